"""Jacobians that are reused for several steps of a multistep method.

SUNDIALS requests a Newton matrix whenever its step has changed. A matrix with an older Jacobian is as good as long as
Newton's method converges, because it does not affect the solution: CVODE keeps one for 50 steps, but CasADi's
interfaces evaluate the Jacobian each time. If that takes as long as many evaluations of the rates (18 for a box on a
box), it dominates a run. Source of the strategy: A. C. Hindmarsh et al., SUNDIALS: suite of nonlinear and
differential/algebraic equation solvers, ACM Transactions on Mathematical Software 31 (2005) 363-396, section 2.1.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from acausal.simulate.equations.calls.in_columns import BufferCallback, outputs

_REUSED = 5
"""Consecutive Newton matrices that use an older Jacobian; each matrix serves about seven steps between kinks."""
# A Jacobian is reused if it has at least this many instructions, and this many times as many as the rates.
_MANY_INSTRUCTIONS, _WORK_RATIO = 8_000, 8


def pays(rates: Any, jacobian: Any) -> bool:
    """Whether evaluations of this Jacobian dominate an integration of these rates."""
    if not rates.is_a("SXFunction") or not jacobian.is_a("SXFunction"):
        return False
    return bool(jacobian.n_instructions() >= max(_MANY_INSTRUCTIONS, _WORK_RATIO * rates.n_instructions()))


class Reused(BufferCallback):
    """A Jacobian function `(t, x, z, p, u) -> blocks` that returns the result for an earlier point several times.

    A step that is repeated calls it at an earlier time. The first repetition gets the same Jacobian, as the error of
    the step may have been too large; the next one gets a new Jacobian, as Newton's method may not have converged. An
    object serves one thread and one integration at a time; `begin` is called before each, so that results do not depend
    on earlier integrations.
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
        """Begin an integration: the next call evaluates the Jacobian."""
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
