"""AC112 and AC123 to AC126: classes that are declared wrongly."""

from __future__ import annotations

import pytest

from acausal import Component, Connector, Real, flow, parameter, variable
from acausal.library.translational import Mass
from tests.messages.cases import Case, Corpus

corpus = Corpus()


@corpus.wrong("AC112", "Tank.level", 'level = variable(unit="m")')
def field_without_annotation() -> None:
    class Tank(Component):
        area: Real = parameter(unit="m2")
        level = variable(unit="m")


@corpus.wrong("AC112", "Tank.level", "level: Real")
def field_without_declaration() -> None:
    class Tank(Component):
        level: Real


@corpus.wrong("AC123", "Port: 'area'", 'area: Real = parameter(unit="m2")')
def connector_with_a_parameter() -> None:
    class Port(Connector):
        p: Real = variable(unit="Pa")
        q: Real = flow(unit="m3/s")
        area: Real = parameter(unit="m2")


@corpus.wrong("AC124", "Port", "class Port(Connector):")
def unbalanced_connector() -> None:
    class Port(Connector):
        p: Real = variable(unit="Pa")
        T: Real = variable(unit="K")
        q: Real = flow(unit="m3/s")


@corpus.wrong("AC125", "Tank.equations", "equations: Real = variable()")
def reserved_name() -> None:
    class Tank(Component):
        equations: Real = variable()


@corpus.wrong("AC125", "Tank.time", "time: Real = variable()")
def name_of_the_time() -> None:
    """`result["time"]` would be the time of the run."""

    class Tank(Component):
        time: Real = variable()


@corpus.wrong("AC125", "Tank._level", "_level: Real = variable()")
def name_with_an_underscore() -> None:
    class Tank(Component):
        _level: Real = variable()


@corpus.wrong("AC126", "Engine.m", "m: Real = parameter(default=1.0)")
def field_declared_again() -> None:
    class Engine(Mass):
        m: Real = parameter(default=1.0)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
