"""Stability functions of the fixed-step methods, and the refusal of steps that amplify a mode."""

from __future__ import annotations

import math
from typing import ClassVar

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Experiment, Real, cos, der, fixed, parameter, part, time, variable, where
from acausal.errors import IntegrationError
from acausal.simulate.step_limit.amplification import METHODS, Method
from acausal.simulate.step_limit.state_matrix import StateMatrix


class StiffAndTurning(Component):
    """A fast decay beside an undamped oscillation: eigenvalues -1e4 and +-i."""

    om: Real = parameter(default=1.0, unit="rad/s")
    fast: Real = variable(default=fixed(2.0))
    y: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=1.0)

    def equations(self) -> Equations:
        yield der(self.fast) == -1e4 * (self.fast - cos(self.om * time))
        yield der(self.y) == self.v
        yield der(self.v) == -self.y


class LoopAndIntegral(Component):
    """An algebraic loop z**3 + z = x, x' = -z, and an integral of x: eigenvalues -1/(1 + 3*z**2) and 0."""

    x: Real = variable(default=fixed(2.0))
    y: Real = variable(default=fixed(0.0))
    z: Real = variable()

    def equations(self) -> Equations:
        yield self.z**3 + self.z == self.x
        yield der(self.x) == -self.z
        yield der(self.y) == self.x


class Decay(Component):
    """One eigenvalue, -1."""

    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -self.x


class Ramp(Component):
    """Two integrals in a row: no eigenvalue but zero, whatever the numbers."""

    x: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == 1.0


def state_matrix(model: Component) -> StateMatrix:
    compiled = acausal.compile(model)
    return StateMatrix(compiled, np.array(compiled.parameter_values, dtype=float), np.zeros(0))


def test_spectra_of_many_points_are_those_of_each() -> None:
    """-1/(1 + 3*z**2) at z = 1 and z = 2, by the implicit function theorem; nan where something is not finite."""
    matrix = state_matrix(LoopAndIntegral())
    assert len(matrix.compiled.algebraic) == 1
    x, z = np.array([[2.0, 10.0, np.nan], [0.0, 0.0, 0.0]]), np.array([[1.0, 2.0, 0.0]])
    spectra = matrix.spectra(np.zeros(3), x, z, np.zeros((0, 3)))
    for k, expected in enumerate((-1.0 / 4.0, -1.0 / 13.0)):
        assert sorted(spectra[k].real) == pytest.approx([expected, 0.0])
        one = matrix.eigenvalues(0.0, x[:, k], z[:, k], np.zeros(0))
        assert one is not None
        assert sorted(one.real) == pytest.approx(sorted(spectra[k].real))


def test_chains_of_integrals_are_inert() -> None:
    assert state_matrix(Ramp()).inert
    assert not state_matrix(LoopAndIntegral()).inert
    assert not state_matrix(StiffAndTurning()).inert


def method(name: str) -> Method:
    return next(m for m in METHODS if m.name == name)


# Real axis: Hairer and Wanner, Solving Ordinary Differential Equations II, section IV.2: 2, 2, 2.785. Imaginary axis:
# none for Euler and order 2, 2*sqrt(2) for RK4. Both as `explicit-penalty` of the stability scenes states them.
@pytest.mark.parametrize(
    ("name", "real", "imaginary"),
    [("euler", 2.0, 0.0), ("rk2", 2.0, 0.0), ("rk4", 2.785293563, math.sqrt(8.0)), ("rosenbrock", math.inf, math.inf)],
)
def test_radii_are_those_of_the_books(name: str, real: float, imaginary: float) -> None:
    assert method(name).radius(math.pi) == pytest.approx(real, rel=1e-8)
    assert method(name).radius(0.5 * math.pi) == pytest.approx(imaginary, rel=1e-8)


@pytest.mark.parametrize("m", METHODS, ids=lambda m: m.name)
def test_amplification_is_of_its_order(m: Method) -> None:
    """R(z) = exp(z) + O(z**(order + 1)), by the definition of order."""
    errors = [abs(complex(m.amplification(z)) - np.exp(z)) for z in (0.2 + 0.2j, 0.1 + 0.1j)]
    assert math.log2(errors[0] / errors[1]) > m.order + 0.8


@pytest.mark.parametrize("plugin", ["erk", "rosenbrock"])
@pytest.mark.parametrize("z", [-0.7 + 2.1j, -5.0 + 0.3j, 1.5j])
def test_amplification_is_that_of_the_solver(plugin: str, z: complex) -> None:
    """One step of CasADi's integrator on y' = lambda*y, written in real and imaginary part."""
    y = ca.SX.sym("y", 2)
    rate = ca.vertcat(z.real * y[0] - z.imag * y[1], z.imag * y[0] + z.real * y[1])
    one = ca.integrator("one", plugin, {"x": y, "ode": rate}, 0.0, [1.0], {"step_size": 1.0})
    end = np.array(one(x0=[1.0, 0.0])["xf"]).ravel()
    assert complex(*end) == pytest.approx(complex(method(plugin).amplification(z)), rel=1e-10)


