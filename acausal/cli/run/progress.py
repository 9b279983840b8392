"""Time of a command: a progress bar on the terminal after one second, and seconds by stage."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any

_PATIENCE = 1.0
# Time that Python has used before this module is loaded: its start and the imports so far. Processor time is the
# portable measure of it, although the elapsed time is longer when the disk cache is cold.
_BEFORE = time.process_time()
_LOADED = time.perf_counter()


class ProgressBar:
    """Progress bar for `simulate(progress=...)`; draws nothing before `_PATIENCE` seconds, and nothing into a file."""

    def __init__(self, label: str, quiet: bool = False) -> None:
        self.label = label
        # keep the stream, because stderr is redirected while the bar is shown, to catch the messages of solvers
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
        """Draw the fraction that is done, with a text for it."""
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
    """Seconds per stage; the difference to `total` belongs to no stage."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._mark = _LOADED - _BEFORE

    def lap(self, stage: str) -> None:
        """Add the time since the last lap (or the start of the process) to `stage`."""
        now = time.perf_counter()
        self.laps[stage] = self.laps.get(stage, 0.0) + now - self._mark
        self._mark = now

    def take(self, source: str, stages: dict[str, float]) -> None:
        """Move the times of `stages`, measured elsewhere, from `source` to these stages."""
        inside = {k: v for k, v in stages.items() if v > 0.0}
        self.laps[source] = max(self.laps.get(source, 0.0) - sum(inside.values()), 0.0)
        for stage, seconds in inside.items():
            self.laps[stage] = self.laps.get(stage, 0.0) + seconds

    @property
    def total(self) -> float:
        """Seconds since the start of the process."""
        return time.perf_counter() - _LOADED + _BEFORE
