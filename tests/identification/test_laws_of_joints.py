"""Joints with nonlinear laws, identified from records of time: estimates, sensitivities, hidden states."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.errors import NotIdentifiable, UsageError
from dynid.identification.diagnosis.idle_laws import idle_laws
from dynid.identification.estimators.auto import Auto
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.identifiability import identifiability
from dynid.identification.identify import identify
from dynid.identification.likelihood.nonlinear_record import NonlinearRecord, growing
from dynid.identification.planning.plan import plan
from dynid.identification.problem import Problem
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.lti.signals import Multisine
from dynid.report.content import content
from dynid.structure.hysteretic_laws import Iwan, Jenkins
from dynid.structure.joint_laws import Cubic, Gap
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.model_laws import joint_law
from dynid.structure.ports import Channel, Load
from tests.identification.cases import diagnostic, parameter

STEP = 1 / 300
LAWS = {
    "cubic": (Cubic(), {"k3": 2e8}),
    "jenkins": (Jenkins(), {"kt": 3e3, "fs": 1.0}),
    "iwan": (Iwan(), {"kt": 3e3, "fs": 1.0, "chi": -0.5, "beta": 0.5}),
    "gap": (Gap(), {"kg": 2e4, "clearance": 2e-4, "cg": 5.0}),
}


def model(kind, factor=1.0, *, signed=False):
    law, true = LAWS[kind]
    parameters = [JointParameter(start=factor * x, true=x, signed=signed or x < 0) for x in true.values()]
    k, c = (JointParameter(start=factor * x, true=x) for x in (1e4, 4.0))
    bolt = Joint("bolt", (1, 2), k, c, laws=(joint_law(law, parameters),))
    return lumped((1.0, 0.7), (Link((1,), 1.5e4, 5.0),), [bolt])


def experiment(samples, noise=0.0, amplitude=6.0):
    force = Multisine([amplitude] * 4, [60, 85, 120, 170], [0.1, 2.0, 4.0, 5.5])
    channels = (Channel(1, "velocity"), Channel(2, "velocity"))
    return Experiment((Load(2, force),), Measurement(STEP, samples, channels, Simulation(noise, 1)))


def likelihood_of(kind, samples, factor=1.0, **options):
    return Problem.of(model(kind, factor), experiment(samples, **options)).likelihood


def idle(kind, **options):
    likelihood = likelihood_of(kind, 60, **options)
    return list(idle_laws(likelihood, likelihood.fit(truth(likelihood.records[0]))))


def record_of(kind, samples, factor=1.0, **options):
    (record,) = likelihood_of(kind, samples, factor, **options).records
    assert isinstance(record, NonlinearRecord)
    return record


def truth(record):
    return np.array([unknown.coordinate(unknown.true) for unknown in record.unknowns])


@pytest.mark.parametrize("kind", ["cubic", "jenkins"])
def test_derivatives_are_those_of_differences(kind):
    record = record_of(kind, 40)
    eta = truth(record)
    fit = record.fit(eta, record.data.values)
    predicted, start = record.predicted(fit), fit.predicted.start.copy()
    start[: record.model.states] += 1e-3 * np.diag(record.root)[: record.model.states]
    start[record.model.states :] = 0.2
    base, state_slopes = record._prediction(eta, start)
    both = np.concatenate([base.by_state, base.by_parameter], axis=2)
    steps = np.concatenate(
        [1e-6 * np.maximum(np.abs(start), 1e-3), np.where(np.abs(eta) > 30, 1e-6 * eta, 1e-6)]
    )
    for column, step in enumerate(steps):
        ends = []
        for side in (step, -step):
            moved = np.concatenate([start, eta])
            moved[column] += side
            ends.append(record._prediction(moved[len(start) :], moved[: len(start)])[0])
        for name, slopes in (("outputs", both), ("states", state_slopes)):
            difference = (getattr(ends[0], name) - getattr(ends[1], name)) / (2 * step)
            size = np.abs(difference).max()
            assert np.abs(slopes[..., column] - difference).max() < 2e-5 * size, (name, column)
    assert predicted.outputs.shape == base.outputs.shape


def test_a_clean_record_returns_the_truth_and_its_first_states():
    record = record_of("jenkins", 60, amplitude=12.0)
    hidden = np.array([0.6])
    start = np.concatenate([[2e-4, -1e-4, 0.01, 0.02] / record.model.scale, hidden])
    values = record._prediction(truth(record), start)[0].outputs
    fit = record.fit(truth(record), values)
    assert np.abs(fit.residual).max() < 1e-7 * np.abs(values).max()
    assert fit.predicted.start == pytest.approx(start, rel=1e-3, abs=1e-6)


def test_numbers_of_hidden_states_stay_in_their_range():
    record = record_of("jenkins", 40)
    fit = record.fit(truth(record), 30 * record.data.values)
    assert np.abs(fit.predicted.start[record.model.states :]).max() <= 5.0
    assert np.isfinite(fit.residual).all()


def test_output_error_finds_a_cubic_spring():
    problem = model("cubic", 0.95)
    result = identify(problem, experiment(60, 0.01), OutputError())
    error = (parameter(result, "estimate") - parameter(result, "true")) / parameter(result, "standard_error")
    assert np.abs(error).max() < 4
    assert diagnostic(result, "optimum")
    assert parameter(result, "standard_error") == pytest.approx(parameter(result, "cramer_rao"), rel=0.4)
    assert "identification/nonlinearity/p" not in result
    band = result["identification/states/standard_deviation"].data
    assert band.shape == (60, 4)
    assert (band > 0).all()


@pytest.mark.thorough
def test_a_slider_that_sticks_is_named_with_the_excitation_that_moves_it():
    sentences = []
    for amplitude in (0.01, 0.1):
        record = record_of("jenkins", 60, amplitude=amplitude)
        fit = record.fit(truth(record), record.data.values)
        sizes = np.abs(record.predicted(fit).by_parameter).max(axis=(0, 1))
        assert sizes[3] < 1e-6 * sizes[2]  # of the slip force, which does not act, and the spring
        sentences += idle("jenkins", amplitude=amplitude)
    factors = [float(sentence.rpartition("excitation ")[2].split()[0]) for sentence in sentences]
    assert "joint bolt never slips in this record" in sentences[0]
    assert factors[0] == pytest.approx(10 * factors[1], rel=0.1)
    # With that much excitation it slips.
    assert idle("jenkins", amplitude=0.11 * factors[1]) == []


def test_an_iwan_joint_of_which_some_sliders_stick_is_named():
    (sentence,) = idle("iwan", amplitude=0.4)
    assert "joint bolt never slips as a whole in this record" in sentence
    assert "bolt.fs and beta cannot be identified" in sentence
    factor = float(sentence.rpartition("excitation ")[2].split()[0])
    assert idle("iwan", amplitude=0.4 * 1.3 * factor) == []


def test_a_gap_that_stays_open_is_named():
    (sentence,) = idle("gap", amplitude=0.1)
    assert "joint bolt never closes in this record" in sentence


@pytest.mark.thorough
def test_a_plan_has_the_bounds_of_other_amplitudes():
    small = plan(model("jenkins"), [experiment(60, 0.01, amplitude=0.4)])
    bounds = dict(zip(small["plan/amplitude/factor"].data, small["plan/amplitude/bound"].data, strict=True))
    identifiable = "identification/identifiability/relative_bound"
    np.testing.assert_allclose(bounds[1], small[identifiable].data, rtol=1e-6)
    assert np.isinf(bounds[1][[0, 2, 3]]).all()
    assert np.isfinite(bounds[8]).all()
    assert "bolt never slips" in small.group_attrs["identification/identifiability"]["laws"]
    # The same as those of a record with that excitation and this noise.
    noise = small["identification/identifiability/noise/deviation"].data
    large = identifiability(model("jenkins"), [experiment(60, 0.01, amplitude=3.2)])
    ratio = large["identification/identifiability/noise/deviation"].data / noise
    assert ratio == pytest.approx([8, 8], rel=0.3)
    low, high = ratio.min(), ratio.max()
    assert np.all(bounds[8] * low < large[identifiable].data * 1.001)
    assert np.all(bounds[8] * high > large[identifiable].data * 0.999)
    labels = [
        row[0]
        for part in content(small).sections
        if part.title == "Excitation"
        for row in part.blocks[0].rows
    ]
    assert labels == ["× 0.25", "× 0.5", "× 1", "× 2", "× 4", "× 8"]


@pytest.mark.parametrize("signed", [False, True])
def test_relative_bounds_of_a_plan_are_over_values_of_any_sign(signed):
    planned = plan(model("cubic", signed=signed), [experiment(60, 0.01)])
    present = planned["plan/sensors/present_bound"].data
    np.testing.assert_allclose(
        present, planned["identification/identifiability/relative_bound"].data, rtol=1e-6
    )
    assert present[2] == pytest.approx(0.0255, rel=0.01)


@pytest.mark.slow
def test_a_record_that_never_slips_is_refused_with_the_excitation_that_would():
    with pytest.raises(NotIdentifiable, match=r"bolt\.fs cannot be estimated") as refused:
        identify(model("jenkins", 0.98), experiment(60, 0.01, amplitude=0.1), OutputError())
    assert "oint bolt never slips in this record" in refused.value.remedy


def test_parts_of_records_grow():
    likelihood = Problem.of(model("jenkins"), experiment(64)).likelihood
    parts = growing(likelihood, (8, 2))
    assert [len(part.records[0].times) for part in parts] == [18, 32]
    assert np.array_equal(parts[1].records[0].data.values, likelihood.records[0].data.values[:32])


def test_what_superposes_is_refused():
    likelihood = Problem.of(model("cubic"), experiment(30)).likelihood
    assert not likelihood.records[0].superposes
    with pytest.raises(UsageError, match="a delay is unknown"):
        _delayed()


def _delayed():
    from dynid.arithmetic.dependent import Dependent
    from dynid.parameters import Parameter

    late = Parameter("late", 1e-3, scale="linear")
    delayed = replace(model("cubic"), parameters=(late,))
    (load,), measured = experiment(30)
    load = load._replace(delay=Dependent.parameter("late", 1e-3))
    identify(delayed, Experiment((load,), replace(measured, source=np.ones((30, 2)))), OutputError())


@pytest.mark.slow
def test_the_default_estimator_finds_a_slider_from_a_poor_start():
    result = identify(model("jenkins", 0.5), experiment(200, 0.01, 12.0), Auto())
    error = (parameter(result, "estimate") - parameter(result, "true")) / parameter(result, "standard_error")
    assert np.abs(error).max() < 5
