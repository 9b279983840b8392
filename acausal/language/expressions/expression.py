"""Expression tree of the language: small slotted nodes whose shape is known when they are made.

The language has its own nodes because CasADi symbols return `nan` for `math.sin(x)`, multiply a matrix by a vector of
the wrong size without an error, fold `x*1 == x` to a constant, and cost a hundred times more per operation (measured,
see docs/devdocs/language.md). Only `acausal.lower` uses CasADi.

Shapes: `()` scalar, `(n,)` vector, `(m, n)` matrix. Operators are elementwise between equal shapes; between matrices
only sums are, and `@` is their product. A scalar multiplies, divides, limits and is compared with anything; in a sum
only a literal number adapts, because adding a scalar to a vector in space is a mistake.
"""

from __future__ import annotations

import operator
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NoReturn

from acausal.errors import DeclarationError
from acausal.language.declarations.declaration import Declaration
from acausal.language.expressions.foreign import (
    WithoutForeignOperators,
    number_advice,
    refuse_numpy,
    truth_advice,
)
from acausal.language.statement import Statement, made

Shape = tuple[int, ...]

RELATIONS, _FLAGS = {"lt": "<", "le": "<=", "gt": ">", "ge": ">="}, ("initial", "after_reset", "terminal")
CONDITIONS = frozenset((*RELATIONS, "equals", "and", "or", "not", "sample", "edge", "change", *_FLAGS))
"""Operators whose value is always true or false; see `is_condition`."""
_INFIX = {
    "add": "+",
    "sub": "-",
    "mul": "*",
    "div": "/",
    "pow": "**",
    "matmul": "@",
    **RELATIONS,
    "and": "&",
    "or": "|",
}


_UFUNCS = {
    "add": "__add__",
    "subtract": "__sub__",
    "multiply": "__mul__",
    "divide": "__truediv__",
    "power": "__pow__",
    "matmul": "__matmul__",
    "less": "__lt__",
    "less_equal": "__le__",
    "greater": "__gt__",
    "greater_equal": "__ge__",
    "equal": "__eq__",
}
"""Operators by their names as numpy functions, which numpy calls if its array or number is the left operand."""


def _no_truth(shown: str, kind: str, advice: str) -> DeclarationError:
    return DeclarationError("AC101", f"`{shown}` is {kind}, not a truth value", help=advice)


