"""The note on external functions that may vary within a step of a solver without being noticed."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from acausal.language.expressions.external import Call, External
from acausal.language.expressions.lookup import Lookup
from acausal.lower.compiled import CompiledModel
from acausal.numeric.external import function as casadi_function
from acausal.recent import once_per_owner

_NOTE = (
    "a change inside of {} that is over within one step is missed, as kinks and steep parts of external functions are "
    "not located: max_step bounds the steps"
)
# CasADi's names of operations.
_BRANCH_OPERATIONS = "FABS SIGN FMIN FMAX FLOOR CEIL FMOD COPYSIGN LT LE EQ NE NOT AND OR IF_ELSE_ZERO"
_STEEP_OPERATIONS = "EXP EXPM1 POW TANH SINH COSH ATAN ATAN2 ERF"


@once_per_owner
def note_on_externals(compiled: CompiledModel) -> str:
    """The note of a run without `max_step` on external functions that contain kinks, jumps or steep parts; or "".

    Kinks and steep functions in equations are located. Those inside of an external function are only noticed if a step
    evaluates it there. A function that declares its jumps states itself what is to be located.
    """
    pool = compiled.solution.structure.reduced.pool
    moving = {
        # derivatives jump where the function has a kink, so the function itself is examined
        op.external.primal or op.external
        for op, *arguments in pool.nodes
        if isinstance(op, Call) and any(map(pool.varies, arguments))
    }
    names = sorted({f.name for f in moving if not isinstance(f, Lookup) and not f.jumps and _may_be_missed(f)})
    return _NOTE.format(", ".join(names)) if names else ""


@lru_cache(maxsize=256)
def _may_be_missed(external: External) -> bool:
    """Whether the function has kinks, jumps or steep parts, or cannot be examined."""
    function = casadi_function(external)
    try:
        scalar = function if function.is_a("SXFunction") else function.expand()
    except RuntimeError:
        return True
    operations = {getattr(ca, f"OP_{name}") for name in (*_BRANCH_OPERATIONS.split(), *_STEEP_OPERATIONS.split())}
    return any(scalar.instruction_id(k) in operations for k in range(scalar.n_instructions()))
