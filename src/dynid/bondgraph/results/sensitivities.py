"""Sensitivities of zeros, poles and gains to every parameter."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from dynid.bondgraph.characteristic_polynomial import characteristic_polynomials
from dynid.bondgraph.engine_choice import modelled_storages
from dynid.bondgraph.exact_engine import TransferFunction
from dynid.bondgraph.plan import ReducedGraph
from dynid.bondgraph.request import Analysis, SensitivityParameter
from dynid.bondgraph.sensitivity import sensitivity
from dynid.errors import UsageError
from dynid.lti.certified_roots import certified_roots, repeated
from dynid.result import Result

#: Most storages with which they are taken unasked: the work grows with the cube.
_STORAGES = 100

_NOTE = (
    "inf: roots meet there, and part with a root of the parameter; of a multiple root it is the mean "
    "that moves as said"
)


def add_sensitivities(result: Result, reduced: ReducedGraph, analysis: Analysis) -> None:
    """Add the derivatives of every channel's zeros, poles and gains by the parameters.

    Beside each derivative stands the one by the parameter's logarithm (`…_relative`): what moves per
    relative change, so that parameters of different units can be compared.

    Raises
    ------
    UsageError
        Where the graph is so large that they would take very long, and nobody insists on it.
    """
    size = modelled_storages(reduced)
    if size > _STORAGES and analysis.engine != "exact":
        raise UsageError(
            f"sensitivities of a graph of {size:,} storages take very long: they are taken up to {_STORAGES}",
            remedy="Drop 'sensitivities' from the results, or insist with 'engine: exact'.",
            names=("analysis.results",),
        )
    channels = reduced.channels()
    ratios = reduced.rational(channels.values())
    modes = {port: repeated(certified_roots(p)) for port, p in characteristic_polynomials(reduced).items()}
    parameters = _parameters(reduced, analysis.parameters)
    for (port, source), register in channels.items():
        transfer = TransferFunction.of(ratios[register])
        roots = transfer.zeros, transfer.poles
        found = sensitivity(reduced, register, *roots, modes[port], parameters)
        group = f"bond_graph/sensitivities/{port}/{source}"
        result.annotate(group, note=_NOTE)
        result.add_axis(f"{group}/parameter", np.array([p.name for p in parameters], dtype=object))
        sizes = np.array([float(p.value) for p in parameters])
        result.add(f"{group}/value", sizes, ("parameter",))
        for name, own, rates in zip(("zero", "pole"), roots, (found.zeros, found.poles), strict=True):
            values = repeated(own)
            result.add_axis(f"{group}/{name}", np.arange(1, len(values) + 1))
            result.add(f"{group}/{name}s", values, (name,), "rad/s")
            _add_rates(result, f"{group}/{name}_sensitivity", rates, sizes, (name, "parameter"), "rad/s")
        for gain, slopes in (("dc_gain", found.dc_gain), ("high_frequency_gain", found.high_frequency_gain)):
            _add_rates(result, f"{group}/{gain}_sensitivity", slopes, sizes, ("parameter",))


def _add_rates(
    result: Result, path: str, rates: Any, sizes: Any, dims: tuple[str, ...], units: str = ""
) -> None:
    per_unit = f"{units or '1'}/(unit of the parameter)"
    result.add(path, rates, dims, per_unit)
    finite = np.isfinite(rates)
    relative = np.where(finite, np.where(finite, rates, 0) * sizes, np.inf)
    result.add(f"{path}_relative", relative, dims, units)


def _parameters(
    reduced: ReducedGraph, given: Sequence[SensitivityParameter] | None
) -> list[SensitivityParameter]:
    """Return the parameters that the reduced part depends on; by default the values of its nodes."""
    modelled = {name for reduction in reduced.reductions.values() for name in reduction.modelled}
    if given is not None:
        return [parameter for parameter in given if modelled & parameter.rates.keys()]
    return [
        SensitivityParameter(name, reduced.graph.value(name), {name: Fraction(1)})
        for name in reduced.valued
        if name in modelled
    ]
