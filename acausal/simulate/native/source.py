"""C sources: functions as CasADi writes them, and integrators whose output times and tolerances are arguments.

CasADi writes output times and tolerances as constants into the code of an integrator. One library should serve every
segment of every run of a model, so the few lines with these constants are replaced. Each replacement must match exactly
once, as in the version of CasADi for which it was written (3.8); otherwise no source is generated, and runs are
interpreted.

For a large model CasADi writes a single function of tens of thousands of assignments without branches, in which
thousands of values are live at once; gcc spends four fifths of its time on register allocation. The function is
therefore cut into pieces, which pass values to later pieces through an array. Then few values are live inside a piece,
and 64 hinged links (50 000 assignments) compile in seconds instead of minutes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import casadi as ca

from acausal.simulate.native.jacobian import CALL, as_derived
from acausal.simulate.native.powers import with_own_functions, with_shared_powers
from acausal.simulate.native.sizes import with_sizes
from acausal.simulate.native.sparse_lu import with_lu

ENTRY = "segment"
"""Name of an integrator's C function."""

# Functions that are not exported are hidden: a compiler must not inline those that could be replaced from outside.
_RUN_STRUCTURE = """
#include <stdlib.h>
#include <string.h>
#include <time.h>
#if defined(__GNUC__) && !defined(_WIN32)
#define GCC_HASCLASSVISIBILITY
#pragma GCC visibility push(hidden)
#endif
struct acausal_run {
  const double *grid; long long n;
  double reltol, abstol, step, first, past; /* `first` step and `past` error: the state of the step size control */
  long long steps, rejected, rhs, jac, reached, second;
  int (*enter)(void); int (*signals)(void); void (*clear)(void); void (*leave)(int);
  double *last, last_time; /* states and time at which the last step before an event began; 0 if not requested */
  double last_end;         /* where that step would have ended without the event */
  double stop;             /* the time of an event, after which no row follows; INFINITY if none has stopped it */
  /* samples of steep functions, if there are any: a function of time, states and rates for their columns, the rates of
     these, and the heights of the functions; memory for the samples; the function to which each column belongs */
  int (*sample)(void*, double, const double*, const double*, double*);
  void* sampler;
  double* sampled;
  const long long* owners;
  long long columns, functions;
  long long doubts; /* number of places that may have been stepped over */
  /* values that parameters, modes and discrete variables alone determine, if they are known */
  const double* held;
  /* events: whether they are ignored; the guards at the start, their noises, and their mean rates in the last
     step that was looked at, which ended at `looked`; whether a call for the guards is to return their slopes along
     the solution too, or only these */
  long long is_blind;
  const double *distances, *noises;
  double longest; /* step, 0 if there is no bound besides that of the integrator */
  double *rates, looked;
  long long slopes;
  /* whether the stop is at the lowest point of a guard; this guard, if it exceeds its noise at both ends of the step */
  long long is_dip, away;
  long long most; /* steps between two rows, 0 if there is no bound besides that of the integrator */
};
/* The shorter one of two longest steps, of which 0 is none. */
static double acausal_shorter(double a, double b) { return a > 0 && (a < b || !(b > 0)) ? a : b; }
/* Check for Ctrl-C, once a second: Python's handlers only run when they are called. */
static int acausal_stopped(struct acausal_run* run) {
  long long now = (long long) time(0);
  int state, found;
  if (!run->enter || now == run->second) return 0;
  run->second = now;
  state = run->enter();
  found = run->signals() != 0;
  if (found) run->clear();
  run->leave(state);
  return found;
}
"""

_HEUN = """
CASADI_SYMBOL_EXPORT int acausal_heun(const double* x0, const double* p, double* out, casadi_int nx,
                                      const double** arg, double** res, casadi_int* iw, double* w,
                                      struct acausal_run* run) {
  /* a function may read an input after it has written an output, so they need separate memory */
  double th[2], *x = w, *next = w + nx, *other;
  casadi_int k, i, j, count;
  w += 2 * nx;
  th[0] = 0;
  for (i = 0; i < nx; ++i) x[i] = x0[i];
  for (k = 0; k < run->n; ++k) {
    count = (casadi_int) ceil(run->grid[k] / run->step - 1e-9);
    if (count < 1) count = 1;
    th[1] = run->grid[k] / count;
    for (j = 0; j < count; ++j) {
      arg[0] = x; arg[1] = th; arg[2] = p; res[0] = next;
      if (heun(arg, res, iw, w, 0)) return 4;
      other = x; x = next; next = other;
      th[0] += th[1];
      if (!(++run->steps & 255) && acausal_stopped(run)) return 100;
    }
    for (i = 0; i < nx; ++i) out[k * nx + i] = x[i];
    run->reached = k + 1;
  }
  return 0;
}
"""

