"""Every component of the multibody library: dimensions, local balance in each role, documentation."""

from __future__ import annotations

import inspect
import math
from itertools import product
from typing import Any

import pytest

from acausal import Component, Connector, flatten
from acausal.errors import DeclarationError
from acausal.language.connections.overconstrained import Branch, Root
from acausal.language.declarations.declaration import Kind
from acausal.language.events import Assertion
from acausal.language.expressions.dimensions import check_dimensions
from acausal.library import multibody
from acausal.library.multibody import Frame, Prismatic, Revolute
from acausal.models.double_pendulum import DoublePendulum
from acausal.models.pendulum import Pendulum
from acausal.models.pendulum_chain import PendulumChain
from tests.expected import fails_with

COMPOSED = ("Universal", "GearConstraint")
LEAVES = [
    cls
    for name, cls in vars(multibody).items()
    if inspect.isclass(cls) and issubclass(cls, Component) and not issubclass(cls, Connector) and name not in COMPOSED
]
GIVEN = {"width_direction": (0.0, 0.0, 1.0)}


def made(cls: type[Component], rooted: bool, is_root: bool) -> Component:
    """An instance in a role: nearer to the root by frame_a or by frame_b; a root itself or not."""
    given: dict[str, Any] = {k: v for k, v in GIVEN.items() if k in cls._declarations}
    given |= {n: 1.0 for n, d in cls._declarations.items() if d.kind is Kind.PARAMETER and d.default is None}
    component = cls(**given)
    for name, member in component._parts.items():
        if isinstance(member, Frame):
            member.__dict__["_roles"] = {"is_root": is_root, "rooted": rooted == (name == "frame_a")}
    component.__dict__.update(dict.fromkeys(cls._outers, multibody.World()))
    return component


def stated(component: Component, generator: str) -> list[Any]:
    return [
        item
        for base in reversed(type(component).__mro__)
        if generator in base.__dict__
        for item in base.__dict__[generator](component)
        if not isinstance(item, Assertion)
    ]


ROLES = list(product((True, False), repeat=2))
leaves = pytest.mark.parametrize("cls", LEAVES, ids=lambda cls: cls.__name__)


@leaves
def test_dimensions_agree(cls: type[Component]) -> None:
    for role in ROLES:
        for equation in stated(made(cls, *role), "equations"):
            check_dimensions(equation, ())


@leaves
def test_local_balance(cls: type[Component]) -> None:
    """As many equations as own unknowns and flows (Modelica 3.6, section 4.8), where an orientation counts three.

    A component that defines an orientation states twelve equations for `R` and `w`: nine more than three.
    """
    for rooted, is_root in ROLES:
        component = made(cls, rooted, is_root)
        ties = stated(component, "ties")
        certain = sum(isinstance(tie, Root | Branch) for tie in ties)
        potential = len(ties) - certain
        expected = 9 * (certain + (potential if is_root else 0))
        for name, declaration in cls._declarations.items():
            if declaration.kind is Kind.PART:
                inner = getattr(component, name)._declarations.values()
                expected += sum(math.prod(d.shape) for d in inner if d.kind is Kind.FLOW)
            elif declaration.kind in (Kind.VARIABLE, Kind.OUTPUT):
                expected += math.prod(declaration.shape)
        equations = stated(component, "equations")
        assert sum(math.prod(e.left.shape or e.right.shape) for e in equations) == expected, (rooted, is_root)


@leaves
def test_every_declaration_says_what_it_is(cls: type[Component]) -> None:
    assert cls.__doc__
    for name, declaration in cls._declarations.items():
        assert declaration.doc, name
        if declaration.kind not in (Kind.STRUCTURAL, Kind.PART):
            assert declaration.unit, name


@pytest.mark.parametrize("joint", [Revolute, Prismatic])
def test_an_axis_without_direction_is_refused(joint: type[Component]) -> None:
    with fails_with(DeclarationError, "AC130", match=r"n = \(0.0, 0.0, 0.0\) does not define a direction"):
        joint(n=(0.0, 0.0, 0.0))


@pytest.mark.parametrize("model", [Pendulum, DoublePendulum, PendulumChain, lambda: PendulumChain(n=1)])
def test_models_have_as_many_equations_as_unknowns(model: Any) -> None:
    system = flatten(model())
    assert len(system.equations) == system.n_scalars


def test_unknowns_of_a_link_stay_few() -> None:
    """The chain is what growth is measured on: 87 scalars per link and joint before any elimination."""
    sizes = [flatten(PendulumChain(n=n)).n_scalars for n in (4, 5)]
    assert sizes[1] - sizes[0] <= 81
