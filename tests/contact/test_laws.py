"""Normal laws against closed forms of the impact of one mass."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    as_expr,
    der,
    discrete,
    fixed,
    parameter,
    pre,
    reset,
    structural,
    variable,
    when,
)
from acausal.library.contact import DampedPowerLaw, Flores, HuntCrossley, KelvinVoigt, LankaraniNikravesh, NormalLaw


class Impact(Component):
    """A mass that flies 1.2345 mm and hits a wall."""

    law: NormalLaw = structural()
    m: Real = parameter(default=1.0, unit="kg")
    v_0: Real = parameter(default=1.0, unit="m/s")
    s: Real = variable(unit="m", default=fixed(-1.2345e-3))
    v: Real = variable(unit="m/s")
    f: Real = variable(unit="N")
    touches: Real = discrete()

    def equations(self) -> Equations:
        yield self.v == der(self.s)
        yield self.f == self.law.force(self.s, self.v)
        yield self.m * der(self.v) == -self.f
        yield when(self.s > 0, reset(self.touches, pre(self.touches) + 1))

    def initial_equations(self) -> Equations:
        yield self.v == self.v_0


def rebound(law: NormalLaw, stop_time: float, tolerance: float = 1e-10, **parameters: float) -> acausal.Result:
    return acausal.simulate(
        Impact(law=law),
        stop_time=stop_time,
        tolerance=tolerance,
        solver="rosenbrock",
        parameters=parameters,
        output_interval=stop_time / 200,
    )


@pytest.mark.parametrize(
    ("zeta", "restitution", "release"), [(0.05, 0.858758, 9.6303), (0.2, 0.571740, 8.8397), (0.5, 0.298436, 7.6476)]
)
def test_kelvin_voigt_does_not_pull(zeta: float, restitution: float, release: float) -> None:
    """Scene kv-tension of stability_scenes.json: m = 1 kg, k = 1e5 N/m, 1 m/s, force clipped at zero."""
    result = rebound(KelvinVoigt(k=1e5, d=2 * zeta * math.sqrt(1e5)), 0.02)
    assert result.final("v") == pytest.approx(-restitution, abs=6e-7)
    # nothing but what the force loses in the rounding of the instant of release
    assert result["f"].min() >= -1e-12 * result["f"].max()
    # touch after 1.2345 ms of flight; release where the force reaches zero with the bodies still overlapping
    instants = [e.time for e in result.events]
    assert min(abs(t - 1.2345e-3) for t in instants) < 1e-12
    assert min(abs(t - 1.2345e-3 - release * 1e-3) for t in instants) < 6e-8
    assert result.final("touches") == 1


@pytest.mark.parametrize(
    ("a", "u"),
    [(0.2, 0.88218998624730637932), (0.5, 0.74843493159743415812), (1.0, 0.59362426004004009232)],
)
@pytest.mark.parametrize(("m", "k", "n"), [(1.0, 1e5, 1.5), (3.0, 1e7, 1.0), (0.2, 1e6, 2.0)])
def test_restitution_of_power_laws(a: float, u: float, m: float, k: float, n: float) -> None:
    """Scene hunt-crossley: v0/a - ln(1 + a v0)/a^2 = -u/a - ln(1 - a u)/a^2, whatever m, k and n."""
    result = rebound(DampedPowerLaw(k=k, n=n, a=a), 0.2, 1e-8, m=m)
    assert result.final("v") == pytest.approx(-u, abs=1e-7)  # ten tolerances, as the scene demands


def test_damping_of_the_published_laws() -> None:
    """Factors as printed in the papers, at e = 0.8 and 2 m/s; and the restitution that Hunt-Crossley then gives."""
    given = {"k": 1e6, "e": 0.8, "v_0": 2.0}
    for law, a in (
        (HuntCrossley(**given), 1.5 * 0.2 / 2.0),
        (LankaraniNikravesh(**given), 0.75 * (1 - 0.64) / 2.0),
        (Flores(**given), 8 * 0.2 / (5 * 0.8 * 2.0)),
    ):
        v, u = 2.0, -rebound(law, 0.1, 1e-9, v_0=2.0).final("v")
        # the energy integrals of approach and rebound are equal (Hunt and Crossley, 1975)
        assert v / a - math.log(1 + a * v) / a**2 == pytest.approx(-u / a - math.log(1 - a * u) / a**2, rel=1e-6)
        assert 0.7 < u / v < 0.88


def test_undamped_laws_give_everything_back() -> None:
    result = rebound(DampedPowerLaw(k=1e6, n=1.5), 0.1)
    assert result.final("v") == pytest.approx(-1.0, abs=1e-9)


def test_a_parameter_of_the_owner_stays_a_parameter() -> None:
    class Owner(Component):
        k: Real = parameter(default=1e5, unit="N/m")
        s: Real = variable(unit="m")
        f: Real = variable(unit="N")

        def equations(self) -> Equations:
            yield self.s == 1e-3
            yield self.f == KelvinVoigt(k=self.k).force(self.s, as_expr(0.0))

    compiled = acausal.compile(Owner())
    assert "k" in compiled.parameters
    result = acausal.simulate(compiled, stop_time=1.0, parameters={"k": 2e5})
    np.testing.assert_allclose(result["f"], 200.0, rtol=1e-12)
