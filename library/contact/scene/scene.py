"""A scene of bodies in contact, which finds the pairs that can touch by itself."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

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
    quantity,
    signal_output,
    structural,
)
from acausal.errors import DeclarationError
from acausal.library.contact.scene.bodies import ContactBody, Surfaces
from acausal.library.contact.scene.broad_phase import (
    FAR,
    Dropped,
    Pair,
    PairReport,
    candidates,
)
from acausal.library.contact.scene.checks import check_bodies, check_scene
from acausal.library.contact.scene.choice import SceneChoice
from acausal.library.contact.scene.outlines import Outlines
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.interfaces import PartialAbsoluteSensor
from acausal.library.multibody.orientation import Vector
from acausal.library.multibody.parts import Fixed

Array = NDArray[np.float64]
_SLACK = 1e-6
"""Distance [m], and fraction of its reach, by which a body may exceed it: covers rounding and solver tolerances."""


class Untouched(PartialAbsoluteSensor):
    """Zero force on a frame, so that it stays connected while no contact of its body is in the equations."""


class Apart(Component):
    """Placeholder without equations for a contact that is left out, so that later contacts keep their names."""


class ContactScene(Component):
    """Contacts between all bodies of a scene, without a list of pairs.

    Bodies are registered with their shapes (`bodies`); those that move are connected: `connect(self.box.frame_a,
    self.scene.frame("box"))`. Bodies at rest need no frame. Pairs that can never touch according to their declarations
    are dropped when the scene is made. If at most `keep` others remain, all of them stay in the equations for the whole
    run. If there are more, the run is divided into segments: only pairs whose boxes, inflated by `skin`, overlap are in
    the equations, until a body has moved so far that others may overlap (docs/devdocs/contact.md).

    `report()` lists the pairs in the equations, and the reasons for which the others are left out.
    """

    bodies: tuple[ContactBody, ...] = structural(doc="The bodies of the scene")
    surfaces: Surfaces = structural(default=Surfaces(), doc="Laws between surfaces")
    keep: int = structural(default=12, doc="Up to this many pairs stay in the equations for the whole run")
    skin: float = structural(default=0.01, doc="Distance by which bounding boxes are inflated [m]")

    energy: Real = signal_output(unit="J", doc="Energy stored in all contacts")
    power_normal: Real = signal_output(unit="W", doc="Power into the compliance of all contacts, stored or lost")
    power_damping: Real = signal_output(
        unit="W", doc="Power lost by the damping of all contacts, except what drills lose at once at an edge"
    )
    power_friction: Real = signal_output(unit="W", doc="Power lost by friction in all contacts")
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
        self.moving = [(k, b) for k, b in enumerate(self.bodies) if not b.at_rest]
        origin = np.zeros(3), np.eye(3)
        boxes = [b.box(*origin) if b.at_rest else origin[:1] * 2 for b in self.bodies]
        self.at_rest = tuple(np.array(boxes, dtype=float).reshape(-1, 2, 3).swapaxes(0, 1))
        self.numbers = [k for k, _ in self.moving]
        self.outlines = Outlines.of([b for _, b in self.moving])
        self.ends, self.dropped = candidates(self.bodies)
        self.has_traces = any(b.trace for b in self.bodies)
        self._makers: dict[Pair, int] = {}
        self._kinds: dict[Pair, type[Component]] = {}
        # Only few of many pairs are ever near: the contacts of all pairs are made on request only.
        self._is_made = len(self.ends[0]) <= self.keep or self.has_traces or self.surfaces.law is None
        self._pairs = self.candidates if self._is_made else ()
        self.contacts = [self._contact(i, j) for i, j in self._pairs]

    @property
    def candidates(self) -> tuple[Pair, ...]:
        """Pairs that the declarations of the bodies allow to touch: numbers of two bodies each."""
        return self.pairs_of(slice(None))

    def pairs_of(self, places: Any) -> tuple[Pair, ...]:
        """The candidates at some indices."""
        first, second = self.ends
        return tuple(zip(first[places].tolist(), second[places].tolist(), strict=True))

    def among(self, pairs: Sequence[Pair]) -> NDArray[np.bool_]:
        """Which of the candidates are among `pairs`, as a mask."""
        first, second = self.ends
        n = len(self.bodies)
        return np.asarray(np.isin(first * n + second, [i * n + j for i, j in pairs]))

    def equations(self) -> Equations:
        for frame, untouched in zip(self.frames, self.untouched, strict=True):
            yield connect(frame, untouched.frame_a)
        for (i, j), contact in self._present():
            a, b = self.bodies[i], self.bodies[j]
            # The frames of a contact are known to the body that made it.
            owner, other = (a, b) if self.maker(i, j) == i else (b, a)
            end, other_end = owner.ends(contact)
            yield connect(self._frame_of(owner), end)
            yield connect(self._frame_of(other), other_end)
        for name in ("energy", "power_normal", "power_damping", "power_friction", "power_cutting"):
            yield getattr(self, name) == self._sum(name)
        for _, body in self.moving:
            if body.reach is not None:
                yield from self._within(body, *body.reach)

    def _within(self, body: ContactBody, low: Vector, high: Vector) -> Equations:
        """Assert that a body stays within its declared reach, on account of which pairs were dropped."""
        r = self.frame(body.name).r_0
        beyond: Expr = as_expr(-1.0)
        for k in range(3):
            middle, half = (low[k] + high[k]) / 2, (high[k] - low[k]) / 2
            if math.isfinite(half):
                beyond = maximum(beyond, fabs(r[k] - quantity(middle, "m")) - quantity(half * (1 + _SLACK), "m"))
        yield assert_(
            ~(beyond > _SLACK),
            f"{body.name} has left its reach, {tuple(low)} to {tuple(high)} m: contacts out there are not modelled",
        )

    def _sum(self, name: str) -> Expr:
        """Sum of a quantity over the contacts that have it."""
        total = as_expr(0.0)
        for pair, contact in self._present():
            for account in self.bodies[self.maker(*pair)].accounts(contact):
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
        """The pairs that are kept and dropped at present."""
        kept, pairs = [], self._pairs if self._is_made else self.candidates
        for i, j in pairs:
            maker = self.maker(i, j)
            how = self.bodies[maker].describe(self.bodies[i + j - maker])
            kept.append((self.bodies[i].name, self.bodies[j].name, how))
        counts = {**self.dropped, FAR: len(self.ends[0]) - len(pairs)}
        return PairReport(len(self.bodies), tuple(kept), tuple(Dropped(r, n) for r, n in counts.items() if n))

    # The interface `acausal.language.choices.Changing` of components whose structure is chosen.

    def is_variable(self) -> bool:
        """Whether the structure changes during a run."""
        return len(self.ends[0]) > self.keep or (
            self.has_traces and any(self.bodies[self.maker(i, j)].trace for i, j in self.candidates)
        )

    def whole(self) -> SceneChoice:
        """The choice of all candidate pairs."""
        wandering = filter(self._leaves_traces, self.candidates) if self.has_traces else ()
        return SceneChoice(self, self.candidates, wandering=tuple(wandering))

    def _leaves_traces(self, pair: Pair) -> bool:
        return hasattr(self.kind(pair), self.bodies[self.maker(*pair)].trace or "no trace")

    def least(self, steady: bool) -> SceneChoice:
        """The choice of no pairs; with `steady`, pairs added later keep their numbers among all candidates."""
        return SceneChoice(self, (), steady=steady)

    def with_pairs(self, pairs: Sequence[Pair], steady: bool) -> ContactScene:
        """The scene with the contacts of these pairs; with `steady`, the others leave placeholders."""
        is_whole = not steady and len(pairs) == len(self.ends[0])
        if is_whole and (len(self._pairs) == len(pairs) or "_whole" in self.__dict__):
            made: ContactScene = self.__dict__.get("_whole", self)
            return made
        known = self.__dict__.get("_last_view")
        if known is not None and known[0] == (tuple(pairs), steady):
            return known[1]  # type: ignore[no-any-return]
        places, own = self.candidates if steady else pairs, set(pairs)
        contacts = [self._contact(*pair) if pair in own else Apart() for pair in places]
        view = self._view({"_pairs": tuple(pairs), "_is_made": True})
        view._adopt("contacts", contacts)
        if is_whole:
            self.__dict__["_whole"] = view  # made once per scene, as in `build`
        else:
            self.__dict__["_last_view"] = (tuple(pairs), steady), view
        return view

    def kind(self, pair: Pair) -> type[Component]:
        """Class of the contact component of a pair."""
        found: type[Component] | None = self._kinds.get(pair)
        if found is None:
            found = self._kinds[pair] = type(self._contact(*pair))
        return found

    def place(self, body: ContactBody) -> int | None:
        """Number of the frame of a body; None for one at rest."""
        found: int | None = self._place.get(body.name)
        return found

    def _present(self) -> Iterator[tuple[Pair, Component]]:
        """The pairs in the equations with their contacts."""
        contacts = [c for c in self.contacts if not isinstance(c, Apart)]
        return zip(self._pairs, contacts, strict=True)

    def maker(self, i: int, j: int) -> int:
        """Which of two bodies makes their contact: the first that defines one with the other."""
        known: int | None = self._makers.get((i, j))
        if known is None:
            made = self.bodies[i].contact(self.bodies[j], self.surfaces)
            other = None if made is not None else self.bodies[j].contact(self.bodies[i], self.surfaces)
            known = self._makers[i, j] = j if other is not None else i
        return known

    def _contact(self, i: int, j: int) -> Component:
        maker = self.maker(i, j)
        body, other = self.bodies[maker], self.bodies[i + j - maker]
        return body.contact(other, self.surfaces) or self.surfaces.contact(body, other)

    def _frame_of(self, body: ContactBody) -> Frame:
        return self.ground.frame_b if body.at_rest else self.frame(body.name)
