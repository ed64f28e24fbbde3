"""Bounds and priors of parameters."""

import numpy as np
import pytest

from dynid.errors import NotIdentifiable, UsageError
from dynid.identification.estimators.auto import Auto
from dynid.identification.estimators.filter_passes import Filter
from dynid.identification.estimators.imbedding import InvariantImbedding
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.parameters import Parameter, ParameterPrior
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from tests.identification.cases import LINKS, MASSES, diagnostic, parameter, run, simulated
from tests.sample import sample

ESTIMATORS = [Auto(), OutputError(), Filter(2), InvariantImbedding(tolerance=1e-3)]
each = pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda estimator: estimator.name)
TRUE = 2e4


def model(c3=None, **k3):
    """Joints 2–3 known, the stiffness of 3–4 with what is known of it, its damping unknown."""
    k = JointParameter(start=k3.pop("start", 1.8e4), true=TRUE, **k3)
    c = c3 or JointParameter(start=15.0, true=20.0)
    return lumped(MASSES, [*LINKS, Link((2, 3), 2e4, 20)], [Joint("j3", (3, 4), k, c)])


@pytest.mark.parametrize("estimator", ESTIMATORS[:3], ids=lambda estimator: estimator.name)
def test_a_bound_that_does_not_bind_changes_nothing(estimator):
    free = run(model(), simulated(0.05, samples=200), estimator=estimator)
    held = run(model(low=1e3, high=1e6), simulated(0.05, samples=200), estimator=estimator)
    np.testing.assert_allclose(parameter(held, "estimate"), parameter(free, "estimate"), rtol=1e-9)
    assert not parameter(held, "at_bound").any()


@each
@pytest.mark.parametrize("side", sample(["low", "high"], 1))
def test_a_bound_holds(estimator, side):
    """The truth lies 1 % outside: the estimate ends at the bound, and the damping where that is fixed."""
    at = {"low": 1.01, "high": 0.99}[side] * TRUE
    bounded = model(start=at, **{side: at})
    result = run(bounded, simulated(0.05, samples=200), estimator=estimator)
    assert parameter(result, "estimate")[0] == pytest.approx(at, rel=1e-12)
    assert parameter(result, "at_bound").tolist() == [True, False]
    if isinstance(estimator, (Auto, OutputError)):
        fixed = lumped(
            MASSES,
            [*LINKS, Link((2, 3), 2e4, 20), Link((3, 4), at, 0)],
            [Joint("j3", (3, 4), None, JointParameter(start=15.0))],
        )
        truth = {"truth": bounded}
        alone = run(fixed, simulated(0.05, samples=200), estimator=estimator, **truth)
        np.testing.assert_allclose(
            parameter(result, "estimate")[1], parameter(alone, "estimate")[0], rtol=1e-3
        )
        assert diagnostic(result, "settled")


@pytest.mark.parametrize("estimator", ESTIMATORS[1:3], ids=lambda estimator: estimator.name)
def test_a_sharp_prior_outweighs_the_record_and_a_vague_one_does_not(estimator):
    measurement = simulated(0.05, samples=200)
    free = run(model(), measurement, estimator=estimator)
    sharp = run(model(prior=ParameterPrior(1.9e4, 1e-6)), measurement, estimator=estimator)
    vague = run(model(prior=ParameterPrior(1.9e4, 100.0)), measurement, estimator=estimator)
    assert parameter(sharp, "estimate")[0] == pytest.approx(1.9e4, rel=1e-4)
    deviation = parameter(free, "standard_error")
    assert np.all(np.abs(parameter(vague, "estimate") - parameter(free, "estimate")) < deviation)


@pytest.mark.parametrize("width", [0.3, 0.01, 1e-4])
def test_a_prior_that_the_record_contradicts_is_named_however_sharp_it_is(width):
    """By the same distance, which is that of the record's own estimate in deviations of both."""
    measurement = simulated(0.05, samples=200)
    free = run(model(), measurement)
    far = run(model(prior=ParameterPrior(1.9e4 * np.exp(6 * width + 0.1), width)), measurement)
    apart = diagnostic(far, "prior_conflict")
    own = parameter(free, "estimate")[0]
    deviation = np.hypot(parameter(free, "standard_error")[0] / own, np.sqrt(np.log1p(width**2)))
    expected = np.abs(np.log(1.9e4 / own) + 6 * width + 0.1) / deviation
    # The record's information is taken where the prior has drawn the estimate.
    np.testing.assert_allclose(apart[0], expected, rtol=0.3)
    assert apart[1] == 0
    assert diagnostic(far, "prior_contradicted").tolist() == [expected > 4, False]
    said = "the prior of j3.k and the record contradict each other"
    assert any(warning.startswith(said) for warning in diagnostic(far, "warnings")) == (expected > 4)
    near = run(model(prior=ParameterPrior(float(own), width)), measurement)
    assert not diagnostic(near, "prior_contradicted").any()
    assert "identification/diagnostics/prior_conflict" not in free


