"""A channel that is fed at one end: components of `acausal.library.fields`."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, connect
from acausal.library.fields import Channel, ConcentrationExchange, FixedMolarFlow


class FedChannel(Component):
    """A tracer enters a channel at a constant rate, spreads with the flow, and leaves at the end."""

    feed: FixedMolarFlow = FixedMolarFlow(n_flow=1e-6)
    channel: Channel = Channel(n=40, length=1.0, A=1e-4, D=1e-4, v=1e-2)
    exchange: ConcentrationExchange = ConcentrationExchange(k=1e-6)

    experiment: ClassVar[Experiment] = Experiment(stop_time=400.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("channel.c[0]", "channel.c[20]", "channel.c[39]"), title="Begin, middle and end"),
    )

    def equations(self) -> Equations:
        yield connect(self.feed.port, self.channel.port_a)
        yield connect(self.channel.port_b, self.exchange.port)
