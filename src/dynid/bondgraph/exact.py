"""The exact engine: every channel in lowest terms over the rationals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

from dynid.bondgraph.graph import Port
from dynid.bondgraph.natural import characteristic_polynomials, hidden_polynomial
from dynid.bondgraph.reduced import Channel, ReducedGraph
from dynid.bondgraph.transfer import TransferFunction
from dynid.choices import STARTED_ROOTS
from dynid.errors import NumericalError
from dynid.lti.certified import Root, certified_roots

#: Degree from which eigenvalues are worth their time as first values of roots.
_LARGE = STARTED_ROOTS.value


class ExactEngine:
    """The channels of a graph, exactly.

    Roots of large polynomials are certified from the eigenvalues of the graph's own equations: these save
    time, and what is certified does not depend on them.

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
            channel: replace(TransferFunction.of(ratios[register]), starts=partial(self._starts, channel))
            for channel, register in channels.items()
        }
        self._modes: dict[frozenset[str], list[complex] | None] = {}

    def channel(self, channel: Channel) -> TransferFunction:
        """Return one channel."""
        return self._transfers[channel]

    def hidden_modes(self, channel: Channel) -> tuple[Root, ...]:
        """Return the natural modes that cancel in a channel: uncontrollable, unobservable, or both."""
        polynomial = self.hidden_polynomial(channel)
        return certified_roots(
            polynomial, self._natural_starts(channel[0]) if polynomial.degree() > _LARGE else None
        )

    def hidden_polynomial(self, channel: Channel) -> Any:
        """Return the polynomial that these are the roots of."""
        port = channel[0]
        return hidden_polynomial(self.reduced, port, self._transfers[channel], self._natural[port])

    @cached_property
    def _natural(self) -> dict[Port, Any]:
        return characteristic_polynomials(self.reduced)

    def _starts(self, channel: Channel, what: str) -> Sequence[complex] | None:
        """Return first values of the zeros or poles of a channel, where they are many."""
        transfer = self._transfers[channel]
        if what == "poles":
            return self._natural_starts(channel[0]) if transfer.denominator.degree() > _LARGE else None
        if transfer.numerator.degree() <= _LARGE:
            return None
        from dynid.bondgraph.floating.systems import zero_equations

        return _first_values(zero_equations(self.reduced, channel))

    def _natural_starts(self, port: Port) -> Sequence[complex] | None:
        junctions = frozenset(self.reduced.reductions[port].junctions)
        if junctions not in self._modes:
            from dynid.bondgraph.floating.systems import natural_equations

            self._modes[junctions] = _first_values(natural_equations(self.reduced, port))
        return self._modes[junctions]


def _first_values(equations: Any) -> list[complex] | None:
    from dynid.bondgraph.floating.spectrum import first_values

    try:
        return first_values(equations)
    except NumericalError:  # they would only have saved time
        return None
