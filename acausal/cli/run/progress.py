"""Time of a command: a bar on the terminal for what takes longer than a second, and seconds by stage."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any

_PATIENCE = 1.0
# What Python has already used when the command line is loaded: its own start and the imports so far. The processor's
# time is the portable measure of it; the wall's differs when the disk is cold.
_BEFORE = time.process_time()
_LOADED = time.perf_counter()


class ProgressBar:
    """What `simulate(progress=...)` calls; it draws nothing before `_PATIENCE` seconds, and nothing into a file."""

    def __init__(self, label: str, quiet: bool = False) -> None:
        self.label = label
        # Taken now: the solver's words to stderr are caught while the bar is shown.
        self._stream = sys.stderr
        self._shown = not quiet and self._stream.isatty()
        self._bar: Any = None
        self._task: Any = None

    def __enter__(self) -> ProgressBar:
        self._began = time.perf_counter()
        return self

    def __call__(self, fraction: float, reached: float) -> None:
        self.show(fraction, f"{reached:.6g} s")

    def show(self, fraction: float, reached: str) -> None:
        """Draw how much is done, and where that is, in words."""
        if not self._shown or (self._bar is None and time.perf_counter() - self._began < _PATIENCE):
            return
        self._bar = self._bar or self._started()
        self._bar.update(self._task, completed=fraction, reached=reached)

    def _started(self) -> Any:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

        bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[reached]}"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=Console(file=self._stream),
            transient=True,
        )
        self._task = bar.add_task(self.label, total=1.0, reached="")
        bar.start()
        return bar

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()


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
