"""Structures with unknowns of any kind, identified: bounds, groups that no record separates, tied joints."""

import math

import numpy as np
import pytest

from dynid.arithmetic.dependent import Dependent
from dynid.errors import NotIdentifiable
from dynid.identification.estimators.auto import Auto
from dynid.identification.identifiability import identifiability
from dynid.identification.identify import identify
from dynid.identification.problem import Problem
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.lti.signals import Chirp, Multisine
from dynid.parameters import Parameter, coordinates, starts, truths
from dynid.structure.assembly import PointMass, Support
from dynid.structure.damping import ProportionalDamping
from dynid.structure.frame import beam
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.identification.cases import parameter
from tests.sample import sample

pytestmark = pytest.mark.thorough

TRUE = {"EI": 1700.0, "rhoA": 0.1, "m": 0.2, "turn.k": 5e3, "link.k": 1e4, "link.c": 20.0}
LOADS = [Load("w_4", Multisine([50] * 6, [9, 25, 60, 110, 190, 320]))]
CHANNELS = {
    "acceleration": (Channel("w_4", "acceleration"), Channel("w_6", "acceleration")),
    "velocity": (Channel("w_4", "velocity"), Channel("w_6", "velocity")),
}


def numbers(true, factor=1.0, **more):
    """Unknown parameters off by a factor, and the numbers that they are."""
    parameters = [Parameter(name, factor * value, value, **more) for name, value in true.items()]
    return {name: Dependent.parameter(name, value) for name, value in true.items()}, parameters


def joint(name, dofs, factor, **true):
    return Joint(
        name, dofs, **{letter: JointParameter(start=factor * x, true=x) for letter, x in true.items()}
    )


def unknown_beam(factor=1.0):
    """Yang's second example with EI, rhoA, a mass and both joints unknown."""
    p, parameters = numbers({name: TRUE[name] for name in ("EI", "rhoA", "m")}, factor)
    joints = [joint("turn", ("theta_1",), factor, k=5e3), joint("link", ("w_6",), factor, k=1e4, c=20.0)]
    return beam(
        7, 7.0, p["EI"], p["rhoA"], supports=[Support(1, ("w",))], masses=[PointMass(3, p["m"])],
        damping=ProportionalDamping(0.1), joints=joints, parameters=parameters,
    )  # fmt: skip


def errors_over_bounds(channels, seeds, factor=1.0):
    """Errors of the coordinates over their Cramér–Rao bounds (seeds x p)."""
    found = []
    for seed in seeds:
        measurement = Measurement(0.002, 400, CHANNELS[channels], Simulation(0.02, seed))
        likelihood = Problem.of(unknown_beam(factor), [Experiment(LOADS, measurement)]).likelihood
        true = coordinates(likelihood.unknowns, truths(likelihood.unknowns))
        fit = Auto().run(likelihood, starts(likelihood.unknowns)).fit
        bound = likelihood.information(likelihood.at_truth, [likelihood.records[0].data.noise]).deviations()
        found.append((fit.eta - true) / bound)
    return np.array(found)


def assert_bound_met(errors):
    """RMS over the bound is 1 within the scatter of sampling, and 95 % lie within 1.96 of it."""
    count = errors.size / errors.shape[1]
    rms = np.sqrt(np.mean(errors**2, axis=0))
    assert np.all(np.abs(rms - 1) < 3.5 / math.sqrt(2 * count)), rms
    inside = np.mean(np.abs(errors) < 1.96)
    assert abs(inside - 0.95) < 3 * math.sqrt(0.05 * 0.95 / count)


@pytest.mark.parametrize("channels", sample(CHANNELS, 1))
def test_a_beam_with_six_unknowns_is_found_from_poor_starts(channels):
    assert_bound_met(errors_over_bounds(channels, range(1, 9), 1.7))


@pytest.mark.slow
def test_a_beam_with_six_unknowns_meets_the_bound():
    """`pytest -m slow -k meets_the_bound tests/identification/test_unknown_structures.py`: accelerations."""
    assert_bound_met(errors_over_bounds("acceleration", range(1, 201), 1.5))


