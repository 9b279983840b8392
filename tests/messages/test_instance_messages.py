"""AC113 to AC119, AC122 and AC127: instances that are made wrongly."""

from __future__ import annotations

from typing import Any

import pytest

from acausal import Component, part
from acausal.errors import AcausalError
from acausal.library.translational import Mass
from tests.messages.cases import Case, Corpus

corpus = Corpus()

# Any: a type checker would refuse most of what follows.
mass: Any = Mass


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


corpus.table(
    """
AC116 'flange_a' -- mass(m=1.0, flange_a=electrical.Pin())
AC122 frame_a -- rooted(multibody.Body(m=1.0).frame_a)
AC127 'mas' -- mass(mas=1.0)
AC127 'flange_c' -- connect(mass(m=1.0).flange_c, translational.Fixed().flange)
AC127 Mass -- mass(1.0)

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
