"""External functions in which something may come and go within a step, where no solver sees it."""

from __future__ import annotations

from functools import lru_cache
from weakref import WeakKeyDictionary

import casadi as ca

from acausal.language.expressions.external import Call, External
from acausal.language.expressions.lookup import Lookup
from acausal.lower.compiled import CompiledModel
from acausal.numeric.external import function as casadi_function

_NOTE = (
    "what comes and goes within one step inside of {} is not seen, as kinks and steep parts of external functions are "
    "not located: max_step bounds the steps"
)
# CasADi's names of operations.
_BRANCHES = "FABS SIGN FMIN FMAX FLOOR CEIL FMOD COPYSIGN LT LE EQ NE NOT AND OR IF_ELSE_ZERO"
_STEEP = "EXP EXPM1 POW TANH SINH COSH ATAN ATAN2 ERF"
_NOTES: WeakKeyDictionary[CompiledModel, str] = WeakKeyDictionary()


def note_on_externals(compiled: CompiledModel) -> str:
    """What a run without a longest step says of external functions with kinks, jumps or steep parts inside; or "".

    Kinks and steep functions of equations are located and searched. Inside of an external function they are seen only
    where a step evaluates it. One that declares jumps says itself what its caller locates.
    """
    if compiled not in _NOTES:
        pool = compiled.solution.structure.reduced.pool
        moving = {
            # derivatives jump where the function has a kink: its factory shows which kinks there are
            op.external.primal or op.external
            for op, *arguments in pool.nodes
            if isinstance(op, Call) and any(map(pool.varies, arguments))
        }
        names = sorted({f.name for f in moving if not isinstance(f, Lookup) and not f.jumps and _may_wake(f)})
        _NOTES[compiled] = _NOTE.format(", ".join(names)) if names else ""
    return _NOTES[compiled]


@lru_cache(maxsize=256)
def _may_wake(external: External) -> bool:
    """Whether it has kinks, jumps or steep parts, or cannot be looked into."""
    function = casadi_function(external)
    try:
        scalar = function if function.is_a("SXFunction") else function.expand()
    except RuntimeError:
        return True
    waking = {getattr(ca, f"OP_{name}") for name in (*_BRANCHES.split(), *_STEEP.split())}
    return any(scalar.instruction_id(k) in waking for k in range(scalar.n_instructions()))
