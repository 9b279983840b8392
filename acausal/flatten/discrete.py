"""Discrete equations of a flat system, and the check that each discrete variable is determined exactly once."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from acausal.errors import DeclarationError
from acausal.flatten.flat import FlatAssert, FlatAssignment, FlatEquation, FlatStart, FlatWhen, suffix, suffixes
from acausal.flatten.instances.instances import Instance
from acausal.flatten.instances.statements import Statement
from acausal.flatten.pool import Pool
from acausal.flatten.scalars.scalarise import Resolve, Scalars, scalars, sides
from acausal.language.declarations.declaration import Declaration, Kind
from acausal.language.events import Assertion
from acausal.language.expressions.expression import Equation, assigned
from acausal.language.statement import Origin

Place = tuple[Instance, str, Declaration, int]
"""Declaration of a discrete scalar: component, name, declaration and index of the entry."""


def assignments(pool: Pool, instance: Instance, items: Sequence[Statement], resolve: Resolve) -> list[FlatAssignment]:
    """Discrete equations among the statements of a component."""
    done: dict[int, Scalars] = {}
    return [
        FlatAssignment(int(pool.nodes[left][1]), right, origin, instance.path, item, k)
        for item, origin in items
        if isinstance(item, Equation) and assigned(item) is not None
        for k, (left, right) in enumerate(sides(pool, item, resolve, done, origin))
    ]


def asserts(pool: Pool, instance: Instance, items: Sequence[Statement], resolve: Resolve) -> list[FlatAssert]:
    """Assertions among the statements of a component."""
    return [
        FlatAssert(scalars(pool, item.condition, resolve, {})[0], item.message, item.level, origin, instance.path, item)
        for item, origin in items
        if isinstance(item, Assertion)
    ]


def places(all_instances: Iterable[Instance], inputs: Iterable[int]) -> dict[int, Place]:
    """First declaration of every discrete scalar that is no input of the model."""
    model_inputs = set(inputs)
    first_declaration: dict[int, Place] = {}
    for instance in all_instances:
        for name, declaration in instance.component._declarations.items():
            if declaration.discrete:
                for k in range(len(suffixes(declaration.shape))):
                    scalar = instance.first[name] + k
                    if scalar not in model_inputs:
                        first_declaration.setdefault(scalar, (instance, name, declaration, k))
    return first_declaration


def fill_starts(pool: Pool, starts: dict[int, FlatStart], discrete: Mapping[int, Place]) -> None:
    """Give discrete variables without a declared start the value false or zero."""
    for scalar, (instance, name, _, _) in discrete.items():
        starts.setdefault(scalar, FlatStart(pool.zero, True, instance.origin, instance.prefix + name))


def constancy(pool: Pool, discrete: Mapping[int, Place]) -> list[FlatEquation]:
    """Equations der(d) == 0: discrete variables are constant between events."""
    return [
        FlatEquation(
            pool.var(pool.derivative(scalar)), pool.zero, instance.origin, instance.path, f"{name} is discrete"
        )
        for scalar, (instance, name, _, _) in discrete.items()
    ]


def check_assigned(
    made: Sequence[FlatAssignment], whens: Sequence[FlatWhen], discrete: Mapping[int, Place], inputs: Iterable[int]
) -> None:
    """Refuse discrete variables that are determined twice, and signals that are not determined.

    Raises DeclarationError: AC145 for two discrete equations, or an equation and a reset, of one variable; AC148 for a
    discrete signal without a source.
    """
    model_inputs = set(inputs)
    first: dict[int, tuple[Origin | None, str]] = {}
    for a in made:
        if a.scalar in model_inputs:
            continue
        if a.scalar in first:
            raise _twice(discrete[a.scalar], (first[a.scalar], (a.origin, str(a.source))))
        first[a.scalar] = (a.origin, str(a.source))
    reset: set[int] = set()
    for w in whens:
        _refuse_repeated(w)
        for scalar, _ in w.actions:
            reset.add(scalar)
            if scalar in first:
                raise _twice(discrete[scalar], (first[scalar], (w.origin, str(w.source))))
    for scalar, (instance, name, declaration, k) in discrete.items():
        if declaration.kind in (Kind.INPUT, Kind.OUTPUT) and scalar not in first and scalar not in reset:
            is_input = declaration.kind is Kind.INPUT
            raise DeclarationError(
                "AC148",
                f"{instance.prefix}{name}{suffix(declaration.shape, k)} has no value: "
                + ("nothing is connected to it" if is_input else "no equation assigns it"),
                where=(instance.origin.span(),),
                evidence=[f"{instance.prefix}{name}   {declaration.doc}"] if declaration.doc else [],
                help=f"connect it to a boolean_output, or bind it: {type(instance.component).__name__}({name}=...)"
                if is_input
                else f"yield self.{name} == condition in {type(instance.component).__name__}.equations",
            )


def _refuse_repeated(w: FlatWhen) -> None:
    scalars_ = [scalar for scalar, _ in w.actions]
    targets = [a.target if a.by is None else a.by for a in w.source.actions]
    each = [str(target) for target in targets for _ in range(math.prod(target.shape))]
    names = [name for name, scalar in zip(each, scalars_, strict=True) if scalars_.count(scalar) > 1]
    if names:
        raise DeclarationError(
            "AC145",
            f"{names[0]} is reset twice by one `when`",
            where=() if w.origin is None else (w.origin.span(),),
            evidence=[str(w.source)],
            help="keep one of the two, or make them branches: when(...).elsewhen(...)",
        )


def _twice(place: Place, ends: Sequence[tuple[Origin | None, str]]) -> DeclarationError:
    instance, name, declaration, k = place
    return DeclarationError(
        "AC145",
        f"{instance.prefix}{name}{suffix(declaration.shape, k)} is determined twice at events",
        where=tuple(origin.span() for origin, _ in ends if origin is not None),
        evidence=[text for _, text in ends],
        cause="a discrete variable either has one equation or is reset by `when`s, not both",
        help="join them to one: where(condition, value, where(other, value, pre(variable)))",
    )
