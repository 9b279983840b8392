"""The command line as tests call it: in this process, or as a process of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import typer.testing
from typer.testing import CliRunner

ROOT = Path(__file__).resolve().parents[2]
# The command is made once: its parser takes 40 ms, most of the time of a short command.
typer.testing._get_command = cache(typer.testing._get_command)  # type: ignore[attr-defined]
_PROGRAM = "from acausal_command import run; run()"


@dataclass(frozen=True)
class Outcome:
    """What a command left: exit code and both streams."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Standard output as one JSON object."""
        return json.loads(self.out)


def run(*arguments: str | Path) -> Outcome:
    """Run a command in this process."""
    from acausal.cli.main import app

    result = CliRunner().invoke(app, [str(a) for a in arguments], prog_name="acausal")
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return Outcome(result.exit_code, result.stdout, result.stderr)


def start(*arguments: str | Path, folder: Path, **options: Any) -> subprocess.Popen[str]:
    """Start a command as a process of its own, in `folder`."""
    return subprocess.Popen(
        [sys.executable, "-c", _PROGRAM, *map(str, arguments)],
        stdin=subprocess.DEVNULL,
        stdout=options.pop("stdout", subprocess.PIPE),
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"},
        # A suite in the background was started with SIGINT ignored, and what it starts would be too.
        preexec_fn=None if sys.platform == "win32" else partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
        **options,
    )


def spawn(*arguments: str | Path, folder: Path) -> Outcome:
    """Run a command as a process of its own, in `folder`."""
    with start(*arguments, folder=folder) as process:
        out, err = process.communicate(timeout=300)
    return Outcome(process.returncode, out, err)
