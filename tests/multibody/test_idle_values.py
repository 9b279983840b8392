"""Values that have no effect are refused."""

from __future__ import annotations

from typing import Any

import pytest

import acausal
from acausal import Component, fixed, part, structural
from acausal.errors import DeclarationError
from acausal.library.multibody import Body, World
from acausal.library.multibody.gravity import point_field
from tests.expected import fails_with

G_0 = (0.0, 0.0, -9.81)


class Falling(Component):
    given: dict[str, Any] = structural()
    world: World = part()
    body: Body = Body(m=1.0, r_0=fixed((7e6, 0.0, 0.0)), v_0=fixed((0.0, 0.0, 0.0)))

    def build(self) -> None:
        self.world = World(**self.given)


@pytest.mark.parametrize(
    ("given", "idle"),
    [
        ({"g": 5.0, "g_0": G_0}, "g is given, but has no effect beside g_0"),
        ({"n": (0.0, 0.0, -1.0), "g_0": G_0}, "n is given, but has no effect beside g_0"),
        ({"gravity": point_field(4e14), "g": 3.0}, "g is given, but has no effect in the field of a point mass"),
        ({"gravity": point_field(4e14), "n": (1.0, 0.0, 0.0)}, "n is given, but has no effect in the field"),
        ({"gravity": point_field(4e14), "g_0": G_0}, "g_0 is given, but has no effect in the field of a point mass"),
    ],
)
def test_a_world_refuses_what_its_gravity_does_not_use(given: dict[str, Any], idle: str) -> None:
    with fails_with(DeclarationError, "AC130", idle):
        acausal.compile(Falling(given=given))
