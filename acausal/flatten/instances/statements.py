"""The generator methods of a component are run: its equations, connections and ties with their places in the source.

The place of a statement is taken from the frame of the generator that yields it, even through `yield from`.
"""

from __future__ import annotations

import dis
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from functools import cache
from traceback import walk_tb
from types import CodeType
from typing import Any

from acausal.errors import DeclarationError, Span
from acausal.language.component import STATING, Component
from acausal.language.connections.connect import Connection
from acausal.language.declarations.declaration import Kind
from acausal.language.declarations.declare import check_discrete
from acausal.language.declarations.misuse import called
from acausal.language.events import Assertion, When
from acausal.language.expressions.conditions import is_discrete
from acausal.language.expressions.dimensions import check_dimensions
from acausal.language.expressions.expression import Equation, Expr, Symbol, assigned, is_condition, nodes
from acausal.language.model_code import OF_PYTHON, in_model_code
from acausal.language.statement import RECORDING, Ledger, Origin, refuse_discarded_generators, refuse_lost

Statement = tuple[Any, Origin]
_COMPUTES = frozenset(("BINARY_OP", "COMPARE_OP", "UNARY_NEGATIVE", "UNARY_INVERT"))


def statements(component: Component, method: str = "equations") -> list[Statement]:
    """Statements yielded by `method` of every class in the MRO, base classes first, with checked dimensions."""
    stated: list[Statement] = []
    for cls in reversed(type(component).__mro__):
        function = cls.__dict__.get(method)
        if function is not None:
            stated += run(component, cls.__name__, method, function)
    return stated


def refuse_unstated(components: Iterable[Component]) -> None:
    """Refuse statements made in `build` that no generator method of the component yields (AC186)."""
    for component in components:
        stated: Ledger | None = component.__dict__.get("_stated")
        if stated:
            lost = dict(stated)
            for method in STATING:
                for item, _ in statements(component, method):
                    lost.pop(id(item), None)
            refuse_lost(f"{type(component).__name__}.build", lost)


def run(component: Component, cls: str, method: str, function: Callable[..., Any], *args: Any) -> list[Statement]:
    """Statements yielded by one generator method.

    Raises DeclarationError: AC129 if the method is no generator, AC130 for an item that is no statement.
    """
    form = f"def {method}(self) -> Equations"
    generator = called(f"{cls}.{method}", form, function, component, *args)
    if not isinstance(generator, Generator):
        what = "yields nothing" if generator is None else f"returns a {type(generator).__name__} and yields nothing"
        raise DeclarationError(
            "AC129",
            f"{cls}.{method} {what}",
            where=(Span(function.__code__.co_filename, function.__code__.co_firstlineno),),
            help="every equation needs a `yield`: yield left == right",
        )
    refuse_discarded_generators(type(component), f"{cls}.{method}", function)
    _refuse_idle(f"{cls}.{method}", function)
    ledger, items = Ledger(), list[Statement]()
    for item, origin in _stepped(component, generator, ledger):
        if isinstance(item, Equation) and method != "ties":
            check_dimensions(item, _Where(origin))  # type: ignore[arg-type]
            _check_discrete(item, origin)
        elif isinstance(item, When | Assertion) and method == "equations":
            for branch in (item, *item.branches) if isinstance(item, When) else (item,):
                for action in branch.actions if isinstance(branch, When) else ():
                    check_dimensions(Equation(action.target, action.value), _Where(origin))  # type: ignore[arg-type]
                for condition in branch.conditions if isinstance(branch, When) else (branch.condition,):
                    check_dimensions(Equation(condition, condition), _Where(origin))  # type: ignore[arg-type]
        elif method != "ties" and not (isinstance(item, Connection) and method == "equations"):
            raise DeclarationError(
                "AC130",
                f"{cls}.{method} yields `{item}` ({type(item).__name__})",
                where=(origin.span(),),
                cause="two plain numbers, or two connectors, were compared, which gives True or False, not an equation"
                if isinstance(item, bool)
                else None,
                help="yield an equation `left == right`"
                + (", connect(a, b), when(...) or assert_(...)" if method == "equations" else ""),
            )
        items.append((item, origin))
    refuse_lost(f"{cls}.{method}", ledger)
    return items


def _stepped(component: Component, generator: Generator[Any, Any, Any], ledger: Ledger) -> Iterator[Statement]:
    """The items of a generator with their places; statements that it makes without yielding them stay in the ledger.

    Adds the component to errors of library functions, which do not know it. The place of such an error is the line of
    the modeller's code that calls the function, or, if equations of the library call it, where the component was made.
    """
    while True:
        token = RECORDING.set(ledger)
        try:
            item = next(generator)
        except StopIteration:
            return
        except DeclarationError as error:
            path = component._path_to("")[:-1]
            if error.attribute_to(f"{path} ({type(component).__name__})" if path else type(component).__name__):
                calls = [Span(f.f_code.co_filename, line) for f, line in walk_tb(error.__traceback__)][1:]
                callers = tuple(s for s in calls if not s.of_library)[-1:]
                error.where = callers or (component.__dict__["_origin"].span(),)
            raise
        except (*OF_PYTHON, RecursionError) as error:
            raise in_model_code(error)  # noqa: B904 (it sets the cause)
        finally:
            RECORDING.reset(token)
        ledger.pop(id(item), None)
        yield item, _origin_of(generator)


