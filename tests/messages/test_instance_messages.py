"""Classes, instances and values of parameters that are wrong: AC112 to AC119, AC122 to AC127, AC133 to AC136, AC15x."""

from __future__ import annotations

import pytest

from acausal import (
    Component,
    Real,
    parameter,
    part,
)
from acausal.errors import AcausalError
from acausal.library.translational import Mass
from tests.messages.cases import Case, Corpus

corpus = Corpus()


@corpus.wrong("AC114", "'masses'", "Train()", "masses: list[Mass] = part()")
def part_that_was_not_made() -> None:
    class Train(Component):
        engine: Mass = Mass(m=1.0)
        masses: list[Mass] = part()

    Train()


@corpus.wrong("AC117", "'engine'", "self.engine = shared", "Mass(m=1.0)")
def one_component_in_two_models() -> None:
    shared = Mass(m=1.0)

    class Train(Component):
        engine: Mass = part()

        def build(self) -> None:
            self.engine = shared

    Train()
    Train()


class Two(Component):
    """Two masses and what subclasses do with them."""

    left: Mass = Mass(m=1.0)
    right: Mass = Mass(m=1.0)


@corpus.broken(
    "AC134",
    "mass.m -> mass.density -> mass.m",
    "m: Real = parameter(default=lambda self: 2.0 * self.density)",
    "density: Real = parameter(default=lambda self: self.m / 2.0)",
)
class BoundInACircle(Component):
    class Ball(Component):
        m: Real = parameter(default=lambda self: 2.0 * self.density)
        density: Real = parameter(default=lambda self: self.m / 2.0)

    mass: Ball = part()

    def build(self) -> None:
        self.mass = self.Ball()


corpus.table(
    """
AC116 'flange_a' -- Mass(m=1.0, flange_a=electrical.Pin())
AC122 frame_a -- rooted(multibody.Body(m=1.0).frame_a)
AC127 'mas' -- Mass(mas=1.0)
AC127 'flange_c' -- connect(Mass(m=1.0).flange_c, translational.Fixed().flange)
AC127 Mass -- Mass(1.0)
AC150 furlong -- variable(unit="furlongg/s")
AC153 'mm' -- variable(unit="mm")

structural_without_value AC113 'n'
class Chain(Component):
    n: int = structural(doc="Number of links")
chain: Any = Chain
> chain()

part_that_build_reads_too_early AC114 'engine'
class Train(Component):
    engine: Mass = part()
    truck: Mass = part()
    def build(self) -> None:
>         self.truck = Mass(m=self.engine.m)
        self.engine = Mass(m=1.0)
Train()

structural_given_a_symbol AC115 'n'
class Link(Component):
    n: int = structural(default=1)
link: Any = Link
class Chain(Component):
    count: Real = parameter(default=3.0)
    link: Link = part()
    def build(self) -> None:
>         self.link = link(n=self.count)
Chain()

part_that_is_no_component AC116 'engine'
class Train(Component):
    engine: Any = part()
    def build(self) -> None:
>         self.engine = 3.0
Train()

one_component_in_two_places AC117 front and rear
class Train(Component):
    front: Mass = part()
    rear: Mass = part()
    def build(self) -> None:
        self.front = <<Mass(m=1.0)>>
        self.rear = self.front
acausal.flatten(Train())

attribute_set_after_construction AC118 Mass.m
heavy = Mass(m=1.0)
> heavy.m = 2.0

assignment_instead_of_an_equation AC118 Ramp.equations assigns self.x
class Ramp(Component):
    x: Real = variable()
    def equations(self) -> Equations:
>         self.x = 3.0
        yield self.x == 1.0
acausal.flatten(Ramp())

part_that_is_not_declared AC119 Train.engine
class Train(Component):
    def build(self) -> None:
>         self.engine = Mass(m=1.0)
Train()

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

MissingValue(Two) AC133 left.m
build: self.left = <<Mass()>>
build: self.right = Mass(m=1.0)

MissingValues AC133 a.c, a.d
a: translational.SpringDamper = <<translational.SpringDamper()>>

ParameterThatVaries AC135 left.m
x: Real = variable(unit="kg")
left: Mass = part()
build: self.left = <<Mass(m=self.x)>>
yield self.x == 1.0

OutsideItsLimits(Two) AC136 left.m
build: self.left = <<Mass(m=-1.0)>>
build: self.right = Mass(m=1.0)

PositionIsVelocity(Two) AC155 left.s == left.v
> yield self.left.s == self.left.v

SumOfDifferentUnits(Two) AC155 left.s + left.v
x: Real = variable(unit="m")
> yield self.x == self.left.s + self.left.v

SineOfALength(Two) AC155 sin(left.s)
x: Real = variable(unit="1")
> yield self.x == sin(self.left.s)
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()


def test_a_list_of_parts_can_grow_in_build() -> None:
    """What is appended to the list after it was set belongs to the owner like everything else."""

    class Train(Component):
        masses: list[Mass] = part()

        def build(self) -> None:
            self.masses = []
            for _ in range(2):
                self.masses.append(Mass(m=1.0))

    assert str(Train().masses[1].s) == "masses[1].s"


def test_a_part_that_build_reads_too_early_is_no_matter_of_defaults() -> None:
    with pytest.raises(AcausalError) as caught:
        corpus["part_that_build_reads_too_early"].run()
    assert "`build` reads the part before the line that makes it" in str(caught.value)
    assert "defaults" not in str(caught.value)
