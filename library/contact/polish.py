"""The contact as the solution of equations: which makes it exact, and differentiable as often as wanted.

Portal and distance search find *which* corners and circles of two shapes touch. With these given, the normal n, weights
l and the signed offset s of the support plane solve

    sum l_i w_i(n) = s n,   sum l_i = 1,   n . w_i(n) equal for all i,   n . n = 1

where w_i(n) is the point of the difference that pair i of features has in direction n: the offset is stationary on the
sphere of directions, so that its derivative is that of the witnesses along the normal. One step of Newton from the
solution has the exact derivative of the solution, whatever the search did to find it; a second step the next two.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from acausal.library.contact.minkowski import Pair

_F = [slice(8 * k, 8 * k + 8) for k in range(3)]
_ON = [24, 25]
_N = slice(26, 29)
_L = [29, 30]
_S = 31
_OK = 32
SIZE = 33
"""Three features, whether the second and the third count, normal, weights of these two, offset, whether it is sound."""

GOING = SIZE
_COUNT = SIZE + 1
_FIRST = slice(SIZE + 2, SIZE + 5)
_START = slice(SIZE + 5, SIZE + 13)
WORKING = SIZE + 13
"""While it is searched: whether it goes on, number of steps, and the normal and a feature to fall back upon."""

ROUNDING = 1e-13
_MOST = 12


@dataclass(frozen=True)
class Contact:
    """A solution, or a step towards it."""

    features: list[Any]
    on: list[Any]
    normal: Any
    weights: list[Any]
    offset: Any
    sound: Any

    @property
    def vector(self) -> Any:
        """As a column of SIZE."""
        return ca.vertcat(*self.features, *self.on, self.normal, *self.weights, self.offset, self.sound)

    @property
    def all_weights(self) -> list[Any]:
        """Weights of the three features."""
        return [1 - self.weights[0] - self.weights[1], *self.weights]


def contact(vector: Any) -> Contact:
    """The contact in a column."""
    return Contact(
        [vector[f] for f in _F],
        [vector[k] for k in _ON],
        vector[_N],
        [vector[k] for k in _L],
        vector[_S],
        vector[_OK],
    )


def newton(pair: Pair, c: Contact) -> Contact:
    """One step of Newton's method; where the system is not sound the normal stays as it is."""
    n, weights = c.normal, c.all_weights
    w = [_difference(pair, f, n) for f in c.features]
    bend = ca.SX(3, 3)
    mean = ca.SX(3, 1)
    for weight, f, x in zip(weights, c.features, w, strict=True):
        bend += weight * pair.bend(f, n)
        mean += weight * x
    edges = [(x - w[0]) * on for x, on in zip(w[1:], c.on, strict=True)]
    matrix = ca.SX(6, 6)
    matrix[:3, :3] = bend - c.offset * ca.SX.eye(3)
    right = ca.SX(6, 1)
    right[:3] = c.offset * n - mean
    for k, (edge, on, weight) in enumerate(zip(edges, c.on, c.weights, strict=True)):
        matrix[:3, 3 + k] = edge
        matrix[3 + k, :3] = edge.T
        matrix[3 + k, 3 + k] = 1 - on
        right[3 + k] = -ca.dot(edge, n) - (1 - on) * weight
    matrix[:3, 5], matrix[5, :3] = -n, n.T
    right[5] = (1 - ca.sumsqr(n)) / 2
    fixed = c.sound <= 0
    matrix, right = ca.if_else(fixed, ca.SX.eye(6), matrix), ca.if_else(fixed, ca.SX.zeros(6), right)
    change = ca.solve(matrix, right)
    moved = n + change[:3]
    return Contact(
        c.features,
        c.on,
        moved / ca.sqrt(ca.sumsqr(moved)),
        [c.weights[0] + change[3], c.weights[1] + change[4]],
        c.offset + change[5],
        c.sound,
    )


def witnesses(pair: Pair, c: Contact) -> tuple[Any, Any, Any]:
    """Offset of the support plane, and the points of both shapes that touch, in the frame of the first."""
    a, b = ca.SX(3, 1), ca.SX(3, 1)
    for weight, f in zip(c.all_weights, c.features, strict=True):
        of_a, of_b = pair.points(f, c.normal)
        a, b = a + weight * of_a, b + weight * of_b
    return ca.dot(c.normal, a - b), a, b


def start(pair: Pair, vertices: list[Any], normal: Any, offset: Any) -> Any:
    """The state of the search with the features of three vertices; equal ones count once."""
    f = [pair.settled(v, normal) for v in vertices]
    second = ca.logic_not(_same(f[1], f[0]))
    third = ca.logic_not(ca.logic_or(_same(f[2], f[0]), _same(f[2], f[1])))
    top = pair.settled(pair.support(normal), normal)
    share = 1 / (1 + second + third)
    c = Contact(f, [second, third], normal, [second * share, third * share], offset, 1)
    return ca.vertcat(c.vector, 1, 0, normal, top)


