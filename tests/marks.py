"""Parameters marked slow because a similar quick one exists."""

from __future__ import annotations

import os
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import pytest
from _pytest.mark import ParameterSet


def seeds(default: str, parts: int = 1) -> list[range]:
    """Seeds of a random search, "first:end", split into `parts`; ACAUSAL_SEEDS=0:400 selects another range.

    The suite always uses the same seeds: a hundred models of a kind reveal a defect that affects 3 % of them 19 times
    in 20. Rarer defects need a wider search than every run of a suite can afford.
    """
    first, end = map(int, os.environ.get("ACAUSAL_SEEDS", default).split(":"))
    ends = [first + (end - first) * k // parts for k in range(parts + 1)]
    return [range(a, b) for a, b in pairwise(ends)]


def slow_but(values: Iterable[Any], *quick: Any) -> list[ParameterSet]:
    """Values of one parameter, or tuples of values of several, all marked slow except the `quick` ones."""
    found = list(values)
    assert all(q in found for q in quick), f"no such value among {found}: {quick}"
    own = [v if isinstance(v, tuple) else (v,) for v in found]
    return [pytest.param(*o, marks=() if v in quick else pytest.mark.slow) for v, o in zip(found, own, strict=True)]
