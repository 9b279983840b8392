"""A step function and its C source: CasADi's code and a wrapper with plain arrays, start values and names."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca

from acausal.lower.casadi_model import Ports
from acausal.result.files import atomic, check_suffix
from acausal.simulate.native.source import functions

_HEAD = """/* {name}: one step of {method}, {step!r} s. By acausal: bounded work, no allocation, no state outside x.

   {identifier}_step(x, u, p, x_next, y): x at a time, u held during the step, x_next and y at its end.
   x_next may not be x. The start is {identifier}_x0; declared parameters are {identifier}_p0.

{tables}
*/
"""
_WRAPPER = """
#define {capital}_NX {nx}
#define {capital}_NU {nu}
#define {capital}_NP {np}
#define {capital}_NY {ny}

const double {identifier}_x0[{nx1}] = {{{x0}}};
const double {identifier}_p0[{np1}] = {{{p0}}};

void {identifier}_step(const double* x, const double* u, const double* p, double* x_next, double* y) {{
  const double* arg[{narg}] = {{x, u, p}};
  double* res[{nres}] = {{x_next, y}};
  casadi_int iw[{niw}];
  double w[{nw}];
  {identifier}_casadi(arg, res, iw, w, 0);
}}
"""


@dataclass(frozen=True, eq=False)
class StepFunction:
    """`function` is `step(x, u, p) -> (x, y)`; vectors are described by the attributes of the same names.

    x holds the states, discrete ones among them, then the algebraic variables, then the modes of a model with events,
    then the time where the equations depend on it. y belongs to the new x. u is constant during the `step` [s].

    Behind the outputs, y has the flags of the step, 0 or 1: `step.unsettled`, its events had not settled when its turns
    were used up, or two clauses set one variable to different values;
    `step.unlocated`, more happened than the one event that is located: another relation was passed, one was there and
    back, or time came to an instant at which a relation of it changes, or a clock ticks, before the end of the step;
    `step.too_large`, an explicit method is not stable at this step, so that what it computes means nothing;
    `step.unconverged`, the fixed number of Newton steps did not solve the algebraic equations, or those of a stage, or
    solutions of the algebraic equations may meet within the step, so that it may have gone over to another one.
    y ends with `step.error`, unless it was left out: an estimate of what the step adds to the error of a state, by its
    nominal value, infinite where it could not be computed. The sum over a run is the error of its states, but for what
    the model makes of earlier errors: it forgets those of stiff parts, which are in the sum, and enlarges those before
    a grazing contact, which are not.
    """

    name: str
    method: str
    step: float
    function: Any
    x: Ports
    u: Ports
    p: Ports
    y: Ports
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        sizes = ", ".join(f"{len(getattr(self, v))} {v}" for v in "xupy")
        return f"StepFunction({self.name}: {self.method}, {self.step:g} s, {sizes})"

    def source(self) -> str:
        """C: the function in CasADi's calling convention, and `NAME_step` with plain arrays."""
        return _source(self)

    def save(self, path: str | Path) -> None:
        """Write the C source to a `.c` file, completely or not at all; UsageError AC012 or AC013."""
        check_source_file(Path(path))
        with atomic(Path(path)) as file:
            file.write(self.source().encode())


def check_source_file(path: Path) -> None:
    """UsageError AC013 for another suffix than `.c`, by which compilers know what a file holds."""
    check_suffix(path, (".c",), "suffix of C files")


def identifier(name: str) -> str:
    """The model's name as a prefix of C identifiers."""
    return re.sub(r"\W", "_", name).lower()


def _source(made: StepFunction) -> str:
    """The complete C file."""
    own = identifier(made.name)
    # not "step": the C library has an old function of that name, which a shared library would call instead
    arguments = [ca.MX.sym(name, made.function.sparsity_in(name)) for name in made.function.name_in()]
    function = ca.Function(f"{own}_casadi", arguments, made.function.call(arguments))
    if made.function.is_a("SXFunction"):
        function = function.expand(f"{own}_casadi")
    code = functions(function)
    ports = zip("xupy", (made.x, made.u, made.p, made.y), strict=True)
    tables = "\n".join(table(letter, entries) for letter, entries in ports)
    narg, nres, niw, nw = function.sz_arg(), function.sz_res(), function.sz_iw(), function.sz_w()
    return (
        _HEAD.format(name=made.name, method=made.method, step=made.step, identifier=own, tables=tables)
        + code
        + _WRAPPER.format(
            identifier=own,
            capital=own.upper(),
            nx=len(made.x),
            nu=len(made.u),
            np=len(made.p),
            ny=len(made.y),
            nx1=max(len(made.x), 1),
            np1=max(len(made.p), 1),
            x0=numbers(made.x),
            p0=numbers(made.p),
            narg=max(narg, 3),
            nres=max(nres, 2),
            niw=niw + 1,
            nw=nw + 1,
        )
    )


def table(letter: str, ports: Ports) -> str:
    lines = [f"   {letter}[{k}]  {port.name} [{port.unit or '1'}]" for k, port in enumerate(ports)]
    return "\n".join(lines or [f"   {letter} is empty"]).replace("*/", "* /")


def numbers(ports: Ports) -> str:
    return ", ".join(repr(float(v)) for v in ports.start) or "0"
