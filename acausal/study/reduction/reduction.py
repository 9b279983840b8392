"""`acausal.reduce`: the smallest model that computes the requested outputs, and a report on the reduction."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from acausal.analyse.delays import PADE, refuse_delays
from acausal.arrays import Vector
from acausal.errors import AcausalError, listed_names
from acausal.flatten.connections.connections import UnionFind
from acausal.flatten.instances.instances import changing
from acausal.language.component import Component
from acausal.lower.compile import compile, lower
from acausal.lower.compiled import CompiledModel
from acausal.reduce.cone import dependence, restrict
from acausal.reduce.freeze import ZEROS
from acausal.reduce.outputs import output_scalars
from acausal.reduce.select import KINDS, Dropped
from acausal.result.result import Result, Signal
from acausal.simulate.restructure.joined import renamed
from acausal.simulate.restructure.restructure import lasting_names
from acausal.simulate.run import simulate
from acausal.study.reduction.comparison import Comparison, compare_runs


@dataclass(frozen=True)
class Counts:
    """Size of a model."""

    equations: int  # scalar equations: of the full model as composed, of the reduced one those that remain
    solved: int  # equations evaluated in a run or for its outputs
    # Integrated states, and algebraic variables, which are iterated in every step.
    states: int
    algebraic: int
    # Free parameters that have an effect, and relations of time.
    parameters: int
    time_events: int
    operations: int  # of one evaluation of the right-hand side


@dataclass(frozen=True, eq=False)
class Reduction:
    """A reduced model, the parts left out, and a comparison with the full model; returned by `acausal.reduce`.

    Attributes
    ----------
    outputs, constant
        Full names of the requested outputs, and of the constant ones among them.
    compiled, full
        The reduced and the full model.
    before, after
        Their sizes.
    dropped
        Parts of the full model left out, with reasons.
    islands
        Groups of outputs without common states, which `simulate` solves separately.
    comparison
        Measured times and errors of both models; None without `compare`.
    hints
        Options that would reduce the model further.
    """

    model: str
    outputs: tuple[str, ...]
    constant: tuple[str, ...]
    compiled: CompiledModel
    full: CompiledModel
    before: Counts
    after: Counts
    dropped: tuple[Dropped, ...]
    islands: tuple[Island, ...]
    comparison: Comparison | None
    hints: tuple[str, ...]

    def __repr__(self) -> str:
        return (
            f"Reduction({self.model}: {self.before.states} -> {self.after.states} states, "
            f"{self.before.equations} -> {self.after.equations} equations)"
        )

    def __str__(self) -> str:
        return "\n".join(self.lines())

    @cached_property
    def kinds(self) -> Mapping[str, int]:
        """Number of parts left out of each kind."""
        found = Counter(item.kind for item in self.dropped)
        return {kind: found[kind] for kind in KINDS if found[kind]}

    def simulate(self, **options: Any) -> Result:
        """Simulate the reduced model, its islands separately; options as in `acausal.simulate`."""
        return simulate_islands(self.compiled, self.islands, options)

    def record(self) -> dict[str, Any]:
        """The reduction as a dictionary, for JSON."""
        comparison = self.comparison
        return {
            "model": self.model,
            "outputs": list(self.outputs),
            "constant": list(self.constant),
            "before": asdict(self.before),
            "after": asdict(self.after),
            "states": {"before": list(self.full.states), "after": list(self.compiled.states)},
            "dropped": [asdict(item) for item in self.dropped],
            "islands": [asdict(island) for island in self.islands],
            "speed": None if comparison is None else comparison.speed(),
            "error": None if comparison is None else {e.name: asdict(e) for e in comparison.errors},
            "estimate": None if comparison is None else comparison.estimate,
            "failed": None if comparison is None else comparison.failed,
            "hints": list(self.hints),
        }

    def lines(self) -> Iterator[str]:
        """The report as text."""
        before, after = asdict(self.before), asdict(self.after)
        yield f"{self.model}, reduced to {_name_list(self.outputs)}"
        yield f"  {'':14}{'full':>8}{'reduced':>10}"
        for key in before:
            yield f"  {key.replace('_', ' '):14}{before[key]:8d}{after[key]:10d}"
        yield "  states that remain: " + (_name_list(self.compiled.states, 12) or "none")
        for kind in self.kinds:
            yield f"  {_TITLES[kind]}"
            yield from _by_reason([item for item in self.dropped if item.kind == kind])
        if self.constant:
            yield f"  never change: {_name_list(self.constant)}"
        if len(self.islands) > 1:
            yield f"  {len(self.islands)} islands that can be solved separately:"
            yield from (f"    {_name_list(i.outputs)}: {_name_list(i.states, 6)}" for i in self.islands)
        if self.comparison is not None:
            yield from self.comparison.lines()
        yield from (f"  hint: {hint}" for hint in self.hints)


_TITLES = {
    "parameter": "parameters made numbers",
    "contact": "contacts that cannot occur",
    "motionless": "states that never move",
    "relation": "relations that never switch",
    "quasi-static": "states in their quasi-static limit",
    "state": "states left out",
    "unknown": "iterated unknowns left out",
    "event": "events left out",
    "assert": "assertions left out",
}
_MOST_NAMES = 6


def reduce(
    model: Component,
    outputs: Sequence[str],
    *,
    freeze: Sequence[str] = (),
    quasi_static: Sequence[str] = (),
    parameters: Mapping[str, object] | None = None,
    formulation: str = "torn",
    compare: bool = True,
    repeat: int = 5,
    **options: Any,
) -> Reduction:
    """Find the smallest model that computes `outputs`, and compare it with the full one.

    Parameters
    ----------
    outputs
        Names of variables; an array stands for all its entries, `*` matches any text.
    freeze
        Parameters, components or patterns to make constant; "zeros" for all parameters that are zero.
    quasi_static
        States, or components with all their states, to put at their quasi-static limit.
    parameters
        Values by path, as in `acausal.compile`.
    compare
        Whether to run both models: times are the shortest of `repeat` runs, errors the largest differences in outputs.
    options
        Options of these runs, as in `acausal.simulate`: stop_time, tolerance, solver, inputs, ...

    Raises
    ------
    UsageError
        AC010, AC018, AC020, AC026 for wrong names, AC027 for drills that may leave several holes;
        those of `simulate` for wrong options.
    AcausalError
        Any error of the model.
    """
    name_of = {lasting: name for name, lasting in lasting_names(model).items()}
    outputs = [renamed(name, name_of) for name in listed_names("outputs", outputs)]
    full = compile(model, parameters=parameters, formulation=formulation)
    refuse_delays(full.flat, "reduce", "simulate it whole, or " + PADE)
    compiled = compile(
        model,
        parameters=parameters,
        formulation=formulation,
        outputs=outputs,
        freeze=freeze,
        quasi_static=quasi_static,
    )
    selection = compiled.selection
    assert selection is not None, "outputs were given"
    names = selection.outputs or ()
    return Reduction(
        model=full.name,
        outputs=names,
        constant=selection.constant,
        compiled=compiled,
        full=full,
        before=counts(full, len(full.flat.equations)),
        after=counts(compiled),
        dropped=selection.dropped,
        islands=islands(compiled, names),
        comparison=_comparison(model, full, compiled, parameters, repeat, options) if compare else None,
        hints=_hints(model, compiled, outputs, parameters, formulation, freeze),
    )


def _comparison(
    model: Component,
    full: CompiledModel,
    compiled: CompiledModel,
    parameters: Mapping[str, object] | None,
    repeat: int,
    options: Mapping[str, Any],
) -> Comparison:
    """Comparison of both models; a scene with changing contacts runs once, in pieces, with lasting contact names."""
    if not changing(model):
        return compare_runs(full, compiled, compiled.requested_outputs, repeat, options)
    names = lasting_names(model)
    given: Any = parameters
    runs = {"full": partial(simulate, model, parameters=given), "reduced": partial(simulate, compiled)}
    return compare_runs(full, compiled, compiled.requested_outputs, 1, options, runs, lambda name: renamed(name, names))


def counts(compiled: CompiledModel, equations: int | None = None) -> Counts:
    """Size of a compiled model; `equations` defaults to the number of solved ones."""
    solved = len(compiled.solution.definitions) + len(compiled.solution.residuals)
    return Counts(
        equations=solved if equations is None else equations,
        solved=solved,
        states=len(compiled.states),
        algebraic=len(compiled.algebraic),
        parameters=len(_effective_parameters(compiled)),
        time_events=len(compiled.time_events.relations),
        operations=int(compiled.rhs.n_instructions()),
    )


def _effective_parameters(compiled: CompiledModel) -> set[int]:
    """Free parameters on which any evaluated expression depends."""
    solution = compiled.solution
    reduced = solution.structure.reduced
    roots = [n for _, n in solution.definitions] + [*solution.residuals, *reduced.event_nodes]
    roots += [*compiled.start.direct.values(), *compiled.start.guesses.values()]
    roots += [c.node for c in compiled.start.conditions]
    roots += [n for s, n in enumerate(reduced.image) if s not in reduced.left_out]
    nodes = (reduced.pool.nodes[n] for n in reduced.pool.reachable(roots))
    return {node[1] for node in nodes if node[0] == "par"}


def _hints(
    model: Component,
    compiled: CompiledModel,
    outputs: Sequence[str],
    parameters: Mapping[str, object] | None,
    formulation: str,
    freeze: Sequence[str],
) -> tuple[str, ...]:
    """A hint if freezing the zero parameters would reduce the model further."""
    if ZEROS in freeze or 0.0 not in compiled.parameter_values:
        return ()
    try:
        smaller = compile(
            model, parameters=parameters, formulation=formulation, outputs=outputs, freeze=[*freeze, ZEROS]
        )
    except AcausalError:
        return ()
    before, after = counts(compiled), counts(smaller)
    if after.states < before.states or after.operations < 0.8 * before.operations:
        return (
            f"with its zero parameters made constant (freeze {ZEROS}) the model has {after.states} states "
            f"and {after.operations} operations",
        )
    return ()


def _name_list(names: Sequence[str], most: int = _MOST_NAMES) -> str:
    """Text of at most `most` names."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _by_reason(items: Sequence[Dropped]) -> Iterator[str]:
    """One line for each reason, with its names."""
    reasons: dict[str, list[str]] = {}
    for item in items:
        reasons.setdefault(item.why, []).append(item.name)
    for why, names in reasons.items():
        yield f"    {_name_list(names)}: {why}"