_NUMBER = r"[-+.e\d]+"
_INTEGRATOR: tuple[tuple[str, str], ...] = (
    (
        r"  /\* Problem structure \*/\n",
        r"\g<0>  struct acausal_run* run = (struct acausal_run*) arg[3];\n  run->stop = INFINITY;\n",
    ),
    (rf"  p\.abstol = {_NUMBER};", "  p.abstol = run->abstol;"),
    (rf"  p\.reltol = {_NUMBER};", "  p.reltol = run->reltol;"),
    (
        r"casadi_ivp_reset\(&d, j \? \w+\[\w+\[j\]-1\] : 0\., 0, j == 0\);",
        "casadi_ivp_reset(&d, 0., 0, 1); d.err_prev = run->past > 0 ? run->past : 1;",
    ),
    (rf"  p\.h_init = {_NUMBER};", "  p.h_init = run->first;"),
    (rf"  p\.h_max = ({_NUMBER});", r"  p.h_max = acausal_shorter(\g<1>, run->longest);"),
    (r"  p\.max_num_steps = (\d+);", r"  p.max_num_steps = run->most > 0 ? run->most : \g<1>;"),
    (r"for \(k = \w+\[j\]; k < \w+\[j\+1\]; \+\+k\)", "for (k = 0; k < run->n && !(run->stop < INFINITY); ++k)"),
    (r"casadi_ivp_advance\(&d, \w+\[k\], \w+\[\w+\[j\+1\]-1\], 0\);", "acausal_to_row(&d, &rows, run, k);"),
    (
        r"  casadi_ivp_setup\(&p\);\n",
        r"\g<0>  casadi_real own[2 * (p.ny > ROWS_MOST ? 0 : p.ny) + 1];\n"
        "  struct acausal_rows rows = {0};\n"
        "  rows.checked = NAN; rows.y = own; rows.f = own + (p.ny > ROWS_MOST ? 0 : p.ny);\n",
    ),
    (
        r"while \(casadi_(?:rosenbrock|erk)\(&d, &e\)\) \{\n",
        "while (acausal_going(&d, &e, &rows, run)) {\n        if (acausal_stopped(run)) return 100;\n",
    ),
    (
        r"if \(d\.status != IVP_SUCCESS\) return 1;",
        "run->steps = d.n_steps; run->rejected = d.n_reject; run->rhs = d.n_rhs; run->jac = d.n_jac;\n"
        "      run->first = d.h_next; run->past = d.err_prev;\n"
        "      if (d.status != IVP_SUCCESS) return d.status;\n"
        "      acausal_note_stop(&d, run);\n"
        "      run->reached = k + 1;",
    ),
)
# Macros of `rows.c` for each method: how a defect becomes an error of the states, and how rows are corrected.
_METHODS = {
    "rosenbrock": "#define METHOD_IS_STIFF\n"
    "#define METHOD_RELAX(d, e, v) casadi_rosenbrock_solve(d, e, v)\n"
    "#define METHOD_CORRECT(d, e, r) acausal_correct(d, e, r)\n",
    "erk": "#define METHOD_RELAX(d, e, v) casadi_scal((d)->prob->ny, (d)->h / 3., v)\n"
    "#define METHOD_CORRECT(d, e, r)\n",
}
_FIXED = (rf"  p\.step_size = {_NUMBER};", "  p.step_size = run->step;")

# Values that do not change between two events are computed once for a stretch.
_PARAMETERS = (
    r"  casadi_copy\(arg\[2\], \d+, pv\);",
    "  if (acausal_parameters(run, arg[2], pv, sarg, sres, iw, w)) return 1;",
)
_HELD_PARAMETERS = """
#define HELD {held}
static int acausal_parameters(struct acausal_run* run, const casadi_real* p, casadi_real* found,
                              const casadi_real** arg, casadi_real** res, casadi_int* iw, casadi_real* w) {{
  if (run->held) casadi_copy(run->held, HELD, found);
  else {{
    arg[0] = p; res[0] = found;
    if (determined(arg, res, iw, w, 0)) return 1;
  }}
  casadi_copy(p + {own}, {rest}, found + HELD);
  return 0;
}}
"""
# Slopes of guards cost twice as much as guards, and are computed only if one is passed in a step (`crossings.c`).
_EVENTS = (
    (r"while \(casadi_ivp_event\(&d\)\) \{", "while (acausal_event(&d, run)) {"),
    (
        r"(case IVP_EVAL_ZERO:\n(?:.*\n){5} *sres\[0\] = d\.res;\n)( *if \(casadi_f\d+\(sarg, sres, iw, w, 0\)\))",
        r"\g<1>              if (run->slopes < 2)\n\g<2>",
    ),
    (r"(              )(sarg\[5\] = d\.res;\n)", r"\g<1>if (!run->slopes) break;\n\g<1>\g<2>"),
)


