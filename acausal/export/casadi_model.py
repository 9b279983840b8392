"""A model as CasADi functions with a description of every entry: what optimal control starts from."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acausal.errors import UsageError, nearest


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
        Declared limits, infinite where none were; nothing in the functions keeps them.
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

    def position(self, name: str) -> int:
        """Where an entry stands; UsageError AC010 with the nearest names when there is none."""
        for k, port in enumerate(self):
            if port.name == name:
                return k
        close = nearest(name, self.names)
        raise UsageError(
            "AC010",
            f"'{name}' is not in this vector",
            evidence=[f"nearest  {', '.join(close)}"] if close else [],
            help=f"it holds: {', '.join(self.names) or 'nothing'}",
        )


@dataclass(frozen=True, eq=False)
class CasadiModel:
    """CasADi functions of a model, in SI units, and what their arguments mean; made by `compiled.casadi()`.

    Vectors are columns; `x` states, `z` algebraic variables, `u` the model's own inputs, `p` parameters, `y` outputs.
    They are described, in order, by the attributes of the same names.

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
    init
        `(p) -> (x0, z0)`: the start conditions. States given outright are expressions of p; where others, or z, have
        to be solved for, a rootfinder is inside (MX). Inputs have their start values in it.
    instants
        `(p) -> times`: when sources of the model switch, in no order, some twice. Between them the functions are as
        smooth as the model's own equations; put mesh points there. At such a time the functions take the value after
        it.
    start_time
        Time [s] of `init`.
    notes
        Sentences about what was assumed.

    CasADi can generate C (`Function.generate`) from everything that is SX; of functions with a `newton` rootfinder it
    cannot, nor does it say so in an error. Build a `fast_newton` rootfinder from `dae` for that.
    """

    name: str
    dae: Any
    ode: Any
    init: Any
    instants: Any
    x: Ports
    z: Ports
    u: Ports
    p: Ports
    y: Ports
    start_time: float = 0.0
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        sizes = ", ".join(f"{len(getattr(self, v))} {v}" for v in "xzupy")
        return f"CasadiModel({self.name}: {sizes})"

    def save(self, path: str | Path) -> None:
        """Write functions and description to one file, completely or not at all; see `acausal.export.casadi_file`.

        Raises
        ------
        UsageError
            AC012 when the file cannot be written.
        """
        from acausal.export.casadi_file import save_casadi

        save_casadi(self, path)

    @classmethod
    def load(cls, path: str | Path) -> CasadiModel:
        """Read what `save` wrote; see `acausal.load_casadi`."""
        from acausal.export.casadi_file import load_casadi

        return load_casadi(path)
