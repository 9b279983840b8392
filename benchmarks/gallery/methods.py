"""What the exhibits share: fixed steps, IDAS as CasADi ships it, SciPy with a bound on its work, and how to say it."""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Vector = NDArray[np.float64]
Rhs = Callable[[float, Vector], Any]
MOST_EVALUATIONS = 200_000


@dataclass(frozen=True)
class Case:
    """One method on one scene: what came out, in words, and a curve where there is one to draw."""

    method: str
    outcome: str
    fails: bool
    curve: tuple[Vector, Vector] | None = None


@dataclass(frozen=True)
class Exhibit:
    """One scene: who fails, how, and what is done here. `limits` bounds the vertical axis, `log` its scale."""

    scene: str
    title: str
    model: str
    what: str
    cases: Sequence[Case]
    x: str = "time [s]"
    y: str = ""
    log: str = ""
    limits: tuple[float, float] | None = None
    done: str = ""
    exact: tuple[Vector, Vector] | None = field(default=None)


@dataclass(frozen=True, eq=False)
class Run:
    """Times, states of shape (n, rows), and why it ended before its end, if it did."""

    t: Vector
    x: Vector
    steps: int
    failure: str = ""


class TooMuch(Exception):
    """The bound on evaluations is reached."""


def scipy_run(rhs: Rhs, span: tuple[float, float], x0: Sequence[float], method: str, rtol: float, **more: Any) -> Run:
    """`solve_ivp`, given up after so many evaluations."""
    count = 0
    reached = span[0]

    def counted(t: float, x: Vector) -> Any:
        nonlocal count, reached
        count += 1
        reached = max(reached, t)
        if count > MOST_EVALUATIONS:
            raise TooMuch
        return rhs(t, x)

    atol = more.pop("atol", 1e-3 * rtol)
    with np.errstate(all="ignore"):
        try:
            found = solve_ivp(counted, span, x0, method=method, rtol=rtol, atol=atol, **more)
        except TooMuch:
            return Run(
                np.zeros(0), np.zeros((len(x0), 0)), count, f"{MOST_EVALUATIONS} evaluations at t = {reached:.4g} s"
            )
    failure = "" if found.status >= 0 else f"stops at t = {found.t[-1]:.6g} s"
    return Run(found.t, found.y, len(found.t), failure)


def fixed(step: Callable[[float, Vector, float], Vector], x0: Sequence[float], h: float, count: int) -> Run:
    """So many steps of a one-step method, up to where it overflows."""
    x = np.array(x0, dtype=float)
    rows = [x]
    with np.errstate(all="ignore"):
        for k in range(count):
            x = step(k * h, x, h)
            if not np.isfinite(x).all() or np.max(np.abs(x)) > 1e30:
                break
            rows.append(x)
    found = np.array(rows).T
    return Run(h * np.arange(found.shape[1]), found, found.shape[1] - 1)


def rk2(rhs: Rhs) -> Callable[[float, Vector, float], Vector]:
    """Heun's method."""

    def step(t: float, x: Vector, h: float) -> Vector:
        a = np.asarray(rhs(t, x))
        return np.asarray(x + h / 2 * (a + np.asarray(rhs(t + h, x + h * a))))

    return step


def rk4(rhs: Rhs) -> Callable[[float, Vector, float], Vector]:
    """The classical method of order 4."""

    def step(t: float, x: Vector, h: float) -> Vector:
        a = np.asarray(rhs(t, x))
        b = np.asarray(rhs(t + h / 2, x + h / 2 * a))
        c = np.asarray(rhs(t + h / 2, x + h / 2 * b))
        d = np.asarray(rhs(t + h, x + h * c))
        return np.asarray(x + h / 6 * (a + 2 * b + 2 * c + d))

    return step


def idas(dae: dict[str, Any], x0: Sequence[float], grid: Vector, rtol: float, **more: Any) -> Run:
    """IDAS over a grid that starts at 0; a failure keeps what came before it, found by halving the horizon."""
    settings = {"reltol": rtol, "abstol": 1e-3 * rtol, "max_num_steps": 300_000, "calc_ic": True, **more}
    z0 = settings.pop("z0", 0.0)
    with quiet():
        integrator = ca.integrator("peer", "idas", dae, 0.0, grid.tolist(), settings)
        try:
            found = np.array(integrator(x0=x0, z0=z0)["xf"])
            return Run(grid, found, int(integrator.stats().get("nsteps", 0)))
        except RuntimeError as error:
            text = str(error)
        whole, rows = len(grid), 0
        best = np.zeros((len(x0), 0))
        while whole - rows > 1:
            middle = (rows + whole) // 2
            part = ca.integrator("peer", "idas", dae, 0.0, grid[:middle].tolist(), settings)
            try:
                best, rows = np.array(part(x0=x0, z0=z0)["xf"]), middle
            except RuntimeError:
                whole = middle
    reason = next(
        (w for w in ("TOO_MUCH_WORK", "CONV_FAIL", "ERR_FAIL", "NO_RECOVERY", "IDACalcIC") if w in text), "fails"
    )
    at = f" after t = {grid[rows - 1]:.5g} s" if rows else " at the start"
    return Run(grid[:rows], best, 0, f"{reason}{at}")


@contextlib.contextmanager
def quiet() -> Any:
    """SUNDIALS writes its complaints past Python: both streams go nowhere for a while."""
    with open(os.devnull, "w") as nowhere:
        kept = os.dup(2)
        os.dup2(nowhere.fileno(), 2)
        try:
            with contextlib.redirect_stderr(io.StringIO()):
                yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
