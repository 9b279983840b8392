"""The tree of frames: loops cut once, roots chosen by rank, every frame told its role.

The connector here is a planar one, an angle instead of a rotation matrix: the algorithm sees `overconstrained` only.
"""

from __future__ import annotations

import pytest

import acausal
from acausal import (
    Component,
    Connector,
    Equations,
    Real,
    branch,
    connect,
    flow,
    is_root,
    parameter,
    part,
    potential_root,
    root,
    rooted,
    structural,
    variable,
)
from acausal.errors import AcausalError, DeclarationError, StructureError
from tests.expected import fails_with


class Frame(Connector):
    """An angle that is the same in all connected frames, and the torque about it."""

    phi: Real = variable(overconstrained=True)
    t: Real = flow()

    def residuals(self, other: Frame) -> Equations:
        yield self.phi == other.phi


class Ground(Component):
    frame: Frame = Frame()

    def ties(self) -> Equations:
        yield root(self.frame)

    def equations(self) -> Equations:
        yield self.frame.phi == 0.25


class Bar(Component):
    """Turns by a fixed angle from one end to the other, written from the root outward."""

    frame_a: Frame = Frame()
    frame_b: Frame = Frame()
    angle: Real = parameter(default=1.0)

    def ties(self) -> Equations:
        yield branch(self.frame_a, self.frame_b)

    def equations(self) -> Equations:
        if rooted(self.frame_a):
            yield self.frame_b.phi == self.frame_a.phi + self.angle
        else:
            yield self.frame_a.phi == self.frame_b.phi - self.angle
        yield self.frame_a.t + self.frame_b.t == 0


class Free(Component):
    """Has an angle of its own when nobody else gives it one."""

    frame: Frame = Frame()
    priority: int = structural(default=0)
    own: Real = parameter(default=10.0)

    def ties(self) -> Equations:
        yield potential_root(self.frame, self.priority)

    def equations(self) -> Equations:
        if is_root(self.frame):
            yield self.frame.phi == self.own
        else:
            yield self.frame.t == 0


class Chain(Component):
    """Ground and bars in a row; `turned` bars are built in the wrong way round."""

    turned: tuple[bool, ...] = structural(default=(False, False))
    ground: Ground = Ground()
    bars: list[Bar] = part()

    def build(self) -> None:
        self.bars = [Bar(angle=k + 1.0) for k in range(len(self.turned))]

    def equations(self) -> Equations:
        tip = self.ground.frame
        for bar, is_turned in zip(self.bars, self.turned, strict=True):
            a, b = (bar.frame_b, bar.frame_a) if is_turned else (bar.frame_a, bar.frame_b)
            yield connect(tip, a)
            tip = b


@pytest.mark.parametrize("turned", [(False, False), (True, False), (False, True), (True, True)])
def test_equations_are_written_from_the_root_outward(turned: tuple[bool, bool]) -> None:
    """The angle at the tip is 0.25 + 1 + 2, each term negative where its bar is turned."""
    model = Chain(turned=turned)
    result = acausal.simulate(model)
    expected = 0.25 + sum((-1 if t else 1) * (k + 1.0) for k, t in enumerate(turned))
    tip = "bars[1].frame_a.phi" if turned[1] else "bars[1].frame_b.phi"
    assert result.final(tip) == pytest.approx(expected)
    flat = acausal.flatten(model)
    number = {v.path: v.first for v in flat.variables}
    left = {(e.component, flat.pool.nodes[e.left]) for e in flat.equations}
    for k, is_turned in enumerate(turned):
        outward = f"bars[{k}].frame_{'a' if is_turned else 'b'}.phi"
        assert (f"bars[{k}]", ("var", number[outward])) in left


class Islands(Component):
    """Two islands without a ground: one with two candidates, one with one."""

    ranks: tuple[int, int] = structural(default=(5, 1))
    a: Free = part()
    b: Free = part()
    c: Free = Free(own=30.0)
    bar: Bar = Bar()

    def build(self) -> None:
        self.a, self.b = Free(priority=self.ranks[0], own=10.0), Free(priority=self.ranks[1], own=20.0)

    def equations(self) -> Equations:
        yield connect(self.a.frame, self.bar.frame_a)
        yield connect(self.b.frame, self.bar.frame_b)