class Expr(WithoutForeignOperators):
    """A node: operator name, operands, shape, and a payload for constants, indices and names."""

    __slots__ = ("args", "op", "payload", "shape")
    __hash__ = object.__hash__

    def __init__(self, op: str, args: tuple[Expr, ...], shape: Shape, payload: Any = None) -> None:
        self.op = op
        self.args = args
        self.shape = shape
        self.payload = payload

    def __array_ufunc__(self, function: Any, method: str, *inputs: Any, **options: Any) -> Any:
        operator = _UFUNCS.get(function.__name__)
        if operator is None or method != "__call__" or len(inputs) != 2:
            refuse_numpy(str(self), function, method)
        return getattr(as_expr(inputs[0]), operator)(as_expr(inputs[1]))

    def __add__(self, other: Operand) -> Expr:
        return _elementwise("add", self, as_expr(other))

    def __radd__(self, other: Operand) -> Expr:
        return _elementwise("add", as_expr(other), self)

    def __sub__(self, other: Operand) -> Expr:
        return _elementwise("sub", self, as_expr(other))

    def __rsub__(self, other: Operand) -> Expr:
        return _elementwise("sub", as_expr(other), self)

    def __mul__(self, other: Operand) -> Expr:
        return _product(self, as_expr(other))

    def __rmul__(self, other: Operand) -> Expr:  # type: ignore[misc]
        return _product(as_expr(other), self)

    def __truediv__(self, other: Operand) -> Expr:
        return _quotient(self, as_expr(other))

    def __rtruediv__(self, other: Operand) -> Expr:
        return _quotient(as_expr(other), self)

    def __pow__(self, other: Operand) -> Expr:
        return elementwise("pow", self, as_expr(other))

    def __rpow__(self, other: Operand) -> Expr:
        return elementwise("pow", as_expr(other), self)

    def __matmul__(self, other: Operand) -> Expr:
        return _matmul(self, as_expr(other))

    def __rmatmul__(self, other: Operand) -> Expr:
        return _matmul(as_expr(other), self)

    def __neg__(self) -> Expr:
        return Operation("neg", (self,), self.shape)

    def __pos__(self) -> Expr:
        return self

    def __abs__(self) -> Expr:
        if len(self.shape) > 1:
            raise shape_error("fabs", self)
        return Operation("fabs", (self,), self.shape)

    def __eq__(self, other: Operand) -> Equation:  # type: ignore[override]
        return Equation(self, as_expr(other))

    def __ne__(self, other: object) -> NoReturn:
        raise DeclarationError(
            "AC102", f"`{self} != ...` has no meaning for equations", help="use < and >, or where(...)"
        )

    def __lt__(self, other: Operand) -> Expr:
        return elementwise("lt", self, as_expr(other))

    def __le__(self, other: Operand) -> Expr:
        return elementwise("le", self, as_expr(other))

    def __gt__(self, other: Operand) -> Expr:
        return elementwise("gt", self, as_expr(other))

    def __ge__(self, other: Operand) -> Expr:
        return elementwise("ge", self, as_expr(other))

    def __and__(self, other: Operand) -> Expr:
        return _logical("and", self, as_expr(other))

    def __rand__(self, other: Operand) -> Expr:
        return _logical("and", as_expr(other), self)

    def __or__(self, other: Operand) -> Expr:
        return _logical("or", self, as_expr(other))

    def __ror__(self, other: Operand) -> Expr:
        return _logical("or", as_expr(other), self)

    def __invert__(self) -> Expr:
        return _logical("not", self)

    def __getitem__(self, index: int | slice | tuple[int | slice, ...]) -> Expr:
        try:
            key = tuple(map(_whole, index if isinstance(index, tuple) else (index,)))
        except TypeError:
            raise DeclarationError(
                "AC103",
                f"`{self}[{index}]`: an index is a whole number, or a slice of them",
                help="indices count from 0: v[0], v[1:-1], R[0, :]",
            ) from None
        if len(key) != len(self.shape) or not all(_is_within(k, n) for k, n in zip(key, self.shape, strict=True)):
            shown = f"element {list(key)}"
            if any(isinstance(k, slice) for k in key):
                shown = f"elements [{', '.join(map(_slice_text, key))}]"
            limits = [f"0 to {n - 1}" for n in self.shape]
            raise DeclarationError(
                "AC103",
                f"`{self}` is a {shape_text(self.shape)}; it has no {shown}",
                help=f"indices count from 0: [{', '.join(limits)}]" if limits else "use it without an index",
            )
        selected = tuple(range(n)[k] for k, n in zip(key, self.shape, strict=True))
        if not any(isinstance(p, range) for p in selected):
            return Operation("index", (self,), (), selected)
        shape = tuple(len(p) for p in selected if isinstance(p, range))
        return Operation("slice", (self,), shape, (selected, ", ".join(map(_slice_text, key))))

    if not TYPE_CHECKING:  # else `x[0] = 1.0` would pass a type checker

        def __setitem__(self, index: Any, value: Any) -> NoReturn:
            shown = ", ".join(str(k) for k in index) if isinstance(index, tuple) else index
            raise DeclarationError(
                "AC118",
                f"`{self}[{shown}]` is assigned: write `yield self.{self}[{shown}] == ...`",
                cause="an assignment states no equation",
            )

    def __iter__(self) -> Iterator[Expr]:
        return (self[i] for i in range(self._size("can be iterated")))

    def __len__(self) -> int:
        return self._size("have a length")

    def _size(self, what: str) -> int:
        if len(self.shape) != 1:
            raise DeclarationError(
                "AC103",
                f"`{self}` is a {shape_text(self.shape)}; only vectors {what}",
                help="index a matrix by row and column: R[0, 1]" if self.shape else "it has one value only",
            )
        return self.shape[0]

    @property
    def T(self) -> Expr:
        """The transpose of a matrix."""
        if len(self.shape) != 2:
            raise shape_error("transpose", self)
        return Operation("transpose", (self,), (self.shape[1], self.shape[0]))

    def __bool__(self) -> NoReturn:
        symbols = symbols_in(self)
        is_constant = all(s.declaration.kind.value == "parameter" for s in symbols)
        parameters = dict.fromkeys(s.name for s in symbols if is_constant)
        raise _no_truth(str(self), "symbolic", truth_advice(sys._getframe(1), parameters))

    def _no_number(self, what: str) -> NoReturn:
        raise DeclarationError(
            "AC104",
            f"`{self}` is symbolic and has no {what}",
            help="declare counts, indices and sizes with structural(...)"
            if what == "int value"
            else number_advice(sys._getframe(2)),
        )

    def __float__(self) -> float:
        self._no_number("float value")

    def __int__(self) -> int:
        self._no_number("int value")

    def __index__(self) -> int:
        self._no_number("int value")

    def __str__(self) -> str:
        return to_text(self)

    def __repr__(self) -> str:
        return to_text(self)


