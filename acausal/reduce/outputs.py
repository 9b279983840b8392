"""Names of requested outputs: the variables of a flat system that they select, and errors for unknown names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from acausal.errors import UsageError, meant
from acausal.flatten.flat import FlatSystem, suffixes


def output_scalars(flat: FlatSystem, names: Sequence[str]) -> dict[str, int]:
    """Flat scalar of every requested output by its full name; an array stands for all its entries.

    A name with `*` stands for all variables that match it; `time` is always available and adds nothing.

    Raises UsageError: AC010 for a name that is not a variable of the model, AC018 if no output is requested.
    """
    entries: dict[str, dict[str, int]] = {}
    for v in flat.variables:
        scalars = {v.path + s: v.first + k for k, s in enumerate(suffixes(v.declaration.shape))}
        entries[v.path] = scalars
        entries.update((name, {name: scalar}) for name, scalar in scalars.items())
    scalar_of: dict[str, int] = {}
    for name in (n.strip() for n in names):
        if name in entries:
            scalar_of |= entries[name]
        elif matching := fitting(name, entries):
            for entry in matching:
                scalar_of |= entries[entry]
        elif name != "time":
            raise _unknown(flat, name, list(entries))
    if not scalar_of:
        raise UsageError(
            "AC018",
            f"no output of {flat.name} is requested",
            help="name the requested variables, for example outputs=['" + next(iter(entries), "mass.s") + "']",
        )
    return scalar_of


def fitting(pattern: str, names: Iterable[str]) -> list[str]:
    """Names that match a pattern, in which `*` stands for any text; none if it contains no `*`."""
    if "*" not in pattern:
        return []
    # Not fnmatch: brackets are indices here.
    form = re.compile(".*".join(map(re.escape, pattern.split("*"))))
    return [name for name in names if form.fullmatch(name)]


def _unknown(flat: FlatSystem, name: str, known: list[str]) -> UsageError:
    parameters = {*flat.parameter_names, *(p.path for p in flat.parameters)}
    names_inside = [n for n in known if n.startswith(name + ".")]
    advice = None
    if name in parameters:
        advice = "it is a parameter: it depends on nothing, and can be read without a run"
    elif names_inside:
        advice = f"it is a component: name its variables, {', '.join(names_inside[:3])}, or all of them: {name}.*"
    return UsageError(
        "AC010",
        f"{flat.name} has no variable '{name}' that could be an output",
        evidence=meant(name, known),
        help=advice,
    )
