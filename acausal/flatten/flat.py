"""The flat system: every scalar variable, parameter and equation of a model, with names and places."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

from acausal.errors import Span
from acausal.flatten.pool import Pool
from acausal.language.component import Component, Connector
from acausal.language.declarations.declaration import Declaration
from acausal.language.declarations.experiment import Experiment
from acausal.language.declarations.misuse import Declared
from acausal.language.events import Assertion, When
from acausal.language.expressions.arrays import one_of
from acausal.language.expressions.expression import Equation, Symbol, equation_text
from acausal.language.origin import Origin


class FlatVariable(NamedTuple):
    """A declared variable: its entries are the scalars `first ... first + size - 1`, row-major.

    Connected potentials are one scalar with several FlatVariables: they share `first`.
    """

    path: str
    declaration: Declaration
    first: int
    size: int


class FlatParameter(NamedTuple):
    """A declared parameter: one node per entry, a ("par", k) where it is free, an expression where it is bound.

    A parameter bound to nothing but another one has the other's nodes and is not free.
    """

    path: str
    declaration: Declaration
    nodes: tuple[int, ...]
    free: bool


class FlatEquation(NamedTuple):
    """`left == right` between scalar nodes; `source` is the language equation, or words for what connections made.

    Of an equation between vectors and matrices it is the scalar one at `entry`, counted row by row.
    """

    left: int
    right: int
    origin: Origin | None
    component: str
    source: Equation | str
    entry: int = 0


class FlatComponent(NamedTuple):
    """A component of the instance tree: its class, and where it was made."""

    cls: type[Component]
    origin: Origin

    @property
    def is_connector(self) -> bool:
        """True for pins, flanges, frames."""
        return issubclass(self.cls, Connector)


class FlatLoop(NamedTuple):
    """A closed loop of frames: the two frames between which it was cut, and the components on the way around."""

    ends: tuple[str, str]
    origin: Origin
    components: tuple[str, ...]


class FlatWhen(NamedTuple):
    """Actions `(scalar, node of its new value)` at the instants at which any of the nodes `conditions` becomes true.

    Not if one of the conditions `earlier` does too: those of the branches before it. The run ends there when
    `terminate` is a message.
    """

    conditions: tuple[int, ...]
    earlier: tuple[int, ...]
    actions: tuple[tuple[int, int], ...]
    origin: Origin
    component: str
    source: When
    terminate: str | None = None


class FlatAssignment(NamedTuple):
    """A discrete equation: at events, and only there, the discrete `scalar` takes the value of `node`."""

    scalar: int
    node: int
    origin: Origin | None
    component: str
    source: Equation | str
    entry: int = 0


class FlatAssert(NamedTuple):
    """A condition that must hold in all of a run; `level` is "error" or "warning"."""

    condition: int
    message: str
    level: str
    origin: Origin
    component: str
    source: Assertion


class FlatDelay(NamedTuple):
    """The node `source` as it was `time` ago; `most` bounds a delay that varies. Its place among all is its number."""

    source: int
    time: int
    most: int | None
    label: str
    origin: Origin | None
    component: str


class FlatStart(NamedTuple):
    """A declared start of one scalar: an initial equation when `is_fixed`, else a guess."""

    node: int
    is_fixed: bool
    origin: Origin | Declared | None
    path: str


@dataclass(frozen=True, eq=False)
class FlatSystem:
    """What `flatten` makes of a model.

    Attributes
    ----------
    name
        Class name of the model.
    pool
        The scalar expressions; variables 0 ... n-1 come first, derivatives behind them.
    variables, parameters
        In the order of declaration, depth first.
    equations, initial_equations
        Scalar equations with their origin.
    whens
        What happens at events.
    assignments
        Discrete equations, at most one per scalar. The scalar keeps its equation der(d) == 0 among `equations`.
    asserts, demands
        What must hold: in all of a run, and of the parameters alone.
    inputs
        Scalar variables of the model's own unconnected inputs.
    parameter_values
        Value of each free parameter scalar (nan where none was given is refused earlier).
    starts
        Declared start of a scalar variable.
    components
        Every component by its path; the model itself has the path "".
    loops
        Closed loops of frames that were cut.
    notes
        Facts the user should see, for example connections cut in closed loops.
    frozen
        Names of parameter scalars that were made numbers (`acausal.reduce.freeze`).
    nominals
        Magnitude of each scalar before that: frozen zeros join variables, which must not change the tolerances.
    delays
        Signals of the past.
    undelayed
        Delays that are zero with the values of these parameters: node of the delay, and its words.
    """

    name: str
    pool: Pool
    n_scalars: int
    variables: tuple[FlatVariable, ...]
    parameters: tuple[FlatParameter, ...]
    equations: tuple[FlatEquation, ...]
    initial_equations: tuple[FlatEquation, ...]
    whens: tuple[FlatWhen, ...]
    assignments: tuple[FlatAssignment, ...]
    asserts: tuple[FlatAssert, ...]
    demands: tuple[FlatAssert, ...]
    inputs: tuple[int, ...]
    parameter_values: tuple[float, ...]
    starts: Mapping[int, FlatStart]
    experiment: Experiment
    components: Mapping[str, FlatComponent]
    loops: tuple[FlatLoop, ...] = ()
    notes: tuple[str, ...] = ()
    frozen: tuple[str, ...] = ()
    nominals: tuple[float, ...] = ()
    delays: tuple[FlatDelay, ...] = ()
    undelayed: tuple[tuple[int, str], ...] = ()

    def __repr__(self) -> str:
        return (
            f"FlatSystem({self.name}: {len(self.equations)} equations, {self.n_scalars} variables, "
            f"{len(self.parameter_values)} parameters)"
        )

    @cached_property
    def owner(self) -> dict[int, FlatVariable]:
        """The first declared variable of each scalar."""
        found: dict[int, FlatVariable] = {}
        for v in self.variables:
            for k in range(v.first, v.first + v.size):
                found.setdefault(k, v)
        return found

    def declaration(self, scalar: int) -> Declaration:
        """Declaration of a scalar; of the integrated variable for a derivative."""
        while scalar in self.pool.integral_of:
            scalar = self.pool.integral_of[scalar]
        return self.owner[scalar].declaration

    def scalar_name(self, scalar: int) -> str:
        """`path`, `path[i]`, `path[i,j]`, or `der(...)` of these."""
        if scalar in self.pool.integral_of:
            return f"der({self.scalar_name(self.pool.integral_of[scalar])})"
        variable = self.owner[scalar]
        return variable.path + suffix(variable.declaration.shape, scalar - variable.first)

    def text(self, equation: FlatEquation | FlatAssignment) -> str:
        """The equation as the modeller wrote it, with the names of the component it belongs to.

        Equal components share one language equation, which names the first of them.
        """
        source = equation.source
        if isinstance(source, str):
            return source
        source = one_of(source, equation.entry)
        written_for = _written_for(source)
        here = self.components.get(equation.component)
        if written_for is None or here is None or type(written_for) is not here.cls:
            return str(source)
        old = written_for._path_to("")
        new = equation.component + "." if equation.component else ""

        def name_of(symbol: Symbol) -> str:
            path: str = symbol.owner._path_to(symbol.name)
            return new + path.removeprefix(old)

        return equation_text(source, name_of)

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the free parameter scalars."""
        names = [""] * len(self.parameter_values)
        for p in self.parameters:
            if p.free:
                for suffix, node in zip(suffixes(p.declaration.shape), p.nodes, strict=True):
                    op, *number = self.pool.nodes[node]
                    if op == "par":  # single entries may be frozen
                        names[number[0]] = p.path + suffix
        return tuple(names)

    @cached_property
    def limited(self) -> tuple[tuple[int, FlatParameter, int], ...]:
        """Entries of bound parameters that have limits: node, parameter, number of the entry; equal ones once."""
        found: dict[tuple[int, int], tuple[int, FlatParameter, int]] = {}
        for p in self.parameters:
            if not p.free and (p.declaration.min > -math.inf or p.declaration.max < math.inf):
                for k, node in enumerate(p.nodes):
                    found.setdefault((node, id(p.declaration)), (node, p, k))
        return tuple(found.values())