class Operation(Expr):
    """Operations on other expressions, and literals: every expression that is not a `Symbol`.

    It is a sibling of Symbol, not its base class: for `a == b` Python calls the operator of b first if the class of b
    is derived from that of a, and then `der(x) == u` would be `u == der(x)`. The side of a discrete variable matters.
    """

    __slots__ = ()


class Symbol(Expr):
    """A declared quantity of one component instance: `self.s` inside it, `mass.s` outside."""

    __slots__ = ("declaration", "name", "owner")

    def __init__(self, owner: Any, name: str, declaration: Declaration) -> None:
        super().__init__("symbol", (), declaration.shape)
        self.owner = owner
        self.name = name
        self.declaration = declaration


class Equation(Statement):
    """`left == right`, elementwise. It has no truth value."""

    __slots__ = ("left", "right")
    __hash__ = object.__hash__

    def __init__(self, left: Expr, right: Expr) -> None:
        if left.shape != right.shape and not (is_literal(right) or is_literal(left)):
            raise DeclarationError(
                "AC105",
                f"`{left} == {right}`: the left side is a {shape_text(left.shape)}, "
                f"the right side a {shape_text(right.shape)}",
                help="both sides need one shape; only a literal number adapts: v == 0"
                + ("; dot(a, b) is the scalar product of two vectors" if _has_product(left, right) else ""),
            )
        self.left = left
        self.right = right
        made(self)

    def __bool__(self) -> NoReturn:
        raise _no_truth(
            str(self),
            "an equation",
            "yield it; `a == b == c`, `in`, `if` and `assert` need a truth value, which an equation does not have",
        )

    def __str__(self) -> str:
        return equation_text(self)

    __repr__ = __str__


def _has_product(*sides: Expr) -> bool:
    """Whether a side is, up to a factor, an elementwise product of vectors."""
    stack = list(sides)
    while stack:
        e = stack.pop()
        if e.op == "mul" and all(a.shape for a in e.args):
            return True
        stack += e.args if e.op in ("mul", "div", "neg") else ()
    return False


Operand = Expr | float | int | bool | tuple[Any, ...] | list[Any]


def constant(value: Any, shape: Shape = ()) -> Expr:
    """A literal; `value` is a float, or a row-major tuple of floats for a vector or matrix."""
    return Operation("const", (), shape, value)


