"""The square systems of equations whose determinants have a channel's natural modes and zeros as roots."""

from __future__ import annotations

from dynid.bondgraph.equations.descriptor import Descriptor
from dynid.bondgraph.equations.forms import Field, Form
from dynid.bondgraph.graph import Port
from dynid.bondgraph.reduced import Channel, ReducedGraph
from dynid.errors import NumericalError

#: Most storages whose eigenvalues are sought: the matrix is dense.
_LARGEST = 8000


def natural_equations(reduced: ReducedGraph, port: Port) -> list[Form]:
    """Return the equations of the part behind an output without inputs: their roots are its natural modes."""
    return _descriptor(reduced, port).equations


def zero_equations(reduced: ReducedGraph, channel: Channel) -> list[Form]:
    """Return the equations with the input unknown and the output held at zero: zeros, and hidden modes."""
    port, source = channel
    system = _descriptor(reduced, port, freed=source)
    output = system.output(port)
    return [*system.equations, output]


def _descriptor(reduced: ReducedGraph, port: Port, freed: str | None = None) -> Descriptor:
    if len(reduced.storages) > _LARGEST:
        raise NumericalError(
            f"zeros and poles of {len(reduced.storages):,} storages are beyond dense eigenvalues "
            f"(at most {_LARGEST:,})",
            remedy="Ask for the frequency response, which needs no roots, or for a smaller part.",
        )
    junctions = reduced.reductions[port].junctions
    return Descriptor(reduced.structure, junctions, Field.rational(reduced.graph), freed=freed)