def _written_for(equation: Equation) -> Component | None:
    """The component whose own symbols, or symbols of whose connectors, are all that an equation holds."""
    found: Component | None = None
    stack = [equation.left, equation.right]
    while stack:
        e = stack.pop()
        stack.extend(e.args)
        if isinstance(e, Symbol):
            owner: Component = e.owner
            if isinstance(owner, Connector) and owner.__dict__["_owner"] is not None:
                owner = owner.__dict__["_owner"][0]
            if found is not None and owner is not found:
                return None
            found = owner
    return found


def suffixes(shape: tuple[int, ...]) -> list[str]:
    """`[""]` for a scalar, `["[0]", "[1]", ...]` for a vector, `["[0,0]", ...]` for a matrix."""
    if not shape:
        return [""]
    return ["[" + ",".join(map(str, index)) + "]" for index in product(*(range(n) for n in shape))]


def suffix(shape: tuple[int, ...], place: int) -> str:
    """One of `suffixes`: a name costs the same in an array of any length."""
    index = []
    for n in reversed(shape):
        place, k = divmod(place, n)
        index.append(str(k))
    return "[" + ",".join(reversed(index)) + "]" if shape else ""


def span_of(equation: FlatEquation | FlatAssignment) -> tuple[Span, ...]:
    """Where the equation stands in the source, as a tuple for `AcausalError.where`."""
    return () if equation.origin is None else (equation.origin.span(),)
