"""Result of a stability study, as an object, as JSON and as text."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from acausal.errors import counted
from acausal.providers import provided
from acausal.study.growth import Growth
from acausal.study.stability.character import Character
from acausal.study.stability.modes.bdf import BdfEffect
from acausal.study.stability.modes.limits import Limit
from acausal.study.stability.modes.modes import Local, Mode
from acausal.study.stability.structure import Facts
from acausal.study.stability.verdict import Verdict

_MOST_EIGENVALUES = 60
# Limits of the short report.
_MOST_NOTES, _LONGEST = 3, 108


@dataclass(frozen=True, eq=False)
class Stability:
    """Result of a stability study: which methods fail on a model, and why.

    Attributes
    ----------
    locals
        Eigenvalues at points of the run, the fastest first.
    limits
        Largest stable step of every fixed-step method.
    growth
        Growth of errors along the run; None if it cannot be measured.
    bdf
        (mode, effects of BDF of order 1 to 5) for oscillating modes.
    step
        The step [s] by which the plot scales the eigenvalues.
    """

    model: str
    solver: str
    tolerance: float
    span: float
    states: tuple[str, ...]
    locals: tuple[Local, ...]
    character: Character
    growth: Growth | None
    limits: tuple[Limit, ...]
    bdf: tuple[tuple[Mode, tuple[BdfEffect, ...]], ...]
    facts: Facts
    verdict: Verdict
    step: float

    def __repr__(self) -> str:
        return f"Stability({self.model}: {self.verdict.kind}, use {self.verdict.solver})"

    @property
    def stiffness_ratio(self) -> float:
        """Largest ratio max|Re|/min|Re| of decaying modes over the run."""
        return self.character.stiffness_ratio

    @property
    def fastest_mode(self) -> Mode | None:
        """The mode of largest |eigenvalue| over the run."""
        return self.character.fastest

    def largest_step(self, method: str) -> float:
        """Largest stable step [s] of a method by its name or its solver's: `euler`, `rk2`, `rk4`, `erk` ..."""
        return next(q.largest_step for q in self.limits if method in (q.method.name, q.method.solver))

    def content(self) -> dict[str, object]:
        """All results as a dictionary, for JSON."""
        ch = self.character
        return {
            **{name: getattr(self, name) for name in ("model", "solver", "tolerance", "span")},
            "states": list(self.states),
            "points": [
                {
                    "t": local.point.t,
                    "eigenvalues": [[v.real, v.imag] for v in local.eigenvalues[:_MOST_EIGENVALUES].tolist()],
                    "activity": local.activity,
                }
                for local in self.locals
            ],
            "stiffness_ratio": ch.stiffness_ratio,
            "stiffness_against_solution": ch.stiffness,
            "explicit_steps": ch.explicit_steps,
            "steps": ch.steps,
            "fastest_mode": None if ch.fastest is None else ch.fastest.content(),
            "ringing_mode": None if ch.ringing is None else ch.ringing.content(),
            "oscillation": None if ch.oscillation is None else {**ch.oscillation.content(), "periods": ch.periods},
            "growth": None if self.growth is None else self.growth.content(),
            "usable_step": {limit.method.name: limit.usable_step for limit in self.limits},
            "largest_stable_step": {limit.method.name: limit.largest_step for limit in self.limits},
            "methods": [limit.content() for limit in self.limits],
            "bdf": [{"mode": mode.content(), "orders": [e.content() for e in effects]} for mode, effects in self.bdf],
            "step": self.step,
            "verdict": self.verdict.content(),
        }

    def lines(self, details: bool = False) -> Iterator[str]:
        """The report as text: the verdict and its reasons in at most ten lines; with `details` everything."""
        judged = self.verdict
        yield f"verdict: {judged.solver} ({judged.kind}) for {self.model}, {self.span:g} s, run with {self.solver}"
        for text in judged.why if details else judged.why[:2]:
            yield f"  because  {text}"
        if self.growth is not None:
            yield f"  errors   {self.growth.text}"
        explicit = [limit for limit in self.limits if limit.method.explicit]
        if not details:
            if all(_step(q) == "any" for q in explicit):
                yield f"  steps    of any size are stable: {', '.join(map(_name, explicit))}"
            else:
                yield f"  steps    at most {', '.join(f'{_step(q)} {_name(q)}' for q in explicit)}"
            if shown := dict.fromkeys(a.solver for a in judged.avoid if a.solver):
                yield f"  avoid    {', '.join(shown)}"
            yield from self._noted()
            return
        for a in judged.avoid:
            yield f"  avoid    {a.method}{f' ({a.solver})' if a.solver else ''}: {a.why}"
        for f in judged.findings:
            yield f"  note     {f.fact}"
            yield f"           {f.remedy}"
        yield from self._numbers()

    def _noted(self) -> Iterator[str]:
        notes = [f.fact for f in self.verdict.findings if f.kind != "growing" or self.growth is None]
        yield from (f"  note     {_within(text)}" for text in notes[:_MOST_NOTES])
        if len(notes) > _MOST_NOTES:
            yield f"  note     {counted(len(notes) - _MOST_NOTES, 'more fact')} with --details"

    def _numbers(self) -> Iterator[str]:
        """Lines on measurements along the run, and on every method."""
        ch = self.character
        size = f"{counted(len(self.states), 'state')}, {counted(len(self.locals), 'point')}"
        yield f"  linear model along the run: {size}"
        if ch.fastest is not None:
            names = ", ".join(f"{n} ({100 * share:.0f} %)" for n, share in ch.fastest.states[:4])
            yield f"  fastest mode     {ch.fastest.text} at t = {ch.fastest.t:.4g} s, in {names or 'many states'}"
        yield f"  stiffness ratio  {ch.stiffness_ratio:.3g}; {ch.stiffness:.3g} against the solution's own changes"
        yield from _table(self.limits)
        for mode, effects in self.bdf[:2]:
            factors = ", ".join(f"{e.order}: x{e.over_run:.4g}" for e in effects)
            yield f"  BDF on {mode.text} ({', '.join(mode.names[:2])}), amplitude over the run by order  {factors}"

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def plot(self, file: str | Path | None = None) -> object:
        """Plot eigenvalues in the complex plane with the stability regions at `step`; returns a matplotlib figure."""
        drawn: object = provided("stability_picture")(self, file)
        return drawn


