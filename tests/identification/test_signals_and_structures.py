"""Signals, sensors and structures of all kinds; records without enough information."""

import numpy as np
import pytest

from dynid.errors import Diverged, NotIdentifiable, UsageError
from dynid.identification.estimators.filter_passes import Filter
from dynid.identification.identify import identify
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.lti.signals import Impulse, Multisine, RecordTimes, signal
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.modes import modes
from dynid.structure.ports import Channel, Load
from dynid.structure.response import time_response
from tests.identification.cases import (
    LINKS,
    LOADS,
    MASSES,
    VELOCITIES,
    diagnostic,
    in_bounds,
    parameter,
    recorded,
    run,
    simulated,
    suspension,
    unknown,
)
from tests.sample import sample

RECORD = RecordTimes(0.002, 800)
FORCE = np.random.default_rng(0).standard_normal(800) * 100


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        ("random", {"amplitude": 100, "seed": 3}),
        ("random", {"amplitude": 100, "seed": 3, "band": [20, 400]}),
        ("chirp", {"amplitude": 100, "start": 10, "stop": 300}),
        ("impact", {"amplitude": 1000, "duration": 0.0153}),
        ("impulse", {"amplitude": 10}),
        ("file", {"values": FORCE}),
        ("multisine", {"amplitude": [30] * 12, "frequency": list(range(20, 260, 20))}),
    ],
    ids=["random", "band", "chirp", "impact", "impulse", "file", "many sines"],
)
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_every_signal_identifies(kind, parameters, noise):
    loads = (Load(5, signal(kind, parameters, RECORD)),)
    result = run(measurement=simulated(noise, 1, settle=0.0), loads=loads)
    assert diagnostic(result, "converged")
    if noise:
        assert np.abs(in_bounds(result)).max() < 3.5
    else:
        # Random forces reach the estimator as samples only: the spline hold leaves some 0.005 %.
        assert parameter(result, "error_percent").max() < 0.02


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
def test_every_quantity_identifies(quantity):
    channels = (Channel(2, quantity), Channel(3, quantity))
    assert parameter(run(measurement=simulated(channels=channels)), "error_percent").max() < 1e-3
    result = run(measurement=simulated(0.05, channels=channels))
    assert np.abs(in_bounds(result)).max() < 3
    assert diagnostic(result, "converged")


def test_quantities_may_be_mixed_and_lie_beside_the_force():
    channels = (Channel(5, "acceleration"), Channel(3, "displacement"))
    assert parameter(run(measurement=simulated(channels=channels)), "error_percent").max() < 1e-3


def test_a_stiff_structure_needs_no_smaller_step():
    links = (LINKS[0], Link((1, 2), 2.25e8, 30), LINKS[2])
    model = suspension(links=links)
    assert modes(*model.with_joints(model.true_values())).omega[-1] * 0.002 > 30
    assert parameter(run(model), "error_percent").max() < 1e-4
    assert np.abs(in_bounds(run(model, simulated(0.05)))).max() < 3


def test_no_damping_at_all():
    joints = [Joint("a", (2, 3), unknown(2e4)), Joint("b", (3, 4), unknown(2e4))]
    model = lumped(MASSES, [Link(link.dofs, link.k) for link in LINKS], joints)
    result = run(model, simulated(0.05, settle=0.0))
    assert np.abs(in_bounds(result)).max() < 3
    assert parameter(run(model, simulated(settle=0.0)), "error_percent").max() < 1e-4


def test_a_free_structure_and_a_free_decay():
    joints = [Joint("a", (1, 2), unknown(5e3), unknown(5.0))]
    model = lumped([1, 2], [], joints)
    channels = (Channel(1, "displacement"), Channel(2, "velocity"))
    t = np.arange(300) * 0.005
    true = {"a.k": 5e3, "a.c": 5.0}
    y = time_response(model, [], channels, t, values=true, displacement={1: 0.01}, velocity={2: 0.2})
    result = identify(
        model,
        Experiment([], Measurement(0.005, 300, channels, y.value("structure/time_response/response"))),
        Filter(3),
    )
    # Each pass leaves 1/600, the weight of its prior, of the last one's error.
    assert parameter(result, "error_percent").max() < 1e-4
    assert result.value("identification/measurement/input").shape == (300, 0)


