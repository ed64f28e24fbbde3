"""Frequency responses from records of time: impacts without a window, one or several random forces by H1.

Impacts: spectra of whole decays, their scatter from hit to hit as noise. An exponential window
``exp(-t / tau)`` on force and response shifts all poles by -1/tau, which is corrected exactly. Random forces:
H1 with Hann segments, half overlapping, of several forces at once by the inverse of their spectral matrix.
Leakage biases damping ratios by about 40/r^2 %, r = 2 zeta f / df, whatever chi-squared says: so much counts
as a standard error, below r = 4 none is given.
Sources: P. D. Welch, *IEEE Trans. Audio Electroacoust.* 15 (1967) 70–73; J. S. Bendat, A. G. Piersol,
*Random Data*, 4th ed. 2010, eq 9.57 and chapter 7 (several inputs).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.errors import UsageError
from dynid.modal.frf_matrix import smoothed_variance

#: Relative bias of a damping ratio by leakage times r^2, as a standard error, and least r that has one.
LEAKAGE, MIN_RESOLUTION = 0.5, 4.0
# Part of the energy of impacts that their largest samples hold, one in twenty; those of white noise 28 %.
_IMPACT_ENERGY, _LARGEST = 0.9, 0.05
# A second hit: its part of the peak, beyond so many widths of the first; edge of a pulse, part of its peak.
_SECOND_HIT, _WIDTHS_BETWEEN, _EDGE = 0.15, 2, 0.05
# Equal samples at an extreme that are a clipped signal, and what counts as equal, relative.
_CLIPPED_SAMPLES, _EQUAL = 3, 1e-9
# Segments of random records by default, and the factor by which half overlap makes their variance larger.
_SEGMENTS, _OVERLAP_VARIANCE = 16, 1 + 2 / 36
# Condition of the spectral matrix of simultaneous forces above which they count as one; coherence between
# them above which a note says that errors of responses to them are dependent.
_MAX_CONDITION, _COHERENT_FORCES = 1e6, 0.3
# Part of the largest response that a decay may have left at its end, noise included, and a windowed one,
# whose noise decays, too; parts of a record in this test.
_NOT_DECAYED, _PARTS = (0.02, 0.003), 20


class TimeRecord(NamedTuple):
    """A record of responses (samples x channels) to forces (samples x references), at a step (s)."""

    name: str
    forces: Array
    values: Array
    channels: Sequence[str]
    references: Sequence[str]
    step: float

    @property
    def force(self) -> Array:
        """The first force (samples); of an impact the only one."""
        return np.asarray(self.forces[:, 0])


class Spectra(NamedTuple):
    """Responses by pair of channel and reference: values and variance of the complex noise (lines)."""

    omega: Array
    values: dict[tuple[str, str], ComplexArray]
    variance: dict[tuple[str, str], Array | None]  # None where a single record shows no scatter
    resolution: float  # distance of the lines of random records, Hz; 0 of impacts, which do not leak
    notes: list[str]
    cut_off: tuple[str, ...] = ()  # records that end before their decay, which matters where a fit lacks


def is_impact(force: Array) -> bool:
    """Return True if few samples of a force hold nearly all of its energy."""
    energy = np.sort(np.asarray(force, dtype=float) ** 2)[::-1]
    return bool(energy[: max(3, int(_LARGEST * len(force)))].sum() > _IMPACT_ENERGY * energy.sum())


def defect(record: TimeRecord) -> str:
    """Return what is wrong with an impact in words, for example a double hit; empty of a good one."""
    size = np.abs(record.force)
    peak = int(np.argmax(size))
    start, end = _pulse(record.force)
    sign = np.sign(record.force[peak])
    later = sign * record.force[end + _WIDTHS_BETWEEN * (end - start) :]
    if later.max(initial=0.0) > _SECOND_HIT * size[peak]:
        at = end + _WIDTHS_BETWEEN * (end - start) + int(np.argmax(later))
        share = 100 * later.max() / size[peak]
        return f"a double hit, {1e3 * (at - peak) * record.step:.3g} ms later with {share:.2g} % of the force"
    for name, signal in zip(("force", *record.channels), (record.force, *record.values.T), strict=True):
        if _is_clipped(signal):
            return f"{'the force' if name == 'force' else f'channel {name}'} is clipped"
    return ""


def _pulse(force: Array) -> tuple[int, int]:
    """Return the first sample of the largest pulse of a force, and the one behind its last."""
    size = np.abs(force)
    peak = int(np.argmax(size))
    outside = np.flatnonzero(size <= _EDGE * size[peak])
    before, after = outside[outside < peak], outside[outside > peak]
    return int(before[-1]) + 1 if len(before) else 0, int(after[0]) if len(after) else len(force)


def _from_the_pulse(records: Sequence[TimeRecord]) -> list[TimeRecord]:
    """Return records that begin at their pulses, of one length.

    So the transform of a decay that is cut off has the exact poles, which silence before the pulse spoils.
    """
    pulses = [_pulse(record.force) for record in records]
    starts = [max(2 * start - end, 0) for start, end in pulses]  # the width of the pulse before it
    n = min(len(record.forces) - start for record, start in zip(records, starts, strict=True))
    return [
        record._replace(forces=record.forces[start : start + n], values=record.values[start : start + n])
        for record, start in zip(records, starts, strict=True)
    ]


def _is_clipped(signal: Array) -> bool:
    """Return True if consecutive samples are equal at the largest or the smallest value."""
    span = float(np.ptp(signal))
    for extreme in (signal.max(), signal.min()):
        at_end = np.abs(signal - extreme) <= _EQUAL * span
        runs = np.convolve(at_end, np.ones(_CLIPPED_SAMPLES), "valid")
        if span > 0 and runs.max(initial=0.0) >= _CLIPPED_SAMPLES and abs(extreme) > span / 4:
            return True
    return False


def spectra_of_records(
    records: Sequence[TimeRecord], *, exponential: float | None = None, segment: float | None = None
) -> Spectra:
    """Return frequency responses of records, all of them impacts or all random.

    `exponential`: time constant of a window that is applied to force and response of impacts (s); `segment`:
    length of the segments of random records (s); default: 16 of them in the shortest record.

    Raises
    ------
    UsageError
        Where records differ in step or length, in kind, or none is without a defect.
    """
    first = records[0]
    if any(record.step != first.step or len(record.forces) != len(first.forces) for record in records):
        raise UsageError(
            "the records have different steps or lengths, so that their lines differ",
            remedy="Give them one step and the same number of samples.",
            names=("measurement.records", "measurement"),
        )
    impacts = [is_impact(record.force) for record in records]
    if any(impacts) and not all(impacts):
        other = records[impacts.index(False)].name
        raise UsageError(
            f"{other} is no impact, and others are", names=("measurement.records", "measurement")
        )
    if not impacts[0]:
        return _of_random(records, exponential, segment)
    for record in records:
        if len(record.references) > 1:
            raise UsageError(
                f"{record.name} has impacts at {len(record.references)} DOFs at once",
                remedy="Record one after the other.",
                names=("excitation", "measurement.excitation", "measurement.records"),
            )
    return _of_impacts(records, exponential)


def _of_impacts(records: Sequence[TimeRecord], exponential: float | None) -> Spectra:
    notes, good = list[str](), list[TimeRecord]()
    for record in records:
        if problem := defect(record):
            notes.append(f"{record.name} is left out: {problem}")
        else:
            good.append(record)
    good = _from_the_pulse(good) if good else good
    n, step = len((good or records)[0].force), records[0].step
    window = np.ones(n) if exponential is None else np.exp(-np.arange(n) * step / exponential)
    cut_off = [
        record.name
        for record in good
        # The transform of a truncated decay after an impulse is exact.
        if np.any(record.force[1:])
        and _has_not_decayed(record, window, _NOT_DECAYED[exponential is not None])
    ]
    if not good:
        raise UsageError(
            f"no impact is without a defect: {'; '.join(notes)}",
            remedy="Record impacts anew.",
            names=("measurement.records", "measurement"),
        )
    omega = np.asarray(2 * np.pi * np.fft.rfftfreq(n, step), dtype=np.float64)
    forces = [np.fft.rfft(record.force * window) for record in good]
    spectra = [np.fft.rfft(record.values * window[:, None], axis=0) for record in good]
    values: dict[tuple[str, str], ComplexArray] = {}
    variances: dict[tuple[str, str], Array | None] = {}
    for pair in _pairs(good):
        at = [
            k
            for k, record in enumerate(good)
            if record.references[0] == pair[1] and pair[0] in record.channels
        ]
        U = np.array([forces[k] for k in at])
        Y = np.array([spectra[k][:, list(good[k].channels).index(pair[0])] for k in at])
        power = np.sum(np.abs(U) ** 2, axis=0)
        H = np.sum(U.conj() * Y, axis=0) / np.where(power > 0, power, np.nan)
        values[pair], variances[pair] = H, None
        if len(at) > 1:
            scatter = np.sum(np.abs(Y - H * U) ** 2, axis=0) / (len(at) - 1)
            variance, degrees = (scatter / power)[:, None], 2.0 * (len(at) - 1)
            variances[pair] = smoothed_variance(variance, H[:, None], degrees, 1 / power[:, None])[:, 0]
    return Spectra(omega, values, variances, 0.0, notes, tuple(cut_off))


def _has_not_decayed(record: TimeRecord, window: Array, least: float) -> bool:
    """Return True if the windowed end of a channel is above a part of its largest part."""
    sizes = np.array([part.std(axis=0) for part in np.array_split(record.values * window[:, None], _PARTS)])
    return bool(np.any(sizes[-1] > least * sizes.max(axis=0)))


def _of_random(records: Sequence[TimeRecord], exponential: float | None, segment: float | None) -> Spectra:
    if exponential is not None:
        raise UsageError(
            "an exponential window is for impacts; these forces are random", names=("exponential",)
        )
    n, step = len(records[0].forces), records[0].step
    length = 2 * n // (_SEGMENTS + 1) if segment is None else round(segment / step)
    starts = range(0, n - length + 1, max(length // 2, 1))
    if length < 2 or len(starts) * len(records) < 2:
        raise UsageError(
            f"segments of {length * step:.4g} s leave fewer than two of them",
            remedy="Shorten them: segment.",
            names=("segment",),
        )
    window = np.hanning(length + 1)[:-1]
    omega = np.asarray(2 * np.pi * np.fft.rfftfreq(length, step), dtype=np.float64)

    def transformed(signals: Array) -> ComplexArray:
        parts = np.array([signals[start : start + length] for start in starts])
        return np.asarray(np.fft.rfft((parts - signals.mean(axis=0)) * window[:, None], axis=1))

    values: dict[tuple[str, str], ComplexArray] = {}
    variances: dict[tuple[str, str], Array | None] = {}
    notes = list[str]()
    for references in dict.fromkeys(tuple(record.references) for record in records):
        together = [record for record in records if tuple(record.references) == references]
        for channel in dict.fromkeys(name for record in together for name in record.channels):
            if any((channel, reference) in values for reference in references):
                raise UsageError(
                    f"channel {channel} is recorded with a force alone and with others at once",
                    remedy="Analyse these records apart.",
                    names=("measurement.records", "measurement"),
                )
            of_channel = [record for record in together if channel in record.channels]
            U = np.concatenate([transformed(record.forces) for record in of_channel])
            rows = (record.values[:, [list(record.channels).index(channel)]] for record in of_channel)
            Y = np.concatenate([transformed(row) for row in rows])[:, :, 0]
            H, variance, degrees, coherence = _h1(U, Y)
            if coherence > _COHERENT_FORCES:
                notes.append(
                    f"forces {', '.join(references)} have a coherence of {coherence:.2g}; standard errors "
                    "take the responses to them as independent"
                )
            for k, reference in enumerate(references):
                pair, flat = (channel, reference), 1 / np.mean(np.abs(U[:, :, [k]]) ** 2, axis=0)
                values[pair] = H[:, k]
                variances[pair] = smoothed_variance(variance[:, [k]], H[:, [k]], degrees, flat)[:, 0]
    return Spectra(omega, values, variances, 1 / (length * step), list(dict.fromkeys(notes)))


def _h1(U: ComplexArray, Y: ComplexArray) -> tuple[ComplexArray, Array, float, float]:
    """Return H1 (lines x forces), its variance, its degrees of freedom, and the forces' coherence.

    U: segments x lines x forces; Y: segments x lines. The coherence is the median over the lines of the
    largest that a force has with the others.
    """
    segments, _, forces = U.shape
    spectra = np.einsum("klf,klg->lfg", U.conj(), U) / segments
    size = np.sqrt(np.maximum(np.einsum("lff->lf", spectra).real, np.finfo(float).tiny))
    scaled = spectra / (size[:, :, None] * size[:, None, :])
    averages = segments / _OVERLAP_VARIANCE
    if averages <= forces or np.median(np.linalg.cond(scaled)) > _MAX_CONDITION:
        raise UsageError(
            f"the {forces} forces cannot be separated by {segments} segments",
            remedy="Drive them by independent signals, record longer, or shorten the segments: segment.",
            names=("excitation", "measurement.excitation", "measurement.records", "segment"),
        )
    inverse = np.linalg.pinv(scaled, hermitian=True) / (size[:, :, None] * size[:, None, :])
    cross = np.einsum("klf,kl->lf", U.conj(), Y) / segments
    H = np.einsum("lfg,lg->lf", inverse, cross)
    rest = np.sum(np.abs(Y - np.einsum("klf,lf->kl", U, H)) ** 2, axis=0) / segments
    of_inverse = np.einsum("lff->lf", inverse).real
    variance = (rest * averages / (averages - forces))[:, None] * of_inverse / averages
    coherence = 1 - 1 / np.maximum(of_inverse * size**2, 1.0)
    return H, variance, 2 * (averages - forces), float(np.median(coherence.max(axis=1)))


def _pairs(records: Sequence[TimeRecord]) -> list[tuple[str, str]]:
    """Return the pairs of channel and reference that records have."""
    return list(
        dict.fromkeys((channel, record.references[0]) for record in records for channel in record.channels)
    )
