"""Poor records: an estimate with right error bars, or a refusal; never NaN, never silently wrong."""

import numpy as np
import pytest

import dynid
from dynid.errors import Diverged, DynidError
from dynid.identification.estimators.filter_passes import Filter
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.records.measurement import Measurement
from dynid.lti.signals import Multisine
from dynid.structure.ports import Load
from tests.identification.cases import (
    VELOCITIES,
    diagnostic,
    in_bounds,
    parameter,
    recorded,
    run,
    simulated,
    suspension,
)
from tests.identification.test_reduced_models import BEAM
from tests.scene.example_scenes import check

pytestmark = [pytest.mark.thorough, pytest.mark.usefixtures("complete")]

# The force had been acting for 10 s when the record began.
LOADS = (Load(5, Multisine([100] * 3, [70, 110, 250], [700, 1100, 2500])),)

#: What few samples leave undefined: nothing given, or no response left beside what is estimated.
_UNDEFINED = ("/noise_p", "/high", "nonlinearity/p", "nonlinearity/joint_p", "nonlinearity/size")


def assert_honest(result):
    """No number is missing; and what says that it has converged is within five bounds."""
    for path, variable in result.items():
        if variable.data.dtype.kind in "fc" and not path.endswith(_UNDEFINED):
            assert np.isfinite(variable.data).all(), path
    if diagnostic(result, "converged"):
        assert np.abs(in_bounds(result)).max() < 5


@pytest.mark.parametrize("step", [0.003, 0.005])
def test_a_reduced_model_stiffer_than_the_step_is_no_matter(step):
    text = BEAM.replace("step: 0.002", f"step: {step}").replace("[45, 250, 300]", "[45, 95, 250]")
    text = text.replace("noise_ratio: 0,", "noise_ratio: 0.02,").replace("{count: 8}", "{count: 9}")
    text = text.replace("estimator: {method: filter, passes: 2}\n", "").replace("800", "400")
    result = dynid.run(check(text))
    # An explicit integrator would be unstable from 2.8 on.
    assert result["identification/model_error/frequency"].data.max() * step > 3
    assert diagnostic(result, "converged")
    assert_honest(result)


def answered(*arguments, **options):
    """Run; return the result, or nothing where that is refused in words."""
    try:
        return run(*arguments, **options)
    except DynidError as error:
        refused = error
    assert refused.names
    assert refused.remedy
    return None


@pytest.mark.parametrize("factor", [1e-3, 1e-2, 30.0])
def test_a_start_far_off_ends_at_the_optimum_or_says_that_it_did_not(factor):
    result = answered(suspension(factor), simulated(0.05, samples=200), estimator=Filter(2))
    if result is not None:
        assert_honest(result)


def clipped(level):
    """Return a record cut off at so many times its RMS."""
    clean = recorded(0.02)
    size = level * np.sqrt(np.mean(clean**2, axis=0))
    return Measurement(0.002, 800, VELOCITIES, np.clip(clean, -size, size))


@pytest.mark.usefixtures("poor_starts")
def test_a_clipped_record_is_a_warning():
    result = run(measurement=clipped(1.2), loads=LOADS, estimator=OutputError())
    said = " ".join(result["identification/diagnostics/warnings"].data)
    assert "it may be clipped" in said
    assert "the model lacks fit" in said
    assert diagnostic(result, "lack_of_fit_p") < 1e-6
    assert result.group_attrs["identification/parameters"]["error_bars"].startswith("nominal")
    assert np.isfinite(parameter(result, "estimate")).all()


@pytest.mark.slow
@pytest.mark.usefixtures("poor_starts")
def test_a_record_clipped_at_a_third_is_refused():
    with pytest.raises(Diverged, match="are invalid"):
        run(measurement=clipped(0.3), loads=LOADS, estimator=OutputError())


@pytest.mark.parametrize("samples", [1, 2, 3, 5, 7, 8, 12])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_records_of_a_few_samples(samples, noise):
    result = answered(measurement=simulated(noise, samples=samples))
    if result is not None:
        assert samples > 6  # 14 unknowns, two values a sample
        for path, variable in result.items():
            if variable.data.dtype.kind in "fc" and not path.endswith(_UNDEFINED):
                assert np.isfinite(variable.data).all(), path


@pytest.mark.parametrize(("samples", "noise", "said"), [(5, None, True), (5, 1e-4, False), (40, None, False)])
def test_a_noise_estimated_from_few_values_is_a_warning(samples, noise, said):
    scene = {
        "dynid": 1,
        "kind": "identification",
        "structure": {"lumped": {"masses": [1], "links": []}},
        "joints": {"a": {"dofs": [1], "k": {"start": 100, "true": 120}, "c": 2}},
        "initial": {1: {"x": 0.01}},
        "measurement": {
            "step": 0.1,
            "samples": samples,
            "channels": [{"dof": 1, "quantity": "displacement"}],
            "simulate": {"noise_ratio": 0.02, "seed": 4},
            **({} if noise is None else {"noise": noise}),
        },
    }
    warned = dynid.run(dynid.scene_from(scene)).value("identification/diagnostics/warnings")
    assert any("left to estimate the noise from" in text for text in warned) == said


@pytest.mark.slow
def test_a_million_samples():
    result = run(measurement=simulated(0.05, samples=1_000_000))
    assert_honest(result)
    assert diagnostic(result, "converged")
    # The bound falls with the root of the length: 0.17 % of 800 samples, 0.005 % of a million.
    assert (parameter(result, "cramer_rao") / parameter(result, "true")).max() < 1e-3
