"""Where fixed steps are looked at for events: every other step, and at every output."""

from itertools import pairwise

import numpy as np
import pytest

from acausal.simulate.events.location.mesh import stepped


@pytest.mark.parametrize("seed", range(20))
def test_mesh_of_fixed_steps(seed: int) -> None:
    """Each output before the end is one of them, none is farther from the next than two steps, and all are evenly
    spaced between two outputs; fewer than all are the first ones of all."""
    rng = np.random.default_rng(seed)
    outputs, step = np.sort(rng.uniform(1.0, 5.0, 1 + seed)), float(10.0 ** rng.uniform(-3.0, 0.0))
    mesh = stepped(0.5, outputs, 4.0, step, 10**6)
    stops = [0.5, *outputs[outputs < 4.0], 4.0]
    assert set(stops[1:]) <= set(mesh)
    assert (np.diff(mesh, prepend=0.5) > 0.0).all()
    for left, right in pairwise(stops):
        gaps = np.diff(mesh[(mesh > left) & (mesh <= right)], prepend=left)
        assert gaps.max() <= 2.0 * step * (1.0 + 1e-9)
        assert np.ptp(gaps) < 1e-12
    assert np.array_equal(stepped(0.5, outputs, 4.0, step, 7), mesh[:7])
