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
"""Names of the functions of a `CasadiModel`, in the order in which files hold them."""
EVENT_FUNCTIONS = ("dae", "indicators", "react", "clocks", "round")
"""The same of `CasadiEvents`."""


@dataclass(frozen=True)
class Port:
    """One entry of a vector of a `CasadiModel`.

    Parameters
    ----------
    name, unit, doc
        Path in the model, unit as declared ("" where none was), one-line meaning.
    start
        Value at the start with the declared parameters; of a parameter, its value; of an input, its guess, else 0.
    nominal
        Magnitude to scale with.
    min, max
        Declared limits, infinite where none were; the functions do not enforce them.
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
        """Index of an entry; UsageError AC010 with the nearest names when there is none."""
        for k, port in enumerate(self):
            if port.name == name:
                return k
        raise UsageError(
            "AC010",
            f"'{name}' is not in {place}",
            evidence=meant(name, self.names),
            help=f"it holds: {', '.join(self.names) or 'nothing'}",
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
        `(t, x, z, u, p, m) -> g`: positive while the relations of variables hold as `m` says; an event is where one
        becomes negative.
    react
        `(t, x, z, u, p, m, ticks) -> (x_after, z_after, m_after, settled)`: event iteration at an instant: relations
        flip, `when`s act and discrete equations are solved until nothing changes. `ticks`, shape (clocks,), is 1 for
        each of `clocks` that ticks at it. `settled` is 0 when the rounds did not suffice, or two clauses set one
        variable to different values. An integer that gets a fraction is nan. MX.
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
    """CasADi functions of a model, in SI units, and what their arguments mean; made by `compiled.casadi()`.

    Vectors are columns; `x` states, `z` algebraic variables, `u` the model's own inputs, `p` parameters, `y` outputs.
    They are described, in order, by the attributes of the same names. No function has the argument `t` where nothing
    in the model depends on the time. First and second derivatives are finite wherever the values are, see
    `acausal.export.casadi.finite`. docs/casadi.md shows each function in use.

    Attributes
    ----------
    dae
        `(t, x, z, u, p) -> (ode, alg, y)`: x' = ode, 0 = alg, index 1; SX, so it can be mapped, differentiated and
        generated as C. For transcriptions that keep z among their unknowns (collocation): the sturdiest way.
    ode
        `(t, x, u, p) -> (xdot, y)`: the same without z. Without algebraic variables it is SX. With them a Newton
        iteration inside (MX, CasADi's rootfinder `newton` with line search, on variables divided by their nominal
        magnitudes) starts at the z of the model's start, whatever x is; CasADi differentiates it any number of times
        by the implicit function theorem. It raises RuntimeError where it does not converge. For shooting and explicit
        integrators.
    implicit
        `(t, xdot, x, z, u, p) -> r`, nx + nz residuals: xdot - ode and alg.
    outputs
        `(t, x, z, u, p) -> y`.
    init
        `(p) -> (x0, z0)`: the start conditions. States given outright are expressions of p; where others, or z, have
        to be solved for, a rootfinder is inside (MX). Inputs have their start values in it.
    step
        `(t, x, u, p, h) -> (x_next, y)`: one step of length h [s] of the classical Runge-Kutta method on `ode`, y at
        its end.
    too_large
        `(t, x, u, p, h) -> too_large`: 1 where `step` is unstable at this h, so that x_next means nothing;
        `acausal.step_function` has implicit methods.
    step_error
        `(t, x, u, p, h) -> error`: estimate of what `step` adds to the error of a state, by its nominal value; see
        `acausal.export.step.defect`. Sums of it are the error of a run, but for what the model makes of errors.
    determinants
        `(t, x, z, u, p) -> (signs, sizes)` of the slopes of each block of algebraic equations that is nonlinear in its
        own unknowns; sizes are logarithms of magnitudes. Where a sign changes along a solution, or a determinant is
        zero, other solutions meet it, and what follows it may go on with one of these.
    invariants
        `(t, x, z, u, p) -> (position, velocity)`: constraints that bind the states, as stated, and differentiated:
        both are 0 along solutions, and at consistent starts. The functions above draw states back to them at the rate
        `stabilisation.rate`. Empty where the states are as many as the degrees of freedom ask for.
    instants
        `(p) -> times`: when sources of the model switch, in no order, some twice. Between them the functions are as
        smooth as the model's own equations; put mesh points there. At such a time the functions take the value after
        it.
    events
        Functions of the events, if requested; else None, and models whose events act are refused.
    start_time
        Time [s] of `init`.
    notes
        Sentences about what was assumed or left out.
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
        found = {name: getattr(self, name) for name in FUNCTIONS}
        if self.events is not None:
            found |= {f"events.{name}": getattr(self.events, name) for name in EVENT_FUNCTIONS}
        return found

    def source(self) -> dict[str, str]:
        """C of all functions: the texts of `NAME.c`, `NAME.h` and `NAME_main.c` by file name; see docs/casadi.md.

        Raises
        ------
        ExportError
            AC612 when a function cannot be generated.
        """
        texts: dict[str, str] = provided("sources")(self)
        return texts

    def save(self, path: str | Path) -> None:
        """Write functions and description to one file, completely or not at all; see `export/casadi/casadi_file.py`.

        Raises
        ------
        UsageError
            AC012 when the file cannot be written.
        """
        provided("save_casadi")(self, path)

    @classmethod
    def load(cls, path: str | Path) -> CasadiModel:
        """Read what `save` wrote; see `acausal.load_casadi`."""
        read: CasadiModel = provided("load_casadi")(path)
        return read