# --- what cannot be separated ----------------------------------------------------------------------------


def test_a_common_factor_of_all_matrices_and_an_unknown_force_is_a_group():
    true = {"m": 2.0, "k": 300.0, "c": 1.5, "g": 1.2}
    p, parameters = numbers(true)
    model = lumped([p["m"]], [Link((1,), p["k"], p["c"])], parameters=parameters)
    measurement = Measurement(0.02, 300, (Channel(1, "velocity"),), Simulation(0.01, 1))
    loads = [Load(1, Chirp(10.0, 3.0, 30.0, 6.0), gain=p["g"])]
    words = r"m, k, c, g cannot be distinguished in this record, which shows only m/g, k/g, c/g"
    with pytest.raises(NotIdentifiable, match=words) as raised:
        identify(model, Experiment(loads, measurement))
    assert set(raised.value.names) == set(true)
    found = identifiability(model, [Experiment(loads, measurement)])
    group = "identification/identifiability/groups"
    assert found.value(f"{group}/parameters").tolist() == ["m, k, c, g"]
    np.testing.assert_allclose(np.abs(found.value(f"{group}/blind")), [[0.5] * 4], rtol=1e-6)


def test_length_and_stiffness_of_a_beam_without_mass_are_a_group():
    """A static spring EI/L^3: a light cantilever under a mass shows one combination of EI and L."""
    p, parameters = numbers({"EI": 200.0, "L": 2.0})
    light = 1e-12
    model = beam(
        1, p["L"], p["EI"], light, supports=[Support(1, ("w", "theta"))], masses=[PointMass(2, 3.0, 1e-9)],
        damping=ProportionalDamping(0.5), parameters=parameters,
    )  # fmt: skip
    measurement = Measurement(0.05, 200, (Channel("w_2", "displacement"),), Simulation(0.01, 1))
    found = identifiability(model, [Experiment([Load("w_2", Chirp(10.0, 1.0, 10.0, 10.0))], measurement)])
    group = "identification/identifiability/groups"
    blind = found.value(f"{group}/blind")
    np.testing.assert_allclose(blind[0, 0] / blind[0, 1], 3, rtol=1e-3)


# --- tied joints -----------------------------------------------------------------------------------------


def tied(shared, factor=0.6):
    """Two masses on two equal springs to ground far apart; one unknown, or two."""
    true = {"kb": 3e3} if shared else {"ka": 3e3, "kc": 3e3}
    p, parameters = numbers(true, factor)
    first, second = (p["kb"], p["kb"]) if shared else (p["ka"], p["kc"])
    joints = [Joint("one", (1,), first), Joint("two", (2,), second)]
    return lumped([1.0, 2.0], [Link((1,), 1e2, 1.0), Link((2,), 1e2, 2.0)], joints, parameters=parameters)


def test_tied_joints_give_one_estimate_with_the_information_of_both():
    """Independent oscillators: the information of the shared stiffness is the sum of those of two."""
    loads = [Load(1, Chirp(10.0, 20.0, 90.0, 2.0)), Load(2, Chirp(10.0, 20.0, 90.0, 2.0))]
    channels = (Channel(1, "velocity"), Channel(2, "velocity"))
    measurement = Measurement(0.005, 400, channels, Simulation(0.03, 4))
    one, two = (identify(tied(shared), Experiment(loads, measurement)) for shared in (True, False))
    separate, bar = parameter(two, "cramer_rao"), parameter(one, "cramer_rao")
    assert bar[0] < separate.min()
    np.testing.assert_allclose(bar[0] ** -2, np.sum(separate**-2.0), rtol=1e-9)
    assert abs(parameter(one, "estimate")[0] - 3e3) < 3 * bar[0]
    weights = parameter(two, "standard_error") ** -2.0
    mean = float(weights @ parameter(two, "estimate") / weights.sum())
    assert parameter(one, "estimate")[0] == pytest.approx(mean, abs=0.1 * bar[0])
