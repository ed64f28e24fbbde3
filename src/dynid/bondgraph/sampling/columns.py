"""What samples are asked for most, made for all of them at once; the rest as for any sample."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.question import Analysis
from dynid.bondgraph.reduced import Channel
from dynid.bondgraph.results.channels import add_channel, natural_frequencies
from dynid.bondgraph.sampling.engine import SampledEngine
from dynid.result import Selection, Variable

Column = Sequence[Variable]
"""One array of a result for every sample."""


def columns(engine: SampledEngine, analysis: Analysis, wanted: Collection[str]) -> dict[str, Column]:
    """Return what is wanted of the channels of all samples, by path.

    Parameters
    ----------
    engine
        The samples; of those that are not certain nothing is meant.
    analysis
        What is asked.
    wanted
        The arrays to make.
    """
    found: dict[str, Column] = {}
    for name in engine.channels:
        found |= {path: column for path, column in _quick(engine, name, wanted).items() if path in wanted}
    rest = frozenset(path for path in wanted if path not in found)
    return found | _others(engine, analysis, rest)


def _quick(engine: SampledEngine, of: Channel, wanted: Collection[str]) -> dict[str, Column]:
    """Return the zeros and poles of a channel, its gains, degrees and verdicts."""
    found: dict[str, Column] = {}
    channel, name = engine.channels[of], f"{of[0]}/{of[1]}"
    group, count = f"bond_graph/transfer_function/{name}", engine.count
    for kind, spectrum in (("zero", channel.zeros), ("pole", channel.poles)):
        found[f"{group}/{kind}"] = [_axis(kind, spectrum.values.shape[1])] * count
        found[f"{group}/{kind}s"] = [Variable((f"{kind}",), row, "rad/s") for row in spectrum.values]
    group, units = f"bond_graph/properties/{name}", engine.family.reduced.units.of_channel(*of)
    for side, gain in (("dc", channel.dc_gain), ("high_frequency", channel.high_frequency_gain)):
        if f"{group}/{side}_gain" in wanted:
            found[f"{group}/{side}_gain"] = [_scalar(value, units) for value in gain()]
    degrees = {"relative_degree": channel.relative_degree, "order": channel.poles.values.shape[1]}
    found |= {f"{group}/{what}": [_scalar(degree)] * count for what, degree in degrees.items()}
    verdicts = {"stable": channel.poles, "minimum_phase": channel.zeros}
    told = {truth: _scalar(truth) for truth in (False, True)}
    for what, spectrum in verdicts.items():
        left = np.all(spectrum.sides < 0, axis=1)
        found[f"{group}/{what}"] = [told[bool(truth)] for truth in left]
    if not channel.hidden.values.shape[1]:
        found[f"{group}/hidden_mode"] = [_axis("hidden_mode", 0)] * count
        found[f"{group}/hidden_modes"] = [
            Variable(("hidden_mode",), np.empty(0, dtype=complex), "rad/s")
        ] * count
    if f"{group}/natural_frequency" in wanted or f"{group}/damping_ratio" in wanted:
        found |= _natural(group, channel.poles.values)
    return found


def _natural(group: str, poles: NDArray[np.complex128]) -> dict[str, Column]:
    """Return natural frequencies and damping ratios."""
    each = [natural_frequencies(row) for row in poles]
    axes = {length: _axis("mode", length) for length in {len(size) for size, _ in each}}
    return {
        f"{group}/mode": [axes[len(size)] for size, _ in each],
        f"{group}/natural_frequency": [Variable(("mode",), size, "rad/s") for size, _ in each],
        f"{group}/damping_ratio": [Variable(("mode",), ratio) for _, ratio in each],
    }


def _axis(name: str, length: int) -> Variable:
    return Variable((name,), np.arange(1, length + 1))


def _scalar(value: Any, units: str = "") -> Variable:
    return Variable((), np.asarray(value), units)


def _others(engine: SampledEngine, analysis: Analysis, wanted: Collection[str]) -> dict[str, Column]:
    """Return what is told of each sample by itself."""
    if not wanted:
        return {}
    results = []
    for number in range(engine.count):
        result = Selection("bond-graph", wanted)
        if engine.certain[number]:
            for channel in engine.channels:
                add_channel(result, engine[number], channel, analysis.results)
        results.append(result)
    nothing = Variable((), np.asarray(np.nan))
    kept = {path for result in results for path in result}
    return {path: [result.get(path, nothing) for result in results] for path in wanted if path in kept}
