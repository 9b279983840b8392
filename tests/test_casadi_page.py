"""docs/casadi.md runs, and its file is read by CasADi alone."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

PAGE = Path(__file__).parents[1] / "docs" / "casadi.md"
BLOCKS = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
ALONE = """
import sys
sys.path = [p for p in sys.path if p != {root!r}]
sys.modules["acausal"] = None  # whoever imports it fails
{five}
rate, y = functions["ode"]([0.0, 2.0], 3.0, [entry["start"] for entry in about["p"]])
print([float(v) for v in (*rate.elements(), *y.elements())], [entry["name"] for entry in about["x"]])
"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The folder in which all blocks have run, and the names they leave."""
    folder = tmp_path_factory.mktemp("page")
    names: dict[str, Any] = {"__name__": "page"}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for k, block in enumerate(BLOCKS):
            exec(compile(block, f"<casadi {k}>", "exec", dont_inherit=True), names)
    return folder, names


def test_five_lines_read_the_file_without_acausal(page: tuple[Path, dict[str, Any]]) -> None:
    """v' = F/m = 3 at v = 2, F = 3, m = 1; power F v = 6."""
    (five,) = (block for block in BLOCKS if block.startswith("import casadi, json"))
    assert len([line for line in five.splitlines() if line]) == 5
    code = ALONE.format(five=five, root=str(PAGE.parents[1]))
    run = subprocess.run([sys.executable, "-I", "-c", code], cwd=page[0], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip() == "[2.0, 3.0, 6.0] ['mass.s', 'mass.v']"


def test_casadi_alone_bounces_the_ball(page: tuple[Path, dict[str, Any]]) -> None:
    """Free fall: the first impact after sqrt(2 h/g), each flight 2 e^k sqrt(2 g h)/g long, up to 2 s."""
    first = math.sqrt(2 / 9.81)
    times: list[float] = []
    while not times or times[-1] < 2.0:
        k = len(times)
        times.append(first if not k else times[-1] + 2 * 0.8**k * first)
    np.testing.assert_allclose(page[1]["impacts"], times[:-1], atol=1e-9)
    assert page[1]["x"][2] == len(times) - 1


def test_a_decision_by_name(page: tuple[Path, dict[str, Any]]) -> None:
    heavier = page[1]["heavier"]
    assert heavier.p.names == ("mass.m",)
    assert float(heavier.ode([0.0, 0.0], 1.0, 4.0)[0][1]) == 0.25
