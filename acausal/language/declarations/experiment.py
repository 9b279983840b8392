"""Default run of a model; every field can be overridden in `simulate`."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real as Number

from acausal.errors import DeclarationError, calling_span


@dataclass(frozen=True)
class Experiment:
    """Default run of a model: `experiment = Experiment(stop_time=40.0)` in the class body.

    `stop_time`, `start_time`, `output_interval`, `step` and `max_step` are in seconds; `output_interval` None gives 500
    intervals; `tolerance` is the relative tolerance; `solver` is the name of a solver or "auto"; `step` is the size of
    a fixed step; `max_step` is the largest step of an adaptive solver, which cannot overlook anything that lasts
    longer.
    """

    stop_time: float = 1.0
    start_time: float = 0.0
    output_interval: float | None = None
    tolerance: float = 1e-6
    solver: str = "auto"
    step: float | None = None
    max_step: float | None = None

    def __post_init__(self) -> None:
        for name in ("stop_time", "start_time", "output_interval", "tolerance", "step", "max_step"):
            value = getattr(self, name)
            may_be_none = name not in ("stop_time", "start_time", "tolerance")
            if not (isinstance(value, Number) and not isinstance(value, bool)) and not (may_be_none and value is None):
                raise DeclarationError(
                    "AC110",
                    f"Experiment: {name} is {value!r}, not a number",
                    where=calling_span(),
                    help="give a relative tolerance" if name == "tolerance" else "give seconds",
                )
