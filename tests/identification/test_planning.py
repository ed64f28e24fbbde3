"""Plans: identifiability before a run, and the sensors and sines with the most information."""

from itertools import combinations

import numpy as np
import pytest

from dynid.arithmetic.dependent import Dependent
from dynid.errors import NotIdentifiable
from dynid.identification.identifiability import expected_records, identifiability
from dynid.identification.information import collinear_groups
from dynid.identification.planning.excitation import candidate_sines, exact_bounds, grid
from dynid.identification.planning.plan import PlanRequest, candidate_sensors, every_channel, plan
from dynid.identification.planning.selection import Candidates, select
from dynid.identification.problem import Problem
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.lti.signals import Multisine, Sine
from dynid.parameters import Parameter
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.identification.cases import (
    LINKS,
    LOADS,
    MASSES,
    VELOCITIES,
    parameter,
    run,
    simulated,
    suspension,
    unknown,
)

GROUP = "identification/identifiability"
CASE = Experiment(LOADS, simulated(0.05))


def test_the_bound_is_that_of_the_run_and_of_the_published_case():
    before = identifiability(suspension(), [CASE])
    bound = before.value(f"{GROUP}/bound")
    np.testing.assert_allclose(bound, parameter(run(measurement=CASE.measurement), "cramer_rao"), rtol=1e-9)
    np.testing.assert_allclose(
        100 * before.value(f"{GROUP}/relative_bound"), [0.17, 1.47, 0.16, 1.03], rtol=0.04
    )
    assert np.all(
        before.value(f"{GROUP}/relative_bound_known_state") < before.value(f"{GROUP}/relative_bound")
    )
    assert before.group_attrs[GROUP] == {"at": "true", "noise": "known"}
    assert before.value(f"{GROUP}/groups/group").size == 0
    sigma = before.value(f"{GROUP}/noise/deviation")
    np.testing.assert_allclose(before.value(f"{GROUP}/noise/bound"), sigma / np.sqrt(1600))


def test_nothing_known_of_noise_and_truth_means_a_nominal_noise_and_the_starts():
    values = run(measurement=simulated(0.05)).value("identification/measurement/measured")
    joints = [Joint("j2", (2, 3), JointParameter(start=1.9e4), JointParameter(start=18.0))]
    model = lumped(MASSES, [*LINKS, Link((3, 4), 2e4, 20)], joints)
    loads = [Load(5, Multisine([100] * 3, [70, 110, 250], [700, 1100, 2500]))]
    found = identifiability(model, [Experiment(loads, Measurement(0.002, 800, VELOCITIES, values))])
    assert found.group_attrs[GROUP] == {"at": "start", "noise": "assumed"}
    rms = np.sqrt(np.mean(values**2, axis=0))
    np.testing.assert_allclose(found.value(f"{GROUP}/noise/deviation"), 0.01 * rms)


def single(omega=17.0, samples=4000, ratio=0.02):
    model = lumped([2.0], [], [Joint("j", (1,), unknown(800.0, 1.0), unknown(30.0, 1.0))])
    measurement = Measurement(0.01, samples, (Channel(1, "velocity"),), Simulation(ratio, 1, 10.0))
    return model, Experiment([Load(1, Sine(5.0, omega))], measurement)


def closed_form(omega, samples, amplitude, sigma):
    """Information of one sine on log k and log c: N A^2 / 2 sigma^2 times that of the complex response."""
    H = 1 / (800 - 2 * omega**2 + 30j * omega)
    g = np.array([-800 * H**2, -30j * omega * H**2]) * 1j * omega
    return samples * amplitude**2 / (2 * sigma**2) * np.real(np.outer(g.conj(), g))


def test_a_sine_in_a_single_mass_has_the_information_of_the_closed_form():
    model, experiment = single()
    expected = expected_records(Problem.of(model, [experiment]).likelihood)
    found = candidate_sines(model, experiment, expected, [1])
    sigma = float(expected.noise[0][0])
    for at in range(0, len(found.omega), 40):
        root = found.roots[at, 0]
        exact = closed_form(found.omega[at], 4000, np.sqrt(2) * found.rms, sigma)
        np.testing.assert_allclose(root.T @ root, exact, rtol=1e-9, atol=1e-12 * exact.max())
    # The record's own: the state costs a few of 4000 samples, and 17 rad/s is no whole number of periods.
    exact = np.sqrt(np.diag(np.linalg.inv(closed_form(17.0, 4000, 5.0, sigma))))
    np.testing.assert_allclose(expected.information().bounds(), exact, rtol=5e-3)


