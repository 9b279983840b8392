"""Verdict of a stability study: recommended solver, reasons, and methods to avoid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from acausal.simulate.step_limit.amplification import METHODS
from acausal.study.stability.character import Character
from acausal.study.stability.findings import Finding
from acausal.study.stability.modes.bdf import BdfEffect
from acausal.study.stability.modes.limits import Limit
from acausal.study.stability.structure import Facts

# Up to this ratio of explicit to implicit steps an explicit method is cheaper, because it needs no matrices.
_WORTH = 4.0
# From this number of states IDAS is cheaper than rosenbrock (docs/devdocs/numerics.md).
_MANY = 100
# Number of periods from which the solution counts as an oscillation.
_PERIODS = 5.0
# A smaller stiffness is not reported: its median is meaningless for a solution at rest, whose rate of change consists
# of rounding errors.
_MEANINGFUL = 5.0


@dataclass(frozen=True)
class Avoided:
    """A method that fails or is inefficient on this run; `solver` if acausal has it."""

    method: str
    solver: str | None
    why: str

    def content(self) -> dict[str, object]:
        """For JSON."""
        return dict(vars(self))


@dataclass(frozen=True)
class Verdict:
    """The recommended solver, and why."""

    solver: str  # name of the recommended solver
    # `stiff`, `ringing` (a fast mode that the solution does not follow), `oscillating`, `smooth`, `static` (integrals
    # only), or `singular` (suitable solvers fail).
    kind: str
    # `why`, `avoid`: reasons, one sentence each, and methods to avoid.
    why: tuple[str, ...]
    avoid: tuple[Avoided, ...]
    findings: tuple[Finding, ...]  # further difficulties of this run, and their remedies

    def content(self) -> dict[str, object]:
        """For JSON."""
        return {
            "solver": self.solver,
            "kind": self.kind,
            "why": list(self.why),
            "avoid": [a.content() for a in self.avoid],
            "findings": [f.content() for f in self.findings],
        }


def kind_of(ch: Character) -> str:
    """The kind of problem."""
    if ch.fastest is None or ch.fastest.eigenvalue == 0.0:
        return "static"
    if ch.ringing is not None:
        return "ringing"
    if ch.explicit_steps > _WORTH * max(ch.steps, 20.0):
        return "stiff"
    if ch.oscillation is not None and ch.periods >= _PERIODS:
        return "oscillating"
    return "smooth"


def verdict(
    ch: Character,
    facts: Facts,
    limits: Sequence[Limit],
    bdf: Sequence[BdfEffect],
    findings: Sequence[Finding],
    states: int,
    span: float,
    run_solver: str,
    failed: Sequence[tuple[str, float]] = (),
) -> Verdict:
    """Choose a solver; `run_solver` made the run, the `failed` ones (solver, time [s]) did not finish it."""
    kind = kind_of(ch)
    large = states > _MANY
    by_name = {limit.method.name: limit for limit in limits}
    if kind == "stiff":
        solver, why = ("idas" if large else "rosenbrock"), _stiff(ch, large)
    elif kind == "ringing":
        solver, why = "rosenbrock", _ringing(ch)
    else:
        solver = "erk" if not facts.algebraic else ("idas" if large and kind == "smooth" else "rosenbrock")
        why = _gentle(kind, ch, facts)
    failure_times = dict(failed)
    if "rosenbrock" in failure_times and run_solver not in failure_times:
        kind, solver = "singular", run_solver
        when = failure_times["rosenbrock"]
        why = [f"rosenbrock fails at t = {when:.6g} s, where the equations are singular; {run_solver} passes by chance"]
    avoid = [*_explicit(kind, by_name, ch, span), *_undamping(kind, by_name, ch, span), *_multistep(kind, ch, bdf)]
    ruled_out = [Avoided(method, None, why_not) for f in findings for method, why_not in f.avoid]
    return Verdict(solver, kind, tuple(why), (*avoid, *ruled_out), tuple(findings))


def _beyond_rounding(damping: float) -> float:
    return abs(damping) if abs(damping) > 1e-9 else 0.0


def _stiff(ch: Character, large: bool) -> list[str]:
    assert ch.fastest is not None
    names = ", ".join(ch.fastest.names[:3]) or "many states"
    text = [
        f"the mode {ch.fastest.text} of {names} is {ch.stiffness:.2g} times faster than the solution changes"
        if ch.stiffness > _MEANINGFUL
        else f"the fastest mode {ch.fastest.text} of {names} has long decayed while the run goes on",
        f"stability requires {ch.explicit_steps:.3g} steps of an explicit method; this run took {ch.steps:.0f}",
    ]
    text.append(
        "BDF needs few evaluations, and the model is large"
        if large
        else "it is L-stable: fast modes are damped out in one step"
    )
    return text


def _ringing(ch: Character) -> list[str]:
    assert ch.ringing is not None
    names = ", ".join(ch.ringing.names[:3]) or "many states"
    return [
        f"{names} can oscillate at {ch.ringing.text} (damping ratio {_beyond_rounding(ch.ringing.damping):.2g}), "
        "but the solution does not follow it",
        "an L-stable one-step method damps it out and steps with the slow solution",
    ]


def _gentle(kind: str, ch: Character, facts: Facts) -> list[str]:
    if kind == "static":
        between = "between events " if facts.relations or facts.clauses else ""
        return [f"{between}no state has dynamics of its own: any method integrates it exactly or nearly so"]
    text = [f"stability requires at most {ch.explicit_steps:.3g} steps of an explicit method: the run is not stiff"]
    if kind == "oscillating" and ch.oscillation is not None:
        text = [
            f"the solution is an oscillation of {', '.join(ch.oscillation.names[:3])} at {ch.oscillation.text}, "
            f"about {ch.periods:.3g} periods with damping ratio {_beyond_rounding(ch.oscillation.damping):.2g}",
            "order 5 keeps its amplitude where BDF damps or amplifies it",
        ]
    if facts.algebraic:
        text.append(f"{facts.algebraic} algebraic unknowns: a method for DAEs needs no rootfinder per stage")
    return text


def _explicit(kind: str, limits: dict[str, Limit], ch: Character, span: float) -> list[Avoided]:
    found = []
    for method in (m for m in METHODS if m.explicit):
        limit = limits[method.name]
        names = "" if limit.mode is None else ", ".join(limit.mode.names[:2])
        by = "" if limit.usable_by is None else ", ".join(limit.usable_by.names[:2])
        if kind in ("stiff", "ringing") and math.isfinite(limit.usable_step):
            count = span / limit.usable_step if limit.usable_step else math.inf
            text = f"unstable above {limit.usable_step:.3g} s (mode of {by}): {count:.3g} steps for this run"
            found.append(Avoided(method.title, method.solver, text))
        elif limit.largest_step == 0.0 and method.name in ("euler", "rk2"):
            text = f"amplifies the undamped mode of {names} at any step, harmless below {limit.usable_step:.3g} s"
            found.append(Avoided(method.title, method.solver, text))
    return found


def _undamping(kind: str, limits: dict[str, Limit], ch: Character, span: float) -> list[Avoided]:
    """Implicit methods that do not damp fast modes."""
    if kind not in ("stiff", "ringing") or ch.fastest is None:
        return []
    step = span / max(ch.steps, 20.0)
    found = []
    for name in ("trapezoid", "implicit_midpoint", "gauss2", "lobatto3"):
        method = limits[name].method
        size = float(abs(complex(method.amplification(step * ch.fastest.eigenvalue))))
        if size > 0.5:
            order = "" if method.stiffly_accurate else ", and its order drops on stiff components"
            found.append(
                Avoided(
                    method.title, None, f"rings: {size:.4g} of a fast error remains after a step of {step:.2g} s{order}"
                )
            )
    return found


def _multistep(kind: str, ch: Character, bdf: Sequence[BdfEffect]) -> list[Avoided]:
    """IDAS and CVODES, where BDF damps or amplifies modes, or takes tiny steps."""
    if kind == "ringing":
        text = "BDF of order 3 to 5 is unstable near the imaginary axis: it has to resolve the fast oscillation"
        return [Avoided("BDF", "idas", text), Avoided("BDF", "cvodes", text)]
    # order 1 is left out: solvers of variable order do not stay there
    worst = [e for e in bdf if e.order > 1 and e.effect != "keeps"]
    if kind != "oscillating" or not worst:
        return []
    shown = "; ".join(f"order {e.order} x{e.over_run:.3g}" for e in worst)
    text = f"changes the amplitude over the run by {shown} (at this tolerance)"
    return [Avoided("BDF", "idas", text), Avoided("BDF", "cvodes", text)]
