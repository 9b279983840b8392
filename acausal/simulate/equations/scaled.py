"""The equations of a model, scaled: as CasADi's integrators get them.

What parameters and inputs alone determine is computed once per run, which halves the operations of a drill on its
guide. It is an argument, so that functions and integrators serve all runs, whatever their parameters: ThickBlock makes
43 integrators, a quarter of a first run. In large models it is numbers in the expressions instead, which evaluate up to
a fifth faster there, and functions and integrators are kept for the last few values.
"""

from __future__ import annotations

import threading
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.lower.compiled import CompiledModel
from acausal.recent import Recent
from acausal.simulate.equations.calls.buffered import BufferedFunction
from acausal.simulate.equations.calls.in_columns import InColumns, derived, in_columns
from acausal.simulate.equations.calls.raw import Kept
from acausal.simulate.equations.calls.reused import Reused, pays
from acausal.simulate.equations.factorisation import FEW, Factorisation, factorisation
from acausal.simulate.native.columns import is_long
from acausal.simulate.native.equations import equations

_DAE_IN = ["t", "x", "z", "p", "u"]
_DAE_OUT = ["ode", "alg", "quad", "zero"]
# Forms of the equations, and integrators for each of these, that are kept: of models of many unknowns as many as have
# so many together, one at least.
_FORMS, _INTEGRATORS, _UNKNOWNS = 4, 128, 128_000
# Instructions of equations whose parameters are arguments.
_LARGEST_SHARED = 2000
# What integrators derive from the equations, by CasADi's names.
_DERIVED = "daeF", "jacF"
# Those that ask for a Jacobian with every Newton matrix.
_MULTISTEP = frozenset(("idas", "cvodes"))
LARGEST = 1e100
"""Scaled rates and residuals beyond it are none."""
UNIT = 2.0**20
"""How long a stretched interval is: its shortest piece is far from what SUNDIALS' interfaces take for nothing."""
# What is left of an algebraic equation at its root, as a share of what its unknowns can make of it, and of the size of
# its terms; and the iterations to it.
_ROOT, _ROUNDING = 1e-8, 1e-12
_MOST_ITERATIONS = 40


# Of a form of the equations: plugin, hash, whether compiled code may be used, and thread.
_Form = tuple[str, int, bool, int]


