"""Derivatives of random hybrid models against differences of tight runs.

They act at the start, at samples, at known instants and at relations; rates, algebraic equations, relations and actions
read states, parameters and what `pre` remembers.
"""

from __future__ import annotations

import random
from typing import Any

import numpy as np
import pytest

import acausal
from acausal.errors import AcausalError
from acausal.lower.compiled import CompiledModel
from tests.marks import seeds

PARAMETERS = ("p0", "p1", "p2", "p3")
STEP = 3e-5


def source(seed: int) -> tuple[str, list[str]]:
    """The text of a model, and its variables."""
    draw = random.Random(seed)
    states = [f"x{i}" for i in range(draw.randint(1, 3))]
    held = [f"d{j}" for j in range(draw.randint(0, 2))]
    lines = [f"{p}: Real = parameter(default={draw.uniform(0.3, 1.7):.3f})" for p in PARAMETERS]
    lines += [f"{x}: Real = variable(default=fixed({draw.uniform(-1, 1):.2f}))" for x in states]
    lines += [f"{d}: Real = discrete(default={draw.uniform(-1, 1):.2f})" for d in held]
    lines += ["z: Real = variable()", "", "def equations(self) -> Equations:"]

    def p() -> str:
        return f"self.{draw.choice(PARAMETERS)}"

    def x() -> str:
        return f"self.{draw.choice(states)}"

    def value() -> str:
        found = [p(), x(), f"{p()} * {x()}", f"({x()} - {p()})", f"sin({x()} * {p()})"]
        return draw.choice([*found, *[f"pre(self.{draw.choice(held)})" for _ in range(3) if held]])

    def relation() -> str:
        if draw.random() < 0.3:
            return f"(time > {draw.uniform(0.1, 1.8):.2f} * {p()})"
        other = draw.choice([p(), f"-{p()}", *[f"pre(self.{d})" for d in held]])
        return f"({x()} {draw.choice('<>')} {other})"

    said = [f"der(self.{v}) == -self.{v} * {p()} + 0.6 * {value()} + sin(2 * time * {p()})" for v in states]
    said[-1] += f" + where({relation()}, {value()}, {value()})"
    said.append(f"self.z + 0.2 * self.z**3 == {x()} * {p()} + {value()}")
    for v in draw.sample([*states, *held], min(2, len(states) + len(held))):
        new = value() if v in held else f"{p()} * pre(self.{v})"
        first = [relation(), "initial()", f"sample({p()} * 0.2, {p()} * 0.4)", "sample(0.25, 0.25)", "sample(0.0, 0.5)"]
        condition = draw.choice(first)
        if v in held and condition == "sample(0.25, 0.25)":  # a discrete equation says the same
            said.append(f"self.{v} == where({condition}, {new}, pre(self.{v}))")
        else:
            said.append(f"when({condition}, reset(self.{v}, {new}))")
    lines += [f"    yield {text}" for text in said]
    head = "from acausal import *\nfrom acausal import Component, Equations, Real\n\n\nclass Model(Component):\n"
    return head + "\n".join(f"    {line}" for line in lines) + "\n", [*states, *held, "z"]


@pytest.mark.slow
def test_derivatives_are_those_of_differences() -> None:
    """Where differences of two steps agree: those do not where an event passes another between them."""
    judged = 0
    for seed in seeds("0:12")[0]:
        text, names = source(seed)
        space: dict[str, Any] = {}
        exec(compile(text, "<random model>", "exec"), space)
        model = acausal.compile(space["Model"]())
        free = [name for name in PARAMETERS if name in model.parameters]
        asked = {"stop_time": 1.5, "tolerance": 1e-10}
        try:
            forward, adjoint = (
                acausal.sensitivities(model, free, names, method=way, **asked).final  # type: ignore[arg-type]
                for way in ("forward", "adjoint")
            )
            wide, narrow = (_differences(model, free, names, asked, h) for h in (3 * STEP, STEP))
        except AcausalError as error:
            if error.code not in ("AC615", "AC501"):
                raise
            continue
        sure = np.abs(wide - narrow) < 1e-3 * (1 + np.abs(narrow))
        judged += int(sure.sum())
        np.testing.assert_allclose(adjoint, forward, rtol=1e-6, atol=1e-6, err_msg=f"seed {seed}")
        off = np.abs(forward - narrow) / (1 + np.abs(narrow))
        assert off[sure].max(initial=0.0) < 2e-3, f"seed {seed}: {forward} for {narrow} of {names} by {free}\n{text}"
    assert judged > 60


def _differences(
    model: CompiledModel, free: list[str], names: list[str], asked: dict[str, float], h: float
) -> np.ndarray:
    columns = []
    for name in free:
        value = model.parameter_values[model.parameters.index(name)]
        ahead, behind = (
            acausal.simulate(model, parameters={name: value + s * h}, **asked)  # type: ignore[arg-type]
            for s in (1, -1)
        )
        columns.append([(ahead.final(v) - behind.final(v)) / (2 * h) for v in names])
    return np.array(columns, dtype=float).T
