"""What compiling costs grows as the model does, and the garbage collector does not walk through what lives.

Counts, not seconds: all calls of functions, Python's and built-in ones, while a model is made and compiled.
"""

import cProfile
import gc
import pstats
from collections.abc import Iterator

import pytest

import acausal
from acausal.collector import collector_paused
from acausal.models.rc_ladder import RCLadder


def calls(n: int) -> int:
    gc.collect()  # what tests before have left would be finalized in between, by calls that count
    profile = cProfile.Profile()
    profile.enable()
    acausal.compile(RCLadder(n=n), cache=False)
    profile.disable()
    return int(pstats.Stats(profile).total_calls)  # type: ignore[attr-defined]


@pytest.mark.slow
def test_calls_grow_with_the_model() -> None:
    """Twice as many sections more, of ten equations each, take twice as many calls more, to the power of 1.05."""
    calls(180)  # what is made and imported once
    # above a hundred equal parts, where patterns begin, and 500 equations to match, where SciPy does
    few, some, many = (calls(n) for n in (180, 300, 540))
    assert (many - some) / (some - few) < 2.0**1.05
    assert (many - some) / 240 < 3700  # 3520 when this was written, 3970 before


@pytest.fixture
def frozen_again() -> Iterator[None]:
    """Freeze again what `conftest.py` has frozen; otherwise every later collection of a session would traverse it."""
    yield
    gc.freeze()


@pytest.mark.usefixtures("frozen_again")
def test_what_was_made_is_old() -> None:
    """A hundred thousand lists made in a pause are in the oldest generation behind it, without a collection."""
    gc.unfreeze()  # nothing made is old where a user has frozen, as conftest.py has
    runs = sum(s["collections"] for s in gc.get_stats())
    with collector_paused():
        with collector_paused():
            made = [[k] for k in range(200_000)]
        assert not gc.isenabled()
    assert gc.isenabled()
    assert gc.get_count()[0] < len(made) / 2
    old = {id(x) for x in gc.get_objects(generation=2)}
    assert all(id(x) in old for x in made[::1000])
    assert sum(s["collections"] for s in gc.get_stats()) <= runs + 3  # the walk for this assertion itself may be one


@pytest.mark.usefixtures("frozen_again")
def test_pause_leaves_what_the_user_froze() -> None:
    """`gc.freeze` is the user's: nothing is thawed."""
    gc.freeze()
    try:
        frozen = gc.get_freeze_count()
        with collector_paused():
            made = [[k] for k in range(200_000)]
        assert gc.get_freeze_count() >= frozen - 1000
        assert made
    finally:
        gc.unfreeze()