def functions(*parts: Any) -> str:
    """C of CasADi functions, each under its own name."""
    generator = ca.CodeGenerator("acausal.c")
    for part in parts:
        generator.add(part)
    return with_own_functions(_without_null_checks(str(generator.dump())))


def integrator(
    plugin: str, dae: Any, settings: Mapping[str, Any], *companions: Any, held: Any = None, jacobian: Any = None
) -> str | None:
    """C of a whole integrator; its argument 3 is a pointer to a `struct acausal_run`. None if a replacement fails.

    `plugin` is "rosenbrock" or "erk", and `dae` the SX oracle without controls. `settings` are CasADi's options, of
    which tolerances and step are replaced by arguments. `companions` are further functions for the same library.

    `held` is for an integrator that stops at events: a function `parameters -> values` of the first parameters that the
    caller passes. The DAE gets these values, followed by the other parameters. `jacobian` is a Jacobian of it that is
    shorter than the one by CasADi (`jacobian.py`).
    """
    inside = ca.integrator(ENTRY, plugin, dae, 0.0, [0.5, 1.0], dict(settings))
    if jacobian is not None:
        jacobian = as_derived(jacobian, inside.get_function("jacF")) if plugin == "rosenbrock" else None
    source = functions(*(f for f in (held, jacobian) if f is not None), inside, *companions)
    # the additional argument replaces the controls, of which there are none
    if "arg[3]" in source[source.index("/* Problem structure */") : source.index("/* Forward integration")]:
        return None
    fixed = [_FIXED] if settings.get("step_size") else []
    passes = "case IVP_EVENT:" in source
    passing = [*([] if held is None else [_PARAMETERS]), *(_EVENTS if passes else [])]
    for pattern, text in (*_INTEGRATOR, *fixed, *passing):
        source, count = re.subn(pattern, text, source)
        if count != 1:
            return None
    if jacobian is not None:
        source, count = re.subn(*CALL, source)
        if count != 1:
            return None
    if plugin == "rosenbrock":
        source = with_lu(source)
    before, marker, after = source.partition(f"/* {ENTRY}:")
    if not marker:
        return None
    if held is not None:
        own, count = held.numel_in(0), held.numel_out(0)
        before += _HELD_PARAMETERS.format(held=count, own=own, rest=dae.numel_in("p") - count)
        before += "#define CROSSINGS\n" if passes else ""
    return _with_run_structure(with_sizes(f"{before}{rows(plugin)}{marker}{after}"))


def rows(plugin: str) -> str:
    """C for rows inside of steps, to be inserted before an integrator."""
    names = f"#define METHOD casadi_{plugin}\n#define METHOD_DATA struct casadi_{plugin}_data\n"
    names_of_files = "dips.c", "crossings.c", "steep.c", "rows.c"
    files = (Path(__file__).with_name(name).read_text(encoding="utf-8") for name in names_of_files)
    return "".join((names, _METHODS[plugin], *files))


def heun(step: Any, companion: Any) -> str:
    """C of Heun's method over a grid; `step` is the function `(x, [t, h], p) -> x` with the name "heun"."""
    return _with_run_structure(functions(step, companion)) + _HEUN


def _without_null_checks(source: str) -> str:
    """Move CasADi's checks for null arguments and results from each access to the beginning of a function.

    Without these branches a right-hand side of 6400 instructions compiles in 1 s instead of 4 s. Long functions, which
    have no loops, are compiled with less optimisation, in half of that time and without becoming slower.
    """
    parts = re.split(r"(?m)^(?=static int casadi_f\d+\()", source)
    return "".join(_with_pointers(part) for part in parts)


_INPUT = re.compile(r"arg\[(\d+)\]\? arg\[\1\]\[(\d+)\] : 0")
_OUTPUT = re.compile(r"if \(res\[(\d+)\]!=0\) res\[\1\]\[(\d+)\]=")
_LESS_OPTIMISED = '#pragma GCC push_options\n#pragma GCC optimize ("O1")\n{}#pragma GCC pop_options\n'
# Functions with more lines are compiled with less optimisation.
_MOST_OPTIMISED_LINES = 1500
# Results that are not requested are written to the stack, if there is enough of it.
_LARGEST_STACK = 10_000


