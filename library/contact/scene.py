"""A scene of bodies that touch: who can touch whom is found out, not declared."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    as_expr,
    assert_,
    connect,
    fabs,
    maximum,
    part,
    signal_output,
    structural,
)
from acausal.errors import DeclarationError
from acausal.library.contact.bodies import ContactBody, PoseValue, Surfaces
from acausal.library.contact.broad_phase import CANNOT_MEET, FAR, Dropped, Pair, PairReport, candidates, overlapping
from acausal.library.contact.checks import check_bodies, check_scene
from acausal.library.contact.surface import SurfaceContact
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.interfaces import PartialAbsoluteSensor
from acausal.library.multibody.orientation import Vector
from acausal.library.multibody.parts import Fixed

Array = NDArray[np.float64]
_SLACK = 1e-6
"""How far [m], and by which part of its reach, a body may be beyond it: rounding, and the tolerance of a run."""


class Untouched(PartialAbsoluteSensor):
    """What a body feels that nothing touches: no force. It also says so for a body whose contacts come and go."""


class Apart(Component):
    """In the place of a contact that cannot come about: no equations. Those behind it keep their names."""


class ContactScene(Component):
    """Contacts between all bodies of a scene, without a list of pairs.

    Bodies are registered with their shapes (`bodies`); those that move are connected: `connect(self.box.frame_a,
    self.scene.frame("box"))`. What is at rest needs no frame. Pairs that can never touch, by what is declared, are
    dropped when the scene is made. Of the others, up to `keep` stay in the equations for the whole run. When there are
    more, the run is divided: only pairs whose boxes, inflated by `skin`, overlap are in the equations, until some body
    has moved so far that this may no longer be true (docs/devdocs/contact.md).

    `report()` says which pairs are in the equations, and why the others are not.
    """

    bodies: tuple[ContactBody, ...] = structural(doc="The bodies of the scene")
    surfaces: Surfaces = structural(default=Surfaces(), doc="Laws between surfaces")
    keep: int = structural(default=12, doc="Up to so many pairs stay in the equations for the whole run")
    skin: float = structural(default=0.01, doc="By how much boxes are inflated [m]")

    energy: Real = signal_output(unit="J", doc="Stored in all contacts")
    power_damping: Real = signal_output(unit="W", doc="Lost by the damping of all contacts")
    power_friction: Real = signal_output(unit="W", doc="Lost by friction in all contacts")
    power_cutting: Real = signal_output(unit="W", doc="Power of all cuts")

    frames: list[Frame] = part()
    contacts: list[Component] = part()
    untouched: list[Untouched] = part()
    ground: Fixed = part()

    def build(self) -> None:
        check_bodies(self.bodies)
        check_scene(self.skin, self.keep)
        self.ground = Fixed()
        self._place = {b.name: k for k, b in enumerate(b for b in self.bodies if not b.at_rest)}
        self.frames = [Frame() for _ in self._place]
        self.untouched = [Untouched() for _ in self._place]
        self._moving = [(k, b) for k, b in enumerate(self.bodies) if not b.at_rest]
        origin = np.zeros(3), np.eye(3)
        boxes = [b.box(*origin) if b.at_rest else origin[:1] * 2 for b in self.bodies]
        self._at_rest = tuple(np.array(boxes, dtype=float).reshape(-1, 2, 3).swapaxes(0, 1))
        self._candidates, self._dropped = candidates(self.bodies)
        self._makers: dict[Pair, int] = {}
        self._places: dict[Pair, list[Array]] = {}
        self._site: dict[Pair, int] = {}
        self._overlaps: dict[tuple[Pair, int, int], str] = {}
        self._wandering: list[Pair] = []
        self._pairs: list[Pair] = []
        self._select(self._candidates)

    def equations(self) -> Equations:
        for frame, untouched in zip(self.frames, self.untouched, strict=True):
            yield connect(frame, untouched.frame_a)
        for (i, j), contact in self._present():
            a, b = self.bodies[i], self.bodies[j]
            # The one that made the contact knows its frames.
            owner, other = (a, b) if self._maker(i, j) == i else (b, a)
            end, other_end = owner.ends(contact)
            yield connect(self._frame_of(owner), end)
            yield connect(self._frame_of(other), other_end)
        for name in ("energy", "power_damping", "power_friction", "power_cutting"):
            yield getattr(self, name) == self._sum(name)
        for _, body in self._moving:
            if body.reach is not None:
                yield from self._within(body, *body.reach)

    def _within(self, body: ContactBody, low: Vector, high: Vector) -> Equations:
        """What was declared of a body holds: pairs were dropped for it."""
        r = self.frame(body.name).r_0
        beyond: Expr = as_expr(-1.0)
        for k in range(3):
            middle, half = (low[k] + high[k]) / 2, (high[k] - low[k]) / 2
            if math.isfinite(half):
                beyond = maximum(beyond, fabs(r[k] - middle) - half * (1 + _SLACK))
        yield assert_(
            ~(beyond > _SLACK),
            f"{body.name} has left its reach, {tuple(low)} to {tuple(high)} m: what it can touch there was left out",
        )

    def _sum(self, name: str) -> Expr:
        """Sum over the contacts that have a quantity of this name."""
        total = as_expr(0.0)
        for pair, contact in self._present():
            for account in self.bodies[self._maker(*pair)].accounts(contact):
                if hasattr(type(account), name):
                    total = total + getattr(account, name)
        return total

    def frame(self, name: str) -> Frame:
        """The frame of a registered body that moves.

        Raises
        ------
        DeclarationError
            AC170 when no moving body has this name.
        """
        if name not in self._place:
            raise DeclarationError(
                "AC170",
                f"the scene has no moving body '{name}'",
                evidence=[f"moving bodies: {', '.join(self._place) or 'none'}"],
                help="register it: ContactScene(bodies=(ContactBody(name=..., shape=...), ...))",
            )
        found: Frame = self.frames[self._place[name]]
        return found

    def report(self) -> PairReport:
        """Pairs kept and dropped, as the scene is now."""
        kept = []
        for i, j in self._pairs:
            maker = self._maker(i, j)
            how = self.bodies[maker].describe(self.bodies[i + j - maker])
            kept.append((self.bodies[i].name, self.bodies[j].name, how))
        counts = {**self._dropped, FAR: len(self._candidates) - len(self._pairs)}
        return PairReport(len(self.bodies), tuple(kept), tuple(Dropped(r, n) for r, n in counts.items() if n))

    # What the simulator asks of components whose structure depends on the state: acausal/simulate/restructure.py.

    def is_variable(self) -> bool:
        """Whether the structure changes during a run."""
        return len(self._candidates) > self.keep or any(
            self.bodies[self._maker(i, j)].trace for i, j in self._candidates
        )

    def watched(self) -> tuple[str, ...]:
        """Signals, relative to this component, that `restructure` and `moved` look at."""
        poses = [f"frames[{k}].{name}" for k in range(len(self.frames)) for name in ("r_0", "R")]
        return (*poses, *(name for pair in self._pairs if (name := self._trace(pair))))

    def restructure(self, seen: Mapping[str, Array] | None) -> bool:
        """Choose the pairs for one instant, or none without it; True when they differ from those before."""
        chosen: list[Pair] = []
        before = dict(self._site)
        if seen is None:  # a new run
            self._places.clear()
            self._site.clear()
        else:
            low, high = self._boxes(seen)
            first, second = (np.array(side, dtype=int) for side in zip(*self._candidates, strict=True))
            near = overlapping(low - self.skin / 2, high + self.skin / 2, first, second)
            chosen = [pair for pair, is_near in zip(self._candidates, near, strict=True) if is_near]
            for pair in chosen:
                self._find_site(pair, seen)
        if chosen == self._pairs and all(before.get(pair, 0) == self._site.get(pair, 0) for pair in chosen):
            return False
        own = self.__dict__
        own["_building"] = True
        self._select(chosen)
        own["_building"] = False
        return True

    # What is asked where a model is made smaller: acausal/lower/confine.py.

    def poses(self) -> tuple[str, ...]:
        """The poses of the bodies that move."""
        return tuple(f"frames[{k}].{name}" for k in range(len(self.frames)) for name in ("r_0", "R"))

    def confined(self, bounds: Mapping[str, tuple[Array, Array]] | None) -> bool:
        """Keep pairs that can touch while poses stay within bounds, and those kept before.

        True when that adds some, and others may follow.
        """
        before = self._pairs if bounds is not None else []
        chosen, wandering = list(before), self._wandering
        if bounds is not None and self._candidates:
            low, high = self._swept(bounds)
            first, second = (np.array(side, dtype=int) for side in zip(*self._candidates, strict=True))
            meet = overlapping(low, high, first, second)
            chosen = [p for p, m in zip(self._candidates, meet, strict=True) if m or p in before]
            wandering = [p for p in chosen if not self._keeps_to_one_hole(p, bounds)]
        own = self.__dict__
        own["_building"] = True
        self._pairs, self._wandering = chosen, wandering
        self.contacts = [self._contact(i, j) if (i, j) in chosen else Apart() for i, j in self._candidates]
        own["_building"] = False
        # all of them are in: wider bounds change nothing but what drills may do
        complete = len(chosen) == len(self._candidates) and not any(b.trace for b in self.bodies)
        return len(chosen) > len(before) and not complete

    def apart(self) -> list[tuple[str, str]]:
        """What is not in the equations, and why: pairs that cannot meet by name, others as numbers."""
        never = [
            f"{self.bodies[i].name} - {self.bodies[j].name}" for i, j in self._candidates if (i, j) not in self._pairs
        ]
        counted = [(f"{n} pair{'s' * (n > 1)}", reason) for reason, n in self._dropped.items() if n]
        return [(name, CANNOT_MEET) for name in never] + counted

    def unsteady(self) -> list[str]:
        """Pairs in which a drill may leave more than one hole."""
        return [f"{self.bodies[i].name} - {self.bodies[j].name}" for i, j in self._wandering]

    def released(self) -> None:
        """All pairs that may touch by what is declared."""
        own = self.__dict__
        own["_building"] = True
        self._select(self._candidates)
        own["_building"] = False

    def _swept(self, bounds: Mapping[str, tuple[Array, Array]]) -> tuple[Array, Array]:
        """Boxes around everything each body can reach within bounds of its pose [m]."""
        low, high = (side.copy() for side in self._at_rest)
        for place, (number, body) in enumerate(self._moving):
            r, R = (bounds[f"frames[{place}].{name}"] for name in ("r_0", "R"))
            if np.array_equal(R[0], R[1]):
                own = body.box(np.zeros(3), R[0].reshape(3, 3))
            else:
                own = _turned(body, R[0].reshape(3, 3), R[1].reshape(3, 3))
            slack = 1e-9 * (1 + np.abs(np.nan_to_num(own, posinf=0.0, neginf=0.0)).max())
            low[number], high[number] = r[0] + own[0] - slack, r[1] + own[1] + slack
        return low, high

    def _keeps_to_one_hole(self, pair: Pair, bounds: Mapping[str, tuple[Array, Array]]) -> bool:
        """Whether a contact leaves no trace, or its drill moves along its axis only, into a workpiece that stands."""
        maker = self._maker(*pair)
        if not self.bodies[maker].trace or isinstance(self._contact(*pair), SurfaceContact):
            return True
        other = self.bodies[sum(pair) - maker]
        if not other.at_rest:
            return False
        k = self._place[self.bodies[maker].name]
        (low, high), R = bounds[f"frames[{k}].r_0"], bounds[f"frames[{k}].R"]
        along = np.flatnonzero(low != high)
        # an axis along one of the body's and of the world's, whichever way the drill has turned about it
        own = np.array(self.bodies[maker].pose[1])[:, 2]
        column = int(np.argmax(np.abs(own)))
        axis, after = (side.reshape(3, 3)[:, column] for side in R)
        steady = abs(own[column]) > 1 - 1e-12 and np.array_equal(axis, after) and len(along) <= 1
        return bool(steady and (not len(along) or abs(axis[along[0]]) > 1 - 1e-12))

    def _trace(self, pair: Pair) -> str:
        """The signal by which the contact of a pair shows that it left a trace; "" when it leaves none."""
        maker = self._maker(*pair)
        own = self.bodies[maker].trace
        if not own or pair not in self._pairs:
            return ""
        k = self._pairs.index(pair)
        return f"contacts[{k}].{own}" if hasattr(type(self.contacts[k]), own) else ""

    def _find_site(self, pair: Pair, seen: Mapping[str, Array]) -> None:
        maker = self._maker(*pair)
        body, other = self.bodies[maker], self.bodies[sum(pair) - maker]
        if body.trace:
            poses = self._pose(body, seen), self._pose(other, seen)
            known, current = self._places.get(pair, []), self._site.get(pair, 0)
            # Left a while ago: what is remembered was marked, or it would not be worth to be remembered.
            marked = bool(np.any(seen.get(self._trace(pair), np.ones(1)) > 0))
            known, current = body.site(other, *poses, known, current, marked)
            self._places[pair], self._site[pair] = known, current
            near = body.overlaps(other, *poses, known, current)
            for k in range(len(known)):
                self._overlaps.pop((pair, min(k, current), max(k, current)), None)
                if k in near:
                    self._overlaps[pair, min(k, current), max(k, current)] = near[k]

    def _pose(self, body: ContactBody, seen: Mapping[str, Array]) -> PoseValue:
        k = self._place.get(body.name)
        return (np.zeros(3), np.eye(3)) if k is None else (seen[f"frames[{k}].r_0"], seen[f"frames[{k}].R"])

    def moved(self, before: Mapping[str, Array], after: Mapping[str, Array]) -> Array:
        """How far the choice is used up at several instants [1]: some body has moved by so many halves of the skin.

        `before` holds values at the instant of the choice, `after` those of n instants, first axis n. A pair that was
        left out is apart by the skin, so both of its bodies may move by half of it.
        """
        used = np.zeros(1)
        for k, body in enumerate(b for _, b in self._moving):
            start = before[f"frames[{k}].r_0"], before[f"frames[{k}].R"]
            moved = body.displacement(start, after[f"frames[{k}].r_0"], after[f"frames[{k}].R"])
            used = np.maximum(used, moved / (self.skin / 2))
        return np.asarray(used)

    def labels(self) -> list[tuple[str, str]]:
        """Each contact as it is called now, and by a name that stays the same while others come and go."""
        return [(f"contacts[{k}]", self._lasting(p, self._site.get(p, 0))) for k, p in enumerate(self._pairs)]

    def _lasting(self, pair: Pair, site: int) -> str:
        names = ",".join(self.bodies[k].name for k in pair) + (f"#{site}" if site else "")
        return f"contacts[{names}]"

    def remarks(self, largest: Callable[[str], float]) -> list[str]:
        """What the run has to tell, for the largest value each signal had: places of contacts that overlap."""
        return [
            text
            for (pair, *sites), text in self._overlaps.items()
            if all(largest(f"{self._lasting(pair, k)}.{self.bodies[self._maker(*pair)].trace}") > 0 for k in sites)
        ]

    def _select(self, pairs: list[Pair]) -> None:
        self._pairs = list(pairs)
        self.contacts = [self._contact(i, j) for i, j in pairs]

    def _present(self) -> Iterator[tuple[Pair, Component]]:
        """The pairs in the equations with their contacts."""
        contacts = [c for c in self.contacts if not isinstance(c, Apart)]
        return zip(self._pairs, contacts, strict=True)

    def _maker(self, i: int, j: int) -> int:
        """Which of two bodies makes their contact: the first that has something to say about the other."""
        known: int | None = self._makers.get((i, j))
        if known is None:
            made = self.bodies[i].contact(self.bodies[j], self.surfaces)
            other = None if made is not None else self.bodies[j].contact(self.bodies[i], self.surfaces)
            known = self._makers[i, j] = j if other is not None else i
        return known

    def _contact(self, i: int, j: int) -> Component:
        maker = self._maker(i, j)
        body, other = self.bodies[maker], self.bodies[i + j - maker]
        return body.contact(other, self.surfaces) or self.surfaces.contact(body, other)

    def _frame_of(self, body: ContactBody) -> Frame:
        return self.ground.frame_b if body.at_rest else self.frame(body.name)

    def _boxes(self, seen: Mapping[str, Array]) -> tuple[Array, Array]:
        low, high = (side.copy() for side in self._at_rest)
        for place, (number, body) in enumerate(self._moving):
            low[number], high[number] = body.box(seen[f"frames[{place}].r_0"], seen[f"frames[{place}].R"])
        return low, high


def _turned(body: ContactBody, low: Array, high: Array) -> tuple[Array, Array]:
    """Box around a body whose frame stays in place and turns within bounds of its rotation [m]."""
    sides = np.array(body.box(np.zeros(3), np.eye(3)))
    radius = body.radius()
    if not np.isfinite(sides).all() or not np.isfinite([low, high]).all():
        return np.full(3, -radius), np.full(3, radius)
    products = np.array([[entry * side for side in sides] for entry in (low, high)])
    lowest, highest = products.min(axis=(0, 1)).sum(axis=1), products.max(axis=(0, 1)).sum(axis=1)
    return np.maximum(lowest, -radius), np.minimum(highest, radius)