def _within(text: str) -> str:
    return text if len(text) <= _LONGEST else text[: _LONGEST - 4] + " ..."


def _name(limit: Limit) -> str:
    return limit.method.solver or limit.method.title


def _step(limit: Limit) -> str:
    """Text of the largest stable step; if undamped modes allow none, of the largest harmless one."""
    step = limit.largest_step or limit.usable_step
    return "any" if math.isinf(step) else f"{step:.3g} s"


def _table(limits: Sequence[Limit]) -> Iterator[str]:
    yield "  largest stable step, checked by runs at 0.9 and 1.1 of it (factor of a disturbance in one step)"
    for limit in limits:
        name = limit.method.title + (f" ({limit.method.solver})" if limit.method.solver else "")
        if not limit.method.explicit or math.isinf(limit.largest_step):
            note = "any" if limit.method.explicit else f"any; keeps {limit.rings:.0%} of infinitely fast modes"
            yield f"    {name:<38} {note}"
        elif limit.largest_step == 0.0:
            yield f"    {name:<38} none for an undamped mode; harmless below {limit.usable_step:.3g} s"
        else:
            checks = [c for c in (limit.below, limit.above) if c is not None]
            runs = ", ".join(f"x{c.measured:.4g}" for c in checks)
            doubt = "" if limit.confirmed in (True, None) else "   not confirmed: the mode changes within these steps"
            yield f"    {name:<38} {limit.largest_step:.4g} s   {runs}{doubt}"
