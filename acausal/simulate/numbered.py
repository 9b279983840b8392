"""The equations of a model with its parameters and inputs as numbers, scaled: as CasADi's integrators get them.

What parameters alone determine is computed once, which halves the operations of a drill on its guide. Functions and
integrators are kept for the values they were made with: a run of a few milliseconds that is repeated, in a bench or
inside an optimiser, would spend half of its time on making them again.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.lower.compiled import CompiledModel
from acausal.simulate.quick import Quick

Vector = NDArray[np.float64]
_DAE_IN = ["t", "x", "z", "p", "u"]
_DAE_OUT = ["ode", "alg", "quad", "zero"]
# Values of the parameters, and integrators for each of these, that are kept. Large models keep no integrators: they
# take a hundred megabytes, and next to a run their making is nothing.
_VALUES, _INTEGRATORS, _LARGEST = 4, 64, 1000


class Numbered:
    """Equations of `compiled` for the parameters `p` and the inputs `u`.

    The parameter vector that is left is `[m, d, shift]`: modes of events, discrete variables, and the time at which a
    segment starts (a CasADi integrator has its time frozen at construction).
    """

    def __init__(self, compiled: CompiledModel, p: Vector, u: Vector) -> None:
        self.n, self.nq, self.nd = compiled.n_dynamic, compiled.quadratures, compiled.discretes
        self.nz, self.nm = len(compiled.algebraic), compiled.n_modes
        self._rhs = compiled.rhs
        self._scale_x, self._scale_z = compiled.nominal_x[: self.n], compiled.nominal_z
        self._p, self._u = p.copy(), u.copy()
        self._columns = compiled.mapped(tuple(np.flatnonzero(p == 0.0).tolist()))
        self._integrators: OrderedDict[tuple[Any, ...], Any] = OrderedDict()

    @cached_property
    def scaled(self) -> tuple[Any, ...]:
        """Symbols t, x, z, [m, d, shift], and the scaled expressions ode and alg."""
        n, nm, nd = self.n, self.nm, self.nd
        t = ca.SX.sym("t")
        x, z, p = ca.SX.sym("x", n), ca.SX.sym("z", self.nz), ca.SX.sym("p", nm + nd + 1)
        m, d, shift = ca.vertsplit(p, [0, nm, nm + nd, nm + nd + 1])  # p[0:0] would be p[0]
        full_x = ca.vertcat(x * ca.DM(self._scale_x), ca.SX(self.nq, 1), d)
        ode, alg = self._rhs(t + shift, full_x, z * ca.DM(self._scale_z), self._u, self._p, m)
        return t, x, z, p, ca.densify(ode)[:n] / ca.DM(self._scale_x), ca.densify(alg)

    @cached_property
    def dae(self) -> Any:
        """`(t, x, z, p, u) -> (ode, alg, quad, zero)` for integrators that take algebraic variables.

        SX, or MX with each pattern of repeated components once (`acausal.lower.mapped`).
        """
        form = self._columns
        if form is not None:
            constants = np.array(form.constants(self._p, self._u)).ravel()
            if np.isfinite(constants).all():
                return form.dae(self._scale_x, self._scale_z, constants)
        t, x, z, p, ode, alg = self.scaled
        none = ca.SX(0, 1)
        return ca.Function("dae", [t, x, z, p, ca.SX.sym("u", 0)], [ode, alg, none, none], _DAE_IN, _DAE_OUT)

    @cached_property
    def quick(self) -> Quick:
        """`dae`, for single points."""
        return Quick(self.dae)

    @cached_property
    def ode(self) -> Any:
        """The same without algebraic variables: a rootfinder solves for them; its start is appended to `p`."""
        if self.nz == 0:
            return self.dae
        t, x, z, p, ode, alg = self.scaled
        full = ca.Function("full", [t, x, z, p], [ode])
        time, state, par = ca.MX.sym("t"), ca.MX.sym("x", x.numel()), ca.MX.sym("p", p.numel())
        z0 = ca.MX.sym("z0", self.nz)
        solved: Any = self._root(t, x, z, p, alg)(z0, ca.vertcat(time, state, par))
        none = ca.MX(0, 1)
        arguments: list[Any] = [time, state, ca.MX.sym("z", 0), ca.vertcat(par, z0), ca.MX.sym("u", 0)]
        return ca.Function("ode", arguments, [full(time, state, solved, par), none, none, none], _DAE_IN, _DAE_OUT)

    @cached_property
    def algebraic_root(self) -> Quick:
        """Rootfinder for consistent algebraic variables: `(z, [t, x, m, d, shift]) -> z`, all scaled."""
        t, x, z, p, _, alg = self.scaled
        return Quick(self._root(t, x, z, p, alg))

    def _root(self, t: Any, x: Any, z: Any, p: Any, alg: Any) -> Any:
        """Rootfinder `(z0, [t, x, p]) -> z` for the scaled algebraic equations."""
        residual = ca.Function("residual", [z, ca.vertcat(t, x, p)], [alg], ["z", "q"], ["r"])
        return ca.rootfinder(
            "algebraic", "newton", residual, {"abstol": 1e-13, "abstolStep": 1e-10, "error_on_fail": False}
        )

    def integrator(self, plugin: str, dae: Any, grid: Vector, settings: dict[str, Any]) -> Any:
        """An integrator of `dae`, one of these equations in some form, from 0 over the times of `grid`."""
        if self.n + self.nz > _LARGEST:
            return ca.integrator("segment", plugin, dae, 0.0, grid.tolist(), settings)
        # a function has one memory that is its own: no two threads may share it
        key = plugin, dae.__hash__(), grid.tobytes(), repr(sorted(settings.items())), threading.get_ident()
        found = self._integrators.pop(key, None)
        if found is None:
            found = ca.integrator("segment", plugin, dae, 0.0, grid.tolist(), settings)
        self._integrators[key] = found
        if len(self._integrators) > _INTEGRATORS:
            self._integrators.popitem(last=False)
        return found


_MADE: WeakKeyDictionary[CompiledModel, OrderedDict[tuple[bytes, bytes], Numbered]] = WeakKeyDictionary()


def numbered(compiled: CompiledModel, p: Vector, u: Vector) -> Numbered:
    """The equations for these values, from the last few that were asked for."""
    made = _MADE.setdefault(compiled, OrderedDict())
    key = p.tobytes(), u.tobytes()
    found = made.pop(key, None)
    if found is None:
        found = Numbered(compiled, p, u)
    made[key] = found
    if len(made) > _VALUES:
        made.popitem(last=False)
    return found
