"""Every feature with every verb: equal within its tolerance, or refused with a code; nothing else."""

from __future__ import annotations

import pytest
from _pytest.mark import ParameterSet

from acausal import AcausalError
from tests.matrix.features import FEATURES, Feature
from tests.matrix.verbs import SOLVERS, VERBS

NATIVE = tuple(f"{solver} native" for solver in SOLVERS)

# What compiles C, steps a thousand times or runs a bench.
SLOW = (*NATIVE, "accuracy", "bench", "rk fixed step", "rk2 fixed step")

# What runs a model several times is left to the slow part where once takes its time.
SEVERAL = ("stability", "threads", "again")

# What runs a model once more or compiled, or reads its result otherwise, is the same from another start.
AGAIN = (
    *NATIVE,
    "again",
    "accuracy",
    "other interval",
    "other stop",
    "bench",
    "threads",
)

# `accuracy` is a bench and then a run, judged more sharply; the other features have the bench alone.
BENCHED = ("smooth", "dae", "time event", "delay", "inputs", "assertion broken")


def cells() -> list[ParameterSet]:
    """Pairs of a feature and a verb; those outside the quick part are marked."""
    found: list[ParameterSet] = []
    for feature in FEATURES:
        for verb in VERBS:
            known = verb == ("bench" if feature.name in BENCHED else "accuracy")
            if known or (feature.other_start and verb in AGAIN):
                continue
            costs = feature.cost > 2.0 or (feature.cost > 1.0 and verb in SEVERAL)
            marks = (pytest.mark.slow,) if verb in SLOW or costs else ()
            found.append(pytest.param(feature, verb, id=f"{feature.name}, {verb}", marks=marks))
    return found


@pytest.mark.parametrize(("feature", "verb"), cells())
def test_cell(feature: Feature, verb: str) -> None:
    code = None
    try:
        VERBS[verb](feature)
    except AcausalError as error:
        code = error.code
    assert code is None or not code.startswith("AC9"), f"{code} is a defect"
    if feature.refused is not None and verb in ("again", *SOLVERS):
        assert code == feature.refused[0]
