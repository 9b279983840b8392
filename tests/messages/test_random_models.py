"""Random circuits and drive trains: they compile, or fail with a message that names a cause; nothing else."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import acausal
from acausal import AcausalError, Component, Equations, connect, part, structural
from acausal.library import electrical, rotational
from acausal.library.electrical import ConstantCurrent, ConstantVoltage, Diode, Ground, IdealTransformer
from tests.marks import slow_but

CIRCUIT: dict[str, Any] = {
    "R": lambda: electrical.Resistor(R=2.0),
    "C": lambda: electrical.Capacitor(C=1e-3),
    "L": lambda: electrical.Inductor(L=0.1),
    "V": lambda: ConstantVoltage(V=1.0),
    "I": lambda: ConstantCurrent(I=0.5),
    "D": Diode,
    "T": lambda: IdealTransformer(n=2.0),
    "G": Ground,
}
TRAIN: dict[str, Any] = {
    "J": lambda: rotational.Inertia(J=1.0),
    "c": lambda: rotational.Spring(c=10.0),
    "d": lambda: rotational.Damper(d=1.0),
    "G": lambda: rotational.IdealGear(ratio=3.0),
    "F": rotational.Fixed,
    "T": lambda: rotational.ConstantTorque(tau_constant=1.0),
    "w": lambda: rotational.Speed(w_ref=2.0),
}
ENDS = ("p", "n", "p1", "n1", "p2", "n2", "flange", "flange_a", "flange_b")

Plan = tuple[tuple[str, tuple[int, ...]], ...]


class Random(Component):
    """Parts by letter, each with the nodes that its connectors go to; -1 leaves a connector open."""

    plan: Plan = structural()
    of_circuit: bool = structural(default=True)
    parts: list[Component] = part()

    def build(self) -> None:
        kit = CIRCUIT if self.of_circuit else TRAIN
        self.parts = [kit[letter]() for letter, _ in self.plan]

    def equations(self) -> Equations:
        nodes: dict[int, list[Any]] = {}
        for component, (_, places) in zip(self.parts, self.plan, strict=True):
            ends = [getattr(component, name) for name in ENDS if name in component._parts]
            for end, node in zip(ends, places, strict=False):
                if node >= 0:
                    nodes.setdefault(node, []).append(end)
        for joined in nodes.values():
            if len(joined) > 1:
                yield connect(*joined)


def plans(letters: str) -> st.SearchStrategy[Plan]:
    """Up to seven parts on up to four nodes."""
    places = st.tuples(*[st.integers(-1, 3)] * 4)
    return st.lists(st.tuples(st.sampled_from(letters), places), min_size=1, max_size=7).map(tuple)


def outcome(model: Component) -> str:
    """The code of the error, or nothing; every error has a cause or a help, and a place in this file or the library."""
    try:
        acausal.compile(model)
    except AcausalError as error:
        found = error
    else:
        return ""
    assert str(found).splitlines()[1].startswith("  at      "), found
    assert found.help, found
    return found.code


def check_circuit(plan: Plan) -> None:
    code = outcome(Random(plan=plan))
    assert code == "" or code.startswith("AC20"), code
    if not any(letter == "G" for letter, _ in plan):
        assert code, "a circuit without ground cannot be determined"


def check_drive_train(plan: Plan) -> None:
    code = outcome(Random(plan=plan, of_circuit=False))
    assert code == "" or code.startswith("AC20"), code


CHECKS = {"RRCLVIDTG": check_circuit, "JJcdGFTw": check_drive_train}


@pytest.mark.parametrize("count", slow_but([30, 150], 30))
@pytest.mark.parametrize("letters", CHECKS, ids=["circuits", "drive trains"])
def test_random_models(letters: str, count: int) -> None:
    checked = given(plans(letters))(CHECKS[letters])
    settings(max_examples=count, suppress_health_check=[HealthCheck.too_slow])(checked)()
