"""The reduced system: the equations left after alias elimination, over variables of their own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

from acausal.flatten.flat import FlatSystem
from acausal.flatten.pool import Pool
from acausal.flatten.text import to_text


class ReducedWhen(NamedTuple):
    """Nodes of a `when`: its conditions, those of the branches before it, and the new values."""

    conditions: tuple[int, ...]
    earlier: tuple[int, ...]
    values: tuple[int, ...]

    @property
    def guards(self) -> tuple[int, ...]:
        """Nodes that decide whether the clause acts."""
        return (*self.conditions, *self.earlier)

    def mapped(self, image: Mapping[int, int]) -> ReducedWhen:
        """The clause with the images of its nodes."""
        return ReducedWhen(*(tuple(image[n] for n in nodes) for nodes in self))


@dataclass(frozen=True, eq=False)
class ReducedSystem:
    """The equations that remain, over numbered variables of their own pool."""

    flat: FlatSystem  # the system it was made from
    pool: Pool  # expressions over the remaining variables 0 ... n_variables-1; `pool.derivative_of` links x to der(x).
    scalar: tuple[int, ...]  # flat scalar that names each remaining variable
    residuals: tuple[int, ...]  # nodes that must be zero
    equation: tuple[int, ...]  # index of the flat equation of each residual
    image: tuple[int, ...]  # node of every flat scalar: a variable, its negative, a constant, or a known expression
    inputs: tuple[int, ...]  # variables that are the model's own inputs
    redundant: tuple[int, ...]  # flat equations implied by others
    # Nodes of the initial equations that must be zero at the start, in the order of `flat.initial_equations`.
    initial: tuple[int, ...]
    whens: tuple[ReducedWhen, ...]  # nodes of `flat.whens`
    # `assignments`, `asserts`: nodes of `flat.assignments`, the new values, and of the conditions of `flat.asserts`.
    assignments: tuple[int, ...] = ()
    asserts: tuple[int, ...] = ()
    delays: tuple[tuple[int, int, int | None], ...] = ()
    # Flat scalars without trajectories, because no requested output needs them (`acausal.reduce.cone`); their images
    # are invalid.
    left_out: frozenset[int] = frozenset()

    def __repr__(self) -> str:
        return f"ReducedSystem({self.flat.name}: {len(self.residuals)} equations, {self.pool.n_variables} variables)"

    @property
    def event_nodes(self) -> list[int]:
        """Nodes of `when` clauses, discrete equations, assertions and delays."""
        whens = [n for w in self.whens for n in (*w.guards, *w.values)]
        delays = [n for delay in self.delays for n in delay if n is not None]
        return [*whens, *self.assignments, *self.asserts, *delays]

    def with_images(self, images: Mapping[int, int]) -> ReducedSystem:
        """The system with the images of the nodes of its variables and of `event_nodes`.

        Residuals and initial equations are left to the caller, who may drop some of them.
        """
        return replace(
            self,
            image=tuple(images[n] for n in self.image),
            whens=tuple(w.mapped(images) for w in self.whens),
            assignments=tuple(images[n] for n in self.assignments),
            asserts=tuple(images[n] for n in self.asserts),
            delays=tuple((images[s], images[t], None if m is None else images[m]) for s, t, m in self.delays),
        )

    def name(self, variable: int) -> str:
        """Name of a variable in the model; `der(...)` for derivatives added by the compiler."""
        if variable < len(self.scalar):
            return self.flat.scalar_name(self.scalar[variable])
        return f"der({self.name(self.pool.integral_of[variable])})"

    def leaf_name(self, op: str, k: int) -> str:
        """Name of variable or of parameter k, by the operation of its node, "var" or "par".

        The parameters of the model may be followed by one of the compiler, the stabilisation rate.
        """
        if op == "var":
            return self.name(k)
        names = self.flat.parameter_names
        return names[k] if k < len(names) else "stabilisation.rate"

    def text(self, node: int, limit: int = 80) -> str:
        """Text of an expression with the names of variables and parameters, cut after about `limit` characters."""
        return to_text(self.pool, node, self.leaf_name, limit)

    @cached_property
    def aliases(self) -> dict[int, list[int]]:
        """Flat scalars that equal each variable up to sign."""
        scalars_of: dict[int, list[int]] = {}
        for scalar, node in enumerate(self.image):
            op, *rest = self.pool.nodes[node]
            if op == "neg":
                op, *rest = self.pool.nodes[rest[0]]
            if op == "var" and scalar not in self.left_out:
                scalars_of.setdefault(rest[0], []).append(scalar)
        return scalars_of


def nominal(reduced: ReducedSystem, variable: int) -> float:
    """Declared nominal magnitude of a variable: the first one declared among its aliases.

    Undeclared it is 1; for the derivative of a velocity v = der(x), added by the compiler, it is v^2/x from the
    nominals of both: the acceleration if v changes over the same time as x.
    """
    flat = reduced.flat
    if flat.nominals and variable < len(reduced.scalar) and reduced.scalar[variable] < flat.n_scalars:
        return flat.nominals[reduced.scalar[variable]]
    sizes = (flat.declaration(s).nominal for s in reduced.aliases.get(variable, ()))
    declared = next((abs(s) for s in sizes if s != 1.0), None)
    return declared if declared is not None else _nominal_rate(reduced, variable)


def _nominal_rate(reduced: ReducedSystem, variable: int) -> float:
    flat = reduced.flat
    velocity = reduced.pool.integral_of.get(variable)
    if velocity is None or flat.nominals:
        return 1.0
    size = nominal(reduced, velocity)
    positions = (flat.pool.integral_of.get(s) for s in reduced.aliases.get(velocity, ()))
    position = next((s for s in positions if s is not None and s < flat.n_scalars), None)
    below = reduced.pool.integral_of.get(velocity)
    if position is None and below is None:
        return 1.0
    length = abs(flat.declaration(position).nominal) if position is not None else nominal(reduced, below or 0)
    return size * size / length if size != 1.0 else 1.0
