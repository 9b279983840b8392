"""Contacts that cannot come about are no part of a reduced model, and only those."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, connect, fixed, part, structural
from acausal.library.contact import Box, ContactBody, ContactScene, HuntCrossley, Sphere, Surfaces
from acausal.library.drilling import DrillBody, WorkpieceBody
from acausal.library.multibody import Body, Prismatic, Revolute, World
from acausal.library.multibody.orientation import IDENTITY
from acausal.library.rotational import Speed
from acausal.library.translational import ConstantForce
from acausal.models.contact_scenes import BoxStack

FIRM = Surfaces(law=HuntCrossley(k=1e5, n=1.5, e=1.0, v_0=0.01))


class Rails(Component):
    """Balls of 0.1 m on rails along x without gravity: three in a row, of which the first moves, and one 1 m beside."""

    keep: int = structural(default=12)
    world: World = World(g=0.0)
    rails: list[Prismatic] = part()
    balls: list[Body] = part()
    scene: ContactScene = part()

    def build(self) -> None:
        starts = (0.0, 0.3, 0.6, 0.3)
        self.rails = [Prismatic(n=(1.0, 0.0, 0.0), s=fixed(s), v=fixed(float(k == 0))) for k, s in enumerate(starts)]
        self.balls = [Body(m=1.0) for _ in starts]
        places = [(0.0, float(k == 3), 0.0) for k in range(len(starts))]
        self.scene = ContactScene(
            bodies=(
                *(
                    ContactBody(name=f"ball{k}", shape=Sphere(0.1), pose=(place, IDENTITY))
                    for k, place in enumerate(places)
                ),
                ContactBody(name="wall", shape=Box((4.0, 0.1, 1.0)), pose=((0.0, -1.0, 0.0), IDENTITY), at_rest=True),
            ),
            surfaces=FIRM,
            keep=self.keep,
        )

    def equations(self) -> Equations:
        for k, (rail, ball) in enumerate(zip(self.rails, self.balls, strict=True)):
            yield connect(self.world.frame_b, rail.frame_a)
            yield connect(rail.frame_b, ball.frame_a)
            yield connect(ball.frame_a, self.scene.frame(f"ball{k}"))


@pytest.mark.parametrize("keep", [pytest.param(12, marks=pytest.mark.slow), 2])
def test_what_moves_only_when_it_is_hit_is_hit(keep: int) -> None:
    # balls 1 and 2 rest until ball 0 comes: bounds without contacts would take them for motionless
    # a scene of more pairs than `keep` runs in pieces, which takes longer: compared once is enough
    found = acausal.reduce(Rails(keep=keep), ["rails[2].s"], stop_time=1.0, repeat=1, compare=keep > 2)
    dropped = {left.name: left.why for left in found.dropped if left.kind == "contact"}
    apart = {f"scene: ball{k} - wall" for k in range(4)} | {f"scene: ball{k} - ball3" for k in range(3)}
    assert apart == dropped.keys()
    assert all("can never meet" in why for why in dropped.values())
    moving = {n for n in found.compiled.states if n.startswith("rails")}
    assert moving == {f"rails[{k}].{q}" for k in range(3) for q in ("s", "v")}
    # central impacts of equal masses hand the velocity on, up to what springs take of time
    result = acausal.simulate(found.compiled, stop_time=1.0)
    assert result.final("rails[2].s") > 1.1
    if found.comparison is not None:
        assert found.comparison.errors[0].absolute < 1e-6


def test_the_model_is_as_it_was_afterwards() -> None:
    model = Rails()
    full = acausal.compile(model)
    acausal.compile(model, outputs=["rails[0].s"])
    assert acausal.compile(model).states == full.states
    assert len(model.scene.report().kept) == 10


def test_contacts_behind_one_that_was_left_out_keep_their_names() -> None:
    model = Rails()
    kept = [names[:2] for names in model.scene.report().kept]
    k = kept.index(("ball1", "ball2"))
    compiled = acausal.compile(model, outputs=[f"scene.contacts[{k}].F_N"])
    full = acausal.simulate(Rails(), stop_time=1.0)
    reduced = acausal.simulate(compiled, stop_time=1.0)
    name = f"scene.contacts[{k}].F_N"
    largest = float(full[name].max())
    assert largest > 10.0
    for t in np.linspace(0.0, 1.0, 7):
        assert reduced.at(float(t), name) == pytest.approx(full.at(float(t), name), abs=1e-3 * largest)


@pytest.mark.slow
def test_a_scene_in_pieces_becomes_one_model() -> None:
    names = ["boxes[0].r_0[2]", "scene.contacts[ground,box0].F_N"]
    found = acausal.reduce(BoxStack(n=2), names, stop_time=0.05, repeat=1)
    assert found.outputs == ("boxes[0].r_0[2]", "scene.contacts[0].F_N")
    assert found.comparison is not None
    assert found.comparison.failed is None
    assert found.comparison.errors[0].absolute < 1e-7
    assert found.comparison.errors[1].relative < 1e-2


class OneHole(Component):
    """A drill on a rail over the first of three plates that stand in a row."""

    world: World = World(g=0.0)
    slide: Prismatic = Prismatic(n=(0.0, 0.0, 1.0), s=fixed(-1e-4), v=fixed(0.0))
    spindle: Revolute = Revolute(n=(0.0, 0.0, 1.0), phi=fixed(0.0))
    drill: Body = Body(m=5.0)
    force: ConstantForce = ConstantForce(f_constant=1500.0)
    speed: Speed = Speed(w_ref=2 * math.pi * 9.28)
    scene: ContactScene = part()

    def build(self) -> None:
        plates = (
            WorkpieceBody(
                name=f"plate{k}", shape=Box((0.1, 0.1, 0.05)), pose=((0.12 * k, 0.0, 0.025), IDENTITY), at_rest=True
            )
            for k in range(3)
        )
        self.scene = ContactScene(bodies=(DrillBody(name="drill"), *plates))

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a)
        yield connect(self.slide.frame_b, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.drill.frame_a)
        yield connect(self.drill.frame_a, self.scene.frame("drill"))
        yield connect(self.force.flange, self.slide.axis)
        yield connect(self.speed.flange, self.spindle.axis)


@pytest.mark.slow
def test_a_drill_that_moves_along_its_axis_leaves_one_hole() -> None:
    # the drill may wander by its declaration; on this rail it cannot, and never comes to the other plates
    found = acausal.reduce(OneHole(), ["slide.s"], freeze=["zeros"], stop_time=1.0, repeat=1)
    dropped = {left.name for left in found.dropped if left.kind == "contact"}
    assert {"scene: drill - plate1", "scene: drill - plate2"} <= dropped
    assert "scene: drill - plate0" not in dropped
    assert found.comparison is not None
    assert found.comparison.failed is None
    assert found.comparison.errors[0].absolute < 1e-7
