"""Every driver of events against the reference: what each makes of a random model, in one sentence or none."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import acausal
from acausal import AcausalError
from tests.random.hybrid_models import Hybrid, source
from tests.random.hybrid_reference import ROWS, Contradiction, Discard, Reference, Run, reference

TOLERANCE = 1e-8
# Values after events whose times are known to the tolerance, of states that move by a few units per second.
_CLOSE = 2e-5


def built(model: Hybrid, text: str | None = None) -> Any:
    """The component that the source of a model declares, or another text that means the same."""
    space: dict[str, Any] = {"__name__": "random_model"}
    exec(compile(text or source(model), "<random model>", "exec"), space)
    return space["Model"]()


def simulated(solver: str, native: bool) -> Callable[[Any, Hybrid, Run], Any]:
    def drive(compiled: Any, model: Hybrid, run: Run) -> Any:
        r = acausal.simulate(
            compiled,
            stop_time=model.stop,
            output_interval=model.stop / ROWS,
            solver=solver,
            native=native,
            tolerance=TOLERANCE,
        )
        names = [f"x{i}" for i in range(len(model.states))] + [f"d{j}" for j in range(len(model.discretes))]
        # the last row of each time: values after what happens there
        rows = np.array([np.flatnonzero(np.abs(r.time - t) < 1e-9)[-1] for t in run.times], dtype=int)
        return np.column_stack([r[n][rows] for n in names])

    return drive


def stepped(compiled: Any, model: Hybrid, run: Run) -> Any:
    """`step_function` with steps so short that no two events share one; the states are cubics, exact in rk4."""
    apart = min(np.diff([0.0, *run.events]), default=0.1)
    count = 20 * max(2, int(np.ceil(2.1 / (20 * apart)))) * int(model.stop / 1.0)
    h = model.stop / count
    if count > 8000 or len({int(t / h - 1e-9) for t in run.events}) < len(run.events):
        return None
    s = acausal.step_function(compiled, h, "rk4")
    x = np.array([p.start for p in s.x])
    p = np.array([q.start for q in s.p])
    found = []
    names = [q.name for q in s.x]
    own = [f"x{i}" for i in range(len(model.states))] + [f"d{j}" for j in range(len(model.discretes))]
    place = [names.index(n) for n in own]
    for _ in range(count):
        x = np.asarray(s.function(x, np.zeros(0), p)[0]).ravel()
        found.append(x[place])
    rows = np.array(found)
    # at the rows' times: states go straight between steps only without curvature, so the nearest step is asked instead
    return rows, h


DRIVERS: dict[str, Callable[[Any, Hybrid, Run], Any]] = {
    "rosenbrock": simulated("rosenbrock", False),
    "rosenbrock native": simulated("rosenbrock", True),
    "erk": simulated("erk", False),
    "erk native": simulated("erk", True),
    "idas": simulated("idas", False),
    "cvodes": simulated("cvodes", False),
    "step_function": stepped,
}


def expected(model: Hybrid) -> Run | str:
    """The reference run, or the code with which the model has to be refused."""
    try:
        return reference(model)
    except Contradiction:
        return "AC504"


def judged(model: Hybrid, compiled: Any, driver: str, run: Run | str) -> str | None:
    """What is wrong, or None."""
    if isinstance(run, str):
        return refused(model, compiled, driver, run)
    try:
        found = DRIVERS[driver](compiled, model, run)
    except AcausalError as error:
        return f"refused {error.code}: {str(error).splitlines()[0]}"
    if found is None:
        return None
    if driver == "step_function":
        rows, h = found
        grid = [h * (k + 1) for k in range(len(rows))]
        keep = range(19, len(rows), max(1, len(rows) // 40))
        run = Reference(model).result([grid[k] for k in keep])
        found = rows[list(keep)]
        near = h * 1.01
    else:
        near = 1e-5
    want = np.column_stack([np.array(run.states), np.array(run.discretes)])
    if len(found) != len(want):
        return f"{len(found)} rows for {len(want)}"
    scale = 1.0 + np.abs(want).max(axis=0)
    for t, a, b in zip(run.times, found, want, strict=True):
        if min((abs(t - e) for e in run.events), default=1.0) < near:
            continue
        off = np.abs(a - b) / scale
        # states after many events carry the errors of all their times
        if not (off < _CLOSE).all():
            k = int(np.argmax(np.where(np.isnan(off), np.inf, off)))
            name = [f"x{i}" for i in range(len(model.states))] + [f"d{j}" for j in range(len(model.discretes))]
            return f"{name[k]}({t:.6g}) = {a[k]:.9g}, must be {b[k]:.9g}"
    return None


def refused(model: Hybrid, compiled: Any, driver: str, code: str) -> str | None:
    """What is wrong with a run that must end with `code`; exported steps cannot end, and are not asked."""
    if driver == "step_function":
        return None
    try:
        DRIVERS[driver](compiled, model, Run())
    except AcausalError as error:
        return None if error.code == code else f"refused {error.code}, must be {code}"
    return f"runs, must be refused with {code}"


__all__ = ["DRIVERS", "Discard", "built", "expected", "judged"]
