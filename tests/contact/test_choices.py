"""A run never touches its model: contacts are chosen on frozen choices, whoever runs and how often."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, variable
from acausal.errors import AcausalError, UsageError
from acausal.flatten.instances.instances import instances
from acausal.library.contact import ContactBody, ContactScene, HalfSpace, HuntCrossley, Sphere, Surfaces
from acausal.lower.compile import DeferredModel
from acausal.models.contact_scenes import HolesSideBySide
from acausal.simulate.restructure import structures
from tests.contact.test_scene import ThrownBall
from tests.expected import fails_with


def state_of(model: acausal.Component) -> list[dict[str, Any]]:
    """All that the components of a model hold, but the symbols that were asked for."""
    held = (i.component.__dict__ for i in instances(model))
    return [
        {k: list(v) if isinstance(v, list) else dict(v) if isinstance(v, dict) else v for k, v in h.items()}
        for h in held
    ]


def test_a_run_leaves_the_model_as_it_was() -> None:
    model = ThrownBall(n=6, keep=2)
    before, flat = state_of(model), acausal.flatten(model)
    acausal.simulate(model, stop_time=0.1, solver="rosenbrock")
    acausal.compile(model, outputs=["ball.r_0"])
    after = state_of(model)
    for a, b in zip(before, after, strict=True):
        assert a.keys() == b.keys()
        for name in a.keys() - {"_symbols"}:
            if isinstance(a[name], list | tuple):
                assert len(a[name]) == len(b[name])
                assert all(x is y or x == y for x, y in zip(a[name], b[name], strict=True) if not hasattr(x, "op"))
    again = acausal.flatten(model)
    assert [v.path for v in again.variables] == [v.path for v in flat.variables]
    assert len(again.equations) == len(flat.equations)


@pytest.mark.slow
def test_the_second_run_and_a_compiled_one_are_as_the_first() -> None:
    model = ThrownBall(n=6, keep=2)
    compiled = acausal.compile(model)
    runs = [acausal.simulate(m, stop_time=0.15, solver="rosenbrock") for m in (model, model, compiled, compiled)]
    assert int(str(runs[0].stats["structures"])) > 1
    for run in runs[1:]:
        assert run.names == runs[0].names
        assert run.stats["structures"] == runs[0].stats["structures"]
        np.testing.assert_array_equal(run["ball.r_0"], runs[0]["ball.r_0"])
    # structures are kept for a model; other parameters have their own
    spent: Any = [run.stats["time"] for run in runs[:2]]
    assert "flatten" in spent[0]
    assert "flatten" not in spent[1]
    for m in (model, compiled):
        moved = acausal.simulate(m, stop_time=0.15, solver="rosenbrock", parameters={"v": 0.5})
        assert moved.final("ball.r_0[0]") < runs[0].final("ball.r_0[0]") - 0.05


RATE = {"x": 1.0}


class Fed(Component):
    """A throw beside an integral whose rate is written down outside of the model."""

    throw: ThrownBall = ThrownBall(n=1, keep=0)
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == RATE["x"]


def test_equal_models_share_what_was_made_and_others_do_not() -> None:
    """What a class reads outside of its instances counts: the integral of another rate is another one."""
    models = [Fed() for _ in range(2)]
    runs = [acausal.simulate(model, stop_time=0.01, solver="rosenbrock") for model in models]
    np.testing.assert_array_equal(runs[1]["throw.ball.r_0"], runs[0]["throw.ball.r_0"])
    made = [{id(own) for m, own in structures._structures.entries.values() if m is model} for model in models]
    assert made[0] == made[1] != set()
    RATE["x"] = 2.0
    other = acausal.simulate(Fed(), stop_time=0.01, solver="rosenbrock")
    assert runs[0].final("x") == pytest.approx(0.01)
    assert other.final("x") == pytest.approx(0.02)


def test_pairs_that_nobody_asks_for_are_not_compiled() -> None:
    """A run has those that are near, and only who looks at a compiled model has all."""
    compiled = acausal.compile(ThrownBall(n=1, keep=0))
    acausal.simulate(compiled, stop_time=0.01, solver="rosenbrock")
    assert isinstance(compiled, DeferredModel)
    assert not compiled.is_made
    assert "ball.v_0[0]" in compiled.states
    assert compiled.is_made


@pytest.mark.slow
def test_two_threads_do_not_disturb_each_other() -> None:
    """One model thrown at two speeds at a time: each as it goes alone."""
    model = ThrownBall(n=8, keep=2)
    speeds = (0.4, 1.0)
    found: dict[tuple[str, float], Any] = {}

    def run(how: str, v: float) -> None:
        found[how, v] = acausal.simulate(model, stop_time=0.3, solver="rosenbrock", parameters={"v": v})

    for v in speeds:
        run("alone", v)
    threads = [threading.Thread(target=run, args=("together", v)) for v in speeds]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for v in speeds:
        np.testing.assert_array_equal(found["together", v]["ball.r_0"], found["alone", v]["ball.r_0"])


def test_a_parameter_of_a_contact_keeps_its_contact() -> None:
    """Number 1 among all contacts is plate1, also while it is the only one left out; a wrong name is refused."""
    model = HolesSideBySide(n=2)
    values: Any = {p.path: p for p in acausal.flatten(model).parameters if p.free}
    name = next(n for n in values if n.startswith("scene.contacts[1].")).removeprefix("scene.contacts[1]")
    runs = [acausal.simulate(model, stop_time=0.9, parameters={f"scene.contacts[{k}]{name}": 0.012}) for k in (0, 1)]
    found = [run[f"scene.contacts[drill,plate0]{name}"] for run in runs]
    assert np.nanmax(found[0]) == 0.012
    assert np.nanmax(found[1]) != 0.012
    with fails_with(UsageError, "AC020"):
        acausal.simulate(model, stop_time=0.3, parameters={f"scene.contacts[1]{name}x": 1.0})


def refused(call: Any) -> str:
    with pytest.raises(AcausalError) as caught:
        call()
    return caught.value.code


@pytest.mark.slow
def test_holes_run_compiled_and_are_refused_where_equations_must_stay() -> None:
    """Two holes 20 mm apart: with the equations of one hole the second would not be cut."""
    model = HolesSideBySide(n=2)
    compiled = acausal.compile(model)
    result = acausal.simulate(compiled, stop_time=10.0)
    assert np.nanmax(result["scene.contacts[drill,plate0].s_tar"]) == pytest.approx(3e-3, rel=0.05)
    assert np.nanmax(result["scene.contacts[drill,plate0#1].s_tar"]) == pytest.approx(3e-3, rel=0.05)
    assert refused(lambda: acausal.simulate(model, accuracy=1e-4)) == "AC027"
    assert refused(lambda: acausal.bench(model)) == "AC027"
    assert refused(lambda: acausal.stability(model)) == "AC027"
    assert refused(lambda: acausal.linearize(model)) == "AC027"
    assert refused(lambda: acausal.step_function(compiled, step=1e-3)) == "AC027"
    assert refused(lambda: compiled.casadi()) == "AC027"


@pytest.mark.slow
def test_a_ball_lands_when_an_accuracy_is_asked_for() -> None:
    """It fell through the plates: the bench ran the structure with which runs begin, without contacts.

    Free fall would take it to 0.03 - g t^2 / 2 = 0.0177 m; its radius is 0.02 m.
    """
    result = acausal.simulate(ThrownBall(n=1, keep=0), stop_time=0.05, accuracy=1e-2)
    assert result["ball.r_0[2]"].min() > 0.0185


def test_contacts_of_many_pairs_are_made_when_all_are_asked_for() -> None:
    """40 balls have 780 pairs of their own and 40 with the ground; a flat system without choices has all."""
    scene = ContactScene(
        bodies=(
            ContactBody(name="ground", shape=HalfSpace(), at_rest=True),
            *(ContactBody(name=f"b{k}", shape=Sphere(0.05)) for k in range(40)),
        ),
        surfaces=Surfaces(law=HuntCrossley(k=1e5, n=1.5, e=0.7, v_0=0.5)),
    )
    assert len(scene.contacts) == 0
    assert len(scene.report().kept) == 820
    whole = scene.whole().applied()
    assert isinstance(whole, ContactScene)
    assert len(whole.contacts) == 820
    assert scene.whole().applied() is whole
    assert len(scene.contacts) == 0


def test_pairs_stay_while_they_hold_all_that_are_near() -> None:
    """Balls of radius 50 mm, 300 mm apart, over the ground: gaps in a skin of 20 mm have to be in the equations."""
    skin, radius = 0.02, 0.05
    balls = tuple(ContactBody(name=f"b{k}", shape=Sphere(radius)) for k in range(3))
    ground = ContactBody(name="ground", shape=HalfSpace(), at_rest=True)
    scene = ContactScene(
        bodies=(ground, *balls), surfaces=Surfaces(law=HuntCrossley(k=1e5, n=1.5, e=0.7, v_0=0.5)), skin=skin, keep=1
    )

    def seen(heights: tuple[float, ...], x: tuple[float, ...] = (0.0, 0.3, 0.6)) -> dict[str, Any]:
        places = {f"frames[{k}].r_0": np.array((x[k], 0.0, radius + h)) for k, h in enumerate(heights)}
        return {**places, **{f"frames[{k}].R": np.eye(3) for k in range(3)}}

    floating = scene.least(False).following(seen((0.03, 0.05, 0.09)))
    assert floating.pairs == ()
    assert floating.clearance == pytest.approx(0.03)
    # as many pairs as there are bodies, the nearest first; the balls are 0.2 m from each other
    one_near = floating.following(seen((0.01, 0.05, 0.09)))
    assert one_near.pairs == ((0, 1), (0, 2), (0, 3))
    assert one_near.clearance == pytest.approx(0.2)
    away = one_near.following(seen((0.09, 0.09, 0.09)))
    assert away.structure() == one_near.structure()
    # pairs that are left out are 0.2 m apart, and how much of that is used up is what they have come closer
    before = seen((0.09, 0.09, 0.09))

    def used(*instants: dict[str, Any]) -> np.ndarray[Any, Any]:
        return away.moved(before, {name: np.stack([at[name] for at in instants]) for name in before})

    aside, closer = seen((0.19, 0.19, 0.19)), seen((0.09, 0.09, 0.09), (0.0, 0.2, 0.6))
    assert used(before, aside) == pytest.approx([0.0, 0.0])
    assert used(before, seen((0.09, 0.09, 0.09), (0.05, 0.3, 0.6)))[1] >= 0.25
    # anywhere between two instants, and beyond them by as far as it came
    assert used(before, *(seen((0.09,) * 3, (0.0, 0.3 - 0.01 * k, 0.6)) for k in range(11)))[-1] == pytest.approx(0.55)
    # two balls that pass each other's places are never near at an instant
    assert used(before, closer, seen((0.09,) * 3, (0.2, 0.5, 0.6)))[-1] >= 1.0
    # two balls meet far above the ground: the pair is new, and the nearest others come with it
    meeting = away.following(seen((0.5, 0.5, 0.9), (0.0, 0.11, 0.6)))
    assert (1, 2) in meeting.pairs
    assert len(meeting.pairs) == 3


def test_a_scene_with_one_workpiece_looks_where_its_drill_is() -> None:
    """With no pair left out nothing else would end a choice, and a second hole would be the first one, gone on with."""
    scene = HolesSideBySide(n=1).scene
    moving = range(len(scene.moving))
    seen = {f"frames[{k}].r_0": np.zeros(3) for k in moving} | {f"frames[{k}].R": np.eye(3) for k in moving}
    chosen = scene.least(False).following(seen)
    assert len(chosen.pairs) == 1
    assert chosen.clearance == scene.skin
