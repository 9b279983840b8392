"""The reference pages, from the classes, the options and the messages themselves: `python docs/generate.py`."""

from __future__ import annotations

import ast
import inspect
import math
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import typer.main
from error_examples import Example as ErrorExample
from error_examples import examples as error_examples
from examples import example

import acausal
from acausal.cli.arguments.catalogue import Part, families, library_parts
from acausal.cli.main import app
from acausal.cli.models.component import described
from acausal.diagram.symbols import symbol_of
from acausal.notebook.latex import latex

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
REFERENCE = HERE / "reference"

# How symbols are drawn here: in the colour of the text, on light and dark pages.
_STYLE = "fill:none;stroke:currentColor;stroke-width:1.5"
_MARKS = {
    "b": "fill:none",
    "f": "fill:currentColor;fill-opacity:0.25",
    "w": "stroke-width:2.5",
    "t": "fill:currentColor;stroke:none;text-anchor:middle",
}

# What each group of codes is about, by their first digit.
GROUPS = {
    "0": "Usage",
    "1": "Models: declarations, units, connections",
    "2": "Structure of the equations",
    "3": "Start values",
    "4": "Integration",
    "5": "Events",
    "6": "Export",
    "7": "Optimal control",
    "9": "Defects of acausal and limits of the machine",
}


