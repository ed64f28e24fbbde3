"""Names, axes and units of an identification's result."""

import numpy as np

from dynid.identification.estimators.filter_passes import Filter
from dynid.lti.signals import Multisine
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import lumped
from dynid.structure.ports import Channel, Load
from tests.identification.cases import run, simulated

PATHS = {
    "parameters": ("name", "start", "true", "estimate", "standard_error", "cramer_rao", "error_percent"),
    "history": ("time", "estimate", "standard_deviation", "state"),
    "measurement": ("time", "measured", "predicted", "input"),
    "diagnostics": (
        "converged",
        "settled",
        "explained",
        "distance_to_optimum",
        "residual_rms",
        "whiteness_p",
        "white",
        "condition",
    ),
}


def test_names_axes_and_units():
    result = run(measurement=simulated(0.05))
    for group, names in PATHS.items():
        for name in names:
            assert f"identification/{group}/{name}" in result
    assert result["identification/history/estimate"].dims == ("time", "parameter")
    assert result.value("identification/history/state").shape == (800, 10)
    assert result["identification/measurement/measured"].dims == ("time", "channel")
    assert result["identification/measurement/measured"].units == "m/s"
    assert result["identification/measurement/input"].dims == ("time", "excitation")
    time = result.value("identification/measurement/time")
    np.testing.assert_allclose(time, np.arange(800) * 0.002)
    force = sum(100 * np.sin(w * (10 + time)) for w in (70, 110, 250))
    np.testing.assert_allclose(result.value("identification/measurement/input")[:, 0], force, atol=1e-9)


def test_every_axis_has_its_coordinate_and_no_array_bears_an_axis_name():
    result = run(measurement=simulated(0.05))
    for path, variable in result.items():
        group, name = path.rsplit("/", 1)
        for dim in variable.dims:
            assert result[f"{group}/{dim}"].dims == (dim,)
        if name in variable.dims:
            assert variable.dims == (name,)


def test_history_ends_at_the_estimate_and_the_first_pass_is_kept():
    result = run(measurement=simulated(0.05), estimator=Filter(2))
    estimate = result.value("identification/parameters/estimate")
    np.testing.assert_allclose(result.value("identification/history/estimate")[-1], estimate, rtol=1e-14)
    early = result.value("identification/first_pass/estimate")[0]
    np.testing.assert_allclose(early, result.value("identification/parameters/start"), rtol=0.2)
    assert "identification/first_pass/estimate" not in run(estimator=Filter(1))


def test_prediction_and_residual_belong_together():
    result = run(measurement=simulated(0.05))
    residual = result.value("identification/measurement/measured") - result.value(
        "identification/measurement/predicted"
    )
    np.testing.assert_allclose(
        result.value("identification/diagnostics/residual_rms"),
        np.sqrt(np.mean(residual**2, axis=0)),
        rtol=1e-12,
    )
    for verdict in ("converged", "settled", "explained", "white"):
        assert isinstance(result.value(f"identification/diagnostics/{verdict}"), bool)


VALUES = ("start", "true", "estimate", "standard_error", "cramer_rao")


def test_values_of_one_unit_have_it_and_mixed_ones_have_it_beside_them():
    mixed = simulated(channels=(Channel(2, "velocity"), Channel(3, "acceleration")))
    result = run(measurement=mixed, estimator=Filter(2))
    group = "identification"
    assert list(result.value(f"{group}/parameters/unit")) == ["N/m", "N.s/m"] * 2
    assert {result[f"{group}/parameters/{name}"].units for name in VALUES} == {""}
    assert list(result.value(f"{group}/measurement/unit")) == ["m/s", "m/s2"]
    assert result[f"{group}/measurement/measured"].units == ""
    for history in ("history", "first_pass"):
        unit = result[f"{group}/{history}/unit"]
        assert (unit.dims, list(unit.data)) == (("component",), ["m"] * 5 + ["m/s"] * 5)

    joint = Joint("j", (1,), JointParameter(start=90.0, true=100.0), 2.0)
    loads = [Load(1, Multisine([1.0], [9.0]))]
    result = run(lumped([1.0], [], [joint]), simulated(channels=(Channel(1, "velocity"),)), loads)
    assert {result[f"{group}/parameters/{name}"].units for name in VALUES} == {"N/m"}
    assert result[f"{group}/history/estimate"].units == "N/m"
    assert result[f"{group}/diagnostics/residual_rms"].units == "m/s"
