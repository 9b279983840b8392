"""Closed loops of joints from random starts, against maximal coordinates: equal within the tolerance, or refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import acausal
from acausal.errors import AcausalError
from tests.expected import fails_with
from tests.multibody.loops import (
    GRAVITY,
    KINDS,
    Assembly,
    Plan,
    four_bar,
    maximal,
    parameters,
    pose,
    rscr,
    rssr,
    shaken,
    three_rps,
)
from tests.multibody.maximal import Mechanism, Mechanisms, Pose, rotations

Kind = Callable[[np.random.Generator], Plan]
TOLERANCE = 1e-7


def searched(kind: Kind, compiled: int, each: int, stop: float = 0.3) -> tuple[int, list[str], list[str]]:
    """How many of so many loops were equal; which were wrong; and the codes of those that were refused.

    `compiled` plans are drawn and compiled, and each is run with `each` sets of parameters, of which the first is its
    own.
    """
    plans, begins, ends, refused, names = [], [], [], [], []
    for seed in range(compiled):
        random = np.random.default_rng([seed, *kind.__name__.encode()])
        plan = kind(random)
        model = acausal.compile(Assembly(plan=plan))
        for k in range(each):
            solver = ("idas", "rosenbrock")[k % 2]
            own = plan if k == 0 else shaken(plan, random)
            try:
                run = acausal.simulate(
                    model,
                    parameters=parameters(own),
                    stop_time=stop,
                    tolerance=TOLERANCE,
                    solver=solver,
                    output_interval=stop / 50,
                )
            except AcausalError as error:
                refused.append(error.code)
                continue
            plans.append(own)
            begins.append(pose(own, run, 0))
            ends.append(pose(own, run, -1))
            names.append(f"{kind.__name__} {seed}.{k} {solver}")
    off, allowed = distances([maximal(plan) for plan in plans], joined(begins), joined(ends), stop)
    wrong = [f"{n}: {o:.2g} > {a:.2g}" for n, o, a in zip(names, off, allowed, strict=True) if not o <= a]
    return len(names) - len(wrong), wrong, refused


def joined(poses: list[Pose]) -> Pose:
    r, Q, v, w = (np.array(parts) for parts in zip(*poses, strict=True))
    return r, Q, v, w


def distances(
    mechanisms: list[Mechanism], begin: Pose, end: Pose, stop: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far the ends are from where they must be, and how far they may be.

    That is a hundred tolerances, times what a small change of the start grows to: two links that fold out throw each
    other anywhere. Starts must be on the constraints.
    """
    group = Mechanisms(mechanisms, GRAVITY)
    positions, velocities = group.gaps(begin)
    start = np.maximum(positions, velocities)
    true = group.motion(begin, stop)
    random = np.random.default_rng(0)
    r, Q, *rates = begin
    v, w = (part + 1e-5 * random.standard_normal(part.shape) for part in rates)
    beside = group.motion((r, Q, v, w), stop)
    growth = _apart(beside, true) / 1e-5
    off = np.where(start < 1e-6, _apart(end, true), np.inf)
    return off, 100 * TOLERANCE * np.maximum(1.0, growth)


def _apart(a: Pose, b: Pose) -> NDArray[np.float64]:
    pairs = zip((a[0], rotations(a[1]), *a[2:]), (b[0], rotations(b[1]), *b[2:]), strict=True)
    return np.asarray(np.max([np.abs(x - y).reshape(len(x), -1).max(axis=1) for x, y in pairs], axis=0))


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_random_loops_move_as_in_maximal_coordinates(kind: Kind) -> None:
    compiled, each = {"stewart": (1, 3), "three_rps": (3, 4)}.get(kind.__name__, (4, 5))
    equal, wrong, refused = searched(kind, compiled, each)
    assert not wrong
    assert equal + len(refused) == compiled * each
    # a drive may be given an angle that the mechanism does not reach
    assert len(refused) <= 0.2 * compiled * each, refused


@pytest.mark.parametrize("kind", [four_bar, rscr], ids=lambda kind: kind.__name__)
def test_a_few_loops(kind: Kind) -> None:
    equal, wrong, refused = searched(kind, 1, 2, 0.1)
    assert (equal, wrong, refused) == (2, [], [])


@pytest.mark.slow
def test_a_run_that_crawls_to_a_vanishing_pivot_begins_again() -> None:
    """A platform whose pivot vanishes at 0.2 s: a Rosenbrock method took minutes there, in ever smaller steps."""
    random = np.random.default_rng([201, *b"three_rps"])
    plan = three_rps(random)
    own = shaken(plan, random)
    run = acausal.simulate(
        acausal.compile(Assembly(plan=plan)),
        parameters=parameters(own),
        stop_time=0.3,
        tolerance=TOLERANCE,
        solver="rosenbrock",
        output_interval=0.006,
    )
    assert float(run.stats["steps"]) < 5000  # type: ignore[arg-type]
    off, allowed = distances([maximal(own)], joined([pose(own, run, 0)]), joined([pose(own, run, -1)]), 0.3)
    assert off[0] <= allowed[0]


def test_a_crank_out_of_reach_is_told_so() -> None:
    """The rocker's end comes no nearer to the crank's than the rod is long and this gap, wherever it turns."""
    plan = rssr(np.random.default_rng([100, *b"rssr"]))
    a, b, c, d = (np.array(tie.place) for tie in plan.ties)
    crank, rocker = (np.array(plan.ties[k].axis) for k in (0, 3))
    (turn, _), angles = plan.drives[0].start or (0.0, 0.0), np.linspace(-np.pi, np.pi, 20_001)
    end = a + Rotation.from_rotvec(turn * crank).apply(b - a)
    ends = d + Rotation.from_rotvec(angles[:, None] * rocker).apply(c - d)
    gap = float(np.linalg.norm(ends - end, axis=1).min() - np.linalg.norm(c - b))
    assert gap > 0.0
    model = acausal.compile(Assembly(plan=plan))
    with fails_with(AcausalError, "AC301") as caught:
        acausal.simulate(model, parameters=parameters(plan), stop_time=0.01)
    assert float(caught.value.fact.split("off by ")[1].split()[0]) == pytest.approx(gap, rel=1e-3)
