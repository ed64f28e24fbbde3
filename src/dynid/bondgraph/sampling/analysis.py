"""The analysis of many samples of a graph, computed together as far as possible.

Zeros, poles and what follows from them are computed for all samples at once; responses sample by sample, on
the plan that they share. Every number is that of `dynid.bondgraph.analysis` for the sample alone.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.analysis_request import Analysis, choose_engine
from dynid.bondgraph.exact_engine import TransferFunction
from dynid.bondgraph.graph import BondGraph, no_collection
from dynid.bondgraph.reduced_graph import Channel, ReducedGraph, SampleValues
from dynid.bondgraph.results.channels import add_channel, add_channels, natural_frequencies, time_constants
from dynid.bondgraph.results.characteristics import CHARACTERISTICS
from dynid.bondgraph.results.response_results import add_frequency_response, add_time_response
from dynid.bondgraph.sampling.channel_polynomials import (
    ChannelPolynomials,
    Integers,
    PowerTables,
    SquarefreeFactor,
    channel_polynomials,
    nonzero,
)
from dynid.errors import DynidError
from dynid.lti.certified_roots import CertifiedRoot
from dynid.lti.root_batches import RootBatch, disjoint, root_batch
from dynid.result import Selection, Variable


@dataclass(frozen=True, eq=False)
class _SampledRoots:
    """Roots of one polynomial of every sample."""

    #: The roots, each as often as its multiplicity says, smallest modulus first (sample x root).
    values: NDArray[np.complex128]
    #: radii, sides: Bounds on their errors, and their sides of the axis, likewise.
    radii: NDArray[np.float64]
    sides: NDArray[np.int8]
    multiplicities: NDArray[np.int64]  # their multiplicities, likewise

    @classmethod
    def of(cls, factors: Sequence[tuple[RootBatch, int]], count: int) -> _SampledRoots:
        """Join the roots of the factors of polynomials, each with its multiplicity."""

        def joined(what: str, kind: type) -> NDArray[Any]:
            parts = [np.repeat(getattr(batch, what), power, axis=1) for batch, power in factors]
            return np.concatenate([np.empty((count, 0), dtype=kind), *parts], axis=1)

        values, radii, sides = joined("values", complex), joined("radii", float), joined("sides", np.int8)
        parts = [np.full((count, batch.values.shape[1] * power), power) for batch, power in factors]
        powers = np.concatenate([np.empty((count, 0), dtype=int), *parts], axis=1)
        order = np.lexsort((values.imag, values.real, np.hypot(values.real, values.imag)))
        return cls(*(np.take_along_axis(array, order, axis=1) for array in (values, radii, sides, powers)))

    def roots(self, sample: int) -> tuple[CertifiedRoot, ...]:
        """Return the roots of one sample, each once."""
        arrays = (self.values, self.radii, self.sides, self.multiplicities)
        rows = (array[sample].tolist() for array in arrays)
        distinct = dict.fromkeys(zip(*rows, strict=True))
        return tuple(CertifiedRoot(value, power, radius, side) for value, radius, side, power in distinct)


@dataclass(frozen=True, eq=False)
class _SampledChannel:
    """A channel of all samples: coefficients, ascending, for each one integer a sample, and roots."""

    numerator: list[Integers]
    denominator: list[Integers]
    zeros: _SampledRoots
    poles: _SampledRoots
    hidden: _SampledRoots

    @property
    def relative_degree(self) -> int:
        """Poles minus zeros."""
        return len(self.denominator) - len(self.numerator)

    def dc_gain(self) -> list[float]:
        """Return the limit of T(s) as s falls to 0, of every sample."""
        above, below = map(_lowest, (self.numerator, self.denominator))
        return _limits(self.numerator[above], self.denominator[below], above - below)

    def high_frequency_gain(self) -> list[float]:
        """Return the limit of T(s) as s grows, of every sample."""
        return _limits(self.numerator[-1], self.denominator[-1], self.relative_degree)


class _SampledEngine:
    """The channels of samples of a graph.

    Numerator and denominator are evaluated exactly and the roots certified together. A sample for which
    something of that fails (a leading coefficient that vanishes, roots that meet or cancel, one that is on
    the axis by chance) is not `certain`: it is to be run alone.

    `certain`: samples that the engine answers for.
    """

    def __init__(
        self,
        reduced: ReducedGraph,
        channels: dict[Channel, ChannelPolynomials],
        values: SampleValues,
        count: int,
    ) -> None:
        self.reduced, self.count = reduced, count
        self.certain = np.ones(count, dtype=bool)
        parts = [
            polynomial
            for polynomials in channels.values()
            for polynomial in (
                polynomials.numerator,
                polynomials.denominator,
                *(factor.polynomial for factor in polynomials.factors),
            )
        ]
        self._tables = PowerTables(list(values.values()), parts, count)
        self.channels: dict[Channel, _SampledChannel] = {}
        for channel, polynomials in channels.items():
            above, below = map(self._tables.coefficients, (polynomials.numerator, polynomials.denominator))
            for columns in (above, below):
                self.certain &= nonzero(columns[_lowest(columns) :])
            zeros, poles, hidden = (
                self._roots(polynomial)
                for polynomial in (polynomials.zeros, polynomials.poles, polynomials.hidden)
            )
            self.certain &= _apart([*zeros, *poles], count) & _apart(hidden, count)
            roots = (_SampledRoots.of(polynomial, count) for polynomial in (zeros, poles, hidden))
            self.channels[channel] = _SampledChannel(above, below, *roots)

    def __getitem__(self, sample: int) -> _EngineSample:
        return _EngineSample(self, sample)

    def _roots(self, factors: Sequence[SquarefreeFactor]) -> list[tuple[RootBatch, int]]:
        spectrum = []
        for factor in factors:
            if factor.is_laplace:
                zero, sure = np.zeros((self.count, 1)), np.ones(self.count, dtype=bool)
                origin = RootBatch(zero.astype(complex), zero, zero.astype(np.int8), sure)
                spectrum.append((origin, factor.multiplicity))
                continue
            columns = self._tables.coefficients(factor.polynomial)
            sound = nonzero(columns)
            self.certain &= sound
            if factor.degree:
                even = factor.even
                steady = [np.where(sound, column, 1) for column in (columns[::2] if even else columns)]
                batch = root_batch([column.tolist() for column in steady], even=even)
                self.certain &= batch.certain
                spectrum.append((batch, factor.multiplicity))
        return spectrum


class _EngineSample(NamedTuple):
    """One sample of an engine, which answers for its channels as any engine does."""

    engine: _SampledEngine
    number: int

    @property
    def reduced(self) -> ReducedGraph:
        """The plan that the sample shares with the others."""
        return self.engine.reduced

    def channel(self, channel: Channel) -> TransferFunction:
        """Return one channel, with its roots."""
        from flint import fmpz_poly

        solved, sample = self.engine.channels[channel], self.number
        numerator, denominator = (
            fmpz_poly([column[sample] for column in columns])
            for columns in (solved.numerator, solved.denominator)
        )
        transfer = TransferFunction(numerator, denominator)
        vars(transfer).update(zeros=solved.zeros.roots(sample), poles=solved.poles.roots(sample))
        return transfer

    def hidden_modes(self, channel: Channel) -> tuple[CertifiedRoot, ...]:
        """Return the natural modes that cancel in a channel."""
        return self.engine.channels[channel].hidden.roots(self.number)


def _apart(spectrum: Sequence[tuple[RootBatch, int]], count: int) -> NDArray[np.bool_]:
    """Return for which samples no root of one factor may be one of another."""
    if len(spectrum) < 2:
        return np.ones(count, dtype=bool)
    values = np.concatenate([batch.values for batch, _ in spectrum], axis=1)
    return disjoint(values, np.concatenate([batch.radii for batch, _ in spectrum], axis=1))


def _lowest(columns: Sequence[Integers]) -> int:
    """Return the lowest power whose coefficient is not always 0."""
    return next((power for power, column in enumerate(columns) if column.any()), 0)


def _limits(above: Integers, below: Integers, power: int) -> list[float]:
    """Return the limits of above/below times the variable to a power, as it falls to 0."""
    if power > 0:
        return [0.0] * len(above)
    limits = []
    for a, b in zip(above.tolist(), below.tolist(), strict=True):
        infinite = math.inf if (a > 0) == (b > 0) else -math.inf
        try:
            limits.append(a / b if power == 0 else infinite)
        except OverflowError:
            limits.append(infinite)
        except ZeroDivisionError:  # of a sample that is not certain
            limits.append(math.nan)
    return limits


# --- arrays of all samples ------------------------------------------------------------------------

ResultColumn = Sequence[Variable]
"""One array of a result for every sample."""


def columns(engine: _SampledEngine, analysis: Analysis, paths: Collection[str]) -> dict[str, ResultColumn]:
    """Return the wanted arrays of the channels of all samples, by path."""
    by_path: dict[str, ResultColumn] = {}
    for name in engine.channels:
        by_path |= {path: column for path, column in _quick(engine, name, paths).items() if path in paths}
    rest = frozenset(path for path in paths if path not in by_path)
    if not rest:
        return by_path
    results = []  # of each sample by itself
    for number in range(engine.count):
        result = Selection("bond-graph", rest)
        if engine.certain[number]:
            for channel in engine.channels:
                add_channel(result, engine[number], channel, analysis.results)
        results.append(result)
    nothing = Variable((), np.asarray(np.nan))
    kept = [path for path in rest if any(path in result for result in results)]
    return by_path | {path: [result.get(path, nothing) for result in results] for path in kept}


def _quick(engine: _SampledEngine, of: Channel, paths: Collection[str]) -> dict[str, ResultColumn]:
    """Return the zeros and poles of a channel, its gains, degrees and verdicts."""
    by_path: dict[str, ResultColumn] = {}
    channel, name = engine.channels[of], f"{of[0]}/{of[1]}"
    group, count = f"bond_graph/transfer_function/{name}", engine.count
    for kind, spectrum in (("zero", channel.zeros), ("pole", channel.poles)):
        by_path[f"{group}/{kind}"] = [_axis(kind, spectrum.values.shape[1])] * count
        by_path[f"{group}/{kind}s"] = [Variable((f"{kind}",), row, "rad/s") for row in spectrum.values]
    group, units = f"bond_graph/properties/{name}", engine.reduced.units.of_channel(*of)
    for side, gain in (("dc", channel.dc_gain), ("high_frequency", channel.high_frequency_gain)):
        if f"{group}/{side}_gain" in paths:
            by_path[f"{group}/{side}_gain"] = [_scalar(value, units) for value in gain()]
    degrees = {"relative_degree": channel.relative_degree, "order": channel.poles.values.shape[1]}
    by_path |= {f"{group}/{what}": [_scalar(degree)] * count for what, degree in degrees.items()}
    verdicts = {"stable": channel.poles, "minimum_phase": channel.zeros}
    booleans = {truth: _scalar(truth) for truth in (False, True)}
    for what, spectrum in verdicts.items():
        left = np.all(spectrum.sides < 0, axis=1)
        by_path[f"{group}/{what}"] = [booleans[bool(truth)] for truth in left]
    if not channel.hidden.values.shape[1]:
        by_path[f"{group}/hidden_mode"] = [_axis("hidden_mode", 0)] * count
        nothing = Variable(("hidden_mode",), np.empty(0, dtype=complex), "rad/s")
        by_path[f"{group}/hidden_modes"] = [nothing] * count
    if any(f"{group}/{name}" in paths for name in ("natural_frequency", "damping_ratio", "time_constant")):
        modes = [natural_frequencies(row) for row in channel.poles.values]
        decays = [time_constants(row) for row in channel.poles.values]
        axes = {length: _axis("mode", length) for length in {len(size) for size, _ in modes}}
        by_path |= {
            f"{group}/mode": [axes[len(size)] for size, _ in modes],
            f"{group}/natural_frequency": [Variable(("mode",), size, "rad/s") for size, _ in modes],
            f"{group}/damping_ratio": [Variable(("mode",), ratio) for _, ratio in modes],
            f"{group}/time_constant": [Variable(("mode",), decay, "s") for decay in decays],
        }
    return by_path


def _axis(name: str, length: int) -> Variable:
    return Variable((name,), np.arange(1, length + 1))


def _scalar(value: Any, units: str = "") -> Variable:
    return Variable((), np.asarray(value), units)


# --- analysis -------------------------------------------------------------------------------------

#: Groups of results that samples are computed for together.
_CHANNELS = ("bond_graph/transfer_function/", "bond_graph/properties/")
_FREQUENCY, _TIME = "bond_graph/frequency_response/", "bond_graph/time_response/"
#: Of channels the names that the exact engine alone has the numbers for, one sample at a time.
_ALONE = frozenset(
    {"zero_error_bound", "pole_error_bound", "hidden_mode_cause", "hidden_mode_elements", "exact"}
)


def shared(paths: Collection[str], analysis: Analysis) -> bool:
    """Test whether samples of an analysis share enough work on these paths to be run together."""
    groups = (*_CHANNELS, _FREQUENCY, _TIME)
    if any(loop.delayed for loop in analysis.loops):  # its reduction has approximants of them
        return False
    if analysis.port is not None or not all(path.startswith(groups) for path in paths):
        return False
    return not any(path.rpartition("/")[2] in CHARACTERISTICS for path in paths)


class SampledAnalysis:
    """An analysis of many samples.

    `wanted`: the arrays to compute, by path; all of them `shared`. Raises `Singular` where the equations have
    no unique solution whatever the values.
    """

    def __init__(
        self, graph: BondGraph, analysis: Analysis, varying: Collection[str], paths: Collection[str]
    ) -> None:
        self.analysis, self.wanted = analysis, frozenset(paths)
        self._varying = tuple(varying)
        stand_ins = {name: Fraction(1009 + 20 * k, 7) for k, name in enumerate(varying)}
        graph = graph.with_values(stand_ins)  # what varies in it counts for nothing
        reduced = self._reduced = ReducedGraph(graph, analysis.inputs, analysis.outputs, traced=False)
        # elements that no output depends on, but whose values decide whether sources agree
        structure, deciding = reduced.structure, set[str]()
        for name in reduced.unsolved():
            deciding.update(structure.junctions[name].elements)
            deciding.update(coupling.two_port for coupling in structure.tied[name] if coupling.two_port)
        self._apart = bool(reduced.undetermined) or not deciding.isdisjoint(varying)
        self._responds = self._asks(_FREQUENCY, _TIME)
        #: The channels as polynomials; None where each sample is to be solved by itself.
        self._polynomials: dict[Channel, ChannelPolynomials] | None = None
        ends = {path.rpartition("/")[2] for path in self.wanted}
        if (
            self._asks(*_CHANNELS)
            and not ends & _ALONE
            and choose_engine(reduced, analysis).engine == "exact"
        ):
            polynomials = channel_polynomials(reduced, self._varying)
            explained = "hidden_modes" in analysis.results and "hidden_modes" in ends
            if not explained or not any(polynomial.hidden for polynomial in (polynomials or {}).values()):
                self._polynomials = polynomials  # explained hidden modes stand in the order of their causes

    def run(
        self,
        values: SampleValues,
        count: int,
        initial: Sequence[Mapping[str, float | Fraction]] | None = None,
    ) -> list[Mapping[str, Variable] | None]:
        """Return the wanted arrays of every sample; None for one that is to be run alone.

        `initial`: stored energy of every sample at t = 0; default: as the analysis says.
        """
        with no_collection():
            kept = [] if self._apart else np.flatnonzero(self._reduced.holds(values, count)).tolist()
            engine: _SampledEngine | None = None
            channel_columns: dict[str, ResultColumn] = {}
            if self._polynomials is not None and kept:
                of_kept = {name: [values[name][k] for k in kept] for name in self._varying}
                engine = _SampledEngine(self._reduced, self._polynomials, of_kept, len(kept))
                channel_paths = {path for path in self.wanted if path.startswith(_CHANNELS)}
                channel_columns = columns(engine, self.analysis, channel_paths)
            results: list[Mapping[str, Variable] | None] = [None] * count
            for position, sample in enumerate(kept):
                certain = engine is not None and bool(engine.certain[position])
                sampled = (
                    {path: column[position] for path, column in channel_columns.items()} if certain else {}
                )
                if self._responds or not certain:
                    sample_values = {name: column[sample] for name, column in values.items()}
                    stored = self.analysis.initial if initial is None else initial[sample]
                    alone = self._alone(sample_values, stored, channels=not certain)
                    if alone is None:
                        continue
                    sampled |= alone
                results[sample] = sampled
            return results

    def _alone(
        self, values: Mapping[str, Fraction], initial: Mapping[str, float | Fraction], *, channels: bool
    ) -> dict[str, Variable] | None:
        """Return the arrays of one sample by itself; None where it fails: run alone it reports why."""
        analysis, result = self.analysis, Selection("bond-graph", self.wanted)
        reduced = self._reduced.with_values(values)
        try:
            if channels and self._asks(*_CHANNELS):
                add_channels(result, reduced, analysis)
            if self._asks(_FREQUENCY) and analysis.omega is not None:
                add_frequency_response(result, reduced, analysis.omega)
            if self._asks(_TIME) and analysis.times is not None:
                add_time_response(
                    *(result, reduced, analysis.times, analysis.signals, initial),
                    apart=analysis.apart,
                    storages=len(reduced.storages),
                )
        except DynidError:
            return None
        return {path: variable for path, variable in result.items() if path in self.wanted}

    def _asks(self, *groups: str) -> bool:
        return any(path.startswith(groups) for path in self.wanted)