def test_bounds_of_settled_sines_are_those_of_a_record_that_has_settled():
    model, experiment = single()
    expected = expected_records(Problem.of(model, [experiment]).likelihood)
    direct = exact_bounds(model, experiment, expected, [Load(1, Multisine([5.0], [17.0]))])
    np.testing.assert_allclose(direct, expected.information().bounds(), rtol=1e-9)


def test_what_sensors_tell_is_the_information_of_records_with_them():
    expected = expected_records(Problem.of(suspension(), [CASE]).likelihood)
    found = candidate_sensors(suspension(), CASE, expected, every_channel(suspension()))
    assert len(found.channels) == 15
    for names in (
        VELOCITIES,
        (Channel(1, "acceleration"), Channel(4, "displacement"), Channel(5, "velocity")),
    ):
        direct = expected_records(
            Problem.of(suspension(), [Experiment(LOADS, simulated(0.05, channels=names))]).likelihood
        )
        np.testing.assert_allclose(
            found.candidates.bounds(found.places(names)), direct.information().bounds(), rtol=1e-6
        )


def test_the_noise_of_candidates_may_be_given_by_quantity():
    expected = expected_records(Problem.of(suspension(), [CASE]).likelihood)
    found = candidate_sensors(
        suspension(), CASE, expected, every_channel(suspension()), {"acceleration": 0.5}
    )
    for channel, noise, rms in zip(found.channels, found.noise, found.rms, strict=True):
        assert noise == pytest.approx(0.5 if channel.quantity == "acceleration" else 0.05 * rms)


def test_a_sensor_that_sees_no_motion_is_left_out():
    model = lumped([1.0, 1.0], [Link((1,), 100.0, 1.0), Link((2,), 50.0)], [])
    joint = Joint("j", (1,), unknown(100.0), unknown(1.0))
    model = lumped([1.0, 1.0], [Link((2,), 50.0)], [joint])
    experiment = Experiment(
        [Load(1, Sine(1.0, 9.0))], Measurement(0.01, 500, (Channel(1, "velocity"),), Simulation(0.05))
    )
    found = candidate_sensors(
        model, experiment, expected_records(Problem.of(model, [experiment]).likelihood), every_channel(model)
    )
    assert found.still == ("2.displacement", "2.velocity", "2.acceleration")


def designs(seed, nuisance):
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-2, 2, (8, 1, 1))
    return Candidates(scale * rng.standard_normal((8, 2, nuisance + 3)), nuisance)


def determinant(candidates, chosen):
    rows = candidates.roots[list(chosen)].reshape(-1, candidates.roots.shape[2])
    full = candidates.before().T @ candidates.before() + rows.T @ rows
    n = candidates.nuisance
    schur = full[n:, n:] - full[n:, :n] @ np.linalg.pinv(full[:n, :n]) @ full[:n, n:]
    return np.linalg.slogdet(schur)[1]


@pytest.mark.parametrize("seed", range(12))
def test_the_choice_is_the_best_but_for_what_greed_may_lose(seed):
    candidates = designs(seed, 0)
    nothing = candidates.worth([])
    for count in (1, 2, 4):
        best = max(combinations(range(8), count), key=lambda chosen: determinant(candidates, chosen))
        chosen = select(candidates, count)
        assert len(set(chosen)) == count
        found, most = determinant(candidates, chosen), determinant(candidates, best)
        # The oracle squares the condition.
        assert candidates.worth(chosen) == pytest.approx(found, abs=1e-4)
        assert found - nothing >= (1 - 1 / np.e) * (most - nothing)
        assert found <= most + 1e-4
        for out in chosen:  # no exchange of one helps
            for new in set(range(8)) - set(chosen):
                assert determinant(candidates, [*(set(chosen) - {out}), new]) <= found + 1e-4


def test_exchanges_find_what_greed_alone_does_not():
    """The best single candidate is in no best pair."""
    roots = np.array([[[1.0, 1.0], [0, 0.5]], [[1.5, 0.0], [0, 0]], [[0.0, 1.5], [0, 0]]])
    candidates = Candidates(roots, 0)
    assert int(np.argmax(candidates.gains([]))) == 0
    assert sorted(select(candidates, 2)) == [1, 2]


def test_nuisance_is_projected_off():
    candidates = designs(3, 2)
    for chosen in ([0, 1, 2], [4, 5, 6, 7]):
        assert candidates.worth(chosen) == pytest.approx(determinant(candidates, chosen), rel=1e-5)


