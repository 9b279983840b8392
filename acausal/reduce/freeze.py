"""Parameters replaced by numbers: a new value needs a compilation, but zeros and ones simplify the equations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from acausal.analyse.aliases import reduce
from acausal.errors import UsageError, meant
from acausal.flatten.flat import FlatSystem, suffixes, translated
from acausal.flatten.pool import Pool
from acausal.flatten.reduced import nominal
from acausal.reduce.outputs import fitting

ZEROS = "zeros"
"""Freezes every parameter whose value is zero, entry by entry."""


def freeze(flat: FlatSystem, names: Sequence[str]) -> FlatSystem:
    """The flat system with the named parameters replaced by numbers, in a new pool.

    Raises UsageError: AC020 for a name that is neither parameter nor component.

    `names` are parameters, entries of array parameters (`body.r_CM[1]`), components (for all their parameters),
    patterns with `*`, or "zeros" for all entries whose value is zero.
    """
    frozen = sorted(_frozen(flat, names))
    if not frozen:
        return flat
    removed = set(frozen)
    kept = [k for k in range(len(flat.parameter_values)) if k not in removed]
    number = {k: i for i, k in enumerate(kept)}
    old, new = flat.pool, Pool()
    new.new_variables(old.n_variables)
    new.derivative_of.update(old.derivative_of)
    new.integral_of.update(old.integral_of)
    image: dict[int, int] = {}
    for k, (op, *index) in enumerate(old.nodes):
        if op == "var":
            image[k] = new.var(index[0])
        elif op == "par":
            image[k] = new.const(flat.parameter_values[index[0]]) if index[0] in removed else new.par(number[index[0]])
    new.copy(old, range(len(old.nodes)), image)
    new.slope.update((v, image[n]) for v, n in old.slope.items())
    return replace(
        translated(flat, new, image),
        parameter_values=tuple(flat.parameter_values[k] for k in kept),
        nominals=flat.nominals or _nominals(flat),
        frozen=(*flat.frozen, *(flat.parameter_names[k] for k in frozen)),
    )


def _nominals(flat: FlatSystem) -> tuple[float, ...]:
    """Magnitude of every scalar before any parameter is frozen."""
    reduced = reduce(flat)
    sizes = [flat.declaration(s).nominal for s in range(flat.n_scalars)]
    for v, scalars in reduced.aliases.items():
        size = nominal(reduced, v)
        for s in scalars:
            sizes[s] = size
    return tuple(sizes)


def _frozen(flat: FlatSystem, names: Sequence[str]) -> set[int]:
    """Indices of the free parameter scalars that the names select."""
    entries: dict[str, list[int]] = {}
    for p in flat.parameters:
        free_nodes = [flat.pool.nodes[n] for n in p.nodes]
        numbers = [n[1] for n in free_nodes if n[0] == "par"] if p.free else []
        entries[p.path] = numbers
        if p.free:
            for suffix, node in zip(suffixes(p.declaration.shape), free_nodes, strict=True):
                entries.setdefault(p.path + suffix, [node[1]] if node[0] == "par" else [])
        for owner in _owners(p.path):
            entries.setdefault(owner, []).extend(numbers)
    indices: set[int] = set()
    for name in (n.strip() for n in names):
        if name in entries:
            indices.update(entries[name])
        elif name == ZEROS:
            indices.update(k for k, v in enumerate(flat.parameter_values) if v == 0.0)
        elif matching_names := fitting(name, entries):
            indices.update(k for e in matching_names for k in entries[e])
        else:
            raise _unknown(flat, name, list(entries))
    return indices


def _owners(path: str) -> list[str]:
    """Paths of the components around a parameter, except the model itself."""
    parts = path.split(".")[:-1]
    return [".".join(parts[: k + 1]) for k in range(len(parts))]


def _unknown(flat: FlatSystem, name: str, known: list[str]) -> UsageError:
    variables = {v.path for v in flat.variables}
    return UsageError(
        "AC020",
        f"there is no parameter '{name}' to freeze in {flat.name}",
        evidence=meant(name, known),
        help="it is a variable: only parameters can be frozen"
        if name in variables
        else "name parameters, components, patterns with *, or zeros for all parameters that are zero",
    )
