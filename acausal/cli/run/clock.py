"""Wall time of a command by stage, from the start of the process on."""

from __future__ import annotations

import time

# What Python has already used when the command line is loaded: its own start and the imports so far. The processor's
# time is the portable measure of it; the wall's differs when the disk is cold.
_BEFORE = time.process_time()
_LOADED = time.perf_counter()


class Clock:
    """Seconds per stage; what no stage claims is the difference to `total`."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._mark = _LOADED - _BEFORE

    def lap(self, stage: str) -> None:
        """Everything since the last lap, the first time since the start of the process, belongs to `stage`."""
        now = time.perf_counter()
        self.laps[stage] = self.laps.get(stage, 0.0) + now - self._mark
        self._mark = now

    def take(self, source: str, stages: dict[str, float]) -> None:
        """Divide what `source` has into `stages` measured elsewhere; the rest stays with it."""
        inside = {k: v for k, v in stages.items() if v > 0.0}
        self.laps[source] = max(self.laps.get(source, 0.0) - sum(inside.values()), 0.0)
        for stage, seconds in inside.items():
            self.laps[stage] = self.laps.get(stage, 0.0) + seconds

    @property
    def total(self) -> float:
        """Seconds since the start of the process."""
        return time.perf_counter() - _LOADED + _BEFORE
