"""Values of parameters and inputs as a run is given them, by name, as the vectors that functions take."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from acausal.arrays import Vector
from acausal.errors import UsageError, meant
from acausal.flatten.flat import suffixes
from acausal.flatten.parameters import check_limit, check_values, entries
from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import values


def parameter_vector(compiled: CompiledModel, given: Mapping[str, object]) -> Vector:
    """Values of the free parameters, some replaced.

    Raises UsageError: AC020 for an unknown name, AC022 for a parameter that is bound to others in this compiled model,
    AC023 for a value that is no number or has another shape.
    Raises DeclarationError: AC136 for a value outside its limits, AC139 for values that do not go together.
    """
    p = np.array(compiled.parameter_values, dtype=float)
    index = {name: k for k, name in enumerate(compiled.parameters)}
    declared = {f.path: f for f in compiled.flat.parameters}
    for path, value in given.items():
        base = declared.get(path)
        names = [path + s for s in suffixes(base.declaration.shape)] if base is not None else [path]
        fixed = [n for n in names if n in compiled.flat.frozen]
        if fixed:
            raise UsageError(
                "AC022",
                f"{fixed[0]} was frozen when this model was compiled",
                help="compile anew without it in freeze, or with its new value",
            )
        if base is not None and not base.free:
            raise UsageError(
                "AC022",
                f"{path} follows from other parameters in this compiled model",
                help=f"set those, or compile anew: acausal.compile(model, parameters={{{path!r}: ...}})",
            )
        if names[0] not in index:
            raise UsageError(
                "AC020",
                f"there is no parameter '{path}'",
                evidence=meant(path, list(index)),
            )
        whole = declared.get(path if base is not None else path.rpartition("[")[0])
        shape, unit = base.declaration.shape if base is not None else (), whole.declaration.unit if whole else ""
        numbers = entries(path, shape, value, unit)
        for name, number in zip(names, numbers, strict=True):
            if whole is not None:
                check_limit(whole.path, name.removeprefix(whole.path), whole.declaration, number)
            p[index[name]] = number
    if given:
        check_values(compiled.flat, p.tolist())
    return p


def input_vector(compiled: CompiledModel, given: Mapping[str, float], unchecked: Collection[str] = ()) -> Vector:
    """Values of the model's inputs; what is missing has its declared default.

    `unchecked` are inputs whose numbers here are only placeholders.

    Raises UsageError: AC033 when one is missing, unknown or no finite number.
    Raises DeclarationError: AC136 for a value outside the limits of its input.
    """
    if not isinstance(given, Mapping):
        raise UsageError("AC033", f"inputs is a {type(given).__name__}", help="a dictionary: inputs={'u': 0.0}")
    unknown = [n for n in given if n not in compiled.inputs]
    scalars = dict(zip(compiled.inputs, compiled.flat.inputs, strict=True))
    missing = [n for n in compiled.inputs if n not in given and scalars[n] not in compiled.flat.starts]
    if unknown or missing:
        wanted = (missing or [*compiled.inputs, "u"])[0]
        fact = f"input {missing[0]} has no value" if missing else f"there is no input '{unknown[0]}'"
        raise UsageError(
            "AC033",
            fact,
            evidence=[f"inputs of {compiled.name}: {', '.join(compiled.inputs) or 'none'}"],
            help=f"inputs={{'{wanted}': 0.0}}, or --input {wanted}=0; or bind it in the model",
        )
    u = np.zeros(len(compiled.inputs))
    for k, name in enumerate(compiled.inputs):
        try:
            u[k] = given[name] if name in given else declared_input(compiled, scalars[name])
        except (TypeError, ValueError):
            u[k] = np.nan
        if not np.isfinite(u[k]):
            help = "one constant here; functions of time and data go with simulate(tolerance=...)"
            raise UsageError("AC033", f"input {name} = {given[name]!r} is not a finite number", help=help)
        if name not in unchecked:
            check_limit(name, "", compiled.flat.declaration(scalars[name]), float(u[k]))
    return u


def declared_input(compiled: CompiledModel, scalar: int) -> float:
    """Declared default of an input with the declared parameters; 0 where there is none."""
    start = compiled.flat.starts.get(scalar)
    if start is None:
        return 0.0
    leaves = {"par": compiled.parameter_values.__getitem__, "time": lambda _: compiled.flat.experiment.start_time}
    return float(values(compiled.flat.pool, [start.node], leaves)[start.node])
