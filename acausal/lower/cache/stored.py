"""Compiled models on disk, shared between processes.

A model that took long to compile is not only cached in memory (`cache.py`) but also written to a private folder
(`acausal.private`), where the next process that flattens the same equations finds it. The key is a hash of the
signature, of the sources of the compiler, and of the versions of Python, NumPy and CasADi. External functions enter the
key with the operations that they build. A signature that contains an object without stable content has no key, and such
a model is compiled in each process.

A file contains the pickled objects of a compiled model, and CasADi functions in CasADi's serialisation. It is unpickled
only if its digest is right, and only with names from a table: classes of the compiler, components that are already
imported, and a few constructors of NumPy and CasADi. A file that cannot be read is removed, and its model compiled
anew.
"""

from __future__ import annotations

import hashlib
import io
import logging
import marshal
import os
import pickle
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from functools import cache, lru_cache
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import AcausalError
from acausal.flatten.flat import FlatSystem
from acausal.language.component import Component
from acausal.language.events import Assertion
from acausal.language.expressions.expression import Equation
from acausal.language.expressions.external import Call, External
from acausal.lower.compiled import CompiledModel
from acausal.numeric.external import function, is_self_contained
from acausal.private import discard, folder, home, place
from acausal.private import find as file_of

_log = logging.getLogger(__name__)
_KIND, _SUFFIX = "models", ".model"
# Least compile time [s] of a stored model, least number of nodes, in total and per equation, of a flat system that may
# take so long, and largest number of stored files.
_LEAST_SECONDS, _LEAST_NODES, _LEAST_NODES_PER_EQUATION, _MOST_FILES = 0.3, 4_000, 5, 100
_SOURCES = ("language", "flatten", "structure", "numeric", "analyse", "reduce", "lower", "diagnose")
_PACKAGE = Path(__file__).resolve().parents[2]
_OWN_PACKAGES = [["acausal", name] for name in (*_SOURCES, "errors")]
_PLAIN = frozenset((int, float, str, bytes, bool, type(None)))
# Callables allowed while unpickling, besides classes of this package and components.
_ALLOWED = {
    ("acausal.language.declarations.declaration", "_declaration_of"),
    ("casadi.casadi", "Function"),
    ("numpy", "dtype"),
    ("numpy", "ndarray"),
    ("numpy._core.numeric", "_frombuffer"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"),
    ("numpy.random._pcg64", "PCG64"),
    ("numpy.random._pickle", "__bit_generator_ctor"),
    ("numpy.random._pickle", "__generator_ctor"),
    ("numpy.random.bit_generator", "SeedSequence"),
    ("numpy.random.bit_generator", "__pyx_unpickle_SeedSequence"),
    ("builtins", "str"),
}


class _NoStableContent(Exception):
    """The object has no content that is the same in every process."""


def find(signature: tuple[Any, ...], flat: FlatSystem) -> CompiledModel | None:
    """The model of this signature that some process stored, with the values of that process; None if there is none."""
    if not _is_heavy(flat) or not folder(_KIND).is_dir():
        return None
    key = _key(signature)
    path = None if key is None else file_of(_KIND, key, _SUFFIX)
    if path is None:
        return None
    try:
        model = _Reader(io.BytesIO(path.read_bytes()), _externals(signature)).load()
        os.utime(path)  # mark as recently used
    except Exception as error:  # any failure: the model can be compiled again
        _log.info("%s is not read: %r", path, error)
        discard(path)
        return None
    return model if isinstance(model, CompiledModel) else None


def keep(signature: tuple[Any, ...], compiled: CompiledModel) -> None:
    """Store a model for other processes if it took long to compile."""
    seconds = sum(s for stage, s in compiled.timings.items() if stage != "flatten")
    if seconds < _LEAST_SECONDS or not _is_heavy(compiled.flat) or not _is_plain(compiled, signature):
        return
    key = _key(signature)
    if key is None:
        return
    try:
        content = io.BytesIO()
        _Writer(content, _externals(signature)).dump(_without_flat_data(compiled))
        directory = home(_KIND)
        with tempfile.TemporaryDirectory(prefix="write-", dir=directory) as scratch:
            target = Path(scratch) / "model"
            target.write_bytes(content.getvalue())
            place(target, directory, key, _SUFFIX)
        oldest = sorted(directory.glob(f"*{_SUFFIX}"), key=lambda path: path.stat().st_mtime)
        for path in oldest[:-_MOST_FILES]:
            discard(path)
    except Exception as error:  # the model is valid although it cannot be stored
        _log.info("%s is not kept for other processes: %r", compiled.name, error)


def _is_heavy(flat: FlatSystem) -> bool:
    """Whether a system has long equations, such as contacts; short ones are compiled as fast as a file is read."""
    return len(flat.pool.nodes) >= max(_LEAST_NODES, _LEAST_NODES_PER_EQUATION * len(flat.equations))


def _is_plain(compiled: CompiledModel, signature: tuple[Any, ...]) -> bool:
    """Whether the signature determines the model: not reduced, without variables that the compiler has added."""
    return compiled.selection is None and compiled.recipe is None and tuple(compiled.flat.variables) in signature


def _without_flat_data(compiled: CompiledModel) -> CompiledModel:
    """The model without the data that the reader's flat system supplies: components, places of connections, notes."""
    old = compiled.solution.structure
    flat = replace(old.reduced.flat, components={}, loops=(), notes=())
    reduced = replace(old.reduced, flat=flat)
    structure = replace(old, reduced=reduced, points=type(old.points)(reduced, old.points.visited))
    bare: CompiledModel = replace(compiled, solution=replace(compiled.solution, structure=structure), timings={})
    return bare


def _externals(signature: tuple[Any, ...]) -> list[External]:
    """The external functions of a flat system, in the order in which its nodes call them."""
    return list(dict.fromkeys(op.external for op, *_ in signature[2] if isinstance(op, Call)))


def _external(index: int, derivatives: int) -> External:
    """Represents an external function in a file, by its index among those of the flat system, which the reader has."""
    raise NotImplementedError  # `_Reader` resolves it by its method `external`


class _Writer(pickle.Pickler):
    """Writes no statements, because the reader's flat system supplies them (`_is_plain`, `cache._with_values`).

    Their texts took 70 % of the time to store 256 balls, whose assertions are long.
    """

    def __init__(self, file: io.BytesIO, externals: list[External]) -> None:
        super().__init__(file, protocol=5)
        self.places = {external: k for k, external in enumerate(externals)}

    def reducer_override(self, obj: Any) -> Any:
        """Write objects in another form that would need a component, or that only this process has."""
        if isinstance(obj, Equation | Assertion):
            return str, ()
        if isinstance(obj, External):
            base, derivatives = obj, 0
            while base not in self.places and base.primal is not None:
                base, derivatives = base.primal, derivatives + 1
            return (_external, (self.places[base], derivatives)) if base in self.places else NotImplemented
        if isinstance(obj, Component):
            raise pickle.PicklingError(f"a {type(obj).__name__} is in the compiled model")
        return NotImplemented


class _Reader(pickle.Unpickler):
    """Reads data, and only those names that `find_class` allows."""

    def __init__(self, file: io.BytesIO, externals: list[External]) -> None:
        super().__init__(file)
        self.externals = externals

    def external(self, index: int, derivatives: int) -> External:
        """An external function of the reader's flat system, or its partial derivatives of the given order."""
        function = self.externals[index]
        for _ in range(derivatives):
            function = function.partials
        return function

    def find_class(self, module: str, name: str) -> Any:
        """The class of this name, if files may refer to it."""
        if (module, name) == (__name__, _external.__name__):
            return self.external
        is_listed = (module, name) in _ALLOWED or module.split(".")[:2] in _OWN_PACKAGES
        target: Any = import_module(module) if is_listed else sys.modules.get(module)
        for part in name.split("."):
            target = getattr(target, part)
        is_allowed = isinstance(target, type) and (
            target.__module__ == module if is_listed else issubclass(target, Component)
        )
        if is_allowed or (module, name) in _ALLOWED:
            return target
        raise pickle.UnpicklingError(f"{module}.{name} is not allowed in compiled models")


def _key(signature: tuple[Any, ...]) -> str | None:
    """A key of a signature that is the same in all processes; None if parts of it have no stable content."""
    try:
        return hashlib.sha256(f"{_compiler_version()} {_digest(signature)}".encode()).hexdigest()
    except (_NoStableContent, ValueError, OSError, TypeError, RecursionError) as error:
        _log.info("no key for other processes: %r", error)
        return None


@lru_cache(maxsize=1)  # needed before a model is compiled, and again afterwards
def _digest(signature: tuple[Any, ...]) -> str:
    content = marshal.dumps(_plain_content(signature, {}), 2)  # without references, which differ between processes
    return hashlib.sha256(content).hexdigest()


@cache
def _compiler_version() -> str:
    """A hash of everything besides the signature that determines the compiled model."""
    compiler_hash = hashlib.sha256(repr((sys.version_info[:3], np.__version__, ca.CasadiMeta.version())).encode())
    for path in _compiler_sources():
        compiler_hash.update(str(path.relative_to(_PACKAGE)).encode() + b"\0" + path.read_bytes())
    return compiler_hash.hexdigest()


def _compiler_sources() -> Iterator[Path]:
    """The source files of the compiler, in a fixed order."""
    for name in _SOURCES:
        yield from sorted((_PACKAGE / name).rglob("*.py"))


def _plain_content(value: Any, visited: dict[int, Any]) -> Any:
    """The content of a part of a signature, in plain values."""
    kind = type(value)
    if kind in _PLAIN:
        return value
    if kind is tuple and _PLAIN.issuperset(map(type, value)):  # nodes of a pool, nearly all of a signature
        return "builtins.tuple", *value
    if id(value) in visited:
        return visited[id(value)][1]
    content = tuple(_parts(value, visited))
    visited[id(value)] = value, content  # keeps the value alive, so that no other object gets its id
    return content


def _parts(value: Any, visited: dict[int, Any]) -> Iterator[Any]:
    kind = type(value)
    yield f"{kind.__module__}.{kind.__qualname__}"
    if isinstance(value, tuple | list):
        yield from (_plain_content(v, visited) for v in value)
    elif isinstance(value, Mapping):
        yield from ((_plain_content(k, visited), _plain_content(v, visited)) for k, v in value.items())
    elif isinstance(value, Enum):
        yield value.name
    elif isinstance(value, type):
        yield f"{value.__module__}.{value.__qualname__}"
    elif isinstance(value, FunctionType):
        yield _function(value)
    elif isinstance(value, np.ndarray) and value.dtype != object:
        yield from (str(value.dtype), value.shape, value.tobytes())
    elif isinstance(value, ca.Function):
        yield value.serialize()
    elif isinstance(value, Call):
        yield from (_plain_content(value.external, visited), value.entry)
    elif isinstance(value, External):
        yield from (value.name, value.inputs, value.outputs, value.units, value.jumps, _operations(value))
    elif is_dataclass(value):
        yield from (_plain_content(getattr(value, f.name), visited) for f in fields(value))
    else:
        raise _NoStableContent(kind)


def _operations(external: External) -> Any:
    """The serialised CasADi function of an external function."""
    try:
        built = function(external)
    except AcausalError as error:
        raise _NoStableContent(external) from error
    if not is_self_contained(built):  # Python functions are serialised without their code, libraries as a path
        raise _NoStableContent(external)
    return built.serialize()


def _function(value: FunctionType) -> tuple[Any, ...]:
    """The position of a function in its file, and the content of the whole file."""
    if value.__closure__ or value.__defaults__ or value.__kwdefaults__:
        raise _NoStableContent(value)
    code = value.__code__
    return value.__module__, value.__qualname__, code.co_firstlineno, _content(code.co_filename)


@cache
def _content(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()
