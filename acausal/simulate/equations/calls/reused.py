"""Jacobians that serve several steps of a multistep method.

SUNDIALS asks for a Newton matrix whenever its step has changed. A matrix with an older Jacobian does as well as long as
Newton's method converges, on which the solution does not depend: CVODE keeps one for 50 steps, but CasADi's interfaces
evaluate the Jacobian each time. Where it takes as long as many evaluations of the rates (a box on a box: 18) that is
most of a run. Source of the strategy: A. C. Hindmarsh et al., SUNDIALS: suite of nonlinear and differential/algebraic
equation solvers, ACM Transactions on Mathematical Software 31 (2005) 363-396, section 2.1.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from acausal.simulate.equations.calls.in_columns import OnMemory, outputs

_REUSED = 5
"""Newton matrices in a row that are made of an older Jacobian; each serves seven steps between kinks."""
# Instructions of a Jacobian, and how many times those of the rates, from which on it is most of the work.
_LONG, _SHARE = 8_000, 8


def pays(rates: Any, jacobian: Any) -> bool:
    """Whether evaluations of this Jacobian are most of what an integration of these rates takes."""
    if not rates.is_a("SXFunction") or not jacobian.is_a("SXFunction"):
        return False
    return bool(jacobian.n_instructions() >= max(_LONG, _SHARE * rates.n_instructions()))


class Reused(OnMemory):
    """A Jacobian function `(t, x, z, p, u) -> blocks` that hands out what it has computed for an earlier point.

    A step that is tried again is asked for at an earlier time: once with the same Jacobian, as its error may have been
    too large, then with a new one, as Newton's method may not have converged. For one thread, and one integration after
    the other: `begin` is called before each, so that none depends on those before it.
    """

    def __init__(self, jacobian: Any) -> None:
        super().__init__(jacobian.name(), jacobian, outputs(jacobian))
        self._buffer, self._evaluate = jacobian.buffer()
        for k, argument in enumerate(self._arguments):
            if argument.size:
                self._buffer.set_arg(k, argument.data)
        for k, result in enumerate(self._results):
            if result.size:
                self._buffer.set_res(k, result.data)
        self.begin()

    def begin(self) -> None:
        """Forget what was computed: the next call is the first one of an integration."""
        self.evaluations, self._age, self._retries, self._t = 0, _REUSED, 0, -np.inf

    def _run(self) -> int:
        t = self._arguments[0][0]
        self._retries = self._retries + 1 if t <= self._t else 0
        self._t = t
        if self._age < _REUSED and self._retries <= 1:
            self._age += 1
            return 0
        self._evaluate()
        self.evaluations += 1
        failed = int(self._buffer.ret())
        self._age = _REUSED if failed else 0
        return failed
