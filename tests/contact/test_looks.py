"""Looks at pairs become rare while nothing comes nearer: a ball that arrives late is found all the same."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, der, fixed, parameter, part, quantity, variable
from acausal.library.contact import ContactBody, ContactScene, HuntCrossley, Sphere, Surfaces
from acausal.library.multibody import Body, World
from acausal.simulate.restructure.structures import Watch

RADIUS, M, SPEED = 0.05, 1.0, 4.0


class Row(Component):
    """Balls in a row without gravity, the first of which is shot at the others; one more flies beside it."""

    speed: Real = parameter(default=SPEED, unit="m/s")
    world: World = World(g=0.0)
    balls: list[Body] = part()
    scene: ContactScene = part()

    def build(self) -> None:
        inertia = 0.4 * M * RADIUS**2
        places = [(0.0, 0.0), (1.0, 0.0), (1.6, 0.0), (0.0, 0.3)]
        self.balls = [
            Body(
                m=M,
                I_11=inertia,
                I_22=inertia,
                I_33=inertia,
                r_0=fixed((x, y, 0.0)),
                v_0=fixed((self.speed if x == 0.0 else 0.0, 0.0, 0.0)),
                Q=fixed((0.0, 0.0, 0.0, 1.0)),
                w_a=fixed((0.0, 0.0, 0.0)),
            )
            for x, y in places
        ]
        bodies = tuple(ContactBody(name=f"ball{k}", shape=Sphere(RADIUS)) for k in range(len(places)))
        surfaces = Surfaces(law=HuntCrossley(k=1e6, n=1.5, e=1.0, v_0=0.5))
        self.scene = ContactScene(bodies=bodies, surfaces=surfaces, skin=0.02, keep=0)

    def equations(self) -> Equations:
        for k, ball in enumerate(self.balls):
            yield connect(ball.frame_a, self.scene.frame(f"ball{k}"))


def test_a_ball_that_arrives_late_hands_on_its_speed() -> None:
    """Equal elastic balls exchange their velocities: (1.6 - 4 RADIUS)/SPEED = 0.35 s until the last one moves."""
    result = acausal.simulate(Row(), stop_time=0.4, tolerance=1e-7, output_interval=1e-3)
    last = [float(result[f"balls[{k}].v_0[0]"][-1]) for k in range(4)]
    assert last == pytest.approx([0.0, 0.0, SPEED, SPEED], abs=1e-4)
    time, x = np.asarray(result.time), np.asarray(result["balls[2].r_0[0]"])
    # rows are 1 ms apart, and the two contacts take some of them
    assert 0.349 <= time[np.argmax(x > 1.6 + 1e-6)] <= 0.357


class Sliding(Component):
    """What moves, what is the same mirrored, and what stays at a place that is a parameter."""

    place: Real = parameter(default=1.0, unit="m")
    x: Real = variable(default=fixed(0.0), unit="m")
    mirrored: Real = variable(unit="m")
    still: Real = variable(unit="m")

    def equations(self) -> Equations:
        yield der(self.x) == quantity(1.0, "m/s")
        yield self.mirrored == -self.x
        yield self.still == self.place


def test_a_look_reads_what_the_result_says() -> None:
    """Where signals are is kept for a compiled model; what does not move has another value in each run of it."""
    compiled = acausal.compile(Sliding())
    names = "mirrored", "still", "x"
    watch = Watch.of(compiled, {"": names})
    for place in (1.0, 3.0):
        result = acausal.simulate(compiled, stop_time=1.0, parameters={"place": place})
        found = watch.read(result)[""]
        assert found["still"] == pytest.approx(np.full(len(result.time), place))
        for name in names:
            assert np.array_equal(found[name], result[name])
