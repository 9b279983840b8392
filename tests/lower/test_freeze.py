"""Parameters made numbers, and the names that say which."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, parameter, part, structural, variable
from acausal.errors import UsageError


class Leaf(Component):
    k: Real = parameter(default=2.0)
    r: Real = parameter(default=(1.0, 0.0, 3.0), shape=3)
    x: Real = variable(shape=3, nominal=1e-3, default=fixed((1.0, 1.0, 1.0)))

    def equations(self) -> Equations:
        yield der(self.x) == -self.k * self.r + 0.0 * self.x


class Tree(Component):
    n: int = structural(default=2)
    scale: Real = parameter(default=1.0)
    leaves: list[Leaf] = part()

    def build(self) -> None:
        self.leaves = [Leaf(k=self.scale) for _ in range(self.n)]

    def equations(self) -> Equations:
        yield from ()


def free(*names: str) -> set[str]:
    return set(acausal.compile(Tree(), freeze=names).parameters)


ALL = {"scale", *(f"leaves[{k}].r[{i}]" for k in range(2) for i in range(3))}


def test_names_that_can_be_given() -> None:
    assert free() == ALL
    assert free("scale") == ALL - {"scale"}
    assert free("leaves[0]") == ALL - {f"leaves[0].r[{i}]" for i in range(3)}
    assert free("leaves[1].r") == ALL - {f"leaves[1].r[{i}]" for i in range(3)}
    assert free("leaves[1].r[2]") == ALL - {"leaves[1].r[2]"}
    assert free("zeros") == ALL - {"leaves[0].r[1]", "leaves[1].r[1]"}
    assert free("*") == set()


def test_frozen_values_are_those_of_the_model_and_of_this_compilation() -> None:
    compiled = acausal.compile(Tree(), parameters={"scale": 5.0}, freeze=["scale", "leaves[0]"])
    result = acausal.simulate(compiled, stop_time=1.0, parameters={"leaves[1].r[0]": 2.0})
    # x = 1 - k r t, closed form
    np.testing.assert_allclose(result["leaves[0].x"][-1], [-4.0, 1.0, -14.0], rtol=1e-7)
    np.testing.assert_allclose(result["leaves[1].x"][-1], [-9.0, 1.0, -14.0], rtol=1e-7)
    assert result["scale"][0] == 5.0
    assert result["leaves[0].r"][0].tolist() == [1.0, 0.0, 3.0]


def test_a_frozen_parameter_cannot_be_changed() -> None:
    compiled = acausal.compile(Tree(), freeze=["leaves[0].r[1]"])
    values: tuple[Any, ...] = ({"leaves[0].r[1]": 1.0}, {"leaves[0].r": (1.0, 1.0, 1.0)})
    for value in values:
        with pytest.raises(UsageError, match="frozen") as caught:
            acausal.simulate(compiled, stop_time=1.0, parameters=value)
        assert caught.value.code == "AC022"
    acausal.simulate(compiled, stop_time=1.0, parameters={"leaves[0].r[2]": 1.0})


@pytest.mark.parametrize(("name", "told"), [("leafs[0].r", "leaves[0].r"), ("leaves[0].x", "only parameters")])
def test_unknown_names(name: str, told: str) -> None:
    with pytest.raises(UsageError) as caught:
        acausal.compile(Tree(), freeze=[name])
    assert caught.value.code == "AC020"
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("outputs", "code", "told"),
    [
        (["leaves[0].y"], "AC010", "leaves[0].x"),
        (["leaves[0]"], "AC010", "leaves[0].*"),
        (["scale"], "AC010", "parameter"),
        ([], "AC018", "outputs="),
        ("leaves[0].x", "AC018", "outputs=['leaves[0].x']"),
    ],
)
def test_outputs_that_cannot_be(outputs: list[str], code: str, told: str) -> None:
    with pytest.raises(UsageError) as caught:
        acausal.compile(Tree(), outputs=outputs)
    assert caught.value.code == code
    assert told in str(caught.value)


def test_patterns_and_entries_are_outputs() -> None:
    selection = acausal.compile(Tree(), outputs=["leaves[0].*", "leaves[1].x[2]"]).selection
    assert selection is not None
    assert selection.outputs == ("leaves[0].x[0]", "leaves[0].x[1]", "leaves[0].x[2]", "leaves[1].x[2]")


def test_freezing_does_not_change_tolerances() -> None:
    """Zeros join variables of different nominal sizes; absolute tolerances stay what they were."""
    full, frozen = acausal.compile(Tree()), acausal.compile(Tree(), freeze=["*"])
    sizes = dict(zip(full.states, full.nominal_x, strict=True))
    assert all(sizes[name] == size for name, size in zip(frozen.states, frozen.nominal_x, strict=True))
