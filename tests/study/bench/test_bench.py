"""The bench on models with closed forms: errors, order of methods, failures, recommendation."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Experiment,
    Real,
    der,
    fixed,
    integer,
    parameter,
    pre,
    reset,
    sample,
    terminate,
    variable,
    when,
)
from acausal.errors import IntegrationError, UsageError
from acausal.study.bench.report import Bench


class Swing(Component):
    """x = cos(w t)."""

    w: Real = parameter(default=2.0, unit="1/s")
    x: Real = variable(default=fixed(1.0), unit="m")
    v: Real = variable(default=fixed(0.0), unit="m/s")

    experiment: ClassVar[Experiment] = Experiment(stop_time=10.0)

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.w * self.w * self.x


class Stiff(Component):
    """x follows 1 at a rate of 1e6/s: explicit methods need steps below 2 us (2.8 us of order 4)."""

    x: Real = variable(default=fixed(0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=1.0)

    def equations(self) -> Equations:
        yield der(self.x) == 1e6 * (1.0 - self.x)


class Counter(Component):
    """Nothing but a number that a clock increases."""

    n: Real = integer()

    def equations(self) -> Equations:
        yield when(sample(0.0, 0.1), reset(self.n, pre(self.n) + 1))


@pytest.fixture(scope="module")
def swing() -> Bench:
    return acausal.bench(
        Swing,
        solvers=("idas", "rosenbrock", "rk2"),
        tolerances=(1e-4, 1e-8),
        steps=(0.01, 0.001),
        repeat=1,
        native=False,
    )


@pytest.mark.slow
def test_two_different_solvers_agree_on_the_reference(swing: Bench) -> None:
    reference = swing.reference
    assert reference.trusted_digits > 10
    assert len({name.split()[0] for name in reference.solvers}) == 2
    # closed form: x = cos 2t, v = -2 sin 2t
    end = dict(zip(reference.trajectory.names, reference.trajectory.values[-1], strict=True))
    assert end["x"] == pytest.approx(math.cos(20.0), abs=1e-10)
    assert end["v"] == pytest.approx(-2 * math.sin(20.0), abs=1e-10)


def test_errors_are_those_of_the_method(swing: Bench) -> None:
    heun = {r.case.step: r for r in swing.runs if r.case.solver == "rk2"}
    # Heun on x'' = -w^2 x is early by (w h)^2 / 6 per unit of time; w = 2, h = 0.01, the window's middle is 8.75 s.
    assert heun[0.01].distance is not None
    assert heun[0.01].distance.phase == pytest.approx(-8.75 * (2 * 0.01) ** 2 / 6, rel=0.03)
    # order 2
    assert heun[0.01].error / heun[0.001].error == pytest.approx(100.0, rel=0.1)
    # four evaluations of steps of 0.01 s in intervals of 0.05 s
    assert heun[0.01].counters["rhs_evaluations"] == 2000


def test_every_run_has_its_costs(swing: Bench) -> None:
    assert len(swing.runs) == 4 + 4
    for run in swing.runs:
        assert not run.failure
        assert run.solve_time > 0
        assert run.counters["steps"] > 0
    assert swing.notes == ("dae: the same equations as torn", "projected: the same equations as torn")
    assert {"build", "compile torn", "compile dae", "compile projected", "start"} <= swing.times.keys()


def test_the_cheapest_run_that_is_exact_enough(swing: Bench) -> None:
    advice = swing.recommend(1e-5)
    assert advice.run.error <= 1e-5
    good = [r for r in swing.runs if r.error <= 1e-5]
    assert advice.run.cost == min(r.cost for r in good)
    with pytest.raises(IntegrationError, match="AC411"):
        swing.recommend(1e-14)


@pytest.mark.slow
def test_failures_stay_with_their_reason(tmp_path: Path) -> None:
    found = acausal.bench(
        Stiff,
        solvers=("idas", "erk", "rk2"),
        tolerances=(1e-3, 1e-6),
        steps=(1e-3,),
        formulations=("torn",),
        repeat=1,
        time_limit=1.0,
        native=False,
    )
    by_name = {(r.case.series, r.case.tolerance): r for r in found.runs}
    # far beyond the largest stable step: refused, or not finite
    assert by_name["rk2", None].failure.startswith("AC40")
    assert by_name["erk fixed", None].failure.startswith("AC40")
    assert not by_name["idas", 1e-6].failure
    picture = tmp_path / "stiff.svg"
    found.plot(picture)
    text = picture.read_text()
    assert text.count("the solution is not finite") == 0 or "rk2" in text
    assert len(found.record()["runs"]) == 6
    assert sum(r["failed"] for r in found.record()["runs"]) >= 2


@pytest.mark.slow
def test_a_reference_can_be_given(tmp_path: Path) -> None:
    file = tmp_path / "end.json"
    file.write_text(
        json.dumps(
            {"reference": {"values": {"x": repr(math.cos(20.0)), "v": -2 * math.sin(20.0)}, "trusted_digits": 8}}
        )
    )
    options = {"solvers": ("rosenbrock",), "tolerances": (1e-6, 1e-12), "steps": (), "repeat": 1, "native": False}
    found = acausal.bench(Swing, reference=file, **options)  # type: ignore[arg-type]
    loose, tight = found.runs
    assert loose.distance is not None
    assert tight.distance is not None
    assert loose.error == loose.distance.end
    assert tight.distance.mescd == 8.0
    # the loose run is 2e-9 off: what it is measured by must be right to 2e-12
    fine = acausal.simulate(Swing(), solver="rosenbrock", tolerance=1e-12, output_interval=0.005)
    fine.save(tmp_path / "fine.npz")
    again = acausal.bench(Swing, reference=tmp_path / "fine.npz", **options)  # type: ignore[arg-type]
    assert again.runs[0].distance is not None
    assert again.runs[0].distance.end == pytest.approx(loose.distance.end, rel=1e-3)
    file.write_text('{"values": {"x": 1.0}}')
    with pytest.raises(UsageError, match="AC010"):
        acausal.bench(Swing, reference=file, **options)  # type: ignore[arg-type]


@pytest.mark.slow
def test_parameters_and_variables_are_taken() -> None:
    found = acausal.bench(
        Swing(),
        parameters={"w": 1.0},
        variables=("x",),
        solvers=("rosenbrock",),
        tolerances=(1e-8,),
        steps=(),
        repeat=1,
        stop_time=math.pi,
        native=False,
    )
    assert found.components == ("x",)
    np.testing.assert_allclose(found.reference.trajectory.values[-1], [-1.0], atol=1e-10)


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"solvers": ("euler",)}, "AC032"),
        ({"formulations": ("index2",)}, "AC024"),
        ({"tolerances": (2.0,)}, "AC041"),
        ({"repeat": 0}, "AC041"),
        ({"variables": ("y",)}, "AC010"),
    ],
)
def test_wrong_requests(options: dict[str, object], code: str) -> None:
    with pytest.raises(UsageError, match=code):
        acausal.bench(Swing, **options)  # type: ignore[arg-type]


def test_a_tolerance_asks_for_step_control_though_the_model_has_a_step() -> None:
    class Stepped(Swing):
        experiment: ClassVar[Experiment] = Experiment(stop_time=10.0, solver="erk", step=0.001)

    assert acausal.simulate(Stepped()).stats["steps"] == 10_000
    assert float(str(acausal.simulate(Stepped(), solver="erk", tolerance=1e-4).stats["steps"])) < 1000
    assert acausal.simulate(Stepped(), solver="rk2", tolerance=1e-4).stats["steps"] == 10_000


def test_a_dead_method_costs_its_limit_once(tmp_path: Path) -> None:
    reference = tmp_path / "end.json"
    reference.write_text('{"values": {"x": 1.0}}')
    found = acausal.bench(
        Stiff,
        solvers=("erk",),
        tolerances=(1e-3, 1e-5, 1e-7),
        steps=(),
        formulations=("torn",),
        reference=reference,
        repeat=1,
        time_limit=0.05,  # 3e5 steps take ten times as long
        stop_time=1.0,
        native=False,
        variables=("x",),
    )
    reasons = [run.failure for run in found.runs]
    assert reasons[0] == "no end after 0.05 s"
    assert reasons[1:] == ["not tried: no end after 0.05 s at tolerance 0.001"] * 2


@pytest.mark.slow
def test_exact_runs_stand_on_the_chart_too(tmp_path: Path) -> None:
    """A counter has no error at all: zero has no place on a logarithmic axis, and is drawn at the end of it."""
    found = acausal.bench(Counter(), solvers=["erk"], tolerances=[1e-4], steps=[], repeat=1, native=False)
    assert [run.error for run in found.runs] == [0.0]
    figure = found.plot(tmp_path / "counter.png")
    assert len(figure.axes[0].lines) == 1
    assert found.recommend(1e-6).run is found.runs[0]


class Ender(Component):
    """A lag that ends its run at ln 4."""

    x: Real = variable(default=fixed(1.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=2.0)

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield when(self.x < 0.25, terminate("done"))


@pytest.mark.slow
def test_a_run_that_the_model_ends_is_compared_on_the_grid_of_the_whole() -> None:
    found = acausal.bench(Ender(), solvers=["rosenbrock"], tolerances=[1e-6], steps=[], repeat=1, native=False)
    assert found.runs[0].error < 1e-5


def test_the_report_is_short_and_the_chart_says_all(tmp_path: Path) -> None:
    """Steps of a rate of 1e6/s that explicit methods cannot take, whatever their size: told once in the report."""
    found = acausal.bench(
        Stiff,
        solvers=("rosenbrock", "rk2", "erk"),
        tolerances=(1e-3, 1e-8),
        steps=(0.5, 0.05, 0.005),
        formulations=("torn",),
        repeat=1,
        time_limit=0.2,
        native=False,
    )
    lines = list(found.lines())
    assert lines[0].startswith("verdict: rosenbrock")
    assert len(lines) <= 10
    figure = found.plot(tmp_path / "stiff.svg")
    assert len(figure.axes) <= 3
    shown = " ".join(" ".join(text.get_text().split()) for text in figure.texts)
    for runs in found.failures().values():
        assert " ".join(runs[0].failure.split()) in shown
