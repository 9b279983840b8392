"""Values given to parts at any depth: bindings, overrides by path, and parts in lists."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import acausal
from acausal import Component, Equations, Real, der, fixed, parameter, part, signal_input, structural, variable
from acausal.errors import UsageError
from acausal.flatten.flatten import flatten
from tests.expected import fails_with


class Leaf(Component):
    k: Real = parameter(default=1.0)
    x: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == -self.k * self.x


class Node(Component):
    """`tree` is a list of its parts: a number makes a leaf with that k, a list another node; k is passed down."""

    tree: tuple[Any, ...] = structural()
    k: Real = parameter(default=2.0)
    parts: list[Component] = part()

    def build(self) -> None:
        self.parts = [
            Node(tree=tuple(t), k=self.k * 2.0)
            if isinstance(t, list | tuple)
            else Leaf(k=self.k if t is None else t, x=fixed(float(i)))
            for i, t in enumerate(self.tree)
        ]


leaf = st.one_of(st.none(), st.floats(0.1, 9.0).map(lambda v: round(v, 2)))
trees = st.recursive(
    st.lists(leaf, max_size=3), lambda inner: st.lists(st.one_of(leaf, inner), max_size=3), max_leaves=8
)


def expected(tree: Any, k: float, prefix: str = "") -> dict[str, float]:
    """Value of k of every leaf, by path."""
    found: dict[str, float] = {}
    for i, t in enumerate(tree):
        path = f"{prefix}parts[{i}]"
        if isinstance(t, list | tuple):
            found |= expected(t, 2.0 * k, path + ".")
        else:
            found[path + ".k"] = k if t is None else t
    return found


def leaves(flat: Any) -> dict[str, float]:
    """Value of k of every leaf of a flat system, by path."""
    found = {}
    for p in flat.parameters:
        if p.path.rpartition(".")[0] in flat.components and flat.components[p.path.rpartition(".")[0]].cls is Leaf:
            found[p.path] = flat.pool.parameter_value(p.nodes[0])
    return found


@given(trees, st.floats(0.1, 5.0))
def test_bindings_reach_every_leaf(tree: list[Any], k: float) -> None:
    flat = flatten(Node(tree=tuple(tree), k=k))
    wanted = expected(tree, k)
    assert leaves(flat).keys() == wanted.keys()
    for path, value in leaves(flat).items():
        assert value == pytest.approx(wanted[path], rel=1e-12)


@given(trees, st.floats(0.1, 5.0), st.data())
def test_an_override_by_path_changes_that_leaf_and_no_other(tree: list[Any], value: float, data: st.DataObject) -> None:
    wanted = expected(tree, 2.0)
    if not wanted:
        return
    path = data.draw(st.sampled_from(sorted(wanted)))
    flat = flatten(Node(tree=tuple(tree)), {path: value})
    wanted[path] = value
    for name, found in leaves(flat).items():
        assert found == pytest.approx(wanted[name], rel=1e-12)


@given(st.integers(1, 4), st.integers(-2, 6))
def test_an_index_out_of_range_is_named(size: int, index: int) -> None:
    model = Node(tree=(None,) * size)
    path = f"parts[{index}].k"
    if 0 <= index < size:
        assert leaves(flatten(model, {path: 7.0}))[path] == 7.0
    else:
        with fails_with(UsageError, "AC020", path):
            flatten(model, {path: 7.0})


@given(st.integers(1, 5))
def test_starts_are_kept_apart(size: int) -> None:
    flat = flatten(Node(tree=(None,) * size))
    assert {s.path: flat.pool.value(s.node) for s in flat.starts.values()} == {
        f"parts[{i}].x": float(i) for i in range(size)
    }


class Arrays(Component):
    B: Real = parameter(default=((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)), shape=(2, 3))
    d: Real = parameter(default=(1.0, 2.0), shape=2)
    e: Real = parameter(default=lambda self: 2.0 * self.d, shape=2)
    s: Real = variable(shape=(2, 3), default=fixed(0.0))
    t: Real = variable(shape=2, default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.s) == self.B
        yield der(self.t) == self.e


def test_an_entry_is_set_like_the_whole() -> None:
    """The same model however it is given: as a component, compiled, by entries or as a whole."""
    whole = {"d": [1.0, 7.0], "B": [[1.0, 2.0, 3.0], [9.0, 5.0, 6.0]]}
    entries = {"d[1]": 7.0, "B[1,0]": 9.0}
    runs = [
        acausal.simulate(model, parameters=given, stop_time=1.0)
        for model in (Arrays(), acausal.compile(Arrays()))
        for given in (whole, entries)
    ]
    for run in runs:
        assert run.final("s") == pytest.approx(np.array(whole["B"]))
        assert run.final("t") == pytest.approx(np.array([2.0, 14.0]))
    with pytest.raises(UsageError, match=r"AC022.*bound as a whole"):
        acausal.simulate(Arrays(), parameters={"e[0]": 1.0})


@pytest.mark.parametrize("model", [Arrays(), acausal.compile(Arrays())])
def test_the_transpose_of_a_matrix_is_refused(model: Any) -> None:
    """It has as many numbers, and was taken row by row."""
    for wrong in (np.ones((3, 2)), [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], np.ones((6, 1))):
        with pytest.raises(UsageError, match=r"AC023.*2x3 matrix"):
            acausal.simulate(model, parameters={"B": wrong})
        with pytest.raises(UsageError, match=r"AC023.*2x3 matrix"):
            acausal.simulate(model, start={"s": wrong})


class Apart(Component):
    u: Real = signal_input(default=2.0)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.u
        yield der(self.y) == -self.y


def test_an_input_that_no_output_depends_on_keeps_its_default() -> None:
    """Leaving equations out changes no value; the run asked for the input instead (AC033)."""
    asked = acausal.simulate(Apart(), outputs=["y"], stop_time=1.0, tolerance=1e-9)
    assert asked.final("y") == pytest.approx(np.exp(-1.0), rel=1e-7)
    assert acausal.simulate(Apart(), outputs=["x"], stop_time=1.0).final("x") == pytest.approx(2.0)