def step(pair: Pair, state: Any) -> Any:
    """A Newton step; then a feature that pulls is dropped, or one that stands out is added."""
    old = contact(state[:SIZE])
    new = newton(pair, old)
    change = ca.fmax(ca.norm_inf(new.normal - old.normal), ca.fabs(new.offset - old.offset))
    lost = ca.logic_or(ca.logic_not(change < 0.5), state[_COUNT] >= _MOST)
    dropped, pulling = _dropped(new)
    top = pair.support(new.normal)
    gap = ca.dot(new.normal, top[:3]) - new.offset
    feature = pair.settled(top, new.normal)
    standing = gap > ROUNDING * 10
    known = ca.logic_or(
        _same(feature, new.features[0]),
        ca.logic_or(
            ca.logic_and(new.on[0], _same(feature, new.features[1])),
            ca.logic_and(new.on[1], _same(feature, new.features[2])),
        ),
    )
    added = _added(new, feature)
    adding = ca.logic_and(standing, ca.logic_and(ca.logic_not(known), ca.logic_not(pulling)))
    following = ca.if_else(pulling, dropped.vector, ca.if_else(adding, added.vector, new.vector))
    going = ca.logic_or(ca.logic_or(pulling, adding), change > ROUNDING)
    # Rounding may keep the change from falling further.
    going = ca.logic_and(
        going, ca.logic_or(state[_COUNT] < 5, ca.logic_or(change > 1e-11, ca.logic_or(pulling, adding)))
    )
    found = ca.vertcat(following, going, state[_COUNT] + 1, state[_FIRST], state[_START])
    return ca.if_else(lost, _given_up(pair, state), found)


def _given_up(pair: Pair, state: Any) -> Any:
    """The plane that portal or distance found, kept as it is."""
    n, f = state[_FIRST], state[_START]
    offset = ca.dot(n, _difference(pair, f, n))
    c = Contact([f, f, f], [0, 0], n, [0, 0], offset, 0)
    return ca.vertcat(c.vector, 0, state[_COUNT] + 1, state[_FIRST], state[_START])


def _dropped(c: Contact) -> tuple[Contact, Any]:
    """The contact without the feature of the most negative weight, and whether there is one."""
    l1, l2, l3 = c.all_weights
    low = -1e-9
    third = ca.logic_and(c.on[1], ca.logic_and(l3 < low, ca.logic_and(l3 <= l2, l3 <= l1)))
    second = ca.logic_and(c.on[0], ca.logic_and(l2 < low, ca.logic_and(l2 <= l1, ca.logic_not(third))))
    first = ca.logic_and(l1 < low, ca.logic_not(ca.logic_or(second, third)))
    # The first always counts: another that does takes its place.
    from_second = ca.logic_and(first, c.on[0])
    from_third = ca.logic_and(first, ca.logic_not(c.on[0]))
    head = ca.if_else(from_second, c.features[1], ca.if_else(from_third, c.features[2], c.features[0]))
    on = [
        ca.logic_and(c.on[0], ca.logic_not(ca.logic_or(second, from_second))),
        ca.logic_and(c.on[1], ca.logic_not(ca.logic_or(third, from_third))),
    ]
    share = 1 / (1 + on[0] + on[1])
    rest = Contact([head, *c.features[1:]], on, c.normal, [on[0] * share, on[1] * share], c.offset, c.sound)
    return rest, ca.logic_or(first, ca.logic_or(second, third))


def _added(c: Contact, feature: Any) -> Contact:
    """The contact with one more feature, in a free place or in that of the smallest weight."""
    l1, l2, l3 = c.all_weights
    full = ca.logic_and(c.on[0], c.on[1])
    second = ca.logic_or(ca.logic_not(c.on[0]), ca.logic_and(full, ca.logic_and(l2 <= l1, l2 <= l3)))
    third = ca.logic_and(ca.logic_not(second), ca.logic_or(ca.logic_not(c.on[1]), ca.logic_and(l3 <= l1, l3 <= l2)))
    first = ca.logic_not(ca.logic_or(second, third))
    features = [ca.if_else(here, feature, f) for here, f in zip((first, second, third), c.features, strict=True)]
    on = [ca.logic_or(c.on[0], second), ca.logic_or(c.on[1], third)]
    return Contact(features, on, c.normal, [ca.if_else(second, 0, l2), ca.if_else(third, 0, l3)], c.offset, c.sound)


def _difference(pair: Pair, feature: Any, n: Any) -> Any:
    a, b = pair.points(feature, n)
    return a - b


def _same(f: Any, g: Any) -> Any:
    return ca.norm_inf(f - g) <= 1e-14
