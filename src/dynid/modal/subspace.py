"""Modes of responses alone: covariance-driven stochastic subspaces with first-order covariances.

Correlations of responses to white forces are free decays, ``R_k = C A^(k-1) G``. Of the singular vectors U_n
of their block Hankel matrix H, ``A = U_n(up)^+ U_n(down)`` and ``C`` is the first block row. Blocks of the
record each give a perturbation of H, and to first order of A, C, poles and shapes: their scatter is the
covariance (E. Reynders, R. Pintelon & G. De Roeck, Mech. Syst. Signal Process. 22 (2008) 948-969; M. Döhler
& L. Mevel, ibid. 38 (2013) 346-366). The part of a perturbation of U_n in its own span is a change of the
coordinates of the state, and left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray
from dynid.errors import NumericalError
from dynid.modal.chains import Chart, chart_of
from dynid.modal.reported_modes import LARGEST, ReportedModes
from dynid.progress import report_progress
from dynid.structure.correlation import mac

#: Blocks of the records whose scatter gives covariances.
BLOCKS = 40
# Highest orders of the chart (two for each mode), and the number of chains from which the second counts.
_ORDERS, _MANY_CHAINS = (60, 120), 15
# Largest number of columns of the Hankel matrix, a limit of cost.
_MAX_COLUMNS = 800
# A mode is that at the lower quartile of the standard errors of some orders, from this part of its chain on:
# at its beginning frequencies are biased (90 % covered), at its end standard errors are half as large again
# as the scatter; and at single orders a pole of noise beside a mode makes them ten times as large.
_PART_OF_CHAIN, _QUARTILE_OF = 0.2, 7
# Relative standard error of the damping ratio above which a pole is no mode: of spurious chains of six masses
# it was 0.6 and more.
_MAX_DAMPING_ERROR = 0.4
# Two chains are one mode if nearer than a half width, with shapes of so large a MAC.
_ONE_SHAPE = 0.9
# Segments of the kurtosis of a line, their phases, and the ratio E|a|^4 / (E|a|^2)^2 of its amplitudes below
# which it is a sine: of one it is 1, of random vibration 2 with a standard deviation of 0.25.
_SEGMENTS, _SINE_KURTOSIS = 64, 1.25
# Decay over a segment below which a pole is a line.
_LINE_DECAY = 0.3


@dataclass(frozen=True, eq=False)
class OutputModes:
    """Modes of responses alone, with what they rest on."""

    modes: ReportedModes
    chart: Chart
    order: NDArray[np.int_]  # order at which each mode is (n)
    harmonics: Array  # frequencies of sines of the excitation, rad/s
    block_rows: int
    periods: float  # of the lowest mode in the records


class Subspace:
    """Block Hankel matrix of the correlations of records, its singular vectors, and perturbations of both.

    `records`: samples x channels each, at one `step` (s). `rows`: block rows; `blocks`: over all records.
    """

    def __init__(self, records: Sequence[Array], step: float, rows: int, blocks: int = BLOCKS) -> None:
        self.step, self.rows, self.channels = step, rows, records[0].shape[1]
        usable = [len(record) - 2 * rows for record in records]
        counts = np.maximum(1, np.round(blocks * np.array(usable) / sum(usable))).astype(int)
        sums, lengths = list[Array](), list[int]()
        for record, count, end in zip(records, counts, usable, strict=True):
            y = record - record.mean(axis=0)
            edges = np.linspace(0, end, count + 1).astype(int).tolist()
            for start, stop in pairwise(edges):
                lags = range(1, 2 * rows + 1)
                sums.append(np.stack([y[start + k : stop + k].T @ y[start:stop] for k in lags]))
                lengths.append(stop - start)
        total, parts = sum(lengths), np.array(lengths) / sum(lengths)
        self.correlations = np.sum(sums, axis=0) / total
        scale = np.sqrt(len(sums) / (len(sums) - 1))
        self._blocks = [
            scale * (block / total - part * self.correlations)
            for block, part in zip(sums, parts, strict=True)
        ]
        self.U, self.sizes, self._V = np.linalg.svd(self._hankel(self.correlations), full_matrices=False)

    def _hankel(self, correlations: Array) -> Array:
        rows, channels = self.rows, self.channels
        H = np.stack(
            [correlations[i : i + rows].transpose(1, 0, 2).reshape(channels, -1) for i in range(rows + 1)]
        )
        return np.asarray(H.reshape((rows + 1) * channels, rows * channels))

    @cached_property
    def _moved(self) -> Array:
        """Perturbations of the singular vectors, parts in their span included (blocks x rows x order)."""
        highest = min(_ORDERS[-1], len(self.sizes))
        weights = self._V[:highest].T / self.sizes[:highest]
        return np.stack([self._hankel(block) @ weights for block in self._blocks])

    @cached_property
    def _shifted(self) -> tuple[Array, Array, Array]:
        """Q and R of the vectors less their last block row, and Q' times those less their first one."""
        highest = min(_ORDERS[-1], len(self.sizes))
        Q, R = np.linalg.qr(self.U[: -self.channels, :highest])
        return Q, R, Q.T @ self.U[self.channels :, :highest]

    @lru_cache(maxsize=2 * _ORDERS[-1])  # noqa: B019 (the records of one analysis)
    def realisation(self, order: int) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Return eigenvalues (n), eigenvectors (n x n) and shapes (channels x n) of an order."""
        _, R, down = self._shifted
        values, vectors = np.linalg.eig(np.linalg.solve(R[:order, :order], down[:order, :order]))
        return values.astype(complex), vectors.astype(complex), self.U[: self.channels, :order] @ vectors

    def poles(self, order: int) -> ComplexArray:
        """Return the poles of an order (rad/s)."""
        values = self.realisation(order)[0]
        return np.asarray(np.log(values[np.abs(values) > 0]) / self.step)

    def mode(self, order: int, pole: complex) -> Candidate:
        """Return the mode of an order whose pole is nearest to one, with perturbations by blocks."""
        values, vectors, shapes = self.realisation(order)
        channels, k = self.channels, int(np.argmin(np.abs(values - np.exp(pole * self.step))))
        # Of the observability matrix times the eigenvector: its parts (rows x parts and blocks).
        parts = np.zeros((self._moved.shape[2], 2))
        parts[:order] = np.stack([vectors[:, k].real, vectors[:, k].imag], axis=1)
        at = (self._moved @ parts).transpose(1, 2, 0).reshape(len(self.U), -1)
        at = at - self.U[:, :order] @ (self.U[:, :order].T @ at)
        moved = at[:, : at.shape[1] // 2] + 1j * at[:, at.shape[1] // 2 :]
        Q, R, _ = self._shifted
        right = Q[:, :order].T @ (moved[channels:] - values[k] * moved[:-channels])
        parts_of_modes = np.linalg.solve(vectors, np.linalg.solve(R[:order, :order], right))
        distance = values[k] - values
        distance[k] = np.inf
        return Candidate(
            order,
            complex(np.log(values[k]) / self.step),
            shapes[:, k],
            parts_of_modes[k] / (values[k] * self.step),
            moved[:channels] + shapes @ (parts_of_modes / distance[:, None]),
        )


@dataclass(frozen=True, eq=False)
class Candidate:
    """A pole of a chain, with its perturbations by blocks."""

    order: int
    pole: complex
    shape: ComplexArray
    pole_moved: ComplexArray  # (blocks)
    shape_moved: ComplexArray  # (channels x blocks)

    @property
    def damping(self) -> float:
        """Damping ratio."""
        return -self.pole.real / abs(self.pole)

    @property
    def moved(self) -> tuple[Array, Array]:
        """Perturbations of frequency and damping ratio (blocks)."""
        size = abs(self.pole)
        by_omega = np.real(np.conj(self.pole) * self.pole_moved) / size
        return by_omega, (-self.pole_moved.real - self.damping * by_omega) / size

    @property
    def damping_error(self) -> float:
        """Standard error of the damping ratio."""
        return float(np.linalg.norm(self.moved[1]))


def analyse_outputs(
    records: Sequence[Array],
    step: float,
    band: tuple[float, float],
    instrument: Callable[[complex], ComplexArray],
) -> OutputModes:
    """Return the modes in a band of records without their excitation.

    Parameters
    ----------
    records
        Responses (samples x channels) each, in any units.
    step
        Step of their samples, s.
    band
        Its ends, rad/s.
    instrument
        Factors of the channels from displacements at a complex frequency (1/s) to what was recorded.

    Raises
    ------
    NumericalError
        Where records are too short, or the band has no mode.
    """
    channels = records[0].shape[1]
    samples = sum(map(len, records))
    rms = np.sqrt(sum(np.sum((record - record.mean(axis=0)) ** 2, axis=0) for record in records) / samples)
    if not np.all(rms > 0):
        raise NumericalError(
            f"channel {int(np.argmin(rms)) + 1} is constant", remedy="Leave it out of the analysis."
        )
    scaled = [record / rms for record in records]
    rows = _block_rows(band[0], step, channels)
    if min(map(len, records)) < 2 * rows * (1 + BLOCKS // len(records)):
        raise NumericalError(
            f"a record of {min(map(len, records))} samples is too short for correlations over {2 * rows} "
            "lags",
            remedy="Record longer, or begin the band higher.",
        )
    report_progress("correlations of the responses")
    subspace = Subspace(scaled, step, rows)
    duration = samples * step
    chart = _chart(subspace, band, duration)
    candidates, harmonics = list[Candidate](), list[float]()
    lengths = np.bincount(chart.chain[chart.chain >= 0])
    for chain in np.argsort(-lengths, kind="stable").tolist():  # the longest of those of one mode stays
        candidate = _of_chain(subspace, chart, chain)
        if _is_sine(candidate, scaled, step):
            harmonics.append(abs(candidate.pole))
        elif candidate.damping_error < _MAX_DAMPING_ERROR * candidate.damping and not any(
            _is_same(candidate, mode) for mode in candidates
        ):
            candidates.append(candidate)
    modes = sorted(candidates, key=lambda mode: abs(mode.pole))
    if not modes:
        named = f"; {len(harmonics)} sines" if harmonics else ""
        raise NumericalError(
            f"the band has no pole with a determined damping ratio{named}",
            remedy="Choose the band by the peaks of the spectra, or record longer.",
        )
    reported = _reported(modes, rms, instrument)
    return OutputModes(
        reported,
        chart,
        np.array([mode.order for mode in modes]),
        np.unique(harmonics),
        rows,
        duration * float(reported.omega[0]) / (2 * np.pi),
    )


def _block_rows(low: float, step: float, channels: int) -> int:
    """Return block rows over a period at the lower end of the band, with columns for all orders."""
    least, most = -(-_ORDERS[0] // channels), max(2, _MAX_COLUMNS // channels)
    period = 2 * np.pi / (low * step) if low > 0 else np.inf
    return int(max(2, min(max(least, period), most)))


def _chart(subspace: Subspace, band: tuple[float, float], duration: float) -> Chart:
    """Return the chart of poles; what hardly decays in the record is a line, and counts as stable."""
    chart, line = None, _LINE_DECAY * _SEGMENTS / duration
    for highest in _ORDERS:
        orders = range(2, min(highest, len(subspace.sizes)) + 1, 2)
        report_progress(f"poles up to order {orders[-1]}")
        poles = [subspace.poles(order) for order in orders]
        lines = [np.where(np.abs(p.real) < line, -np.abs(p.real), p.real) + 1j * p.imag for p in poles]
        chart = chart_of(orders, lines, band)
        if chart.chain.max(initial=-1) + 1 < _MANY_CHAINS:
            break
    assert chart is not None
    return chart


def _is_sine(candidate: Candidate, records: Sequence[Array], step: float) -> bool:
    """Return True of a line that hardly decays over a segment, and whose amplitude is the same in all."""
    lengths = [len(record) for record in records]
    omega, length = abs(candidate.pole.imag), min(sum(lengths) // _SEGMENTS, *lengths)
    if abs(candidate.pole.real) * length * step > _LINE_DECAY:
        return False
    turn = np.hanning(length) * np.exp(-1j * omega * step * np.arange(length))
    amplitudes = [
        np.abs(turn @ record[start : start + length] @ candidate.shape.conj()) ** 2
        for record in records
        for start in range(0, len(record) - length + 1, length)
    ]
    power = np.array(amplitudes)
    return bool(np.mean(power**2) < _SINE_KURTOSIS * np.mean(power) ** 2)


def _of_chain(subspace: Subspace, chart: Chart, chain: int) -> Candidate:
    """Return the pole at the lower quartile of the standard errors of some orders of a chain."""
    members = np.flatnonzero(chart.chain == chain)
    first = int(_PART_OF_CHAIN * len(members))
    candidates = [
        subspace.mode(int(chart.order[at]), complex(chart.pole[at]))
        for at in members[first : first + _QUARTILE_OF]
    ]
    return sorted(candidates, key=lambda candidate: candidate.damping_error)[(len(candidates) - 1) // 4]


def _is_same(candidate: Candidate, mode: Candidate) -> bool:
    """Return True of two poles of one mode."""
    if abs(mode.pole - candidate.pole) > max(-mode.pole.real, -candidate.pole.real):
        return False
    return float(mac(mode.shape[:, None], candidate.shape[:, None])[0, 0]) > _ONE_SHAPE


def _reported(
    modes: Sequence[Candidate], rms: Array, instrument: Callable[[complex], ComplexArray]
) -> ReportedModes:
    """Return modes with the covariance of their blocks, shapes as displacements with a largest entry of 1."""
    n, channels = len(modes), len(rms)
    shapes = np.zeros((n, channels), dtype=complex)
    by_omega, by_damping = (np.array(rows) for rows in zip(*(mode.moved for mode in modes), strict=True))
    of_shapes = np.zeros((channels, n, by_omega.shape[1]), dtype=complex)
    driving = np.zeros(n, dtype=int)
    for k, mode in enumerate(modes):
        factor = instrument(mode.pole)
        nearby = 1e-6 * abs(mode.pole)
        slope = (instrument(mode.pole + nearby) - instrument(mode.pole - nearby)) / (2 * nearby * factor)
        size = rms / factor
        shape, moved = size * mode.shape, size[:, None] * mode.shape_moved
        moved = moved - np.outer(shape * slope, mode.pole_moved)
        o = driving[k] = int(np.argmax(np.abs(shape)))
        shapes[k] = shape / shape[o]
        of_shapes[:, k] = (moved - np.outer(shapes[k], moved[o])) / shape[o]
        shapes[k, o], of_shapes[o, k] = 1.0, 0.0  # without round-off
    parts = [
        by_omega,
        by_damping,
        *(part.reshape(channels * n, -1) for part in (of_shapes.real, of_shapes.imag)),
    ]
    perturbations = np.vstack(parts)
    omega = np.array([abs(mode.pole) for mode in modes])
    damping = np.array([mode.damping for mode in modes])
    alone = _shrinkage(perturbations)
    own = np.sqrt(alone) * np.linalg.norm(perturbations, axis=1)
    common = np.hstack([np.sqrt(1 - alone) * perturbations, np.diag(own)[:, : 2 * n]])
    by_channel = np.zeros((channels, 2, n, 2, n))
    part, mode_at = np.ogrid[:2, :n]
    by_channel[:, part, mode_at, part, mode_at] = own[2 * n :].reshape(2, channels, n).transpose(1, 0, 2)
    blocks = by_channel.reshape(channels, 2 * n, 2 * n)
    return ReportedModes(omega, damping, shapes, LARGEST, common, blocks, driving)


def _shrinkage(perturbations: Array) -> float:
    """Return by how much correlations of few blocks (values x blocks) are to be reduced.

    The covariance of so few blocks is singular; that of least mean squared error is between it and its
    diagonal (J. Schäfer & K. Strimmer, Stat. Appl. Genet. Mol. Biol. 4 (2005) 32).
    """
    size = np.linalg.norm(perturbations, axis=1)
    z = perturbations[size > 0] / size[size > 0, None]
    blocks, correlations = z.shape[1], z @ z.T
    scatter = blocks / (blocks - 1) * (z**2 @ (z**2).T - correlations**2 / blocks)
    np.fill_diagonal(correlations, 0.0)
    np.fill_diagonal(scatter, 0.0)
    squares = float(np.sum(correlations**2))
    return float(np.clip(np.sum(scatter) / squares, 0.0, 1.0)) if squares > 0 else 1.0
