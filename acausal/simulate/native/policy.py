"""Decides when to compile a model.

An evaluation of compiled equations saves the overhead of a call, and a part of the time of each instruction. Compiling
takes a constant time, and a time per instruction. Both are known in advance, so a library is built when the interpreted
evaluations so far have cost more than it would. Compiling then at most about doubles the time of a run, a short first
run compiles nothing, and repeated runs of a model become fast automatically. With fixed steps the number of future
evaluations is known and counts as well. A library on disk is always used; `native=True` builds one immediately,
`native=False` uses none.

Evaluations are counted instead of seconds, so that runs are reproducible. The constants are measured
(docs/devdocs/native.md).
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, TypeVar
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.lower.compiled import CompiledModel
from acausal.numeric.external import is_self_contained
from acausal.simulate.equations.calls.buffered import BufferedFunction
from acausal.simulate.equations.scaled import UNIT, in_units
from acausal.simulate.native import cache, source
from acausal.simulate.native.cache import made
from acausal.simulate.native.equations import CONSTANTS, by_patterns, differentiated, equations
from acausal.simulate.native.event_loop import EventLoopProgram
from acausal.simulate.native.event_loop import source as event_loop_source
from acausal.simulate.native.program import HeunProgram

T = TypeVar("T")

# Time saved by one compiled evaluation [s]: for its call, and for each instruction.
_CALL, _INSTRUCTION = 1.5e-6, 4e-9
# Time to compile a library [s]: for the integrator itself, and for each instruction of the equations.
_START, _COMPILED_INSTRUCTION = 0.5, 3e-4
# With more instructions, a multistep method is slower with compiled equations: interpreted ones have the parameters as
# numbers, so that their Jacobian is partly constant.
_LARGEST_ORACLE = 2000
# Evaluations after which a program of columns pays off: writing it takes 4 us per instruction, and saves 3 ns on each.
_REPAID = 1500.0
# Interpreted operations on columns are this many times as fast as those on single instances (docs/devdocs/mapped.md).
COLUMNS = 8


def pays(evaluations: float, size: int, code: int | None = None) -> bool:
    """Whether compiling equations of `size` instructions costs less than this number of interpreted evaluations.

    `code` is the number of instructions to compile, if that differs from `size`.
    """
    return evaluations * (_CALL + _INSTRUCTION * size) > _START + _COMPILED_INSTRUCTION * (
        size if code is None else code
    )


@dataclass(frozen=True, eq=False)
class Library(Generic[T]):
    """A loaded library: its main function or program, and the function `(p, u) -> c` of its constants."""

    run: T
    constants: BufferedFunction

    def vector(self, p: Vector, u: Vector, numbers: Vector) -> Vector:
        """The parameter vector of its equations; `numbers` as in `Problem.numbers`."""
        return np.concatenate([self.constants(p, u)[0], numbers])


@dataclass(frozen=True, eq=False)
class StoppingEquations:
    """The CasADi functions of a library that integrates over events.

    `dae` has the form for CasADi's integrators, and `constants` that of `equations.py`.
    `event_functions` are "judged", "event_round" and "relaxed", and "steep" if the rates contain steep functions. The
    DAE gets the values of `held` for the first parameters of its caller, followed by the other parameters. `jacobian`
    is a short Jacobian of it (`jacobian.py`).
    """

    dae: Any
    constants: Any
    event_functions: tuple[Any, ...]
    held: Any = None
    jacobian: Any = None


_Details = tuple[tuple[str, Any], ...]
# Key of a library: its kind, the parameters that are zero, and details.
_Key = tuple[str, tuple[int, ...], _Details]


@dataclass(eq=False)
class Memory:
    """Libraries of one model that are loaded, missing on disk, or failed to build; shared by all runs in a process."""

    ready: dict[_Key, Library[Any]] = field(default_factory=dict)
    absent: set[_Key] = field(default_factory=set)
    failed: set[_Key] = field(default_factory=set)
    evaluations: dict[str, float] = field(default_factory=dict)
    expected: float = 0.0


# Models are identified by identity, and not kept alive.
_MEMORIES: WeakKeyDictionary[CompiledModel, Memory] = WeakKeyDictionary()


def expect(compiled: CompiledModel, evaluations: float) -> None:
    """Announce the number of evaluations in many runs to come, which counts in addition to those so far."""
    _MEMORIES.setdefault(compiled, Memory()).expected = evaluations


class Native:
    """Access of one run to the compiled code of a model."""

    def __init__(self, compiled: CompiledModel, wanted: bool | None, p: Vector | None = None) -> None:
        """`p` are the parameters of the run; those that are zero are constant in its libraries."""
        self.compiled = compiled = compiled.common
        self.zeros: tuple[int, ...] = () if p is None else tuple(np.flatnonzero(np.asarray(p) == 0.0).tolist())
        self.wanted = wanted
        self.memory = _MEMORIES.setdefault(compiled, Memory())
        self.used: set[str] = set()

    def integrator(self, plugin: str, settings: Mapping[str, Any]) -> Library[EventLoopProgram] | None:
        """A whole integrator, "rosenbrock" or "erk"; that of an ODE can also integrate over time events.

        Tolerances and step are arguments of the program, so that all their values use the same library. Units of
        algebraic variables are appended to its parameters (`in_units`).
        """
        fixed = {"step_size": 0.25} if settings.get("step_size") else {}
        neutral = {**settings, "reltol": 1e-6, "abstol": 1e-8, "max_num_steps": 10**6, **fixed}
        kind = f"{plugin}, fixed steps" if fixed else plugin

        def text() -> str | None:
            dae, constants, jacobian = differentiated(self.compiled, self.zeros)
            dae = in_units(dae) if self.compiled.algebraic else dae
            written = source.integrator(plugin, dae, neutral, constants, jacobian=jacobian)
            return None if written is None else f"{written}#define PLAIN\n{event_loop_source()}"

        def load(path: Path) -> EventLoopProgram:
            return EventLoopProgram(path, self._nx, len(self.compiled.algebraic))

        return self._library(kind, tuple(sorted(neutral.items())), lambda: self._pays(self._spent(plugin)), text, load)

    def stopping(
        self,
        plugin: str,
        settings: Mapping[str, Any],
        equations: Callable[[], StoppingEquations],
        made_from: Callable[[], tuple[Any, ...]],
        instructions: Callable[[], int],
    ) -> Library[EventLoopProgram] | None:
        """A whole integrator that stops at events (`simulate/events/loop_equations.py`).

        `equations()` builds its functions, which follow from the functions `made_from()`, and from the rates and rounds
        of the model. `instructions()` is the size of its event functions.
        """
        if self.wanted is False:  # this is called at every event
            return None
        fixed = {"step_size": 0.25} if settings.get("step_size") else {}
        neutral = {**settings, "reltol": 1e-6, "abstol": 1e-8, **fixed}
        kind = f"{plugin}, events" + (", fixed steps" if fixed else "")

        def text() -> str | None:
            parts = equations()
            with contextlib.redirect_stderr(io.StringIO()):  # CasADi warns that events are experimental
                companions = parts.constants, *parts.event_functions
                written = source.integrator(
                    plugin, parts.dae, neutral, *companions, held=parts.held, jacobian=parts.jacobian
                )
            has_steep = any(f.name() == "steep" for f in parts.event_functions)
            return (
                None if written is None else f"{written}{'#define STEEP' if has_steep else ''}\n{event_loop_source()}"
            )

        def load(path: Path) -> EventLoopProgram:
            return EventLoopProgram(path, self._nx, 0)

        def pays_now() -> bool:
            # the derivatives that locate events have twice as many instructions as the event functions
            return pays(self._spent(kind), self._size, 4 * self._size + 3 * instructions())

        def all_functions() -> tuple[Any, ...]:
            return self.compiled.events.round, *made_from()

        return self._library(kind, tuple(sorted(neutral.items())), pays_now, text, load, all_functions)

    def oracle(
        self, plugin: str, settings: Mapping[str, Any], change: Callable[[Any], Any] | None = None
    ) -> Library[Any] | None:
        """Compiled right-hand side and Jacobian, as an oracle for one of CasADi's integrators.

        `change` transforms the equations before they are compiled: a wrapped compiled function would have finite
        differences instead of compiled derivatives. Only with `native=True`, and not for large models, because a
        multistep method spends most of its time elsewhere.
        """
        if not self.wanted or self._size > _LARGEST_ORACLE:
            return None

        def text() -> str:
            dae, constants = self.equations
            dae = dae if change is None else change(dae)
            inside = ca.integrator("inside", plugin, dae, 0.0, [1.0], dict(settings))
            derived = (inside.get_function(name) for name in inside.get_function() if name != dae.name())
            return source.functions(dae, constants, *derived)

        kind = plugin if change is None else f"{plugin}, {change.__name__} to {UNIT}"
        return self._library(kind, (), lambda: False, text, lambda path: ca.external("dae", str(path)))

    def heun(self, step: Callable[[Any], Any], evaluations: float) -> Library[HeunProgram] | None:
        """Heun's method; `step` builds the function `(x, [t, h], p) -> x` from a DAE without algebraic variables.

        `evaluations` is the number of evaluations to come.
        """

        def text() -> str:
            dae, constants = self.equations
            return source.heun(step(dae), constants)

        expected = self._spent("heun") + evaluations
        return self._library("heun", (), lambda: self._pays(expected), text, lambda path: HeunProgram(path, self._nx))

    def by_columns(self, plugin: str) -> bool:
        """Whether the equations of a multistep method are evaluated by columns, if they have columns."""
        return self.wanted is not False and (self.wanted is True or self._spent(plugin) >= _REPAID)

    def notes(self, solver: str) -> tuple[str, ...]:
        """The note on a run with `native=True` that was interpreted."""
        if not self.wanted or self.used:
            return ()
        if cache.compiler() is None:
            why = "no C compiler was found ($CC, cc, gcc, clang)"
        elif not is_self_contained(self.compiled.rhs):
            why = "an external function calls Python or a library, for which there is no C"
        elif self.memory.failed:
            why = f"{cache.compiler()} failed, its message is in the log"
        else:
            why = f"'{solver}' has no compiled form for this model"
        return (f"compiled code was requested, but the run was interpreted: {why}",)

    def interpreted(self, kind: str, evaluations: float) -> None:
        """Add the evaluations of an interpreted segment to those that decide about compiling."""
        self.memory.evaluations[kind] = self._spent(kind) + evaluations

    @cached_property
    def equations(self) -> tuple[Any, Any]:
        """The equations and their constants for compiled code; see `equations.py`."""
        return equations(self.compiled, self.zeros)

    @property
    def _nx(self) -> int:
        return self.compiled.n_dynamic

    @property
    def _size(self) -> int:
        return int(self.compiled.rhs.n_instructions())

    def _pays(self, evaluations: float) -> bool:
        """`pays` for the equations of the model, whose code may consist of columns."""
        form = self.compiled.mapped(self.zeros)
        if form is None:
            return pays(evaluations, self._size)
        return pays(evaluations, self._size // COLUMNS, form.operations if by_patterns(self.compiled) else self._size)

    def _spent(self, kind: str) -> float:
        return self.memory.evaluations.get(kind, 0.0) + self.memory.expected

    def _library(
        self,
        kind: str,
        details: _Details,
        is_worth_it: Callable[[], bool],
        text: Callable[[], str | None],
        load: Callable[[Path], T],
        made_from: Callable[[], tuple[Any, ...]] = tuple,
    ) -> Library[T] | None:
        """The library of this kind with these `details`; its functions follow from the rates and from `made_from()`."""
        memory = self.memory
        if self.wanted is False:
            return None
        key = kind, self.zeros, details  # a longest step is part of the code
        library = memory.ready.get(key)
        if library is None:
            allowed = self.wanted is True or is_worth_it()
            unavailable = memory.failed if allowed else memory.absent
            if key in unavailable:
                return None
            library = self._made(key, made_from, text if allowed else None, load)
            if library is None:
                unavailable.add(key)
                return None
            memory.ready[key] = library
        self.used.add(kind)
        return library

    def _made(
        self,
        wanted: _Key,
        made_from: Callable[[], tuple[Any, ...]],
        text: Callable[[], str | None] | None,
        load: Callable[[Path], T],
    ) -> Library[T] | None:
        if text is None and cache.is_empty():
            return None
        compiled = self.compiled
        given = compiled.rhs, *made_from()
        if not all(map(is_self_contained, given)):
            return None
        scales = compiled.quadratures, compiled.discretes, compiled.nominal_x.tolist(), compiled.nominal_z.tolist()
        # The key is made of the functions from which the equations follow, so that a hit needs no symbolic work.
        functions = (f.serialize() for f in given)
        key = cache.key(repr(wanted), event_loop_source(), source.rows("rosenbrock"), *functions, repr(scales))
        return made(key, text, lambda path: Library(load(path), BufferedFunction(ca.external(CONSTANTS, str(path)))))
