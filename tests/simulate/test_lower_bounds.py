"""Guards that are left out where there are many rows are those whose bounds are positive all the same."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from acausal.simulate.events.location.between import interpolated, lower_bounds, lowest, root, steady


@given(seed=st.integers(0, 10_000), spread=st.sampled_from([0.0, 0.1, 0.9, 6.0]), away=st.floats(0.0, 200.0))
def test_no_guard_that_may_be_passed_is_left_out(seed: int, spread: float, away: float) -> None:
    """Walks with random steps and intervals; each guard is so many of its largest steps away from zero, or on it."""
    draw = np.random.default_rng(seed)
    times = np.cumsum((1.0 + spread) ** draw.uniform(-1.0, 1.0, 600))
    steps = draw.uniform(-1.0, 1.0, (600, 5)) * draw.uniform(0.0, 1.0, 5) ** 4
    g = np.cumsum(steps, axis=0)
    g += away * np.abs(steps).max(axis=0) * draw.uniform(0.0, 1.0, 5) - g.min(axis=0)
    g[7, 0] = np.nan
    places, bounds = lowest(times, g)
    found = np.full((len(g) - 1, g.shape[1]), np.inf)
    found[places] = bounds
    assert ((found < 0.0) == (lower_bounds(times, g) < 0.0)).all()
    assert (found[found < np.inf] == lower_bounds(times, g)[found < np.inf]).all()


def test_rows_that_are_next_to_each_other_do_not_enlarge_rounding_errors() -> None:
    """A straight line, known to its last digit, at evenly spaced rows with six of them within 0.1 us.

    The polynomial of degree seven there swings by a fortieth: three plates behind each other took ten minutes.
    """
    times = np.sort(np.concatenate([np.linspace(0.0, 0.4, 101), 0.2 + 2e-8 * np.arange(1, 6)]))
    line = (1.0 + 2.3e-3 * times)[:, None]
    wanted = np.linspace(0.15, 0.25, 997)
    exact = (1.0 + 2.3e-3 * wanted)[:, None]
    assert np.abs(interpolated(times, line, wanted, 8)[0] - exact).max() > 1e-10
    assert np.abs(steady(times, line, wanted, 8) - exact).max() < 1e-12


def test_a_zero_between_points_of_which_rounding_makes_some_one() -> None:
    a, b = 1.5999999999999996, 1.5999999999999999
    times, values = np.array([a, a, b, b, 1.6]), np.array([1e-16, 3e-17, -6e-17, -1e-16, -2e-16])
    assert a <= root(times, values, 1) <= b
