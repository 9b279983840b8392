"""Errors of delays in a run, each with the name of the delay and its place in the source."""

from __future__ import annotations

from acausal.analyse.delays import Delay
from acausal.errors import EventError, UsageError


def out_of_bounds(model: str, t: float | None, item: Delay, length: float, longest: float) -> EventError | UsageError:
    """A delay that is negative, or longer than its declared maximum; `t` is None for a constant delay."""
    limits = f"it is {length:.9g} s, and must be at least 0" + (f" and at most {longest:.9g} s" if longest >= 0 else "")
    kind = UsageError if t is None else EventError
    return kind(
        "AC182",
        f"{item.name} cannot be read" + (f" at t = {t:.9g} s in {model}" if t is not None else f" in {model}"),
        where=(item.where,) if item.where is not None else (),
        evidence=[limits],
        cause="the future of a signal is unknown" if length < 0 else "older values are no longer stored",
        help="limit it: maximum(T, 0.0)" if length < 0 else "raise the maximum, the third argument of delay",
    )


def vanished(model: str, t: float, item: Delay, length: float) -> EventError:
    """A variable delay that becomes so short that a run makes no progress."""
    return EventError(
        "AC185",
        f"{item.name} is {length:.3g} s at t = {t:.9g} s in {model}: too short to continue",
        where=(item.where,) if item.where is not None else (),
        cause="a run is integrated in stretches that are no longer than its shortest delay",
        help="give it a lower limit that does not matter for the result: maximum(T, 1e-3)",
    )


def changed_kind(model: str, name: str, length: float) -> UsageError:
    """A delay that is zero in a model compiled with a nonzero one, or the other way round."""
    zero = length == 0.0
    return UsageError(
        "AC037",
        f"{name} is {length:g} s, but {model} was compiled {'with a delay there' if zero else 'with 0 s there'}",
        cause="with a delay of zero the model has other equations, because the delayed signal is the signal itself",
        help="compile again with the value: acausal.compile(model, parameters={...})",
    )
