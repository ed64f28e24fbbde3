"""Interchangeable parameters: all optima, what decides, no false pair; against known permutations."""

import re
from itertools import permutations

import numpy as np
import pytest

from dynid.arithmetic.dependent import Dependent
from dynid.identification.diagnosis.symmetry import interchangeable, like_parameters, symmetries
from dynid.identification.identifiability import expected_records, identifiability
from dynid.identification.identify import identify
from dynid.identification.planning.plan import plan
from dynid.identification.problem import Problem
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.records.modal_measurement import ModalMeasurement
from dynid.lti.signals import Multisine
from dynid.parameters import Parameter, ParameterPrior
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.identification.cases import diagnostic, parameter
from tests.sample import sample

pytestmark = pytest.mark.thorough

SINES = Multisine([40.0] * 6, [20.0, 55.0, 90.0, 140.0, 190.0, 260.0])
OPTIMA = "identification/equivalent_optima"


def star(k, c, *, masses=None, starts=None, priors=None, limits=None, known=True, scatter=0.6, seed=0):
    """A mass on a spring, with arms of one mass each; k and c (or k alone) of the arms are unknown."""
    arms, rng = len(k), np.random.default_rng(seed)
    masses = [1.0] * arms if masses is None else masses
    joints = []
    for place in range(arms):
        start = k[place] * np.exp(scatter * rng.uniform(-1, 1)) if starts is None else starts[place]
        low, high = (None, None) if limits is None else limits[place]
        prior = None if priors is None else priors[place]
        stiffness = JointParameter(start=start, true=k[place], low=low, high=high, prior=prior)
        damping = c[place] if known else JointParameter(start=1.3 * c[place], true=c[place])
        joints.append(Joint(f"arm{place + 1}", (1, place + 2), stiffness, damping))
    return lumped([2.0, *masses], [Link((1,), 5e3, 3.0)], joints)


def measured(seed=1, noise=0.05, samples=900, dof=1):
    dofs = [dof] if isinstance(dof, int) else dof
    channels = tuple(Channel(each, "acceleration") for each in dofs)
    return Measurement(0.004, samples, channels, Simulation(noise, seed, 3.0))


def optima(result):
    """Return the estimates of all optima, by permutation of the parameters' names."""
    return result.value(f"{OPTIMA}/estimate")


def assert_permuted(result, k, tolerance=5):
    """All permutations of the true stiffnesses are there, each once, to so many standard errors."""
    names = parameter(result, "name")
    columns = [j for j, name in enumerate(names) if name.endswith(".k")]
    found = optima(result)[:, columns]
    relative = (parameter(result, "standard_error") / parameter(result, "estimate"))[columns].max()
    wanted = np.array(list(permutations(k)))
    assert len(found) == len(wanted)
    for row in wanted:
        assert np.abs(np.log(found / row)).max(axis=1).min() < tolerance * relative


@pytest.mark.parametrize(("arms", "known"), [(2, True), (2, False), (3, True)])
def test_every_optimum_of_equal_arms_is_reported(arms, known):
    k, c = [9e3, 24e3, 55e3][:arms], [2.0, 3.0, 5.0][:arms] if not known else [2.0] * arms
    result = identify(star(k, c, known=known), Experiment([Load(1, SINES)], measured()))
    assert diagnostic(result, "equivalent_optima") == len(list(permutations(k)))
    assert_permuted(result, k)
    assert not diagnostic(result, "converged")
    assert diagnostic(result, "optimum")
    assert diagnostic(result, "verdict").startswith(
        f"NOT converged: {len(optima(result))} optima explain the record"
    )
    assert not known or np.ptp(result.value(f"{OPTIMA}/log_likelihood")) < 1e-6
    (said,) = [text for text in diagnostic(result, "warnings") if "interchangeable" in text]
    first = "arm1.k" if known else "(arm1.k, arm1.c)"
    assert said.startswith(first)
    assert ("a sensor at DOF " if arms == 2 else "sensors at DOF 2 and DOF ") in said
    assert "a prior" in said or "priors" in said
    assert "min or max" in said


