"""Errors of the event iteration: they name who takes part."""

from __future__ import annotations

from collections.abc import Sequence

from acausal.analyse.events.state_events import Assert, Clause
from acausal.errors import EventError, InitializationError, Span


class RestlessKink(EventError):
    """A watched kink is passed without time passing: better let alone."""


def accumulated(model: str, t: float, count: int, names: Sequence[str]) -> EventError:
    """Events without end in next to no time."""
    return EventError(
        "AC502",
        f"{count} events follow one another at t = {t:.9g} s in {model} without time passing",
        evidence=[f"relations that take part: {'; '.join(names[:4])}"],
        cause="events that follow each other ever faster (Zeno behaviour), without a state of rest as their limit",
        help="let the model come to rest below a threshold, or use a compliant contact or a smooth switch",
    )


def unsettled(model: str, t: float, names: Sequence[str]) -> EventError:
    """An event iteration without end."""
    return EventError(
        "AC501",
        f"events do not settle at t = {t:.9g} s in {model}: {'; '.join(names)}",
        evidence=[f"changes again and again: {n}" for n in names],
        cause="each of the two modes leads back to the other at once (chattering)",
        help="give the relation a hysteresis, or declare the switch smooth: where(..., smooth=True), no_event(...)",
    )


def undetermined(t: float, error: InitializationError) -> EventError:
    """No values after an event, where there were some before: what is known at a start is known there as well."""
    fact = error.fact.replace(" at the start", f" after the event at t = {t:.9g} s")
    if fact == error.fact:
        fact = f"{fact}, after the event at t = {t:.9g} s"
    return EventError(
        "AC507",
        fact,
        where=error.where,
        evidence=error.evidence,
        cause="after the event the equation has no solution, or it constrains variables that are determined already, "
        "which would need the impulse of a force that no reset names",
        help="let it change continuously, connect it through a spring and damper or a clutch, "
        "or state the jump yourself: when(..., reset(velocity, value, by=force))",
    )


def vain(model: str, t: float, clauses: Sequence[Clause]) -> EventError:
    """Impulses that cannot give velocities their new values."""
    return EventError(
        "AC508",
        f"{model}: no impulse gives velocities the values that they are reset to at t = {t:.9g} s",
        where=tuple(c.where for c in clauses[:2]),
        evidence=[c.text for c in clauses[:4]],
        cause="constraints hold the velocity, or impulses at this instant are redundant",
        help="let the force act on a part that can move; leave out impacts that follow from others at this instant",
    )


def overloaded(model: str, t: float, names: Sequence[str]) -> EventError:
    """Stuck elements whose loads no equation determines, and whose motions contradict each other."""
    return EventError(
        "AC506",
        f"{model}: nothing that is stuck gives way at t = {t:.9g} s, although not all of it can hold",
        evidence=[f"loads that the equations leave open: {', '.join(names)}"],
        cause="a motion is prescribed where an element is held, a current where all blocks, or the limits of what is "
        "stuck are infinite",
        help="give the elements finite largest forces, or let a spring or an inertia take up the motion; give ideal "
        "diodes a conductance Goff",
    )


def violated(model: str, t: float, broken: Assert) -> EventError:
    """An assertion that does not hold."""
    where: tuple[Span, ...] = (broken.where,)
    place = f" in {broken.component}" if broken.component else ""
    return EventError(
        "AC503",
        f"{model} stopped at t = {t:.9g} s: {broken.message}",
        where=where,
        evidence=[f"an assertion of the model{place} does not hold"],
        help="the assertion says where the model is valid: check its parameters and inputs",
    )


def not_a_clock(model: str, first: float, interval: float, clauses: Sequence[Clause]) -> EventError:
    """A sample whose instants cannot be listed."""
    return EventError(
        "AC505",
        f"{model}: sample({first:g}, {interval:g}) has no instants: its interval is {interval:g} s",
        where=tuple(c.where for c in clauses),
        evidence=[c.text for c in clauses],
        help="give a positive interval in seconds",
    )


def contradicting(model: str, t: float, name: str, clauses: Sequence[Clause]) -> EventError:
    """Two `when`s that act at one instant and disagree."""
    return EventError(
        "AC504",
        f"{name} is set to different values at t = {t:.9g} s in {model}",
        where=tuple(c.where for c in clauses),
        evidence=[c.text for c in clauses],
        cause="two `when`s become true at the same instant; neither comes first",
        help="make them branches of one: when(...).elsewhen(...), of which the first that becomes true acts",
    )
