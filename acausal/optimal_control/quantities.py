"""Variables and parameters of a model by name, as CasADi symbols for constraints and objectives."""

from __future__ import annotations

import math
from copy import copy
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.errors import UsageError, calling_span, meant
from acausal.export.minimal.coordinates import coordinates_of
from acausal.export.observed import dae_function
from acausal.export.ports import Output, named_outputs, parameter_ports, variable_ports
from acausal.export.start_point import StartPoint, init_function, start_point
from acausal.lower.casadi_model import Ports
from acausal.lower.compiled import CompiledModel
from acausal.optimal_control.declare import Guard
from acausal.optimal_control.program.points import key, symbols_in
from acausal.simulate.options import parameter_vector


class Quantities:
    """Symbols of one problem: the time, the variables of the model that it uses, and decided parameters.

    Attributes
    ----------
    p
        Values of all parameters, shape (np,); of decided ones, the guess.
    model, compiled
        The model as it is simulated, and as the equations are taken from it.
    states, x, first
        States of the model; coordinates of the optimization, and their start values, shape (nx,).
    outputs
        Variables used in the problem, in order of first use; `symbols` are theirs.
    low
        Lower bounds of the algebraic variables, shape (nz,).
    decided
        `(index in p, lower, upper, symbol)` of decided parameters.
    """

    def __init__(self, compiled: CompiledModel, parameters: dict[str, float]) -> None:
        self.model = self.compiled = compiled = compiled.unchanging("optimal control")
        self.p = parameter_vector(compiled, parameters)
        self.begin: StartPoint = start_point(compiled, self.p)
        inputs = compiled.solution.structure.reduced.inputs
        self.states: Ports = variable_ports(compiled, compiled.state_variables, self.begin.x)
        self.coordinates = coordinates_of(compiled, self.states, self.begin.x, self.p)
        if self.coordinates.complete:
            self.p[-1] = 0.0  # minimal coordinates have no constraints to stabilise
        self.x: Ports = self.coordinates.ports
        self.first: Vector = self.coordinates.of(self.begin.x[:, None]).ravel()
        self.z: Ports = variable_ports(compiled, compiled.solution.algebraic, self.begin.z)
        self.low: Vector = np.full(len(self.z), -math.inf)
        self.u: Ports = variable_ports(compiled, inputs, self.begin.u)
        self.parameters: Ports = parameter_ports(compiled)
        self.time = ca.MX.sym("time")
        self.outputs: list[Output] = []
        self.symbols: list[Any] = []
        self.decided: list[tuple[int, float, float, Any]] = []
        self._known: dict[str, Any] = {}
        self._daes: dict[tuple[CompiledModel, int], Any] = {}
        self._places: dict[str, tuple[str, int, int] | None] = {}

    def opened(self) -> Quantities:
        """A copy in which the unknowns of blocks with a monotone search are appended to the algebraic variables."""
        searched = self.compiled.solution.monotone
        if not searched:
            return self
        found, compiled = copy(self), self.compiled.opened
        variables = [m.variable for m in searched]
        found.compiled = compiled
        found.z = Ports([*self.z, *variable_ports(compiled, variables, [m.low for m in searched])])
        found.low = np.array([*self.low, *(m.low for m in searched)])
        return found

    def __getitem__(self, name: str) -> Any:
        if name not in self._known:
            places = {port.name: k for k, port in enumerate(self.parameters)}
            if name in places:
                self._known[name] = ca.MX(self.p[places[name]])
                return self._known[name]
            found = named_outputs(self.compiled, [name])
            column = [self._scalar(output) for output in found]
            self._known[name] = column[0] if len(column) == 1 else ca.vertcat(*column)
        return self._known[name]

    def _scalar(self, output: Output) -> Any:
        """Symbol of a scalar variable, a new one if it was not used before."""
        for known, symbol in zip(self.outputs, self.symbols, strict=True):
            if known.scalar == output.scalar:
                return symbol
        self.outputs.append(output)
        self.symbols.append(ca.MX.sym(output.name))
        return self.symbols[-1]

    def entries(self, name: str) -> tuple[str, ...]:
        """Names of the scalars of a variable."""
        return tuple(output.name for output in named_outputs(self.compiled, [name]))

    def nominal(self, name: str) -> float:
        """Declared magnitude of a scalar variable."""
        (output,) = named_outputs(self.compiled, [name])
        return float(output.declaration.nominal)

    def name_of(self, expression: Any) -> str | None:
        """Name of the scalar variable whose symbol an expression is; None for others."""
        names = [o.name for o, s in zip(self.outputs, self.symbols, strict=True) if key(s) == key(expression)]
        return names[0] if names else None

    def is_used(self, name: str) -> bool:
        """Whether a variable or a parameter has been used in the problem."""
        return name in self._known

    def varies(self, expression: Any) -> bool:
        """Whether an expression depends on the time or on variables."""
        return not symbols_in(expression).isdisjoint(map(key, (self.time, *self.symbols)))

    def decide(self, name: str, lower: float | None, upper: float | None) -> Any:
        """Make a parameter a decision, and return its symbol."""
        place = self.parameters.position(name, f"the parameters of {self.compiled.name}")
        port = self.parameters[place]
        if name in self._known:
            raise UsageError(
                "AC053",
                f"{name} has already been used as a number, or decided with other limits",
                where=calling_span(),
                help="decide each parameter once, before it is used",
            )
        low = port.min if lower is None else max(lower, port.min)
        high = port.max if upper is None else min(upper, port.max)
        if not low <= high:
            raise UsageError(
                "AC051",
                f"no value of {name} lies within its limits: {low:g} ... {high:g}",
                where=calling_span(),
                help=f"it is declared from {port.min:g} to {port.max:g}",
            )
        if place in self.coordinates.bound:
            raise UsageError(
                "AC053",
                f"{name} cannot be decided: the angle that replaces states of {self.compiled.name} depends on it",
                where=calling_span(),
                help="declare the angle in the model, with the constraint solved for x and y",
            )
        symbol = ca.MX.sym(name)
        self.decided.append((place, low, high, symbol))
        self._known[name] = symbol
        return symbol

    def place(self, name: str) -> tuple[str, int, int] | None:
        """(Vector, index, sign) of a scalar that is, or is an alias of, a state or an input; else None."""
        if name not in self._places:
            self._places[name] = self._locate(name)
        return self._places[name]

    def _locate(self, name: str) -> tuple[str, int, int] | None:
        (output,) = named_outputs(self.compiled, [name])
        reduced = self.compiled.solution.structure.reduced
        op, *rest = reduced.pool.nodes[reduced.image[output.scalar]]
        sign = 1
        if op == "neg":
            op, *rest = reduced.pool.nodes[rest[0]]
            sign = -1
        if op == "var":
            kept = [self.compiled.state_variables[k] for k in self.coordinates.kept]
            for vector, variables in (("x", kept), ("u", list(reduced.inputs))):
                if rest[0] in variables:
                    return vector, variables.index(rest[0]), sign
        return None

    def of_states(self, name: str) -> list[int]:
        """Indices of a state, or of all of a vector, among the coordinates; AC010 for other variables and for states
        replaced by an angle, AC053 for integers.
        """
        if name in self.x.names and name not in self.states.names:  # an angle
            return [self.x.position(name)]
        outputs = named_outputs(self.compiled, [name])
        if any(o.declaration.integer or o.declaration.boolean for o in outputs):
            raise UsageError(
                "AC053",
                f"{name} has no values between two of its values, so its start is no decision",
                where=calling_span(),
                help="solve one problem for each of its values",
            )
        return [self._state(output.name) for output in outputs]

    def _state(self, name: str) -> int:
        if name in self.x.names:
            return self.x.position(name)
        found = self.place(name)
        if found is None or found[0] != "x" or found[2] < 0:
            raise UsageError(
                "AC010",
                f"{name} is not a state of {self.compiled.name}",
                where=calling_span(),
                evidence=meant(name, self.x.names),
                help=f"its states: {', '.join(self.x.names)}",
            )
        return found[1]

    def guard(self, until: str | Any) -> Guard:
        """The guard of a condition that ends a phase: an expression that becomes positive there."""
        if isinstance(until, str):
            return self._relation(until)
        op = until.op() if until.n_dep() == 2 else None
        if op not in (ca.OP_LE, ca.OP_LT):
            raise UsageError(
                "AC051",
                f"a phase ends with a relation, not with {until}",
                where=calling_span(),
                help='until=problem["drill.s"] >= 0.01, or the text of an event of the model',
            )
        return Guard(until.dep(1) - until.dep(0), None, str(until))

    def _relation(self, text: str) -> Guard:
        """The guard of a relation of the model, found by its text; AC010."""
        texts = self.compiled.events.texts
        for k, known in enumerate(texts):
            if known.replace(" ", "") == text.replace(" ", ""):
                return Guard(None, k, text)
        raise UsageError(
            "AC010",
            f"{self.compiled.name} has no event '{text}'",
            where=calling_span(),
            evidence=meant(text, texts),
            help=f"its relations: {'; '.join(texts[:8]) or 'none'}",
        )

    def dae(self) -> Any:
        """The function `(t, x, z, u, p) -> (ode, alg, y)`, where y are the variables used in the problem."""
        version = (self.compiled, len(self.outputs))  # outputs are only ever appended
        if version not in self._daes:
            self._daes[version] = self.coordinates.equations(dae_function(self.compiled, self.outputs))
        return self._daes[version]

    def rates(self) -> dict[int, int]:
        """For each coordinate whose rate is another coordinate, the index of that one."""
        dae = self.dae()
        arguments = [ca.SX.sym(dae.name_in(k), dae.numel_in(k)) for k in range(5)]
        ode, c = dae(*arguments)[0], ca.vertsplit(arguments[1])
        return {k: j for k in range(len(c)) for j, other in enumerate(c) if ca.is_equal(ode[k], other)}

    def start(self, p: Any) -> Any:
        """Start values of the coordinates as an expression of the parameters p, shape (nx, 1)."""
        x = init_function(self.model, self.begin)(p)[0]
        return self.coordinates.reduce(x) if self.coordinates.angles else x


def magnitude(port_nominal: Vector, seen: Vector) -> Vector:
    """Declared nominal values or, if none was declared, the largest values in the guess; all of shape (n,)."""
    undeclared = port_nominal == 1.0
    usable = np.isfinite(seen) & (seen > 1e-12)
    return np.where(undeclared & usable, seen, port_nominal)