def test_candidates_that_are_alike_are_chosen_once():
    candidates = Candidates(designs(5, 0).roots, 0, np.array([0, 0, 0, 0, 1, 1, 2, 2]))
    chosen = select(candidates, 8)
    assert len(chosen) == 3
    assert sorted(candidates.alike[chosen]) == [0, 1, 2]


def test_frequencies_have_whole_periods_and_keep_below_half_the_sampling_rate():
    omega = grid(np.array([0.0, 10.0, 30.0, 900.0]), 0.01, 1000)
    periods = omega * 10 / (2 * np.pi)
    np.testing.assert_allclose(periods, np.rint(periods), atol=1e-9)
    assert omega[0] >= 3 - 1
    assert omega[-1] < np.pi / 0.01
    for natural in (10.0, 30.0):
        assert np.abs(omega - natural).min() <= np.pi / 10


# --- collinear parameters ----------------------------------------------------------------------------


def beside(k1=2e4, k2=1e4):
    """Two joints between the same masses."""
    joints = [Joint(name, (2, 3), unknown(k), 10.0) for name, k in (("a", k1), ("b", k2))]
    return lumped(MASSES, [*LINKS, Link((3, 4), 2e4, 20)], joints)


def test_two_joints_side_by_side_show_their_sum_only():
    found = identifiability(beside(), [CASE])
    assert found.value(f"{GROUP}/groups/parameters").tolist() == ["a.k, b.k"]
    assert found.value(f"{GROUP}/groups/seen").tolist() == ["a.k + b.k"]
    assert np.all(np.isinf(found.value(f"{GROUP}/relative_bound")))
    assert not found.value(f"{GROUP}/identifiable").any()
    # What a grows by, b loses: 2e4 da/a = -1e4 db/b.
    blind = found.value(f"{GROUP}/groups/blind")[0]
    assert blind[1] / blind[0] == pytest.approx(-2)
    with pytest.raises(
        NotIdentifiable,
        match=r"a\.k, b\.k cannot be distinguished in this record, which shows only a\.k \+ b\.k",
    ):
        run(beside())


def test_two_joints_in_series_show_the_sum_of_their_compliances():
    """A mass of no weight between them."""
    joints = [Joint("a", (2, 3), unknown(2e4)), Joint("b", (3, 4), unknown(1e4))]
    links = [Link((1,), 2e4, 20), Link((1, 2), 3e4, 30), Link((4, 5), 2e4, 20)]
    model = lumped([2, 2, 1e-7, 1, 1], links, joints)
    channels = (Channel(2, "velocity"), Channel(4, "velocity"))
    found = identifiability(model, [Experiment(LOADS, simulated(0.05, channels=channels))])
    assert found.value(f"{GROUP}/groups/seen").tolist() == ["1/a.k + 1/b.k"]
    assert found.value(f"{GROUP}/condition") > 1e3


def test_a_joint_without_motion_is_named():
    joints = [Joint("a", (1,), unknown(2e4), unknown(20.0)), Joint("b", (2,), unknown(1e4))]
    model = lumped([2, 2], [], joints)
    experiment = Experiment(
        [Load(1, Sine(1.0, 50.0))], Measurement(0.01, 500, (Channel(1, "velocity"),), Simulation(0.05))
    )
    found = identifiability(model, [experiment])
    assert found.value(f"{GROUP}/identifiable").tolist() == [True, True, False]
    assert found.value(f"{GROUP}/groups/group").size == 0


@pytest.mark.parametrize(
    ("gradient", "seen"),
    [
        (np.array([3.0, 5.0]), "a + b"),
        (np.array([3.0, -5.0]), "a - b"),
        (np.array([1 / 3, 1 / 5]), "1/a + 1/b"),
        (np.array([1.0, 1.0]), "ln a + ln b"),
        (np.array([1.0, -1.0]), "ln a - ln b"),
        (np.array([1.0, 0.3]), "1 ln a + 0.3 ln b"),
    ],
)
def test_the_identifiable_combination_of_a_group_is_named(gradient, seen):
    rng = np.random.default_rng(1)
    rows = np.concatenate([np.outer(rng.standard_normal(20), gradient), np.zeros((20, 2))], axis=1)
    rows[:, 2:] = rng.standard_normal((20, 2))
    values = np.array([3.0, 5.0, 1.0, 1.0])  # rates of logarithms, too
    (group,) = collinear_groups(("a", "b", "c", "d"), values, values, rows, 1e-8)
    assert (group.places, group.identifiable) == ((0, 1), seen)
    np.testing.assert_allclose(rows[:, :2] @ group.blind.T, 0, atol=1e-12)


