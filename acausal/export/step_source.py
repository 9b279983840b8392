"""C of a step function: CasADi's straight-line code and a wrapper with plain arrays, starts and names."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import casadi as ca

from acausal.lower.casadi_model import Ports
from acausal.simulate.native.source import functions

if TYPE_CHECKING:
    from acausal.export.step import StepFunction

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


def identifier(name: str) -> str:
    """The model's name as the beginning of C names."""
    return re.sub(r"\W", "_", name).lower()


def source(made: StepFunction) -> str:
    """The whole file."""
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
