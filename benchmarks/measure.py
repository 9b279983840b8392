"""Common functions of the benchmarks: alternated repetitions, medians, a readable line and a JSON record."""

from __future__ import annotations

import gc
import json
import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any


def alternated(jobs: Mapping[str, Callable[[], Any]], repetitions: int) -> dict[str, list[float]]:
    """Processor seconds of every job, run in turn so that changes of the machine's speed affect all of them alike.

    Each job runs once before, unmeasured.
    """
    for job in jobs.values():
        job()
    seconds: dict[str, list[float]] = {name: [] for name in jobs}
    gc.disable()
    for _ in range(repetitions):
        for name, job in jobs.items():
            gc.collect()
            began = time.process_time()
            job()
            seconds[name].append(time.process_time() - began)
    gc.enable()
    return seconds


def medians(seconds: Mapping[str, list[float]]) -> dict[str, float]:
    """Median of each list."""
    return {name: statistics.median(values) for name, values in seconds.items()}


def ratios(seconds: Mapping[str, list[float]], name: str) -> dict[str, float]:
    """Median over the rounds of the time of `name` divided by that of each other job in the same round."""
    return {
        other: statistics.median(a / b for a, b in zip(seconds[name], values, strict=True))
        for other, values in seconds.items()
        if other != name
    }


def report(claim: str, line: str, record: Mapping[str, Any]) -> None:
    """Print the claim with its readable line, and the record as JSON."""
    import casadi

    machine = {
        "python": platform.python_version(),
        "casadi": casadi.CasadiMeta.version(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
    }
    print(json.dumps({"claim": claim, **record, "machine": machine}, indent=1))
    print(line)


def rounded(value: Any, digits: int = 4) -> Any:
    """Numbers to a few significant digits, through dictionaries and lists."""
    if isinstance(value, float):
        return float(f"{value:.{digits}g}")
    if isinstance(value, Mapping):
        return {k: rounded(v, digits) for k, v in value.items()}
    return [rounded(v, digits) for v in value] if isinstance(value, list | tuple) else value


def drawn_lines(file: Path, lines: Mapping[str, list[tuple[float, float]]], across: str, up: str) -> None:
    """Draw a log-log picture of some lines with their points."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for (name, points), marker in zip(lines.items(), "osD^vP*X<>", strict=False):
        if points:
            axes.loglog(*zip(*points, strict=True), marker=marker, markersize=5, label=name)
    places = sorted({x for points in lines.values() for x, _ in points})
    if len(places) < 12:
        axes.set_xticks(places, [f"{x:g}" for x in places])
        axes.set_xticks([], minor=True)
    axes.set_xlabel(across)
    axes.set_ylabel(up)
    axes.grid(True, color="0.9")
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(file, dpi=150)
