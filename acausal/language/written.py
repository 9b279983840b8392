"""The source of a single instruction: the expression that Python was computing, as the modeller wrote it."""

from __future__ import annotations

import ast
import linecache
from types import CodeType


def written(code: CodeType, lasti: int) -> str:
    """Source text of the expression that an instruction computes; empty without source."""
    positions = list(code.co_positions())
    line, end_line, column, end_column = positions[lasti // 2] if lasti >= 0 else (None,) * 4
    if line is None or end_line is None or column is None or end_column is None:
        return ""
    lines = [linecache.getline(code.co_filename, n).encode() for n in range(line, end_line + 1)]  # columns count bytes
    if len(lines) == 1:
        lines[0] = lines[0][column:end_column]
    else:
        lines[0], lines[-1] = lines[0][column:], lines[-1][:end_column]
    return " ".join(part.decode(errors="ignore").strip() for part in lines)


def parsed(text: str) -> ast.AST | None:
    """An expression or a statement of a source text; None if it is no Python, as the head of a loop is none."""
    try:
        (statement,) = ast.parse(text.removeprefix("yield ").strip()).body
    except (SyntaxError, ValueError):
        return None
    return statement.value if isinstance(statement, ast.Expr) else statement


def called_name(node: ast.AST | None) -> str:
    """`sin` for a call of `sin` or `math.sin`; empty for anything but a call."""
    if not isinstance(node, ast.Call):
        return ""
    return node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
