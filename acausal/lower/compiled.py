"""The compiled model: CasADi functions with documented signatures, and the names of their entries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca

from acausal.analyse.blocks.solve import opened
from acausal.analyse.delays import PADE, refuse_delays
from acausal.flatten.instances.instances import changing
from acausal.lower.build import Builder, Symbols
from acausal.lower.casadi_model import CasadiModel
from acausal.lower.columns.mapped import LEAST, Mapped, mapped
from acausal.lower.events.functions import EventFunctions, just_after
from acausal.lower.lowered import Lowered
from acausal.providers import provided
from acausal.reduce.confine import refuse_unsteady

_INPUTS = ["t", "x", "z", "u", "p", "m"]


@dataclass(frozen=True, eq=False, repr=False)
class CompiledModel(Lowered):
    """A model ready to run; made by `acausal.compile`, never changed. Its data are those of `Lowered`.

    `like` is a model that differs in names and numbers only, and whose functions this one shares
    (`acausal.lower.subsystems`).
    """

    like: CompiledModel | None = None

    @property
    def common(self) -> CompiledModel:
        """The model that owns the functions: `like`, or this one."""
        return self if self.like is None else self.like

    @property
    def is_steep(self) -> bool:
        """Whether rates depend on steep functions, which may burst between two steps of a solver."""
        return bool(self.common.narrow.arguments)

    def __repr__(self) -> str:
        return (
            f"CompiledModel({self.name}: {len(self.continuous)} states, {len(self.algebraic)} algebraic, "
            f"{len(self.parameters)} parameters, {len(self.flat.equations)} flat equations)"
        )

    def _repr_html_(self) -> str:
        shown: str = provided("compiled_html")(self)
        return shown

    def unchanging(self, what: str) -> CompiledModel:
        """The model with every possible contact in its equations, for operations that cannot switch structures.

        `what` names the operation in messages.

        Raises
        ------
        UsageError
            AC027 if no single set of equations holds for a whole run, as for drills that make several holes.
        """
        if self.recipe is None:
            return self
        whole = {path: part.whole() for path, part in changing(self.recipe.model).items()}
        refuse_unsteady(self.name, whole, f"{what} needs equations that stay")
        return replace(self, recipe=None)

    def mapped(self, zeros: tuple[int, ...] = ()) -> Mapped | None:
        """The equations with each pattern of repeated components lowered once; None if that does not pay.

        `zeros` are the indices of parameters that are taken as zero, whatever their values in p.
        """
        if self.varied or self.driven or self.delays or self.rhs.n_instructions() < LEAST:
            return None
        if zeros not in self._mapped:
            self._mapped[zeros] = mapped(self, frozenset(zeros))
        return self._mapped[zeros]

    @cached_property
    def _mapped(self) -> dict[tuple[int, ...], Mapped | None]:
        return {}

    @cached_property
    def constant_divisors(self) -> dict[int, float]:
        """Pivots that may lose digits, or their factors, that depend on parameters alone; their sizes when chosen."""
        solution = self.solution
        pool, points = solution.structure.reduced.pool, solution.structure.points
        below = set(pool.reachable([*(n for _, n in solution.definitions), *solution.residuals]))
        stack, chosen = [n for n in solution.divisors if n in below], dict[int, float]()
        while stack:
            node = stack.pop()
            op, *operands = pool.nodes[node]
            if op != "const" and not points.varies(node):
                chosen[node] = abs(points.constant(pool, node))
            elif op in ("mul", "neg"):
                stack += operands
        return chosen

    @cached_property
    def observe(self) -> Any:
        """`(t, x, z, u, p, m) -> y[len(columns)]`: every trajectory of the model at one instant."""
        return self._of_nodes("observe", y=self.columns)

    @cached_property
    def blended_observe(self) -> Any:
        """`observe` for modes between 0 and 1."""
        return self._of_nodes("observe", blend=True, y=self.columns)

    @cached_property
    def blended(self) -> Any:
        """`rhs` for modes between 0 and 1 (sliding modes): `where` is a weighted mean of its two values."""
        structure = self.solution.structure
        ode = structure.rates(self.state_variables)
        return self._of_nodes("blended", blend=True, ode=ode, alg=self.solution.residuals)

    def _of_nodes(self, name: str, blend: bool = False, **outputs: Sequence[int]) -> Any:
        """Function `(t, x, z, u, p, m) ->` a column of the nodes of each output."""
        symbols = Symbols(self)
        builder = symbols.defined(self, blend)
        columns = [ca.densify(builder.column(builder.replaced(nodes))) for nodes in outputs.values()]
        return ca.Function(name, symbols.inputs, columns, _INPUTS, [*outputs])

    @cached_property
    def opened(self) -> CompiledModel:
        """The model with the unknowns of monotone blocks as algebraic variables, after all others.

        For nonlinear programs, which can have them as unknowns: the unrolled Newton iteration, which this replaces,
        always costs all its steps.
        """
        if not self.solution.monotone:
            return self
        shell = replace(self, solution=opened(self.solution), rhs=None)
        solution, symbols = shell.solution, Symbols(shell)
        builder = symbols.builder(shell)
        builder.define([d for d in solution.definitions if d[0] in solution.needed], shell.rewritten)
        ode = builder.column(solution.structure.rates(shell.state_variables))
        alg = builder.lower(builder.replaced(solution.residuals))
        return replace(shell, rhs=ca.Function("rhs", symbols.inputs, [ode, _column(alg)], _INPUTS, ["ode", "alg"]))

    @cached_property
    def searched(self) -> Any:
        """`(t, x, z, u, p, m) -> v`: the unknowns of monotone blocks, which `opened` appends to z."""
        pool = self.solution.structure.reduced.pool
        return self._of_nodes("searched", v=[pool.var(m.variable) for m in self.solution.monotone])

    @cached_property
    def guess(self) -> Any:
        """`(p) -> (x[nx], z[nz])`: declared starts and guesses, 0 where there are none."""
        p = ca.SX.sym("p", len(self.parameters))
        builder = Builder(self.solution.structure.reduced.pool, ca.SX(0), p, {})
        declared = {**self.start.guesses, **self.start.direct}
        x, z = (
            _column([builder.lower([declared[v]])[0] if v in declared else ca.SX(0) for v in variables])
            for variables in (self.state_variables, self.solution.algebraic)
        )
        return ca.Function("guess", [p], [x, z], ["p"], ["x", "z"])

    @cached_property
    def conditions(self) -> Any:
        """`(t, x, z, u, p, m) -> (used, surplus)`: residuals of the start conditions; see `StartProblem`."""
        used, surplus = ([c.node for c in group] for group in (self.start.conditions, self.start.surplus))
        return self._of_nodes("conditions", used=used, surplus=surplus)

    @cached_property
    def all_modes(self) -> Any:
        """`(t, x, z, u, p) -> m[nm]`: the modes at a point, for use outside a run.

        Relations of time have their values just after t. Samples, `initial()` and `terminal()` are false, and `pre(d)`
        is d.

        Raises
        ------
        UsageError
            AC035 for a model with delays, which depends on the past.
        """
        refuse_delays(self.flat, "a point without a past", PADE)
        symbols = Symbols(self)
        timely, builder = self.time_events, symbols.builder(self)
        after = just_after(Builder(builder.pool, symbols.t, symbols.p, {}), timely)
        builder.done = dict(zip(timely.relations, ca.vertsplit(after), strict=True))
        builder.done |= {n: ca.SX(0) for n in (*self.state_events.samples, *self.state_events.flags)}
        builder.define(self.solution.definitions, self.rewritten)
        m = _column(builder.lower(self.mode_nodes))
        return ca.Function("all_modes", symbols.inputs[:-1], [m], _INPUTS[:-1], ["m"])

    @cached_property
    def events(self) -> EventFunctions:
        """Functions of the event iteration."""
        return EventFunctions(self)

    @cached_property
    def delay_signals(self) -> Any:
        """`(t, x, z, u, p, m) -> [sources, delays]`: signals that are delayed, and the delays [s]."""
        return self._of_nodes("signals", y=self.delays.roots)

    @cached_property
    def blended_delay_signals(self) -> Any:
        """`delay_signals` for modes between 0 and 1 (sliding modes)."""
        return self._of_nodes("signals", blend=True, y=self.delays.roots)

    @cached_property
    def homotopy(self) -> Any:
        """`(t, x, z, u, p, m, s) -> (used, alg)`: the start system from simplified (s = 0) to actual (s = 1).

        None for a model without `homotopy(...)`.
        """
        pool = self.solution.structure.reduced.pool
        conditions = [c.node for c in self.start.conditions]
        roots = [*conditions, *self.solution.residuals, *(n for _, n in self.solution.definitions)]
        if not any(pool.nodes[n][0] == "homotopy" for n in pool.reachable(roots)):
            return None
        symbols = Symbols(self)
        builder = symbols.defined(self)
        builder.homotopy = ca.SX.sym("s")
        used, alg = (_column(builder.lower(builder.replaced(group))) for group in (conditions, self.solution.residuals))
        return ca.Function(
            "homotopy", [*symbols.inputs, builder.homotopy], [used, alg], [*_INPUTS, "s"], ["used", "alg"]
        )

    @cached_property
    def constraints(self) -> Any:
        """`(t, x, z, u, p, m) -> (g, dg/dx)`: stabilised constraints, all levels, and their Jacobian."""
        symbols = Symbols(self)
        builder = symbols.defined(self)
        g = _column(builder.lower(builder.replaced(n for _, n in self.solution.structure.invariants)))
        return ca.Function("constraints", symbols.inputs, [g, ca.jacobian(g, symbols.x)], _INPUTS, ["g", "J"])

    @cached_property
    def constants(self) -> Any:
        """`(p) -> c`: the quantities that depend on parameters only, in the order of `constant_nodes`."""
        p = ca.SX.sym("p", len(self.parameters))
        builder = Builder(self.solution.structure.reduced.pool, ca.SX(0), p, {})
        return ca.Function("constants", [p], [_column(builder.lower(self.constant_nodes))], ["p"], ["c"])

    def casadi(
        self,
        outputs: Sequence[str] | None = None,
        *,
        parameters: Sequence[str] | None = None,
        minimal: bool = False,
        events: bool = False,
    ) -> CasadiModel:
        """The model as CasADi functions for optimal control, with names, units and limits of every entry.

        `outputs` names the entries of y; None means the variables declared in the class of the model itself.
        `parameters` names the entries of p; None means all parameters. `minimal` requests as many states as degrees of
        freedom, `events` the functions of the events. See `acausal.export.casadi.functions.casadi_model` and
        docs/casadi.md.
        """
        made: CasadiModel = provided("casadi_model")(
            self, outputs, parameters=parameters, minimal=minimal, events=events
        )
        return made


def _column(entries: list[Any]) -> Any:
    return ca.vertcat(*entries) if entries else ca.SX(0, 1)
