"""C source of a `CasadiModel`: all functions on plain arrays, a header, and a main that prints values at the start.

`NAME.c` contains CasADi's code and, for each function, `int NAME_FUNCTION(...)`, which takes pointers to dense columns
in the order of the arguments, then of the results. It returns 0 on success. An iteration that does not converge yields
nan, and the wrapper returns 1 for nan results. Nothing is allocated or kept between calls.

CasADi generates C only for the rootfinder `fast_newton`. Every other rootfinder in the graph of an MX function is
replaced by a `fast_newton` for the same residual, and so are rootfinders in the functions that it calls. Results agree
within the tolerance of Newton's method, which here takes full steps.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from acausal.errors import ExportError
from acausal.export.casadi.parts import NEWTON
from acausal.export.step.source import identifier, numbers, table
from acausal.lower.casadi_model import CasadiModel, Ports
from acausal.simulate.native.source import functions

_WRAPPER = """
int {own}({parameters}) {{
  const double* arg[{narg}] = {{{arguments}}};
  double* res[{nres}] = {{{results}}};
  casadi_int iw[{niw}];
  double w[{nw}];
  int failed = {own}_casadi(arg, res, iw, w, 0);
{checks}  return failed;
}}
"""
_MAIN = """/* Prints the results of every function of {name} at the start: FUNCTION RESULT NUMBERS. */
#include <stdio.h>
#include "{prefix}.h"

static void show(const char* name, const double* values, int n) {{
  int k;
  printf("%s", name);
  for (k = 0; k < n; ++k) printf(" %.17g", values[k]);
  printf("\\n");
}}