@dataclass(frozen=True)
class Island:
    """Outputs, and the states on which no other outputs depend."""

    outputs: tuple[str, ...]
    states: tuple[str, ...]


def islands(compiled: CompiledModel, outputs: Sequence[str]) -> tuple[Island, ...]:
    """Groups of outputs without common states and algebraic variables; outputs that depend on none are in the first.

    A model with events is one island, because an event in one part interrupts the integration of all parts.
    """
    solution = compiled.solution
    reduced = solution.structure.reduced
    depends = dependence(solution)
    dynamic = {*solution.structure.states, *solution.algebraic}
    needed: dict[str, frozenset[int]] = {}
    scalars = output_scalars(reduced.flat, outputs)
    for name, scalar in scalars.items():
        found = depends.closure(solution, reduced.pool.variables_in(reduced.image[scalar])) & dynamic
        if found:
            needed[name] = frozenset(found)
    names = list(needed)
    sets = UnionFind(len(names))
    owner: dict[int, int] = {}
    for k, name in enumerate(names):
        for v in needed[name]:
            sets.union(k, owner.setdefault(v, k))
    if compiled.state_events.clauses:
        for k in range(1, len(names)):
            sets.union(0, k)
    groups: dict[int, list[str]] = {}
    for k, name in enumerate(names):
        groups.setdefault(sets.find(k), []).append(name)
    constant = compiled.selection.constant if compiled.selection is not None else ()
    for group in list(groups.values())[:1]:  # outputs of time and inputs alone can be computed in any of them
        group += [name for name in scalars if name not in needed and name not in constant]
    found_islands = []
    for group in groups.values():
        variables = frozenset().union(*(needed[name] for name in group if name in needed))
        states = tuple(reduced.name(x) for x in solution.structure.states if x in variables)
        found_islands.append(Island(tuple(group), states))
    return tuple(found_islands)


