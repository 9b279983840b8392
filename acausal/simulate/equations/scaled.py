"""The scaled equations of a model, in the forms that CasADi's integrators take.

Values that parameters and inputs alone determine are computed once per run, which halves the operations of a drill on
its guide. They are arguments of the equations, so that functions and integrators serve runs with any parameters:
ThickBlock builds 43 integrators, which takes a quarter of a first run. In large models these values are numbers in the
expressions instead, which evaluate up to a fifth faster there; functions and integrators are then cached for the last
few sets of values.
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
from acausal.simulate.native.columns.translation import is_long
from acausal.simulate.native.equations import equations

_DAE_INPUTS = ["t", "x", "z", "p", "u"]
_DAE_OUTPUTS = ["ode", "alg", "quad", "zero"]
# Cached forms of the equations, and cached integrators for each form: for large models, only as many integrators as
# have `_UNKNOWNS` together, at least one.
_FORMS, _INTEGRATORS, _UNKNOWNS = 4, 128, 128_000
# Equations with more instructions have the values of parameters as numbers.
_LARGEST_WITH_ARGUMENTS = 2000
# Functions that integrators derive from the equations, by CasADi's names.
_DERIVED = "daeF", "jacF"
# Plugins that evaluate a Jacobian for every Newton matrix.
_MULTISTEP = frozenset(("idas", "cvodes"))
LARGEST = 1e100
"""Larger scaled rates and residuals count as not finite."""
UNIT = 2.0**20
"""Length of a stretched interval: its shortest piece is far longer than what SUNDIALS' interfaces treat as zero."""
# Residual of an algebraic equation at its root, relative to the terms of its unknowns, and to all of its terms; and the
# iterations to find the root.
_ROOT, _ROUNDING = 1e-8, 1e-12
_MOST_ITERATIONS = 40


# Key of a form of the equations: plugin, hash, whether compiled code may be used, and thread.
_Form = tuple[str, int, bool, int]


