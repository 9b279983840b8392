"""AC112 and AC123 to AC126: classes that are declared wrongly."""

from __future__ import annotations

import pytest

from tests.messages.cases import Case, Corpus

corpus = Corpus()


corpus.table(
    """
field_without_annotation AC112 Tank.level
class Tank(Component):
    area: Real = parameter(unit="m2")
>     level = variable(unit="m")

field_without_declaration AC112 Tank.level
class Tank(Component):
>     level: Real

connector_with_a_parameter AC123 Port: 'area'
class Port(Connector):
    p: Real = variable(unit="Pa")
    q: Real = flow(unit="m3/s")
>     area: Real = parameter(unit="m2")

unbalanced_connector AC124 Port
> class Port(Connector):
    p: Real = variable(unit="Pa")
    T: Real = variable(unit="K")
    q: Real = flow(unit="m3/s")

reserved_name AC125 Tank.equations
class Tank(Component):
>     equations: Real = variable()

name_of_the_time AC125 Tank.time
# `result["time"]` would be the time of the run.
class Tank(Component):
>     time: Real = variable()

name_with_an_underscore AC125 Tank._level
class Tank(Component):
>     _level: Real = variable()

field_declared_again AC126 Engine.m
class Engine(translational.Mass):
>     m: Real = parameter(default=1.0)
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
