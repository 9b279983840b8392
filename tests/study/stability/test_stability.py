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
from acausal import (
    Component,
    Equations,
    Experiment,
    Real,
    cos,
    der,
    fixed,
    guess,
    maximum,
    parameter,
    sin,
    sqrt,
    time,
    variable,
    where,
)
from acausal.cli.main import app
from acausal.errors import IntegrationError, UsageError
from acausal.study.stability.modes.bdf import bdf_effects


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
        [
            "stability",
            f"{source}:Contact",
            "--set",
            "zeta=1.5",
            "--points",
            "6",
            "--json",
            "--output-file",
            str(picture),
        ],
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
    study = acausal.stability(StiffLag(), points=4)
    short, whole = list(study.lines()), list(study.lines(details=True))
    assert short[0].startswith("verdict: rosenbrock (stiff)")
    assert whole[0] == short[0]
    assert len(short) <= 10
    assert "-1e+04 1/s" in str(study)
    assert any("fast (100 %)" in line for line in whole)
    assert "rk2" in next(line for line in short if "avoid" in line)


def test_point_count_and_eigenvalues_per_point() -> None:
    study = acausal.stability(StiffLag(), points=7)
    assert len(study.locals) == 7
    assert all(np.isfinite(local.eigenvalues).all() and len(local.eigenvalues) == 2 for local in study.locals)


class FloatingCapacitors(Component):
    """R - C - R chains as in Rentrop's amplifier: the sum of two equations holds no rate, index 1."""

    y: Real = variable(shape=4, default=guess((0.0, 1.0, 1.0, 0.0)))
    experiment: ClassVar[Experiment] = Experiment(stop_time=0.1)

    def equations(self) -> Equations:
        y = self.y
        yield 1e-6 * (der(y[1]) - der(y[0])) == (y[0] - sin(100.0 * time)) / 2e3
        yield 1e-6 * (der(y[0]) - der(y[1])) == y[1] / 5e3 - (2.0 - y[1]) / 5e3
        yield 3e-6 * (der(y[3]) - der(y[2])) == (y[2] - 2.0) / 4e3 + 1e-4 * y[1]
        yield 3e-6 * (der(y[2]) - der(y[3])) == y[3] / 7e3


class Parallel(Component):
    """Two storages, one filled through the other: flows follow from the rate of a constraint, index 2."""

    u: Real = variable(default=fixed(0.0))
    w: Real = variable()
    i: Real = variable()
    j: Real = variable()
    experiment: ClassVar[Experiment] = Experiment(stop_time=1.0)

    def equations(self) -> Equations:
        yield self.w == self.u + 0.1 * self.u**3
        yield self.i == 2.0 * der(self.u)
        yield self.j == 3.0 * der(self.w)
        yield self.i + self.j == cos(time) - self.u**3


@pytest.mark.parametrize(("model", "index"), [(FloatingCapacitors, 1), (Parallel, 2), (Contact, 0)])
def test_the_index_is_that_of_the_equations(model: type[Component], index: int) -> None:
    """By definition; higher than 1 is a constraint that BDF cannot be handed, 1 is none."""
    study = acausal.stability(model(), points=4, check=False)
    assert study.facts.index == index
    assert (index > 1) == any("BDF for the constraint" in a.method for a in study.verdict.avoid)


class Mixed(Component):
    """One relation that is an event, one that is not."""

    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))
    experiment: ClassVar[Experiment] = Experiment(stop_time=2.0)

    def equations(self) -> Equations:
        yield der(self.x) == where(self.x < 0.5, 1.0, 0.5)
        yield der(self.y) == maximum(self.x, 0.3)


def test_located_relations_and_others_are_told_apart() -> None:
    """In one statement: nothing is called located and not located."""
    study = acausal.stability(Mixed(), points=4, check=False)
    assert (study.facts.relations, study.facts.kinks) == (1, 1)
    facts = [f.fact for f in study.verdict.findings if f.kind in ("events", "kinks")]
    assert len(facts) == 1
    assert "1 relation of variables" in facts[0]
    assert "1 other" in facts[0]


class Orbit(Component):
    """Two bodies, 25 periods of 2 pi; one frozen eigenvalue has a positive real part at every point."""

    x: Real = variable(default=fixed(0.6))
    y: Real = variable(default=fixed(0.0))
    u: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(math.sqrt(1.4 / 0.6)))
    experiment: ClassVar[Experiment] = Experiment(stop_time=50.0 * math.pi, tolerance=1e-8)

    def equations(self) -> Equations:
        cubed = sqrt(self.x**2 + self.y**2) ** 3
        yield der(self.x) == self.u
        yield der(self.y) == self.v
        yield der(self.u) == -self.x / cubed
        yield der(self.v) == -self.y / cubed


@pytest.mark.slow
def test_what_a_study_says_of_an_orbit_is_what_its_run_does() -> None:
    """An error of the semi-axis leads to 1.5 T times as much at the end, T = 157; the advised solver arrives."""
    study = acausal.stability(Orbit(), points=12)
    assert study.growth is not None
    assert 1.5 * 50.0 * math.pi < study.growth.factor < 1e4
    a, b = (
        acausal.simulate(Orbit(), solver="rosenbrock", tolerance=1e-11, start={"x": 0.6 + d, "u": 0.0})
        for d in (0.0, 1e-7)
    )
    apart = max(abs(float(a.final(name)) - float(b.final(name))) for name in ("x", "y", "u", "v")) / 1e-7
    assert 0.05 * study.growth.factor < apart < 2.0 * study.growth.factor
    result = acausal.simulate(Orbit(), solver=study.verdict.solver)
    assert result.final("x") == pytest.approx(0.6, abs=1e-5)
    assert "no method" not in str(study)


def test_a_refused_step_and_the_study_name_one_limit() -> None:
    """Constant eigenvalues: the same number at every point, for a damped mode and for an undamped one."""
    for zeta in (0.3, 0.0):
        model = Contact(zeta=zeta)
        limit = next(q for q in acausal.stability(model, points=4, check=False).limits if q.method.name == "rk2")
        with pytest.raises(IntegrationError, match="AC405") as refused:
            acausal.simulate(model, solver="rk2", step=5e-3)
        assert f"is {limit.largest_step or limit.usable_step:.4g} s" in str(refused.value)


class Burst(Component):
    """y follows x, within 1 s and, for 5 ms at known times, within 10 us."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield der(self.y) == -where((time > 0.9) & (time < 0.905), 1e5, 1.0) * (self.y - self.x)


def test_a_mode_that_is_fast_between_two_known_times_limits_the_steps() -> None:
    """An explicit Euler step of a mode -1e5 1/s is stable up to 2e-5 s."""
    study = acausal.stability(Burst(), stop_time=2.0)
    assert "2e-05 s explicit Euler" in str(study)
