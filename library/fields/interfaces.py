"""Port of a dissolved substance. Heat and electricity have the ports of their own libraries.

Fields are vectors over `n` equal cells. A cell holds the mean over its volume, assigned to its centre; the flow between
two cells is an expression of both values. Half a cell lies between the last centre and a port, so that a port has the
value at the end.
"""

from __future__ import annotations

from acausal import Connector, Real, flow, variable


class ConcentrationPort(Connector):
    """End of a channel."""

    c: Real = variable(
        unit="mol/m3",
        doc="Concentration at the port",
        hint="is this port connected to a FixedConcentration, or is its channel free there (free_a, free_b)?",
    )
    n_flow: Real = flow(unit="mol/s", doc="Molar flow rate into the component")