class ScaledEquations:
    """Equations of `compiled`.

    The parameter vector of all forms is `[c, m, d, shift]`: what parameters and inputs alone determine, modes of
    events, discrete variables, and the time at which a segment starts (a CasADi integrator has its time frozen at
    construction).
    """

    def __init__(self, compiled: CompiledModel, zeros: tuple[int, ...], values: tuple[Vector, Vector] | None) -> None:
        """For parameters that are zero at `zeros`, or with these `values` of p and u as numbers; c is empty then."""
        self.n, self.nq, self.nd = compiled.n_dynamic, compiled.quadratures, compiled.discretes
        self.nz, self.nm = len(compiled.algebraic), compiled.n_modes
        self._rhs = compiled.rhs
        self._scale_x, self._scale_z = compiled.nominal_x[: self.n], compiled.nominal_z
        self._shared: Any = None
        if values is None:
            self._shared, constants = equations(compiled, zeros)
            self._constants = BufferedFunction(constants)
        else:
            self._p, self._u = (v.copy() for v in values)
            self._columns = compiled.mapped(zeros)
        self._integrators: Recent[Kept] = Recent(min(_INTEGRATORS, max(_UNKNOWNS // (self.n + self.nz), 1)))
        self._derived: Recent[tuple[Any, dict[str, Any]]] = Recent(_FORMS)
        self._reused: dict[_Form, tuple[Any, Reused]] = {}
        self._in_columns: dict[_Form, tuple[Any, InColumns | None]] = {}
        self._slowed: dict[tuple[int, float], Any] = {}
        self._measured: dict[int, Any] = {}
        self._stretched: dict[int, Any] = {}
        self._reordered: dict[int, Any] = {}

    @property
    def is_shared(self) -> bool:
        """Whether it serves all parameters that are zero at the same places."""
        return self._shared is not None

    def constants(self, p: Vector, u: Vector) -> Vector:
        """What parameters and inputs alone determine, c."""
        return np.zeros(0) if self._shared is None else self._constants(p, u)[0]

    @cached_property
    def scaled(self) -> tuple[Any, ...]:
        """Symbols t, x, z, [c, m, d, shift], and the scaled expressions ode and alg."""
        n, nm, nd = self.n, self.nm, self.nd
        t = ca.SX.sym("t")
        x, z = ca.SX.sym("x", n), ca.SX.sym("z", self.nz)
        if self._shared is not None:
            p = ca.SX.sym("p", self._shared.numel_in("p"))
            return t, x, z, p, *self._shared(t, x, z, p, ca.SX(0, 1))[:2]
        p = ca.SX.sym("p", nm + nd + 1)
        m, d, shift = ca.vertsplit(p, [0, nm, nm + nd, nm + nd + 1])  # p[0:0] would be p[0]
        full_x = ca.vertcat(x * ca.DM(self._scale_x), ca.SX(self.nq, 1), d)
        ode, alg = self._rhs(t + shift, full_x, z * ca.DM(self._scale_z), self._u, self._p, m)
        return t, x, z, p, ca.densify(ode)[:n] / ca.DM(self._scale_x), ca.densify(alg)

    @cached_property
    def dae(self) -> Any:
        """`(t, x, z, p, u) -> (ode, alg, quad, zero)` for integrators that take algebraic variables.

        SX, or MX with each pattern of repeated components once (`acausal.lower.columns.mapped`).
        """
        if self._shared is not None:
            return self._shared
        form = self._columns
        if form is not None:
            constants = np.array(form.constants(self._p, self._u)).ravel()
            if np.isfinite(constants).all():
                return form.dae(self._scale_x, self._scale_z, constants)
        t, x, z, p, ode, alg = self.scaled
        none = ca.SX(0, 1)
        return ca.Function("dae", [t, x, z, p, ca.SX.sym("u", 0)], [ode, alg, none, none], _DAE_IN, _DAE_OUT)

    @cached_property
    def buffered(self) -> BufferedFunction:
        """`dae`, for single points."""
        return BufferedFunction(self.dae)

    @cached_property
    def ode(self) -> Any:
        """The same without algebraic variables: a rootfinder solves for them; its start is appended to `p`.

        Where it does not converge the rates are nan: adaptive methods try a shorter step, others end there.
        """
        if self.nz == 0:
            return self.dae
        t, x, z, p, ode, alg = self.scaled
        full = ca.Function("full", [t, x, z, p], [ode])
        time, state, par = ca.MX.sym("t"), ca.MX.sym("x", x.numel()), ca.MX.sym("p", p.numel())
        z0 = ca.MX.sym("z0", self.nz)
        solved: Any = self._root(t, x, z, p, alg)(z0, ca.vertcat(time, state, par))
        solved = ca.if_else(self.is_root(time, state, solved, par), solved, float("nan"))
        none = ca.MX(0, 1)
        arguments: list[Any] = [time, state, ca.MX.sym("z", 0), ca.vertcat(par, z0), ca.MX.sym("u", 0)]
        return ca.Function("ode", arguments, [full(time, state, solved, par), none, none, none], _DAE_IN, _DAE_OUT)

    @cached_property
    def is_root(self) -> Any:
        """`(t, x, z, [c, m, d, shift]) -> 1` where the algebraic equations hold, all scaled."""
        t, x, z, p, _, alg = self.scaled
        reach = ca.fabs(ca.jacobian(alg, z)) @ (1 + ca.fabs(z))
        others = ca.vertcat(t, x, p)
        terms = reach + ca.fabs(ca.jacobian(alg, others)) @ ca.fabs(others)
        return ca.Function("is_root", [t, x, z, p], [ca.mmax(ca.fabs(alg) - _ROOT * reach - _ROUNDING * terms) <= 0])

    @cached_property
    def slope(self) -> BufferedFunction:
        """`(t, x, z, [c, m, d, shift]) -> (d alg/dz, size of the terms of alg)`, all scaled."""
        t, x, z, p, _, alg = self.scaled
        by_x, by_z = ca.jacobian(alg, x), ca.jacobian(alg, z)
        sizes = ca.fabs(by_x) @ ca.fabs(x) + ca.fabs(by_z) @ ca.fabs(z)
        return BufferedFunction(ca.Function("slope", [t, x, z, p], [ca.densify(by_z), ca.densify(sizes)]))

    @cached_property
    def buffered_is_root(self) -> BufferedFunction:
        """`is_root`, for single points."""
        return BufferedFunction(self.is_root)

    @cached_property
    def halting_dae(self) -> Any:
        """`dae`, with steps that end at outputs."""
        return halting(self.dae)

    @cached_property
    def halting_ode(self) -> Any:
        """`ode`, with steps that end at outputs."""
        return halting(self.ode)

    @cached_property
    def algebraic_root(self) -> BufferedFunction:
        """Rootfinder for consistent algebraic variables: `(z, [t, x, c, m, d, shift]) -> z`, all scaled."""
        t, x, z, p, _, alg = self.scaled
        return BufferedFunction(self._root(t, x, z, p, alg))

    def _root(self, t: Any, x: Any, z: Any, p: Any, alg: Any) -> Any:
        """Rootfinder `(z0, [t, x, p]) -> z` for the scaled algebraic equations.

        The step decides, and no residual: equations have units of their own, and one of picocoulombs is small anywhere.
        """
        residual = ca.Function("residual", [z, ca.vertcat(t, x, p)], [alg], ["z", "q"], ["r"])
        return ca.rootfinder(
            "algebraic",
            "newton",
            residual,
            {
                "abstol": 0.0,
                "abstolStep": 1e-10,
                "max_iter": _MOST_ITERATIONS,
                "error_on_fail": False,
                "show_eval_warnings": False,  # a step that leads there is tried again, shorter
            },
        )

    def slowed(self, dae: Any, unit: float) -> Any:
        """One of these forms with time in another unit [s]."""
        key = int(dae.__hash__()), unit
        if key not in self._slowed:
            arguments = dae.sx_in() if dae.is_a("SXFunction") else dae.mx_in()
            ode, *others = dae(unit * arguments[0], *arguments[1:])
            slow = ca.Function(dae.name(), arguments, [unit * ode, *others], dae.name_in(), dae.name_out())
            self._slowed[key] = slow
        return self._slowed[key]

    def measured(self, dae: Any) -> Any:
        """See `measured`; made once."""
        key = int(dae.__hash__())
        if key not in self._measured:
            self._measured[key] = measured(dae)
        return self._measured[key]

    @cached_property
    def limited_dae(self) -> Any:
        """`dae`, where what has no finite value is a large one: see `limited`."""
        return limited(self.dae)

    @cached_property
    def factorisation(self) -> Factorisation | None:
        """How the Newton matrices of `dae` are factorised; None by QR, with the variables as they come."""
        if self.n + self.nz <= FEW:
            return None
        dae = self.dae
        places = (("ode", "x"), ("ode", "z"), ("alg", "x"), ("alg", "z")) if self.nz else (("ode", "x"),)
        blocks = [ca.DM(dae.jac_sparsity(dae.index_out(f), dae.index_in(v))) for f, v in places]
        whole = ca.blockcat([blocks[:2], blocks[2:]]) if self.nz else blocks[0]
        return factorisation((whole + ca.DM.eye(self.n + self.nz)).sparsity(), self.n)

    def reordered(self, dae: Any, order: Factorisation) -> Any:
        """One of these forms with its variables in the order of its `factorisation`."""
        x, z = order.x, order.z
        key = int(dae.__hash__())
        if key not in self._reordered:
            kind: Any = ca.SX if dae.is_a("SXFunction") else ca.MX
            arguments = [kind.sym(name, dae.numel_in(k)) for k, name in enumerate(_DAE_IN)]
            t, own_x, own_z, *others = arguments
            ode, alg, *more = dae(t, own_x[np.argsort(x).tolist()], own_z[np.argsort(z).tolist()], *others)
            results = [ode[x.tolist()], alg[z.tolist()], *more]
            self._reordered[key] = ca.Function("dae", arguments, results, _DAE_IN, _DAE_OUT)
        return self._reordered[key]

    def stretched(self, dae: Any) -> Any:
        """One of these forms over a time from 0 to `UNIT` (`stretched`)."""
        key = int(dae.__hash__())
        if key not in self._stretched:
            self._stretched[key] = stretched(dae)
        return self._stretched[key]

    def integrator(
        self,
        plugin: str,
        dae: Any,
        grid: Vector,
        settings: dict[str, Any],
        *,
        native: bool = False,
        by_columns: bool = False,
    ) -> Kept:
        """An integrator of `dae`, one of these equations in some form, from 0 over the times of `grid`.

        For one call: what is kept for its steps is forgotten here.

        `native`: A multistep method may use compiled code: its Jacobian is computed by columns, if that is less work.
        `by_columns`: It gets its rates from equal parts at once, if there are enough of them.
        """
        form = _form(plugin, dae, native)
        by_columns = by_columns and self._has_columns(form, dae)
        reused = self.reused(plugin, dae, native)
        if reused is not None:
            reused.begin()
        # a function has one memory that is its own: no two threads may share it
        given = tuple((name, v if isinstance(v, (float, int, str)) else repr(v)) for name, v in settings.items())
        key = *form, grid.tobytes(), given, by_columns
        found = self._integrators.get(key)
        return found or self._integrators.put(key, Kept(self._made(form, dae, grid, settings, by_columns)))

    def reused(self, plugin: str, dae: Any, native: bool = False) -> Reused | None:
        """The Jacobian of these integrators in this thread, where it serves several steps."""
        found = self._reused.get(_form(plugin, dae, native))
        return found and found[1]

    def _made(self, form: _Form, dae: Any, grid: Vector, settings: dict[str, Any], by_columns: bool) -> Any:
        """A new integrator, with the equations and Jacobians that another one of this thread has derived.

        To derive and order the Jacobian is nearly all of what an integrator of many equations costs.
        """
        plugin = form[0]
        _, shared = self._derived.get(form) or (dae, {})
        shared = shared or self._derived_by_columns(form, dae)
        # what is not finite is named by `failure.py`, once, and a step that leads there is tried again, shorter
        options = {**settings, "show_eval_warnings": False, "cache": self._by_columns(form, dae, shared, by_columns)}
        found = ca.integrator("segment", plugin, dae, 0.0, grid.tolist(), options)
        # rootfinders inside of MX have a memory of their own
        if not shared and (self.nz == 0 or dae.is_a("SXFunction")):
            shared = {name: found.get_function(name) for name in _DERIVED if found.has_function(name)}
            if plugin in _MULTISTEP and self.nz == 0 and pays(dae, shared["jacF"]):
                # one for all that call it, and held as long as they may be
                _, shared["jacF"] = self._reused.setdefault(form, (dae, Reused(shared["jacF"])))
            changed = self._by_columns(form, dae, shared, by_columns)
            if changed is not shared or form in self._reused:
                found = ca.integrator("segment", plugin, dae, 0.0, grid.tolist(), {**options, "cache": changed})
        self._derived.put(form, (dae, shared))  # a function that is held has its hash for itself
        return found

    def _derived_by_columns(self, form: _Form, dae: Any) -> dict[str, Any]:
        """What an integrator would derive itself, where that is less work by columns; else nothing.

        From the first integrator on: a Jacobian that is rounded otherwise in the second run would give other results.
        """
        plugin, _, native, _ = form
        if not native or plugin not in _MULTISTEP or self.nz or not is_long(dae):
            return {}
        found = derived(dae.factory("daeF", _DAE_IN, _DAE_OUT[:2]))
        self._in_columns[form] = dae, None if found is None else found.rates
        if found is None or found.jacobian is None:
            return {}
        self._reused[form] = dae, Reused(found.jacobian)
        return {"daeF": found.rates, "jacF": self._reused[form][1]}

    def _has_columns(self, form: _Form, dae: Any) -> bool:
        """Whether rates may be evaluated by columns; else no integrator is made anew for them."""
        if form[0] not in _MULTISTEP or not is_long(dae):
            return False
        tried = self._in_columns.get(form)
        return tried is None or tried[1] is not None

    def _by_columns(self, form: _Form, dae: Any, shared: dict[str, Any], wanted: bool) -> dict[str, Any]:
        """What integrators share, with the rates by columns where these are wanted, and pay."""
        if not wanted or "daeF" not in shared:
            return shared
        if form not in self._in_columns:
            self._in_columns[form] = dae, in_columns(shared["daeF"])  # a function that is held has its hash for itself
        rates = self._in_columns[form][1]
        return shared if rates is None else {**shared, "daeF": rates}


def _form(plugin: str, dae: Any, native: bool) -> _Form:
    return plugin, int(dae.__hash__()), native, threading.get_ident()


def stretched(dae: Any) -> Any:
    """The same over a time from 0 to `UNIT`, whose length [s] is one more parameter."""
    kind: Any = ca.SX if dae.is_a("SXFunction") else ca.MX
    t, x, z, p, u = (kind.sym(name, dae.numel_in(k)) for k, name in enumerate(_DAE_IN))
    length = kind.sym("length")
    ode, *others = dae(t * (length / UNIT), x, z, p, u)
    arguments = [t, x, z, ca.vertcat(p, length), u]
    return ca.Function("dae", arguments, [length / UNIT * ode, *others], _DAE_IN, _DAE_OUT)


def measured(dae: Any) -> Any:
    """The same with algebraic variables in other units, which are more parameters: z is `units` times as large."""
    kind: Any = ca.SX if dae.is_a("SXFunction") else ca.MX
    t, x, z, p, u = (kind.sym(name, dae.numel_in(k)) for k, name in enumerate(_DAE_IN))
    units = kind.sym("units", z.numel())
    return ca.Function("dae", [t, x, z, ca.vertcat(p, units), u], dae(t, x, units * z, p, u), _DAE_IN, _DAE_OUT)


def limited(dae: Any) -> Any:
    """A form whose rates and residuals lie within `LARGEST`, not a number being at one end.

    CasADi's integrators of fixed steps go on with whatever stands in their memory when the equations of a step have no
    finite value. A large residual is one that Newton's method reports instead.
    """
    kind: Any = ca.SX if dae.is_a("SXFunction") else ca.MX
    arguments = [kind.sym(name, dae.numel_in(k)) for k, name in enumerate(_DAE_IN)]
    ode, alg, *others = dae(*arguments)
    within = [ca.fmax(ca.fmin(part, LARGEST), -LARGEST) for part in (ode, alg)]
    return ca.Function("dae", arguments, [*within, *others], _DAE_IN, _DAE_OUT)


def halting(dae: Any) -> Any:
    """The same with a control that acts on nothing.

    CasADi's one-step methods interpolate outputs between their steps, by a polynomial that holds for slow components
    only: of a fast one that follows a source the rows are 20 mV off where the steps are right to 1e-10 V. A step ends
    where a control changes, so one that is another number at each output makes each output a step.
    """
    kind: Any = ca.SX if dae.is_a("SXFunction") else ca.MX
    t, x, z, p = (kind.sym(name, dae.numel_in(name)) for name in _DAE_IN[:4])
    return ca.Function("dae", [t, x, z, p, kind.sym("u")], dae(t, x, z, p, kind(0, 1)), _DAE_IN, _DAE_OUT)


def controls(count: int) -> Vector:
    """Values of that control in the intervals before `count` outputs."""
    return np.array(np.arange(count) % 2, dtype=np.float64)


_MADE: WeakKeyDictionary[CompiledModel, Recent[ScaledEquations]] = WeakKeyDictionary()


def scaled_equations(compiled: CompiledModel, p: Vector, u: Vector) -> ScaledEquations:
    """The equations for these values, from the last few forms that were asked for."""
    zeros = tuple(np.flatnonzero(p == 0.0).tolist())
    if compiled.rhs.n_instructions() <= _LARGEST_SHARED and compiled.mapped(zeros) is None:
        found = _kept(compiled, zeros, None)
        if np.isfinite(found.constants(p, u)).all():
            return found
    return with_values(compiled, p, u)


def with_values(compiled: CompiledModel, p: Vector, u: Vector) -> ScaledEquations:
    """The equations with these values as numbers: what was divided by zero may be multiplied by zero again."""
    return _kept(compiled, tuple(np.flatnonzero(p == 0.0).tolist()), (p, u))


def _kept(compiled: CompiledModel, zeros: tuple[int, ...], values: tuple[Vector, Vector] | None) -> ScaledEquations:
    compiled = compiled.common
    made = _MADE.setdefault(compiled, Recent(_FORMS))
    key = zeros if values is None else tuple(v.tobytes() for v in values)
    return made.get(key) or made.put(key, ScaledEquations(compiled, zeros, values))
