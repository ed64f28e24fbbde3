"""Joints identified from backbones: points against other solutions, derivatives, exact data, the bound."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve
from scipy.special import ellipk

from dynid.errors import NumericalError, UsageError
from dynid.identification.estimators.maximum_likelihood import refine
from dynid.identification.identify import identify
from dynid.identification.problem import Problem
from dynid.identification.records.modal_measurement import NO_ERROR, Backbone, ModalMeasurement
from dynid.parameters import coordinates, starts
from dynid.structure.hysteretic_laws import BoucWen, Iwan, Jenkins
from dynid.structure.joint_laws import Cubic, Gap
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.model_laws import joint_law
from dynid.structure.nonlinear.backbone_points import Backbones, Place, backbone_points
from dynid.structure.ports import Channel

pytestmark = pytest.mark.thorough

#: Laws, their numbers, and the least and largest amplitude of the first harmonic, m.
LAWS = {
    "cubic": (Cubic(), (4e5,), (2e-3, 3e-2)),
    "jenkins": (Jenkins(), (300.0, 0.5), (1e-3, 1e-2)),
    "gap": (Gap(), (3e3, 3e-3, 1.0), (1e-3, 1e-2)),
    "iwan": (Iwan(), (300.0, 0.5, -0.3, 0.5), (1e-4, 1e-2)),
    "bouc_wen": (BoucWen(), (300.0, 60.0, 20.0), (1e-3, 3e-2)),
}
POINTS = 6


def joined(structure, kind, factor=1.0, dofs=(1, 2)):
    """Return a structure with a joint of a law, whose unknowns start at the true values times a factor."""
    law, numbers, _ = LAWS[kind]
    pairs = zip(law.names, numbers, strict=True)
    parameters = [
        JointParameter(start=factor * true, true=true, signed=name in law.signed) for name, true in pairs
    ]
    stiffness = JointParameter(start=200 * factor, true=200.0)
    return structure.joined([Joint("j", dofs, stiffness, laws=(joint_law(law, parameters),))])


def masses(kind, factor=1.0):
    return joined(lumped([1.0, 1.2], [Link((1,), 1000.0, 2.0), Link((2,), 500.0, 1.0)]), kind, factor)


def true_values(model):
    return {unknown.name: unknown.true for unknown in model.unknowns}


def points(model, values, amplitudes, modes, *, dof=2, order=0, backbones=None):
    place = Place(model.row(dof), order)
    names = [unknown.name for unknown in model.unknowns]
    return backbone_points(
        model, values, names, place, np.asarray(amplitudes), np.asarray(modes), 25.0,
        backbones or Backbones(),
    )  # fmt: skip


def survey(kind, noise=0.0, seed=0):
    """Return two backbones of two masses, whose scatter is `noise` of frequencies, 20 times of damping."""
    model, levels = masses(kind), np.geomspace(*LAWS[kind][2], POINTS)
    amplitude, mode = np.tile(levels, 2), np.repeat([0, 1], POINTS)
    exact = points(model, true_values(model), amplitude, mode)
    random = np.random.default_rng(seed)
    omega = exact.omega * (1 + noise * random.standard_normal(2 * POINTS))
    damping = exact.damping * (1 + 20 * noise * random.standard_normal(2 * POINTS))
    size = noise or 1e-3
    return ModalMeasurement(
        omega,
        damping=damping,
        omega_std=size * exact.omega,
        damping_std=20 * size * exact.damping,
        floors=NO_ERROR,
        backbone=Backbone(Channel(2, "displacement"), amplitude, mode.astype(float)),
    )


def test_a_duffing_oscillator_has_the_frequency_of_elliptic_functions():
    k, k3, c = 1200.0, 4e5, 2.0  # 1000 and 200 N/m
    model = joined(lumped([1.0], [Link((1,), 1000.0, c)]), "cubic", dofs=(1,))
    peak = np.array([0.03, 0.003, 0.1])
    stiffness = k + k3 * peak**2
    m = k3 * peak**2 / (2 * stiffness)
    K = ellipk(m)
    omega = np.pi / 2 * np.sqrt(stiffness) / K
    nome = np.exp(-np.pi * ellipk(1 - m) / K)
    first = peak * 2 * np.pi / (np.sqrt(m) * K) * np.sqrt(nome) / (1 + nome)  # of cn
    for order in range(3):
        found = points(model, true_values(model), first * omega**order, [0, 0, 0], dof=1, order=order)
        assert found.omega == pytest.approx(omega, rel=1e-9)
        assert found.damping == pytest.approx(c / (2 * omega), rel=1e-9)


def test_a_slider_damps_as_in_a_time_integration():
    kt, limit = 300.0, 0.5
    model = joined(lumped([1.0], [Link((1,), 1000.0, 2.0)]), "jenkins", dofs=(1,))
    amplitude = 4e-3
    found = points(model, true_values(model), [amplitude], [0], dof=1)
    omega, growth = found.omega[0], 2 * found.omega[0] * found.damping[0]

    def march(peak, growth):
        slips_at = peak - 2 * limit / kt

        def rate(slipping):
            def of(_, y):
                force = -limit if slipping else limit + kt * (y[0] - peak)
                return [y[1], -1200.0 * y[0] - force - (2.0 - growth) * y[1]]

            return of

        def slips(_, y):
            return y[0] - slips_at

        def stops(_, y):
            return y[1]

        slips.terminal = stops.terminal = True
        stops.direction = 1
        options = {"rtol": 1e-11, "atol": 1e-15, "method": "DOP853", "dense_output": True}
        stick = solve_ivp(rate(False), (0.0, 1.0), [peak, 0.0], events=slips, **options)
        slip = solve_ivp(rate(True), (stick.t[-1], 1.0), stick.y[:, -1], events=stops, **options)
        return stick, slip

    def first_harmonic(stick, slip):
        total, nodes, weights = 0.0, *np.polynomial.legendre.leggauss(40)
        period = 2 * slip.t[-1]
        for part in (stick, slip):
            middle, width = (part.t[0] + part.t[-1]) / 2, (part.t[-1] - part.t[0]) / 2
            t = middle + width * nodes
            turn = np.exp(-2j * np.pi * t / period)
            total += 4 / period * width * weights @ (part.sol(t)[0] * turn)
        return abs(total)

    def missing(unknowns):
        stick, slip = march(unknowns[0] * 1e-3, unknowns[1])
        return [1e3 * slip.y[0, -1] + unknowns[0], 1e3 * (first_harmonic(stick, slip) - amplitude)]

    peak, expected = fsolve(missing, [4.0, growth * 0.9], xtol=1e-11)
    _, slip = march(peak * 1e-3, expected)
    assert omega == pytest.approx(np.pi / slip.t[-1], rel=1e-7)
    assert growth == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    "kind", [*LAWS][:2] + [pytest.param(kind, marks=pytest.mark.slow) for kind in [*LAWS][2:]]
)
def test_derivatives_are_differences(kind):
    model = masses(kind)
    values, levels = true_values(model), np.geomspace(*LAWS[kind][2], 3)
    amplitude, mode = np.tile(levels, 2), np.repeat([0, 1], 3)
    found = points(model, values, amplitude, mode)
    for k, name in enumerate(values):
        step = 1e-5 * abs(values[name])
        high, low = (
            points(model, values | {name: values[name] + sign * step}, amplitude, mode) for sign in (1, -1)
        )
        for exact, ends in (
            (found.omega_slopes, (high.omega, low.omega)),
            (found.damping_slopes, (high.damping, low.damping)),
        ):
            difference = np.subtract(*ends) / (2 * step)
            assert exact[:, k] == pytest.approx(difference, rel=1e-4, abs=1e-4 * np.abs(difference).max())


def test_what_is_continued_is_what_is_followed_from_small_amplitudes():
    model = masses("jenkins")
    values, backbones = true_values(model), Backbones()
    amplitude, mode = np.geomspace(*LAWS["jenkins"][2], 4), np.ones(4, dtype=int)
    points(model, values, amplitude, mode, backbones=backbones)
    moved = values | {"j.fs": 0.55, "j.kt": 280.0}
    continued, followed = (points(model, moved, amplitude, mode, backbones=b) for b in (backbones, None))
    assert continued.omega == pytest.approx(followed.omega, rel=1e-7)
    assert continued.damping == pytest.approx(followed.damping, rel=1e-6)


@pytest.mark.parametrize(("kind", "error"), [("cubic", 1e-8), ("jenkins", 1e-6)])  # to their harmonics
def test_exact_backbones_give_exact_parameters(kind, error):
    problem = Problem.of(masses(kind, 0.9), survey(kind))
    fit, _ = refine(problem.likelihood, starts(problem.model.unknowns))
    true = coordinates(problem.model.unknowns, np.array([u.true for u in problem.model.unknowns]))
    assert fit.eta == pytest.approx(true, rel=error, abs=error)


def test_a_fit_explains_a_backbone_and_says_what_was_measured():
    measured = survey("cubic", 1e-3, 2)
    unnumbered = measured.backbone._replace(mode=np.full(2 * POINTS, np.nan))
    result = identify(masses("cubic", 0.85), measured)
    group = "identification/modes"
    assert result["identification/diagnostics/verdict"].data == (
        "converged: optimum found, the model explains the backbone"
    )
    assert result[f"{group}/amplitude"].data == pytest.approx(measured.backbone.amplitude)
    assert list(result[f"{group}/model_mode"].data) == [1] * POINTS + [2] * POINTS
    estimate, true, bound = (
        result[f"identification/parameters/{name}"].data for name in ("estimate", "true", "cramer_rao")
    )
    assert np.all(np.abs(estimate - true) < 4 * bound)
    # Without numbers the points are of the modes nearest in frequency.
    near = Problem.of(masses("cubic", 0.85), ModalMeasurement(measured.omega, backbone=unnumbered))
    assert list(near.measurements[0].backbone.mode[:POINTS]) == [0] * POINTS


def test_backbones_of_structures_without_them_are_refused():
    measured = survey("cubic")
    linear = lumped([1.0, 1.2], [Link((1,), 1000.0, 2.0), Link((2,), 500.0)])
    linear = linear.joined([Joint("j", (1, 2), JointParameter(start=200.0))])
    with pytest.raises(UsageError, match="no joint has a law"):
        identify(linear, measured)
    with pytest.raises(UsageError, match="cannot identify nonlinear laws"):
        identify(masses("cubic"), ModalMeasurement(measured.omega))
    model = masses("cubic")
    values = true_values(model)
    with pytest.raises(UsageError, match="no mode 3"):
        points(model, values, [1e-3], [2])
    symmetric = joined(lumped([1.0, 1.0], [Link((1,), 500.0, 1.0), Link((2,), 500.0, 1.0)]), "cubic")
    centre = Place(symmetric.row(1) + symmetric.row(2))
    with pytest.raises(UsageError, match="does not move the place"):
        backbone_points(
            symmetric, values, [*values], centre, np.array([1e-3]), np.array([1]), 30.0, Backbones()
        )


def test_an_amplitude_that_cannot_be_reached_is_an_error():
    # A spring that softens to nothing at 0.0548 m, where the motion is a square: 4 / pi times that.
    model = joined(lumped([1.0], [Link((1,), 1000.0, 2.0)]), "cubic", dofs=(1,))
    values = true_values(model) | {"j.k3": -4e5}
    with pytest.raises(NumericalError, match=r"cannot be followed beyond the amplitude 0\.06[89]"):
        points(model, values, [1e-3, 0.1], [0, 0], dof=1)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seeds"), [("cubic", 150), ("jenkins", 150), ("iwan", 150)])
def test_errors_are_those_of_the_bound(kind, seeds):
    model, noise = masses(kind), 1e-3
    eta, errors, bound = starts(model.unknowns), [], np.zeros(0)
    for seed in range(seeds):
        likelihood = Problem.of(model, survey(kind, noise, seed)).likelihood
        if not seed:
            level = [np.ones(2)]
            bound = likelihood.information(likelihood.fit(eta), level).deviations()
        errors.append(refine(likelihood, eta).fit.eta - eta)
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / bound
    print(kind, ratio)
    assert np.all(np.abs(ratio - 1) <= 0.1 + 1.6 / np.sqrt(2 * seeds))
