"""Channels against closed forms of advection, diffusion and Fisher's front."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Expr, connect, part
from acausal.errors import DeclarationError
from acausal.library.fields import (
    Channel,
    ConcentrationExchange,
    FixedConcentration,
    FixedMolarFlow,
    LogisticChannel,
    PartialChannel,
)


class Alone(Component):
    """A channel with open or free ends."""

    channel: PartialChannel = part()
    made: Any = acausal.structural(default=None)

    def build(self) -> None:
        self.channel = self.made()


def run(made: Any, start: Any = None, **options: Any) -> acausal.Result:
    given = {} if start is None else {"channel.c_start": [float(c) for c in start]}
    return acausal.simulate(Alone(made=made), parameters=given, **{"tolerance": 1e-7, **options})


def profile(result: acausal.Result, n: int) -> Any:
    return np.array([result.final(f"channel.c[{k}]") for k in range(n)])


def middles(n: int) -> Any:
    return (np.arange(n) + 0.5) / n


def bump(n: int, at: float, wide: float) -> Any:
    return np.exp(-((middles(n) - at) ** 2) / (2.0 * wide**2))


@pytest.mark.parametrize("v", [0.2, -0.2])
def test_upwind_moves_with_the_flow_and_spreads_by_half_a_cell(v: float) -> None:
    """Upwind differences are advection with v dx/2 more diffusion: mean v t, variance 2 (D + v dx/2) t, exactly."""
    n, t = 100, 1.5
    at = 0.5 - v * t / 2.0
    start = bump(n, at, 0.05)
    result = run(lambda: Channel(n=n, v=v, D=1e-4, free_a=True, free_b=True), start, stop_time=t)
    x, c = middles(n), profile(result, n)
    assert c.sum() == pytest.approx(start.sum(), rel=1e-4)
    mean, before = (c * x).sum() / c.sum(), (start * x).sum() / start.sum()
    assert mean - before == pytest.approx(v * t, rel=1e-4)
    grown = (c * (x - mean) ** 2).sum() / c.sum() - (start * (x - before) ** 2).sum() / start.sum()
    assert grown == pytest.approx(2.0 * (1e-4 + abs(v) / n / 2.0) * t, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("v", "shape", "share"), [(0.2, "square", 0.4), (-0.2, "bump", 0.2)])
def test_the_limiter_makes_no_extremes_and_keeps_a_bump(v: float, shape: str, share: float) -> None:
    """Harten's theorem: a TVD scheme stays between the extremes of the start; it is nearer than upwind, too."""
    n, t = 100, 2.0
    at = 0.5 - v * t / 2.0
    start = bump(n, at, 0.05) if shape == "bump" else np.where(np.abs(middles(n) - at) < 0.1, 1.0, 0.0)
    errors = []
    for scheme in ("upwind", "van_leer"):
        made = lambda scheme=scheme: Channel(n=n, v=v, scheme=scheme, free_a=True, free_b=True)  # noqa: E731
        c = profile(run(made, start, stop_time=t), n)
        assert c.min() > -1e-5
        assert c.max() < 1.0 + 1e-5
        assert c.sum() == pytest.approx(start.sum(), rel=5e-4)  # a tail leaves
        errors.append(np.abs(c - np.roll(start, round(v * t * n))).mean())
    assert errors[1] < share * errors[0]


class Between(Component):
    """A channel between two conditions."""

    channel: Channel = Channel(n=40, D=1e-3, v=2e-3)
    first: Component = part()
    last: Component = part()
    ends: Any = acausal.structural(default=None)

    def build(self) -> None:
        self.first, self.last = self.ends()

    def equations(self) -> Equations:
        yield connect(self.first.port, self.channel.port_a)  # type: ignore[attr-defined]
        yield connect(self.channel.port_b, self.last.port)  # type: ignore[attr-defined]


