"""Exact results channel by channel: transfer functions, zeros and poles, properties, hidden modes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dynid.bondgraph.graph import Port
from dynid.bondgraph.natural import characteristic_polynomials
from dynid.bondgraph.reduced import Channel, ReducedGraph
from dynid.bondgraph.reduction.reducer import Reduction
from dynid.bondgraph.transfer import TransferFunction
from dynid.lti.certified import Root, certified_roots, repeated
from dynid.result import Result


def add_channels(result: Result, reduced: ReducedGraph, asked: frozenset[str]) -> None:
    """Add what is asked for of every channel."""
    from dynid.bondgraph.formula import formulas

    channels = reduced.channels()
    ratios = reduced.rational(channels.values())
    transfers = {channel: TransferFunction.of(ratios[register]) for channel, register in channels.items()}
    readable = formulas(reduced) if "transfer_function" in asked else {}
    natural = characteristic_polynomials(reduced) if asked & {"properties", "hidden_modes"} else {}
    for channel, transfer in transfers.items():
        _add_transfer_function(result, channel, transfer, asked, readable.get(channel))
        if "properties" in asked:
            _add_properties(result, channel, transfer, reduced.reductions[channel[0]])
        if natural:
            explained = "hidden_modes" in asked
            _add_hidden_modes(result, reduced, channel, transfer, natural[channel[0]], explained=explained)


def _add_transfer_function(
    result: Result, channel: Channel, transfer: TransferFunction, asked: frozenset[str], formula: str | None
) -> None:
    group = f"bond_graph/transfer_function/{channel[0]}/{channel[1]}"
    result.annotate(group, engine="exact", reading="decimal")
    if "transfer_function" in asked:
        if formula is not None:
            result.annotate(group, symbolic=formula)
        for name, coefficients in zip(("numerator", "denominator"), transfer.coefficients(), strict=True):
            axis = f"{name}_power"
            result.add_axis(f"{group}/{axis}", np.arange(len(coefficients))[::-1])
            result.add(f"{group}/{name}", coefficients, (axis,))
    if "zeros" in asked:
        _add_roots(result, group, "zeros", transfer.zeros)
    if "poles" in asked:
        _add_roots(result, group, "poles", transfer.poles)


def _add_roots(result: Result, group: str, name: str, roots: Sequence[Root]) -> None:
    """Add roots with their certified error bounds, each as often as its multiplicity says."""
    axis = name[:-1]
    values = repeated(roots)
    radii = [root.radius for root in roots for _ in range(root.multiplicity)]
    result.add_axis(f"{group}/{axis}", np.arange(1, len(values) + 1))
    result.add(f"{group}/{name}", values, (axis,), "rad/s")
    result.add(f"{group}/{axis}_error_bound", np.array(radii, dtype=float), (axis,), "rad/s")


def _add_properties(
    result: Result, channel: Channel, transfer: TransferFunction, reduction: Reduction
) -> None:
    group = f"bond_graph/properties/{channel[0]}/{channel[1]}"
    result.add(f"{group}/relative_degree", transfer.relative_degree)
    result.add(f"{group}/dc_gain", transfer.dc_gain)
    result.add(f"{group}/high_frequency_gain", transfer.high_frequency_gain)
    result.add(f"{group}/stable", transfer.stable)
    result.add(f"{group}/stability", transfer.stability)
    result.add(f"{group}/minimum_phase", transfer.minimum_phase)
    result.add(f"{group}/order", transfer.order)
    result.add(f"{group}/prototype", reduction.prototype.letter)
    result.add(f"{group}/zero_stability", transfer.zero_stability)


def _shown(reduced: ReducedGraph, port: Port, transfer: TransferFunction) -> Any:
    """Return the polynomial of the natural modes that a channel shows.

    The integrator of a displacement or momentum output is no mode of the graph (a storage's own is).
    """
    from flint import fmpz_poly

    integrates = port.quantity in "qp" and not reduced.graph.is_state(port)
    if not integrates or transfer.denominator[0] != 0:
        return transfer.denominator
    return transfer.denominator // fmpz_poly([0, 1])


def _add_hidden_modes(
    result: Result,
    reduced: ReducedGraph,
    channel: Channel,
    transfer: TransferFunction,
    natural: Any,
    *,
    explained: bool,
) -> None:
    """Add the natural modes that cancel in the channel, and why where that is asked for."""
    group = f"bond_graph/properties/{channel[0]}/{channel[1]}"
    polynomial = natural // natural.gcd(_shown(reduced, channel[0], transfer))
    if not explained:
        _add_modes(result, group, repeated(certified_roots(polynomial)))
        return
    from dynid.bondgraph.hidden import hidden_modes

    modes = [
        mode for mode in hidden_modes(reduced, channel, polynomial) for _ in range(mode.root.multiplicity)
    ]
    _add_modes(result, group, np.array([mode.root.value for mode in modes], dtype=complex))
    result.add(f"{group}/hidden_mode_cause", [mode.cause for mode in modes], ("hidden_mode",))
    result.add(f"{group}/hidden_mode_elements", [mode.elements for mode in modes], ("hidden_mode",))


def _add_modes(result: Result, group: str, values: Any) -> None:
    result.add_axis(f"{group}/hidden_mode", np.arange(1, len(values) + 1))
    result.add(f"{group}/hidden_modes", values, ("hidden_mode",), "rad/s")
