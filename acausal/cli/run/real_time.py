"""`acausal simulate --real-time-factor`: how the model would keep pace with a clock."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from acausal.cli.output.report import remark, say
from acausal.errors import AcausalError

if TYPE_CHECKING:
    from acausal.lower.compiled import CompiledModel
    from acausal.result.result import Result

_METHODS = {"rk2": "rk2", "rk": "rk4", "erk": "rk4"}
_MOST_STEPS = 200_000


def paces(compiled: CompiledModel, result: Result, step: float | None, inputs: Mapping[str, float]) -> dict[str, Any]:
    """The factor of the run itself, and of compiled fixed steps of its kind of method; simulated by computing time.

    Steps are those of the run, else of its experiment, else of 1 ms; each is timed. A model whose steps cannot be
    compiled has the reason in "failure".
    """
    import numpy as np

    from acausal.export.step.real_time import real_time
    from acausal.export.step.step import step_function

    times: Any = result.stats["time"]
    span = float(result.time[-1] - result.time[0])
    content: dict[str, Any] = {"run_factor": span / times["integrate"], "run_time": times["integrate"]}
    size = step or compiled.flat.experiment.step or min(1e-3, span / 10)
    own = _METHODS.get(str(result.stats["solver"]))
    count = min(round(span / size), _MOST_STEPS)
    states = [name for name in compiled.states[: compiled.n_dynamic] if name in result]
    # a Rosenbrock method is cheaper and more accurate, where it stays with the run
    for method in (own,) if own else ("rosenbrock", "sdirk"):
        try:
            made = step_function(compiled, size, method, [])
            u = np.array([inputs.get(port.name, port.start) for port in made.u])
            measured, x = real_time(made, max(count, 1), u=u)
        except AcausalError as error:
            return {**content, "failure": f"{error.code}: {error.fact}"}
        content |= measured.record()
        if count != round(span / size) or not states:
            break
        ends = dict(zip(made.x.names, x, strict=True))
        apart = {name: abs(ends[name] - float(result.final(name))) for name in states}
        worst = max(apart, key=lambda name: apart[name])
        largest = float(np.max(np.abs(result[worst])))
        content |= {"largest_difference": apart[worst], "worst_state": worst, "its_largest_value": largest}
        if measured.finite and all(d <= 0.1 * float(np.max(np.abs(result[n]))) for n, d in apart.items()):
            break
    return content


def say_paces(paced: Mapping[str, Any]) -> None:
    """The report for a person."""
    if not paced:
        return
    say(
        f"real time: the run took {1e3 * paced['run_time']:.3g} ms, "
        f"{paced['run_factor']:.4g} times faster than real time"
    )
    if "failure" in paced:
        remark(f"note: no compiled steps: {paced['failure']}")
        return
    say(
        f"  {paced['method']} at {paced['step']:g} s, compiled: {1e6 * paced['mean']:.3g} us a step, "
        f"{paced['factor']:.4g} times faster than real time"
    )
    say(
        f"  worst of {paced['steps']} steps {1e6 * paced['worst']:.3g} us (99.9 % below {1e6 * paced['p999']:.3g} us): "
        f"{paced['worst_factor']:.4g} times"
    )
    if not paced["finite"]:
        remark("note: these steps do not stay finite: the step is too large for this model and method")
    elif "largest_difference" in paced:
        say(
            f"  states end within {paced['largest_difference']:.2g} of the run's: {paced['worst_state']}, "
            f"whose largest value is {paced['its_largest_value']:.3g}"
        )
        if paced["largest_difference"] > 0.1 * paced["its_largest_value"]:
            remark("note: these steps do not follow the run: the step is too large for this model and method")
