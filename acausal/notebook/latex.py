"""LaTeX of equations, from their text: `v == R * i` becomes `v = R\\,i`."""

from __future__ import annotations

import ast
import re

_GREEK = {
    *("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "kappa", "lambda", "mu", "nu", "xi", "pi"),
    *("rho", "sigma", "tau", "phi", "chi", "psi", "omega", "Gamma", "Delta", "Theta", "Phi", "Psi", "Omega"),
}
_COMPARED: dict[type[ast.cmpop], str] = {
    ast.Eq: "=",
    ast.NotEq: r"\neq",
    ast.Lt: "<",
    ast.LtE: r"\leq",
    ast.Gt: ">",
    ast.GtE: r"\geq",
}
# A longer formula would be harder to read than the source.
LONGEST = 300
_FUNCTIONS = {"sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "min", "max"}
_RENAMED = {"asin": "arcsin", "acos": "arccos", "atan": "arctan", "minimum": "min", "maximum": "max"}
# Precedence of operators; operands of lower precedence go into brackets. A derivative at the end of a product is
# "open": a factor after it would be differentiated, too.
_TERNARY, _COMPARISON, _OR, _AND, _SUM, _OPEN, _PRODUCT, _SIGN, _POWER, _ATOM = range(10)


def latex(text: str) -> str | None:
    """An equation, a `when` or an expression in LaTeX; None for other texts (assertions, connections) and long ones.

    `text`: Python, as in sources and in printed equations.
    """
    if len(text) > LONGEST:
        return None
    try:
        tree = ast.parse(text, mode="eval").body
        return _when(tree) if _called(tree) == "when" else _equation(tree)
    except (SyntaxError, _Untypeset):
        return None


class _Untypeset(Exception):
    """Raised for code that has no form in a formula."""


def _equation(tree: ast.expr) -> str:
    """An equation at the top level: its equality sign is not a comparison of values."""
    if isinstance(tree, ast.Compare) and len(tree.ops) == 1:
        value, binding = _written(tree.comparators[0])
        # cases at the end need no brackets besides their brace
        right = value if binding == _TERNARY else _at(tree.comparators[0], _SUM)
        return f"{_at(tree.left, _SUM)} {_COMPARED[type(tree.ops[0])]} {right}"
    if isinstance(tree, ast.Call) and _called(tree) == "reset":
        target, new = tree.args
        return f"{_written(target)[0]} := {_written(new)[0]}"
    raise _Untypeset


def _when(tree: ast.expr) -> str:
    """LaTeX of `when(condition, a, b)`; one with further branches remains text."""
    if not isinstance(tree, ast.Call) or not isinstance(tree.func, ast.Name) or tree.keywords:
        raise _Untypeset
    condition, *body = tree.args
    return rf"\mathrm{{when}}\ {_written(condition)[0]}:\ \ " + r",\ \ ".join(map(_equation, body))


def _at(tree: ast.expr, context: int) -> str:
    """An expression in a context of this precedence, in brackets if its own is lower."""
    text, binding = _written(tree)
    return text if binding >= context else rf"\left({text}\right)"


def _beside(tree: ast.expr, context: int) -> str:
    """The same after another sign: an expression that starts with a sign goes into brackets."""
    text = _at(tree, context)
    return rf"\left({text}\right)" if text.startswith("-") else text


def _factor(tree: ast.expr) -> tuple[str, int]:
    """(LaTeX of the last factor of a product or the operand of a sign, precedence of the expression that it ends)."""
    return _beside(tree, _OPEN), _OPEN if _written(tree)[1] == _OPEN else _PRODUCT


def _written(tree: ast.expr) -> tuple[str, int]:
    """(LaTeX of an expression, its precedence)."""
    match tree:
        case ast.Constant(value=bool() | int() | float() as value):
            return _number(value), _ATOM
        case ast.Name() | ast.Attribute() | ast.Subscript():
            return _name(tree), _ATOM
        case ast.Compare(ops=[op]):
            sides = _at(tree.left, _SUM), _at(tree.comparators[0], _SUM)
            return f"{sides[0]} {_COMPARED.get(type(op), '=')} {sides[1]}", _COMPARISON
        case ast.UnaryOp(op=ast.USub()):
            text, binding = _factor(tree.operand)
            return f"-{text}", binding
        case ast.UnaryOp(op=ast.Invert() | ast.Not()):
            return rf"\neg {_at(tree.operand, _ATOM)}", _SIGN
        case ast.BinOp():
            return _binary(tree)
        case ast.IfExp():
            return _cases([(tree.body, tree.test)], tree.orelse)
        case ast.Call():
            return _call(tree)
        case ast.Slice(lower=lower, upper=upper, step=None):
            return ":".join("" if end is None else _written(end)[0] for end in (lower, upper)), _ATOM
        case ast.Tuple() | ast.List():
            return rf"\left({', '.join(_written(e)[0] for e in tree.elts)}\right)", _ATOM
    raise _Untypeset


def _binary(tree: ast.BinOp) -> tuple[str, int]:
    left, right = tree.left, tree.right
    match tree.op:
        case ast.Add():
            return f"{_at(left, _SUM)} + {_beside(right, _SUM)}", _SUM
        case ast.Sub():
            return f"{_at(left, _SUM)} - {_beside(right, _OPEN)}", _SUM
        case ast.Mult():
            # two adjacent numbers would read as one
            second, binding = _factor(right)
            sign = r" \cdot " if second[:1].isdigit() else r"\,"
            return f"{_at(left, _PRODUCT)}{sign}{second}", binding
        case ast.MatMult():
            second, binding = _factor(right)
            return rf"{_at(left, _PRODUCT)} \cdot {second}", binding
        case ast.Div():
            return rf"\frac{{{_written(left)[0]}}}{{{_written(right)[0]}}}", _PRODUCT
        case ast.Pow():
            base, binding = _written(left)
            # a fraction, a root or a power as a base needs brackets
            closed = base if binding == _ATOM and "^" not in base else rf"\left({base}\right)"
            return f"{closed}^{{{_written(right)[0]}}}", _POWER
        case ast.BitAnd():
            return rf"{_at(left, _AND)} \wedge {_at(right, _AND)}", _AND
        case ast.BitOr():
            return rf"{_at(left, _OR)} \vee {_at(right, _OR)}", _OR
    raise _Untypeset


def _call(tree: ast.Call) -> tuple[str, int]:
    name = _called(tree)
    if (
        not name
        or name in ("connect", "assert_", "when", "reset")
        or any(isinstance(a, ast.Starred) for a in tree.args)
    ):
        raise _Untypeset
    if name == "der" and len(tree.args) == 1:
        inner = _written(tree.args[0])[0]
        return (
            (rf"\dot{{{inner}}}", _ATOM) if len(inner) == 1 else (rf"\frac{{d}}{{dt}}{_at(tree.args[0], _ATOM)}", _OPEN)
        )
    match tree.args:
        case [ast.Constant(value=int() | float() as value), ast.Constant(value=str(unit))] if name == "quantity":
            return rf"{_number(value)}\,\mathrm{{{unit}}}", _PRODUCT
    if name == "sqrt":
        return rf"\sqrt{{{_written(tree.args[0])[0]}}}", _ATOM
    if name in ("abs", "fabs"):
        return rf"\left|{_written(tree.args[0])[0]}\right|", _ATOM
    if name in ("noevent", "no_event"):
        return _written(tree.args[0])
    if name == "where" and len(tree.args) == 3:
        condition, one, other = tree.args
        branches = [(one, condition)]
        while isinstance(other, ast.Call) and _called(other) == "where" and len(other.args) == 3:
            condition, one, other = other.args
            branches.append((one, condition))
        return _cases(branches, other)
    if name in ("cross", "dot") and len(tree.args) == 2:
        sign = r"\times" if name == "cross" else r"\cdot"
        # a factor after it would belong to the second vector
        return rf"{_at(tree.args[0], _ATOM)} {sign} {_at(tree.args[1], _ATOM)}", _OPEN
    name = _RENAMED.get(name, name)
    shown = rf"\{name}" if name in _FUNCTIONS or name.startswith("arc") else rf"\mathrm{{{_plain(name)}}}"
    arguments = [_written(a)[0] for a in tree.args] + [_written(k.value)[0] for k in tree.keywords]
    return rf"{shown}\left({', '.join(arguments)}\right)", _ATOM


def _cases(branches: list[tuple[ast.expr, ast.expr]], other: ast.expr) -> tuple[str, int]:
    lines = [rf"{_written(value)[0]} & \mathrm{{if}}\ {_written(condition)[0]}" for value, condition in branches]
    lines.append(rf"{_written(other)[0]} & \mathrm{{otherwise}}")
    return r"\begin{cases} " + r" \\ ".join(lines) + r" \end{cases}", _TERNARY


def _called(tree: ast.expr) -> str:
    return tree.func.id if isinstance(tree, ast.Call) and isinstance(tree.func, ast.Name) else ""


def _number(value: bool | int | float) -> str:
    if isinstance(value, bool):
        return rf"\mathrm{{{str(value).lower()}}}"
    mantissa, e, exponent = f"{value:.12g}".partition("e")
    if not e:
        return mantissa
    power = f"10^{{{int(exponent)}}}"
    return power if mantissa == "1" else rf"{mantissa} \cdot {power}"


def _name(tree: ast.expr) -> str:
    """A path such as `p.v`: of each name, the part after the first underscore becomes an index."""
    match tree:
        case ast.Name(id=name):
            return _symbol(name)
        case ast.Attribute(value=ast.Attribute(attr="R") as rotation, attr="T"):
            return f"{_name(rotation)}^{{T}}"
        case ast.Attribute(value=ast.Name() | ast.Attribute() | ast.Subscript() as value, attr=name):
            return f"{_name(value)}.{_symbol(name)}"
        case ast.Attribute(value=value, attr="T"):
            return f"{_at(value, _ATOM)}^{{T}}"
        case ast.Subscript(value=value, slice=index):
            entries = index.elts if isinstance(index, ast.Tuple) else [index]
            return f"{_name(value)}[{', '.join(_written(e)[0] for e in entries)}]"
        case ast.Call():
            return _call(tree)[0]
        case ast.BinOp() | ast.UnaryOp():
            return rf"\left({_written(tree)[0]}\right)"
    raise _Untypeset


def _symbol(name: str) -> str:
    head, _, index = name.strip("_").partition("_")
    head = head or name
    # the number of x1 and u2 becomes an index, unless the name has one, as k_c11
    numbered = re.fullmatch(r"([A-Za-z]+?)(\d+)", head)
    if numbered and not index:
        head, index = numbered[1], numbered[2]
    if head in _GREEK:
        shown = r"\varphi" if head == "phi" else rf"\{head}"
    else:
        shown = head if len(head) == 1 else rf"\mathrm{{{_plain(head)}}}"
    return rf"{shown}_{{\mathrm{{{_plain(index)}}}}}" if index else shown


def _plain(text: str) -> str:
    return text.replace("_", r"\_")
