"""Explanation of a modal analysis: responses, lines, noise, and the scale that shapes will have."""

from __future__ import annotations

import numpy as np

from dynid.errors import NumericalError, UsageError
from dynid.number_format import counted
from dynid.result import Result
from dynid.scene.explanations.explanation import Explanation, Fact
from dynid.scene.kinds.modal_analysis import modal_test
from dynid.scene.load import Scene
from dynid.scene.schema.modal_analysis import ModalAnalysisScene
from dynid.units import angular_factor


def explain(scene: Scene[ModalAnalysisScene]) -> Explanation:
    """Return the explanation of a scene of kind `modal-analysis`, whose measurement is read."""
    result = Result("modal-analysis", scene.title)
    try:
        test = modal_test(scene)
    except (NumericalError, UsageError) as error:
        return Explanation(result, [], obstacle=error)
    frf, band = test.frf, scene.model.band
    factor = angular_factor(band.unit)
    responses, references = (
        counted(len(test.channels), "response"),
        counted(len(test.references), "reference"),
    )
    step = float(np.median(np.diff(frf.omega))) / factor
    facts = [
        Fact("responses", f"{responses} to {references} ({', '.join(test.references)})"),
        Fact("lines", f"{counted(len(frf.omega), 'line')} in the band, {step:.4g} {band.unit} apart"),
        Fact("noise", "estimated from the responses" if frf.estimated else "as stated or measured"),
        Fact("scale", _scale(test.driving_points, real=scene.model.modes.shapes == "real")),
        *(Fact("warning", note) for note in test.notes),
    ]
    return Explanation(result, facts)


def _scale(driving_points: list[tuple[int, int]], *, real: bool) -> str:
    if not driving_points:
        return "largest entry 1: no response is measured at a reference"
    return (
        f"{'unit modal mass' if real else 'modal a of 1'}, by {counted(len(driving_points), 'driving point')}"
    )
