"""A bar on the terminal for what takes longer than a second."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any

_PATIENCE = 1.0


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
