"""Statement of an optimal-control problem: model, phases, objective and constraints."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any, Self

import casadi as ca
import numpy as np

from acausal.errors import UsageError, calling_span
from acausal.language.component import Component
from acausal.lower.compile import compile
from acausal.lower.compiled import CompiledModel
from acausal.optimal_control.declare import Constraint, Guard, Mesh, PhaseSpec, Value
from acausal.optimal_control.free_start import refuse_dependents
from acausal.optimal_control.program.points import key
from acausal.optimal_control.quantities import Quantities
from acausal.result.result import Result

_NUMBER = (int, float, np.integer, np.floating)
_RELATIONS = {ca.OP_LE: 1, ca.OP_LT: 1, ca.OP_EQ: 0}
_TRUTHS = {*_RELATIONS, ca.OP_NE, ca.OP_AND, ca.OP_OR, ca.OP_NOT}


class StatedProblem:
    """Statement of an optimal-control problem; `Problem` adds the ways of solving it."""

    def __init__(
        self,
        model: Component | CompiledModel,
        *,
        parameters: Mapping[str, float] | None = None,
        free_start: Sequence[str] = (),
    ) -> None:
        compiled = model if isinstance(model, CompiledModel) else compile(model)
        self.quantities = Quantities(compiled, dict(parameters or {}))
        self.compiled = self.quantities.model  # with all pairs of a contact scene, whose choice a run would change
        self.free_start = tuple(k for name in free_start for k in self.quantities.of_states(name))
        refuse_dependents(self.quantities, self.free_start)
        self.specs: list[PhaseSpec] = []
        self.guards: list[Guard] = []
        self.durations: list[Any] = []
        self.values: list[Value] = []
        self.constraints: list[Constraint] = []
        self.objective: Any = None
        self._are_phases_closed = False
        self.guess_run: Result | None = None
        self.guess_inputs: dict[str, Any] = {}
        self.guess_lines: dict[int, tuple[float, float]] = {}

    def __repr__(self) -> str:
        return f"Problem({self.compiled.name}: {len(self.specs)} phases, {len(self.constraints)} constraints)"

    def __getitem__(self, name: str) -> Any:
        """A variable or parameter by name, as a CasADi symbol; an array as a column.

        Raises UsageError: AC010 for an unknown name.
        """
        return self.quantities[name]

    @property
    def time(self) -> Any:
        """The time [s] as a CasADi symbol."""
        return self.quantities.time

    @property
    def duration(self) -> Any:
        """Total duration of all phases [s] as a CasADi expression."""
        return sum(self.durations[1:], self.durations[0]) if self._close_phases() else None

    def phase(
        self,
        name: str = "",
        *,
        duration: float | tuple[float, float] = (0.0, math.inf),
        until: str | Any = None,
        intervals: int = 10,
        expected: float | None = None,
    ) -> Phase:
        """Append a phase.

        Parameters
        ----------
        duration
            Fixed duration [s], or the limits of a free one.
        until
            Condition that ends the phase: a relation of the model as its events print it ("h < 0"), whose `when`
            clauses then act, or a relation of expressions (`problem["drill.s"] >= 0.004`).
        intervals
            Number of collocation intervals, initially of equal length.
        expected
            Duration in the guess [s]; by default the time at which the run of the guess fulfils `until`, else the
            geometric mean of the limits, else the stop time of the model.

        Raises
        ------
        UsageError
            AC010 for an unknown relation, AC050 for invalid limits, and for a phase declared after a statement about
            all phases.
        """
        shortest, longest = _limits_of(duration)
        if not isinstance(intervals, int) or not 0.0 <= shortest <= longest or longest <= 0.0 or intervals < 1:
            raise UsageError(
                "AC050",
                f"a phase of duration {duration!r} in {intervals} intervals is invalid",
                where=calling_span(),
                help="give duration=(shortest, longest) in s, not negative, and at least one interval",
            )
        if expected is None:
            known = shortest > 0.0 and math.isfinite(longest)
            expected = math.sqrt(shortest * longest) if known else self.compiled.flat.experiment.stop_time
            expected = min(max(expected, shortest), longest)
        if self._are_phases_closed:
            raise UsageError(
                "AC050",
                f"a phase is declared after a statement on all {len(self.specs)} phases",
                where=calling_span(),
                help="declare all phases first, then minimize, subject_to, end, integral",
            )
        number = len(self.specs)
        switch = None
        if until is not None:
            switch = len(self.guards)
            self.guards.append(self.quantities.guard(until if isinstance(until, str) else self._expression(until)))
        label = name or f"phase {number + 1}"
        if any(spec.name == label for spec in self.specs):
            raise UsageError(
                "AC050", f"there is a phase '{label}' already", where=calling_span(), help="choose another: name=..."
            )
        self.specs.append(PhaseSpec(label, shortest, longest, expected, Mesh.uniform(intervals), switch))
        self.durations.append(ca.MX.sym(f"duration of {label}"))
        return Phase(self, number)

    def start(self, what: str | Any) -> Any:
        """Value of a variable or an expression at the start of the first phase."""
        return self._close_phases() and Phase(self, 0).start(what)

    def end(self, what: str | Any) -> Any:
        """Value of a variable or an expression at the end of the last phase."""
        return self._close_phases() and Phase(self, len(self.specs) - 1).end(what)

    def integral(self, what: str | Any) -> Any:
        """Integral of a variable or an expression over all phases."""
        self._close_phases()
        parts = [Phase(self, k).integral(what) for k in range(len(self.specs))]
        return sum(parts[1:], parts[0])

    def decide(self, name: str, *, min: float | None = None, max: float | None = None) -> Any:
        """Make a parameter of the model a decision, within limits; by default those that it declares.

        Raises
        ------
        UsageError
            AC010 for an unknown parameter, AC051 for limits that are no numbers or leave no value, AC053 for one that
            has been used as a number, or decided, before.
        """
        for limit in (min, max):
            _check_limit(limit, name)
        return self.quantities.decide(name, min, max)

    def minimize(self, objective: Any) -> None:
        """Set the objective: a scalar expression of durations, values at ends and integrals.

        A second call replaces the objective, as in CasADi's `Opti.minimize`; add the terms of a sum in one call.
        """
        if isinstance(objective, str) or objective is None:
            objective = self._expression(objective or "")
        self.objective = self._expression(objective)
        if self.objective.numel() != 1 or self.quantities.varies(self.objective):
            raise UsageError(
                "AC053",
                f"{objective} is not a single number to minimize",
                where=calling_span(),
                help="use its integral, or its value at an end: problem.integral(...), problem.end(...)",
            )

    def subject_to(
        self,
        what: str | Any,
        *,
        min: float = -math.inf,
        max: float = math.inf,
        equals: float | None = None,
        name: str = "",
    ) -> None:
        """Add a constraint, in all phases if it varies in time: `subject_to("drill.F_f", max=4e3)`.

        Parameters
        ----------
        what
            Name of a variable or an expression, with `min`, `max` or `equals`; or a relation.
        name
            Name in multipliers and figures; by default the text of the constraint.

        Raises
        ------
        UsageError
            AC010 for an unknown name, AC051 for a constraint without limits.
        """
        self._close_phases()
        self._constrain(what, min, max, equals, name, tuple(range(len(self.specs))))

    def periodic(self, *names: str, shift: float = 0.0) -> None:
        """Require that states end at their start values plus `shift`."""
        for name in names:
            gain = self.end(name) - self.start(name)
            self.subject_to(gain, equals=shift, name=f"{name} is periodic")

    def guess(
        self,
        run: Result | None = None,
        *,
        inputs: Mapping[str, Any] | None = None,
        lines: Mapping[str, tuple[float, float]] | None = None,
    ) -> None:
        """Set the initial guess; by default a simulation with the declared start values of the inputs, or 0.

        Parameters
        ----------
        run
            A result of this model, or the optimum of another problem on it.
        inputs
            Inputs of the simulation, as for `simulate`.
        lines
            States that follow a straight line instead, with their values at the start and the end of all phases.

        Raises
        ------
        UsageError
            AC010 for an unknown state, AC051 for a line that is not a pair of numbers.
        """
        for name, ends in (lines or {}).items():
            if not isinstance(ends, tuple | list) or len(ends) != 2 or not all(isinstance(e, _NUMBER) for e in ends):
                raise UsageError(
                    "AC051", f"the line of {name} is {ends!r}", where=calling_span(), help="lines={'s': (0.0, 4.0)}"
                )
        self.guess_run = run
        self.guess_inputs = dict(inputs or {})
        self.guess_lines = {k: ends for name, ends in (lines or {}).items() for k in self.quantities.of_states(name)}

    def opened(self) -> Self:
        """A copy in which the unknowns of blocks with a monotone search are algebraic variables of the program."""
        found = copy(self)
        found.quantities = self.quantities.opened()
        return found

    def _close_phases(self) -> bool:
        """Ensure that there is a phase, a free one by default, and close the list of phases; always true."""
        if not self.specs:
            self.phase()
        self._are_phases_closed = True
        return True

    def _expression(self, what: str | Any) -> Any:
        if isinstance(what, str):
            return self[what]
        found, q = ca.MX(what), self.quantities
        own = [q.time, *q.symbols, *(symbol for *_, symbol in q.decided), *self.durations]
        known = {key(symbol) for symbol in (*own, *(value.symbol for value in self.values))}
        foreign = [symbol.name() for symbol in ca.symvar(found) if key(symbol) not in known]
        if foreign:
            raise UsageError(
                "AC053",
                f"{foreign[0]} in {found} is not a symbol of this problem",
                where=calling_span(),
                help="take it from this problem: problem[name], problem.time, problem.end(...), problem.decide(...)",
            )
        return found

    def _value(self, phase: int, kind: str, what: str | Any) -> Any:
        """Symbol of a value at the start or end of a phase, or of an integral over it."""
        expression = self._expression(what)
        if not self.quantities.varies(expression):  # a number, or a decided parameter
            return expression * self.durations[phase] if kind == "integral" else expression
        named = what if isinstance(what, str) else str(what)
        place = f" of {self.specs[phase].name}" if len(self.specs) > 1 else ""
        words = {"start": f"{named} at the start{place}", "end": f"{named} at the end{place}"}
        symbol = ca.MX.sym(words.get(kind, f"integral of {named}{place}"), expression.numel())
        self.values.append(Value(symbol, phase, kind, expression))
        return symbol

    def _constrain(
        self, what: Any, lower: float, upper: float, equals: float | None, name: str, phases: tuple[int, ...]
    ) -> None:
        """Append one constraint for each scalar of `what`."""
        for limit in (lower, upper, equals):
            _check_limit(limit, what)
        limits = (lower, upper) != (-math.inf, math.inf)
        if equals is not None:
            if limits:
                raise _lost_limits(what, "equals=")
            lower = upper = equals
        is_name = isinstance(what, str)
        expression = self._expression(what)
        label = name or (what if is_name else "")
        _check_number(expression)
        op = expression.op() if not is_name and expression.n_dep() == 2 else None
        if op in _RELATIONS:
            if limits or equals is not None:
                raise _lost_limits(what, "the relation")
            expression, lower, upper = _relation(expression, op)
            _check_limit(lower, what)
        if lower > upper or lower == math.inf or upper == -math.inf or (lower, upper) == (-math.inf, math.inf):
            raise UsageError(
                "AC051",
                f"the constraint on {label or expression} has no valid limits: {lower:g} ... {upper:g}",
                where=calling_span(),
                help="give min=, max= or equals=, or a relation: subject_to(a <= b)",
            )
        varies = self.quantities.varies(expression)
        where = calling_span()
        for k, entry in enumerate(ca.vertsplit(ca.vec(expression)) if expression.numel() > 1 else [expression]):
            names = self.quantities.entries(what) if is_name else ()
            base = label or str(expression)
            base = base if expression.numel() == 1 else (names[k] if is_name and not name else f"{base}[{k}]")
            text = base if name else constraint_text(base, lower, upper)
            scale = self.quantities.nominal(names[k]) if is_name else _magnitude(lower, upper)
            variable = names[k] if is_name else self.quantities.name_of(entry)
            if any(c.name == text and (c.lower, c.upper) != (lower, upper) for c in self.constraints):
                raise UsageError(
                    "AC051",
                    f"there is a constraint '{text}' with other limits",
                    where=where,
                    help="choose another: name=...",
                )
            self.constraints.append(
                Constraint(text, entry, lower, upper, phases if varies else (), variable, scale, where)
            )


def _limits_of(duration: Any) -> tuple[float, float]:
    """The shortest and the longest duration [s]; nan if `duration` is neither a number nor a pair of numbers."""
    if isinstance(duration, _NUMBER):
        return float(duration), float(duration)
    if isinstance(duration, tuple | list) and len(duration) == 2 and all(isinstance(d, _NUMBER) for d in duration):
        return float(duration[0]), float(duration[1])
    return math.nan, math.nan


def _check_limit(limit: Any, what: object) -> None:
    """Raise UsageError AC051 for a limit that is no number; None is no limit."""
    if limit is not None and (not isinstance(limit, _NUMBER) or isinstance(limit, bool) or math.isnan(limit)):
        raise UsageError(
            "AC051",
            f"the limit {limit!r} of {what} is not a number",
            where=calling_span(),
            help="limits are numbers in SI units: max=4e3 for 4 kN",
        )


def _check_number(expression: Any) -> None:
    """AC051 for a constraint on a truth value, whose slopes are zero: `(u <= 1) >= -1` always holds."""
    sides = [expression] if expression.numel() == 1 else []
    if sides and expression.op() in _RELATIONS:
        sides = [expression.dep(0), expression.dep(1)]
    elif sides and expression.op() not in _TRUTHS:
        return
    if any(side.op() in _TRUTHS for side in sides):
        raise UsageError(
            "AC051",
            f"the constraint {expression} is on a truth value",
            where=calling_span(),
            help="give each relation between numbers on its own: subject_to(a <= b)",
        )


def _lost_limits(what: object, by: str) -> UsageError:
    return UsageError(
        "AC051",
        f"{what} has limits and {by}: one of them would be lost",
        where=calling_span(),
        help="state one constraint for each",
    )


class Phase:
    """One phase of a problem: its boundary values, duration, integrals and constraints."""

    def __init__(self, problem: StatedProblem, number: int) -> None:
        self.problem, self.number = problem, number

    def __repr__(self) -> str:
        return f"Phase({self.problem.specs[self.number].name})"

    @property
    def duration(self) -> Any:
        """Its duration [s]."""
        return self.problem.durations[self.number]

    def start(self, what: str | Any) -> Any:
        """Value of a variable or an expression at its start."""
        return self.problem._value(self.number, "start", what)

    def end(self, what: str | Any) -> Any:
        """Value of a variable or an expression at its end, before the events there."""
        return self.problem._value(self.number, "end", what)

    def integral(self, what: str | Any) -> Any:
        """Integral of a variable or an expression over it."""
        return self.problem._value(self.number, "integral", what)

    def subject_to(
        self,
        what: str | Any,
        *,
        min: float = -math.inf,
        max: float = math.inf,
        equals: float | None = None,
        name: str = "",
    ) -> None:
        """Add a constraint to this phase only; see `Problem.subject_to`."""
        self.problem._constrain(what, min, max, equals, name, (self.number,))


def _relation(expression: Any, op: int) -> tuple[Any, float, float]:
    """(Expression, lower, upper) of a relation; a constant side becomes the limit."""
    left, right = expression.dep(0), expression.dep(1)
    if right.is_constant() and right.numel() == 1:
        limit = float(right.to_DM())
        return left, limit if _RELATIONS[op] == 0 else -math.inf, limit
    if left.is_constant() and left.numel() == 1:
        limit = float(left.to_DM())
        return right, limit, limit if _RELATIONS[op] == 0 else math.inf
    return left - right, 0.0 if _RELATIONS[op] == 0 else -math.inf, 0.0


def _magnitude(lower: float, upper: float) -> float:
    """Largest finite limit, else 1."""
    finite = [abs(v) for v in (lower, upper) if math.isfinite(v) and v != 0.0]
    return max(finite, default=1.0)


def constraint_text(name: str, lower: float, upper: float) -> str:
    """Default name of a constraint: its text."""
    if lower == upper:
        return f"{name} == {lower:g}"
    if lower == -math.inf:
        return f"{name} <= {upper:g}"
    if upper == math.inf:
        return f"{name} >= {lower:g}"
    return f"{lower:g} <= {name} <= {upper:g}"