def test_the_information_of_a_prior_adds_to_the_record():
    """As wide as the record's own bound: with one unknown, the two weigh the same."""
    c = JointParameter(value=20.0)
    measurement = simulated(0.05, samples=200)
    alone = run(model(c), measurement)
    deviation = float(parameter(alone, "cramer_rao")[0]) / TRUE
    mean = float(parameter(alone, "estimate")[0]) * np.exp(2 * deviation)
    both = run(model(c, prior=ParameterPrior(mean, deviation)), measurement)
    np.testing.assert_allclose(
        parameter(both, "cramer_rao"), parameter(alone, "cramer_rao") / np.sqrt(2), rtol=1e-3
    )
    np.testing.assert_allclose(
        parameter(both, "cramer_rao_without_prior"), parameter(alone, "cramer_rao"), rtol=1e-12
    )
    # Half way between them, in logarithms; the noise is estimated and not exactly the true one.
    moved = np.log(parameter(both, "estimate")[0] / parameter(alone, "estimate")[0])
    assert moved == pytest.approx(deviation, rel=0.1)


def test_a_prior_replaces_missing_information():
    """Two joints side by side cannot be distinguished, but for a prior on one."""

    def twins(prior=None):
        unknown = {"start": 1e4, "true": 1e4}
        joints = [
            Joint("a", (3, 4), JointParameter(**unknown, prior=prior), 10.0),
            Joint("b", (3, 4), JointParameter(**unknown), 10.0),
        ]
        return lumped(MASSES, [*LINKS, Link((2, 3), 2e4, 20)], joints)

    with pytest.raises(NotIdentifiable, match="cannot be distinguished"):
        run(twins(), simulated(0.05, samples=200))
    result = run(twins(ParameterPrior(1.1e4, 0.05)), simulated(0.05, samples=200))
    assert parameter(result, "estimate").sum() == pytest.approx(2e4, rel=0.01)
    assert parameter(result, "estimate")[0] == pytest.approx(1.1e4, rel=0.01)
    assert np.isinf(parameter(result, "cramer_rao_without_prior")).all()
    assert np.isfinite(parameter(result, "cramer_rao")).all()


@pytest.mark.parametrize(
    "given",
    [
        {"start": 1.0, "low": 2.0},
        {"start": 1.0, "high": 0.5},
        {"start": 1.0, "low": 0.0},
        {"value": 1.0, "low": 0.5},
        {"value": 1.0, "prior": ParameterPrior(1.0, 0.1)},
        {"start": 1.0, "prior": ParameterPrior(-1.0, 0.1)},
        {"start": 1.0, "prior": ParameterPrior(1.0, np.inf)},
    ],
)
def test_nonsense_is_refused(given):
    with pytest.raises(UsageError):
        JointParameter(**given)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"start": np.inf}, "has a number that is not finite"),
        ({"start": 1.0, "high": np.nan}, "has a number that is not finite"),
        ({"start": 3.0, "high": 2.0}, "starts outside its limits"),
        ({"start": 0.5, "low": 1.0}, "starts outside its limits"),
        (
            {"start": 1.0, "prior": ParameterPrior(1.0, 0.0)},
            "has a prior without a positive standard deviation",
        ),
        (
            {"start": 1.0, "true": -1.0},
            "is estimated by its logarithm, and has a number that is not positive. Write `scale: linear` "
            "where zero or negative values are possible.",
        ),
    ],
)
def test_numbers_of_a_parameter_that_make_no_sense_are_refused(given, said):
    with pytest.raises(UsageError) as caught:
        Parameter("a.k", **given)
    assert str(caught.value) == f"the parameter a.k {said}"
    assert caught.value.names == ("a.k",)


@pytest.mark.parametrize(
    ("given", "spread"),
    [
        ({"scale": "log"}, 2.0),
        ({"spread": 0.5, "prior": ParameterPrior(3.0, deviation=0.2), "low": -1.0, "high": 7.0}, 0.5),
        ({"prior": ParameterPrior(3.0, 0.1), "low": -1.0, "high": 7.0}, 0.3),
        ({"low": -1.0, "high": 7.0}, 2.0),
        ({"low": -1.0}, 6.0),
        ({"start": -4.0}, 8.0),
        ({"start": 0.0}, 1.0),
    ],
)
def test_a_first_guess_may_be_off_by_what_is_known_of_the_parameter(given, spread):
    one = Parameter("a.k", **({"start": 3.0, "scale": "linear"} | given))
    assert one.first_spread == pytest.approx(spread, rel=1e-15)
