"""Law of interval arithmetic: whatever the inputs are within their ranges, the value of a function is in its range.

For inputs that are known exactly the range is the value itself, but for sines, which are only known to be in [-1, 1].
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acausal.simulate.events.resolution.enclosures import Enclosure

_FORMS: dict[str, Callable[[Any, Any], Any]] = {
    "polynomial": lambda x, y: (x * y - 2 * x + 1) ** 2 - y**3,
    "quotient": lambda x, y: x / (1 + y**2) - 1 / (y + 3),
    "powers": lambda x, y: ca.fabs(x) ** 1.5 - (y**2 + 1) ** -0.5 + x**4 + y**5,
    "kinks": lambda x, y: ca.fmin(ca.fabs(x), y) - ca.fmax(x, -y),
    "functions": lambda x, y: ca.exp(x) + ca.tanh(y) * ca.cosh(x) - ca.sinh(y) + ca.atan(x) + ca.log(y + 4),
    "roots": lambda x, y: ca.sqrt(x**2 + y**2) - ca.sqrt(y + 4),
    "choices": lambda x, y: (
        ca.if_else(ca.logic_and(x > 0, y <= 1), x, -y) + ca.if_else(ca.logic_or(x < -1, y == 2), y, 1)
    ),
    "negations": lambda x, y: ca.if_else(ca.logic_not(ca.logic_or(x < y, x > 2)), x, y) + (x != y),
}
_VALUES = st.floats(-3.0, 3.0) | st.sampled_from((-1.0, 0.0, 1.0, 2.0))
_SHARES = st.floats(0.0, 1.0)


def _function(form: str) -> Any:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    return ca.Function("f", [x, y], [_FORMS[form](x, y)])


@pytest.mark.parametrize("form", _FORMS)
@given(a=_VALUES, b=_VALUES, c=_VALUES, d=_VALUES, s=_SHARES, t=_SHARES)
def test_values_lie_in_their_range(form: str, a: float, b: float, c: float, d: float, s: float, t: float) -> None:
    f, x, y = _function(form), (min(a, b), max(a, b)), (min(c, d), max(c, d))
    ((low, high),) = Enclosure(f).bounds([[x], [y]])
    value = float(f(x[0] + s * (x[1] - x[0]), y[0] + t * (y[1] - y[0])))
    rounding = 1e-12 * (1.0 + abs(value))
    assert low - rounding <= value <= high + rounding


@pytest.mark.parametrize("form", _FORMS)
@given(x=_VALUES, y=_VALUES)
def test_the_range_of_known_inputs_is_the_value(form: str, x: float, y: float) -> None:
    f = _function(form)
    ((low, high),) = Enclosure(f).bounds([[(x, x)], [(y, y)]])
    assert low == high == pytest.approx(float(f(x, y)), rel=1e-12, abs=1e-12)
