"""Symbols of a model's vectors, and a builder that maps variables and modes to them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import casadi as ca

from acausal.analyse.delays import WIDTH
from acausal.lower.build import Builder
from acausal.lower.chebyshev import INPUT_WIDTH, polynomial
from acausal.lower.lowered import Lowered


class Symbols:
    """One set of SX symbols for the arguments (t, x, z, u, p, m)."""

    def __init__(self, compiled: Lowered) -> None:
        self.t = ca.SX.sym("t")
        self.x = ca.SX.sym("x", len(compiled.states))
        self.z = ca.SX.sym("z", len(compiled.algebraic))
        self.u = ca.SX.sym("u", len(compiled.inputs))
        self.p = ca.SX.sym("p", len(compiled.parameters))
        self.m = ca.SX.sym("m", compiled.n_modes)

    @property
    def inputs(self) -> list[Any]:
        """The symbols in the order of every function's arguments."""
        return [self.t, self.x, self.z, self.u, self.p, self.m]

    def builder(self, compiled: Lowered) -> DefiningBuilder:
        """A builder that knows states, algebraic variables, inputs and modes."""
        solution = compiled.solution
        modes = {n: self.m[k] for k, n in zip(compiled.mode_places, compiled.mode_nodes, strict=True)}
        builder = DefiningBuilder(solution.structure.reduced.pool, self.t, self.p, modes)
        first, delays = compiled.n_timely - compiled.delays.size, range(len(compiled.delays.items))
        builder.windows = [self.m[first + WIDTH * k : first + WIDTH * (k + 1)] for k in delays]
        for symbols, variables in (
            (self.x, compiled.state_variables),
            (self.z, solution.algebraic),
            (self.input_values(compiled), solution.structure.reduced.inputs),
        ):
            builder.know(variables, symbols)
        return builder

    def defined(self, compiled: Lowered, blend: bool = False) -> DefiningBuilder:
        """As `builder`, with all definitions; `blend` for modes between 0 and 1."""
        builder = self.builder(compiled)
        builder.blend = blend
        builder.define(compiled.solution.definitions, compiled.rewritten)
        return builder

    def input_values(self, compiled: Lowered) -> Any:
        """Inputs in the equations: entries of u, and polynomials in time for driven ones."""
        u, first = ca.SX(self.u), len(compiled.time_events.relations)
        for k, place in enumerate(compiled.driven):
            u[place] = polynomial(self.m[first + k * INPUT_WIDTH : first + (k + 1) * INPUT_WIDTH], self.t)
        return u


class DefiningBuilder(Builder):
    """A builder with definitions in which relations and kinks are replaced by branches on modes."""

    def define(self, definitions: Sequence[tuple[int, int]], rewritten: dict[int, int]) -> None:
        """Add definitions; relations and kinks in them are replaced by their modes."""
        self.rewritten = rewritten
        for variable, node in definitions:
            self.definitions[variable] = self.replaced(node)

    def replaced(self, node: int) -> int:
        """The node with relations and kinks in it replaced by branches on modes."""
        if not self.rewritten:
            return node
        done = self._replaced
        self.pool.rewrite([node], self.pool.var, done)
        return done[node]

    @cached_property
    def _replaced(self) -> dict[int, int]:
        return dict(self.rewritten)
