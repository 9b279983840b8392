"""Data classes of a model as CasADi functions, with a description of every entry of their vectors."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acausal.errors import UsageError, meant
from acausal.providers import provided

FUNCTIONS = (
    *("dae", "ode", "implicit", "outputs", "init", "step", "too_large", "step_error"),
    *("determinants", "invariants", "instants"),
)
"""Names of the functions of a `CasadiModel`, in their order in files."""
EVENT_FUNCTIONS = ("dae", "indicators", "react", "clocks", "round")
"""Names of the functions of `CasadiEvents`, likewise."""


@dataclass(frozen=True)
class Port:
    """One entry of a vector of a `CasadiModel`.

    Parameters
    ----------
    name, unit, doc
        Path in the model, declared unit ("" if there is none), one-line meaning.
    start
        Value at the start with the declared parameters; of a parameter, its value; of an input, its guess, else 0.
    nominal
        Magnitude for scaling.
    min, max
        Declared limits, infinite if there are none; the functions do not enforce them.
    """

    name: str
    unit: str = ""
    doc: str = ""
    start: float = 0.0
    nominal: float = 1.0
    min: float = -math.inf
    max: float = math.inf


class Ports(tuple[Port, ...]):
    """The entries of one vector in order, with their columns: `model.x.names`, `model.x.start`, `model.u.max`, ..."""

    def __new__(cls, ports: Iterable[Port] = ()) -> Ports:
        return super().__new__(cls, tuple(ports))

    @property
    def names(self) -> tuple[str, ...]:
        """Names in order."""
        return tuple(port.name for port in self)

    @property
    def start(self) -> list[float]:
        """Start values in order."""
        return [port.start for port in self]

    @property
    def nominal(self) -> list[float]:
        """Magnitudes in order."""
        return [port.nominal for port in self]

    @property
    def min(self) -> list[float]:
        """Lower limits in order."""
        return [port.min for port in self]

    @property
    def max(self) -> list[float]:
        """Upper limits in order."""
        return [port.max for port in self]

    def position(self, name: str, place: str = "this vector") -> int:
        """Index of an entry; raises UsageError AC010, with the nearest names, if there is none."""
        for k, port in enumerate(self):
            if port.name == name:
                return k
        raise UsageError(
            "AC010",
            f"'{name}' is not in {place}",
            evidence=meant(name, self.names),
            help=f"it contains: {', '.join(self.names) or 'nothing'}",
        )


@dataclass(frozen=True, eq=False)
class CasadiEvents:
    """Event functions of a model, for a loop that integrates between events; see docs/casadi.md.

    The functions have one more argument, the modes `m`, in the order of the attribute of that name: 1 for each relation
    that holds, and the values of `pre`. Between events m is constant, and `dae` is smooth.

    Attributes
    ----------
    dae
        `(t, x, z, u, p, m) -> (ode, alg, y)`.
    indicators
        `(t, x, z, u, p, m) -> g`: positive as long as the relations of variables agree with `m`; an event is where one
        entry becomes negative.
    react
        `(t, x, z, u, p, m, ticks) -> (x_after, z_after, m_after, settled)`: event iteration at an instant: relations
        flip, `when`s act and discrete equations are solved until nothing changes. `ticks`, shape (clocks,), is 1 for
        each of `clocks` that ticks at this instant. `settled` is 0 if the rounds did not suffice, or two clauses set
        one variable to different values. An integer variable that is set to a fraction becomes nan. MX.
    clocks
        `(p) -> (first, interval)`, shape (clocks,): clock k ticks at first[k], first[k] + interval[k], ...
    round
        One round of that iteration, for user-written loops: `acausal.lower.events.round.Round`.
    m
        Names of the modes; start is their value after the events of the start.
    """

    dae: Any
    indicators: Any
    react: Any
    clocks: Any
    round: Any
    m: Ports


@dataclass(frozen=True, eq=False)
class CasadiModel:
    """CasADi functions of a model, in SI units, and the meaning of their arguments; made by `compiled.casadi()`.

    Vectors are columns: `x` states, `z` algebraic variables, `u` the inputs of the model itself, `p` parameters, `y`
    outputs. The attributes of the same names describe their entries in order. If nothing in the model depends on time,
    no function has the argument `t`. First and second derivatives are finite wherever the values are, see
    `acausal.export.casadi.finite`. Where p shrinks a divisor so far that quotients are rounding errors, all results are
    nan. docs/casadi.md shows each function in use.

    Attributes
    ----------
    dae
        `(t, x, z, u, p) -> (ode, alg, y)`: x' = ode, 0 = alg, index 1; SX, so it can be mapped, differentiated and
        generated as C. For transcriptions that keep z among their unknowns (collocation), which is most robust.
    ode
        `(t, x, u, p) -> (xdot, y)`: the same without z, for shooting and explicit integrators. It is SX if the model
        has no algebraic variables. Otherwise it contains a Newton iteration (MX, CasADi's rootfinder `newton` with line
        search, on variables divided by their nominal magnitudes), which starts at the z of the model's start, whatever
        x is. CasADi differentiates it any number of times by the implicit function theorem. It raises RuntimeError
        where it does not converge.
    implicit
        `(t, xdot, x, z, u, p) -> r`, nx + nz residuals: xdot - ode and alg.
    outputs
        `(t, x, z, u, p) -> y`.
    init
        `(p) -> (x0, z0)`: consistent start values. States with explicit start values are expressions of p; if others,
        or z, have to be solved for, it contains a rootfinder (MX). Inputs have their start values in it.
    step
        `(t, x, u, p, h) -> (x_next, y)`: one step of length h [s] of the classical Runge-Kutta method on `ode`, y at
        its end.
    too_large
        `(t, x, u, p, h) -> too_large`: 1 where `step` is unstable at this h, so that x_next is meaningless;
        `acausal.step_function` has implicit methods.
    step_error
        `(t, x, u, p, h) -> error`: estimate of the error that `step` adds to a state, divided by its nominal value; see
        `acausal.export.step.defect`. The sum over a run estimates the error of the run, except for the amplification or
        damping of errors by the model.
    determinants
        `(t, x, z, u, p) -> (signs, sizes)` of the Jacobian of each block of algebraic equations that is nonlinear in
        its own unknowns; sizes are logarithms of magnitudes. Where a sign changes along a solution, or a determinant is
        zero, the solution meets others, and whatever follows it may continue on one of these.
    invariants
        `(t, x, z, u, p) -> (position, velocity)`: constraints between the states, as declared, and differentiated. Both
        are 0 along solutions, and at consistent starts. The functions above draw the states back to them at the rate
        `stabilisation.rate`. Empty if there are as many states as degrees of freedom.
    instants
        `(p) -> times`: when sources of the model switch, unsorted, possibly with repetitions. Between them the
        functions are as smooth as the equations of the model; put mesh points there. At such a time the functions have
        the value after it.
    events
        Functions of the events, if requested; otherwise None, and models whose events act are refused.
    start_time
        Time [s] of `init`.
    notes
        Sentences on assumptions and omissions.
    """

    name: str
    dae: Any
    ode: Any
    implicit: Any
    outputs: Any
    init: Any
    step: Any
    too_large: Any
    step_error: Any
    determinants: Any
    invariants: Any
    instants: Any
    x: Ports
    z: Ports
    u: Ports
    p: Ports
    y: Ports
    events: CasadiEvents | None = None
    start_time: float = 0.0
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        sizes = ", ".join(f"{len(getattr(self, v))} {v}" for v in "xzupy")
        return f"CasadiModel({self.name}: {sizes})"

    @property
    def autonomous(self) -> bool:
        """Whether the functions have no argument t."""
        return "t" not in self.dae.name_in()

    @property
    def functions(self) -> dict[str, Any]:
        """All functions by name, those of the events as `events.NAME`."""
        by_name = {name: getattr(self, name) for name in FUNCTIONS}
        if self.events is not None:
            by_name |= {f"events.{name}": getattr(self.events, name) for name in EVENT_FUNCTIONS}
        return by_name

    def source(self) -> dict[str, str]:
        """C of all functions: the texts of `NAME.c`, `NAME.h` and `NAME_main.c` by file name; see docs/casadi.md.

        Raises
        ------
        ExportError
            AC612 if a function cannot be generated.
        """
        texts: dict[str, str] = provided("sources")(self)
        return texts

    def save(self, path: str | Path) -> None:
        """Write functions and descriptions to one file, completely or not at all; see `export/casadi/casadi_file.py`.

        Raises
        ------
        UsageError
            AC012 if the file cannot be written, AC013 for another suffix than `.casadi`.
        """
        provided("save_casadi")(self, path)

    @classmethod
    def load(cls, path: str | Path) -> CasadiModel:
        """Read what `save` wrote; see `acausal.load_casadi`."""
        read: CasadiModel = provided("load_casadi")(path)
        return read
