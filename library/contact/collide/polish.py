"""The contact as the solution of equations, which makes it exact and repeatedly differentiable.

Portal and distance search find *which* corners and circles of two shapes touch. Given these, the normal n, the weights
l and the signed offset s of the support plane solve

    sum l_i w_i(n) = s n,   sum l_i = 1,   n . w_i(n) equal for all i,   n . n = 1

where w_i(n) is the point of the difference that pair i of features has in direction n: the offset is stationary on the
sphere of directions, so that its derivative is that of the witness points along the normal. One step of Newton's method
from the solution has its exact first derivative, however the solution was found; a second step also has the exact
second and third.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.library.contact.collide.minkowski import Pair, ring

_F = [slice(8 * k, 8 * k + 8) for k in range(3)]
_ON = [24, 25]
_N = slice(26, 29)
_L = [29, 30]
NORMAL, OFFSET, SOUND, WEIGHTS = _N, 31, 32, _L
_S = 31
_OK = 32
SIZE = 33
"""Three features, which of the last two are active, normal, weights of these two, offset, whether it is sound."""

GOING = SIZE
_COUNT = SIZE + 1
_HEIGHT = SIZE + 2
_RADIUS = SIZE + 3
_EXACT = SIZE + 4
WORKING = SIZE + 5
"""During the search also: whether it continues, number of steps, height of the plane, longest step, whether exact."""

_ROUNDING = 1e-13
_LONGEST = 0.3
# After steps shorter than this, Newton's method converges by itself; before, a positive definite matrix is used.
_SAFE = 5e-3
_TILT = 0.05
_ADDED = 10.0
_NEARLY_FLAT, _SNAP = 0.1, 1e-3
_SHAKE = (0.53e-10, -0.71e-10, 0.47e-10)
"""Translation and rotation vector by which a pose is perturbed to see whether its contact is determined."""

_STEEPEST, _REGULAR = 1e7, 1e-12
_TRIANGLE = ((1.0, 0.0), (-0.5, 0.75**0.5), (-0.5, -(0.75**0.5)))


@dataclass(frozen=True)
class Contact:
    """A solution, or an iterate on the way to it."""

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
        [vector[k] > 0.5 for k in _ON],  # a frozen call adds rounding errors to the flags
        vector[_N],
        [vector[k] for k in _L],
        vector[_S],
        vector[_OK] > 0.5,
    )


def newton(pair: Pair, c: Contact, downhill: Any = 0, longest: Any = None) -> Contact:
    """One step of Newton's method; if the system is not sound, the normal stays unchanged.

    With `downhill` the matrix is modified so that the step is a descent direction from any point; `longest` limits it.
    """
    n = c.normal
    bend, mean, rows, lengths = _system(pair, c, downhill)
    right = [*(-ca.dot(row, n) for row in rows[:2]), (1 - ca.sumsqr(n)) / 2]
    turn, changes = saddle(bend, rows, c.offset * n - mean, right, [*c.on, 1])
    if longest is not None:
        turn *= ca.fmin(1, longest / (ca.norm_2(turn) + 1e-300))
    moved = n + ca.if_else(c.sound, turn, 0)
    changes = [ca.if_else(c.sound, change, 0) for change in changes]
    both = zip(c.weights, changes, lengths, c.on, strict=False)
    return Contact(
        c.features,
        c.on,
        moved / ca.sqrt(ca.sumsqr(moved)),
        [ca.if_else(on, weight + change / length, 0) for weight, change, length, on in both],
        c.offset - changes[2],
        c.sound,
    )


def _system(pair: Pair, c: Contact, downhill: Any = 0) -> tuple[Any, Any, list[Any], list[Any]]:
    """Matrix for the rotation of the normal, mean point of the features, edges and normal, lengths of the edges."""
    n, weights = c.normal, c.all_weights
    w = [_difference(pair, f, n) for f in c.features]
    bend = ca.SX(3, 3)
    mean = ca.SX(3, 1)
    for weight, f, x in zip(weights, c.features, w, strict=True):
        bend += weight * pair.bend(f, n)
        mean += weight * x
    bend -= ca.if_else(downhill, -ca.fabs(c.offset), c.offset) * ca.SX.eye(3)
    edges = [(x - w[0]) * on for x, on in zip(w[1:], c.on, strict=True)]
    lengths = [ca.if_else(on, ca.norm_2(edge), 1) for edge, on in zip(edges, c.on, strict=True)]
    rows = [*(edge / length for edge, length in zip(edges, lengths, strict=True)), n]
    return bend, mean, rows, lengths


def saddle(bend: Any, rows: list[Any], force: Any, right: list[Any], on: list[Any]) -> tuple[Any, list[Any]]:
    """x, y with `bend x + sum y_k row_k = force`, and `row_k . x = right_k` where `on`, else y_k = 0; |row_k| = 1.

    `bend` alone may be singular (it is zero on corners): multiples of the rows are added, which leave the solution
    unchanged.
    """
    for row, value in zip(rows, right, strict=True):
        bend = bend + _ADDED * row @ row.T
        force = force + _ADDED * value * row
    inverse = _inverse(bend)
    columns = [inverse @ row for row in rows]
    free = inverse @ force
    small = ca.SX(3, 3)
    rest = ca.SX(3, 1)
    for i, row in enumerate(rows):
        for k, column in enumerate(columns):
            small[i, k] = ca.dot(row, column)
        small[i, i] = ca.if_else(on[i], small[i, i], 1)
        rest[i] = ca.dot(row, free) - right[i]
    y = _inverse(small) @ rest
    return free - sum((y[k] * column for k, column in enumerate(columns)), ca.SX(3, 1)), [y[k] for k in range(3)]


def _inverse(m: Any) -> Any:
    """Inverse of a 3x3 matrix by cofactors."""
    rows = [ca.cross(m[:, 1], m[:, 2]), ca.cross(m[:, 2], m[:, 0]), ca.cross(m[:, 0], m[:, 1])]
    return ca.horzcat(*rows).T / ca.dot(m[:, 0], rows[0])


def witness(pair: Pair, c: Contact) -> tuple[Any, Any]:
    """Offset of the support plane, and the point of the first shape that touches, in its frame.

    The other shape's point is below it by the offset, along the normal.
    """
    a, difference = ca.SX(3, 1), ca.SX(3, 1)
    for weight, f in zip(c.all_weights, c.features, strict=True):
        of_a, of_b = pair.points(f, c.normal)
        a, difference = a + weight * of_a, difference + weight * (of_a - of_b)
    return ca.dot(c.normal, difference), a


def start(pair: Pair, vertices: list[Any], normal: Any, offset: Any) -> Any:
    """Initial state of the search, with the features of three vertices; equal ones count once."""
    normal = _off_axis(pair, normal)
    f = [pair.settled(v, normal) for v in vertices]
    second = ca.logic_not(_same(f[1], f[0]))
    third = ca.logic_not(ca.logic_or(_same(f[2], f[0]), _same(f[2], f[1])))
    share = 1 / (1 + second + third)
    c = Contact(f, [second, third], normal, [second * share, third * share], offset, 1)
    begin, going = c.vector, ca.SX(1)
    for disc, snapped in _discs(pair, normal):
        begin, going = ca.if_else(disc, snapped.vector, begin), ca.if_else(disc, 0, going)
    return ca.vertcat(begin, going, 0, pair.height(begin[_N]), _LONGEST, 0)


def _discs(pair: Pair, n: Any, anywhere: float = 0.0) -> list[tuple[Any, Contact]]:
    """For each shape, whether the other touches its flat disc, and the contact with the normal of the disc.

    With `anywhere`, it need not be hit if the normal is within this angle [rad] of its axis.

    The offset has a kink there, which Newton's method does not see. Three points in the plane of the disc, fixed to its
    body, define the plane.
    """
    found, height = [], pair.height(n)
    for disc in _facing(pair, n):
        near = ca.logic_and(disc.across < _NEARLY_FLAT**2, disc.circle[3] > 0)
        hit = ca.logic_and(near, ca.sumsqr(disc.place) <= disc.circle[3] ** 2)
        # A plane close to it, at the rim, may be lower.
        hit = ca.logic_and(hit, disc.offset <= height + _ROUNDING)
        if anywhere:
            hit = ca.logic_and(disc.across < anywhere**2, disc.circle[3] > 0)
        size, height = 2 * disc.circle[3], disc.circle[2]
        corners = [ca.vertcat(size * x, size * y, height, 0) for x, y in _TRIANGLE]
        rest = disc.features
        fixed = [ca.vertcat(q, rest[4:]) if disc.first else ca.vertcat(rest[:4], q) for q in corners]
        third = ca.SX(1) / 3
        found.append((hit, Contact(fixed, [1, 1], disc.normal, [third, third], disc.offset, 1)))
    return found


def _off_axis(pair: Pair, n: Any) -> Any:
    """The normal, tilted slightly where it is that of a disc which the other shape misses: it touches the rim."""
    for disc in _facing(pair, n):
        distance = ca.sqrt(ca.sumsqr(disc.place))
        flat = ca.logic_and(disc.across <= 1e-12, disc.circle[3] > 0)
        missed = ca.logic_and(flat, distance > disc.circle[3])
        tilt = ca.vertcat(_TILT * disc.place / ca.fmax(distance, 1e-300), 0)
        tilted = disc.normal + (tilt if disc.first else -(pair.R @ tilt))
        n = ca.if_else(missed, tilted / ca.sqrt(ca.sumsqr(tilted)), n)
    return n


@dataclass(frozen=True)
class _Disc:
    """A circle of one shape that faces the other: its normal, and its point nearest to the other."""

    first: bool
    circle: Any
    normal: Any
    across: Any
    place: Any
    offset: Any
    features: Any


def _facing(pair: Pair, n: Any) -> list[_Disc]:
    found = []
    e = -(pair.R.T @ n)
    for body, d, first in ((pair.a, n, True), (pair.b, e, False)):
        if not body.round:
            continue
        axis = ca.vertcat(0, 0, ca.sign(d[2]))
        normal = axis if first else -(pair.R @ axis)
        top = pair.support(normal)
        features = pair.settled(top, normal)
        # The point of the disc below the origin, where the difference has no component across the normal.
        across = (normal * ca.dot(normal, top[:3]) - top[:3]) if first else pair.R.T @ top[:3]
        place = (features[:2] if first else features[4:6]) + across[:2]
        offset = ca.dot(normal, top[:3])
        found.append(_Disc(first, ring(body, axis), normal, d[0] ** 2 + d[1] ** 2, place, offset, features))
    return found


def step(pair: Pair, state: Any) -> Any:
    """A step that lowers the plane or else shortens the next one; it also updates the active features.

    A feature with a negative weight is dropped; one that lies outside the plane is added.
    """
    old, height, radius = contact(state[:SIZE]), state[_HEIGHT], state[_RADIUS]
    far = state[_EXACT] <= 0
    tried = newton(pair, old, far, radius)
    change = ca.norm_2(tried.normal - old.normal)
    top = pair.support(tried.normal)
    new_height = ca.dot(tried.normal, top[:3])
    # Near the solution, rounding errors alone may prevent the plane from becoming lower.
    lower = ca.logic_or(new_height <= height + 1e-15, ca.logic_and(ca.logic_not(far), change <= 1e-9))
    normal = ca.if_else(lower, tried.normal, old.normal)
    new = Contact(tried.features, tried.on, normal, tried.weights, tried.offset, tried.sound)

    dropped, pulling = _dropped(new)
    feature = pair.settled(top, tried.normal)
    known = ca.logic_or(
        _same(feature, new.features[0]),
        ca.logic_or(
            ca.logic_and(new.on[0], _same(feature, new.features[1])),
            ca.logic_and(new.on[1], _same(feature, new.features[2])),
        ),
    )
    standing = new_height > _model_height(pair, tried) + 1e-13
    adding = ca.logic_and(standing, ca.logic_not(known))
    base = contact(ca.if_else(pulling, dropped.vector, new.vector))
    still = ca.logic_or(pulling, adding)
    settled = ca.logic_and(change <= ca.if_else(far, _ROUNDING, 1e-9), ca.logic_not(still))
    next_radius = ca.if_else(lower, ca.fmin(_LONGEST, 2 * radius), 0.3 * ca.fmin(radius, change))
    exact = ca.logic_and(lower, change < _SAFE)
    going = ca.logic_and(ca.logic_not(settled), ca.logic_and(change < 10, next_radius > 1e-12))
    following = ca.if_else(adding, _added(base, feature).vector, base.vector)
    for disc, snapped in _discs(pair, normal):
        following = ca.if_else(disc, snapped.vector, following)
        going = ca.if_else(disc, 0, going)
    return ca.vertcat(following, going, state[_COUNT] + 1, pair.height(following[_N]), next_radius, exact)


def finish(pair: Pair, state: Any) -> Any:
    """The final contact (SIZE, 1); without convergence the present plane, which touches the shapes nevertheless."""
    c = contact(state[:SIZE])
    check = newton(pair, c)
    error = ca.norm_2(check.normal - c.normal) + ca.fabs(check.offset - c.offset)
    height = pair.height(check.normal)
    l1, l2, l3 = check.all_weights
    pulling = ca.fmin(l1, ca.fmin(l2, l3)) < -1e-6
    sound = ca.logic_and(error < 1e-6, ca.logic_and(ca.fabs(height - check.offset) < 1e-9, ca.logic_not(pulling)))
    sound = ca.logic_and(sound, _determined(pair, c, check))
    best = ca.if_else(sound, c.vector, plane(pair, c.normal))
    for disc, snapped in _discs(pair, c.normal, _SNAP):
        # Lines that lie on a disc and end beyond it: the normal is that of the disc, if its plane is lower.
        height = pair.height(best[_N])
        lower = snapped.offset < height - ca.if_else(best[_OK] > 0.5, 1e-13, -1e-15)
        best = ca.if_else(ca.logic_and(disc, lower), snapped.vector, best)
    return best


def plane(pair: Pair, n: Any) -> Any:
    """The contact (SIZE, 1) of the support plane with the given normal."""
    feature = pair.settled(pair.support(n), n)
    return Contact([feature] * 3, [0, 0], n, [0, 0], pair.height(n), 0).vector


def _determined(pair: Pair, c: Contact, solved: Contact) -> Any:
    """Whether a minute perturbation of the pose leaves the contact nearly unchanged.

    It does not where corners coincide (any normal will do) or lines lie along each other: the equations are singular
    there, and rounding errors alone would determine the result.
    """
    turn = ca.DM(np.cross(np.eye(3), _SHAKE))
    moved = newton(Pair(pair.a, pair.b, pair.p + ca.DM(_SHAKE), pair.R + turn @ pair.R), c)
    change = ca.norm_2(moved.normal - solved.normal) + ca.fabs(moved.offset - solved.offset)
    bend, _, rows, _ = _system(pair, c)
    bend += _ADDED * sum((row @ row.T for row in rows), ca.SX(3, 3))
    # The inverse of a matrix that is closer to singular consists of rounding errors too.
    regular = ca.fabs(ca.dot(bend[:, 0], ca.cross(bend[:, 1], bend[:, 2]))) > _REGULAR
    return ca.logic_and(regular, change < _STEEPEST * float(np.linalg.norm(_SHAKE)))


def _model_height(pair: Pair, c: Contact) -> Any:
    """Height of the highest of the features in the direction of the normal."""
    n = c.normal
    first, second, third = (ca.dot(n, _difference(pair, f, n)) for f in c.features)
    return ca.fmax(first, ca.fmax(ca.if_else(c.on[0], second, first), ca.if_else(c.on[1], third, first)))


def _dropped(c: Contact) -> tuple[Contact, Any]:
    """The contact without the feature of the most negative weight, and whether there is one."""
    l1, l2, l3 = c.all_weights
    low = -1e-9
    third = ca.logic_and(c.on[1], ca.logic_and(l3 < low, ca.logic_and(l3 <= l2, l3 <= l1)))
    second = ca.logic_and(c.on[0], ca.logic_and(l2 < low, ca.logic_and(l2 <= l1, ca.logic_not(third))))
    first = ca.logic_and(l1 < low, ca.logic_not(ca.logic_or(second, third)))
    # The first is always active: another active one takes its position.
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
    """The contact with one more feature, in a free position or replacing that of the smallest weight."""
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