def is_literal(e: Expr) -> bool:
    """True for a scalar literal number, with a unit or without; it adapts to any shape in a sum or an equation."""
    return e.op in ("const", "quantity") and e.shape == ()


def as_expr(value: Any) -> Expr:
    """The expression of a number, a (nested) sequence of expressions or numbers, or an array."""
    if isinstance(value, Expr):
        return value
    if isinstance(value, bool | int | float):
        try:
            return Operation("const", (), (), float(value))
        except OverflowError:
            raise DeclarationError(
                "AC106", f"an integer of {len(str(value))} digits is too large to compute with"
            ) from None
    if hasattr(value, "tolist"):  # numpy scalars and arrays, without importing numpy
        return as_expr(value.tolist())
    if isinstance(value, tuple | list) and value:
        return stack([as_expr(v) for v in value])
    raise DeclarationError(
        "AC106",
        f"{value!r} ({type(value).__name__}) cannot take part in an equation",
        help="use numbers, declared variables, tuples of them, or the functions of acausal",
    )


def stack(parts: list[Expr]) -> Expr:
    """A vector of scalars, or a matrix of row vectors."""
    inner = parts[0].shape
    if any(p.shape != inner for p in parts) or len(inner) > 1:
        shown = ", ".join(f"`{p}` ({shape_text(p.shape)})" for p in parts)
        raise DeclarationError(
            "AC105",
            f"no vector or matrix can be made of {shown}",
            help="a vector is made of scalars, a matrix of rows of one length",
        )
    shape = (len(parts), *inner)
    if all(p.op == "const" for p in parts):
        flat = [p.payload for p in parts] if not inner else [v for p in parts for v in p.payload]
        return constant(tuple(flat), shape)
    return Operation("stack", tuple(parts), shape)


def is_condition(e: object) -> bool:
    """True for a condition: relations, boolean variables, and `&`, `|`, `~`, `pre`, `where` of these."""
    if not isinstance(e, Expr):
        return False
    has_condition = False
    stack = [e]
    while stack:
        here = stack.pop()
        if here.op in CONDITIONS or (isinstance(here, Symbol) and here.declaration.boolean):
            has_condition = True
        elif here.op in ("index", "slice", "pre", "noevent"):
            stack.append(here.args[0])
        elif here.op == "where":
            stack += here.args[1:]
        elif not is_truth(here):
            return False
    return has_condition


def assigned(equation: Equation) -> Symbol | None:
    """The discrete variable that an equation assigns: alone on the left, possibly with an index or a slice; or None."""
    left = equation.left
    if left.op in ("index", "slice"):
        left = left.args[0]
    return left if isinstance(left, Symbol) and left.declaration.discrete else None


def is_truth(e: Expr) -> bool:
    """True for the literals `True` and `False`, which are 1 and 0."""
    return e.op == "const" and e.shape == () and e.payload in (0.0, 1.0)


def checked_condition(e: object, example: str = "x > 0", *, several: bool = False) -> Expr:
    """Return `e` if it is a condition; with `several` also a vector of conditions.

    Raises DeclarationError: AC108 when it is not.
    """
    if isinstance(e, Expr) and is_condition(e):
        if not e.shape or several:
            return e
        fact, remedy = "is a vector of conditions", "one is needed here: take an element, such as condition[0]"
    elif isinstance(e, Equation):
        fact, remedy = "is an equation, not a condition", "whole numbers are compared with equals(a, b)"
    elif isinstance(e, Expr):
        fact, remedy = (
            "is a number, not a condition",
            f"write a relation such as {example}, or declare it with boolean()",
        )
    else:
        fact = f"({type(e).__name__}) is not a condition"
        remedy = f"write a relation such as {example}; use a plain `if` for a value that Python knows"
    raise DeclarationError("AC108", f"`{e}` {fact}", help=remedy)


