"""The features (delays, events, ends of runs) that each exported form of a model supports.

A form refuses a model whose values depend on a feature that it lacks. An omission that changes no value becomes a note.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from acausal.analyse.delays import PADE, refuse_delays
from acausal.analyse.events.state_events import Assignment, Clause, switched_dependents
from acausal.errors import ExportError
from acausal.export.ports import Output
from acausal.lower.compiled import CompiledModel
from acausal.simulate.events.resets.constrained import bound


@dataclass(frozen=True)
class Form:
    """An exported form: its name, whether it supports events and `terminate`, and what to use instead of it."""

    name: str
    events: bool
    ends: bool
    instead: str = ""


FUNCTIONS = Form(
    "an export as functions of one instant",
    events=False,
    ends=False,
    instead="casadi(events=True) hands out what happens at events, acausal.step_function(compiled, step) steps through "
    "them, acausal.sensitivities differentiates a run with them, acausal.simulate runs it",
)
BETWEEN = Form("an export with its events", events=True, ends=False)
LINEAR = Form(
    "linearize",
    events=False,
    ends=False,
    instead="acausal.sensitivities differentiates a run with its events, acausal.step_function(compiled, step) is the "
    "map of a step",
)
STEP = Form("a step as a function of states", events=True, ends=False)
SENSITIVITIES = Form("sensitivities", events=True, ends=True)


def check(compiled: CompiledModel, form: Form, outputs: Sequence[Output]) -> tuple[str, ...]:
    """Return notes on what the form leaves out of this model, or refuse the model.

    Raises UsageError: AC035 for a model with delays, AC027 for one whose contacts change its equations.
    Raises ExportError: AC608 when the form does not support events and `when`s or discrete equations change variables
    that the rates or the outputs depend on; or when a `when` resets a state that a stabilised constraint couples to
    others.
    """
    compiled = compiled.unchanging(form.name)
    refuse_delays(compiled.flat, form.name, PADE)
    notes = [] if form.events else _refuse_events(compiled, form, outputs)
    if form.events:
        _refuse_followers(compiled, form)
    if not form.ends:
        events, name = compiled.state_events, form.name
        ends = (c for c in events.clauses if c.terminate is not None)
        notes += [f"{name} does not end the run: {c.text} ({c.where})" for c in ends]
        notes += [f"{name} does not check the assertion: {a.message} ({a.where})" for a in events.asserts]
        looking = sorted({cls.__name__ for cls in compiled.flat.reviewing.values()})
        notes += [f"{name} does not look back on what {cls} has done, as simulate does" for cls in looking]
        constrained = (compiled.solution.structure.reduced.name(v) for v in switched_dependents(compiled.solution))
        notes += [
            f"{name} does not check for jumps of {v}, whose constraint changes at events (AC507)" for v in constrained
        ]
    return tuple(notes)


def _refuse_followers(compiled: CompiledModel, form: Form) -> None:
    """Refuse `reset`s of states in stabilised constraints: only a run adjusts the other states to them."""
    clauses = compiled.state_events.clauses
    states = bound(compiled, {position for c in clauses for position, _ in c.actions})
    if not states:
        return
    acting = [c for c in clauses if {position for position, _ in c.actions} & set(states)]
    names = [compiled.states[k] for k in states]
    raise ExportError(
        "AC608",
        f"{form.name} does not take {compiled.name}: events reset {', '.join(names[:4])}, which a constraint binds",
        where=tuple(dict.fromkeys(c.where for c in acting))[:2],
        evidence=list(dict.fromkeys(c.text for c in acting))[:4],
        cause="other states follow through a stabilised constraint, which a run solves at the event",
        help="choose coordinates that the constraint does not bind (angles for x and y), or use acausal.simulate",
    )


def _refuse_events(compiled: CompiledModel, form: Form, outputs: Sequence[Output]) -> list[str]:
    """Return notes on discrete variables that nothing depends on; ExportError AC608 if events change anything else."""
    events = compiled.state_events
    actions: list[tuple[Clause | Assignment, list[int]]] = [
        *((c, [position for position, _ in c.actions]) for c in events.clauses if c.actions),
        *((a, [a.position]) for a in events.assignments),
    ]
    if not actions:
        return []
    first = len(compiled.states) - compiled.discretes
    structure = compiled.solution.structure
    image = structure.reduced.image
    rates = structure.rates(compiled.state_variables[:first])
    in_rates = _discrete(compiled, [*rates, *compiled.solution.residuals])
    in_outputs = _discrete(compiled, [image[output.scalar] for output in outputs])
    lost = [(act, k) for act, at in actions for k in at if k < first or k in in_rates | in_outputs]
    if not lost:
        return [f"{compiled.states[k]} keeps its value: {act.text}" for act, at in actions for k in at]
    names = list(dict.fromkeys(compiled.states[k] for _, k in lost))
    only_in_outputs = all(k >= first and k not in in_rates for _, k in lost)
    raise ExportError(
        "AC608",
        f"{form.name} does not take {compiled.name}: events change {', '.join(names[:4])}"
        f"{' and more' if len(names) > 4 else ''}",
        where=tuple(dict.fromkeys(act.where for act, _ in lost if isinstance(act, Clause)))[:2],
        evidence=list(dict.fromkeys(act.text for act, _ in lost))[:4],
        cause="what `when`s and discrete equations do at an event is not a function of one instant",
        help=(f"leave {', '.join(names[:4])} out of the outputs; or: " if only_in_outputs else "") + form.instead,
    )


def _discrete(compiled: CompiledModel, roots: Sequence[int]) -> set[int]:
    """Indices, among the states, of the discrete variables on which `roots` depend, directly or through definitions."""
    pool = compiled.solution.structure.reduced.pool
    seen = pool.variables_behind(roots, dict(compiled.solution.definitions))
    first = len(compiled.states) - compiled.discretes
    return {k for k, v in enumerate(compiled.state_variables) if k >= first and v in seen}
