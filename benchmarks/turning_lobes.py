"""The stability chart of turning, from the closed form and by simulation with delays.

    python benchmarks/turning_lobes.py [--picture docs/images/turning-lobes.png]

Closed form: with the receptance G of the tool, widths of cut b = -1 / (2 K Re G(i w)) at turns of T = (2 pi n - arg(1 +
1 / (K b G))) / w are limits (J. Tlusty, M. Polacek, 1963). Simulated: `RegenerativeTurning` 5 % below and above the
limit at a dozen speeds; it counts as unstable if the chip varies more in the last fifth than in the one before.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

import acausal
from acausal.lower.compiled import CompiledModel
from acausal.models.turning import RegenerativeTurning

M, W, ZETA, K = 1.0, 1570.8, 0.03, 2e9
SPEEDS = np.linspace(2000.0, 6000.0, 13)
Vector = NDArray[np.float64]


def lobes(count: int = 12) -> list[tuple[Vector, Vector]]:
    """Spindle speeds [1/min] and widths of cut [m] of each lobe."""
    w = W * np.linspace(1.0003, 1.6, 4000)
    receptance = 1.0 / (M * (W**2 - w**2 + 2j * ZETA * W * w))
    b = -1.0 / (2.0 * K * receptance.real)
    lag = -np.angle(1.0 + 1.0 / (K * b * receptance)) % (2.0 * np.pi)
    return [(60.0 * w / (2.0 * np.pi * n + lag), b) for n in range(count)]


def limit(speed: float) -> float:
    """Smallest unstable width of cut at a speed [m]."""
    found = []
    for speeds, b in lobes():
        for k in np.flatnonzero(np.diff(np.sign(speeds - speed))):
            share = (speed - speeds[k]) / (speeds[k + 1] - speeds[k])
            found.append(b[k] + share * (b[k + 1] - b[k]))
    return float(min(found))


def grows(compiled: CompiledModel, speed: float, b: float) -> bool:
    """Whether the variation of the chip grows."""
    turn = 60.0 / speed
    r = acausal.simulate(compiled, stop_time=40 * turn, tolerance=1e-7, parameters={"turn": turn, "b": b})
    h, t = r["cut.h"], r.time / turn
    return bool(np.ptp(h[t > 32]) > np.ptp(h[(t > 24) & (t < 32)]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--picture", type=Path)
    arguments = parser.parse_args()
    compiled = acausal.compile(RegenerativeTurning())
    began = time.perf_counter()
    points = []
    for speed in SPEEDS:
        for share in (0.95, 1.05):
            b = share * limit(float(speed))
            points.append((float(speed), b, grows(compiled, float(speed), b), share > 1.0))
    right = sum(found == expected for _, _, found, expected in points)
    print(f"{right} of {len(points)} runs of 40 turns on the side theory says, {time.perf_counter() - began:.1f} s")
    if arguments.picture:
        draw(points, arguments.picture)


def draw(points: list[tuple[float, float, bool, bool]], path: Path) -> None:
    """The chart, and one run on either side of the limit at 3000 1/min."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    def head(ax: Axes, title: str) -> None:
        """Title and legend above the axes, where they cover no curve."""
        ax.set_title(title, loc="left", pad=24)
        ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize=9, frameon=False, borderaxespad=0.2)

    figure, (chart, runs) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    for k, (speeds, b) in enumerate(lobes()):
        chart.plot(speeds, 1e3 * b, color="0.35", lw=1.2, label="limit, closed form" if k == 0 else None)
    for unstable, marker, color, label in (
        (False, "o", "C0", "simulated: decays"),
        (True, "^", "C3", "simulated: grows"),
    ):
        chosen = [(s, 1e3 * b) for s, b, found, _ in points if found == unstable]
        chart.plot(*zip(*chosen, strict=True), marker, color=color, ms=5, ls="", label=label)
    chart.set(xlim=(1900, 6100), ylim=(0, 0.45), xlabel="Spindle speed [1/min]", ylabel="Width of cut [mm]")
    head(chart, "Stability chart")
    for b, color in ((0.18e-3, "C3"), (0.14e-3, "C0")):
        r = acausal.simulate(RegenerativeTurning(b=b), stop_time=0.3)
        runs.plot(r.time, 1e6 * r["tool.s"], color=color, lw=0.8, label=f"b = {1e3 * b:.2f} mm")
    runs.set(xlabel="Time [s]", ylabel="Position of the tool [µm]")
    head(runs, "3000 1/min, limit 0.164 mm")
    figure.savefig(path, dpi=130)


if __name__ == "__main__":
    main()
