"""What frequency response functions will tell of the parameters, before they are worked on."""

from __future__ import annotations

from dynid.identification.frf.identify import likelihood_of
from dynid.identification.frf.measurement import FrfMeasurement, frf_data
from dynid.identification.identifiability import expected, told
from dynid.lti.floating import guarded
from dynid.result import Result
from dynid.structure.model import StructuralModel


def frf_identifiability(
    model: StructuralModel, measurement: FrfMeasurement, truth: StructuralModel | None = None
) -> Result:
    """Tell what responses can tell of the unknown joint parameters, from their Fisher information.

    Parameters
    ----------
    model, measurement, truth
        As of `dynid.identification.frf.identify.identify_frf`.

    Returns
    -------
    Result
        As of `dynid.identification.identifiability.identifiability`; there is no initial state to know. The
        deviation of the noise is that of real and imaginary part each, over the deviation by line where that
        is given.
    """
    names = [unknown.name for unknown in model.unknowns]
    with guarded(f"the identifiability of {', '.join(names)}", names=names):
        likelihood = likelihood_of(model, measurement, frf_data(truth or model, measurement))
        channels = [(frf.name, frf.unit) for frf in measurement.channels]
        return told(model, expected(likelihood), channels)
