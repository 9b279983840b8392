"""Errors of a start in terms of the model: contradictions, singular systems, undefined values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from acausal.analyse.start import Condition, Dependence
from acausal.arrays import Vector
from acausal.diagnose.words import component_of, hint, line, lines, listed, made_at, parameter_at, places, short
from acausal.errors import InitializationError, Span, counted
from acausal.flatten.flat import span_of
from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import values
from acausal.simulate.start.finite import UNDEFINED, Undefined

_ROUNDING = 1e-13  # slope in nominal magnitudes that remains of terms that cancel


def contradicting(
    compiled: CompiledModel, condition: Condition, off: float, x: Vector, p: Vector
) -> InitializationError:
    """AC302: a condition that does not hold if all others do.

    `off`: The excess of the value, or of the left side of the equation.
    `x`, `p`: States according to the other conditions, shape (nx,), and parameters.
    """
    given = _value(compiled, condition, p)
    own_texts = f"{condition.text} ", f"d/dt ({condition.text})"
    others = [text for text in _others(compiled, condition, x, p) if not text.startswith(own_texts)]
    other, verb = (others[0].partition("   (")[0], "makes") if len(others) == 1 else ("the others", "make")
    if given is None:
        fact = f"the start equation `{condition.text}` contradicts {other}: it is off by {off:g}"
        advice = "make one of the others a guess(...)"
        if any(compiled.flat.text(e) == condition.text for e in compiled.flat.initial_equations):
            advice = f"remove it, or {advice}"
    else:
        fact = f"the start value {condition.text} = {given:g} contradicts {other}, which {verb} it {given + off:g}"
        field = condition.text.rpartition(".")[2]
        advice = f"remove one of them, or make it a guess: {field}=guess({given:g})"
        if any("   (" not in text for text in others):  # without a place: given for this run
            advice = f"give {condition.text} in start={{...}} too, so that they agree, or {advice}"
        if not condition.where:
            advice = f"leave {condition.text} out of start={{...}}, or give a value there that agrees with the others"
    cause = "the equations determine it at every time: no state is left to be chosen at the start"
    if compiled.continuous:
        states = counted(len(compiled.continuous), "state")
        cause = f"more is fixed at the start than the {states} can satisfy: {listed(compiled.continuous)}"
    return InitializationError(
        "AC302",
        f"{compiled.name}: {fact}",
        where=condition.where or _model_span(compiled),
        evidence=["also given:", *(f"  {text}" for text in others)] if others else [],
        cause=cause,
        help=advice,
    )


def off_constraint(
    compiled: CompiledModel, condition: Condition, off: float, x: Vector, p: Vector
) -> InitializationError:
    """AC302: a constraint, or its derivative, that the start does not satisfy.

    `off`: Left side minus right side.
    `x`, `p`: The last states of the search, shape (nx,), and parameters.
    """
    others = _others(compiled, condition, x, p)
    return InitializationError(
        "AC302",
        f"{compiled.name}: no start satisfies the constraint `{condition.text}`: it is off by {off:g}",
        where=condition.where or _model_span(compiled),
        evidence=["with", *(f"  {text}" for text in others)] if others else [],
        cause="the fixed positions or velocities are inconsistent, or the mechanism is in a singular position there",
        help="give fixed(...) to no more than the degrees of freedom, and a guess(...) to the rest; or start elsewhere",
    )


def _value(compiled: CompiledModel, condition: Condition, p: Vector) -> float | None:
    if condition.scalar is None:
        return None
    flat = compiled.flat
    node = flat.starts[condition.scalar].node
    return float(values(flat.pool, [node], {"par": p.__getitem__, "time": lambda _: 0.0})[node])


def _others(compiled: CompiledModel, condition: Condition, x: Vector, p: Vector) -> list[str]:
    """The other conditions that concern the same states, with their source locations."""
    reach = Dependence(compiled.solution)
    variables = reach.of(condition.node)
    if variables & set(compiled.solution.algebraic):
        variables |= {v for r in compiled.solution.residuals for v in reach.of(r)}
    reduced = compiled.solution.structure.reduced
    texts = []
    for k, state in enumerate(compiled.state_variables):
        if state in variables and state in compiled.start.direct:
            starts = [s for a in reduced.aliases.get(state, ()) if (s := compiled.flat.starts.get(a)) and s.is_fixed]
            spans = [s.origin.span() for s in starts[:1] if s.origin is not None]
            texts.append(f"{compiled.states[k]} = {x[k]:g}{_at(spans)}")
    for other in (*compiled.start.conditions, *compiled.start.surplus):
        if other is not condition and reach.of(other.node) & variables:
            given = _value(compiled, other, p)
            texts.append(other.text + ("" if given is None else f" = {given:g}") + _at(other.where))
    return texts[:6]


def _at(spans: Sequence[Span]) -> str:
    return f"   ({short(spans[0])})" if spans else ""


def _model_span(compiled: CompiledModel) -> tuple[Span, ...]:
    return made_at(compiled.flat, "")


def not_found(
    compiled: CompiledModel,
    free: Sequence[int],
    guesses: Vector,
    residuals: Vector,
    jacobians: Sequence[Any],
    off: tuple[int, float] | None,
) -> InitializationError:
    """AC304 if the start system is singular but consistent, AC302 if it contradicts itself, otherwise AC301.

    Parameters
    ----------
    free
        Indices of the states among the unknowns; then come the algebraic variables.
    guesses
        Where the iteration started, in the units of the model.
    residuals
        Values of the conditions and equations there.
    jacobians
        Their Jacobians at the guess and near it, shape (n, n) each.
    off
        The condition that no states satisfy, and its least residual; None if there is no such condition.
    """
    names = [compiled.states[i] for i in free] + list(compiled.algebraic)
    labels, spans = _labels(compiled, bool(free))
    singular = _common_null(jacobians)
    if singular is not None and len(labels) == len(singular[0]):
        contradiction = _contradiction(compiled, labels, spans, residuals, jacobians)
        if contradiction is not None:
            return contradiction
        if off is None:
            return _singular(compiled, names, labels, spans, singular)
    shown = [f"{n} = {v:g}" for n, v in zip(names, guesses, strict=True)]
    if off is not None:
        return _out_of_reach(
            compiled, compiled.start.conditions[off[0]], off[1], names[: len(free)], shown[: len(free)]
        )
    worst = np.argsort(-np.abs(residuals))[:4]
    return InitializationError(
        "AC301",
        f"{compiled.name}: no start found for {listed(names, 4)}",
        where=[s for k in worst[:1] if k < len(spans) for s in spans[k]] or _model_span(compiled),
        evidence=["largest residuals at the guesses:"]
        + [f"  {residuals[k]:.3g}   in   {labels[k] if k < len(labels) else k}" for k in worst]
        + [f"guesses: {listed(shown)}"],
        cause="the guesses are too far from a solution, or there is none",
        help=f"give better guesses: {', '.join(f'{n}=guess(...)' for n in names[:2])}",
    )


def _out_of_reach(
    compiled: CompiledModel, condition: Condition, off: float, names: Sequence[str], guesses: Sequence[str]
) -> InitializationError:
    """AC301: no values of the free states were found that satisfy a condition."""
    flat = compiled.flat
    stated = [e for e in flat.equations if flat.text(e) == condition.text]
    given = [n for n, v in zip(compiled.states, compiled.state_variables, strict=True) if v in compiled.start.direct]
    return InitializationError(
        "AC301",
        f"{compiled.name}: no start satisfies `{condition.text}`: it is off by {off:g} at best",
        where=places(flat, stated[:1]) or condition.where or _model_span(compiled),
        evidence=[f"guesses: {listed(guesses)}", *([f"given: {listed(given, 6)}"] if given else [])],
        cause="the given values are inconsistent (a loop that does not close), or the guesses lead elsewhere",
        help=f"give other values, or better guesses: {', '.join(f'{n}=guess(...)' for n in names[:2])}",
    )


def _labels(compiled: CompiledModel, with_conditions: bool) -> tuple[list[str], list[tuple[Span, ...]]]:
    """Texts and source locations of the rows of the start system: conditions, then equations."""
    labels, spans = [], []
    for c in compiled.start.conditions if with_conditions else ():
        labels.append(("start value of " if c.scalar is not None else "start equation ") + c.text + _at(c.where))
        spans.append(c.where)
    structure, reach = compiled.solution.structure, Dependence(compiled.solution)
    reduced = structure.reduced
    row_of = {node: k for k, node in enumerate(structure.residuals)}
    for node in compiled.solution.residuals:
        if node not in row_of:
            unknown_variables = sorted(reach.of(node) & set(compiled.solution.algebraic))
            unknowns = listed((reduced.name(v) for v in unknown_variables), 3)
            labels.append("an equation" + (f" for {unknowns}" if unknown_variables else ""))
            spans.append(())
            continue
        equation = compiled.flat.equations[structure.flat_equation(row_of[node])]
        labels.append(line(compiled.flat, equation))
        spans.append(tuple(places(compiled.flat, [equation])))
    return labels, spans


def _common_null(jacobians: Sequence[Any]) -> tuple[Vector, Vector] | None:
    """Left and right null vectors of the first matrix if all matrices are singular, otherwise None."""
    found: tuple[Vector, Vector] | None = None
    for jacobian in jacobians:
        matrix = np.atleast_2d(np.array(jacobian, dtype=float))
        if matrix.shape[0] != matrix.shape[1] or not np.isfinite(matrix).all() or not len(matrix):
            return None
        size = np.max(np.abs(matrix), axis=1, keepdims=True)
        u, s, vt = np.linalg.svd(matrix / np.where(size > _ROUNDING * min(1.0, size.max()), size, 1.0))
        if s[-1] > 1e-11 * max(s[0], 1e-300):
            return None
        found = found or (u[:, -1], vt[-1])
    return found


def _contradiction(
    compiled: CompiledModel,
    labels: Sequence[str],
    spans: Sequence[tuple[Span, ...]],
    residuals: Vector,
    jacobians: Sequence[Any],
) -> InitializationError | None:
    """AC302 if linear conditions have equal left sides but different right sides; otherwise None."""
    first, *others = (np.array(j, dtype=float) for j in jacobians)
    u, s, _ = np.linalg.svd(first)
    weights = u[:, s <= 1e-11 * s[0]]
    for weight in weights.T if weights.shape[1] == 1 else ():
        rows = np.flatnonzero(np.abs(weight) > 1e-9 * np.max(np.abs(weight))).tolist()
        off = float(weight @ residuals) / float(np.max(np.abs(weight)))
        is_linear = all(np.allclose(first[rows], j[rows], rtol=1e-12, atol=1e-12) for j in others)
        if len(rows) < 2 or not is_linear or abs(off) < 1e-9:
            return None
        texts = [labels[k].partition("   (")[0].removeprefix("start equation ") for k in rows]
        names = [f"`{text}`" for text in texts]
        return InitializationError(
            "AC302",
            f"{compiled.name}: the start equations {listed(names, 3)} contradict each other",
            where=[s for k in rows[:2] for s in spans[k]] or _model_span(compiled),
            evidence=["together they demand 0 == " + f"{abs(off):g}:", *(f"  {labels[k]}" for k in rows[:6])],
            cause="start conditions determine the same quantity with different values",
            help="remove one of them, or replace it by a condition for something else",
        )
    return None


def _singular(
    compiled: CompiledModel,
    names: Sequence[str],
    labels: Sequence[str],
    spans: Sequence[tuple[Span, ...]],
    null: tuple[Vector, Vector],
) -> InitializationError:
    rows = np.flatnonzero(np.abs(null[0]) > 1e-6).tolist()
    open_ones = [names[k] for k in np.flatnonzero(np.abs(null[1]) > 1e-6).tolist()]
    if len(rows) == 1:  # independent of the others: its factors are zero by themselves
        return InitializationError(
            "AC304",
            f"{compiled.name}: an equation says nothing about {listed(open_ones, 4)} at the start",
            where=spans[rows[0]] or _model_span(compiled),
            evidence=[labels[rows[0]]],
            cause=f"{listed(open_ones, 4)} is multiplied by zero there",
            help="start elsewhere, or state the equation so that it holds there too",
        )
    return InitializationError(
        "AC304",
        f"{compiled.name}: the start conditions do not determine {listed(open_ones, 4)}",
        where=[s for k in rows[:2] for s in spans[k]] or _model_span(compiled),
        evidence=["these depend on each other at the start:", *(f"  {labels[k]}" for k in rows[:6])],
        cause="start conditions are redundant, perhaps with different values",
        help=f"replace one of them by a condition for {open_ones[0]}, for example {open_ones[0]}=fixed(...)",
    )


def left_open(compiled: CompiledModel, free: Sequence[int], jacobians: Sequence[Any]) -> tuple[str, ...]:
    """A note that names unknowns that the start conditions do not determine although they can be satisfied."""
    null = _common_null(jacobians)
    if null is None:
        return ()
    names = [compiled.states[i] for i in free] + list(compiled.algebraic)
    open_ones = [names[k] for k in np.flatnonzero(np.abs(null[1]) > 1e-6).tolist()]
    return (f"the start conditions do not determine {listed(open_ones)}: their guesses have decided",)


def start_not_finite(compiled: CompiledModel, name: str, value: float) -> InitializationError:
    """AC303: a state that does not start at a number."""
    return InitializationError(
        "AC303",
        f"{compiled.name}: {name} starts at {value:g}",
        where=parameter_at(compiled.flat, name),
        cause="its start value is infinite or undefined, or calculated from such a value",
        help="give a finite start value",
    )


def undefined(compiled: CompiledModel, t: float, found: Undefined) -> InitializationError:
    """AC303: an equation that has no finite value at the start."""
    flat = compiled.flat
    variable, equation, inside, reason, parameter = found
    cause, advice = hint([v.declaration for v in flat.variables if v.path == variable][:1])
    where = (*parameter_at(flat, parameter), *span_of(equation)) or made_at(flat, component_of(flat, variable))
    fact = f"{variable} has no finite value at the start (t = {t:g} s)"
    value = next((text for text in inside if text.startswith(f"{parameter} = ")), "")
    return InitializationError(
        "AC303",
        f"{compiled.name}: {fact}" + (f" for {value}" if value else ""),
        where=where,
        evidence=[text.strip() for text in lines(flat, [equation])]
        + ([f"with {', '.join(inside[:6])}"] if inside else []),
        cause=reason or cause or UNDEFINED,
        help=advice
        or (f"give {parameter} another value" if parameter else None)
        or "start elsewhere, or state the equation so that it holds there too",
    )
