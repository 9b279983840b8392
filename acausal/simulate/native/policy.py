"""When compiling pays.

Compiled, an evaluation of the equations saves a call and a part of the cost of each instruction; a compiler costs its
start and a time per instruction. Both are known beforehand, so a library is made when the evaluations that were
interpreted so far have cost more than it: then no run takes more than about twice its time for it, a short first run
takes nothing, and repeated runs of one model become fast by themselves. With fixed steps the evaluations to come are
known, and count as well. A library that is on disk is always used, `native=True` makes one at once, `native=False`
uses none.

Evaluations are counted, not seconds, so that a run does the same every time. The constants are measured
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
from acausal.simulate.equations.calls.buffered import BufferedFunction
from acausal.simulate.equations.scaled import UNIT, in_units
from acausal.simulate.native import cache, source
from acausal.simulate.native.cache import made
from acausal.simulate.native.equations import CONSTANTS, by_patterns, equations
from acausal.simulate.native.event_loop import EventLoopProgram
from acausal.simulate.native.event_loop import source as event_loop_source
from acausal.simulate.native.program import HeunProgram

T = TypeVar("T")

# Saved by one evaluation, in seconds: its call, and each instruction.
_CALL, _INSTRUCTION = 1.5e-6, 4e-9
# Cost of a library, in seconds: the integrator itself, and each instruction of the equations.
_START, _COMPILED_INSTRUCTION = 0.5, 3e-4
# Instructions from which on a multistep method is slower with compiled equations: interpreted ones have the parameters
# as numbers, and their Jacobian is then partly constant.
_LARGEST_ORACLE = 2000
# Evaluations that repay writing the equations as a program of columns: 4 us an instruction, of which 3 ns are saved.
_REPAID = 1500.0
# Interpreted, operations on columns take this part of the time of their instances (docs/devdocs/mapped.md).
COLUMNS = 8


def pays(evaluations: float, size: int, code: int | None = None) -> bool:
    """Whether to compile equations of `size` instructions costs less than this number of evaluations has cost.

    `code` is the number of instructions to compile, where it is another.
    """
    return evaluations * (_CALL + _INSTRUCTION * size) > _START + _COMPILED_INSTRUCTION * (
        size if code is None else code
    )


@dataclass(frozen=True, eq=False)
class Library(Generic[T]):
    """A loaded library: what it does, and the function `(p, u) -> c` of its constants."""

    run: T
    constants: BufferedFunction

    def vector(self, p: Vector, u: Vector, numbers: Vector) -> Vector:
        """The parameter vector of its equations; `numbers` as in `Problem.numbers`."""
        return np.concatenate([self.constants(p, u)[0], numbers])


@dataclass(frozen=True, eq=False)
class StoppingEquations:
    """What a library that passes events is made of, as CasADi functions.

    `dae` and `transition` as CasADi's integrators want them, `constants` as in `equations.py`; `event_functions` are
    "judged", "event_round" and "relaxed", and "steep" where there is something steep in the rates. The first parameters
    of a DAE for compiled code are what `held` makes of the first ones of its caller.
    """

    dae: Any
    transition: Any
    constants: Any
    event_functions: tuple[Any, ...]
    held: Any = None


@dataclass(eq=False)
class Memory:
    """What was compiled for one model, found absent, or done without: shared by all its runs in a process."""

    ready: dict[str, Library[Any]] = field(default_factory=dict)
    absent: set[str] = field(default_factory=set)
    failed: set[str] = field(default_factory=set)
    evaluations: dict[str, float] = field(default_factory=dict)
    expected: float = 0.0


# Models are compared by identity, and forgotten when nobody else holds them.
_MEMORIES: WeakKeyDictionary[CompiledModel, Memory] = WeakKeyDictionary()


def expect(compiled: CompiledModel, evaluations: float) -> None:
    """Announce so many evaluations, in many runs; they decide more than what was spent so far."""
    _MEMORIES.setdefault(compiled, Memory()).expected = evaluations


class Native:
    """The compiled code of a model, as one run uses it."""

    def __init__(self, compiled: CompiledModel, wanted: bool | None, p: Vector | None = None) -> None:
        """`p` are the parameters of the run: those that are zero stay so in a library."""
        self.compiled = compiled = compiled.common
        self.zeros: tuple[int, ...] = () if p is None else tuple(np.flatnonzero(np.asarray(p) == 0.0).tolist())
        self.wanted = wanted
        self.memory = _MEMORIES.setdefault(compiled, Memory())
        self.used: set[str] = set()

    def integrator(self, plugin: str, settings: Mapping[str, Any]) -> Library[EventLoopProgram] | None:
        """A whole integrator, "rosenbrock" or "erk", that passes time events by itself where nothing is algebraic.

        Tolerances and step are arguments of the program: all values of them use the same library. Units of algebraic
        variables are appended to its parameters (`in_units`).
        """
        fixed = {"step_size": 0.25} if settings.get("step_size") else {}
        neutral = {**settings, "reltol": 1e-6, "abstol": 1e-8, "max_num_steps": 10**6, **fixed}
        kind = f"{plugin}, fixed steps" if fixed else plugin

        def text() -> str | None:
            dae, constants = self.equations
            written = source.integrator(plugin, in_units(dae) if self.compiled.algebraic else dae, neutral, constants)
            return None if written is None else f"{written}#define PLAIN\n{event_loop_source()}"

        def load(path: Path) -> EventLoopProgram:
            return EventLoopProgram(path, self._nx, len(self.compiled.algebraic))

        return self._library(kind, repr(sorted(neutral.items())), lambda: self._pays(self._spent(plugin)), text, load)

    def stopping(
        self,
        plugin: str,
        settings: Mapping[str, Any],
        equations: Callable[[], StoppingEquations],
        made_from: Callable[[], tuple[Any, ...]],
        nx: int,
        instructions: Callable[[], int],
    ) -> Library[EventLoopProgram] | None:
        """A whole integrator that stops at events (`simulate/events/location/stopping.py`).

        `equations` makes what it integrates, `nx` states; with the rates and rounds of the model all of it follows from
        what it is `made_from`. `instructions` is the size of its event functions.
        """
        if self.wanted is False:  # asked for at every event
            return None
        fixed = {"step_size": 0.25} if settings.get("step_size") else {}
        neutral = {**settings, "reltol": 1e-6, "abstol": 1e-8, **fixed}
        kind = f"{plugin}, events" + (", fixed steps" if fixed else "")

        def text() -> str | None:
            made = equations()
            with contextlib.redirect_stderr(io.StringIO()):  # CasADi says that events are experimental
                whole = {**neutral, "transition": made.transition}
                written = source.integrator(
                    plugin, made.dae, whole, made.constants, *made.event_functions, held=made.held
                )
            has_steep = any(f.name() == "steep" for f in made.event_functions)
            return (
                None if written is None else f"{written}{'#define STEEP' if has_steep else ''}\n{event_loop_source()}"
            )

        def load(path: Path) -> EventLoopProgram:
            return EventLoopProgram(path, nx, 0)

        def pays_now() -> bool:
            # the derivatives that locate events are twice as much again as the event functions
            return pays(self._spent(kind), self._size, 4 * self._size + 3 * instructions())

        def whole() -> tuple[Any, ...]:
            return self.compiled.events.round, *made_from()

        return self._library(kind, repr(sorted(neutral.items())), pays_now, text, load, whole)

    def oracle(
        self, plugin: str, settings: Mapping[str, Any], change: Callable[[Any], Any] | None = None
    ) -> Library[Any] | None:
        """Right-hand side and Jacobian for one of CasADi's integrators, as the oracle to give it.

        `change` makes another form of the equations: CasADi takes compiled derivatives only of what was compiled, and
        differences where there are none. Only on request, and not for large models: most of the time of a multistep
        method is spent elsewhere.
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
        return self._library(kind, "", lambda: False, text, lambda path: ca.external("dae", str(path)))

    def heun(self, step: Callable[[Any], Any], evaluations: float) -> Library[HeunProgram] | None:
        """Heun's method; `step` makes the function `(x, [t, h], p) -> x` of a DAE without algebraic variables.

        `evaluations` is the number of those to come.
        """

        def text() -> str:
            dae, constants = self.equations
            return source.heun(step(dae), constants)

        expected = self._spent("heun") + evaluations
        return self._library("heun", "", lambda: self._pays(expected), text, lambda path: HeunProgram(path, self._nx))

    def by_columns(self, plugin: str) -> bool:
        """Whether the equations of a multistep method are evaluated by columns, where they have any."""
        return self.wanted is not False and (self.wanted is True or self._spent(plugin) >= _REPAID)

    def notes(self, solver: str) -> tuple[str, ...]:
        """Notes for a run that asked for compiled code and got none."""
        if not self.wanted or self.used:
            return ()
        if cache.compiler() is None:
            why = "no C compiler was found ($CC, cc, gcc, clang)"
        elif self.memory.failed:
            why = f"{cache.compiler()} failed, its words are in the log"
        else:
            why = f"'{solver}' has none for this model"
        return (f"compiled code was asked for; the run was interpreted: {why}",)

    def interpreted(self, kind: str, evaluations: float) -> None:
        """Remember what an interpreted stretch of time has cost."""
        self.memory.evaluations[kind] = self._spent(kind) + evaluations

    @cached_property
    def equations(self) -> tuple[Any, Any]:
        """See `equations.py`."""
        return equations(self.compiled, self.zeros)

    @property
    def _nx(self) -> int:
        return self.compiled.n_dynamic

    @property
    def _size(self) -> int:
        return int(self.compiled.rhs.n_instructions())

    def _pays(self, evaluations: float) -> bool:
        """`pays` for equations that may be there by patterns."""
        form = self.compiled.mapped(self.zeros)
        if form is None:
            return pays(evaluations, self._size)
        return pays(evaluations, self._size // COLUMNS, form.operations if by_patterns(self.compiled) else self._size)

    def _spent(self, kind: str) -> float:
        return self.memory.evaluations.get(kind, 0.0) + self.memory.expected

    def _library(
        self,
        kind: str,
        details: str,
        is_worth_it: Callable[[], bool],
        text: Callable[[], str | None],
        load: Callable[[Path], T],
        made_from: Callable[[], tuple[Any, ...]] = tuple,
    ) -> Library[T] | None:
        """The library of this kind and these `details`: of the rates, and other functions it is `made_from`."""
        memory = self.memory
        if self.wanted is False:
            return None
        used = kind
        kind = f"{kind}, zero {self.zeros}"
        if kind not in memory.ready:
            allowed = self.wanted is True or is_worth_it()
            tried = memory.failed if allowed else memory.absent
            if kind in tried:
                return None
            found = self._made(kind, details, made_from, text if allowed else None, load)
            if found is None:
                tried.add(kind)
                return None
            memory.ready[kind] = found
        self.used.add(used)
        return memory.ready[kind]

    def _made(
        self,
        kind: str,
        details: str,
        made_from: Callable[[], tuple[Any, ...]],
        text: Callable[[], str | None] | None,
        load: Callable[[Path], T],
    ) -> Library[T] | None:
        if text is None and cache.is_empty():
            return None
        compiled = self.compiled
        scales = compiled.quadratures, compiled.discretes, compiled.nominal_x.tolist(), compiled.nominal_z.tolist()
        # What the equations are made from rather than they: a hit needs nothing that is symbolic.
        functions = (f.serialize() for f in (compiled.rhs, *made_from()))
        key = cache.key(kind, details, event_loop_source(), source.rows("rosenbrock"), *functions, repr(scales))
        return made(key, text, lambda path: Library(load(path), BufferedFunction(ca.external(CONSTANTS, str(path)))))