def test_only_joints_with_unknowns_become_parameters():
    joints = [Joint("a", (2, 3), unknown(2e4), 20.0), Joint("b", (3, 4), 2e4, 20.0)]
    result = run(lumped(MASSES, LINKS, joints), simulated(0.05))
    assert list(parameter(result, "name")) == ["a.k"]
    assert np.abs(in_bounds(result)).max() < 3


def test_parallel_joints_are_not_distinguishable():
    joints = [
        Joint("a", (2, 3), unknown(2e4), 20.0),
        Joint("b", (2, 3), unknown(1e4)),
        Joint("c", (3, 4), unknown(2e4), 20.0),
    ]
    result = run(lumped(MASSES, LINKS, joints))
    assert parameter(result, "identifiable").tolist() == [False, False, True]
    assert any("shows only a.k + b.k" in text for text in diagnostic(result, "warnings"))
    assert np.sum(parameter(result, "estimate")[:2]) == pytest.approx(3e4, rel=1e-6)


def test_a_joint_without_motion_is_not_identifiable():
    joints = [Joint("near", (1, 2), unknown(1e4)), Joint("far", (3,), unknown(1e4))]
    model = lumped([1, 1, 1], [Link((1,), 1e4, 5), Link((3,), 1e4, 5)], joints)
    measurement = simulated(settle=0.0, channels=(Channel(1, "velocity"), Channel(2, "velocity")))
    result = run(model, measurement, loads=(Load(2, Multisine([100], [70])),))
    assert parameter(result, "identifiable").tolist() == [True, False]
    assert diagnostic(result, "verdict").startswith("NOT converged: far.k is not identifiable")


@pytest.mark.parametrize("samples", [1, 6])
def test_too_few_samples(samples):
    with pytest.raises(NotIdentifiable, match="fewer values than unknowns") as caught:
        run(measurement=simulated(samples=samples))
    assert caught.value.names == ("j2.k", "j2.c", "j3.k", "j3.c")


def test_a_dead_sensor_is_named():
    values = np.random.default_rng(0).standard_normal((800, 2))
    for dead in (0.0, np.nan):
        values[:, 1] = dead
        with pytest.raises(NotIdentifiable, match=r"3\.velocity"):
            run(measurement=Measurement(0.002, 800, VELOCITIES, values))


def record_at_ten_seconds():
    """A noisy record as a laboratory would hand it over: its own time, its own phases."""
    return recorded(0.05), (Load(5, Multisine([100] * 3, [70, 110, 250], [700, 1100, 2500])),)


@pytest.mark.usefixtures("complete")
def test_measured_values_and_missing_samples():
    y, loads = record_at_ten_seconds()
    complete = run(measurement=Measurement(0.002, 800, VELOCITIES, y), loads=loads)
    np.testing.assert_allclose(
        parameter(complete, "estimate"), parameter(run(measurement=simulated(0.05)), "estimate"), rtol=1e-9
    )
    y = y.copy()
    y[np.random.default_rng(1).random(y.shape) < 0.2] = np.nan
    y[0] = y[100:150] = np.nan
    gaps = run(measurement=Measurement(0.002, 800, VELOCITIES, y), loads=loads)
    assert np.abs(in_bounds(gaps)).max() < 3
    assert np.all(parameter(gaps, "cramer_rao") > parameter(complete, "cramer_rao"))
    kept = gaps.value("identification/measurement/measured")
    np.testing.assert_array_equal(np.isnan(kept), np.isnan(y))
    for path, variable in gaps.items():
        if variable.data.dtype.kind == "f" and not path.endswith(("measured", "/noise_p")):
            assert np.all(np.isfinite(variable.data)), path


def test_unknown_truth_is_nan_and_everything_else_is_not():
    y, loads = record_at_ten_seconds()
    joints = [
        Joint(name, dofs, JointParameter(start=1e4), JointParameter(start=10.0))
        for name, dofs in (("j2", (2, 3)), ("j3", (3, 4)))
    ]
    result = run(lumped(MASSES, LINKS, joints), Measurement(0.002, 800, VELOCITIES, y), loads)
    assert np.isnan(parameter(result, "true")).all()
    assert np.isnan(parameter(result, "error_percent")).all()
    np.testing.assert_allclose(
        parameter(result, "cramer_rao"), parameter(result, "standard_error"), rtol=1e-12
    )
    with pytest.raises(UsageError, match="no true value"):
        run(lumped(MASSES, LINKS, joints))


