"""Joints from frequency response functions: exact recovery, error bars, poor initial guesses, refusals."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from dynid import defaults
from dynid.errors import Diverged, NotIdentifiable, Singular, UsageError
from dynid.identification.estimators import multi_start
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.identifiability import identifiability
from dynid.identification.identify import identify
from dynid.identification.likelihood import frf_record
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Simulation
from dynid.identification.systems.frf_system import FrfSystem, frf_data
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel
from tests.identification.cases import LINKS, MASSES, diagnostic, in_bounds, parameter, suspension, unknown
from tests.sample import sample

LINES = np.linspace(10, 300, 200)
CHANNELS = tuple(Frf(Channel(dof, "acceleration"), 5) for dof in (2, 3))


def run(factor=0.5, noise=0.0, seed=1, channels=CHANNELS, omega=LINES, **options):
    """Identify the suspension from its own responses."""
    return identify(suspension(factor), FrfMeasurement(omega, channels, Simulation(noise, seed)), **options)


@cache
def exact(channels=CHANNELS):
    """Responses of the suspension (L x channels), by inverting its matrices one line after the other."""
    model = suspension()
    M, C, K = model.dense(model.true_values())
    out = []
    for w in LINES:
        H = np.linalg.inv(K + 1j * w * C - w**2 * M)
        out.append(
            [(1j * w) ** frf.channel.order * H[frf.channel.dof - 1, frf.force - 1] for frf in channels]
        )
    return np.array(out)


@pytest.mark.usefixtures("complete")
def test_clean_responses_give_the_joints_back_exactly():
    result = run()
    assert parameter(result, "error_percent").max() < 1e-8
    assert diagnostic(result, "verdict") == "converged: optimum found, the model explains the response"


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
def test_responses_are_those_of_the_matrices(quantity):
    channels = (Frf(Channel(2, quantity), 5), Frf(Channel(3, quantity, 1), 4))
    model = suspension()
    found = FrfSystem.of(model, channels).response(LINES).values
    oracle = exact((*channels[:1], Frf(Channel(3, quantity), 4), Frf(Channel(1, quantity), 4)))
    assert found[:, 0] == pytest.approx(oracle[:, 0], rel=1e-11)
    assert found[:, 1] == pytest.approx(oracle[:, 1] - oracle[:, 2], rel=1e-11)


def test_slopes_are_those_of_differences():
    model = suspension()
    eta = np.log(list(model.true_values().values()))
    slopes = FrfSystem.of(model, CHANNELS).response(LINES, eta).slopes
    for k in range(len(eta)):
        step = 1e-5 * np.eye(len(eta))[k]
        two = [FrfSystem.of(model, CHANNELS).response(LINES, eta + sign * step).values for sign in (1, -1)]
        # central differences: truncation and rounding leave about 1e-10 of the largest
        assert slopes[..., k] == pytest.approx((two[0] - two[1]) / 2e-5, abs=1e-8 * np.abs(slopes).max())


def test_a_search_that_nothing_ends_is_cut_off_with_a_remedy(monkeypatch):
    """Responses of no structure: no residuals are noise, and starts end in different places."""
    values = exact() * np.exp(3j * np.sin(np.arange(len(LINES)))[:, None])
    monkeypatch.setattr(frf_record, "_MIN_FRF_EVALUATIONS", 60)
    monkeypatch.setattr(frf_record, "SEARCH_WORK", defaults.Limit(0, ""))
    asked = []
    monkeypatch.setattr(FrfSystem, "response", counting(asked, FrfSystem.response))
    monkeypatch.setattr(multi_start, "AGREEING_STARTS", defaults.Limit(100, ""))
    result = identify(suspension(0.5), FrfMeasurement(LINES, CHANNELS, values))
    assert diagnostic(result, "verdict").startswith("NOT converged: the search was cut off")
    assert re.search(
        "cut off after [0-9]+ evaluations.*start nearer", "\n".join(diagnostic(result, "warnings"))
    )
    assert 60 <= len(asked) < 400  # one attempt goes on to its end


def counting(asked, evaluate):
    """Return a function that notes its calls."""

    def counted(*given, **options):
        asked.append(given)
        return evaluate(*given, **options)

    return counted


@pytest.mark.parametrize("factor", sample([0.01, 0.05, 10, 100], 2))
def test_far_starts_end_at_the_optimum(factor):
    assert np.abs(in_bounds(run(factor, 0.05))).max() < 4


def test_the_bound_is_that_of_the_information_of_complex_values():
    result = run(noise=0.05)
    model = suspension()
    slopes = FrfSystem.of(model, CHANNELS).response(LINES, np.log(list(model.true_values().values()))).slopes
    sigma = 0.05 * np.sqrt(np.mean(np.abs(exact()) ** 2, axis=0))  # of the complex noise
    weighted = (slopes / sigma[:, None]).reshape(-1, 4)
    fisher = 2 * (weighted.conj().T @ weighted).real  # S. M. Kay, Estimation Theory, eq 15.52
    bound = np.sqrt(np.linalg.inv(fisher).diagonal()) * parameter(result, "true")
    assert parameter(result, "cramer_rao") == pytest.approx(bound, rel=1e-9)
    assert parameter(result, "standard_error") == pytest.approx(bound, rel=0.1)


@pytest.mark.slow
def test_intervals_cover_and_the_error_is_the_bound():
    results = [run(1.0, 0.05, seed, omega=LINES[::4]) for seed in range(2000)]
    errors = np.array([in_bounds(result) for result in results])
    inside = [
        np.abs(parameter(r, "estimate") - parameter(r, "true")) < 1.96 * parameter(r, "standard_error")
        for r in results
    ]
    assert np.sqrt(np.mean(errors**2, axis=0)).max() < 1.05
    assert np.mean(inside, axis=0).min() > 0.93
    assert np.mean(inside, axis=0).max() < 0.97


def test_missing_lines_are_left_out():
    values = exact().copy()
    values[::7, 0] = np.nan
    result = identify(suspension(), FrfMeasurement(LINES, CHANNELS, values))
    assert parameter(result, "estimate") == pytest.approx([2e4, 20, 2e4, 20], rel=1e-10)
    assert np.isnan(result["identification/measurement/measured"].data[::7, 0]).all()


def noisy(deviation, seed=0):
    """Return the exact responses with complex noise of this deviation (L x channels)."""
    generator = np.random.default_rng(seed)
    real, imaginary = generator.standard_normal((2, *exact().shape))
    return exact() + deviation * (real + 1j * imaginary) / np.sqrt(2)


def test_deviations_by_line_weigh_the_lines():
    deviation = np.full(exact().shape, 0.01)
    deviation[:100] = 1.0  # below 155 rad/s the sensor was disturbed
    measured = FrfMeasurement(LINES, CHANNELS, noisy(deviation), deviation=deviation)
    given, estimated = (
        identify(suspension(0.9), case, OutputError())
        for case in (measured, replace(measured, deviation=None))
    )
    worse = parameter(estimated, "standard_error") / parameter(given, "standard_error")
    assert worse.min() > 3
    errors = parameter(given, "estimate") - [2e4, 20, 2e4, 20]
    assert np.abs(errors / parameter(given, "standard_error")).max() < 4
    assert diagnostic(given, "white")


def test_of_deviations_known_up_to_a_factor_the_factor_is_estimated():
    deviation = np.full(exact().shape, 0.01)
    deviation[:100] = 0.3
    case = FrfMeasurement(LINES, CHANNELS, noisy(deviation), deviation=deviation)
    known = parameter(identify(suspension(), case), "standard_error")
    ratio = replace(case, deviation=50 * deviation, relative=True)
    assert parameter(identify(suspension(), ratio), "standard_error") == pytest.approx(known, rel=0.15)


def test_a_model_that_is_wrong_is_said_to_be():
    stiffer = (Link((1,), 2.4e4, 20), *LINKS[1:])
    truth = suspension(links=stiffer)
    case = FrfMeasurement(LINES[::4], CHANNELS, Simulation(0.01, 1))
    result = identify(suspension(), case, OutputError(), truth=truth)
    assert not diagnostic(result, "converged")
    assert "NOT converged" in diagnostic(result, "verdict")
    [coloured] = [said for said in diagnostic(result, "warnings") if said.startswith("the residuals of")]
    assert "2.acceleration/5 (" in coloured
    assert "are not white noise" in coloured


@pytest.mark.usefixtures("complete", "poor_starts")
def test_units_that_are_wrong_leave_nothing_explained():
    with pytest.raises(Diverged, match="invalid"):  # accelerances that are given as receptances
        identify(
            suspension(),
            FrfMeasurement(LINES, tuple(Frf(Channel(dof, "displacement"), 5) for dof in (2, 3)), exact()),
        )


def test_a_dead_response_is_named():
    values = exact().copy()
    values[:, 1] = 0
    with pytest.raises(NotIdentifiable, match=r"3\.acceleration/5 is nothing but zeros"):
        identify(suspension(), FrfMeasurement(LINES, CHANNELS, values))


def test_what_the_responses_cannot_see_is_named():
    joints = [Joint("seen", (2, 3), unknown(2e4), unknown(20.0)), Joint("apart", (6,), unknown(1e4), None)]
    links = (*LINKS, Link((3, 4), 2e4, 20), Link((6,), 1e3, 1))
    model = lumped((*MASSES, 1), links, joints)
    result = identify(model, FrfMeasurement(LINES, CHANNELS, Simulation(0.01)))
    assert diagnostic(result, "verdict").startswith("NOT converged: apart.k is not identifiable")
    assert parameter(result, "identifiable").tolist() == [True, True, False]
    assert parameter(result, "estimate")[2] == parameter(result, "start")[2]
    errors = (parameter(result, "estimate") - parameter(result, "true")) / parameter(result, "standard_error")
    assert np.abs(errors[:2]).max() < 4


def test_parameters_that_act_as_one_are_named():
    joints = [Joint(name, (2, 3), unknown(1e4), None) for name in ("one", "other")]
    model = lumped(MASSES, (*LINKS, Link((3, 4), 2e4, 20)), joints)
    with pytest.raises(NotIdentifiable, match=r"one\.k, other\.k cannot be distinguished"):
        identify(model, FrfMeasurement(LINES, CHANNELS, Simulation(0.01)))


def test_a_line_on_an_undamped_pole_is_refused():
    model = lumped((1,), (), [Joint("spring", (1,), JointParameter(start=50.0, true=100.0))])
    at_pole = FrfMeasurement(np.array([5.0, 10.0, 20.0]), (Frf(Channel(1, "displacement"), 1),))
    with pytest.raises(Singular, match="10 rad/s"):
        identify(model, at_pole)


def test_an_undamped_structure_is_identified_between_its_poles():
    model = lumped((1,), (), [Joint("spring", (1,), JointParameter(start=50.0, true=100.0))])
    beside = FrfMeasurement(np.array([5.0, 9.0, 20.0]), (Frf(Channel(1, "displacement"), 1),))
    assert parameter(identify(model, beside), "estimate") == pytest.approx([100], rel=1e-10)


def test_a_prior_and_a_bound_count():
    c = JointParameter(start=10, true=20.0, low=5, high=15)
    joints = [Joint("j2", (2, 3), unknown(2e4), c), Joint("j3", (3, 4), unknown(2e4), unknown(20.0))]
    result = identify(
        lumped(MASSES, LINKS, joints), FrfMeasurement(LINES[::4], CHANNELS, Simulation(0.01, 1))
    )
    assert parameter(result, "estimate")[1] == pytest.approx(15)
    assert parameter(result, "at_bound").tolist() == [False, True, False, False]


def test_lines_that_do_not_increase_are_refused():
    with pytest.raises(UsageError, match="increase"):
        FrfMeasurement(np.array([1.0, 3.0, 2.0]), CHANNELS)


def test_what_is_too_large_to_solve_is_refused_with_the_remedy():
    masses = [1.0] * 600
    links = [Link((k, k + 1), 1e4, 1) for k in range(1, 600)]
    model = lumped(masses, links, [Joint("foot", (1,), unknown(1e4), unknown(1.0))])
    with pytest.raises(UsageError, match="too many to solve") as refusal:
        identify(model, FrfMeasurement(LINES, CHANNELS, Simulation(0.01)))
    assert "Reduce the structure" in refusal.value.remedy


def test_before_the_run_the_information_is_that_of_the_run():
    measurement = FrfMeasurement(LINES, CHANNELS, Simulation(0.05, 1))
    result = identifiability(suspension(), measurement)
    found = result["identification/identifiability/bound"].data
    assert found == pytest.approx(parameter(run(noise=0.05), "cramer_rao"), rel=1e-9)


GIVEN = np.ones((3, 2), complex)
SPREAD = np.ones((3, 2))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"channels": CHANNELS[:1] * 2}, r"2\.acceleration/5 is named twice"),
        ({"source": GIVEN[:2]}, r"measured responses are \(2, 2\), but must be \(3, 2\)"),
        ({"source": np.full((3, 2), np.inf)}, "must be finite, or NaN where a line is missing"),
        ({"deviation": SPREAD[:, :1]}, r"deviations by line are \(3, 1\), but must be \(3, 2\)"),
        ({"deviation": -SPREAD}, "deviations by line must be finite and not negative"),
        ({"deviation": SPREAD, "source": Simulation(0.1)}, "the same noise at all lines"),
        ({"deviation": SPREAD, "noise": 0.1}, "the noise is given by line already"),
        ({"omega": np.array([1.0, 3.0, 2.0])}, "must be finite, not negative, and increase"),
    ],
)
def test_a_measurement_that_makes_no_sense_is_refused(changes, said):
    whole = {"omega": np.array([1.0, 2.0, 3.0]), "channels": CHANNELS, "source": GIVEN}
    FrfMeasurement(**whole)
    with pytest.raises(UsageError, match=said):
        FrfMeasurement(**{**whole, **changes})


def test_complex_noise_has_half_of_its_power_in_each_part():
    data = frf_data(suspension(), FrfMeasurement(LINES, CHANNELS, Simulation(noise=(2.0, 4.0), seed=1)))
    assert data.noise == pytest.approx(np.array([2.0, 4.0]) / np.sqrt(2))
