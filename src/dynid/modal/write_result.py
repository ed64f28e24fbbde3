"""Arrays of a modal analysis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dynid.arrays import ComplexArray
from dynid.modal.chains import Chart
from dynid.modal.modal_analysis import ModalAnalysis
from dynid.modal.reported_modes import LARGEST, ReportedModes
from dynid.modal.spectra import MIN_RESOLUTION
from dynid.number_format import counted
from dynid.result import Result

if TYPE_CHECKING:
    from dynid.modal.subspace import OutputModes

#: Group of the results.
GROUP = "modal"
# Relative standard error of the residue at the driving point above which the scale of a shape is doubtful:
# shapes go with its root, whose bars are right while it is small.
_DOUBTFUL_SCALE = 0.15
# Periods of the lowest mode in the shortest records without excitation whose standard errors were tested.
_MIN_PERIODS = 600


def add_analysis(
    result: Result,
    analysis: ModalAnalysis,
    channels: Sequence[str],
    references: Sequence[str],
    powers: ComplexArray,
    warnings: Sequence[str] = (),
) -> None:
    """Add the modes of an analysis, their covariance, the chart of poles, and the fit.

    `channels` and `references` name the DOFs; `powers` (lines x channels) turn receptances into what was
    measured.
    """
    fit, frf = analysis.fit, analysis.model.frf
    _add_modes(result, analysis.modes, analysis.chart, channels)
    result.add_axis(f"{GROUP}/reference", [str(reference) for reference in references])
    result.add_axis(f"{GROUP}/fit/omega", frf.omega, "rad/s")
    lines = ("omega", "channel", "reference")
    measured = np.where(frf.weights > 0, frf.values, np.nan) * powers[:, :, None]
    result.add(f"{GROUP}/fit/measured", measured, lines)
    result.add(f"{GROUP}/fit/synthesis", analysis.model.synthesis(fit) * powers[:, :, None], lines)
    result.add(f"{GROUP}/fit/chi2", fit.chi2)
    result.add(f"{GROUP}/fit/degrees", analysis.degrees)
    result.add(f"{GROUP}/fit/lacks_fit", analysis.bar_scale > 1)
    if np.isfinite(analysis.reciprocity):
        result.add(f"{GROUP}/fit/reciprocity", analysis.reciprocity)
    if np.isfinite(analysis.real_shapes):
        result.add(f"{GROUP}/fit/real_shapes", analysis.real_shapes)
    result.add(f"{GROUP}/fit/whiteness", analysis.whiteness)
    result.annotate(GROUP, noise="estimated" if frf.estimated else "stated")
    if analysis.model.own:
        result.annotate(GROUP, reciprocal=True)
    _add_warnings(result, [*warnings, *doubts_of(analysis)])


def add_output_analysis(
    result: Result, analysis: OutputModes, channels: Sequence[str], warnings: Sequence[str] = ()
) -> None:
    """Add the modes of responses alone, and the frequencies of sines in them."""
    _add_modes(result, analysis.modes, analysis.chart, channels)
    result.add(f"{GROUP}/order", analysis.order, ("mode",))
    result.add(f"{GROUP}/periods", analysis.periods)
    result.annotate(GROUP, block_rows=analysis.block_rows)
    doubts = [*warnings]
    if len(analysis.harmonics):
        result.add(f"{GROUP}/harmonics", analysis.harmonics, ("harmonic",), "rad/s")
        frequencies = ", ".join(f"{omega / (2 * np.pi):.5g}" for omega in analysis.harmonics)
        doubts.append(
            f"{counted(len(analysis.harmonics), 'sine')} in the responses, no modes, at {frequencies} Hz: "
            "harmonics of a machine, whose frequency may hide a mode"
        )
    if analysis.periods < _MIN_PERIODS:
        doubts.append(
            f"the record has {analysis.periods:.0f} periods of the lowest mode, and standard errors are "
            f"those of {_MIN_PERIODS} and more: record longer"
        )
    _add_warnings(result, doubts)


def _add_modes(result: Result, modes: ReportedModes, chart: Chart, channels: Sequence[str]) -> None:
    by_omega, by_damping, by_shape = modes.standard_errors
    result.add_axis(f"{GROUP}/mode", np.arange(1, len(modes.omega) + 1))
    result.add_axis(f"{GROUP}/channel", [str(channel) for channel in channels])
    result.add(f"{GROUP}/frequency", modes.omega, ("mode",), "rad/s")
    result.add(f"{GROUP}/frequency_standard_error", by_omega, ("mode",), "rad/s")
    result.add(f"{GROUP}/damping", modes.damping, ("mode",))
    result.add(f"{GROUP}/damping_standard_error", by_damping, ("mode",))
    of_shapes = ("mode", "channel")
    result.add(f"{GROUP}/shape", modes.shape, of_shapes, normalisation=modes.normalisation)
    result.add(f"{GROUP}/shape_standard_error", by_shape, of_shapes)
    result.add(f"{GROUP}/complexity", modes.complexity, ("mode",))
    result.add(f"{GROUP}/covariance/common", modes.common, ("value", "factor"))
    of_channels = modes.by_channel.reshape(-1, modes.by_channel.shape[2])
    result.add(f"{GROUP}/covariance/by_channel", of_channels, ("channel_value", "root"))
    result.add_all(f"{GROUP}/chart", ("point",), order=chart.order, chain=chart.chain)
    result.add(f"{GROUP}/chart/pole", chart.pole, ("point",), "rad/s")


def _add_warnings(result: Result, doubts: Sequence[str]) -> None:
    if doubts:
        result.add(f"{GROUP}/warnings", list(doubts), ("warning",))


def _misfit(analysis: ModalAnalysis) -> str:
    if analysis.reduced_chi2 >= analysis.bar_scale**2 * (1 - 1e-9):
        return f"chi-squared is {analysis.reduced_chi2:.3g} of its expectation"
    return f"residuals of neighbouring lines are alike (von Neumann's ratio {analysis.whiteness:.3g}, not 1)"


def doubts_of(analysis: ModalAnalysis) -> list[str]:
    """Return what users must know of the modes."""
    doubts, modes = list[str](), analysis.modes
    if analysis.bar_scale > 1:
        doubts.append(
            f"lack of fit: {_misfit(analysis)}, and standard errors are {analysis.bar_scale:.3g} times those "
            "of the noise; close modes need more references"
        )
    if analysis.model.references == 1:
        doubts.append(
            "one reference: modes that it hardly moves, or closer than their bandwidth, may be missing"
        )
    if np.isfinite(analysis.reciprocity) and not analysis.model.own:
        doubts.append(
            f"the responses are not reciprocal (p = {analysis.reciprocity:.2g}): check gains and directions "
            "of the references"
        )
    narrow = [str(k + 1) for k in np.flatnonzero(np.isnan(modes.standard_errors[1]))]
    if narrow:
        doubts.append(
            f"mode {', '.join(narrow)} has fewer than {MIN_RESOLUTION:g} lines in its bandwidth, and no "
            "standard errors: leakage biases its damping; lengthen the segments"
        )
    if modes.normalisation != LARGEST:
        weak = [str(k + 1) for k in np.flatnonzero(modes.scale_error > _DOUBTFUL_SCALE)]
        if weak:
            doubts.append(
                f"the scale of the shape of mode {', '.join(weak)} is doubtful: it hardly moves at the "
                "driving points"
            )
    return doubts