def test_stiffness_and_damping_of_a_joint_are_exchanged_together():
    k, c = [9e3, 24e3], [2.0, 6.0]
    result = identify(star(k, c, known=False), Experiment([Load(1, SINES)], measured()))
    own = dict(zip(parameter(result, "name"), optima(result).T, strict=True))
    order = np.argsort(own["arm1.k"])
    np.testing.assert_allclose(own["arm1.c"][order], c, rtol=0.2)
    np.testing.assert_allclose(own["arm2.c"][order], c[::-1], rtol=0.2)
    np.testing.assert_array_equal(own["arm1.k"], own["arm2.k"][::-1])


@pytest.mark.parametrize("seed", sample(range(100), 2, 0, 1))
def test_no_false_pair_where_the_arms_have_different_masses(seed):
    rng = np.random.default_rng([5, seed])
    k = 10 ** rng.uniform(3.8, 4.8, 2)
    masses = [1.0, float(1 + rng.choice([-1, 1]) * rng.uniform(0.1, 0.6))]
    model = star(k, [2.0, 2.0], masses=masses, seed=seed)
    result = identify(model, Experiment([Load(1, SINES)], measured(seed + 1)))
    assert diagnostic(result, "equivalent_optima") == 1
    assert not [text for text in diagnostic(result, "warnings") if "interchangeable" in text]


def test_a_sensor_on_an_arm_decides():
    k = [9e3, 24e3]
    result = identify(star(k, [2.0, 2.0]), Experiment([Load(1, SINES)], measured(dof=2)))
    assert diagnostic(result, "equivalent_optima") == 1
    assert diagnostic(result, "converged")
    np.testing.assert_allclose(parameter(result, "estimate"), k, rtol=0.02)


@pytest.mark.parametrize("starts", [(9e3, 24e3), (24e3, 9e3)])
def test_a_prior_decides_whatever_the_start(starts):
    k = [9e3, 24e3]
    priors = [ParameterPrior(1.1 * k[0], 0.2), None]
    result = identify(
        star(k, [2.0, 2.0], starts=starts, priors=priors), Experiment([Load(1, SINES)], measured())
    )
    np.testing.assert_allclose(parameter(result, "estimate"), k, rtol=0.02)
    assert diagnostic(result, "converged")
    assert diagnostic(result, "equivalent_optima") == 2
    # The exchanged values are worse by the prior alone: by its squares of ln(k2/(1.1 k1)) and ln(1.1).
    sigma2 = np.log1p(0.2**2)
    worse = (np.log(k[1] / k[0] / 1.1) ** 2 - np.log(1.1) ** 2) / (2 * sigma2)
    assert result.value(f"{OPTIMA}/log_posterior")[1] == pytest.approx(-worse, rel=0.05)
    assert "of 2 that explain the record equally well" in diagnostic(result, "verdict")


def test_a_limit_of_one_of_three_leaves_the_others_interchangeable():
    k, c = [8e3, 21e3, 52e3], [2.0, 3.0, 4.5]
    model = star(k, c, known=False, limits=[(1e3, 1.4e4), (None, None), (None, None)])
    result = identify(model, Experiment([Load(1, SINES)], measured()))
    assert diagnostic(result, "equivalent_optima") == 6
    assert len(optima(result)) == 6  # none twice, where a search beside an image ends at another
    assert np.isfinite(result.value(f"{OPTIMA}/log_posterior")).sum() == 2
    assert diagnostic(result, "verdict").startswith("NOT converged: 2 optima explain the record")
    (said,) = [text for text in diagnostic(result, "warnings") if "interchangeable" in text]
    assert said.startswith("(arm2.k, arm2.c) and (arm3.k, arm3.c) are interchangeable: 2 optima")


@pytest.mark.parametrize("arms", [2, 3, 4])
def test_the_named_sensors_decide(arms):
    k = [8e3, 15e3, 29e3, 56e3][:arms]
    model = star(k, [2.0] * arms)
    result = identify(model, Experiment([Load(1, SINES)], measured()))
    (said,) = [text for text in diagnostic(result, "warnings") if "interchangeable" in text]
    named = re.search(r"sensors? at (.*?), (?:a prior|priors)", said)[1].split(" or ")[0]
    dofs = [int(name) for name in re.findall(r"DOF (\d+)", named)]
    dofs = dofs if " and " in named else dofs[:1]
    assert len(dofs) == arms - 1
    more = identify(model, Experiment([Load(1, SINES)], measured(dof=[1, *dofs])))
    assert diagnostic(more, "equivalent_optima") == 1


