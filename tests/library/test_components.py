"""Every component of the 1D libraries: declared with units, dimensionally right, and locally balanced."""

from __future__ import annotations

import inspect
import math
from typing import Any

import pytest

from acausal import Component, Connector
from acausal.language.declarations.declaration import Kind
from acausal.language.expressions.dimensions import check_dimensions
from acausal.language.expressions.expression import Equation, assigned
from acausal.library import blocks, electrical, rotational, thermal, translational

TABLES: dict[str, Any] = {
    "TimeTable": ((0.0, 0.0), (1.0, 2.0), (1.0, 3.0), (2.0, 3.0)),
    "CombiTable1D": ((0.0, 0.0), (1.0, 2.0), (2.0, 3.0)),
    "BooleanTable": (1.0, 2.0, 3.0),
}


def _leaves() -> list[Any]:
    found = []
    for library in (blocks, translational, rotational, electrical, thermal):
        for name, cls in vars(library).items():
            if inspect.isclass(cls) and issubclass(cls, Component) and not name.startswith("Partial"):
                if issubclass(cls, Connector):
                    continue
                found.append(pytest.param(cls, id=f"{library.__name__.rsplit('.', 1)[-1]}.{name}"))
    return found


def _made(cls: type[Component]) -> Component:
    """An instance with 1.0 for every parameter that needs a value."""
    given: dict[str, Any] = {
        name: 1.0 for name, d in cls._declarations.items() if d.kind is Kind.PARAMETER and d.default is None
    }
    if cls.__name__ in TABLES:
        given["table"] = TABLES[cls.__name__]
    if cls is rotational.LossyGear:
        given["lossTable"] = ((0.0, 0.9, 0.8, 0.5, 0.6), (10.0, 0.95, 0.9, 0.6, 0.7))
    return cls(**given)


def _equations(component: Component) -> list[Equation]:
    return [
        equation
        for base in reversed(type(component).__mro__)
        if "equations" in base.__dict__
        for equation in base.__dict__["equations"](component)
        if isinstance(equation, Equation)
    ]


def check_dimensions_of_equations(cls: type[Component]) -> None:
    for equation in _equations(_made(cls)):
        check_dimensions(equation, ())


def check_as_many_equations_as_own_unknowns_and_flows(cls: type[Component]) -> None:
    """Local balance, Modelica specification 3.6 section 4.8: connections bring one equation for each potential.

    Discrete variables are apart: they have an equation each at most, and `when`s may reset the others.
    """
    component = _made(cls)
    size = {Kind.VARIABLE: 0, Kind.OUTPUT: 0, Kind.FLOW: 0}
    for name, declaration in cls._declarations.items():
        if declaration.kind is Kind.PART:
            own = getattr(component, name)
            for inner in own if isinstance(own, list) else [own]:
                flows = (d for d in inner._declarations.values() if d.kind is Kind.FLOW)
                size[Kind.FLOW] += sum(math.prod(d.shape) for d in flows)
                if not isinstance(inner, Connector) and not _equations(inner):  # a holder of variables
                    held = (d for d in inner._declarations.values() if d.kind is Kind.VARIABLE)
                    size[Kind.VARIABLE] += sum(math.prod(d.shape) for d in held)
        elif declaration.kind in size and not declaration.discrete:
            size[declaration.kind] += math.prod(declaration.shape)
    continuous = [e for e in _equations(component) if assigned(e) is None]
    assert sum(math.prod(e.left.shape or e.right.shape) for e in continuous) == sum(size.values())
    names = [a.name for e in _equations(component) if (a := assigned(e)) is not None]
    assert len(names) == len(set(names))


def check_every_declaration_says_what_it_is(cls: type[Component]) -> None:
    assert cls.__doc__
    physical = cls.__module__.split(".")[2] != "blocks"
    for name, declaration in cls._declarations.items():
        assert declaration.doc, name
        if physical and declaration.kind not in (Kind.STRUCTURAL, Kind.PART) and not declaration.discrete:
            assert declaration.unit, name


@pytest.mark.parametrize("cls", _leaves())
def test_a_component_is_declared_balanced_and_right_in_its_dimensions(cls: type[Component]) -> None:
    check_every_declaration_says_what_it_is(cls)
    check_as_many_equations_as_own_unknowns_and_flows(cls)
    check_dimensions_of_equations(cls)


def test_hints_tell_what_may_be_missing() -> None:
    for connector in (translational.Flange, rotational.Flange, electrical.Pin):
        assert all(d.hint for d in connector._declarations.values())
    assert "Ground" in electrical.Pin._declarations["v"].hint