@pytest.mark.parametrize(("solver", "limit"), [("rk2", 2e-4), ("rk", 2.785293563e-4), ("erk", 3.4373676e-4)])
def test_steps_above_the_limit_are_refused(solver: str, limit: float) -> None:
    compiled = acausal.compile(StiffAndTurning())
    with pytest.raises(IntegrationError) as refused:
        acausal.simulate(compiled, solver=solver, step=1.1 * limit, output_interval=1.1 * limit)
    error = refused.value
    assert error.code == "AC405"
    assert f"{limit:.4g}"[:5] in error.fact
    assert "in the states fast" in error.evidence[0]
    below = acausal.simulate(compiled, solver=solver, step=0.9 * limit, stop_time=0.1, output_interval=0.9 * limit)
    assert below.final("fast") == pytest.approx(math.cos(0.1), abs=2e-5)


def test_force_runs_it_all_the_same() -> None:
    result = acausal.simulate(StiffAndTurning(), solver="rk2", step=4e-4, stop_time=2e-3, force=True)
    assert np.isfinite(result.final("fast"))
    result = acausal.simulate(
        StiffAndTurning(), solver="rk2", step=4e-4, output_interval=4e-4, stop_time=8e-3, force=True
    )
    assert abs(float(result["fast"][-1])) > 1e10


def test_harmless_growth_of_an_undamped_mode_passes() -> None:
    """Heun's method amplifies every undamped mode, by (h*omega)**4/8 a step: 1e-13 at 1 ms; nobody has to know."""
    result = acausal.simulate(StiffAndTurning(), solver="rk2", step=1e-4, output_interval=1e-2)
    assert result.final("y") == pytest.approx(math.sin(1.0), abs=1e-8)


@pytest.mark.parametrize(("solver", "limit"), [("rk2", 2.0), ("rk", 2.785)])
def test_a_step_longer_than_the_default_rows_is_taken_as_it_is(solver: str, limit: float) -> None:
    """x' = -x from 1 over 100 s: rows every 0.2 s would hide that the step is unstable; limits are Hairer, Wanner's."""
    good = acausal.simulate(Decay(), stop_time=100.0, solver=solver, step=0.9 * limit)
    assert len(good.time) == math.ceil(100.0 / (0.9 * limit)) + 1
    assert abs(float(good.final("x"))) < 1e-3
    with pytest.raises(IntegrationError, match="AC405"):
        acausal.simulate(Decay(), stop_time=100.0, solver=solver, step=1.1 * limit)
    grown = acausal.simulate(Decay(), stop_time=100.0, solver=solver, step=1.1 * limit, force=True)
    assert abs(float(grown.final("x"))) > 1e3
    # rows that were asked for are kept, by shorter steps
    asked = acausal.simulate(Decay(), stop_time=100.0, solver=solver, step=1.1 * limit, output_interval=0.5)
    assert len(asked.time) == 201


class Relay(Component):
    """Slides on the line x + v/100 = 0 from 0.33 s on, where x' = -100 x; its branches are double integrals."""

    x: Real = variable(default=fixed(0.01))
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == where(self.x + 0.01 * self.v > 0, -3.0, 3.0)


@pytest.mark.parametrize(("solver", "bound"), [("rk2", 0.02), ("rk", 0.02785)])
def test_the_mode_of_a_sliding_mode_limits_the_step(solver: str, bound: float) -> None:
    """2/100 s and 2.785/100 s (Hairer and Wanner), by the run and by `stability`; the branches have no limit."""
    with pytest.raises(IntegrationError, match=rf"(?s)AC405.* is {bound:.4g} s.*-100 1/s"):
        acausal.simulate(Relay(), solver=solver, step=1.2 * bound, stop_time=2.0)
    run = acausal.simulate(Relay(), solver=solver, step=0.9 * bound, stop_time=2.0)
    assert run["x"][-1] == pytest.approx(0.0, abs=1e-6)


class Relays(Component):
    """Five of them: systems that share no equation are run apart."""

    relays: tuple[Relay, ...] = part()

    def build(self) -> None:
        self.relays = tuple(Relay() for _ in range(5))


@pytest.mark.parametrize("model", [Relay, Relays])
def test_stability_sees_the_mode_of_a_sliding_mode(model: type[Component]) -> None:
    """-100 1/s on the line."""
    study = acausal.stability(model(), stop_time=2.0, tolerance=1e-6)
    assert study.fastest_mode is not None
    assert study.fastest_mode.eigenvalue == pytest.approx(-100.0)
    assert study.largest_step("rk2") == pytest.approx(0.02)
