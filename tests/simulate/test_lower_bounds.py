"""Guards that are left out where there are many rows are those whose bounds are positive all the same."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from acausal.simulate.events.location.between import _bounds, lowest


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
    assert ((found < 0.0) == (_bounds(times, g) < 0.0)).all()
    assert (found[found < np.inf] == _bounds(times, g)[found < np.inf]).all()
