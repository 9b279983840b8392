"""Grids and samples: values that follow from the definition of each."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from acausal import Range
from acausal.errors import UsageError
from acausal.study.sweep.vary import design


def test_a_grid_has_all_combinations_the_last_name_fastest() -> None:
    names, values = design({"a": Range(0.0, 1.0, 3), "b": [5.0, 7.0]}, None, 0)
    assert names == ("a", "b")
    assert values.tolist() == [[0.0, 5.0], [0.0, 7.0], [0.5, 5.0], [0.5, 7.0], [1.0, 5.0], [1.0, 7.0]]


def test_a_logarithmic_range_has_constant_ratios_and_its_ends() -> None:
    levels = Range(1e7, 1e9, 5, log=True).levels()
    assert (levels[0], levels[-1]) == (1e7, 1e9)
    np.testing.assert_allclose(levels[1:] / levels[:-1], 10.0**0.5, rtol=1e-12)


def test_members_can_be_listed() -> None:
    names, values = design([{"a": 1.0, "b": 2.0}, {"b": 4.0, "a": 3.0}], None, 0)
    assert names == ("a", "b")
    assert values.tolist() == [[1.0, 2.0], [3.0, 4.0]]


@pytest.mark.parametrize("kind", ["sobol", "halton", "lhs", "random"])
def test_a_sample_fills_its_ranges_and_comes_again_with_its_seed(kind: str) -> None:
    vary = {"a": Range(2.0, 4.0), "b": Range(1.0, 100.0, log=True), "c": norm(5.0, 0.5)}
    _, values = design(vary, f"{kind}:256", 3)
    assert values.shape == (256, 3)
    assert np.array_equal(values, design(vary, f"{kind}:256", 3)[1])
    assert not np.array_equal(values, design(vary, f"{kind}:256", 4)[1])
    assert values[:, 0].min() >= 2.0
    assert values[:, 0].max() <= 4.0
    # medians and deviation of the distributions; a random sample of 256 is off by 1/16 of a deviation
    assert np.median(values[:, 0]) == pytest.approx(3.0, abs=0.15)
    assert np.median(values[:, 1]) == pytest.approx(10.0, rel=0.4)
    assert values[:, 2].std() == pytest.approx(0.5, rel=0.15)


def test_a_latin_hypercube_has_one_member_in_each_share() -> None:
    _, values = design({"a": Range(0.0, 1.0)}, "lhs:40", 0)
    assert sorted(np.floor(40 * values[:, 0]).astype(int).tolist()) == list(range(40))


@pytest.mark.parametrize(
    ("vary", "sample"),
    [
        ({}, None),
        ({"a": Range(0.0, 1.0)}, None),
        ({"a": norm(0.0, 1.0)}, None),
        ({"a": [0.0, 1.0]}, "sobol:8"),
        ({"a": Range(0.0, 1.0)}, "sobol"),
        ({"a": Range(0.0, 1.0)}, "sobol:0"),
        ({"a": Range(0.0, 1.0)}, "cubic:8"),
        ({"a": [np.nan]}, None),
        ({"a": ["x"]}, None),
        ({"a": []}, None),
        ([{"a": 1.0}, {"b": 1.0}], None),
        ({f"a{k}": Range(0.0, 1.0, 100) for k in range(4)}, None),
    ],
)
def test_what_makes_no_sense_is_refused(vary: Any, sample: str | None) -> None:
    with pytest.raises(UsageError, match="AC060"):
        design(vary, sample, 0)


@pytest.mark.parametrize("ends", [(1.0, 1.0), (2.0, 1.0), (0.0, np.inf), (np.nan, 1.0)])
def test_a_range_goes_up(ends: tuple[float, float]) -> None:
    with pytest.raises(UsageError, match="AC060"):
        Range(*ends, 3)


def test_a_logarithmic_range_is_positive() -> None:
    with pytest.raises(UsageError, match="AC060"):
        Range(0.0, 1.0, 3, log=True)
