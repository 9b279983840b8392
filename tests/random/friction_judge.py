"""Runs of random friction networks against their plain simulation, and against laws."""

from __future__ import annotations

from typing import Any

import numpy as np

import acausal
from acausal import AcausalError
from tests.random.friction_networks import STOP, Friction, Line, Network

ROWS = 80
# Of the largest speed.
CRITERION = 1e-6


def _text(line: Line) -> str:
    t0, a, b = line.pieces[0]
    found = f"{a!r} + {b!r} * time" if b else repr(a)
    for t0, a, b in line.pieces[1:]:
        found = (
            f"where(time < {t0!r}, {found}, {a!r} + {b!r} * (time - {t0!r}))"
            if b
            else f"where(time < {t0!r}, {found}, {a!r})"
        )
    return found


def _element(f: Friction, linear: bool) -> str:
    if f.kind == "bearing":
        return (
            f"SupportFriction(f_pos=((0.0, {f.limit!r}),))"
            if linear
            else f"BearingFriction(tau_pos=((0.0, {f.limit!r}),))"
        )
    made = "Clutch" if f.kind == "clutch" else "Brake"
    return f"{made}(fn_max={2 * f.limit!r}, f_normalized={_text(f.normal)})"


def source(network: Network) -> str:
    """The network as a file."""
    linear = network.linear
    kind = "translational" if linear else "rotational"
    lines = [
        "from acausal import Component, Equations, connect, fixed, part, time, where",
        f"from acausal.library.{kind} import *",
    ]
    lines += ["", "", "class Model(Component):"]
    parts: list[tuple[str, str]] = []
    joins = []
    seen: set[int] = set()
    for k, b in enumerate(network.bodies):
        start = ""
        if b.group not in seen:
            start = (
                f", {'s' if linear else 'phi'}=fixed(0.0), {'v' if linear else 'w'}=fixed({network.speeds[b.group]!r})"
            )
        parts.append((f"b{k}", f"{'Mass(m' if linear else 'Inertia(J'}={b.inertia!r}{start})"))
        if b.group in seen and b.gear:
            ratio = network.bodies[k - 1].ratio / b.ratio
            parts.append((f"g{k}", f"IdealGear(ratio={ratio!r})"))
            joins.append(
                f"connect(self.b{k - 1}.flange_b, self.g{k}.flange_a), connect(self.g{k}.flange_b, self.b{k}.flange_a)"
            )
        elif b.group in seen:
            joins.append(f"connect(self.b{k - 1}.flange_b, self.b{k}.flange_a)")
        seen.add(b.group)
    for k, f in enumerate(network.frictions):
        parts.append((f"f{k}", _element(f, linear)))
        ends = zip(("flange_b", "flange_a") if f.kind == "clutch" else ("flange_a",), f.bodies, strict=True)
        joins += [f"connect(self.f{k}.{end}, self.b{on}.flange_b)" for end, on in ends]
    for k, (on, line) in enumerate(network.torques):
        parts.append((f"t{k}", f"{'Force(u' if linear else 'Torque(u'}={_text(line)})"))
        joins.append(f"connect(self.t{k}.flange, self.b{on}.flange_b)")
    lines += [f"    {name}: {made.split('(')[0]} = part()" for name, made in parts]
    lines += ["", "    def build(self) -> None:", *(f"        self.{name} = {made}" for name, made in parts)]
    lines += ["", "    def equations(self) -> Equations:"]
    lines += [
        f"        yield {one}"
        for join in joins
        for one in join.split("), ")
        for one in [one if one.endswith(")") else one + ")"]
    ]
    return "\n".join([*lines, ""])


def built(network: Network) -> Any:
    """The component that the source declares."""
    space: dict[str, Any] = {"__name__": "friction_network"}
    exec(compile(source(network), "<friction network>", "exec"), space)
    return space["Model"]()


def judged(network: Network, speeds: np.ndarray, solver: str = "auto", compiled: Any = None) -> str | None:
    """What is wrong with a run, or None; `speeds` are those of the groups at ROWS equal intervals."""
    try:
        compiled = acausal.compile(built(network)) if compiled is None else compiled
        r = acausal.simulate(compiled, stop_time=STOP, output_interval=STOP / ROWS, solver=solver, tolerance=1e-8)
    except AcausalError as error:
        return f"refused {error.code}: {str(error).splitlines()[0]}"
    rows = np.array([np.flatnonzero(np.abs(r.time - t) < 1e-12 * STOP)[-1] for t in np.linspace(0, STOP, ROWS + 1)])
    size = np.abs(speeds).max() + 0.1
    name, tau = ("v", "f") if network.linear else ("w", "tau")
    for k, b in enumerate(network.bodies):
        off = np.abs(r[f"b{k}.{name}"][rows] - b.ratio * speeds[b.group]) / (size * max(1.0, abs(b.ratio)))
        j = int(np.argmax(off))
        if not off[j] <= CRITERION:
            found, wanted = r[f"b{k}.{name}"][rows][j], b.ratio * speeds[b.group, j]
            return f"b{k}.{name}({r.time[rows][j]:g}) = {found:.9g}, must be {wanted:.9g}"
    return laws(network, r, rows, tau)


def laws(network: Network, r: Any, rows: np.ndarray, tau: str) -> str | None:
    """Balance of each group, and limits of each element, at the rows."""
    times = r.time[rows]
    loads = np.array([network.loads(t)[0] for t in times]).T
    limits = np.array([network.limits(t)[0] for t in times]).T
    carried = np.array([r[f"f{k}.{tau}"][rows] for k in range(len(network.frictions))])
    first = [next(k for k, b in enumerate(network.bodies) if b.group == g) for g in range(len(network.speeds))]
    a = np.array([r[f"b{k}.a"][rows] for k in first])
    left = network.mass[:, None] * a + network.ways.T @ carried - loads
    size = 1.0 + np.abs(loads).max() + np.abs(limits).max()
    if not np.abs(left).max() < 1e-7 * size:
        return f"balance is off by {np.abs(left).max():.2g}"
    over = np.abs(carried) - limits
    if not over.max() < 1e-6 * size:
        return f"an element carries {over.max():.2g} more than it can"
    return None