def test_a_wide_prior_does_not_decide_but_chooses():
    k = [9e3, 24e3]
    priors = [ParameterPrior(k[0], 1.0), None]
    result = identify(
        star(k, [2.0, 2.0], starts=k[::-1], priors=priors), Experiment([Load(1, SINES)], measured())
    )
    np.testing.assert_allclose(parameter(result, "estimate"), k, rtol=0.02)
    assert not diagnostic(result, "converged")
    assert -5 < result.value(f"{OPTIMA}/log_posterior")[1] < 0


def test_a_limit_decides():
    k = [9e3, 24e3]
    limits = [(5e3, 15e3), (None, None)]
    result = identify(
        star(k, [2.0, 2.0], starts=[14e3, 20e3], limits=limits), Experiment([Load(1, SINES)], measured())
    )
    assert diagnostic(result, "converged")
    np.testing.assert_allclose(parameter(result, "estimate"), k, rtol=0.02)


def test_equal_starts_of_interchangeable_parameters_are_no_reason_to_refuse():
    """They are a saddle between two optima, at which their derivatives are the same."""
    k = [9e3, 24e3]
    result = identify(star(k, [2.0, 2.0], starts=[15e3, 15e3]), Experiment([Load(1, SINES)], measured()))
    assert_permuted(result, k)


def test_frequency_responses_and_several_records():
    k = [9e3, 24e3]
    model = star(k, [2.0, 2.0])
    lines = FrfMeasurement(
        np.linspace(20, 300, 80), (Frf(Channel(1, "acceleration"), 1),), Simulation(0.02, 1)
    )
    assert_permuted(identify(model, lines), k)
    apart = FrfMeasurement(
        np.linspace(20, 300, 80), (Frf(Channel(2, "acceleration"), 1),), Simulation(0.02, 1)
    )
    assert diagnostic(identify(model, apart), "equivalent_optima") == 1
    same = [Experiment([Load(1, SINES)], measured(seed)) for seed in (1, 2)]
    assert_permuted(identify(model, same), k)
    other = Experiment([Load(1, SINES)], measured(3, dof=2))
    assert diagnostic(identify(model, [same[0], other]), "equivalent_optima") == 1


def frequencies(k, masses=(2.0, 1.0, 1.0)):
    """Natural frequencies of the star, from its matrices."""
    K = np.diag([5e3 + sum(k), *k]).astype(float)
    K[0, 1:] = K[1:, 0] = -np.array(k)
    root = np.diag(np.array(masses) ** -0.5)
    return np.sqrt(np.linalg.eigvalsh(root @ K @ root))


def test_natural_frequencies_alone():
    k = [9e3, 24e3]
    model = star(k, [2.0, 2.0])
    omega = frequencies(k) * (1 + 1e-3 * np.array([0.5, -0.3, 0.4]))
    result = identify(model, ModalMeasurement(omega, omega_std=1e-3 * omega))
    assert_permuted(result, k, tolerance=8)
    shaped = ModalMeasurement(
        frequencies(k), (1, 2), np.array([[1.0, 1.0, 1.0], [1.3, -0.4, -2.0]]), omega_std=1e-3 * omega
    )
    assert diagnostic(identify(model, shaped), "equivalent_optima") == 1


def test_two_optima_that_no_permutation_relates():
    """A chain of two masses by its frequencies: (k1, k2) and (2 k2, k1/2) have one trace and determinant."""
    k1, k2 = 3e4, 5e3
    joints = [
        Joint("a", (1,), JointParameter(start=2.2e4, true=k1), 1.0),
        Joint("b", (1, 2), JointParameter(start=6e3, true=k2), 1.0),
    ]
    square = np.linalg.eigvalsh(np.array([[k1 + k2, -k2], [-k2, k2]]))
    omega = np.sqrt(square) * (1 + 1e-4 * np.array([1, -1]))
    result = identify(lumped([1.0, 1.0], [], joints), ModalMeasurement(omega, omega_std=1e-3 * omega))
    found = optima(result)[np.argsort(optima(result)[:, 1])]
    np.testing.assert_allclose(found, [[k1, k2], [2 * k2, k1 / 2]], rtol=5e-3)