def main() -> None:
    """Write all pages anew."""
    REFERENCE.mkdir(exist_ok=True)
    for stale in REFERENCE.glob("*.md"):
        stale.unlink()
    pages = {f"library-{family}": _family(family) for family in families()}
    pages |= {"commands": _commands(), "python": _python(), "errors": _errors()}
    for name, lines in pages.items():
        (REFERENCE / f"{name}.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _family(family: str) -> Iterator[str]:
    yield f"# Library: {family}"
    yield ""
    yield f"The components of `acausal.library.{family}`, in the order of their names."
    yield f"`acausal info {family}.NAME` prints the same in a terminal."
    yield ""
    for part in library_parts():
        if part.family != family:
            continue
        content = _content(part)
        file, _, line = content["source"].rpartition(":")
        file = "library/" + file.rpartition("library/")[2]
        yield f"## {part.name}"
        yield ""
        yield part.doc
        yield ""
        yield from ("```python", content["import"], "```", "")
        yield from _symbol(_class(part))
        yield f"A {part.kind}; source: `{file}`, line {line}."
        yield ""
        yield from _table(
            ("connector", "type", "carries"), [(c["path"], c["type"], c["carries"]) for c in content["connectors"]]
        )
        for key, title in (
            ("parameters", "parameter"),
            ("structural", "structural argument"),
            ("inputs", "input"),
            ("outputs", "output"),
            ("variables", "variable"),
        ):
            rows = [(d["path"], d["default"] or "", d["unit"], _limits(d), d["doc"]) for d in content[key]]
            yield from _table((title, "default", "unit", "limits", "meaning"), rows)
        yield from _table(("part", "type", "meaning"), [(p["path"], p["type"], p["doc"]) for p in content["parts"]])
        yield from _equations(content["equations"])
        yield from example(part, REFERENCE / "pictures")


def _symbol(cls: Any) -> Iterator[str]:
    """The symbol that diagrams draw the component with; none for connectors and bases."""
    drawn = symbol_of(cls)
    if not drawn:
        return
    for mark, style in _MARKS.items():
        drawn = drawn.replace(f'class="{mark}"', f'style="{style}"')
    yield from (
        "```{raw} html",
        f'<svg width="120" height="80" viewBox="-2 -2 64 44" style="{_STYLE}">{drawn}</svg>',
        "```",
        "",
    )


def _equations(equations: list[dict[str, str]]) -> Iterator[str]:
    """Formulas typeset; what is none (assertions, connections, long ones) as it is written."""
    formulas, texts = [], []
    for e in equations:
        formula = latex(e["text"])
        note = rf"\qquad\text{{({e['when']})}}" if e["when"] else ""
        if formula is not None:
            formulas.append(f"{formula}{note}")
        else:
            texts.append(e["text"] + f"    # {e['when']}" * bool(e["when"]))
    if formulas:
        yield from ("```{math}", r"\begin{aligned}", " \\\\\n".join(formulas), r"\end{aligned}", "```", "")
    if texts:
        yield from ("```python", *texts, "```", "")


@cache
def _content(part: Part) -> dict[str, Any]:
    return described(part, _class(part))


def _class(part: Part) -> Any:
    return getattr(import_module(f"acausal.library.{part.family}"), part.name)


def _limits(d: Mapping[str, Any]) -> str:
    texts = [f"≥ {d['min']:g}" * (d["min"] > -math.inf), f"≤ {d['max']:g}" * (d["max"] < math.inf)]
    return ", ".join(t for t in texts if t)


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> Iterator[str]:
    """A table of Markdown; the first column is code."""
    if not rows:
        return
    kept = [k for k in range(len(head)) if k == 0 or any(row[k] for row in rows)]
    yield "| " + " | ".join(head[k] for k in kept) + " |"
    yield "|---" * len(kept) + "|"
    for row in rows:
        first, *rest = (str(row[k]).replace("|", "\\|").replace("\n", " ") for k in kept)
        cells = [f"`{first}`", *rest]
        yield "| " + " | ".join(cells) + " |"
    yield ""


def _commands() -> Iterator[str]:
    yield "# Commands"
    yield ""
    yield "Every command and its options, as `acausal VERB --help` prints them."
    yield ""
    group: Any = typer.main.get_command(app)
    yield from _command("acausal", group)


def _command(name: str, command: Any) -> Iterator[str]:
    if name != "acausal":
        yield f"## {name}"
        yield ""
        yield inspect.cleandoc(command.help or "").replace("\b", "")
        yield ""
    rows = []
    for p in command.params:
        if getattr(p, "hidden", False):
            continue
        spelled = ", ".join([*p.opts, *p.secondary_opts]) if p.param_type_name == "option" else (p.metavar or p.name)
        value = "" if getattr(p, "is_flag", False) or p.param_type_name != "option" else str(p.metavar or "")
        rows.append((spelled, value, getattr(p, "help", "") or ""))
    yield from _table(("option", "value", "meaning"), rows)
    for verb, inner in getattr(command, "commands", {}).items():
        yield from _command(f"{name} {verb}", inner)


def _python() -> Iterator[str]:
    """Every public name by its own docstring."""
    yield "# Python"
    yield ""
    yield "Every public name of the package `acausal`, with its docstring."
    yield ""
    names = [n for n in dir(acausal) if not n.startswith("_")] + list(acausal._LAZY)
    for name in sorted(set(names), key=str.lower):
        value = getattr(acausal, name)
        doc = inspect.getdoc(value)
        if inspect.ismodule(value) or not doc or not getattr(value, "__module__", "acausal").startswith("acausal"):
            continue
        yield f"## {name}"
        yield ""
        if callable(value):
            yield from ("```python", f"{name}{_signature(value)}", "```", "")
        yield from ("```text", doc, "```", "")


def _signature(value: Any) -> str:
    try:
        return str(inspect.signature(value)).replace("'", "")
    except (TypeError, ValueError):
        return "(...)"


def _errors() -> Iterator[str]:
    """Every code with the words of all places that raise it, and the remedies they name."""
    yield "# Error codes"
    yield ""
    yield "Every error has a code. Below it stand its messages, one for each place that raises it, with the remedy."
    yield "Braces mark the names, values and places that a message fills in."
    yield ""
    found: dict[str, list[tuple[str, str]]] = {}
    for path in sorted(p for folder in ("acausal", "library") for p in (ROOT / folder).rglob("*.py")):
        for code, fact, remedy in _stated(ast.parse(path.read_text(encoding="utf-8"))):
            found.setdefault(code, []).append((fact, remedy))
    examples, shown = _messages(), error_examples()
    if examples and (missing := sorted(set(found) - set(examples) - set(shown))):
        sys.stderr.write(f"docs/error-examples.txt has no example of {', '.join(missing)}\n")
    for digit, title in GROUPS.items():
        codes = [c for c in sorted(found) if c[2] == digit]
        if not codes:
            continue
        yield f"## {title}"
        yield ""
        for code in codes:
            yield f"### {code}"
            yield ""
            for fact, remedy in dict.fromkeys(found[code]):
                yield f"- {fact}" + (f"  \n  *Remedy:* {remedy}" if remedy else "")
            yield ""
            if code in shown and (sentence := shown[code].sentence):
                yield from (sentence, "")
            elif code in shown:
                yield from ("Example:", "", *_asked(shown[code]), "```text", shown[code].message(), "```", "")
            elif code in examples:
                yield from ("Example:", "", "```text", examples[code], "```", "")


def _stated(module: ast.Module) -> Iterator[tuple[str, str, str]]:
    """Codes with the words and remedies of errors, and with those of notes, which begin with their code."""
    for node in ast.walk(module):
        if isinstance(node, ast.Call | ast.Tuple):
            given = node.args if isinstance(node, ast.Call) else node.elts
            place = next(
                (k for k, a in enumerate(given[:-1]) if isinstance(a, ast.Constant) and _is_code(a.value)), None
            )
            if place is None:
                continue
            # Some helpers are given the place in a file first; a list of codes states none of them.
            texts = (
                a for a in given[place + 1 :] if isinstance(a, ast.Constant | ast.JoinedStr | ast.BinOp | ast.IfExp)
            )
            fact = _words(next(texts, given[place + 1]))
            keys = {k.arg: k.value for k in node.keywords} if isinstance(node, ast.Call) else {}
            if not _is_code(fact):
                yield _words(given[place]), fact, _words(keys["help"]) if "help" in keys else ""
        elif isinstance(node, ast.JoinedStr):
            code, _, text = _words(node).partition(": ")
            if _is_code(code):
                yield code, text, ""


def _asked(case: ErrorExample) -> Iterator[str]:
    """What leads to the message."""
    if case.python:
        yield from ("```python", case.python, "```", "")
    if case.command:
        yield from ("```console", f"$ {case.command}", "```", "")


def _messages() -> dict[str, str]:
    """A whole message for each code: of the cases of the tests the one that says it in the fewest lines."""
    sys.path.insert(0, str(ROOT))
    try:
        from tests.messages.cases import normalised
    except ModuleNotFoundError as error:  # pytest is in another extra
        sys.stderr.write(f"error codes without examples: {error}\n")
        return {}
    found: dict[str, str] = {}
    for file in sorted((ROOT / "tests" / "messages").glob("test_*.py")):
        corpus = getattr(import_module(f"tests.messages.{file.stem}"), "corpus", None)
        for case in corpus.cases if corpus is not None else ():
            try:
                case.run()
            except acausal.AcausalError as error:
                text = normalised(error)
                if error.code not in found or text.count("\n") < found[error.code].count("\n"):
                    found[error.code] = text
    return found


def _is_code(value: object) -> bool:
    return isinstance(value, str) and len(value) == 5 and value.startswith("AC") and value[2:].isdigit()


def _words(node: ast.expr) -> str:
    """A text as it stands in the source; names of what is filled in, in braces."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return _plain(node.value)
    if isinstance(node, ast.JoinedStr):
        parts = [
            str(v.value) if isinstance(v, ast.Constant) else f"{{{_named(v.value)}}}"  # type: ignore[attr-defined]
            for v in node.values
        ]
        return _plain("".join(parts))
    if isinstance(node, ast.IfExp):
        return f"{_words(node.body)} / {_words(node.orelse)}"
    if isinstance(node, ast.BinOp):
        return f"{_words(node.left)}{_words(node.right)}"
    return f"{{{_named(node)}}}"


def _named(node: ast.expr) -> str:
    names = [
        n.attr if isinstance(n, ast.Attribute) else n.id
        for n in ast.walk(node)
        if isinstance(n, ast.Attribute | ast.Name)
    ]
    return names[0].strip("_") if names else "..."


def _plain(text: str) -> str:
    return text.replace("<", "&lt;").replace("*", "\\*").replace("\n", " ")


if __name__ == "__main__":
    main()
    sys.exit(0)
