"""Claim: MPR as a CasADi function needs no Python callback: it is called at the cost of C, and has exact derivatives.

One contact of a ball, of a cone tip and of a box with a plate is computed in three ways: by the interpreted CasADi
function, by the same function as generated C, and by coal through a Python callback, as a coupling to a library would
do (without derivatives). All are called in turn from within CasADi, as by an integrator. The Jacobian of depth, normal
and points with respect to both poses is measured too; the callback would need 25 calls for it and cannot be compiled.

    pip install .[test]
    python benchmarks/mpr.py
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from measure import alternated, medians, report, rounded
from scipy.spatial.transform import Rotation

from acausal.library.contact.collide.penetration import collision_function
from acausal.library.contact.collide.shapes import Box, Cone, Shape, Sphere

CALLS = 2000
PLATE = Box((0.1, 0.1, 0.01))
# Tool, and the position of its frame at which it is 1 mm deep in the plate, tilted by 10 degrees.
TOOLS: dict[str, tuple[Shape, tuple[float, float, float]]] = {
    "ball": (Sphere(0.008), (0.035, 0.02, 0.012)),
    "cone": (Cone(0.008, 0.0048), (0.035, 0.02, 0.004)),
    "box": (Box((0.02, 0.02, 0.02)), (0.03, 0.02, 0.0155)),
}


class Coal(ca.Callback):  # type: ignore[misc]
    """Depth, normal and nearest points by coal, as a CasADi function that calls Python."""

    def __init__(self, tool: Shape) -> None:
        ca.Callback.__init__(self)
        import coal

        self.coal, self.offset = coal, np.zeros(3)
        if isinstance(tool, Sphere):
            self.tool = coal.Sphere(tool.radius)
        elif isinstance(tool, Box):
            self.tool = coal.Box(*tool.size)
        elif isinstance(tool, Cone):
            self.tool, self.offset = coal.Cone(tool.radius, tool.length), np.array([0.0, 0.0, tool.length / 2])
        self.turn = np.diag([1.0, -1.0, -1.0]) if isinstance(tool, Cone) else np.eye(3)
        self.plate = coal.Box(*PLATE.size)
        self.request = coal.DistanceRequest()
        self.request.enable_signed_distance = True
        self.construct("coal", {})

    def get_n_in(self) -> int:
        return 4

    def get_n_out(self) -> int:
        return 4

    def get_sparsity_in(self, k: int) -> Any:
        return ca.Sparsity.dense(3, 3 if k % 2 else 1)

    def get_sparsity_out(self, k: int) -> Any:
        return ca.Sparsity.dense(3 if k else 1, 1)

    def eval(self, arguments: Any) -> Any:
        r_a, R_a, r_b, R_b = (np.array(a) for a in arguments)
        coal, result = self.coal, self.coal.DistanceResult()
        tool = coal.Transform3s(R_a @ self.turn, r_a.ravel() + R_a @ self.offset)
        plate = coal.Transform3s(R_b, r_b.ravel())
        depth = -coal.distance(self.tool, tool, self.plate, plate, self.request, result)
        return [depth, result.normal, result.getNearestPoint1(), result.getNearestPoint2()]


def jacobian(f: Any) -> Any:
    """Derivatives of all outputs with respect to all inputs, as one function."""
    inputs = f.sx_in()
    return ca.Function("jacobian", inputs, [ca.jacobian(ca.vertcat(*f.call(inputs)), ca.veccat(*inputs))])


def compiled(f: Any, folder: Path) -> tuple[Any, float]:
    """A function compiled to C, and the seconds that the compiler took."""
    generator = ca.CodeGenerator("mpr.c")
    generator.add(f)
    (folder / "mpr.c").write_text(generator.dump())
    library = folder / f"{f.name()}_{time.monotonic_ns()}.so"
    began = time.perf_counter()
    subprocess.run(["gcc", "-O2", "-shared", "-fPIC", folder / "mpr.c", "-o", library, "-lm"], check=True)
    return ca.external(f.name(), str(library)), time.perf_counter() - began


def repeated(f: Any, arguments: list[Any], calls: int) -> Callable[[], None]:
    """A job that evaluates a function many times without leaving CasADi's buffers."""
    buffer, evaluate = f.buffer()
    kept = [np.asarray(a, dtype=float).ravel(order="F").copy() for a in arguments]
    results = [np.zeros(f.nnz_out(k)) for k in range(f.n_out())]
    for k, a in enumerate(kept):
        buffer.set_arg(k, memoryview(a))
    for k, r in enumerate(results):
        buffer.set_res(k, memoryview(r))

    def job(kept: Any = (kept, results, buffer)) -> None:
        for _ in range(calls):
            evaluate()

    return job


def measured(name: str, folder: Path, repetitions: int) -> dict[str, Any]:
    """Microseconds of a call of each kind, and the difference of the results."""
    tool, place = TOOLS[name]
    turn = Rotation.from_rotvec([0.1, 0.14, 0.0]).as_matrix()
    arguments = [np.array(place), turn, np.zeros(3), np.eye(3)]
    f, callback = collision_function(tool, PLATE), Coal(tool)
    in_c, seconds = compiled(f, folder)
    slopes, _ = compiled(jacobian(f), folder)
    functions = {"interpreted": f, "C": in_c, "callback": callback, "Jacobian in C": slopes}
    calls = {k: CALLS // 10 if k in ("interpreted", "callback") else CALLS for k in functions}
    jobs = {k: repeated(g, arguments, calls[k]) for k, g in functions.items()}
    times = {k: 1e6 * t / calls[k] for k, t in medians(alternated(jobs, repetitions)).items()}
    difference = abs(float(f(*arguments)[0]) - float(callback(*arguments)[0]))
    return {**times, "compile s": seconds, "depth": float(f(*arguments)[0]), "difference": difference}


def main() -> None:
    """Measure the tools in turn."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=9)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = {name: measured(name, Path(folder), options.repetitions) for name in TOOLS}
    line = "; ".join(
        f"{name}: {m['C']:.1f} us in C, {m['interpreted']:.0f} interpreted, {m['callback']:.0f} by callback, "
        f"Jacobian {m['Jacobian in C']:.1f} in C"
        for name, m in found.items()
    )
    report("MPR is called at the cost of C, without a Python callback", line, {"us": rounded(found)})


if __name__ == "__main__":
    main()