class ScaledEquations:
    """Equations of `compiled`.

    The parameter vector of all forms is `[c, m, d, shift]`: values that parameters and inputs alone determine, modes of
    events, discrete variables, and the start of the segment (a CasADi integrator has fixed times, so it begins at 0).
    """

    def __init__(self, compiled: CompiledModel, zeros: tuple[int, ...], values: tuple[Vector, Vector] | None) -> None:
        """Build for parameters that are zero at `zeros`, or with these `values` of p and u as numbers and empty c."""
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
        self._integrators: Recent[Kept] = Recent(min(_INTEGRATORS, max(_UNKNOWNS // max(self.n + self.nz, 1), 1)))
        self._derived: Recent[tuple[Any, dict[str, Any]]] = Recent(_FORMS)
        self._reused: dict[_Form, tuple[Any, Reused]] = {}
        self._in_columns: dict[_Form, tuple[Any, InColumns | None]] = {}
        self._in_unit_of_time: dict[tuple[int, float], Any] = {}
        self._in_units: dict[int, Any] = {}
        self._stretched: dict[int, Any] = {}
        self._reordered: dict[int, Any] = {}

    def constants(self, p: Vector, u: Vector) -> Vector:
        """The values c that parameters and inputs alone determine."""
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

        It is an SX function, or MX with each pattern of repeated components once (`acausal.lower.columns.mapped`).
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
        return ca.Function("dae", [t, x, z, p, ca.SX.sym("u", 0)], [ode, alg, none, none], _DAE_INPUTS, _DAE_OUTPUTS)

    @cached_property
    def buffered(self) -> BufferedFunction:
        """`dae`, for single points."""
        return BufferedFunction(self.dae)

    @cached_property
    def ode(self) -> Any:
        """`dae` without algebraic variables: a rootfinder solves for them, and its initial guess is appended to `p`.

        Where it does not converge, the rates are nan: adaptive methods try a shorter step, others fail.
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
        return ca.Function(
            "ode", arguments, [full(time, state, solved, par), none, none, none], _DAE_INPUTS, _DAE_OUTPUTS
        )

    @cached_property
    def is_root(self) -> Any:
        """`(t, x, z, [c, m, d, shift]) -> 1` where the algebraic equations hold, all scaled."""
        t, x, z, p, _, alg = self.scaled
        unknown_terms = ca.fabs(ca.jacobian(alg, z)) @ (1 + ca.fabs(z))
        others = ca.vertcat(t, x, p)
        terms = unknown_terms + ca.fabs(ca.jacobian(alg, others)) @ ca.fabs(others)
        return ca.Function(
            "is_root", [t, x, z, p], [ca.mmax(ca.fabs(alg) - _ROOT * unknown_terms - _ROUNDING * terms) <= 0]
        )

    @cached_property
    def slope(self) -> BufferedFunction:
        """`(t, x, z, [c, m, d, shift]) -> (d alg/dz, magnitude of the terms of alg in x and z)`, all scaled."""
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
        """`dae` with steps that end at outputs; see `halting`."""
        return halting(self.dae)

    @cached_property
    def halting_ode(self) -> Any:
        """`ode` with steps that end at outputs; see `halting`."""
        return halting(self.ode)

    @cached_property
    def algebraic_root(self) -> BufferedFunction:
        """Rootfinder for consistent algebraic variables: `(z, [t, x, c, m, d, shift]) -> z`, all scaled."""
        t, x, z, p, _, alg = self.scaled
        return BufferedFunction(self._root(t, x, z, p, alg))

    def _root(self, t: Any, x: Any, z: Any, p: Any, alg: Any) -> Any:
        """Rootfinder `(z0, [t, x, p]) -> z` for the scaled algebraic equations.

        It converges by the size of its steps, not of residuals: equations have units, and the residual of one in
        picocoulombs is always small.
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
                "show_eval_warnings": False,  # solvers repeat a step without finite values with a shorter one
            },
        )

    def in_unit_of_time(self, dae: Any, unit: float) -> Any:
        """One of these forms with time in another unit [s], cached."""
        key = int(dae.__hash__()), unit
        if key not in self._in_unit_of_time:
            arguments = dae.sx_in() if dae.is_a("SXFunction") else dae.mx_in()
            ode, *others = dae(unit * arguments[0], *arguments[1:])
            slow = ca.Function(dae.name(), arguments, [unit * ode, *others], dae.name_in(), dae.name_out())
            self._in_unit_of_time[key] = slow
        return self._in_unit_of_time[key]

    def in_units(self, dae: Any) -> Any:
        """One of these forms with algebraic variables in other units (`in_units`), cached."""
        key = int(dae.__hash__())
        if key not in self._in_units:
            self._in_units[key] = in_units(dae)
        return self._in_units[key]

    @cached_property
    def limited_dae(self) -> Any:
        """`dae` with large values in place of those that are not finite; see `limited`."""
        return limited(self.dae)

    @cached_property
    def factorisation(self) -> Factorisation | None:
        """The factorisation for the Newton matrices of `dae`; None for QR, with the variables in their own order."""
        if self.n + self.nz <= FEW:
            return None
        dae = self.dae
        pairs = (("ode", "x"), ("ode", "z"), ("alg", "x"), ("alg", "z")) if self.nz else (("ode", "x"),)
        blocks = [ca.DM(dae.jac_sparsity(dae.index_out(f), dae.index_in(v))) for f, v in pairs]
        pattern = ca.blockcat([blocks[:2], blocks[2:]]) if self.nz else blocks[0]
        return factorisation((pattern + ca.DM.eye(self.n + self.nz)).sparsity(), self.n)

    def reordered(self, dae: Any, order: Factorisation) -> Any:
        """One of these forms with its variables in the order of its `factorisation`, cached."""
        x, z = order.x, order.z
        key = int(dae.__hash__())
        if key not in self._reordered:
            kind: Any = ca.SX if dae.is_a("SXFunction") else ca.MX
            arguments = [kind.sym(name, dae.numel_in(k)) for k, name in enumerate(_DAE_INPUTS)]
            t, own_x, own_z, *others = arguments
            ode, alg, *more = dae(t, own_x[np.argsort(x).tolist()], own_z[np.argsort(z).tolist()], *others)
            results = [ode[x.tolist()], alg[z.tolist()], *more]
            self._reordered[key] = ca.Function("dae", arguments, results, _DAE_INPUTS, _DAE_OUTPUTS)
        return self._reordered[key]

    def stretched(self, dae: Any) -> Any:
        """One of these forms over a time from 0 to `UNIT` (`stretched`), cached."""
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
        """Return an integrator of `dae`, one form of these equations, from 0 over the times of `grid`, for one call.

        A Jacobian that is reused from step to step is reset, so that the call does not depend on earlier ones.

        `native` allows a multistep method to use compiled code, which computes its Jacobian by columns if that is less
        work. `by_columns` does the same for its rates: equal parts are computed together, if there are enough of them.
        """
        form = _form(plugin, dae, native)
        by_columns = by_columns and self._has_columns(form, dae)
        reused = self.reused(plugin, dae, native)
        if reused is not None:
            reused.begin()
        # a function has a memory of its own, which two threads must not share
        options_key = tuple((name, v if isinstance(v, (float, int, str)) else repr(v)) for name, v in settings.items())
        key = *form, grid.tobytes(), options_key, by_columns
        cached = self._integrators.get(key)
        return cached or self._integrators.put(key, Kept(self._build(form, dae, grid, settings, by_columns)))

    def reused(self, plugin: str, dae: Any, native: bool = False) -> Reused | None:
        """The Jacobian that integrators of this form reuse for several steps in this thread; None if they do not."""
        found = self._reused.get(_form(plugin, dae, native))
        return found and found[1]

    def _build(self, form: _Form, dae: Any, grid: Vector, settings: dict[str, Any], by_columns: bool) -> Any:
        """Build an integrator with the functions and Jacobians that an earlier one of this thread has derived.

        For many equations, deriving and ordering the Jacobian is nearly all of the cost of building an integrator.
        """
        plugin = form[0]
        _, shared = self._derived.get(form) or (dae, {})
        shared = shared or self._derived_by_columns(form, dae)
        # no warnings of values that are not finite: steps are repeated with shorter ones, and `failure.py` explains
        options = {**settings, "show_eval_warnings": False, "cache": self._by_columns(form, dae, shared, by_columns)}
        integrator = ca.integrator("segment", plugin, dae, 0.0, grid.tolist(), options)
        # a rootfinder inside of an MX function has a memory of its own, so that the function cannot be shared
        if not shared and (self.nz == 0 or dae.is_a("SXFunction")):
            shared = {name: integrator.get_function(name) for name in _DERIVED if integrator.has_function(name)}
            if plugin in _MULTISTEP and self.nz == 0 and pays(dae, shared["jacF"]):
                # one for all integrators that call it, kept alive as long as they may be
                _, shared["jacF"] = self._reused.setdefault(form, (dae, Reused(shared["jacF"])))
            changed = self._by_columns(form, dae, shared, by_columns)
            if changed is not shared or form in self._reused:
                integrator = ca.integrator("segment", plugin, dae, 0.0, grid.tolist(), {**options, "cache": changed})
        self._derived.put(form, (dae, shared))  # `dae` is kept alive so that its hash stays unique
        return integrator

    def _derived_by_columns(self, form: _Form, dae: Any) -> dict[str, Any]:
        """The functions that an integrator would derive itself, by columns if that is less work; otherwise empty.

        This is decided for the first integrator already: a Jacobian with other rounding errors in the second run would
        give other results.
        """
        plugin, _, native, _ = form
        if not native or plugin not in _MULTISTEP or self.nz or not is_long(dae):
            return {}
        by_columns = derived(dae.factory("daeF", _DAE_INPUTS, _DAE_OUTPUTS[:2]))
        self._in_columns[form] = dae, None if by_columns is None else by_columns.rates
        if by_columns is None or by_columns.jacobian is None:
            return {}
        self._reused[form] = dae, Reused(by_columns.jacobian)
        return {"daeF": by_columns.rates, "jacF": self._reused[form][1]}

    def _has_columns(self, form: _Form, dae: Any) -> bool:
        """Whether rates may be evaluated by columns; otherwise no integrator has to be built again for them."""
        if form[0] not in _MULTISTEP or not is_long(dae):
            return False
        known = self._in_columns.get(form)
        return known is None or known[1] is not None

    def _by_columns(self, form: _Form, dae: Any, shared: dict[str, Any], wanted: bool) -> dict[str, Any]:
        """The functions that integrators share, with the rates by columns if these are wanted and pay off."""
        if not wanted or "daeF" not in shared:
            return shared
        if form not in self._in_columns:
            self._in_columns[form] = dae, in_columns(shared["daeF"])  # kept alive as in `_build`
        rates = self._in_columns[form][1]
        return shared if rates is None else {**shared, "daeF": rates}


def _form(plugin: str, dae: Any, native: bool) -> _Form:
    return plugin, int(dae.__hash__()), native, threading.get_ident()


def stretched(dae: Any) -> Any:
    """Transform a form to a time from 0 to `UNIT`; the length of the interval [s] becomes an additional parameter."""
    kind: Any = ca.SX if dae.is_a("SXFunction") else ca.MX
    t, x, z, p, u = (kind.sym(name, dae.numel_in(k)) for k, name in enumerate(_DAE_INPUTS))
    length = kind.sym("length")
    ode, *others = dae(t * (length / UNIT), x, z, p, u)
    arguments = [t, x, z, ca.vertcat(p, length), u]
    return ca.Function("dae", arguments, [length / UNIT * ode, *others], _DAE_INPUTS, _DAE_OUTPUTS)


def in_units(dae: Any) -> Any:
    """Transform a form to algebraic variables z / `units`; the units become additional parameters."""
    kind: Any = ca.SX if dae.is_a("SXFunction") else ca.MX
    t, x, z, p, u = (kind.sym(name, dae.numel_in(k)) for k, name in enumerate(_DAE_INPUTS))
    units = kind.sym("units", z.numel())
    return ca.Function("dae", [t, x, z, ca.vertcat(p, units), u], dae(t, x, units * z, p, u), _DAE_INPUTS, _DAE_OUTPUTS)


def limited(dae: Any) -> Any:
    """Transform a form so that rates and residuals lie within `LARGEST`, and nan becomes one of its ends.

    When the equations of a step have no finite value, CasADi's integrators with fixed steps continue with arbitrary
    values from their memory. With a large residual, Newton's method reports a failure instead.
    """
    kind: Any = ca.SX if dae.is_a("SXFunction") else ca.MX
    arguments = [kind.sym(name, dae.numel_in(k)) for k, name in enumerate(_DAE_INPUTS)]
    ode, alg, *others = dae(*arguments)
    within = [ca.fmax(ca.fmin(part, LARGEST), -LARGEST) for part in (ode, alg)]
    return ca.Function("dae", arguments, [*within, *others], _DAE_INPUTS, _DAE_OUTPUTS)


def halting(dae: Any) -> Any:
    """Add a control that acts on nothing to a form, so that steps end at outputs.

    CasADi's one-step methods interpolate outputs between their steps by a polynomial that is accurate for slow
    components only: for a fast one that follows a source, rows have errors of 20 mV where the steps are accurate to
    1e-10 V. A step ends where a control changes, so a control that changes at each output ends a step there.
    """
    kind: Any = ca.SX if dae.is_a("SXFunction") else ca.MX
    t, x, z, p = (kind.sym(name, dae.numel_in(name)) for name in _DAE_INPUTS[:4])
    return ca.Function("dae", [t, x, z, p, kind.sym("u")], dae(t, x, z, p, kind(0, 1)), _DAE_INPUTS, _DAE_OUTPUTS)


def controls(count: int) -> Vector:
    """Values of the control of `halting` in the intervals before `count` outputs, shape (count,)."""
    return np.array(np.arange(count) % 2, dtype=np.float64)


_MADE: WeakKeyDictionary[CompiledModel, Recent[ScaledEquations]] = WeakKeyDictionary()


def scaled_equations(compiled: CompiledModel, p: Vector, u: Vector) -> ScaledEquations:
    """The equations for these values of p and u, from a cache of the forms used last."""
    zeros = tuple(np.flatnonzero(p == 0.0).tolist())
    if compiled.rhs.n_instructions() <= _LARGEST_WITH_ARGUMENTS and compiled.mapped(zeros) is None:
        shared = _cached(compiled, zeros, None)
        if np.isfinite(shared.constants(p, u)).all():
            return shared
    return with_values(compiled, p, u)


def with_values(compiled: CompiledModel, p: Vector, u: Vector) -> ScaledEquations:
    """The equations with these values as numbers.

    Where a value that c would contain is infinite, the expressions may still be finite: a division by zero that is
    multiplied by zero again.
    """
    return _cached(compiled, tuple(np.flatnonzero(p == 0.0).tolist()), (p, u))


def _cached(compiled: CompiledModel, zeros: tuple[int, ...], values: tuple[Vector, Vector] | None) -> ScaledEquations:
    compiled = compiled.common
    forms = _MADE.setdefault(compiled, Recent(_FORMS))
    key = zeros if values is None else tuple(v.tobytes() for v in values)
    return forms.get(key) or forms.put(key, ScaledEquations(compiled, zeros, values))
