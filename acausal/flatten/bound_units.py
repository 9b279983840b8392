"""Dimensions of what constructors give: values of parameters, bindings of variables and inputs, start values."""

from __future__ import annotations

from acausal.flatten.instances import Instance
from acausal.language.dimensions import check_dimensions
from acausal.language.expression import Equation, Expr, Symbol


def check_bound(instance: Instance, name: str, value: Expr) -> None:
    """Raise UnitError (AC155) when `value` has not the dimension of the field, where both are known."""
    if value.op == "const":
        return
    field: Symbol = getattr(instance.component, name)
    if isinstance(value, Symbol) and value.declaration.unit == field.declaration.unit:
        return
    check_dimensions(Equation(field, value), (instance.origin.span(),))
