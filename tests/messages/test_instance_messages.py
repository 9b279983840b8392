"""AC113 to AC119, AC122 and AC127: instances that are made wrongly."""

from __future__ import annotations

from typing import Any

import pytest

from acausal import Component, Equations, Real, connect, parameter, part, structural, variable
from acausal.errors import AcausalError
from acausal.flatten.flatten import flatten
from acausal.language.connections.overconstrained import rooted
from acausal.library import electrical, multibody, translational
from acausal.library.translational import Mass
from tests.messages.cases import Case, Corpus

corpus = Corpus()

# Any: a type checker would refuse most of what follows.
mass: Any = Mass


@corpus.wrong("AC113", "'n'", "chain()")
def structural_without_value() -> None:
    class Chain(Component):
        n: int = structural(doc="Number of links")

    chain: Any = Chain
    chain()


@corpus.wrong("AC114", "'masses'", "Train()", "masses: list[Mass] = part()")
def part_that_was_not_made() -> None:
    class Train(Component):
        engine: Mass = Mass(m=1.0)
        masses: list[Mass] = part()

    Train()


@corpus.wrong("AC114", "'engine'", "self.truck = Mass(m=self.engine.m)")
def part_that_build_reads_too_early() -> None:
    class Train(Component):
        engine: Mass = part()
        truck: Mass = part()

        def build(self) -> None:
            self.truck = Mass(m=self.engine.m)
            self.engine = Mass(m=1.0)

    Train()


@corpus.wrong("AC115", "'n'", "self.link = link(n=self.count)")
def structural_given_a_symbol() -> None:
    class Link(Component):
        n: int = structural(default=1)

    link: Any = Link

    class Chain(Component):
        count: Real = parameter(default=3.0)
        link: Link = part()

        def build(self) -> None:
            self.link = link(n=self.count)

    Chain()


@corpus.wrong("AC116", "'engine'", "self.engine = 3.0")
def part_that_is_no_component() -> None:
    class Train(Component):
        engine: Any = part()

        def build(self) -> None:
            self.engine = 3.0

    Train()


@corpus.wrong("AC116", "'flange_a'", "mass(m=1.0, flange_a=electrical.Pin())")
def connector_of_another_type() -> None:
    mass(m=1.0, flange_a=electrical.Pin())


@corpus.wrong("AC117", "front and rear", "Mass(m=1.0)")
def one_component_in_two_places() -> None:
    class Train(Component):
        front: Mass = part()
        rear: Mass = part()

        def build(self) -> None:
            self.front = Mass(m=1.0)
            self.rear = self.front

    flatten(Train())


@corpus.wrong("AC117", "'engine'", "self.engine = shared", "Mass(m=1.0)")
def one_component_in_two_models() -> None:
    shared = Mass(m=1.0)

    class Train(Component):
        engine: Mass = part()

        def build(self) -> None:
            self.engine = shared

    Train()
    Train()


@corpus.wrong("AC118", "Mass.m", "heavy.m = 2.0")
def attribute_set_after_construction() -> None:
    heavy = Mass(m=1.0)
    heavy.m = 2.0


@corpus.wrong("AC118", "Ramp.equations assigns self.x", "self.x = 3.0")
def assignment_instead_of_an_equation() -> None:
    class Ramp(Component):
        x: Real = variable()

        def equations(self) -> Equations:
            self.x = 3.0
            yield self.x == 1.0

    flatten(Ramp())


@corpus.wrong("AC119", "Train.engine", "self.engine = Mass(m=1.0)")
def part_that_is_not_declared() -> None:
    class Train(Component):
        def build(self) -> None:
            self.engine = Mass(m=1.0)

    Train()


@corpus.wrong("AC122", "frame_a", "rooted(multibody.Body(m=1.0).frame_a)")
def role_of_a_frame_asked_too_early() -> None:
    rooted(multibody.Body(m=1.0).frame_a)


@corpus.wrong("AC127", "'mas'", "mass(mas=1.0)")
def unknown_field_in_a_constructor() -> None:
    mass(mas=1.0)


@corpus.wrong("AC127", "'flange_c'", "connect(mass(m=1.0).flange_c, translational.Fixed().flange)")
def unknown_field_of_a_part() -> None:
    connect(mass(m=1.0).flange_c, translational.Fixed().flange)


@corpus.wrong("AC127", "Mass", "mass(1.0)")
def value_without_a_name() -> None:
    mass(1.0)


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
        part_that_build_reads_too_early()
    assert "`build` reads the part before the line that makes it" in str(caught.value)
    assert "defaults" not in str(caught.value)
