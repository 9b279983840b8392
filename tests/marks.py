"""Marks of parameters: what quick tests have a like of is a slow one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest
from _pytest.mark import ParameterSet


def slow_but(values: Iterable[Any], *quick: Any) -> list[ParameterSet]:
    """Values of one parameter, or tuples of values of several, all of which are slow but the `quick` ones."""
    found = list(values)
    assert all(q in found for q in quick), f"no such value among {found}: {quick}"
    own = [v if isinstance(v, tuple) else (v,) for v in found]
    return [pytest.param(*o, marks=() if v in quick else pytest.mark.slow) for v, o in zip(found, own, strict=True)]