def steady(ends: Any) -> acausal.Result:
    return acausal.simulate(Between(ends=ends), stop_time=1e5, tolerance=1e-8)


def test_between_two_concentrations_the_profile_is_exponential() -> None:
    """c = (exp(Pe x/L) - 1) / (exp(Pe) - 1), Pe = v L / D = 2; upwind sees Pe / (1 + Pe dx / (2 L))."""
    found = profile(steady(lambda: (FixedConcentration(c=0.0), FixedConcentration(c=1.0))), 40)
    exact = np.expm1(2.0 * middles(40)) / np.expm1(2.0)
    assert np.abs(found - exact).max() < 0.02


def test_what_goes_in_comes_out() -> None:
    """A flow of 1e-6 mol/s through exchange with k: c = n_flow / k outside of nothing at the end."""
    result = steady(lambda: (FixedMolarFlow(n_flow=1e-6), ConcentrationExchange(k=1e-6)))
    assert result.final("channel.port_a.n_flow") == pytest.approx(1e-6, rel=1e-9)
    assert result.final("channel.port_b.n_flow") == pytest.approx(-1e-6, rel=1e-6)
    assert result.final("channel.port_b.c") == pytest.approx(1.0, rel=1e-6)


def test_an_open_end_is_a_wall() -> None:
    start = bump(40, 0.3, 0.1)
    result = run(lambda: Channel(n=40, D=1e-3, v=5e-3), start, stop_time=2000.0)
    assert profile(result, 40).sum() == pytest.approx(start.sum(), rel=1e-6)


def test_fishers_front_runs_at_twice_the_root_of_growth_and_diffusion() -> None:
    """2 sqrt(k D) - 3/2 sqrt(D/k) / t (Bramson 1983), from a step; k = 1/s, D = 1e-4 m2/s."""
    n = 400
    start = np.where(middles(n) < 0.05, 1.0, 0.0)
    made = lambda: LogisticChannel(n=n, D=1e-4, k=1.0)  # noqa: E731
    result = run(made, start, stop_time=40.0, tolerance=1e-6)
    level = np.stack([result[f"channel.c[{k}]"] for k in range(n)], axis=1)

    def front(t: float) -> float:
        c = level[np.searchsorted(result.time, t - 1e-9)]
        k = int(np.argmax(c < 0.5))
        return float((k - 0.5 + (c[k - 1] - 0.5) / (c[k - 1] - c[k])) / n)

    speed = (front(32.0) - front(28.0)) / 4.0
    assert speed == pytest.approx(2.0 * np.sqrt(1e-4) - 1.5 * np.sqrt(1e-4) / 30.0, rel=0.01)


def test_a_reaction_of_ones_own() -> None:
    """Decay k = 2/s in every cell: exp(-2 t)."""

    class Decaying(PartialChannel):
        def equations(self) -> Equations:
            rate: Expr = acausal.quantity(2.0, "1/s")
            yield self.r == -rate * self.c

    result = run(lambda: Decaying(n=3, D=1e-4, c_start=1.0), stop_time=1.0)
    assert profile(result, 3) == pytest.approx(np.exp(-2.0), abs=1e-6)


def test_an_unknown_scheme_is_refused() -> None:
    with pytest.raises(DeclarationError, match="van_leer"):
        Channel(scheme="superbee")


class InSeries(Component):
    """A channel whose free end feeds another channel: the balance of neither counts what flows between them."""

    source: FixedConcentration = FixedConcentration(c=1.0)
    first: Channel = Channel(n=5, v=1.0, free_b=True)
    second: Channel = Channel(n=5, v=0.5, free_b=True)

    def equations(self) -> Equations:
        yield connect(self.source.port, self.first.port_a)
        yield connect(self.first.port_b, self.second.port_a)


def test_a_free_end_that_is_connected_is_refused() -> None:
    with pytest.raises(acausal.errors.AcausalError, match="port of a free end"):
        acausal.simulate(InSeries(), stop_time=1.0)
