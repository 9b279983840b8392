"""docs/fit.md runs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

PAGE = Path(__file__).resolve().parents[1] / "docs" / "fit.md"


@pytest.mark.slow
def test_the_steel_is_found() -> None:
    """34CrMo4 has k_c1.1 = 2240 N/mm2 and z = 0.21 in the paper; one chip thickness does not tell them apart."""
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    found: dict[str, Any] = {"__name__": "page"}
    exec(compile("\n".join(blocks), str(PAGE), "exec"), found)
    low, high = found["found"].interval.T
    truth = np.array([2.24e9, 0.21])
    assert (low <= truth).all()
    assert (truth <= high).all()
    assert (
        found["found"].runs + 0.4 * found["found"].gradients <= 25
    )  # a gradient takes a fifth of a run, or less than two
    assert "combination of drill.k_c11, drill.z" in found["alone"].notes[0]
