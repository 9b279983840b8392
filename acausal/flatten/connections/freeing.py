"""Inputs of a model: those that nothing drives, and inner signals cut from their source by `acausal.free`."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from acausal.errors import UsageError, meant
from acausal.flatten.connections.connections import SignalJoint
from acausal.flatten.connections.elements import ElementJoint
from acausal.flatten.flat import FlatEquation
from acausal.flatten.instances.instances import Instance
from acausal.flatten.pool import Pool
from acausal.language.component import Component
from acausal.language.declarations.declaration import Declaration, Fixed, Guess, Kind

Signal = tuple[int, str]
"""A signal: instance, name."""
_OPEN = Guess(0.0)


def freed_signals(model: Component, found: Sequence[Instance]) -> frozenset[Signal]:
    """The signals named by `free`.

    Raises UsageError: AC047 for a name that is no input, or an input that changes at events only.
    """
    wanted = model.__dict__.get("_freed", ())
    if not wanted:
        return frozenset()
    known = {i.prefix + name: (i, name, d) for i in found for name, d in i.component._declarations.items()}
    inputs = [path for path, (_, _, d) in known.items() if d.kind is Kind.INPUT and not d.discrete]
    signals = set()
    for path in wanted:
        if path not in inputs:
            raise _not_an_input(type(model).__name__, path, known[path][2] if path in known else None, inputs)
        instance, name, _ = known[path]
        signals.add((instance.number, name))
    return frozenset(signals)


def _not_an_input(model: str, path: str, declaration: Declaration | None, inputs: Sequence[str]) -> UsageError:
    if declaration is None:
        fact = f"{model} has no signal '{path}'"
    elif declaration.discrete:
        fact = f"{path} changes at events only: it cannot be a function of time"
    else:
        fact = f"{path} is a {declaration.kind.value}, not an input"
    return UsageError(
        "AC047",
        fact,
        evidence=meant(path, list(inputs)) or [f"inputs: {', '.join(inputs[:6]) or 'none'}"],
        help="free the signal_input that is to be driven, not the source that drives it",
    )


def open_inputs(model: Instance, cut: Collection[Signal]) -> frozenset[Signal]:
    """Signals that are inputs of the model: its own that nothing binds, those with a number as default, and `cut`."""
    values, given = model.component.__dict__["_values"], model.component.__dict__["_given"]
    own = {
        (model.number, name)
        for name, d in model.component._declarations.items()
        if d.kind is Kind.INPUT
        and (isinstance(values.get(name, _OPEN), Fixed | Guess) or (name not in given and _is_number(d)))
    }
    return frozenset(own | set(cut))


def _is_number(declaration: Declaration) -> bool:
    """Whether the declared default is one number, and the signal continuous: discrete defaults are bindings."""
    value = declaration.default
    return isinstance(value, int | float) and not isinstance(value, bool) and not declaration.discrete


def cut_joints(signals: Sequence[SignalJoint], cut: Collection[Signal]) -> list[SignalJoint]:
    """Connections without those that drive a cut signal from outside; their other ends stay connected."""
    remaining: list[SignalJoint] = []
    neighbours: dict[Signal, list[tuple[Signal, SignalJoint]]] = {end: [] for end in cut}
    stack = list(signals)
    while stack:
        joint = stack.pop(0)
        here = next((end for end in (joint.a, joint.b) if end in cut and end[0] != joint.by), None)
        if here is None:
            remaining.append(joint)
            continue
        other = joint.b if joint.a == here else joint.a
        for before, via in neighbours[here][:1]:
            if via.by == joint.by:
                stack.append(SignalJoint(before, other, joint.by, joint.origin))
        neighbours[here].append((other, joint))
    return remaining


def cut_elements(joints: Sequence[ElementJoint], cut: Collection[Signal]) -> list[ElementJoint]:
    """Connections of elements without those that drive a cut signal."""
    return [j for j in joints if j.sink[:2] not in cut]


def cut_equations(
    pool: Pool, found: Sequence[Instance], equations: Sequence[FlatEquation], cut: Collection[Signal]
) -> list[FlatEquation]:
    """Equations without those by which an owner drives a cut signal: `yield self.force.u == ...`."""
    if not cut:
        return list(equations)
    owner_of_driven: dict[int, str] = {}
    for number, name in cut:
        owner = found[number].owner
        if owner is not None:
            first = found[number].first[name]
            count = max(1, _size(found[number].component._declarations[name]))
            owner_of_driven |= {pool.var(first + k): owner.path for k in range(count)}
    return [
        e
        for e in equations
        if not any(
            owner_of_driven.get(side) == e.component and pool.nodes[side][0] == "var" for side in (e.left, e.right)
        )
    ]


def _size(declaration: Declaration) -> int:
    size = 1
    for n in declaration.shape:
        size *= n
    return size


def input_scalars(found: Sequence[Instance], signals: Collection[Signal]) -> tuple[int, ...]:
    """The scalars of these signals, in the order of declaration."""
    return tuple(
        instance.first[name] + k
        for instance in found
        for name, d in instance.component._declarations.items()
        if (instance.number, name) in signals
        for k in range(_size(d))
    )