def _origin_of(generator: Generator[Any, Any, Any]) -> Origin:
    """The place of the statement that `generator`, which was just resumed, has yielded."""
    inner: Any = generator
    while getattr(inner.gi_yieldfrom, "gi_frame", None) is not None:
        inner = inner.gi_yieldfrom
    frame = inner.gi_frame
    return Origin(frame.f_code, frame.f_lasti)


def _refuse_idle(where: str, function: Callable[..., Any]) -> None:
    """Refuse a sum, a product or a relation alone on a line: `der(x) + x` without `== 0` (AC186)."""
    code = getattr(function, "__code__", None)
    line = _idle(code) if code is not None else None
    if code is not None and line is not None:
        raise DeclarationError(
            "AC186",
            f"{where} computes an expression and discards it",
            where=(Span(code.co_filename, line),),
            cause="an expression alone on a line is no equation: only yielded equations are part of the model",
            help="yield an equation: yield left == right",
        )


@cache
def _idle(code: CodeType) -> int | None:
    """First line whose value is computed and discarded, except equations, which the ledger finds."""
    before = None
    for step in dis.get_instructions(code):
        if step.opname == "POP_TOP" and before is not None and before.opname in _COMPUTES and before.argrepr != "==":
            return before.positions.lineno if before.positions else code.co_firstlineno
        before = step
    return None


def _check_discrete(equation: Equation, origin: Origin) -> None:
    """Refuse `pre` of a continuous variable (AC146), and values that a boolean or integer cannot have (AC147)."""
    target = assigned(equation)
    if target is not None:
        try:
            check_discrete(f"`{equation.left}`", target.declaration, equation.right)
        except DeclarationError as error:
            error.where = (origin.span(),)
            raise
    for e in nodes(equation.left, equation.right):
        if e.op == "pre" and not is_discrete(e.args[0]):
            raise DeclarationError(
                "AC146",
                f"`{e}`: `{e.args[0]}` is not discrete",
                where=(origin.span(),),
                evidence=[str(equation)],
                cause="it changes continuously between events, so that it has no previous value",
                help="use it in a `when`, or keep the value in a discrete(): "
                "yield when(condition, reset(self.held, x))",
            )
        if e.op == "der" and (wrong := _no_derivative(e.args[0])) is not None:
            what, cause, remedy = wrong
            raise DeclarationError(
                "AC144", f"`{e}`: {what}", where=(origin.span(),), evidence=[str(equation)], cause=cause, help=remedy
            )


def _no_derivative(e: Expr) -> tuple[str, str, str] | None:
    """(Fact, cause, remedy) if an expression must not be differentiated; None if it may be."""
    if (symbol := _piecewise_constant(e)) is not None:
        kind = "discrete" if symbol.declaration.discrete else f"a {symbol.declaration.kind.value}"
        return (
            f"`{symbol}` is {kind} and has no derivative",
            "it keeps its value between events" if symbol.declaration.discrete else "it is constant in a run",
            f"declare a quantity that changes in time by variable(): {symbol.name}: Real = variable(...)",
        )
    if (jump := _jump(e)) is not None:
        return (
            f"`{jump}` jumps and has no derivative",
            "the derivative is zero between the jumps and infinite at them, so that its integral would be wrong",
            "leave the jump out of der(...), or smooth it: tanh(x / width) for sign(x)",
        )
    if (part := _switching(e)) is not None:
        return (
            f"`{part}` switches, and the expression around it has no name",
            "where it jumps the derivative is an impulse, which a run detects for variables only",
            "declare a variable for it: yield self.q == ..., and der(self.q)",
        )
    return None


def _jump(e: Expr) -> Expr | None:
    """A term that jumps, alone or with a constant factor; with other factors it may be continuous, like x sign(x)."""

    def terms(e: Expr) -> Sequence[Expr]:
        if e.op in ("add", "sub", "neg"):
            return e.args
        return [a for a, b in (e.args, e.args[::-1]) if not _varies(b)] if e.op in ("mul", "div") else ()

    return next((here for here in nodes(e, into=terms) if here.op in ("sign", "floor", "ceil")), None)


def _switching(e: Expr) -> Expr | None:
    """The part of an expression that may jump at an event; None if the expression is a variable or a condition.

    Jumps of differentiated variables are detected when they occur in a run (AC507, AC039).
    """
    if isinstance(e, Symbol) or is_condition(e):
        return None
    for here in nodes(e, into=lambda n: () if n.op in ("noevent", "where") else n.args):
        if here.op in ("sign", "floor", "ceil", "pre") or (here.op == "where" and not here.payload):
            return here
        if isinstance(here, Symbol) and here.declaration.discrete:
            return here
    return None


def _varies(e: Expr) -> bool:
    return any(n.op == "time" or (isinstance(n, Symbol) and n.declaration.kind is not Kind.PARAMETER) for n in nodes(e))


def _piecewise_constant(e: Expr) -> Symbol | None:
    """A symbol of an expression that is constant between events; None if it varies."""
    first_symbol = None
    for here in nodes(e):
        if isinstance(here, Symbol):
            first_symbol = here if first_symbol is None else first_symbol
            if not (here.declaration.discrete or here.declaration.kind is Kind.PARAMETER):
                return None
        elif here.op in ("time", "call"):
            return None
    return first_symbol


class _Where:
    """A sequence of one span, which is computed only when an error prints it."""

    def __init__(self, origin: Origin) -> None:
        self._origin = origin

    def __iter__(self) -> Iterator[Any]:
        yield self._origin.span()

    def __bool__(self) -> bool:
        return True
