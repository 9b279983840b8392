"""Model references: `package.module:Class`, `path/file.py:Class`, `path/file.py`, or the name of a shipped model."""

from __future__ import annotations

import importlib
import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

from acausal.cli.arguments.catalogue import Part, find_part, near_parts
from acausal.cli.arguments.shipped import shipped_models
from acausal.cli.output.failure import as_error
from acausal.errors import UsageError, meant, nearest
from acausal.language.component import Component, Connector

_FILE = re.compile(r"(?P<path>.+\.py)(?::(?P<name>[^:/\\]*))?")
_FORMS = "a shipped model (see: acausal list), path/file.py:Class, or package.module:Class"


def find_model(reference: str) -> type[Component]:
    """The class that a reference names.

    Raises UsageError: AC001 if there is no such model, AC004 if a file has none or several, AC005 if it is not a model.
    Raises AcausalError: for an exception that the file raises while it is imported, with its position.
    """
    if match := _FILE.fullmatch(reference):
        module = _load(Path(match["path"]))
        return _member(module, match["name"], match["path"]) if match["name"] else _only(module, match["path"])
    if ":" in reference:
        module_name, _, name = reference.partition(":")
        return _member(_import(module_name), name, module_name)
    for model in shipped_models():
        if model.name == reference:
            return _member(_import(model.module), model.name, model.module)
    raise _unknown(reference)


def find_component(reference: str) -> tuple[type[Component], Part | None]:
    """The class that a reference names, and its entry in the catalogue if it is a component of the library.

    Raises UsageError as `find_model`, and AC004 if several libraries have a component of this name.
    """
    if _is_plain(reference) and reference not in {m.name for m in shipped_models()}:
        part = find_part(reference)
        if part is not None:
            return getattr(_import(part.module), part.name), part
    cls = find_model(reference)
    part = find_part(f"{cls.__module__.removeprefix('acausal.library.').partition('.')[0]}.{cls.__name__}")
    return cls, part if part is not None and part.module == cls.__module__ else None


def _is_plain(reference: str) -> bool:
    """Whether a reference is neither a file nor a module with a class."""
    return not _FILE.fullmatch(reference) and ":" not in reference


def _unknown(reference: str) -> UsageError:
    names = [m.name for m in shipped_models()]
    wanted = reference.lower()
    # wrong letter case and incomplete names are the most common mistakes
    close = [n for n in names if wanted and n.lower().startswith(wanted)] or nearest(reference, names)
    parts = near_parts(reference)
    evidence = [f"did you mean {', '.join(close)}?"] if close else []
    if parts:
        evidence.append(f"components of the library: {', '.join(parts)}")
    return UsageError(
        "AC001",
        f"there is no model '{reference}'",
        evidence=evidence,
        help=f"give {_FORMS}" + (f"; acausal info {parts[0]} shows a component" if parts else ""),
    )


def _load(path: Path) -> ModuleType:
    if not path.is_file():
        beside = [p.stem for p in path.parent.glob("*.py")] if path.parent.is_dir() else []
        close = nearest(path.stem, beside)
        raise UsageError(
            "AC001",
            f"there is no file {path}",
            evidence=[f"did you mean {', '.join(str(path.with_name(n + '.py')) for n in close)}?"] if close else [],
        )
    file = path.absolute()
    # files beside it can be imported, as for a Python script
    if str(file.parent) not in sys.path:
        sys.path.insert(0, str(file.parent))
    # the module gets another name, because that of the file may contain a dash or belong to an installed package
    name = f"_model_file_{re.sub(r'[^0-9a-zA-Z]', '_', file.stem)}"
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None, "a path that ends in .py has a spec"
    assert spec.loader is not None, "a path that ends in .py has a loader"
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        shown: Exception = error
        if isinstance(error, ValueError) and b"\0" in file.read_bytes():  # a SyntaxError from Python 3.11.4 on
            shown = SyntaxError(str(error))
        if isinstance(shown, SyntaxError) and not shown.filename:  # Python does not name a file with NUL bytes
            shown.filename, shown.lineno = str(file), 1
        raise as_error(shown) from error
    return module


def _import(name: str) -> ModuleType:
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.insert(0, folder)
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        # this error is for the requested module only, not for one that a model imports and that is not installed
        if error.name is None or not f"{name}.".startswith(f"{error.name}."):
            raise as_error(error) from error
        raise UsageError(
            "AC001",
            f"there is no module '{name}'",
            evidence=meant(name, sorted({m.module for m in shipped_models()})),
            help=f"give {_FORMS}",
        ) from error
    except Exception as error:
        raise as_error(error) from error


def _models_in(module: ModuleType) -> dict[str, type[Component]]:
    """Components that the module defines itself; connectors and partial ones cannot run."""
    return {
        name: value
        for name, value in vars(module).items()
        if isinstance(value, type)
        and issubclass(value, Component)
        and not issubclass(value, Connector)
        and value.__module__ == module.__name__
        and not name.startswith(("_", "Partial"))
    }


def _member(module: ModuleType, name: str, place: str) -> type[Component]:
    value = getattr(module, name, None)
    if isinstance(value, type) and issubclass(value, Component) and not issubclass(value, Connector):
        return value
    known = list(_models_in(module))
    if value is not None:
        raise UsageError("AC005", f"{name} of {place} is not a model", help="a model is a class derived from Component")
    close = [n for n in known if n.lower() == name.lower()] or nearest(name, known)
    raise UsageError(
        "AC001",
        f"{place} has no model '{name}'",
        evidence=[f"did you mean {', '.join(close)}?" if close else f"it has {', '.join(known) or 'no model at all'}"],
    )


def _only(module: ModuleType, place: str) -> type[Component]:
    """The model of a file: the only one with an experiment, else the only component."""
    known = _models_in(module)
    runnable = {name: cls for name, cls in known.items() if "experiment" in vars(cls)}
    chosen = runnable if len(runnable) == 1 else known
    if len(chosen) == 1:
        return next(iter(chosen.values()))
    if not known:
        raise UsageError("AC004", f"{place} contains no model", help="a model is a class derived from Component")
    raise UsageError(
        "AC004",
        f"{place} contains several models",
        evidence=[", ".join(runnable or known)],
        help=f"name one: {place}:{next(iter(runnable or known))}",
    )
