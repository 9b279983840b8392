"""`free`: what a model drives by itself becomes an input."""

from __future__ import annotations

from typing import TypeVar

from acausal.errors import UsageError
from acausal.language.component import Component

C = TypeVar("C", bound=Component)


def free(model: C, *signals: str) -> C:
    """The model without the sources of these signals, which become its inputs; the model itself stays as it is.

    Parameters
    ----------
    signals
        Paths of signal inputs inside of the model: `free(ThickBlock(), "force.u", "speed.w_ref")`. What drove them, by
        `connect`, in a constructor or by an equation of the owner, is left out; the source stays in the model without
        effect. Units and limits are those that the input declares.

    Raises
    ------
    UsageError
        AC047 when nothing is named, or a signal twice; when the model is flattened, for a name that is no input.
    """
    if not signals or not all(isinstance(s, str) for s in signals):
        raise UsageError("AC047", "free names no signal", help='paths of inputs: free(model, "force.u")')
    freed = (*model.__dict__.get("_freed", ()), *signals)
    twice = next((s for k, s in enumerate(freed) if s in freed[:k]), None)
    if twice is not None:
        raise UsageError("AC047", f"free names `{twice}` twice", help="name each input once")
    twin = model._copy()
    twin.__dict__["_freed"] = freed
    return twin