int main(void) {{
  int failed = 0;
{calls}
  return failed;
}}
"""


def sources(model: CasadiModel) -> dict[str, str]:
    """The three files, by name: `NAME.c`, `NAME.h`, `NAME_main.c`.

    Raises
    ------
    ExportError
        AC612 when CasADi cannot write one of the functions.
    """
    prefix = identifier(model.name)
    known: dict[int, Any] = {}
    made = {name.replace(".", "_"): with_c_rootfinders(f, known) for name, f in model.functions.items()}
    dense = {name: _dense(f"{prefix}_{name}_casadi", f) for name, f in made.items()}
    try:
        code = functions(*dense.values())
    except RuntimeError as error:
        raise ExportError(
            "AC612",
            f"{model.name} cannot be written as C",
            evidence=[str(error).strip().splitlines()[-1]],
            help="replace external functions for which CasADi generates no code by expressions or by C",
        ) from error
    if "#error" in code:
        raise ExportError("AC612", f"{model.name} cannot be written as C: CasADi generates no code for a part of it")
    wrappers = "".join(_wrapper(prefix, name, f) for name, f in dense.items())
    head = f'/* {model.name}, by acausal. */\n#include "{prefix}.h"\n'
    return {
        f"{prefix}.c": f"{head}{code}\n{_starts(model, prefix)}{wrappers}",
        f"{prefix}.h": _header(model, prefix, dense),
        f"{prefix}_main.c": _main(model, prefix, dense),
    }


def _dense(name: str, function: Any) -> Any:
    """The function under another name, with dense arguments and results."""
    sizes = [function.size_in(k) for k in range(function.n_in())]
    kind: Any = ca.SX if function.is_a("SXFunction") else ca.MX
    arguments = [kind.sym(function.name_in(k), *size) for k, size in enumerate(sizes)]
    inner = [ca.project(a, function.sparsity_in(k)) for k, a in enumerate(arguments)]
    found = [ca.densify(v) for v in function.call(inner)]
    return ca.Function(name, arguments, found, _inputs(function), _results(function))


def _inputs(function: Any) -> list[str]:
    return [function.name_in(k) for k in range(function.n_in())]


def _results(function: Any) -> list[str]:
    return [function.name_out(k) for k in range(function.n_out())]


def _signature(prefix: str, name: str, function: Any) -> str:
    given = [f"const double* {name}" for name in _inputs(function)]
    results = [f"double* {name}" for name in _results(function)]
    return f"int {prefix}_{name}({', '.join([*given, *results])})"


def _wrapper(prefix: str, name: str, function: Any) -> str:
    signature = _signature(prefix, name, function)
    return _WRAPPER.format(
        own=f"{prefix}_{name}",
        parameters=signature[signature.index("(") + 1 : -1],
        arguments=", ".join(_inputs(function)) or "0",
        results=", ".join(_results(function)) or "0",
        checks=_checks(function),
        narg=max(function.sz_arg(), 1),
        nres=max(function.sz_res(), 1),
        niw=function.sz_iw() + 1,
        nw=function.sz_w() + 1,
    )


def _checks(function: Any) -> str:
    """C lines that set `failed` if a result is nan."""
    sizes = [(name, function.numel_out(name)) for name in _results(function)]
    lines = [f"  for (k = 0; k < {n}; ++k) if ({name}[k] != {name}[k]) failed = 1;\n" for name, n in sizes if n]
    return "  int k;\n" * bool(lines) + "".join(lines)


def _vectors(model: CasadiModel) -> dict[str, Ports]:
    found = {v: getattr(model, v) for v in ("x", "z", "u", "p", "y")}
    return found | ({"m": model.events.m} if model.events else {})


def _starts(model: CasadiModel, prefix: str) -> str:
    vectors = _vectors(model)
    return "\n".join(
        f"const double {prefix}_{v}_start[{max(len(vectors[v]), 1)}] = {{{numbers(vectors[v])}}};" for v in vectors
    )


def _header(model: CasadiModel, prefix: str, made: dict[str, Any]) -> str:
    capital, vectors = prefix.upper(), _vectors(model)
    tables = "\n".join(table(v, ports) for v, ports in vectors.items())
    sizes = "\n".join(f"#define {capital}_N{v.upper()} {len(ports)}" for v, ports in vectors.items())
    starts = "\n".join(f"extern const double {prefix}_{v}_start[{max(len(vectors[v]), 1)}];" for v in vectors)
    lines = []
    for name, f in made.items():
        shapes = [f"{f.name_in(k)}[{f.numel_in(k)}]" for k in range(f.n_in())]
        results = [f"{f.name_out(k)}[{f.numel_out(k)}]" for k in range(f.n_out())]
        lines += [f"/* ({', '.join(shapes)}) -> ({', '.join(results)}) */", f"{_signature(prefix, name, f)};"]
    notes = "".join(f"   note: {note}\n" for note in model.notes).replace("*/", "* /")
    return (
        f"/* {model.name}, by acausal: SI units, dense columns; functions return 0 on success.\n\n"
        f'{tables}\n{notes}*/\n#ifndef {capital}_H\n#define {capital}_H\n#ifdef __cplusplus\nextern "C" {{\n#endif\n\n'
        f"{sizes}\n#define {capital}_START_TIME {model.start_time!r}\n\n{starts}\n\n"
        + "\n".join(lines)
        + "\n\n#ifdef __cplusplus\n}\n#endif\n#endif\n"
    )


def _main(model: CasadiModel, prefix: str, made: dict[str, Any]) -> str:
    vectors = _vectors(model)
    calls = []
    for name, f in made.items():
        given: dict[str, list[float]] = {"t": [model.start_time], "h": [1e-3]}
        lines = []
        for k in range(f.n_in()):
            argument = f.name_in(k)
            if argument in vectors:
                continue
            values: list[float] = given[argument] if argument in given else [0.0] * f.numel_in(k)
            text = ", ".join(map(repr, values)) or "0"
            lines.append(f"    const double {argument}[{max(len(values), 1)}] = {{{text}}};")
        lines += [f"    double {f.name_out(k)}[{max(f.numel_out(k), 1)}] = {{0}};" for k in range(f.n_out())]
        arguments = [f"{prefix}_{n}_start" if n in vectors else n for n in (f.name_in(k) for k in range(f.n_in()))]
        arguments += [f.name_out(k) for k in range(f.n_out())]
        lines.append(f"    if ({prefix}_{name}({', '.join(arguments)})) failed = 1;")
        lines += [f'    show("{name} {f.name_out(k)}", {f.name_out(k)}, {f.numel_out(k)});' for k in range(f.n_out())]
        calls.append("  {\n" + "\n".join(lines) + "\n  }")
    return _MAIN.format(name=model.name, prefix=prefix, calls="\n".join(calls))


# An iteration counts as converged if one further Newton step is at most this, relative to the nominal magnitudes.
_CONVERGED = 1e-7
_OPTIONS = {k: NEWTON[k] for k in ("abstol", "abstolStep", "max_iter", "error_on_fail")}


def with_c_rootfinders(function: Any, known: dict[int, Any] | None = None) -> Any:
    """The function with rootfinders for which CasADi generates C; unchanged if it has none.

    `known` caches replacements, so that a function called several times remains one.
    """
    known = {} if known is None else known
    if not _contains_rootfinder(function):
        return function
    key = function.__hash__()
    if key not in known:
        known[key] = _replace_rootfinders(function, known)
    return known[key]


def _replace_rootfinders(function: Any, known: dict[int, Any]) -> Any:
    if function.class_name() == "Newton":
        return _fast_newton(function)
    arguments = function.mx_in()
    found = function.call(arguments, True, False)
    while (old := _output(found)) is not None:
        call = old.dep(0)
        inner = with_c_rootfinders(call.which_function(), known)
        new = inner.call([call.dep(k) for k in range(call.n_dep())], False, True)
        found = ca.graph_substitute(found, [old], [new[old.which_output()]])
    inputs, outputs = ([name(k) for k in range(n)] for name, n in _names(function))
    return ca.Function(function.name(), arguments, found, inputs, outputs)


def _fast_newton(function: Any) -> Any:
    """`fast_newton` for the same residual; nan if a further step is not small, as its C code reports no failure."""
    residual = function.oracle()
    root = ca.rootfinder(f"{function.name()}_c", "fast_newton", residual, _OPTIONS)
    start, q = (ca.MX.sym(function.name_in(k), function.sparsity_in(k)) for k in range(2))
    z, w = ca.SX.sym("z", start.numel()), ca.SX.sym("q", q.numel())
    r = residual(z, w)
    linear: Any = ca.Function("linear", [z, w], [ca.jacobian(r, z), ca.densify(r)])
    root_value = root(start, q)
    slope, defect = linear(root_value, q)
    further = ca.solve(slope, defect, "qr")
    # test each unknown separately: a norm over all would be dominated by one unknown of 1e6 nominal magnitudes
    is_converged = ca.sum1(ca.fabs(further) <= _CONVERGED * (1 + ca.fabs(root_value))) >= start.numel()
    value = ca.if_else(is_converged, root_value, math.nan)
    names = [function.name_in(0), function.name_in(1)], [function.name_out(0)]
    return ca.Function(function.name(), [start, q], [value], *names)


def _names(function: Any) -> list[tuple[Any, int]]:
    return [(function.name_in, function.n_in()), (function.name_out, function.n_out())]


def _contains_rootfinder(function: Any) -> bool:
    if function.class_name() == "Newton":
        return True
    return function.is_a("MXFunction") and any(map(_contains_rootfinder, function.find_functions(0)))


def _output(roots: list[Any]) -> Any:
    """An output of a call, among the nodes of these expressions, whose function contains a rootfinder, or None."""
    seen: set[int] = set()
    stack = list(roots)
    while stack:
        node = stack.pop()
        if node.__hash__() in seen:
            continue
        seen.add(node.__hash__())
        if node.is_output() and node.dep(0).is_call() and _contains_rootfinder(node.dep(0).which_function()):
            return node
        stack.extend(node.dep(k) for k in range(node.n_dep()))
    return None
