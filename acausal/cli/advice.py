"""What to do about the commonest Python errors in the code of a model."""

from __future__ import annotations

import inspect
import re
import sys
from types import FrameType, ModuleType

from acausal.cli.catalogue import library_parts, near_parts
from acausal.errors import nearest
from acausal.language.component import Component

_KEYWORD = re.compile(r"(\w+)\(\) got an unexpected keyword argument '(\w+)'")
_BY_NAME = re.compile(r"(\w+)\(\) takes (?:0|\d+) positional arguments? but")


def advice(error: Exception, frame: FrameType) -> str | None:
    """A line of help, or None when nothing better than the error itself can be said."""
    if isinstance(error, NameError):
        return _unknown_name(str(getattr(error, "name", "")), frame)
    if isinstance(error, AttributeError):
        return _unknown_attribute(str(getattr(error, "name", "")), getattr(error, "obj", None))
    if isinstance(error, ImportError) and not isinstance(error, ModuleNotFoundError):
        wanted = re.search(r"cannot import name '(\w+)'", str(error))
        if wanted is None:
            return None
        return _unknown_attribute(wanted[1], sys.modules.get(error.name or "")) or _elsewhere(wanted[1])
    return _declaration(str(error)) if isinstance(error, TypeError) else None


def _unknown_name(name: str, frame: FrameType) -> str | None:
    owner = frame.f_locals.get("self")
    if isinstance(owner, Component) and (name in owner._declarations or hasattr(type(owner), name)):
        return f"write self.{name}"
    return _did_you_mean(name, [*frame.f_locals, *frame.f_globals]) or _elsewhere(name)


def _unknown_attribute(name: str, owner: object) -> str | None:
    if isinstance(owner, ModuleType):
        return _did_you_mean(name, [n for n in dir(owner) if not n.startswith("_")])
    return None


def _declaration(text: str) -> str | None:
    """Help for the functions that declare fields, which take everything by keyword."""
    from acausal.language import declare

    found = _KEYWORD.match(text) or _BY_NAME.match(text)
    function = getattr(declare, found[1], None) if found else None
    if found is None or not inspect.isfunction(function):
        return None
    names = list(inspect.signature(function).parameters)
    if len(found.groups()) > 1 and found[2] in ("start", "value", "init", "initial", "fixed") and "default" in names:
        return f"write default=fixed(...) or default=guess(...); {found[1]} takes {', '.join(names)}"
    return f"{found[1]} takes by keyword: {', '.join(names)}"


def _elsewhere(name: str) -> str | None:
    """Which libraries have a component of this name, or nearly so."""
    exact = [f"from acausal.library.{p.family} import {name}" for p in library_parts() if p.name == name]
    if exact:
        return ", or ".join(exact)
    close = near_parts(name)
    return f"did you mean {', '.join(close)} of acausal.library?" if close else None


def _did_you_mean(name: str, names: list[str]) -> str | None:
    close = nearest(name, names)
    return f"did you mean {', '.join(close)}?" if close else None
