"""AC112 and AC123 to AC126: classes that are declared wrongly."""

from __future__ import annotations

import pytest

from acausal import Component, Connector, Real, flow, parameter, variable
from acausal.library.translational import Mass
from tests.messages.cases import Case, Corpus

corpus = Corpus()


@corpus.wrong(
    "AC112",
    "Tank.level",
    """
error[AC112]: Tank.level has no annotation
  at      test_declaration_messages.py:N
              level = variable(unit="m")
  help    level: Real = ...
""",
)
def field_without_annotation() -> None:
    class Tank(Component):
        area: Real = parameter(unit="m2")
        level = variable(unit="m")


@corpus.wrong(
    "AC112",
    "Tank.level",
    """
error[AC112]: Tank.level is annotated but not declared
  at      test_declaration_messages.py:N
              level: Real
  help    level: Real = variable(...), or ClassVar[...] for what is no field
""",
)
def field_without_declaration() -> None:
    class Tank(Component):
        level: Real


@corpus.wrong(
    "AC123",
    "Port: 'area'",
    """
error[AC123]: connector Port: 'area' is a parameter
  at      test_declaration_messages.py:N
              area: Real = parameter(unit="m2")
  help    a connector holds variable(...) and flow(...); everything else belongs to the component
""",
)
def connector_with_a_parameter() -> None:
    class Port(Connector):
        p: Real = variable(unit="Pa")
        q: Real = flow(unit="m3/s")
        area: Real = parameter(unit="m2")


@corpus.wrong(
    "AC124",
    "Port",
    """
error[AC124]: connector Port has 2 potentials and 1 flow
  at      test_declaration_messages.py:N
              class Port(Connector):
          variable: p, T
          flow: q
  help    a connector needs one flow for every potential; use signal_input and signal_output for signals
""",
)
def unbalanced_connector() -> None:
    class Port(Connector):
        p: Real = variable(unit="Pa")
        T: Real = variable(unit="K")
        q: Real = flow(unit="m3/s")


@corpus.wrong(
    "AC125",
    "Tank.equations",
    """
error[AC125]: Tank.equations: a field cannot have this name
  at      test_declaration_messages.py:N
              equations: Real = variable()
  cause   `equations` is a method of components
  help    choose another name
""",
)
def reserved_name() -> None:
    class Tank(Component):
        equations: Real = variable()


@corpus.wrong(
    "AC125",
    "Tank._level",
    """
error[AC125]: Tank._level: a field cannot have this name
  at      test_declaration_messages.py:N
              _level: Real = variable()
  cause   names with _ in front are no fields
  help    choose another name
""",
)
def name_with_an_underscore() -> None:
    class Tank(Component):
        _level: Real = variable()


@corpus.wrong(
    "AC126",
    "Engine.m",
    """
error[AC126]: Engine.m is declared again: Mass has it already
  at      test_declaration_messages.py:N
              m: Real = parameter(default=1.0)
  help    choose another name; a value is given where a part is made: Engine(m=...)
""",
)
def field_declared_again() -> None:
    class Engine(Mass):
        m: Real = parameter(default=1.0)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
