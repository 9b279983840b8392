"""Catalogue of the library's components, from its parsed source.

A name is followed through the imports of each file, so that base classes and parts are found under other names without
running any code.
"""

from __future__ import annotations

import ast
from dataclasses import dataclass
from functools import cache

from acausal.cli.arguments.shipped import modules, shipped_models
from acausal.errors import UsageError, nearest

PACKAGE = "acausal.library"
# Libraries that correspond to packages of the Modelica Standard Library; the innermost name decides.
_MODELICA = {
    "Blocks": "blocks",
    "Electrical": "electrical",
    "HeatTransfer": "thermal",
    "MultiBody": "multibody",
    "Rotational": "rotational",
    "Thermal": "thermal",
    "Translational": "translational",
}
_ROOTS = ("Component", "Connector", "Record")


@dataclass(frozen=True)
class Part:
    """A class of the library: `family` is the package to import it from, `kind` component, connector or record."""

    name: str
    family: str
    module: str
    kind: str
    doc: str

    @property
    def reference(self) -> str:
        """Unambiguous name for `acausal info`."""
        return f"{self.family}.{self.name}"

    @property
    def summary(self) -> str:
        """First line of the docstring."""
        return self.doc.split("\n")[0]


@cache
def _followed(module: str, name: str) -> tuple[str, str]:
    """(Module, name) of the definition of the class that `module` calls `name`."""
    seen = set()
    while (module, name) not in seen:
        seen.add((module, name))
        here = modules(PACKAGE).get(module) or modules("acausal.models").get(module)
        if here is None or name in here.classes or name not in here.imports:
            break
        module, name = here.imports[name]
    return module, name


@cache
def _kind(module: str, name: str) -> str:
    """`component`, `connector`, `record`, or "" for any other class."""
    module, name = _followed(module, name)
    if module.partition(".")[0] == "acausal" and name in _ROOTS:
        return name.lower()
    here = modules(PACKAGE).get(module)
    for base in here.classes[name].bases if here and name in here.classes else ():
        inner = base.value if isinstance(base, ast.Subscript) else base
        if isinstance(inner, ast.Name) and (kind := _kind(module, inner.id)):
            return kind
    return ""


@cache
def library_parts() -> tuple[Part, ...]:
    """The public components, connectors and records of the library, sorted by family and name."""
    found = []
    for package, module in modules(PACKAGE).items():
        # public classes are those that the package of a family re-exports by `import X as X`
        if package.count(".") < 2 or not any(m.startswith(f"{package}.") for m in modules(PACKAGE)):
            continue
        for name, (origin, original) in module.imports.items():
            where, own = _followed(origin, original)
            if origin.startswith(PACKAGE) and not name.startswith("_") and (kind := _kind(where, own)):
                doc = ast.get_docstring(modules(PACKAGE)[where].classes[own]) or ""
                found.append(Part(name, package.removeprefix(PACKAGE + "."), where, kind, doc))
    # a family re-exports the classes of its subpackages: list them under the outermost family
    outermost: dict[tuple[str, str], Part] = {}
    for part in sorted(found, key=lambda p: p.family.count(".")):
        outermost.setdefault((part.module, part.name), part)
    return tuple(sorted(outermost.values(), key=lambda p: (p.family, p.name.lower())))


def families() -> tuple[str, ...]:
    """The libraries, by name."""
    return tuple(dict.fromkeys(p.family for p in library_parts()))


@cache
def named_by(package: str) -> dict[tuple[str, str], frozenset[tuple[str, str]]]:
    """For each class of `acausal.library` or `acausal.models`, the definitions of the classes that its body names."""
    return {
        (module, name): frozenset(_followed(module, n.id) for n in ast.walk(node) if isinstance(n, ast.Name))
        for module, content in modules(package).items()
        for name, node in content.classes.items()
    }


@cache
def used_in(part: Part) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of the shipped models, and of the library's components, that use the part.

    A component counts if its class body names the part; a model also if a component in its own folder does.
    """
    wanted = (part.module, part.name)
    components = {name for (_, name), named in named_by(PACKAGE).items() if wanted in named and name != part.name}
    models, holders = named_by("acausal.models"), {wanted}
    while found := {key for key, named in models.items() if key not in holders and holders & named}:
        holders |= found
    runnable = {(m.module, m.name) for m in shipped_models()}
    return tuple(sorted({name for _, name in holders & runnable})), tuple(sorted(components))


def find_part(reference: str) -> Part | None:
    """The part that `Resistor`, `electrical.Resistor` or `Modelica.Electrical.Analog.Basic.Resistor` names; or None.

    Raises UsageError: AC004 if several libraries have a part of this name.
    """
    *packages, name = reference.split(".")
    found = [p for p in library_parts() if p.name == name]
    wanted = _wanted(packages)
    found = [p for p in found if p.family == wanted or p.family.startswith(f"{wanted}.")] if packages else found
    if len(found) > 1:
        raise UsageError(
            "AC004",
            f"{len(found)} libraries have a component '{name}'",
            evidence=[f"{p.reference}: {p.summary}" for p in found],
            help=f"name one: {found[0].reference}",
        )
    return found[0] if found else None


def _wanted(packages: list[str]) -> str:
    if packages[:1] == ["Modelica"]:
        return next((_MODELICA[p] for p in reversed(packages) if p in _MODELICA), "")
    return ".".join(packages).removeprefix(f"{PACKAGE}.")


def near_parts(reference: str) -> list[str]:
    """References of the parts with the most similar names, those of the requested family first."""
    *packages, name = reference.split(".")
    wanted = _wanted(packages)
    of_name: dict[str, list[Part]] = {}
    for part in library_parts():
        of_name.setdefault(part.name.lower(), []).append(part)
    close = [p for n in nearest(name.lower(), list(of_name), 4) for p in of_name[n]]
    return [p.reference for p in sorted(close, key=lambda p: bool(wanted) and p.family != wanted)][:4]


def elsewhere(name: str) -> str | None:
    """Help for an unknown name: the libraries that have a component of this or a similar name."""
    exact = [f"from acausal.library.{p.family} import {name}" for p in library_parts() if p.name == name]
    if exact:
        return ", or ".join(exact)
    # names of components start with a capital letter
    close = near_parts(name) if name[:1].isupper() else []
    return f"did you mean {', '.join(close)} of acausal.library?" if close else None


def missing_library(module: str) -> str | None:
    """Help for a library that does not exist; None for any other module."""
    if not module.startswith("acausal.library."):
        return None
    close = nearest(module.split(".")[2], list(families()))
    return f"did you mean {', '.join(close)}?" if close else f"there are {', '.join(families())}"
