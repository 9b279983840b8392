"""AC113 to AC119, AC122 and AC127: instances that are made wrongly."""

from __future__ import annotations

from typing import Any

import pytest

from acausal import Component, Equations, Real, connect, parameter, part, structural, variable
from acausal.flatten.flatten import flatten
from acausal.language.overconstrained import rooted
from acausal.library import electrical, multibody, translational
from acausal.library.translational import Mass
from tests.messages.cases import Case, Corpus

corpus = Corpus()

# Any: a type checker would refuse most of what follows.
mass: Any = Mass


@corpus.wrong(
    "AC113",
    "'n'",
    """
error[AC113]: Chain: structural 'n' needs a value
  at      test_instance_messages.py:N
              chain()
  cause   Number of links
  help    Chain(n=...)
""",
)
def structural_without_value() -> None:
    class Chain(Component):
        n: int = structural(doc="Number of links")

    chain: Any = Chain
    chain()


@corpus.wrong(
    "AC114",
    "'masses'",
    """
error[AC114]: Train: part 'masses' was not made
  at      test_instance_messages.py:N
              Train()
  at      test_instance_messages.py:N
              masses: list[Mass] = part()
  help    make it in `build`: self.masses = [Mass(...), ...]
""",
)
def part_that_was_not_made() -> None:
    class Train(Component):
        engine: Mass = part()
        masses: list[Mass] = part()

        def build(self) -> None:
            self.engine = Mass(m=1.0)

    Train()


@corpus.wrong(
    "AC115",
    "'n'",
    """
error[AC115]: Link: 'n' is structural and cannot be the symbol `count`
  at      test_instance_messages.py:N
              self.link = link(n=self.count)
  help    give a Python value, or declare the source structural too
""",
)
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


@corpus.wrong(
    "AC116",
    "'engine'",
    """
error[AC116]: Train: part 'engine' cannot be 3.0 (float)
  at      test_instance_messages.py:N
              self.engine = 3.0
  help    it takes Any(...)
""",
)
def part_that_is_no_component() -> None:
    class Train(Component):
        engine: Any = part()

        def build(self) -> None:
            self.engine = 3.0

    Train()


@corpus.wrong(
    "AC116",
    "'flange_a'",
    """
error[AC116]: Mass: 'flange_a' must be a Flange, not a Pin
  at      test_instance_messages.py:N
              mass(m=1.0, flange_a=electrical.Pin())
  help    a connector is declared in the class; it need not be given
""",
)
def connector_of_another_type() -> None:
    mass(m=1.0, flange_a=electrical.Pin())


@corpus.wrong(
    "AC117",
    "front and rear",
    """
error[AC117]: the same Mass is both front and rear
  at      test_instance_messages.py:N
              self.front = Mass(m=1.0)
                           ^^^^^^^^^^^
  help    make one component per place
""",
)
def one_component_in_two_places() -> None:
    class Train(Component):
        front: Mass = part()
        rear: Mass = part()

        def build(self) -> None:
            self.front = Mass(m=1.0)
            self.rear = self.front

    flatten(Train())


@corpus.wrong(
    "AC117",
    "'engine'",
    """
error[AC117]: Train: the Mass given for 'engine' is already 'engine' of Train
  at      test_instance_messages.py:N
              self.engine = shared
  at      test_instance_messages.py:N
              shared = Mass(m=1.0)
                       ^^^^^^^^^^^
  help    make one component per place: call its class in `build`
""",
)
def one_component_in_two_models() -> None:
    shared = Mass(m=1.0)

    class Train(Component):
        engine: Mass = part()

        def build(self) -> None:
            self.engine = shared

    Train()
    Train()


@corpus.wrong(
    "AC118",
    "Mass.m",
    """
error[AC118]: Mass.m cannot be set after construction
  at      test_instance_messages.py:N
              heavy.m = 2.0
  help    a value is given where it is made: Mass(m=...); an equation is yielded: yield self.m == ...
""",
)
def attribute_set_after_construction() -> None:
    heavy = Mass(m=1.0)
    heavy.m = 2.0


@corpus.wrong(
    "AC118",
    "Ramp.x",
    """
error[AC118]: Ramp.x cannot be set after construction
  at      test_instance_messages.py:N
              self.x = 3.0
  help    a value is given where it is made: Ramp(x=...); an equation is yielded: yield self.x == ...
""",
)
def assignment_instead_of_an_equation() -> None:
    class Ramp(Component):
        x: Real = variable()

        def equations(self) -> Equations:
            self.x = 3.0
            yield self.x == 1.0

    flatten(Ramp())


@corpus.wrong(
    "AC119",
    "Train.engine",
    """
error[AC119]: Train.engine is not declared
  at      test_instance_messages.py:N
              self.engine = Mass(m=1.0)
  help    write `engine: Mass = part()` in the class body
""",
)
def part_that_is_not_declared() -> None:
    class Train(Component):
        def build(self) -> None:
            self.engine = Mass(m=1.0)

    Train()


@corpus.wrong(
    "AC122",
    "frame_a",
    """
error[AC122]: the place of frame_a in the tree of frames is not known yet
  at      test_instance_messages.py:N
              rooted(multibody.Body(m=1.0).frame_a)
  help    ask rooted() and is_root() inside equations(), and declare branch(), root() in ties()
""",
)
def role_of_a_frame_asked_too_early() -> None:
    rooted(multibody.Body(m=1.0).frame_a)


@corpus.wrong(
    "AC127",
    "'mas'",
    """
error[AC127]: Mass has no field 'mas'
  at      test_instance_messages.py:N
              mass(mas=1.0)
          fields: flange_a, flange_b, L, s, m, v, a
""",
)
def unknown_field_in_a_constructor() -> None:
    mass(mas=1.0)


@corpus.wrong(
    "AC127",
    "'flange_c'",
    """
error[AC127]: Mass has no field 'flange_c'; did you mean 'flange_b'?
  at      test_instance_messages.py:N
              connect(mass(m=1.0).flange_c, translational.Fixed().flange)
          fields: flange_a, flange_b, L, s, m, v, a
""",
)
def unknown_field_of_a_part() -> None:
    connect(mass(m=1.0).flange_c, translational.Fixed().flange)


@corpus.wrong(
    "AC127",
    "Mass",
    """
error[AC127]: Mass takes its fields by name
  at      test_instance_messages.py:N
              mass(1.0)
          fields: flange_a, flange_b, L, s, m, v, a
  help    Mass(L=...)
""",
)
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
