"""Checks of a run before it is differentiated, for points whose one-sided derivatives differ."""

from __future__ import annotations

from acausal.export.sensitivity.chain import Chain
from acausal.export.sensitivity.jumps import refuse_jumps
from acausal.export.sensitivity.resting import refuse_resting
from acausal.export.sensitivity.start_on_relation import refuse_start_on_relation


def refuse_two_sided(chain: Chain) -> None:
    """Raise ExportError AC615 for a run that rests on a kink, starts on an acting relation, or jumps without event."""
    refuse_resting(chain)
    refuse_start_on_relation(chain)
    refuse_jumps(chain)