def simulate_islands(compiled: CompiledModel, parts: Sequence[Island], options: Mapping[str, Any]) -> Result:
    """Simulate every island separately, and join the runs into one result."""
    if len(parts) < 2:
        return simulate(compiled, **options)
    flat = compiled.flat
    results = []
    for part in parts:
        restricted = restrict(compiled.solution, tuple(output_scalars(flat, part.outputs).values()))
        results.append(simulate(replace(lower(restricted), selection=compiled.selection), **options))
    return _join(results)


def _join(results: Sequence[Result]) -> Result:
    """One result at the times of all runs; times of events occur twice."""
    time = _union([r.time for r in results])
    columns: list[Vector] = []
    signals: dict[str, Signal] = {}
    for result in results:
        first = sum(c.shape[1] for c in columns)
        columns.append(_rows(result, time))
        for name, signal in result.signals.items():
            moved = signal if signal.column is None else replace(signal, column=signal.column + first)
            if name not in signals or signal.column is not None:
                signals[name] = moved
    notes: Any = [note for r in results for note in r.stats.get("notes", ())]  # type: ignore[attr-defined]
    stats = {**results[0].stats, "notes": tuple(dict.fromkeys(notes)), "islands": [dict(r.stats) for r in results]}
    events = tuple(sorted((e for r in results for e in r.events), key=lambda e: e.time))
    return Result(results[0].model, time, np.hstack(columns), signals, events, stats)


def _union(times: Sequence[Vector]) -> Vector:
    """Union of sorted times, shape (n,), each as often as in the run in which it occurs most often."""
    multiplicity: dict[float, int] = {}
    for run_times in times:
        values, count = np.unique(run_times, return_counts=True)
        for t, n in zip(values.tolist(), count.tolist(), strict=True):
            multiplicity[t] = max(multiplicity.get(t, 0), n)
    return np.array([t for t in sorted(multiplicity) for _ in range(multiplicity[t])])


def _rows(result: Result, time: Vector) -> Vector:
    """Rows of a result, shape (n, columns), at times that include its own (those of its events twice)."""
    rows = np.empty((len(time), result.matrix.shape[1]))
    k, between = -1, []
    for i, t in enumerate(time):
        if k + 1 < len(result.time) and result.time[k + 1] == t:
            k += 1
        if k >= 0 and result.time[k] == t:
            rows[i] = result.matrix[k]
        else:
            between.append(i)
    rows[between] = result.rows(time[between])
    return rows
