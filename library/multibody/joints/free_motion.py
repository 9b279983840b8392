"""The joint without constraints: coordinates of a free body."""

from __future__ import annotations

from acausal import Equations, Real, der, guess, rooted, variable
from acausal.library.multibody.interfaces import PartialJoint
from acausal.library.multibody.rotations import quaternion_rates, quaternion_rotation


class FreeMotion(PartialJoint):
    """Six degrees of freedom of frame_b relative to frame_a, with states relative to frame_a.

    Use it to state the motion of a body relative to a moving frame; motion relative to the world needs no joint.
    Start values: `r_rel_a`, `v_rel_a`, `Q`, `w_rel_b`.
    """

    r_rel_a: Real = variable(
        unit="m",
        shape=3,
        prefer_state=True,
        doc="From frame_a to frame_b, in frame_a",
        hint="nothing with mass moves with frame_b; connect a Body there",
    )
    v_rel_a: Real = variable(unit="m/s", shape=3, prefer_state=True, doc="Rate of r_rel_a, in frame_a")
    Q: Real = variable(
        unit="1",
        shape=4,
        prefer_state=True,
        default=guess((0.0, 0.0, 0.0, 1.0)),
        doc="Quaternion of frame_b relative to frame_a, vector part first",
    )
    w_rel_b: Real = variable(
        unit="rad/s", shape=3, prefer_state=True, doc="Angular velocity of frame_b relative to frame_a, in frame_b"
    )

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        R_rel = quaternion_rotation(self.Q)
        yield self.v_rel_a == der(self.r_rel_a)
        yield der(self.Q) == quaternion_rates(self.Q, self.w_rel_b)
        yield b.r_0 == a.r_0 + a.R @ self.r_rel_a
        if rooted(a):
            yield b.R == a.R @ R_rel
            yield b.w == R_rel.T @ a.w + self.w_rel_b
        else:
            yield a.R == b.R @ R_rel.T
            yield a.w == R_rel @ (b.w - self.w_rel_b)
        yield a.f == 0
        yield a.t == 0
        yield b.f == 0
        yield b.t == 0
