"""The right-hand side of a model of repeated components, each pattern once: operations on columns, in CasADi's MX.

`CompiledModel.rhs` contains every instance of every component. That is fast to evaluate, and the right form for models
without many equal parts. But the C compiler needs 10 s for 1000 sections of an RC ladder, and does not finish for
10 000. Here each operation on all instances of a pattern is one operation on columns that are gathered by index: a
loop, in C and in CasADi's interpreter. The alternative, `Function.map` of one small function per pattern, is seven
times slower to interpret (docs/devdocs/mapped.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.collector import collector_paused
from acausal.lower.build import BUILD, Symbols
from acausal.lower.columns.patterns import CONSTANT, Column, Patterns, Stage, patterns
from acausal.lower.lowered import Lowered

# Least number of instructions of a model worth searching, least mean length of columns, and least fraction of nodes in
# columns.
LEAST, _LEAST_MEAN_LENGTH, _LEAST_FRACTION = 1000, 100, 0.7
# Largest number of stages, and of colours of the Jacobian: CasADi differentiates each colour by a sweep of its own.
MOST_STAGES, MOST_COLOURS = 8, 24


@dataclass(frozen=True, eq=False)
class Mapped:
    """The equations of the coupled system, each pattern once."""

    constants: Any  # `(p, u) -> c`: values that do not change during a run
    rhs: Any  # `(t, x, z, d, c, m) -> (ode, alg)`, MX, of dynamic states `x` and discrete variables `d`
    operations: int  # number of operations on columns and on scalars

    def dae(self, scale_x: Vector, scale_z: Vector, c: Vector | None = None) -> Any:
        """`(t, x, z, [c, m, d, shift], u) -> (ode, alg, quad, zero)`, as integrators expect it.

        Variables are divided by their scales, time is relative to `shift`, and `u` is empty. If `c` is given, it is
        inserted as numbers and no argument.
        """
        nc = 0 if c is not None else self.rhs.numel_in("c")
        nm, nd = self.rhs.numel_in("m"), self.rhs.numel_in("d")
        t, x, z = ca.MX.sym("t"), ca.MX.sym("x", len(scale_x)), ca.MX.sym("z", len(scale_z))
        p = ca.MX.sym("p", nc + nm + nd + 1)
        given, m, d, shift = ca.vertsplit(p, [0, nc, nc + nm, nc + nm + nd, nc + nm + nd + 1])
        constants = given if c is None else ca.MX(ca.DM(c))
        arguments = [t + shift, _times(x, scale_x), _times(z, scale_z), d, constants, m]
        ode, alg = self.rhs.call(arguments, True)
        none = ca.MX(0, 1)
        return ca.Function(
            "dae",
            [t, x, z, p, ca.MX.sym("u", 0)],
            [_times(ode, 1.0 / scale_x), alg, none, none],
            ["t", "x", "z", "p", "u"],
            ["ode", "alg", "quad", "zero"],
        )


def _times(column: Any, factors: Vector) -> Any:
    return column if (factors == 1.0).all() else column * ca.DM(factors)


def mapped(compiled: Lowered, zeros: frozenset[int]) -> Mapped | None:
    """The equations of the model as columns; None where scalar code is as fast.

    `zeros` are the indices of parameters that are taken as zero, whatever their values in p.
    """
    with collector_paused():
        program = _Program(compiled, zeros)
    if program.patterns.divided or not pays(program.patterns):
        return None
    constants, p = program.constants(), np.array(compiled.parameter_values)
    p[list(zeros)] = 0.0
    if not np.isfinite(np.array(constants(p, np.ones(len(compiled.inputs))))).all():
        return None  # divides by zero; scalar code with all numbers inserted may multiply the quotient by zero again
    rhs = program.rhs()
    return Mapped(constants, rhs, program.operations) if _colours(rhs) <= MOST_COLOURS else None


def pays(program: Patterns) -> bool:
    """Whether columns are faster than scalar code, and can express all operations."""
    lengths = program.lengths
    total = sum(lengths)
    rare = [one for stage in program.stages for one in stage.few]
    return (
        bool(lengths)
        and all(type(one.op) is str and one.op != "homotopy" for one in rare)  # calls and delays are subclasses of str
        and not any(one.op == "pow" and program.leaves.get(one.operands[1][0], ("",))[0] == CONSTANT for one in rare)
        and total >= _LEAST_MEAN_LENGTH * len(lengths)
        and total >= _LEAST_FRACTION * (total + program.scalars)
        and len(program.stages) <= MOST_STAGES
    )


def _colours(rhs: Any) -> int:
    """Number of sweeps for a Jacobian with respect to all variables."""
    pattern = rhs.jac_sparsity(0, 1)
    if rhs.numel_in(2):
        z = rhs.jac_sparsity(0, 2), rhs.jac_sparsity(1, 2)
        pattern = ca.blockcat([[ca.DM(pattern), ca.DM(z[0])], [ca.DM(rhs.jac_sparsity(1, 1)), ca.DM(z[1])]]).sparsity()
    return int(min(s.uni_coloring().size2() for s in (pattern, pattern.T)))


class _Program:
    """The columns of one model while they are lowered."""

    def __init__(self, compiled: Lowered, zeros: frozenset[int] = frozenset()) -> None:
        self.compiled = compiled
        self.zeros = zeros
        solution = compiled.solution
        self.pool = pool = solution.structure.reduced.pool
        n, nd = compiled.n_dynamic, compiled.discretes
        dynamic, discrete = compiled.state_variables[:n], compiled.state_variables[len(compiled.state_variables) - nd :]
        builder = Symbols(compiled).builder(compiled)
        builder.define([d for d in solution.definitions if d[0] in solution.needed], compiled.rewritten)
        self.n, self.size_z = n, len(solution.algebraic)
        roots = [*solution.structure.rates(dynamic), *builder.replaced(solution.residuals)]
        varying = {pool.time: ("t", 0)}
        for kind, variables in (("x", dynamic), ("z", solution.algebraic), ("d", discrete)):
            varying.update((pool.var(v), (kind, k)) for k, v in enumerate(variables))
        varying.update((k, ("m", at)) for at, k in zip(compiled.mode_places, compiled.mode_nodes, strict=True))
        inputs = frozenset(map(pool.var, solution.structure.reduced.inputs))
        self.patterns = patterns(pool, roots, builder.resolved, varying, inputs, zeros)
        self.resolving = builder
        self.position: dict[int, tuple[str, int]] = dict(self.patterns.leaves)
        self.source: dict[str, Any] = {}
        self.operations = 0

    def constants(self) -> Any:
        """`(p, u) -> c`."""
        symbols = Symbols(self.compiled)
        builder = symbols.builder(self.compiled)
        builder.definitions = self.resolving.definitions
        builder.parameters = ca.SX(symbols.p)
        for k in range(symbols.p.numel()):
            if k in self.zeros:
                builder.parameters[k] = 0  # so that a product with it is zero, whatever the other factor
        c = builder.column(self.patterns.constants)
        return ca.Function("constants", [symbols.p, symbols.u], [ca.densify(c)], ["p", "u"], ["c"])

    def rhs(self) -> Any:
        """`(t, x, z, d, c, m) -> (ode, alg)`."""
        compiled = self.compiled
        sizes = {
            "t": 1,
            "x": self.n,
            "z": self.size_z,
            "d": compiled.discretes,
            CONSTANT: len(self.patterns.constants),
            "m": compiled.n_modes,
        }
        self.source = {name: ca.MX.sym(name, size) for name, size in sizes.items()}
        inputs = list(self.source.values())
        for k, stage in enumerate(self.patterns.stages):
            if stage.few:
                self._few(k, stage)
            for j, column in enumerate(stage.columns):
                self._column(f"column{k}.{j}", column)
        roots = self.patterns.roots
        ode, alg = self._joined(roots[: self.n]), self._joined(roots[self.n :])
        return ca.Function("mapped", inputs, [ode, alg], list(sizes), ["ode", "alg"])

    def _few(self, k: int, stage: Stage) -> None:
        """Rare shapes, as one call of a scalar function."""
        symbols = ca.SX.sym("v", len(stage.needed))
        value: dict[int, Any] = {number: symbols[i] for i, number in enumerate(stage.needed)}
        value.update((number, ca.SX(v)) for number, v in self.patterns.numbers.items())
        for one in stage.few:
            operands = (value[c] > 0.5 if i in one.booleans else value[c] for i, (c,) in enumerate(one.operands))
            value[one.members[0]] = BUILD[one.op](*operands)
        computed = [one.members[0] for one in stage.few]
        function = ca.Function(f"few{k}", [symbols], [ca.densify(ca.vertcat(*(value[n] for n in computed)))])
        self.operations += int(function.n_instructions())
        self.source[f"few{k}"] = function(self._joined(stage.needed))
        self.position.update((number, (f"few{k}", i)) for i, number in enumerate(computed))

    def _column(self, name: str, column: Column) -> None:
        operands = [
            self._gathered(below) > 0.5 if i in column.booleans else self._gathered(below)
            for i, below in enumerate(column.operands)
        ]
        value = BUILD[column.op](*operands)
        if value.numel() == 1:
            value = ca.repmat(value, len(column.members), 1)
        self.source[name] = value
        self.position.update((number, (name, i)) for i, number in enumerate(column.members))
        self.operations += 1 + len(operands)

    def _gathered(self, members: Sequence[int]) -> Any:
        """Nodes from one source as a column, or as one scalar if they are all the same."""
        first = members[0]
        if first in self.patterns.numbers:
            return ca.MX(self.patterns.numbers[first])
        source = self.source[self.position[first][0]]
        return _picked(source, np.array([self.position[n][1] for n in members]))

    def _joined(self, members: Sequence[int]) -> Any:
        """Nodes from any sources as a column."""
        if not members:
            return ca.MX(0, 1)
        names = list(dict.fromkeys(self.position[n][0] for n in members))
        entries_of_source = [
            np.array([self.position[n][1] for n in members if self.position[n][0] == name]) for name in names
        ]
        if len(names) == 1:
            return _picked(self.source[names[0]], entries_of_source[0], scalar=False)
        # Select the entries of each source in order, then permute all of them to the order of `members`.
        which = {name: k for k, name in enumerate(names)}
        source = np.array([which[self.position[n][0]] for n in members])
        order = np.argsort(np.argsort(source, kind="stable"), kind="stable")
        parts = [
            _picked(self.source[name], at, scalar=False) for name, at in zip(names, entries_of_source, strict=True)
        ]
        return _picked(ca.vertcat(*parts), order, scalar=False)


def _picked(source: Any, at: Any, scalar: bool = True) -> Any:
    """Entries of a column: the whole column, a slice or one entry if that suffices, else by index."""
    first, last = int(at[0]), int(at[-1])
    if source.numel() == 1 and len(at) > 1 and not scalar:
        return ca.repmat(source, len(at), 1)  # an index list would turn a scalar into a row
    if scalar and (at == first).all():
        return source if source.numel() == 1 else source[first]
    step = int(at[1]) - first if len(at) > 1 else 1
    if step > 0 and (np.diff(at) == step).all():
        return source if len(at) == source.numel() else source[first : last + 1 : step]
    return source[at.tolist()]
