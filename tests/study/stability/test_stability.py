"""`acausal.stability` on systems whose eigenvalues, limits and verdicts are known in closed form."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from typer.testing import CliRunner

import acausal
from acausal import Component, Equations, Experiment, Real, cos, der, fixed, parameter, time, variable
from acausal.cli.main import app
from acausal.errors import UsageError
from acausal.study.stability.bdf import bdf_effects


class Contact(Component):
    """`explicit-penalty` of the stability scenes: m*s'' = -k*s - d*s', d = 2*zeta*sqrt(k*m)."""

    m: Real = parameter(default=10.0, unit="kg")
    k: Real = parameter(default=1e8, unit="N/m")
    zeta: Real = parameter(default=0.1, unit="1")
    s: Real = variable(default=fixed(1e-5), unit="m", nominal=1e-5)
    v: Real = variable(default=fixed(0.0), unit="m/s", nominal=1e-2)
    experiment: ClassVar[Experiment] = Experiment(stop_time=0.1)

    def equations(self) -> Equations:
        yield der(self.s) == self.v
        d = 2.0 * self.zeta * acausal.as_expr(self.k * self.m) ** 0.5
        yield self.m * der(self.v) == -self.k * self.s - d * self.v


class StiffLag(Component):
    """A lag of 0.1 ms behind a slow input, and a slow lag behind that."""

    om: Real = parameter(default=1.0, unit="rad/s")
    fast: Real = variable(default=fixed(2.0))
    slow: Real = variable(default=fixed(0.0))
    z: Real = variable(doc="Algebraic: eliminated for the eigenvalues")
    experiment: ClassVar[Experiment] = Experiment(stop_time=10.0, solver="rosenbrock")

    def equations(self) -> Equations:
        yield der(self.fast) == -1e4 * (self.fast - cos(self.om * time))
        yield der(self.slow) == self.z
        yield self.z + 0.1 * self.z**3 == self.fast - self.slow


def test_limits_of_a_damped_contact() -> None:
    """Euler 2*zeta/omega; RK4 and RK2 where |1 + z + ...| = 1 on the ray at the damping ratio."""
    study = acausal.stability(Contact(), points=5)
    omega = math.sqrt(1e8 / 10.0)
    assert study.largest_step("euler") == pytest.approx(2 * 0.1 / omega, rel=1e-6)
    ray = omega * complex(-0.1, math.sqrt(0.99))
    for name, order in (("rk2", 2), ("rk4", 4)):
        z = study.largest_step(name) * ray
        assert abs(sum(z**j / math.factorial(j) for j in range(order + 1))) == pytest.approx(1.0, abs=1e-6)
    assert study.largest_step("rosenbrock") == math.inf
    assert study.fastest_mode is not None
    assert study.fastest_mode.eigenvalue == pytest.approx(ray, rel=1e-6) or study.fastest_mode.eigenvalue.imag < 0
    assert set(study.fastest_mode.names) == {"s", "v"}
    assert study.fastest_mode.damping == pytest.approx(0.1, rel=1e-6)


def test_limits_are_confirmed_by_runs() -> None:
    """Disturbed runs of the tool's own solvers decay at 0.9 of the limit, grow at 1.1, by |R| in each step."""
    study = acausal.stability(Contact(zeta=0.5), points=5)
    explicit = [limit for limit in study.limits if limit.method.explicit]
    assert [limit.method.name for limit in explicit] == ["euler", "rk2", "rk4", "erk"]
    for limit in explicit:
        assert limit.confirmed
        assert limit.below is not None
        assert limit.above is not None
        assert limit.below.step == pytest.approx(0.9 * limit.largest_step)
        for run in (limit.below, limit.above):
            assert run.measured == pytest.approx(run.predicted, rel=1e-3)


def test_stiff_lags() -> None:
    """Eigenvalues -1e4 and -1/(1 + 0.3 z**2): between 1 and 1.2 apart from the start; ratio 1e4 at least."""
    study = acausal.stability(StiffLag())
    assert study.fastest_mode is not None
    assert study.fastest_mode.names == ("fast",)
    assert study.fastest_mode.eigenvalue == pytest.approx(-1e4, rel=1e-9)
    assert 1e4 <= study.stiffness_ratio < 3e4
    assert study.verdict.kind == "stiff"
    assert study.verdict.solver == "rosenbrock"
    avoided = {a.solver for a in study.verdict.avoid}
    assert {"rk2", "rk", "erk"} <= avoided
    assert {"trapezoidal rule", "implicit midpoint"} <= {a.method for a in study.verdict.avoid}


def test_bdf_on_an_undamped_oscillation() -> None:
    """Scene `undamped`, 1000 periods, IDAS with its order limited: damps with 1 and 2, grows with 3.

    Measured amplitudes at rtol 1e-6: 1e-23 or less, 0.9976, 1.168; at 1e-8 order 3: 1.005.
    """
    effects = {e.order: e for e in bdf_effects(1j, 2000.0 * math.pi, 1e-6)}
    assert effects[1].effect == "damps"
    assert effects[2].over_run == pytest.approx(0.9976, abs=5e-3)
    assert effects[3].over_run == pytest.approx(1.168, abs=0.03)
    assert bdf_effects(1j, 2000.0 * math.pi, 1e-8)[2].over_run == pytest.approx(1.005, abs=2e-3)


def test_requests_that_make_no_sense() -> None:
    with pytest.raises(UsageError, match="fixed steps"):
        acausal.stability(Contact(), solver="rk2")
    with pytest.raises(UsageError, match="too few"):
        acausal.stability(Contact(), points=1)


def test_command_line(tmp_path: Path) -> None:
    source = tmp_path / "contact.py"
    source.write_text(Path(__file__).read_text(encoding="utf-8"), encoding="utf-8")
    picture = tmp_path / "plane.png"
    run = CliRunner().invoke(
        app,
        ["stability", f"{source}:Contact", "--set", "zeta=1.5", "--points", "6", "--json", "--output", str(picture)],
    )
    assert run.exit_code == 0, run.output
    content = json.loads(run.stdout)
    assert len(content["points"]) == 6
    # zeta = 1.5: real eigenvalues omega*(-1.5 +- sqrt(1.25)), their ratio is (1.5 + sqrt(1.25))**2
    omega = math.sqrt(1e8 / 10.0)
    expected = omega * (-1.5 - math.sqrt(1.25))
    assert content["fastest_mode"]["eigenvalue"] == pytest.approx([expected, 0.0], rel=1e-6)
    assert content["stiffness_ratio"] == pytest.approx((1.5 + math.sqrt(1.25)) ** 2, rel=1e-6)
    assert content["largest_stable_step"]["rk2"] == pytest.approx(-2.0 / expected, rel=1e-6)
    assert content["verdict"]["solver"] in ("rosenbrock", "erk")
    assert picture.stat().st_size > 10_000


def test_text_names_states_and_numbers() -> None:
    text = str(acausal.stability(StiffLag(), points=4))
    assert "-1e+04 1/s" in text
    assert "fast (100 %)" in text
    assert "verdict: rosenbrock" in text


def test_point_count_and_eigenvalues_per_point() -> None:
    study = acausal.stability(StiffLag(), points=7)
    assert len(study.locals) == 7
    assert all(np.isfinite(local.eigenvalues).all() and len(local.eigenvalues) == 2 for local in study.locals)