_ELEMENTWISE = "it works on scalars and, element by element, on vectors of one length"
_SHAPES = {
    "+": "both need one shape; only a literal number adapts: fill(x, n) repeats a scalar",
    "-": "both need one shape; only a literal number adapts: fill(x, n) repeats a scalar",
    "*": "vectors of one length are multiplied element by element; use dot(a, b), cross(a, b) or a @ b",
    "/": "a scalar divides anything, a vector only vectors of its length",
    "@": "the columns of the left matrix must be as many as the rows of the right one",
    "dot": "dot takes two vectors of one length",
    "cross": "cross takes two vectors of 3",
    "skew": "skew takes a vector of 3",
    "where": "both values need one shape; only a literal number adapts",
    "transpose": "only a matrix has a transpose",
}


def shape_text(shape: Shape) -> str:
    """`scalar`, `vector of 3`, `3x3 matrix`."""
    if not shape:
        return "scalar"
    return f"vector of {shape[0]}" if len(shape) == 1 else f"{shape[0]}x{shape[1]} matrix"


def nodes(*roots: Expr, into: Callable[[Expr], Sequence[Expr]] = operator.attrgetter("args")) -> list[Expr]:
    """Expressions and their operands, from left to right; `into` returns the operands to visit of an expression.

    Each occurs only once, because there may be exponentially many paths to a shared part.
    """
    stack, by_id = list(reversed(roots)), dict[int, Expr]()
    while stack:
        e = stack.pop()
        if id(e) not in by_id:
            by_id[id(e)] = e
            stack.extend(reversed(into(e)))
    return list(by_id.values())


def symbols_in(*roots: Expr) -> list[Symbol]:
    """Symbols of expressions, each once, from left to right."""
    return [e for e in nodes(*roots) if isinstance(e, Symbol)]


def shape_error(what: str, *args: Expr) -> DeclarationError:
    """DeclarationError AC105 for operands whose shapes do not fit the operation `what`."""
    shown = " and ".join(f"`{a}` ({shape_text(a.shape)})" for a in args)
    return DeclarationError("AC105", f"{what} does not take {shown}", help=_SHAPES.get(what, _ELEMENTWISE))


def _elementwise(op: str, a: Expr, b: Expr) -> Expr:
    if a.shape == b.shape:
        return Operation(op, (a, b), a.shape)
    if is_literal(a) or is_literal(b):
        return Operation(op, (a, b), a.shape or b.shape)
    raise shape_error(_INFIX[op], a, b)


def elementwise(op: str, *operands: Expr) -> Expr:
    """Elementwise operation on scalars and vectors of one length; scalars are broadcast."""
    shapes = {a.shape for a in operands if a.shape}
    if len(shapes) > 1 or any(len(shape) > 1 for shape in shapes):
        raise shape_error(_INFIX.get(op, op), *operands)
    return Operation(op, operands, shapes.pop() if shapes else ())


def _logical(op: str, *operands: Expr) -> Expr:
    return elementwise(op, *(e if is_truth(e) else checked_condition(e, several=True) for e in operands))


def _product(a: Expr, b: Expr) -> Expr:
    if a.shape and b.shape:
        return elementwise("mul", a, b)
    return Operation("mul", (a, b), a.shape or b.shape)


def _quotient(a: Expr, b: Expr) -> Expr:
    if b.shape:
        return elementwise("div", a, b)
    return Operation("div", (a, b), a.shape)


def _matmul(a: Expr, b: Expr) -> Expr:
    if not a.shape or not b.shape or a.shape[-1] != b.shape[0]:
        raise shape_error("@", a, b)
    return Operation("matmul", (a, b), (*a.shape[:-1], *b.shape[1:]))


def _whole(key: int | slice) -> int | slice:
    """An index with numpy integers converted; DeclarationError AC104 for a symbol in it."""
    if isinstance(key, slice):
        return slice(*(None if k is None else operator.index(k) for k in (key.start, key.stop, key.step)))
    return operator.index(key)


