"""Values given to parts at any depth: bindings, overrides by path, and parts in lists."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acausal import Component, Equations, Real, der, fixed, parameter, part, structural, variable
from acausal.errors import UsageError
from acausal.flatten.flatten import flatten


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


@settings(max_examples=50)
@given(trees, st.floats(0.1, 5.0))
def test_bindings_reach_every_leaf(tree: list[Any], k: float) -> None:
    flat = flatten(Node(tree=tuple(tree), k=k))
    wanted = expected(tree, k)
    assert leaves(flat).keys() == wanted.keys()
    for path, value in leaves(flat).items():
        assert value == pytest.approx(wanted[path], rel=1e-12)


@settings(max_examples=50)
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
        with pytest.raises(UsageError) as caught:
            flatten(model, {path: 7.0})
        assert caught.value.code == "AC020"
        assert path in caught.value.fact


@given(st.integers(1, 5))
def test_starts_are_kept_apart(size: int) -> None:
    flat = flatten(Node(tree=(None,) * size))
    assert {s.path: flat.pool.value(s.node) for s in flat.starts.values()} == {
        f"parts[{i}].x": float(i) for i in range(size)
    }