@pytest.mark.parametrize(
    ("ranks", "expected"), [((5, 1), (19.0, 20.0)), ((1, 5), (10.0, 11.0)), ((0, 0), (10.0, 11.0))]
)
def test_the_smallest_priority_number_is_the_root(ranks: tuple[int, int], expected: tuple[float, float]) -> None:
    """Of equal candidates the first. The other one is then free of torque."""
    result = acausal.simulate(Islands(ranks=ranks))
    assert (result.final("a.frame.phi"), result.final("b.frame.phi")) == expected
    assert result.final("c.frame.phi") == 30.0


class Loop(Component):
    """Ground - bar - bar - ground: three equations too many with plain connections; here one."""

    ground: Ground = Ground()
    bars: list[Bar] = part()
    n: int = structural(default=2)

    def build(self) -> None:
        self.bars = [Bar(angle=1.0) for _ in range(self.n)]

    def equations(self) -> Equations:
        for first, second in zip(self.bars[:-1], self.bars[1:], strict=True):
            yield connect(first.frame_b, second.frame_a)
        yield connect(self.ground.frame, self.bars[0].frame_a)
        yield connect(self.ground.frame, self.bars[-1].frame_b)


@pytest.mark.parametrize("n", [2, 3, 6])
def test_a_loop_is_cut_once(n: int) -> None:
    """The cut is reported with the components around the loop, and its residual is one of the flat equations."""
    flat = acausal.flatten(Loop(n=n))
    assert len(flat.loops) == len(flat.notes) == 1
    assert set(flat.loops[0].components) == {"ground", *(f"bars[{k}]" for k in range(n))}
    # The residual replaces the equality of the cut connection.
    assert len(flat.equations) == len({v.first for v in flat.variables})


@pytest.mark.parametrize("pairs", [("gb", "bg"), ("gb", "bf", "fg")])
def test_connections_said_twice_are_no_loops(pairs: tuple[str, ...]) -> None:
    """Connections in a circle without a component between: g ground, b bar, f free."""

    class Twice(Component):
        ground: Ground = Ground()
        bar: Bar = Bar()
        free: Free = Free()

        def equations(self) -> Equations:
            frames = {"g": self.ground.frame, "b": self.bar.frame_a, "f": self.free.frame}
            for pair in pairs:
                yield connect(frames[pair[0]], frames[pair[1]])

    flat = acausal.flatten(Twice())
    assert not flat.loops
    assert acausal.simulate(Twice()).final("bar.frame_b.phi") == 1.25


def test_an_island_without_root() -> None:
    with fails_with(StructureError, "AC203"):
        acausal.flatten(Bar())


def test_roles_are_not_known_before_the_tree() -> None:
    with fails_with(DeclarationError, "AC122"):
        list(Bar().equations())


class Other(Connector):
    s: Real = variable()
    f: Real = flow()


class TiesPlainConnector(Component):
    flange: Other = Other()
    frame: Frame = Frame()

    def ties(self) -> Equations:
        yield root(self.frame)
        yield branch(self.frame, self.flange)


class TiesForeignFrame(Component):
    frame: Frame = Frame()

    def ties(self) -> Equations:
        yield root(Frame())


class TiesWithEquation(Component):
    frame: Frame = Frame()

    def ties(self) -> Equations:
        yield self.frame.phi == 0.0


class TiesAndConnects(Component):
    frame_a: Frame = Frame()
    frame_b: Frame = Frame()

    def ties(self) -> Equations:
        yield root(self.frame_a)
        yield branch(self.frame_a, self.frame_b)

    def equations(self) -> Equations:
        yield connect(self.frame_a, self.frame_b)


@pytest.mark.parametrize("model", [TiesPlainConnector(), TiesForeignFrame(), TiesWithEquation(), TiesAndConnects()])
def test_wrong_ties(model: Component) -> None:
    with fails_with(AcausalError, "AC130"):
        acausal.flatten(model)
