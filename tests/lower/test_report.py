"""The structure report: counts against those worked out by hand from the components' declarations."""

from __future__ import annotations

import acausal
from acausal import Component, Equations, Real, der, parameter, variable
from acausal.lower.report import state_reason, structure_report
from acausal.models.mass_chain import MassSpringDamperChain
from acausal.models.pendulum_chain import PendulumChain
from acausal.models.rc_ladder import RCLadder


class PlanarPendulum(Component):
    """Point mass on a rod, in x and y: index 3 (Pantelides 1988)."""

    L: Real = parameter(default=1.0, unit="m")
    g: Real = parameter(default=9.81, unit="m/s2")
    x: Real = variable(default=1.0, unit="m")
    y: Real = variable(default=0.0, unit="m")
    u: Real = variable(unit="m/s")
    v: Real = variable(unit="m/s")
    pull: Real = variable(unit="1/s2")

    def equations(self) -> Equations:
        yield der(self.x) == self.u
        yield der(self.y) == self.v
        yield der(self.u) == -self.pull * self.x
        yield der(self.v) == -self.pull * self.y - self.g
        yield self.x**2 + self.y**2 == self.L**2


def test_counts_of_a_ladder() -> None:
    """n sections keep n states; every unknown of the flat system is an unknown, or has been eliminated."""
    n = 7
    compiled = acausal.compile(RCLadder(n=n))
    report = structure_report(compiled)
    counts = {stage.name: stage.counts for stage in report.stages}
    assert list(counts) == ["flatten", "reduce", "analyse", "solve", "lower"]
    assert counts["flatten"]["equations"] == counts["flatten"]["unknowns"]
    assert counts["analyse"]["states"] == n
    assert counts["analyse"]["in the largest block"] == 1
    flat = compiled.flat
    kept = {s for s in compiled.solution.structure.reduced.scalar if s < flat.n_scalars}
    assert sum(report.eliminated.values()) == flat.n_scalars - len(kept)
    # the ground's potential, and with it the far end of each capacitor: one connection set, one scalar, 0 V
    assert report.eliminated["constant"] >= 1
    assert all(stage.seconds >= 0.0 for stage in report.stages)
    assert sum(s.seconds for s in report.stages) == report.seconds


def test_blocks_by_kind_and_size_cover_every_unknown() -> None:
    compiled = acausal.compile(PendulumChain(n=3))
    report = structure_report(compiled)
    unknowns = sum(len(b.columns) for b in compiled.solution.structure.blocks)
    assert sum(b.count * b.size for b in report.blocks) == unknowns
    assert sum(b.iterated for b in report.blocks) == len(compiled.algebraic)
    # the bodies' accelerations and joint forces: one linear block, as they all hang on each other
    assert report.blocks[0].kind == "linear"
    assert [b.size for b in report.blocks] == sorted((b.size for b in report.blocks), reverse=True)


def test_reasons_for_states() -> None:
    chain = structure_report(acausal.compile(MassSpringDamperChain(n=2)))
    assert {s.name for s in chain.states} == {"masses[0].s", "masses[0].v", "masses[1].s", "masses[1].v"}
    pendulum = structure_report(acausal.compile(PendulumChain(n=2)))
    reasons = {s.name: s.why for s in pendulum.states}
    assert set(reasons) == {"joints[0].phi", "joints[0].w", "joints[1].phi", "joints[1].w"}
    assert reasons["joints[1].w"] == "chosen: preferred by its declaration, its start is fixed"


def test_constraint_without_a_safe_choice_keeps_its_variables_as_states() -> None:
    """x and y both vanish somewhere on the circle, so neither is chosen: 4 states, position and velocity stabilised."""
    compiled = acausal.compile(PlanarPendulum())
    report = structure_report(compiled)
    assert report.differentiated == {2: 1}  # the constraint; u and v are derivatives of x and y by name
    analyse = next(s.counts for s in report.stages if s.name == "analyse")
    assert analyse["states"] == 4
    assert analyse["stabilised"] == 2
    structure = compiled.solution.structure
    assert {state_reason(structure, x) for x in structure.states} == {
        "no choice is safe everywhere: all variables of a stabilised constraint stay states"
    }


def test_report_as_text() -> None:
    text = str(structure_report(acausal.compile(PendulumChain(n=2))))
    assert text.startswith("PendulumChain: compiled in ")
    assert "linear blocks of" in text
    assert "variables eliminated as alias" in text
