"""Overconstrained connectors: declarations from which the flattener builds a spanning tree over frames.

A rotation matrix has nine entries and three degrees of freedom, so that a closed loop of frames would have six
equations too many. As in the Modelica language (3.6, section 9.4), components declare the relations between their
frames. The flattener cuts each loop at one connection, which gets three equations instead of nine.
"""

from __future__ import annotations

from dataclasses import dataclass

from acausal.errors import DeclarationError
from acausal.language.component import Connector
from acausal.language.statement import Statement, made


@dataclass(frozen=True)
class Tie(Statement):
    """Base class of the declarations that `ties` yields."""

    def __post_init__(self) -> None:
        made(self)


@dataclass(frozen=True)
class Branch(Tie):
    """A relation between two connectors of one component, which is never cut."""

    a: Connector
    b: Connector


@dataclass(frozen=True)
class Root(Tie):
    """The absolute orientation of the connector is known."""

    a: Connector


@dataclass(frozen=True)
class PotentialRoot(Tie):
    """The connector becomes the root if its island has none; the smallest priority number comes first."""

    a: Connector
    priority: int = 0


def branch(a: Connector, b: Connector) -> Branch:
    """Declare, in `ties`, that the component relates the orientations of `a` and `b`."""
    return Branch(a, b)


def root(a: Connector) -> Root:
    """Declare, in `ties`, that the component fixes the orientation of `a`."""
    return Root(a)


def potential_root(a: Connector, priority: int = 0) -> PotentialRoot:
    """Declare, in `ties`, that the component can define the orientation of `a` if no other component does."""
    return PotentialRoot(a, priority)


def _role(connector: Connector, key: str) -> bool:
    if not isinstance(connector, Connector):
        raise DeclarationError("AC121", f"`{connector}` is no connector", help="give a frame of the component")
    roles: dict[str, bool] | None = connector.__dict__.get("_roles")
    if roles is None:
        raise DeclarationError(
            "AC122",
            f"the place of {connector._path_to('').rstrip('.')} in the tree of frames is not known yet",
            help="call rooted() and is_root() inside equations(), and declare branch(), root() in ties()",
        )
    return roles[key]


def is_root(connector: Connector) -> bool:
    """True if the flattener has made this connector the root of its island; for use in `equations`."""
    return _role(connector, "is_root")


def rooted(connector: Connector) -> bool:
    """True if `connector` is closer to the root than its partner in the branch; for use in `equations`."""
    return _role(connector, "rooted")