def test_groups_do_not_depend_on_the_vectors_of_the_blind_space():
    rng = np.random.default_rng(2)
    x, y, z = rng.standard_normal((3, 30, 1))
    rows = np.concatenate([x, 2 * x, y, -y, z, 0.5 * x], axis=1)
    values = np.array([1.0, 2.0, 1.0, 1.0, 1.0, 0.5])
    found = collinear_groups(tuple("abcdef"), values, values, rows, 1e-8)
    assert [group.places for group in found] == [(0, 1, 5), (2, 3)]
    assert [group.identifiable for group in found] == ["a + b + f", "c - d"]
    assert [len(group.blind) for group in found] == [2, 1]


# --- plans -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def planned():
    return plan(suspension(), [CASE])


def test_the_best_sensors_are_those_of_all_pairs(planned):
    expected = expected_records(Problem.of(suspension(), [CASE]).likelihood)
    found = candidate_sensors(suspension(), CASE, expected, every_channel(suspension()))
    worth = {pair: found.candidates.worth(pair) for pair in combinations(range(15), 2)}
    best = max(worth, key=worth.get)
    assert set(planned.value("plan/sensors/choice")) == {found.channels[k].name for k in best}
    present = worth[tuple(sorted(found.places(VELOCITIES)))]
    assert planned.value("plan/sensors/efficiency") == pytest.approx(np.exp((present - worth[best]) / 8))


def test_the_present_sensors_stand_beside_the_best(planned):
    np.testing.assert_allclose(
        planned.value("plan/sensors/present_bound"), planned.value(f"{GROUP}/relative_bound"), rtol=1e-6
    )
    assert planned.value("plan/sensors/present").tolist() == ["2.velocity", "3.velocity"]
    assert planned.value("plan/sensors/efficiency") < 1
    assert planned.value("plan/sensors/gain")[0] == np.inf
    assert np.all(np.diff(planned.value("plan/sensors/bound"), axis=0) < 0)


def test_the_best_lines_keep_what_they_promise(planned):
    """A record under them, simulated until it has settled, has the bounds: 58 s are 30 records after 10 s."""
    group = "plan/excitation"
    assert planned.value(f"{group}/choice").size == 3
    frequencies = planned.value(f"{group}/choice_omega")
    assert len(set(frequencies)) == 3
    amplitude = planned.value(f"{group}/amplitude")
    loads = [
        Load(int(dof), Sine(amplitude, omega))
        for dof, omega in zip(planned.value(f"{group}/choice_dof"), frequencies, strict=True)
    ]
    noise = planned.value(f"{GROUP}/noise/deviation")
    expected = expected_records(
        Problem.of(suspension(), [Experiment(loads, simulated(0.05, settle=58.0))]).likelihood
    )
    bounds = expected.likelihood.information(expected.fit, [noise]).bounds()
    np.testing.assert_allclose(bounds, planned.value(f"{group}/best_bound"), rtol=1e-6)
    assert np.all(bounds < planned.value(f"{group}/present_bound"))
    assert planned.value(f"{group}/efficiency") < 1


def test_a_plan_says_how_long_settling_takes(planned):
    # The slowest pole, by itself: real part -0.7239.
    assert planned.value("plan/excitation/settling_time") == pytest.approx(np.log(100) / 0.7239, rel=1e-4)


def test_an_undamped_structure_can_be_planned():
    """No line stands on a pole, and there is no settling time."""
    model = lumped([1.0, 2.0], [Link((1,), 100.0)], [Joint("j", (1, 2), unknown(300.0))])
    measurement = Measurement(0.02, 400, (Channel(2, "velocity"),), Simulation(0.05))
    result = plan(model, [Experiment([Load(1, Sine(1.0, 3.0))], measurement)])
    assert "plan/excitation/settling_time" not in result
    assert np.isfinite(result.value("plan/excitation/best_bound")).all()
    assert np.all(result.value(f"{GROUP}/modal_sensitivity/omega_by_parameter") > 0)


def test_a_free_decay_can_be_planned():
    rng = np.random.default_rng(0)
    t = np.arange(400) * 0.02
    values = (np.exp(-0.3 * t) * np.sin(9 * t) + 0.01 * rng.standard_normal(400))[:, None]
    joint = Joint("j", (1,), JointParameter(start=80.0), JointParameter(start=0.6))
    measurement = Measurement(0.02, 400, (Channel(1, "displacement"),), values)
    result = plan(lumped([1.0], [], [joint]), [Experiment([], measurement)])
    assert np.isfinite(result.value("plan/sensors/bound")).all()
    assert result.value("plan/excitation/choice").size == 3


