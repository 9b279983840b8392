"""The run a model is meant for; every field can be overridden when it is simulated."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Experiment:
    """Default run of a model: `experiment = Experiment(stop_time=40.0)` in the class body.

    `stop_time`, `start_time`, `output_interval` and `step` in seconds; `output_interval` None gives 500
    intervals; `solver` is a solver's name or "auto"; `step` is the size of a fixed step, `max_step` the largest step of
    an adaptive solver: the shortest time in which something may happen that it must not step over.
    """

    stop_time: float = 1.0
    start_time: float = 0.0
    output_interval: float | None = None
    tolerance: float = 1e-6
    solver: str = "auto"
    step: float | None = None
    max_step: float | None = None
