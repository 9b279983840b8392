"""A freewheel that starts the wrong way round is refused."""

from __future__ import annotations

import pytest

import acausal
from acausal import Component, Equations, Real, connect, fixed, parameter, part
from acausal.errors import AcausalError
from acausal.library.blocks import Constant
from acausal.library.rotational import Inertia, OneWayClutch


class Pair(Component):
    """Two free inertias and a freewheel between them."""

    w: Real = parameter(default=1.0, unit="rad/s")
    a: Inertia = Inertia(J=1.0, phi=fixed(0.0), w=fixed(0.0))
    b: Inertia = part()
    clutch: OneWayClutch = OneWayClutch(fn_max=2.0, mu_pos=((0.0, 0.5),))
    pressed: Constant = Constant(k=1.0)

    def build(self) -> None:
        self.b = Inertia(J=0.5, phi=fixed(0.0), w=fixed(self.w))

    def equations(self) -> Equations:
        yield connect(self.pressed.y, self.clutch.f_normalized)
        yield connect(self.a.flange_b, self.clutch.flange_a)
        yield connect(self.clutch.flange_b, self.b.flange_a)


def test_sliding_ends_at_the_common_speed() -> None:
    """Momentum 0.5*1 over 1.5 kg.m2; 1 N.m brings the relative speed to 0 after 1/3 s."""
    result = acausal.simulate(Pair(), stop_time=1.0, tolerance=1e-9)
    assert result.final("a.w") == pytest.approx(1.0 / 3.0, abs=1e-8)
    assert result.events[0].time == pytest.approx(1.0 / 3.0, abs=1e-8)


def test_it_cannot_start_backwards() -> None:
    """w_rel = -1 rad/s went on for ever, as if that were locked."""
    with pytest.raises(AcausalError) as error:
        acausal.simulate(acausal.compile(Pair(), parameters={"w": -1.0}), stop_time=1.0)
    assert error.value.code == "AC503"
    assert "w_rel >= 0" in str(error.value)
    assert "clutch" in str(error.value)