def _with_pointers(function: str) -> str:
    head = re.match(r"static int casadi_f\d+\([^)]*\) \{\n", function)
    if head is None:
        return function
    lengths = [_lengths(pattern, function) for pattern in (_INPUT, _OUTPUT)]
    if sum(lengths[1].values()) > _LARGEST_STACK:
        return function
    lines = [f"  static const casadi_real absent[{max(lengths[0].values(), default=1)}] = {{0}};\n"]
    lines += [f"  const casadi_real* in{k} = arg[{k}] ? arg[{k}] : absent;\n" for k in lengths[0]]
    for k, length in lengths[1].items():
        lines.append(f"  casadi_real lost{k}[{length}], *restrict out{k} = res[{k}] ? res[{k}] : lost{k};\n")
    body, end, rest = _OUTPUT.sub(r"out\1[\2]=", _INPUT.sub(r"in\1[\2]", function[head.end() :])).partition("\n}\n")
    body = with_shared_powers(body)
    name = head.group().partition("(")[0].rpartition(" ")[2]
    cut = in_pieces(name, "".join(lines), body)
    result = head.group() + "".join(lines) + body + end
    if cut is not None:
        result = cut[0] + head.group() + "".join(lines) + cut[1] + end
    return (_LESS_OPTIMISED.format(result) if body.count("\n") > _MOST_OPTIMISED_LINES else result) + rest


def _lengths(pattern: re.Pattern[str], function: str) -> dict[str, int]:
    """Number of entries that are used of each argument or result."""
    lengths: dict[str, int] = {}
    for place, index in pattern.findall(function):
        lengths[place] = max(lengths.get(place, 0), int(index) + 1)
    return lengths


def _with_run_structure(source: str) -> str:
    return source.replace("#include <math.h>\n", "#include <math.h>\n" + _RUN_STRUCTURE, 1)


LINES = 400
"""Number of assignments in a piece."""

LONG = 3000
"""Functions with more assignments are cut into pieces."""

_ASSIGNMENT = re.compile(r"  (a\d+|out\d+\[\d+\])=[^;]*;")
_VARIABLE = re.compile(r"\ba\d+\b")
_POINTER = re.compile(r"\b(?:in|out)\d+\b")
_DECLARATION = re.compile(r"  casadi_real a\d+(?:, a\d+)*;")


def in_pieces(name: str, head: str, body: str) -> tuple[str, str] | None:
    """Cut a function into pieces: returns functions for these, and the lines that call them.

    None if the body is short, or does not only consist of assignments. `name` is that of the function, from which the
    names of the pieces are derived. `head` are its lines up to the declarations of `a0, a1, ...`, which declare the
    pointers `in0, ..., out0, ...`; `body` are the declarations, the assignments, and `return 0;`.
    """
    lines = body.split("\n")
    steps = [line for line in lines if not _DECLARATION.fullmatch(line)]
    if len(steps) <= LONG or steps[-1] != "  return 0;" or not all(map(_ASSIGNMENT.fullmatch, steps[:-1])):
        return None
    parts = [steps[k : min(k + LINES, len(steps) - 1)] for k in range(0, len(steps) - 1, LINES)]
    pointers = sorted(set(_POINTER.findall(head)))
    formal = ", ".join(f"casadi_real *restrict {p}" if p[0] == "o" else f"const casadi_real* {p}" for p in pointers)
    actual = ", ".join(("kept", *pointers))
    assigned = [_assigned(cut) for cut in parts]
    read_later: set[str] = set()
    pieces: list[str] = []
    for k in range(len(parts) - 1, -1, -1):
        needed = _read_first(parts[k])
        passed_on = sorted(assigned[k] & read_later)
        text = [
            f"static __attribute__((noinline)) void {name}_{k}(casadi_real* kept, {formal}) {{",
            *_declared(sorted(assigned[k] | needed)),
            *(f"  {v}=kept[{int(v[1:])}];" for v in sorted(needed)),
            *parts[k],
            *(f"  kept[{int(v[1:])}]={v};" for v in passed_on),
            "}\n",
        ]
        pieces.append("\n".join(text))
        read_later = (read_later - assigned[k]) | needed
    size = 1 + max(int(v[1:]) for cut in assigned for v in cut)
    calls = [f"  casadi_real kept[{size}];", *(f"  {name}_{k}({actual});" for k in range(len(parts))), "  return 0;"]
    return "".join(reversed(pieces)), "\n".join(calls)


def _assigned(lines: list[str]) -> set[str]:
    return {line[2:].partition("=")[0] for line in lines if line.startswith("  a")}


def _read_first(lines: list[str]) -> set[str]:
    """Variables that are read before they are assigned."""
    needed: set[str] = set()
    assigned: set[str] = set()
    for line in lines:
        left, _, right = line.partition("=")
        needed.update(v for v in _VARIABLE.findall(right) if v not in assigned)
        assigned.add(left.strip())
    return needed


def _declared(variables: list[str]) -> list[str]:
    return [f"  casadi_real {', '.join(variables)};"] if variables else []
