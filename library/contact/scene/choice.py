"""Which contacts of a scene are in the equations: chosen by poses while a model runs, by bounds where it is reduced."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from acausal import Component
from acausal.library.contact.scene.bodies import ContactBody, PoseValue
from acausal.library.contact.scene.broad_phase import CANNOT_MEET, Pair, gaps, overlapping
from acausal.library.contact.scene.outlines import Outlines
from acausal.library.contact.scene.surface import SurfaceContact

Array = NDArray[np.float64]
_SPARE = 2
"""The present pairs are kept while they number at most this many times the near pairs, or the moving bodies."""

_LITTLE = 0.25
"""Fraction of half the clearance by which bodies may move before pairs are examined one by one."""

_NO_GAP = 1e-12
"""Smallest gap [m] that approaches are compared with: a pair left out with a smaller one may hardly approach."""


class Scene(Protocol):
    """The part of `ContactScene` that a choice uses; its members are documented there."""

    @property
    def bodies(self) -> tuple[ContactBody, ...]: ...
    @property
    def skin(self) -> float: ...
    @property
    def moving(self) -> Sequence[tuple[int, ContactBody]]: ...
    @property
    def numbers(self) -> list[int]: ...
    @property
    def at_rest(self) -> tuple[Array, ...]: ...
    @property
    def outlines(self) -> Outlines: ...
    @property
    def ends(self) -> Any: ...
    @property
    def dropped(self) -> Mapping[str, int]: ...
    @property
    def has_traces(self) -> bool: ...
    @property
    def candidates(self) -> tuple[Pair, ...]: ...
    def pairs_of(self, places: Any, /) -> tuple[Pair, ...]: ...
    def among(self, pairs: Sequence[Pair], /) -> NDArray[np.bool_]: ...
    def with_pairs(self, pairs: Sequence[Pair], steady: bool, /) -> Component: ...
    def kind(self, pair: Pair, /) -> type[Component]: ...
    def place(self, body: ContactBody, /) -> int | None: ...
    def maker(self, i: int, j: int, /) -> int: ...


@dataclass(frozen=True, eq=False)
class SceneChoice:
    """The pairs of a scene that are in the equations: implements `acausal.language.choices.Choice`.

    Attributes
    ----------
    pairs
        Numbers of two bodies each.
    places, sites
        By pair: sites of the contacts that leave traces (`ContactBody.site`), and the number of the present one.
    wandering
        Pairs in which a drill may leave more than one hole.
    steady
        Whether the numbers of pairs that are left out stay unused, so that later pairs keep their names.
    clearance
        Smallest gap [m] of the pairs that are left out, at the instant of the choice. With traces it is the skin,
        however far apart the others are, because each choice also checks whether a drill has moved to another site.
    """

    scene: Scene
    pairs: tuple[Pair, ...]
    places: Mapping[Pair, tuple[Array, ...]] = field(default_factory=dict)
    sites: Mapping[Pair, int] = field(default_factory=dict)
    wandering: tuple[Pair, ...] = ()
    steady: bool = False
    clearance: float = 0.0

    def applied(self) -> Component:
        """The scene with these contacts."""
        return self.scene.with_pairs(self.pairs, self.steady)

    def labels(self) -> list[tuple[str, str]]:
        """The present name of each contact, and a name that stays the same while others come and go."""
        numbered, own = enumerate(self.scene.candidates if self.steady else self.pairs), set(self.pairs)
        return [(f"contacts[{k}]", self._lasting(p, self.sites.get(p, 0))) for k, p in numbered if p in own]

    def structure(self) -> tuple[object, ...]:
        """Which contacts are present, and at which sites."""
        return self.pairs, tuple(self.sites.get(p, 0) for p in self.pairs), self.steady

    def watched(self) -> tuple[str, ...]:
        """Poses, and the traces that contacts leave."""
        traced = self.pairs if self.scene.has_traces else ()
        return (*self.poses(), *(name for pair in traced if (name := self._trace(pair))))

    def poses(self) -> tuple[str, ...]:
        """The poses of the bodies that move."""
        return tuple(f"frames[{k}].{name}" for k in range(len(self.scene.moving)) for name in ("r_0", "R"))

    def following(self, seen: Mapping[str, Array]) -> SceneChoice:
        """The choice for one instant: it includes all pairs whose boxes overlap once inflated by the skin.

        A different choice is a different structure, which has to be compiled. So the present pairs are kept as long as
        they include the near ones, and a new choice takes at least as many of the nearest pairs as there are moving
        bodies: balls that fall onto a plane one after the other then share one structure. In a scene with traces, only
        the near pairs are chosen.
        """
        scene = self.scene
        gap = gaps(*self._sides(scene.outlines.boxes(*self._frames(seen))), *scene.ends)
        near = gap <= scene.skin
        chosen = scene.pairs_of(np.flatnonzero(near))
        if not scene.has_traces and len(chosen) <= len(self.pairs) <= _SPARE * max(len(chosen), len(scene.numbers)):
            held = scene.among(self.pairs)
            if not (near & ~held).any():
                return replace(self, clearance=_least(gap[~held]))
        if not scene.has_traces and chosen:
            most = max(len(chosen), len(scene.numbers))
            further = np.partition(gap, most)[most] if len(gap) > most else np.inf
            chosen = scene.pairs_of(np.flatnonzero(near | (gap < further)))
            near |= gap < further
        places, sites = dict(self.places), dict(self.sites)
        for pair in chosen if self.scene.has_traces else ():
            self._find_site(pair, seen, places, sites)
        clearance = scene.skin if scene.has_traces else _least(gap[~near])
        return replace(self, pairs=chosen, places=places, sites=sites, clearance=clearance)

    def moved(self, before: Mapping[str, Array], after: Mapping[str, Array]) -> Array:
        """Upper bound of the fraction of the gaps of left-out pairs that is used up, at n instants [1], shape (n,).

        The bodies of such a pair are at least the clearance apart, so each may move by half of it. Balls that fall
        side by side move much farther without approaching each other; beyond a small displacement, the gaps are
        therefore also bounded pair by pair, for all instants together.
        """
        start, later = self._frames(before), self._frames(after)
        used = self.scene.outlines.moved(start, *later) / (self.clearance / 2)
        if used.max(initial=0.0) <= _LITTLE or self.scene.has_traces or self.scene.outlines.endless:
            return used
        return np.minimum(used, self._closed(start, later))

    def _closed(self, start: tuple[Array, Array], later: tuple[Array, Array]) -> float:
        """Largest fraction of its gap by which a left-out pair may have approached, also between the instants [1].

        Each body is assumed to stay within the union of its boxes at all instants, extended by the largest change from
        one instant to the next.
        """
        scene = self.scene
        out = ~scene.among(self.pairs)
        ends = scene.ends[0][out], scene.ends[1][out]
        boxes = scene.outlines.boxes(*later)
        step = [np.abs(np.diff(side, axis=0)).max(axis=0, initial=0.0) for side in boxes]
        swept = boxes[0].min(axis=0) - step[0], boxes[1].max(axis=0) + step[1]
        at_start, meanwhile = (gaps(*self._sides(own), *ends) for own in (scene.outlines.boxes(*start), swept))
        return float((1.0 - meanwhile / np.maximum(at_start, _NO_GAP)).max(initial=0.0))

    def _sides(self, own: tuple[Array, Array]) -> tuple[Array, Array]:
        """Lowest and highest corners of the boxes of all bodies [m], shape (n, 3) each; `own`: of the moving ones."""
        low, high = (side.copy() for side in self.scene.at_rest)
        low[self.scene.numbers], high[self.scene.numbers] = own
        return low, high

    def _frames(self, seen: Mapping[str, Array]) -> tuple[Array, Array]:
        """Positions (n, 3) and rotations (n, 3, 3) of the n moving bodies; for m instants (m, n, 3), (m, n, 3, 3)."""
        r, R = ([seen[f"frames[{k}].{name}"] for k in range(len(self.scene.moving))] for name in ("r_0", "R"))
        return np.stack(r, axis=r[0].ndim - 1), np.stack(R, axis=R[0].ndim - 2)

    def confined(self, bounds: Mapping[str, tuple[Array, Array]]) -> tuple[SceneChoice, bool]:
        """The choice extended by the pairs that can touch while poses stay within `bounds`, and whether it grew.

        As long as it grows, further pairs may follow. `bounds` holds the lowest and the highest values of each signal,
        in the shape of the signal.
        """
        before, candidates = self.pairs, self.scene.candidates
        if not candidates:
            return self, False
        meet = overlapping(*self._swept(bounds), *self.scene.ends)
        known = set(before)
        chosen = tuple(p for p, m in zip(candidates, meet, strict=True) if m or p in known)
        wandering = tuple(p for p in chosen if not self._keeps_to_one_hole(p, bounds))
        # With all candidates included, wider bounds can only change which drills may leave more than one hole.
        complete = len(chosen) == len(candidates) and not any(b.trace for b in self.scene.bodies)
        grown = len(chosen) > len(before) and not complete
        return replace(self, pairs=chosen, wandering=wandering), grown

    def apart(self) -> list[tuple[str, str]]:
        """Pairs outside the equations with the reason: candidates by name, pairs dropped before as a count."""
        never = [self._named(pair) for pair in self.scene.candidates if pair not in set(self.pairs)]
        counted = [(f"{n} pair{'s' * (n > 1)}", reason) for reason, n in self.scene.dropped.items() if n]
        return [(name, CANNOT_MEET) for name in never] + counted

    def unsteady(self) -> list[str]:
        """Pairs in which a drill may leave more than one hole."""
        return [self._named(pair) for pair in self.wandering]

    def _named(self, pair: Pair) -> str:
        return " - ".join(self.scene.bodies[k].name for k in pair)

    def _lasting(self, pair: Pair, site: int) -> str:
        names = ",".join(self.scene.bodies[k].name for k in pair) + (f"#{site}" if site else "")
        return f"contacts[{names}]"

    def _maker(self, pair: Pair) -> ContactBody:
        found: ContactBody = self.scene.bodies[self.scene.maker(*pair)]
        return found

    def _trace(self, pair: Pair) -> str:
        """Name of the signal that is positive once the contact of a pair has left a trace; "" if it leaves none."""
        own = self._maker(pair).trace
        if not own or pair not in self.pairs or not hasattr(self.scene.kind(pair), own):
            return ""
        return f"contacts[{self.pairs.index(pair)}].{own}"

    def _find_site(
        self,
        pair: Pair,
        seen: Mapping[str, Array],
        places: dict[Pair, tuple[Array, ...]],
        sites: dict[Pair, int],
    ) -> None:
        """Enter the present site of the contact of a pair in `places` and `sites`."""
        maker = self.scene.maker(*pair)
        body, other = self.scene.bodies[maker], self.scene.bodies[sum(pair) - maker]
        if body.trace:
            poses = self._pose(body, seen), self._pose(other, seen)
            known, current = list(places.get(pair, ())), sites.get(pair, 0)
            # A contact outside the equations has no signal; its remembered site counts as marked, since only marked
            # sites are remembered.
            marked = bool(np.any(seen.get(self._trace(pair), np.ones(1)) > 0))
            known, current = body.site(other, *poses, known, current, marked)
            places[pair], sites[pair] = tuple(known), current

    def _pose(self, body: ContactBody, seen: Mapping[str, Array]) -> PoseValue:
        k = self.scene.place(body)
        return (np.zeros(3), np.eye(3)) if k is None else (seen[f"frames[{k}].r_0"], seen[f"frames[{k}].R"])

    def _swept(self, bounds: Mapping[str, tuple[Array, Array]]) -> tuple[Array, Array]:
        """Boxes [m] around the volume that each body can reach while its pose stays within bounds."""
        low, high = (side.copy() for side in self.scene.at_rest)
        for place, (number, body) in enumerate(self.scene.moving):
            r, R = (bounds[f"frames[{place}].{name}"] for name in ("r_0", "R"))
            if np.array_equal(R[0], R[1]):
                own = body.box(np.zeros(3), R[0].reshape(3, 3))
            else:
                own = _turned(body, R[0].reshape(3, 3), R[1].reshape(3, 3))
            slack = 1e-9 * (1 + np.abs(np.nan_to_num(own, posinf=0.0, neginf=0.0)).max())
            low[number], high[number] = r[0] + own[0] - slack, r[1] + own[1] + slack
        return low, high

    def _keeps_to_one_hole(self, pair: Pair, bounds: Mapping[str, tuple[Array, Array]]) -> bool:
        """Whether a contact leaves no trace, or its drill moves only along its axis into a workpiece at rest."""
        body = self._maker(pair)
        if not body.trace or issubclass(self.scene.kind(pair), SurfaceContact):
            return True
        if not self.scene.bodies[sum(pair) - self.scene.maker(*pair)].at_rest:
            return False
        k = self.scene.place(body)
        (low, high), R = bounds[f"frames[{k}].r_0"], bounds[f"frames[{k}].R"]
        along = np.flatnonzero(low != high)
        # The drill's axis must lie along an axis of its body and of the world; rotation about it does not matter.
        own = np.array(body.pose[1])[:, 2]
        column = int(np.argmax(np.abs(own)))
        axis, after = (side.reshape(3, 3)[:, column] for side in R)
        steady = abs(own[column]) > 1 - 1e-12 and np.array_equal(axis, after) and len(along) <= 1
        return bool(steady and (not len(along) or abs(axis[along[0]]) > 1 - 1e-12))


def _least(gaps: Array) -> float:
    return float(gaps.min(initial=np.inf))


def _turned(body: ContactBody, low: Array, high: Array) -> tuple[Array, Array]:
    """Box [m] around a body whose frame keeps its position and turns within bounds of its rotation matrix."""
    sides = np.array(body.box(np.zeros(3), np.eye(3)))
    radius = body.radius()
    if not np.isfinite(sides).all() or not np.isfinite([low, high]).all():
        return np.full(3, -radius), np.full(3, radius)
    products = np.array([[entry * side for side in sides] for entry in (low, high)])
    lowest, highest = products.min(axis=(0, 1)).sum(axis=1), products.max(axis=(0, 1)).sum(axis=1)
    return np.maximum(lowest, -radius), np.minimum(highest, radius)
