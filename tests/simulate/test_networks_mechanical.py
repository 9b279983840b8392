"""Random drive trains: those with one solution agree with a dense oracle, all others fail with a coded error."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import event, example, given, settings
from hypothesis import strategies as st

import acausal
from acausal import AcausalError, Component, Equations, connect, guess, part, structural
from acausal.library import rotational, translational
from tests.simulate.linear_oracle import Mechanics, Part

NODES = 5
STOP = 0.5

TRANSLATIONAL: dict[str, Any] = {
    "mass": lambda m, L, s, v: translational.Mass(m=m, L=L, s=guess(s), v=guess(v)),
    "rod": lambda L: translational.Rod(L=L),
    "spring": lambda c, s: translational.Spring(c=c, s_rel0=s),
    "damper": lambda d: translational.Damper(d=d),
    "fixed": lambda s: translational.Fixed(s0=s),
    "force": lambda f: translational.ConstantForce(f_constant=f),
}
ROTATIONAL: dict[str, Any] = {
    "mass": lambda m, L, s, v: rotational.Inertia(J=m, phi=guess(s), w=guess(v)),
    "gear": lambda r: rotational.IdealGear(ratio=r),
    "spring": lambda c, s: rotational.Spring(c=c, phi_rel0=s),
    "damper": lambda d: rotational.Damper(d=d),
    "fixed": lambda s: rotational.Fixed(phi0=s),
    "force": lambda f: rotational.ConstantTorque(tau_constant=f),
}
Plan = tuple[Part, ...]


class Train(Component):
    """Parts whose flanges meet at numbered junctions."""

    plan: Plan = structural()
    is_rotational: bool = structural(default=False)
    parts: list[Component] = part()

    def build(self) -> None:
        kit = ROTATIONAL if self.is_rotational else TRANSLATIONAL
        self.parts = [kit[p.kind](*p.values) for p in self.plan]

    def equations(self) -> Equations:
        junctions: dict[int, list[Any]] = {}
        for component, p in zip(self.parts, self.plan, strict=True):
            names = ("flange_a", "flange_b") if len(p.nodes) == 2 else ("flange",)
            for name, node in zip(names, p.nodes, strict=True):
                junctions.setdefault(node, []).append(getattr(component, name))
        for first, *others in junctions.values():
            for other in others:
                yield connect(first, other)


SIZES = st.sampled_from([0.5, 1.0, 2.0, 3.0])
PLACES = st.sampled_from([0.0, 0.5, -1.0])
NODE = st.integers(0, NODES - 1)
TWO = st.tuples(NODE, NODE)
ONE = st.tuples(NODE)


def plans(is_rotational: bool, most: int = 8) -> st.SearchStrategy[Plan]:
    """Anything anywhere, and trees that grow from a fixed point, which mostly have a solution."""
    lengths = st.just(0.0) if is_rotational else PLACES
    rigid = ("gear", st.tuples(SIZES)) if is_rotational else ("rod", st.tuples(PLACES))
    two = [
        ("mass", st.tuples(SIZES, lengths, PLACES, PLACES)),
        ("mass", st.tuples(SIZES, lengths, PLACES, PLACES)),
        ("spring", st.tuples(SIZES, PLACES)),
        ("damper", st.tuples(SIZES)),
        rigid,
    ]
    single = [("fixed", st.tuples(PLACES)), ("force", st.tuples(SIZES))]
    anywhere = [st.builds(Part, st.just(kind), TWO, values) for kind, values in two]
    anywhere += [st.builds(Part, st.just(kind), ONE, values) for kind, values in single]

    @st.composite
    def trees(draw: st.DrawFn) -> Plan:
        plan = [Part("fixed", (0,), draw(st.tuples(PLACES)))]
        for k in range(1, draw(st.integers(1, NODES - 1)) + 1):
            kind, values = draw(st.sampled_from(two))
            ends = (draw(st.integers(0, k - 1)), k)
            plan.append(Part(kind, ends[:: draw(st.sampled_from([1, -1]))], draw(values)))
        for _ in range(draw(st.integers(0, most // 3))):
            plan.append(draw(st.one_of(anywhere)))
        return tuple(draw(st.permutations(plan)))

    return st.one_of(trees(), trees(), st.lists(st.one_of(anywhere), min_size=1, max_size=most).map(tuple))


def compare(plan: Plan, is_rotational: bool) -> None:
    """One network against the oracle."""
    nodes = sorted({k for p in plan for k in p.nodes})
    place = {k: i for i, k in enumerate(nodes)}
    here = [Part(p.kind, tuple(place[k] for k in p.nodes), _oracle_values(p)) for p in plan]
    oracle = Mechanics(len(nodes), here)
    model = Train(plan=plan, is_rotational=is_rotational)
    event(f"regular: {oracle.is_regular()}")
    if not oracle.is_regular():
        with pytest.raises(AcausalError, match=r"AC[23]\d\d"):
            acausal.simulate(model, stop_time=STOP)
        return
    result = acausal.simulate(model, stop_time=STOP, tolerance=1e-10, output_interval=STOP / 4)
    s, v, a = ("phi", "w", "a") if is_rotational else ("s", "v", "a")
    flange = {k: (j, n) for j, p in enumerate(here) for k, n in zip(p.nodes, _flanges(p), strict=True)}
    q = np.array([result[f"parts[{j}].{name}.{s}"] for j, name in (flange[k] for k in range(len(nodes)))])
    masses = [
        (j, p, (oracle.unit(p.nodes[0]) + oracle.unit(p.nodes[1])) / 2) for j, p in enumerate(here) if p.kind == "mass"
    ]
    momentum = sum((p.values[0] * result[f"parts[{j}].{v}"][0] * e for j, p, e in masses), np.zeros(len(nodes)))
    q_end, v_end, force = oracle.solve(q[:, 0], momentum, STOP)
    scale = 1.0 + np.max(np.abs(q_end), initial=0.0) + np.max(np.abs(v_end), initial=0.0)
    np.testing.assert_allclose(q[:, -1], q_end, rtol=0, atol=1e-7 * scale)
    for j, _, e in masses:
        assert result.final(f"parts[{j}].{v}") == pytest.approx(e @ v_end, abs=1e-7 * scale)
    inertial = sum((p.values[0] * result.final(f"parts[{j}].{a}") * e for j, p, e in masses), np.zeros(len(nodes)))
    np.testing.assert_allclose(oracle.N.T @ inertial, force, rtol=0, atol=1e-6 * scale)


def _oracle_values(p: Part) -> tuple[float, ...]:
    return p.values[:2] if p.kind == "mass" else p.values


def _flanges(p: Part) -> tuple[str, ...]:
    return ("flange_a", "flange_b") if len(p.nodes) == 2 else ("flange",)


MASS = (1.0, 0.0, 0.0, 0.0)


@given(plans(is_rotational=False))
@example((Part("mass", (0, 1), (2.0, 0.5, 1.0, 0.5)), Part("spring", (1, 2), (3.0, 0.5)), Part("fixed", (2,), (0.0,))))
@example(
    (
        Part("damper", (0, 1), (1.0,)),
        Part("spring", (1, 2), (1.0, 0.0)),
        Part("fixed", (0,), (0.0,)),
        Part("force", (1,), (1.0,)),
        Part("fixed", (2,), (0.5,)),
    )
)
@example((Part("mass", (0, 0), MASS),))
@example((Part("rod", (0, 1), (0.5,)), Part("rod", (0, 1), (0.5,)), Part("mass", (0, 2), MASS)))
def test_translational(plan: Plan) -> None:
    compare(plan, is_rotational=False)


@given(plans(is_rotational=True))
@example((Part("gear", (0, 1), (2.0,)), Part("gear", (1, 0), (0.5,)), Part("mass", (0, 0), MASS)))
@example((Part("gear", (0, 1), (2.0,)), Part("gear", (1, 0), (2.0,)), Part("mass", (0, 2), MASS)))
def test_rotational(plan: Plan) -> None:
    compare(plan, is_rotational=True)


@pytest.mark.slow
@settings(max_examples=150)
@given(st.booleans(), st.data())
def test_many_trains(is_rotational: bool, data: st.DataObject) -> None:
    compare(data.draw(plans(is_rotational, most=14)), is_rotational)