def _is_within(key: int | slice, n: int) -> bool:
    """Whether an index or a slice is valid for n elements, and the slice not empty."""
    if not isinstance(key, slice):
        return -n <= key < n
    ends = [k for k in (key.start, key.stop) if k is not None]
    return all(-n <= k <= n for k in ends) and key.step != 0 and len(range(n)[key]) > 0


def _slice_text(key: int | slice) -> str:
    """Text of the index as written."""
    if not isinstance(key, slice):
        return str(key)
    ends = ["" if k is None else str(k) for k in (key.start, key.stop)]
    return ":".join([*ends, str(key.step)] if key.step is not None else ends)


def to_text(e: Expr, depth: int = 0, *, name_of: Callable[[Symbol], str] | None = None, binding: int = 0) -> str:
    """Python-like text of an expression with no more parentheses than needed.

    `depth` is the number of levels already written; beyond twelve the text is `...`. `name_of` returns the names of
    symbols, by default their full paths. `binding` is the precedence of the operator around `e`.
    """
    if e.op == "const":
        if not isinstance(e.payload, float):
            return _numbers(e.payload, e.shape)
        return _closed(f"{e.payload:g}", e.payload < 0.0 and binding >= _BINDING["neg"])
    if isinstance(e, Symbol):
        if name_of is not None:
            return name_of(e)
        return e.owner._path_to(e.name) if e.owner is not None else e.name
    if e.op == "time":
        return "time"
    if depth > 12:
        return "..."
    precedence = _BINDING.get(e.op, 0)
    # Operators group to the left, `**` to the right.
    inner = [precedence + ((k > 0) != (e.op == "pow")) for k in range(len(e.args))]
    if e.op in ("index", "slice", "transpose"):
        inner = [9]
    parts = [to_text(a, depth + 1, name_of=name_of, binding=i) for a, i in zip(e.args, inner, strict=True)]
    if e.op in _INFIX:
        return _closed(f"{parts[0]} {_INFIX[e.op]} {parts[1]}", precedence < binding)
    if e.op in ("neg", "not"):
        return _closed(f"{'-' if e.op == 'neg' else '~'}{parts[0]}", precedence < binding)
    if e.op == "index":
        return f"{parts[0]}[{', '.join(map(str, e.payload))}]"
    if e.op == "slice":
        return f"{parts[0]}[{e.payload[1]}]"
    if e.op == "transpose":
        return f"{parts[0]}.T"
    if e.op == "fill":
        return f"fill({parts[0]}, {e.shape[0]})"
    if e.op == "stack":
        return f"({', '.join(parts)})"
    if e.op == "quantity":
        value, unit = e.payload
        return f'quantity({_numbers(value, e.shape) if e.shape else f"{value:g}"}, "{unit}")'
    if e.op == "call":
        external, output = e.payload
        return f"{external.name}({', '.join(parts)})" + (f"[{output}]" if len(external.outputs) > 1 else "")
    return f"{e.op}({', '.join(parts)})"


def equation_text(equation: Equation, name_of: Callable[[Symbol], str] | None = None) -> str:
    """Text of an equation, with a relation on one of its sides in parentheses."""
    left, right = (to_text(e, name_of=name_of, binding=2) for e in (equation.left, equation.right))
    return f"{left} == {right}"


_BINDING = {**dict.fromkeys(RELATIONS, 1), "or": 2, "and": 3, "add": 4, "sub": 4, "mul": 5, "div": 5, "matmul": 5}
_BINDING |= {"neg": 6, "not": 6, "pow": 7}


def _closed(text: str, closed: bool) -> str:
    return f"({text})" if closed else text


def _numbers(values: tuple[float, ...], shape: Shape) -> str:
    if len(shape) == 1:
        return f"({', '.join(f'{v:g}' for v in values)})"
    width = shape[1]
    rows = [_numbers(values[k : k + width], (width,)) for k in range(0, len(values), width)]
    return f"({', '.join(rows)})"