def test_symmetries_of_nested_groups():
    """Arms of two stages each, and a pair of single masses: 2! 2! permutations from two generators."""
    pairs = [("p", 2, 3), ("q", 4, 5)]
    joints = []
    for name, first, second in pairs:
        joints.append(Joint(f"{name}1", (1, first), JointParameter(start=1e4, true=1e4), 1.0))
        joints.append(Joint(f"{name}2", (first, second), JointParameter(start=2e4, true=2e4), 1.0))
    joints += [Joint(f"s{n}", (1, 5 + n), JointParameter(start=3e4, true=3e4), 1.0) for n in (1, 2)]
    model = lumped([2.0, 1.0, 0.5, 1.0, 0.5, 0.7, 0.7], [Link((1,), 5e3, 3.0)], joints)
    expected = expected_records(Problem.of(model, [Experiment([Load(1, SINES)], measured())]).likelihood)
    names = [one.name for one in model.unknowns]
    found = symmetries(expected.likelihood, like_parameters(model), expected.fit.eta)
    groups = {tuple(map(tuple, sets)) for sets in interchangeable(names, found)}
    assert groups == {(("p1.k", "p2.k"), ("q1.k", "q2.k")), (("s1.k",), ("s2.k",))}


def test_a_parameter_elsewhere_in_the_structure():
    """A mass and a spring on each side, exchanged together although their starts differ in all."""
    true = {"ma": 1.0, "ka": 1e4, "mb": 1.6, "kb": 4e4}
    p = {name: Dependent.parameter(name, value) for name, value in true.items()}
    unknowns = [Parameter(name, 1.2 * value, true=value) for name, value in true.items()]
    links = [Link((1,), 5e3, 3.0), Link((1, 2), p["ka"], 2.0), Link((1, 3), p["kb"], 2.0)]
    model = lumped([2.0, p["ma"], p["mb"]], links, parameters=unknowns)
    result = identify(model, Experiment([Load(1, SINES)], measured()))
    found = optima(result)
    assert len(found) == 2
    np.testing.assert_array_equal(found[1], found[0][[2, 3, 0, 1]])


def test_a_plan_says_it_before_the_measurement():
    """Exact, from the expected values; a prior that excludes the exchanged ones is taken into account."""
    k, group = [9e3, 24e3], "identification/identifiability/interchangeable"
    one = [Experiment([Load(1, SINES)], measured())]
    result = plan(star(k, [2.0, 2.0]), one)
    assert result.value(f"{group}/set").tolist() == ["arm1.k and arm2.k are interchangeable"]
    assert result.value(f"{group}/optima") == result.value(f"{group}/undecided") == 2
    deciding = result.group_attrs[group]["deciding"]
    assert "a sensor at DOF" in deciding
    assert "min or max of arm1.k between 9 000 and 24 000" in deciding
    # A standard deviation of the logarithm of ln(24/9) / sqrt(10) puts the other optimum 5 lower.
    wide = np.sqrt(np.expm1(np.log(24 / 9) ** 2 / 10))
    assert f"relative_deviation: {wide:.2g} or less" in deciding
    priors = [ParameterPrior(k[0], 0.9 * wide), None]
    assert plan(star(k, [2.0, 2.0], priors=priors), one).value(f"{group}/undecided") == 1
    apart = plan(star(k, [2.0, 2.0], masses=[1.0, 1.2]), one)
    assert f"{group}/set" not in apart


def test_frequency_responses_are_explained_alike():
    lines = FrfMeasurement(
        np.linspace(20, 300, 80), (Frf(Channel(1, "acceleration"), 1),), Simulation(0.02, 1)
    )
    result = identifiability(star([9e3, 24e3, 55e3], [2.0] * 3), lines)
    assert result.value("identification/identifiability/interchangeable/optima") == 6
