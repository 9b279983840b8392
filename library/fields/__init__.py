"""One-dimensional fields by finite volumes: heat in a bar, transport and reaction in a channel, waves on a line."""

from __future__ import annotations

from acausal.library.fields.boundaries import ConcentrationExchange as ConcentrationExchange
from acausal.library.fields.boundaries import FixedConcentration as FixedConcentration
from acausal.library.fields.boundaries import FixedMolarFlow as FixedMolarFlow
from acausal.library.fields.heat_bar import HeatBar as HeatBar
from acausal.library.fields.interfaces import ConcentrationPort as ConcentrationPort
from acausal.library.fields.transmission_line import TransmissionLine as TransmissionLine
from acausal.library.fields.transport import Channel as Channel
from acausal.library.fields.transport import LogisticChannel as LogisticChannel
from acausal.library.fields.transport import PartialChannel as PartialChannel
