"""What is refused of a run before it is differentiated: derivatives of both sides differ, or miss what moves."""

from __future__ import annotations

from acausal.export.sensitivity.begun import refuse_begun
from acausal.export.sensitivity.chain import Chain
from acausal.export.sensitivity.jumps import refuse_jumps
from acausal.export.sensitivity.resting import refuse_resting


def refuse_two_sided(chain: Chain) -> None:
    """Raise ExportError AC615 for a run that rests on a kink, begins on what acts, or jumps without an event."""
    refuse_resting(chain)
    refuse_begun(chain)
    refuse_jumps(chain)
