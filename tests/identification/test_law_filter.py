"""The filters of joints with nonlinear laws: against that of linear models, in C and NumPy, many noises."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.errors import Diverged, UsageError
from dynid.identification.estimators.filter import filter_pass
from dynid.identification.estimators.filter_passes import Filter, sigma_point_filter, wide_prior
from dynid.identification.estimators.imbedding import InvariantImbedding
from dynid.identification.estimators.law_filter import law_filter_pass
from dynid.identification.identify import identify
from dynid.identification.likelihood.priors import InitialState
from dynid.identification.problem import Problem
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.lti.signals import Multisine
from dynid.native import compiled
from dynid.parameters import starts
from dynid.structure.hysteretic_laws import BoucWen, Jenkins
from dynid.structure.joint_laws import Cubic, Gap, Power
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.model_laws import joint_law
from dynid.structure.ports import Channel, Load
from tests.identification.test_law_coverage import clean_record, measured
from tests.identification.test_law_coverage import model as law_model

pytestmark = pytest.mark.thorough


def unknown(value, *, signed=False):
    return JointParameter(start=1.02 * value, true=value, signed=signed)


def model(*laws, offset=None, stiff=1.5e4):
    joint = Joint("bolt", (1, 2), unknown(1e4), unknown(4.0), laws=laws, offset=offset)
    return lumped((1.0, 0.7), (Link((1,), stiff, 5.0),), [joint])


def experiment(samples=60, source=None, quantity="velocity"):
    force = Multisine([6.0] * 4, [60, 85, 120, 170], [0.1, 2.0, 4.0, 5.5])
    channels = (Channel(1, quantity), Channel(2, "velocity"))
    return Experiment(
        (Load(2, force),), Measurement(1 / 400, samples, channels, source or Simulation(0.01, 1))
    )


def likelihood_of(*laws, **options):
    offset, stiff = options.pop("offset", None), options.pop("stiff", 1.5e4)
    return Problem.of(model(*laws, offset=offset, stiff=stiff), experiment(**options)).likelihood


def passed(likelihood, *, sigma_points, share=0.05, gaps=False):
    (record,) = likelihood.records
    origin, data = starts(likelihood.unknowns), record.data
    if gaps:
        values = data.values.copy()
        values[2:4, 0], values[6] = np.nan, np.nan
        record = replace(record, data=replace(data, values=values))
    prior, noise = wide_prior(record, origin, share), 0.02 * data.rms
    return law_filter_pass(record, prior, noise, origin, sigma_points=sigma_points)


LAWS = {
    "cubic": (joint_law(Cubic(), [unknown(2e8, signed=True)]),),
    "bouc_wen": (joint_law(BoucWen(), [unknown(3e3), unknown(3e3, signed=True), JointParameter(1e3)]),),
    "gap and square": (
        joint_law(Gap(), [unknown(1e4), JointParameter(1e-3), JointParameter(5.0)]),
        joint_law(Power(1, 1, ["v"]), [unknown(500.0, signed=True)]),
    ),
}  # fmt: skip


@pytest.mark.skipif(not compiled("dynid_law_filter"), reason="dynid was installed without its library of C")
@pytest.mark.parametrize("sigma_points", [False, True])
@pytest.mark.parametrize("name", LAWS)
def test_the_filter_in_c_is_that_in_numpy(name, sigma_points, monkeypatch):
    offset = JointParameter(start=3e-4, true=3e-4, signed=True) if "gap" in name else None
    ends = []
    for wish in ("0", "1"):
        monkeypatch.setenv("DYNID_COMPILED", wish)
        case = likelihood_of(*LAWS[name], offset=offset, samples=10, quantity="acceleration")
        ends.append(passed(case, sigma_points=sigma_points, share=0.01, gaps=True))
    for ours, other in zip(*(end[:4] for end in ends), strict=True):
        assert other == pytest.approx(ours, rel=1e-9, abs=1e-10 * np.abs(ours).max())
    assert ends[1].innovations == pytest.approx(ends[0].innovations, rel=1e-7, abs=1e-9, nan_ok=True)
    assert np.isnan(ends[1].innovations).sum() == 4


@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
def test_a_law_without_force_leaves_the_filter_of_the_linear_model(quantity):
    """That one propagates by matrix exponentials; linearised, both are the same filter."""
    nothing = joint_law(Cubic(), [JointParameter(0.0)])
    got = passed(likelihood_of(nothing, quantity=quantity), sigma_points=False)
    linear = likelihood_of(quantity=quantity)
    (record,) = linear.records
    origin = starts(linear.unknowns)
    prior = wide_prior(record, origin, 0.05)
    assert isinstance(prior, InitialState)
    expected = filter_pass(record.model, record.data.values, prior, 0.02 * record.data.rms, origin, 0.0)
    assert got.eta == pytest.approx(expected.eta, abs=0.02 * expected.deviations.max())
    assert got.deviations == pytest.approx(expected.deviations, rel=0.02)
    assert np.abs(got.states - expected.states).max() < 1e-3 * np.abs(expected.states).max()


@pytest.mark.parametrize("estimator", [Filter(), sigma_point_filter(passes=2)], ids=["filter", "sigma-point"])
@pytest.mark.parametrize(
    ("kind", "noises", "samples"),
    [
        ("cubic", 3, 400),
        pytest.param("cubic", 300, 1600, marks=pytest.mark.slow),
        pytest.param("bouc_wen", 300, 1600, marks=pytest.mark.slow),
    ],
)
def test_estimates_scatter_as_the_bound(kind, noises, samples, estimator):
    case, values, noise, eta, bound = clean_record(kind, samples)
    factors = np.random.default_rng(11).uniform(0.8, 1.2, (noises, len(eta)))
    errors = []
    for seed in range(noises):
        problem = Problem.of(law_model(kind, factors[seed]), measured(case, values, noise, seed))
        likelihood = problem.likelihood
        sweeps = estimator.run(likelihood, starts(likelihood.unknowns)).histories
        errors.append((sweeps[-1][-1].eta[-1] - eta) / bound)
    ratio = np.sqrt(np.mean(np.square(errors), axis=0))
    assert ratio.max() < (1.3 if noises == 300 else 3.0)


def test_a_scene_of_a_filter_ends_with_a_verdict():
    result = identify(law_model("cubic", 1.02), experiment(samples=120), sigma_point_filter())
    assert result.value("identification/diagnostics/optimum")
    assert result.value("identification/diagnostics/passes") == 2


def test_what_the_filter_does_not_follow_is_refused():
    slider = joint_law(Jenkins(), [unknown(3e3), unknown(1.0)])
    likelihood = likelihood_of(slider)
    with pytest.raises(UsageError, match="no slip that begins or ends at once, as of the law 'jenkins'"):
        Filter().run(likelihood, starts(likelihood.unknowns))
    likelihood = likelihood_of(*LAWS["cubic"])
    with pytest.raises(UsageError, match="integrated for a linear model"):
        InvariantImbedding().run(likelihood, starts(likelihood.unknowns))
    stiff = likelihood_of(*LAWS["cubic"], stiff=1e8)
    with pytest.raises(UsageError, match="the fastest mode turns by"):
        Filter().run(stiff, starts(stiff.unknowns))
    linear = likelihood_of()
    with pytest.raises(UsageError, match="for joints with nonlinear laws"):
        sigma_point_filter().run(linear, starts(linear.unknowns))


def test_an_estimate_that_runs_away_is_an_error_with_a_remedy():
    """Sigma points of hysteresis that is known to a factor alone leave the range where it has a force."""
    case = likelihood_of(*LAWS["bouc_wen"], samples=60)
    with pytest.raises(Diverged, match=r"(away from|is lost)") as refused:
        passed(case, sigma_points=True, share=3.0)
    assert refused.value.remedy
