"""`acausal doctor`: check of the installation."""

from __future__ import annotations

import importlib
import importlib.util
import math
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import typer

from acausal.cli.arguments import options
from acausal.cli.output.failure import FAILED
from acausal.cli.output.report import record

if TYPE_CHECKING:
    from acausal.lower.compiled import CompiledModel

_PACKAGES = ("casadi", "numpy", "scipy", "matplotlib", "typer", "pint")
_EXTRAS = {"pandas": "Result.to_pandas", "xarray": "Result.to_xarray"}


@dataclass(frozen=True)
class Finding:
    """One line of the report; `status` is "ok", "missing" (optional) or "broken"."""

    name: str
    status: str
    detail: str


def doctor(as_json: options.Json = False, quiet: options.Quiet = False) -> None:
    """Check the installation; exits with 1 if something is broken, and --quiet prints only that.

    Versions, the solvers on a small model against its closed form, a C compiler, the folder of
    compiled models, optional packages.

    Example: acausal doctor
    """
    findings = list(_findings())
    healthy = all(f.status != "broken" for f in findings)
    if as_json:
        record({"healthy": healthy, "findings": [vars(f) for f in findings]})
    else:
        _print([f for f in findings if f.status == "broken" or not quiet])
    if not healthy:
        raise typer.Exit(FAILED)


def _print(findings: list[Finding]) -> None:
    color = {"ok": typer.colors.GREEN, "missing": typer.colors.YELLOW, "broken": typer.colors.RED}
    for f in findings:
        # typer omits colours if stdout is not a terminal
        typer.echo(f"{typer.style(f.status.ljust(8), fg=color[f.status])} {f.name.ljust(22)} {f.detail}")


def _findings() -> Iterator[Finding]:
    version = platform.python_version()
    yield Finding("python", "ok" if sys.version_info >= (3, 11) else "broken", f"{version} at {sys.executable}")
    for package in _PACKAGES:
        yield _tried(package, partial(_version, package))
    yield from _solvers()
    yield from _native()
    for package, use in _EXTRAS.items():
        exists = importlib.util.find_spec(package) is not None
        yield Finding(
            package, "ok" if exists else "missing", f"for {use}" + ("" if exists else f"; pip install {package}")
        )


def _tried(name: str, check: Callable[[], str]) -> Finding:
    try:
        return Finding(name, "ok", check())
    except Exception as error:  # continue the report after any error
        return Finding(name, "broken", f"{type(error).__name__}: {error}".split("\n")[0])


def _version(package: str) -> str:
    from importlib.metadata import version

    importlib.import_module(package)
    return version(package)


def _solvers() -> Iterator[Finding]:
    """Every solver on one compiled oscillator, so that a plugin that loads but computes wrong values is found, too."""
    try:
        from acausal.lower.compile import compile
        from acausal.simulate.solvers import SOLVERS

        oscillator: Any = importlib.import_module("acausal.models.oscillator").Oscillator
        compiled = compile(oscillator())
    except Exception as error:
        yield Finding("compiling a model", "broken", f"{type(error).__name__}: {error}".split("\n")[0])
        return
    yield Finding("compiling a model", "ok", f"{1e3 * sum(compiled.timings.values()):.0f} ms")
    for name, solver in SOLVERS.items():
        step = 1e-3 if solver.fixed_step else None
        yield _tried(f"solver {name}", partial(_run, compiled, name, step))


def _native() -> Iterator[Finding]:
    """The C compiler, and the folder of compiled models."""
    try:
        from acausal.simulate.native import cache
    except Exception as error:
        yield Finding("C compiler", "broken", f"{type(error).__name__}: {error}".split("\n")[0])
        return
    compiler = cache.compiler()
    failure = None if compiler is None else cache.trial(compiler)
    if compiler is None:
        yield Finding("C compiler", "missing", "none found; models run interpreted")
    elif failure is None:
        yield Finding("C compiler", "ok", compiler)
    else:
        yield Finding("C compiler", "broken", f"{compiler} fails, models run interpreted: {failure}".split("\n")[0])
    folder = cache.folder()
    files = [f for f in folder.glob("*") if f.is_file()] if folder.is_dir() else []
    size = sum(f.stat().st_size for f in files) / 1e6
    content = f"{len(files)} files, {size:.1f} MB" if files else "empty"
    existing = next(p for p in (folder, *folder.parents) if p.exists())
    if os.access(existing, os.W_OK):
        yield Finding("compiled models", "ok", f"{folder}: {content}")
    else:
        yield Finding("compiled models", "missing", f"{folder}: not writable; compiled models are not stored")


def _run(compiled: CompiledModel, solver: str, step: float | None) -> str:
    """Compare the damped oscillator with its closed form over half a second."""
    from acausal.simulate.run import simulate

    began = time.perf_counter()
    result = simulate(compiled, stop_time=0.5, tolerance=1e-8, solver=solver, step=step)
    t, z, w = float(result.time[-1]), 0.5, math.sqrt(100.0 - 0.25)
    exact = 0.1 * math.exp(-z * t) * (math.cos(w * t) + z / w * math.sin(w * t))
    error = abs(float(result.final("mass.s")) - exact)
    if not error <= 1e-5:  # also for nan
        raise RuntimeError(f"the oscillator is off by {error:.2g} m")
    return f"oscillator within {error:.1g} m of its closed form, {1e3 * (time.perf_counter() - began):.0f} ms"
