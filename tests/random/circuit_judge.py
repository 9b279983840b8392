"""Runs of random switched circuits against their exact solutions."""

from __future__ import annotations

from typing import Any

import numpy as np

import acausal
from acausal import AcausalError
from tests.random.switched_circuits import SWITCHING, Circuit, Exact

ROWS = 200
# Of the range of each signal over the run.
CRITERION = 1e-4
# Range that a signal has at least [V, A]: a diode in front of a part without return carries nothing, of which the exact
# solution makes 4e-8 V (nodes that are tied to the rest by 1e-5 S).
_LEAST = 1e-3


def source(circuit: Circuit) -> str:
    """The circuit as a file."""
    names = [f"{b.kind[0]}{k}" for k, b in enumerate(circuit.branches)]
    lines = [
        "from acausal import Component, Equations, connect, fixed, part, time",
        "from acausal.library.electrical import *",
        "",
        "",
        "class Model(Component):",
        "    ground: Ground = Ground()",
    ]
    parts, build = [], []
    for name, b in zip(names, circuit.branches, strict=True):
        v = b.values
        window = " | ".join(f"((time > {x!r}) & (time < {y!r}))" for x, y in b.windows)
        made = {
            "R": f"Resistor(R={v[0]!r})",
            "L": f"Inductor(L={v[0]!r}, i=fixed({v[-1]!r}))",
            "C": f"Capacitor(C={v[0]!r}, v=fixed({v[-1]!r}))",
            "diode": f"IdealDiode(Ron={v[0]!r}, Goff={v[-1]!r})",
            "thyristor": f"IdealThyristor(Ron={v[0]!r}, Goff={v[-1]!r}, fire={window})",
            "closing": f"IdealClosingSwitch(Ron={v[0]!r}, Goff={v[-1]!r}, control={window})",
            "opening": f"IdealOpeningSwitch(Ron={v[0]!r}, Goff={v[-1]!r}, control={window})",
            "V": "",
        }[b.kind]
        if b.kind == "V":
            sine = f"SineVoltage(V={v[0]!r}, f={v[1]!r}, phase={v[-1]!r})"
            made = sine if v[1] else f"ConstantVoltage(V={v[0]!r})"
        parts.append(f"    {name}: {made.split('(')[0]} = part()")
        build.append(f"        self.{name} = {made}")
    lines += [*parts, "", "    def build(self) -> None:", *build, "", "    def equations(self) -> Equations:"]
    for node in range(circuit.nodes):
        pins = ["self.ground.p"] if node == 0 else []
        for name, b in zip(names, circuit.branches, strict=True):
            pins += [f"self.{name}.{pin}" for pin, at in (("p", b.a), ("n", b.b)) if at == node]
        if len(pins) > 1:
            lines.append(f"        yield connect({', '.join(pins)})")
    return "\n".join([*lines, ""])


def built(circuit: Circuit) -> Any:
    """The component that the source declares."""
    space: dict[str, Any] = {"__name__": "random_circuit"}
    exec(compile(source(circuit), "<random circuit>", "exec"), space)
    return space["Model"]()


def judged(circuit: Circuit, compiled: Any, truth: Exact, solver: str, tolerance: float = 1e-8) -> str | None:
    """What is wrong with a run, or None."""
    try:
        r = acausal.simulate(
            compiled, stop_time=circuit.stop, output_interval=circuit.stop / ROWS, solver=solver, tolerance=tolerance
        )
    except AcausalError as error:
        return f"refused {error.code}: {str(error).splitlines()[0]}"
    rows = np.array([np.flatnonzero(np.abs(r.time - t) < 1e-13 * circuit.stop)[-1] for t in truth.times])
    state_of = {"C": "v", "L": "i"}
    names = [
        f"{b.kind}{k}.{state_of[b.kind]}" for kind in "CL" for k, b in enumerate(circuit.branches) if b.kind == kind
    ]
    devices = [f"{b.kind[0]}{k}.v" for k, b in enumerate(circuit.branches) if b.kind in SWITCHING]
    away = np.ones(len(truth.times), dtype=bool)
    for e in truth.events:
        away &= np.abs(truth.times - e) > 2e-5 * circuit.stop
    for b in circuit.branches:
        for e in sum(b.windows, ()):
            away &= np.abs(truth.times - e) > 2e-5 * circuit.stop
    worst, words = 0.0, ""
    for name, want in zip([*names, *devices], np.column_stack([truth.states, truth.voltages]).T, strict=True):
        scale = max(float(np.ptp(want)), 1e-3 * float(np.abs(want).max()), _LEAST)
        off = np.abs(r[name][rows] - want) / scale
        off = np.where(away, off, 0.0) if name in devices else off
        k = int(np.argmax(off))
        if not off[k] <= worst:
            worst = float(off[k])
            found = f"{name}({truth.times[k]:.6g}) = {r[name][rows][k]:.9g}"
            words = f"{found}, must be {want[k]:.9g} ({worst:.1e} of its range)"
    return words if not worst <= CRITERION else None
