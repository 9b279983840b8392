"""What parameters alone determine, split from equations that call functions."""

from __future__ import annotations

import casadi as ca
import numpy as np

import acausal
from acausal.library.contact import Capsule
from acausal.library.drilling import ConvexLevel, DrillingForce, Workpiece
from acausal.library.multibody import axis_rotation
from acausal.library.multibody.orientation import IDENTITY
from acausal.models.drilling_dynamic import ThickBlock
from acausal.simulate.native.equations import equations


class Bar(ThickBlock):
    """A drill against a bar with round ends, whose surface is found by a call and polished behind it."""

    def build(self) -> None:
        super().build()
        self.workpiece = Workpiece(t=0.05, r=(0.001, 0.002, 0.0), R_rel=axis_rotation((0.0, 1.0, 0.0), 0.1))
        level = ConvexLevel(Capsule(0.01, 0.05), ((0.0, 0.0, 0.035), IDENTITY), "bar")
        self.drill = DrillingForce(level=level, t=0.05, axis_a=(0.0, 0.0, 1.0), k=1e8, d_c=2e4)


def test_what_is_split_off_behind_calls_is_complete() -> None:
    """The split equations with their constants are the equations, as long as nothing refers to what is not given."""
    compiled = acausal.compile(Bar())
    dae, constants = equations(compiled)
    values = np.array(compiled.parameter_values)
    n = compiled.n_dynamic
    x = np.full(n, 1e-3)
    held = constants(values, [])
    numbers = ca.vertcat(held, ca.DM.zeros(dae.size1_in("p") - held.numel()))
    got = np.asarray(dae(0.0, x / np.array(compiled.nominal_x[:n]), [], numbers, [])[0]).ravel()
    state = np.concatenate([x, np.zeros(compiled.rhs.size1_in(1) - n)])
    wanted = np.asarray(compiled.rhs(0.0, state, [], [], values, np.zeros(compiled.rhs.numel_in("m")))[0]).ravel()[:n]
    np.testing.assert_allclose(got * np.array(compiled.nominal_x[:n]), wanted, rtol=1e-12)
