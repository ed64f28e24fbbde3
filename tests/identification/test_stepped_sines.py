"""Joints identified from stepped sines: exact data, derivatives, errors against the bound, branches.

The oracle of the responses is the long time response of the march from rest, and SciPy's integrator.
"""

import numpy as np
import pytest

from dynid.errors import NumericalError, UsageError
from dynid.identification.estimators.maximum_likelihood import refine
from dynid.identification.identify import identify
from dynid.identification.problem import Problem
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Simulation
from dynid.identification.systems.frf_system import FrfSystem
from dynid.lti.signals import Multisine
from dynid.parameters import coordinates, starts
from dynid.structure.hysteretic_laws import BoucWen, Iwan, Jenkins
from dynid.structure.joint_laws import Cubic, Gap
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.model_laws import joint_law
from dynid.structure.ports import Channel, Load
from dynid.structure.response import time_response

pytestmark = pytest.mark.thorough

LAWS = {
    "cubic": (Cubic(), (4e5,), (0.2, 0.5, 1.0)),
    "jenkins": (Jenkins(), (300.0, 0.5), (0.3, 0.8, 1.5)),
    "gap": (Gap(), (3e3, 3e-3, 1.0), (0.2, 0.5)),
    "iwan": (Iwan(), (300.0, 0.5, -0.3, 0.5), (0.3, 1.5)),
    "bouc_wen": (BoucWen(), (300.0, 60.0, 20.0), (0.3, 1.5)),
}


def model(kind, factor=1.0):
    """Return two masses with a joint between them, whose unknowns start at the true values times a factor."""
    law, numbers, _ = LAWS[kind]
    pairs = zip(law.names, numbers, strict=True)
    parameters = [
        JointParameter(start=factor * true, true=true, signed=name in law.signed) for name, true in pairs
    ]
    joints = [
        Joint(
            "j", (1, 2), JointParameter(start=200 * factor, true=200.0), laws=(joint_law(law, parameters),)
        ),
        Joint("g", (2,), c=JointParameter(start=factor, true=1.0)),
    ]
    return lumped([1.0, 1.2], [Link((1,), 1000.0, 2.0), Link((2,), 500.0)]).joined(joints)


def functions(kind, *sweeps, dofs=(1, 2)):
    sweeps = sweeps or ("up",)
    return tuple(
        Frf(Channel(dof, "acceleration"), 1, "", level, sweep)
        for dof in dofs
        for level in LAWS[kind][2]
        for sweep in sweeps
    )


def measurement(kind, noise, seed=0, lines=20):
    return FrfMeasurement(np.linspace(20.0, 29.0, lines), functions(kind), Simulation(noise, seed))


@pytest.mark.parametrize(
    "kind", [*LAWS][:2] + [pytest.param(kind, marks=pytest.mark.slow) for kind in [*LAWS][2:]]
)
def test_derivatives_of_steady_states_are_differences(kind):
    system, omega = FrfSystem.of(model(kind), functions(kind, dofs=(2,))), np.array([20.0, 22.0, 24.0])
    unknowns, step = model(kind).unknowns, 1e-5
    eta = coordinates(unknowns, np.array([unknown.true for unknown in unknowns]))
    response = system.response(omega, eta)
    for k in range(len(eta)):
        change = step * np.eye(len(eta))[k] * (1.0 if unknowns[k].logarithmic else abs(eta[k]))
        high, low = (system.response(omega, eta + sign * change).values for sign in (1, -1))
        difference = (high - low) / (2 * change[k])
        size = np.abs(difference).max()
        assert response.slopes[..., k] == pytest.approx(difference, abs=2e-5 * size)


@pytest.mark.parametrize(("kind", "error"), [("cubic", 1e-8), ("jenkins", 1e-5)])
def test_a_response_is_that_after_a_long_time(kind, error):
    level, omega, periods, samples = LAWS[kind][2][-1], 23.0, 150, 64
    function = Frf(Channel(2, "velocity"), 1, "", level)
    response = FrfSystem.of(model(kind), [function]).response(np.array([20.0, omega])).values[1, 0]
    times = np.arange(samples * periods + 1) * 2 * np.pi / omega / samples
    load = Load(1, Multisine((level,), (omega,), (np.pi / 2,)))
    at_truth = model(kind)
    values = {unknown.name: unknown.true for unknown in at_truth.unknowns}
    result = time_response(at_truth, [load], [Channel(2, "velocity")], times, values=values)
    last = result["structure/time_response/response"].data[-samples - 1 : -1, 0]
    first = 2 * np.mean(last * np.exp(-1j * omega * times[:samples])) / level
    assert response == pytest.approx(first, rel=error)


