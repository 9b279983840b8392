"""`free`: inner signals of a model become its inputs."""

from __future__ import annotations

from typing import TypeVar

from acausal.errors import UsageError
from acausal.language.check_model import check_model
from acausal.language.component import Component

C = TypeVar("C", bound=Component)


def free(model: C, *signals: str) -> C:
    """A copy of the model in which these signals are inputs, cut from their sources.

    Parameters
    ----------
    signals
        Paths of signal inputs inside the model: `free(ThickBlock(), "force.u", "speed.w_ref")`. The connection, binding
        or equation of the owner that drove them is removed; the source remains in the model without effect. Units and
        limits are those that the input declares.

    Raises
    ------
    UsageError
        AC028 if `model` is not a component, AC047 without signals, or for one named twice; when the model is flattened,
        AC047 for a name that is not an input.
    """
    check_model(model)
    if not signals or not all(isinstance(s, str) for s in signals):
        raise UsageError("AC047", "free names no signal", help='paths of inputs: free(model, "force.u")')
    freed = (*model.__dict__.get("_freed", ()), *signals)
    repeated = next((s for k, s in enumerate(freed) if s in freed[:k]), None)
    if repeated is not None:
        raise UsageError("AC047", f"free names `{repeated}` twice", help="name each input once")
    twin = model._copy()
    twin.__dict__["_freed"] = freed
    return twin
