"""Shell completion: models, files, parameters, signals, solvers. After an error nothing is offered."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import typer

from acausal.errors import AcausalError

_RESULTS = (".mat", ".csv", ".npz", ".parquet")


def _beginning(names: Iterable[str], incomplete: str) -> list[str]:
    return [n for n in names if n.startswith(incomplete)]


def _files(incomplete: str, suffixes: tuple[str, ...]) -> list[str]:
    """Files with one of the suffixes, and folders, that begin with the incomplete path."""
    head = os.path.dirname(incomplete)
    folder = Path(head or ".")
    if not folder.is_dir():
        return []
    found = sorted(p for p in folder.iterdir() if not p.name.startswith("."))
    names = [p.name + "/" * p.is_dir() for p in found if p.is_dir() or p.suffix in suffixes]
    return _beginning([os.path.join(head, n) for n in names], incomplete)


def _given(ctx: typer.Context, name: str) -> str | None:
    """The text of an argument; while the value of an option is missing, the parser leaves it among the rest."""
    value = ctx.params.get(name) or next(iter(ctx.args), None)
    value = next(iter(value), None) if isinstance(value, list | tuple) else value
    return None if value is None else str(value)


def complete_list(incomplete: str) -> list[str]:
    """Kinds of lists of `acausal list`."""
    return _beginning(("models", "library"), incomplete)


def complete_family(incomplete: str) -> list[str]:
    """Libraries."""
    from acausal.cli.arguments.catalogue import families

    return _beginning(families(), incomplete)


def complete_model(incomplete: str) -> list[str]:
    """Shipped models and model files."""
    from acausal.cli.arguments.shipped import shipped_models

    return _beginning((m.name for m in shipped_models()), incomplete) + _files(incomplete, (".py",))


def complete_component(incomplete: str) -> list[str]:
    """Models, and components of the library by name or by family and name."""
    from acausal.cli.arguments.catalogue import library_parts

    names = [n for p in library_parts() for n in (p.name, p.reference)]
    return complete_model(incomplete) + sorted(set(_beginning(names, incomplete)))


def complete_result(incomplete: str) -> list[str]:
    """Result files."""
    return _files(incomplete, _RESULTS)


def complete_shown(incomplete: str) -> list[str]:
    """Models, model files and result files."""
    return [*complete_model(incomplete), *_files(incomplete, _RESULTS)]


def complete_parameter(ctx: typer.Context, incomplete: str) -> list[str]:
    """`path=` of the parameters and structural arguments of the model given before."""
    from acausal.cli.arguments.reference import find_model
    from acausal.flatten.instances.instances import instances
    from acausal.language.declarations.declaration import Kind

    reference = _given(ctx, "model")
    if reference is None:
        return []
    try:
        model = find_model(reference)()
        wanted = (Kind.PARAMETER, Kind.STRUCTURAL)
        names = [
            f"{i.prefix}{name}="
            for i in instances(model)
            for name, d in i.component._declarations.items()
            if d.kind is Kind.PARAMETER or (d.kind in wanted and i.owner is None)
        ]
    except (AcausalError, OSError):
        return []
    return _beginning(names, incomplete)


def complete_signal(ctx: typer.Context, incomplete: str) -> list[str]:
    """Signals of the result file given before."""
    result = _given(ctx, "result") or _given(ctx, "results")
    if result is None:
        return []
    from acausal.result.result import load

    try:
        return _beginning(load(Path(result)).names, incomplete)
    except (AcausalError, OSError):
        return []


def complete_drawn(ctx: typer.Context, incomplete: str) -> list[str]:
    """Signals of the result file given before, and more result files."""
    return [*complete_signal(ctx, incomplete), *_files(incomplete, _RESULTS)]


def complete_solver(incomplete: str) -> list[str]:
    """Solvers."""
    from acausal.simulate.solvers import SOLVERS

    return _beginning(("auto", *SOLVERS), incomplete)