def test_exact_responses_give_exact_parameters():
    problem = Problem.of(model("cubic", 0.9), measurement("cubic", 0.0))
    fit, _ = refine(problem.likelihood, starts(model("cubic", 0.9).unknowns))
    true = coordinates(problem.model.unknowns, np.array([u.true for u in problem.model.unknowns]))
    assert fit.eta == pytest.approx(true, rel=1e-8)


@pytest.mark.slow
def test_a_fit_explains_stepped_sines():
    result = identify(model("cubic", 0.85), measurement("cubic", 0.01))
    diagnostics = "identification/diagnostics"
    assert str(result[f"{diagnostics}/verdict"].data).startswith("converged")
    assert "1.acceleration/1 at 0.5 N" in result["identification/measurement/channel"].data
    estimate, true, bound = (
        result[f"identification/parameters/{name}"].data for name in ("estimate", "true", "cramer_rao")
    )
    assert np.all(np.abs(estimate - true) < 4 * bound)


def test_branches_of_both_sweeps_end_at_their_folds():
    m, level = model("cubic"), 2.0
    omega = np.linspace(24.0, 45.0, 43)
    up, down = (
        FrfSystem.of(m, [Frf(Channel(1, "displacement"), 1, "", level, sweep)]).response(omega).values[:, 0]
        for sweep in ("up", "down")
    )
    both = ~np.isnan(up) & ~np.isnan(down)
    assert not np.isnan(up[0])
    assert np.isnan(up).any()
    assert np.isnan(down[0])
    assert both.any()
    assert np.all(np.abs(up[both]) > 2 * np.abs(down[both]))
    # Missing lines of a simulated record are no values; measured lines beyond a fold are refused.
    level_at_fold = FrfMeasurement(omega, (Frf(Channel(1, "displacement"), 1, "", level),), Simulation())
    values = up[:, None].copy()
    values[np.isnan(values)] = 1.0
    with pytest.raises(NumericalError, match="ends at a fold before the measured line"):
        identify(m, FrfMeasurement(omega, level_at_fold.channels, values))


def test_responses_without_an_amplitude_cannot_identify_laws():
    frf = FrfMeasurement(np.linspace(20.0, 29.0, 9), (Frf(Channel(1, "velocity"), 1),), Simulation())
    with pytest.raises(UsageError, match="cannot identify nonlinear laws") as refused:
        identify(model("cubic"), frf)
    assert "'amplitude'" in refused.value.remedy


@pytest.mark.parametrize(
    ("kind", "noises"),
    [pytest.param(kind, 150, marks=pytest.mark.slow) for kind in ("cubic", "jenkins")],
)
def test_errors_are_those_of_the_bound(kind, noises):
    begun = model(kind)
    clean = Problem.of(begun, measurement(kind, 0.01)).likelihood
    values, noise = clean.records[0].data.clean, clean.records[0].data.noise
    lines, eta = len(values) // 2, starts(begun.unknowns)
    ideal = clean.ideal
    bound = ideal.information(ideal.fit(eta), [noise]).deviations()
    errors = []
    for seed in range(noises):
        scatter = noise * np.random.default_rng(seed).standard_normal(values.shape)
        measured = (values + scatter)[:lines] + 1j * (values + scatter)[lines:]
        omega = measurement(kind, 0.01).omega
        problem = Problem.of(begun, FrfMeasurement(omega, functions(kind), measured))
        errors.append(refine(problem.likelihood, eta).fit.eta - eta)
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / bound
    print(kind, ratio)
    assert np.all(ratio <= 1.1 + 1.6 / np.sqrt(2 * noises))
    assert np.all(ratio >= 0.9 - 1.6 / np.sqrt(2 * noises))
