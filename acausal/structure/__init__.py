"""Structure of equation systems: algorithms that take graphs of integers and return vectors of integers.

They know neither the language nor CasADi; the meaning of rows and columns is left to the caller.
"""

from __future__ import annotations

from acausal.structure.alias import AliasClasses as AliasClasses
from acausal.structure.alias import classes as classes
from acausal.structure.alias import cycle as cycle
from acausal.structure.blt import Block as Block
from acausal.structure.blt import blocks as blocks
from acausal.structure.diagnose import DulmageMendelsohn as DulmageMendelsohn
from acausal.structure.diagnose import Subset as Subset
from acausal.structure.diagnose import dulmage_mendelsohn as dulmage_mendelsohn
from acausal.structure.diagnose import minimal_over as minimal_over
from acausal.structure.diagnose import minimal_under as minimal_under
from acausal.structure.dummy import Choice as Choice
from acausal.structure.dummy import select_dummies as select_dummies
from acausal.structure.graph import BoolArray as BoolArray
from acausal.structure.graph import Incidence as Incidence
from acausal.structure.graph import IntArray as IntArray
from acausal.structure.graph import inverse as inverse
from acausal.structure.matching import match as match
from acausal.structure.matching import stays_matched as stays_matched
from acausal.structure.pantelides import Differentiable as Differentiable
from acausal.structure.pantelides import highest_derivatives as highest_derivatives
from acausal.structure.pantelides import pantelides as pantelides
from acausal.structure.tearing import Tearing as Tearing
from acausal.structure.tearing import tear as tear
