"""Marks of parameters: what quick tests have a like of is a slow one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest
from _pytest.mark import ParameterSet


def slow_but(values: Iterable[Any], *quick: Any) -> list[ParameterSet]:
    """Values of one parameter, all of which are slow but the `quick` ones."""
    found = list(values)
    assert all(q in found for q in quick), f"no such value among {found}: {quick}"
    return [pytest.param(v, marks=() if v in quick else pytest.mark.slow) for v in found]
