"""What raises each error, run: the codes' examples in the reference, from `error-examples.txt`."""

from __future__ import annotations

import math
import os
import re
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from typer.testing import CliRunner

import acausal
from acausal.cli.arguments.reference import find_model
from acausal.cli.arguments.shipped import shipped_models
from acausal.cli.main import app

FILE = Path(__file__).with_name("error-examples.txt")


@dataclass(frozen=True)
class Example:
    """Python and perhaps a command behind it that end with an error; or a sentence instead of both."""

    code: str
    python: str = ""
    command: str = ""
    sentence: str = ""

    def message(self) -> str:
        """The whole message, without folders and line numbers.

        Raises
        ------
        ValueError
            Where it is not the error of the code: the documentation would say what is not so.
        """
        here = Path.cwd()
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            try:
                text = self._run()
            finally:
                os.chdir(here)
        if f"[{self.code}]" not in text:
            raise ValueError(f"{FILE.name}: the example of {self.code} says\n{text or 'nothing'}")
        return _without_places(text[text.index("error[") :])

    def _run(self) -> str:
        is_model = (bool(self.command) and "class " in self.python) or " m.py" in self.command
        if is_model:
            Path("m.py").write_text(f"import math\n\nfrom acausal import *\n\n\n{self.python}\n", encoding="utf-8")
        elif self.python:
            try:
                self._execute()
            except acausal.AcausalError as error:
                return str(error)
        if not self.command:
            return ""
        return CliRunner().invoke(app, self.command.split()[1:], prog_name="acausal").stderr

    def _execute(self) -> None:
        """As a file of its own, so that messages can show its lines."""
        path = Path("example.py").resolve()
        path.write_text(self.python, encoding="utf-8")
        module = ModuleType("example")
        module.__file__ = str(path)
        names = vars(module)
        names |= {n: getattr(acausal, n) for n in dir(acausal) if not n.startswith("_")}
        names |= {n: getattr(acausal, n) for n in acausal._LAZY} | {"acausal": acausal, "math": math, "Path": Path}
        names |= {m.name: find_model(m.name) for m in shipped_models() if m.name in self.python}
        sys.modules["example"] = module
        exec(compile(self.python, str(path), "exec"), names)


def examples() -> dict[str, Example]:
    """All of them by their codes."""
    found = {}
    blocks = re.split(r"^(AC\d{3})\n", FILE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    for code, block in zip(blocks[1::2], blocks[2::2], strict=True):
        lines = block.strip("\n").splitlines()
        command = next((line.removeprefix("$ ") for line in lines if line.startswith("$ ")), "")
        sentence = lines[0].removeprefix("- ") if lines[0].startswith("- ") else ""
        python = "" if sentence else "\n".join(line for line in lines if not line.startswith("$ ")).strip("\n")
        found[code] = Example(code, python, command, sentence)
    return found


def _without_places(text: str) -> str:
    text = re.sub(r"/\S*/(library/)?(?:\w+/)*?((?:\w+/)?[\w.-]+\.(py|csv|mat|casadi|nc))", r"\2", text)
    return re.sub(r"(\w\.py:)\d+", r"\1N", text).rstrip()