def test_bands_are_ranked(planned):
    bounds = planned.value("plan/excitation/bands/bound")
    means = np.exp(np.mean(np.log(bounds), axis=1))
    assert len(bounds) == 25
    assert np.argmin(means) < 5
    low, high = planned.value("plan/excitation/bands/low"), planned.value("plan/excitation/bands/high")
    assert np.all(low < high)


def test_what_is_wanted_is_looked_for():
    wanted = PlanRequest(
        sensors=3,
        lines=2,
        candidates=[Channel(4, "velocity"), Channel(5, "velocity")],
        dofs=[1],
        band=(30, 100),
    )
    result = plan(suspension(), [CASE], wanted)
    assert set(result.value("plan/sensors/candidate")) == {
        "2.velocity",
        "3.velocity",
        "4.velocity",
        "5.velocity",
    }
    assert result.value("plan/sensors/choice").size == 3
    assert result.value("plan/excitation/choice_dof").tolist() == ["1", "1"]
    omega = result.value("plan/excitation/choice_omega")
    assert np.all((omega >= 30) & (omega <= 100))


def test_a_record_that_tells_nothing_yet_can_be_planned():
    """Joints side by side stay what they are; a plan says so and does not end."""
    result = plan(beside(), [CASE])
    assert np.all(np.isinf(result.value("plan/sensors/present_bound")))
    assert np.all(np.isinf(result.value("plan/excitation/best_bound")))


def two_masses(scale, *channels, **true):
    """Two masses with a spring and a damper between them, k and c, either of which may be negative."""
    unknowns = [Parameter(name, value, value, scale=scale) for name, value in true.items()]
    k, c = (Dependent.parameter(name, value) for name, value in true.items())
    model = lumped([2.0, 1.0], [Link((1,), 800.0, 5.0), Link((1, 2), k, c)], parameters=unknowns)
    measurement = Measurement(0.02, 300, channels or (Channel(1, "velocity"),), Simulation(0.02, 1))
    return model, Experiment([Load(2, Multisine([5.0, 3.0], [17.0, 31.0]))], measurement)


def test_a_plan_is_the_same_in_logarithms_and_values():
    plans = []
    for scale in ("log", "linear"):
        model, experiment = two_masses(scale, k=2e3, c=3.0)
        plans.append(plan(model, [experiment], PlanRequest(band=(10.0, 40.0))))
    logarithmic, linear = plans
    for path, variable in logarithmic.items():
        if path.startswith("plan/"):
            if variable.data.dtype.kind == "f":
                np.testing.assert_allclose(linear[path].data, variable.data, rtol=1e-6, err_msg=path)
            else:
                assert linear[path].data.tolist() == variable.data.tolist()
    assert np.isfinite(linear.value("plan/excitation/bands/bound")).any()


def test_designs_are_ranked_by_a_parameter_of_value_zero_too():
    model, experiment = two_masses("linear", k=2e3, c=0.0)
    result = plan(model, [experiment], PlanRequest(sensors=2, band=(10.0, 40.0)))
    for bounds in ("sensors/bound", "excitation/best_bound", "excitation/bands/bound"):
        values = result.value(f"plan/{bounds}")
        assert np.all(np.isinf(values[..., 1]))  # nothing is relative to 0
        assert np.isfinite(values[..., 0]).any()
    for group in ("sensors", "excitation"):
        assert np.isfinite(result.value(f"plan/{group}/gain")[1:]).all()
    found = candidate_sensors(
        model, experiment, expected_records(Problem.of(model, [experiment]).likelihood), every_channel(model)
    )
    worths, determinants = [], []
    for names in ((Channel(1, "velocity"),), (Channel(2, "displacement"), Channel(1, "velocity"))):
        record = two_masses("linear", *names, k=2e3, c=0.0)[1]
        direct = expected_records(Problem.of(model, [record]).likelihood).information()
        determinants.append(-np.linalg.slogdet(direct.covariance())[1])
        worths.append(found.candidates.worth(found.places(names)))
    assert np.diff(worths) == pytest.approx(np.diff(determinants), rel=1e-6)


def test_axes_are_there_and_no_number_is_missing(planned):
    for path, variable in planned.items():
        group = path.rpartition("/")[0]
        for dim in variable.dims:
            assert planned[f"{group}/{dim}"].dims == (dim,)
        if variable.data.dtype.kind in "fc":
            assert not np.isnan(variable.data).any(), path
