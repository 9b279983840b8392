"""`acausal list`: the shipped models, and the components of the library."""

from __future__ import annotations

from typing import Annotated

import typer

from acausal.cli.arguments import options
from acausal.cli.arguments.catalogue import Part, families, library_parts
from acausal.cli.arguments.completion import complete_family, complete_list
from acausal.cli.arguments.shipped import shipped_models
from acausal.cli.output.report import record, say, table
from acausal.errors import UsageError, nearest


def list_models(
    what: Annotated[
        str,
        typer.Argument(metavar="[models|library]", help="Models or library components.", autocompletion=complete_list),
    ] = "",
    family: Annotated[
        str | None,
        typer.Argument(metavar="[FAMILY]", help="One library: electrical, ...", autocompletion=complete_family),
    ] = None,
    search: Annotated[
        str | None,
        typer.Option("--search", metavar="WORD", help="Only those with this word in their name or description."),
    ] = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,  # nothing but the list is printed anyway
) -> None:
    """List the shipped models or the components of the library, with module and description.

    Examples: acausal list; acausal list library electrical; acausal list --search clutch
    """
    if what not in ("", "models", "library"):
        close = [f"acausal list library {n}" for n in nearest(what, families())]
        raise UsageError(
            "AC081",
            f"there is no list of '{what}'",
            evidence=[f"did you mean {close[0]}?"] if close else [],
            help="write acausal list models, acausal list library [FAMILY], or acausal list --search WORD",
        )
    if what != "library" and family is not None:
        raise UsageError("AC081", f"models have no family '{family}'", help=f"write acausal list library {family}")
    word = (search or "").lower()
    models = [m for m in shipped_models() if word in f"{m.name} {m.module} {m.summary}".lower()]
    models = models if what != "library" else []
    parts = list(_parts(family)) if what == "library" or (word and what != "models") else []
    parts = [p for p in parts if word in p.reference.lower() or word in p.doc.lower()]
    if word and not models and not parts:
        raise UsageError("AC001", f"no entry has '{search}' in its name or description", help="try a shorter word")
    if as_json:
        shown = [{"name": m.name, "reference": m.reference, "summary": m.summary} for m in models]
        library = {"library": [_described(p) for p in parts]} if parts else {}
        record(library if what == "library" else {"models": shown, **library})
        return
    table([(m.name, m.module, m.summary) for m in models])
    _say_parts(parts, word)


def _parts(family: str | None) -> list[Part]:
    """The components of the library, or of one family."""
    if family is None:
        return list(library_parts())
    found = [p for p in library_parts() if p.family == family or p.family.startswith(f"{family}.")]
    if not found:
        close = nearest(family, families())
        raise UsageError(
            "AC081",
            f"there is no library '{family}'",
            evidence=[f"did you mean {', '.join(close)}?" if close else f"there are {', '.join(families())}"],
        )
    return found


def _described(part: Part) -> dict[str, str]:
    module = f"acausal.library.{part.family}"
    return {"name": part.name, "family": part.family, "kind": part.kind, "import": module, "summary": part.summary}


def _say_parts(parts: list[Part], word: str) -> None:
    """Print parts by family; those with the word in their name come first."""
    width = max((len(p.name) for p in parts), default=0)
    for family in dict.fromkeys(p.family for p in parts):
        say()
        say(f"acausal.library.{family}")
        members = sorted((p for p in parts if p.family == family), key=lambda p: word not in p.name.lower())
        for part in members:
            kind = "" if part.kind == "component" else f"({part.kind}) "
            say(f"  {part.name:{width}}  {kind}{part.summary}".rstrip())