@pytest.mark.thorough
def test_noise_instead_of_a_record_is_answered_and_rejected():
    noise = np.random.default_rng(0).standard_normal((800, 2))
    result = run(measurement=Measurement(0.002, 800, VELOCITIES, noise))
    assert not diagnostic(result, "converged")
    assert diagnostic(result, "signal_p") > 1e-4
    assert "shows no response" in diagnostic(result, "verdict")


@pytest.mark.thorough
@pytest.mark.usefixtures("poor_starts")
@pytest.mark.parametrize("factor", [1e-6, pytest.param(1e6, marks=pytest.mark.slow)])
def test_a_record_in_wrong_units_is_refused(factor):
    y, loads = record_at_ten_seconds()
    record = Measurement(0.002, 800, VELOCITIES, y * factor)
    said = (
        r"are invalid: .* of 2\.velocity is unexplained" if factor > 1 else "are invalid|away from its start"
    )
    with pytest.raises(Diverged, match=said) as caught:
        run(measurement=record, loads=loads)
    assert caught.value.names
    assert set(caught.value.names) <= {"j2.k", "j2.c", "j3.k", "j3.c"}
    if factor < 1:
        with pytest.raises(Diverged, match="away from its start by a factor of more than 1e6"):
            run(measurement=record, loads=loads, estimator=Filter(2))


@pytest.mark.thorough
@pytest.mark.usefixtures("poor_starts")
def test_a_wrong_excitation_is_refused():
    y, _ = record_at_ten_seconds()
    with pytest.raises(Diverged, match="is unexplained, and the residual is not noise"):
        run(measurement=Measurement(0.002, 800, VELOCITIES, y), loads=LOADS)  # phases of another time


@pytest.mark.thorough
def test_records_may_be_simulated_with_another_structure():
    truth = suspension(links=(LINKS[0], Link((1, 2), 3.3e4, 30), LINKS[2]))
    result = run(truth=truth)
    assert not diagnostic(result, "white")  # 1 % of the record is left, and it is no noise
    assert not diagnostic(run(truth=truth, estimator=Filter(2)), "converged")
    same = run(truth=suspension(0.7))
    assert parameter(same, "error_percent").max() < 1e-4


def test_impulse_while_settling_counts():
    loads = (Load(5, Impulse(5.0)), *LOADS)
    result = run(measurement=simulated(settle=0.3), loads=loads)
    assert parameter(result, "error_percent").max() < 1e-4
    assert list(result.value("identification/measurement/excitation")) == ["5#1", "5#2"]


def test_nonsense_is_refused():
    with pytest.raises(UsageError, match="no parameter is unknown"):
        run(lumped(MASSES, LINKS))
    with pytest.raises(UsageError, match="nothing is measured"):
        run(measurement=Measurement(0.002, 800, ()))
    with pytest.raises(UsageError, match="no DOF 9"):
        run(loads=(Load(9, Multisine([1], [1])),))
    with pytest.raises(UsageError, match="at least one pass"):
        Filter(0)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Simulation(noise_ratio=-0.1),
        lambda: Simulation(settle=-1.0),
        lambda: Simulation(seed=-1),
        lambda: Measurement(0.0, 10, VELOCITIES),
        lambda: Measurement(0.1, 0, VELOCITIES),
        lambda: Measurement(0.1, 10, VELOCITIES + VELOCITIES),
        lambda: Measurement(0.1, 10, VELOCITIES, np.zeros((9, 2))),
        lambda: Measurement(0.1, 10, VELOCITIES, np.full((10, 2), np.inf)),
    ],
)
def test_measurements_must_make_sense(make):
    with pytest.raises(UsageError):
        make()


@pytest.mark.thorough
@pytest.mark.usefixtures("poor_starts")
@pytest.mark.parametrize("start", sample([1e-8, 1e14], 1))
def test_a_filter_that_runs_away_names_the_parameters_it_lost(start):
    joints = [
        Joint("j2", (2, 3), JointParameter(start=start, true=2e4), unknown(20.0)),
        Joint("j3", (3, 4), unknown(2e4), unknown(20.0)),
    ]
    with pytest.raises(Diverged, match=r"are invalid|away from") as caught:
        run(lumped(MASSES, LINKS, joints), simulated(noise_ratio=0.05))
    assert caught.value.names
    assert set(caught.value.names) <= {"j2.k", "j2.c", "j3.k", "j3.c"}
