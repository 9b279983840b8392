"""Errors of the event iteration, which name the relations and clauses involved."""

from __future__ import annotations

from collections.abc import Sequence

from acausal.analyse.events.assertions import Assert
from acausal.analyse.events.state_events import Clause
from acausal.diagnose.words import places
from acausal.errors import EventError, InitializationError, Span
from acausal.lower.compiled import CompiledModel
from acausal.simulate.start.finite import UNDEFINED


class Endless(EventError):
    """Events without end. Located kinks may cause them, so that the run is repeated without locating kinks.

    The text need not name a kink: if one is zero up to rounding errors, the next relation ahead may be named instead.
    """


def accumulated(compiled: CompiledModel, t: float, count: int, names: Sequence[str]) -> Endless:
    """AC502: events without end and without progress in time."""
    return Endless(
        "AC502",
        f"{count} events follow one another at t = {t:.9g} s in {compiled.name} without time passing",
        where=_stated(compiled, names),
        evidence=[f"relations involved: {'; '.join(names[:4])}"],
        cause="each event makes the next one follow sooner, like bounces of a ball in a closing gap (Zeno behaviour), "
        "and their limit is no state of rest",
        help="stop the motion below a threshold, such as reset(v, where(abs(v) < v_min, 0, -e * pre(v))); give a "
        "contact a spring and a damper, or a relay two thresholds",
    )


def unsettled(compiled: CompiledModel, t: float, names: Sequence[str]) -> Endless:
    """AC501: an event iteration without end."""
    return Endless(
        "AC501",
        f"events do not settle at t = {t:.9g} s in {compiled.name}: {'; '.join(names)}",
        where=_stated(compiled, names),
        evidence=[f"changes again and again: {n}" for n in names],
        cause="whichever value it takes, the equations immediately require the other one (chattering)",
        help="make it depend on values before the event, pre(...), or give the relation two thresholds (hysteresis); "
        "if its two sides hardly differ, where(..., smooth=True) or no_event(...) avoids the event",
    )


def _stated(compiled: CompiledModel, texts: Sequence[str]) -> tuple[Span, ...]:
    """Where these relations or clauses are in the source; at most two spans."""
    flat = compiled.flat
    clauses = [c.where for c in compiled.state_events.clauses if any(t in c.text for t in texts)]
    discrete = [a.origin.span() for a in flat.assignments if a.origin and any(t in str(a.source) for t in texts)]
    equations = [e for e in flat.equations if any(t in flat.text(e) for t in texts)]
    return tuple(dict.fromkeys((*clauses, *discrete, *places(flat, equations))))[:2]


def undetermined(t: float, error: InitializationError) -> EventError:
    """AC507: no consistent values after an event; described like the error at a start that it is made from."""
    fact = error.fact.replace(" at the start", f" after the event at t = {t:.9g} s")
    if fact == error.fact:
        fact = f"{fact}, after the event at t = {t:.9g} s"
    return EventError(
        "AC507",
        fact,
        where=error.where,
        evidence=error.evidence,
        cause="after the event the equation has no solution, or it constrains variables that are determined already, "
        "which would take an impulse of a force that no reset names",
        help="let it change continuously, connect it through a spring and damper or a clutch, "
        "or state the jump yourself: when(..., reset(velocity, value, by=force))",
    )


def not_a_number(compiled: CompiledModel, t: float, state: int) -> EventError:
    """AC509: a discrete equation or a `when` that gives nan."""
    events = compiled.state_events
    texts = [
        *(a.text for a in events.assignments if a.position == state),
        *(c.text for c in events.clauses if state in (target for target, _ in c.actions)),
    ]
    return EventError(
        "AC509",
        f"{compiled.name}: {compiled.states[state]} becomes nan, which is not a number, at t = {t:.9g} s",
        where=_stated(compiled, texts),
        evidence=texts[:4],
        cause=UNDEFINED,
        help="state the value so that it exists there too: where(x > 0, log(maximum(x, 1e-9)), 0)",
    )


def vain(model: str, t: float, clauses: Sequence[Clause]) -> EventError:
    """AC508: impulses that cannot give velocities their new values."""
    return EventError(
        "AC508",
        f"{model}: no impulse gives velocities the values to which they are reset at t = {t:.9g} s",
        where=tuple(c.where for c in clauses[:2]),
        evidence=[c.text for c in clauses[:4]],
        cause="constraints hold the velocity, or impulses at this instant are redundant",
        help="let the force act on a part that can move; leave out impacts that follow from others at this instant",
    )


def overloaded(model: str, t: float, names: Sequence[str]) -> EventError:
    """AC506: stuck elements whose loads no equation determines, and whose motions contradict each other."""
    return EventError(
        "AC506",
        f"{model}: no stuck element yields at t = {t:.9g} s, although not all of them can hold",
        evidence=[f"loads that the equations leave open: {', '.join(names)}"],
        cause="a motion is prescribed where an element is held, a current where all diodes block, or the limits of the "
        "stuck elements are infinite",
        help="give the elements finite largest forces, or let a spring or an inertia take up the motion; give ideal "
        "diodes a conductance Goff",
    )


def violated(model: str, t: float, broken: Assert) -> EventError:
    """AC503: an assertion that does not hold."""
    where: tuple[Span, ...] = (broken.where,)
    place = f" in {broken.component}" if broken.component else ""
    return EventError(
        "AC503",
        f"{model} stopped at t = {t:.9g} s: {broken.message}",
        where=where,
        evidence=[f"an assertion of the model{place} does not hold"],
        help="the assertion says where the model is valid: check its parameters and inputs",
    )


def warned(t: float, broken: Assert) -> str:
    """The note on a violated assertion of the level "warning"."""
    place = f"{broken.component}: " if broken.component else ""
    return f"t = {t:.9g} s: {place}{broken.message}"


def not_a_clock(model: str, first: float, interval: float, clauses: Sequence[Clause]) -> EventError:
    """AC505: a sample whose instants cannot be listed."""
    return EventError(
        "AC505",
        f"{model}: sample({first:g}, {interval:g}) has no instants: its interval is {interval:g} s",
        where=tuple(c.where for c in clauses),
        evidence=[c.text for c in clauses],
        help="give a positive interval in seconds",
    )


def contradicting(model: str, t: float, name: str, clauses: Sequence[Clause]) -> EventError:
    """AC504: two `when`s that act at one instant and set different values."""
    return EventError(
        "AC504",
        f"{name} is set to different values at t = {t:.9g} s in {model}",
        where=tuple(c.where for c in clauses),
        evidence=[c.text for c in clauses],
        cause="two `when`s become true at the same instant, and neither has precedence",
        help="make them branches of one: when(...).elsewhen(...), of which the first that becomes true acts",
    )
