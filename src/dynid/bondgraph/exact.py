"""The exact engine: every channel in lowest terms over the rationals."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from dynid.bondgraph.graph import Port
from dynid.bondgraph.natural import characteristic_polynomials, hidden_polynomial
from dynid.bondgraph.reduced import Channel, ReducedGraph
from dynid.bondgraph.transfer import TransferFunction
from dynid.lti.certified import Root, certified_roots


class ExactEngine:
    """The channels of a graph, exactly.

    Parameters
    ----------
    reduced
        The graph.
    """

    def __init__(self, reduced: ReducedGraph) -> None:
        self.reduced = reduced
        channels = reduced.channels()
        ratios = reduced.rational(channels.values())
        self._transfers = {
            channel: TransferFunction.of(ratios[register]) for channel, register in channels.items()
        }

    def channel(self, channel: Channel) -> TransferFunction:
        """Return one channel."""
        return self._transfers[channel]

    def hidden_modes(self, channel: Channel) -> tuple[Root, ...]:
        """Return the natural modes that cancel in a channel: uncontrollable, unobservable, or both."""
        return certified_roots(self.hidden_polynomial(channel))

    def hidden_polynomial(self, channel: Channel) -> Any:
        """Return the polynomial that these are the roots of."""
        port = channel[0]
        return hidden_polynomial(self.reduced, port, self._transfers[channel], self._natural[port])

    @cached_property
    def _natural(self) -> dict[Port, Any]:
        return characteristic_polynomials(self.reduced)
