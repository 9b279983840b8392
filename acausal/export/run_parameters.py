"""The values that parameters had in a run, as its result tells them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from acausal.errors import UsageError
from acausal.flatten.flat import suffixes
from acausal.lower.compiled import CompiledModel
from acausal.result.result import Result
from acausal.simulate.restructure.joined import renamed

# Relative difference up to which two values of a parameter are the same: files of other programs are rounded.
_SAME = 1e-6


@dataclass(frozen=True)
class RunParameters:
    """Parameters of a run.

    Attributes
    ----------
    free
        Values of the free parameters of the compiled model, by the names of their entries.
    replaced
        Parameters that the compiled model binds to others, and that had a value of their own in the run.
    notes
        Parameters that the result does not contain.
    """

    free: Mapping[str, float]
    replaced: Mapping[str, object]
    notes: tuple[str, ...] = ()

    def refuse_replaced(self, compiled: CompiledModel) -> None:
        """Raise UsageError AC022 if the run had values for which this model would have to be compiled again."""
        for name, value in self.replaced.items():
            raise UsageError(
                "AC022",
                f"{name} follows from other parameters in this compiled model, and had a value of its own in the run",
                help=f"compile again: acausal.compile(model, parameters={{{name!r}: {value!r}}})",
            )


def parameters_of_run(compiled: CompiledModel, result: Result, lasting: Mapping[str, str]) -> RunParameters:
    """The parameters of a run, in whose result contacts have their `lasting` names.

    Not every format of files says which signals are parameters, so names decide.
    """
    flat = compiled.flat
    found = {n: float(result[run][0]) for n in flat.parameter_names if (run := renamed(n, lasting)) in result.signals}
    # contacts that the run does not have at all have other names, and their declared values
    missing = [n for n in flat.parameter_names if n not in found and renamed(n, lasting) == n]
    p = [found.get(n, v) for n, v in zip(flat.parameter_names, flat.parameter_values, strict=True)]
    replaced: dict[str, object] = {}
    for bound in (parameter for parameter in flat.parameters if not parameter.free):
        shape = bound.declaration.shape
        names = [renamed(bound.path + s, lasting) for s in suffixes(shape)]
        if all(name in result.signals for name in names):
            own = np.array([result[name][0] for name in names])
            follows = np.array([flat.pool.parameter_value(node, p) for node in bound.nodes])
            if (np.isfinite(follows) & ~np.isclose(own, follows, rtol=_SAME, atol=0.0)).any():
                replaced[bound.path] = own.reshape(shape).tolist()
    listed = ", ".join(missing[:4]) + (f" and {len(missing) - 4} more" if len(missing) > 4 else "")
    return RunParameters(found, replaced, (f"the result does not contain {listed}: as declared",) if missing else ())
