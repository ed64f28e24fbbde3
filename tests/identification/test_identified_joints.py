"""Joints with laws after a fit: dissipated energy, laws that create some, forces as the record has them."""

import numpy as np
import pytest
from scipy.integrate import quad

from dynid.identification.diagnosis.joint_forces import measured_forces, motion_sizes
from dynid.identification.estimators.maximum_likelihood import OutputError, refine
from dynid.identification.identify import identify
from dynid.identification.problem import Problem
from dynid.parameters import starts
from dynid.report.figure import figures
from dynid.structure.hysteretic_laws import BoucWen, Jenkins
from dynid.structure.joint_laws import Cubic, Gap, Power, QuadraticDamping
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.model_laws import joint_law
from tests.identification.cases import diagnostic, parameter
from tests.identification.test_laws_of_joints import experiment, record_of, truth

D, OMEGA = 2e-3, 90.0


@pytest.mark.parametrize(
    ("law", "values", "work"),
    [
        (Cubic(), (1e9,), 0.0),
        (QuadraticDamping(), (7.0,), 8 / 3 * 7 * OMEGA**2 * D**3),
        (Power(1, 1, ("v",)), (40.0,), 4 / 3 * 40 * OMEGA * D**3),
        (Power(0, 1, ("v",)), (3.0,), np.pi * 3 * OMEGA * D**2),
        (Jenkins(), (3e3, 2.0), 4 * 2 * (D - 2 / 3e3)),
        (Jenkins(), (3e3, 7.0), 0.0),
        (Gap(), (1e4, 1e-3, 0.0), 0.0),
        (Gap("positive"), (1e4, 0.0, 5.0), np.pi / 2 * 5 * OMEGA * D**2),
        (BoucWen(), (1e3, 0.0, 0.0), 0.0),
    ],
)
def test_the_energy_of_a_cycle_is_that_of_its_closed_form(law, values, work):
    size = max(abs(work), 1e-3 * values[0] * D**2)
    assert law.cycle_work(values, D, OMEGA) == pytest.approx(work, rel=2e-4, abs=1e-4 * size)


def test_a_hysteresis_loop_dissipates_what_its_branches_enclose():
    kz, alpha, delta = 3e3, 900.0, 300.0
    # Steady loop of n = 1: from -Z at -D to Z at D, exact branches of z' = 1 + delta |z|, then 1 - alpha z.
    from scipy.optimize import brentq

    def rising(z):
        return np.log1p(delta * z) / delta - np.log1p(-alpha * z) / alpha - 2 * D

    end = brentq(rising, 1e-9, (1 - 1e-12) / alpha)
    below = quad(lambda z: z / (1 - delta * z), -end, 0)[0]
    above = quad(lambda z: z / (1 - alpha * z), 0, end)[0]
    exact = 2 * kz * (below + above)
    assert BoucWen().cycle_work((kz, alpha, delta), D, OMEGA) == pytest.approx(exact, rel=2e-3)


def microslip(start, true):
    law = joint_law(Power(1, 1, ("v",)), [JointParameter(start=start, true=true, signed=True)])
    k, c = JointParameter(start=9900, true=1e4), JointParameter(start=39.0, true=40.0)
    return lumped((1.0, 0.7), (Link((1,), 1.5e4, 5.0),), [Joint("bolt", (1, 2), k, c, laws=(law,))])


def test_a_law_that_creates_energy_is_stated_with_amount_and_amplitude():
    result = identify(microslip(-900.0, -1000.0), experiment(60, 0.01, amplitude=12.0), OutputError())
    (said,) = (text for text in diagnostic(result, "warnings") if "creates energy" in text)
    assert "the law power of joint bolt, as estimated, creates energy" in said
    a = dict(zip(parameter(result, "name"), parameter(result, "estimate"), strict=True))["bolt.a"]
    c = dict(zip(parameter(result, "name"), parameter(result, "estimate"), strict=True))["bolt.c"]
    amplitude = result["identification/joints/range"].data[0]
    words = said.split()
    energy, at = float(words[words.index("J") - 1]), float(words[words.index("m;") - 1])
    assert at == pytest.approx(amplitude, rel=1e-3)
    # With the damper of the joint, which dissipates more.
    both = result["identification/joints/dissipation"].data[-1, 0]
    rate = (both + energy) / (np.pi * c * amplitude**2)
    assert energy == pytest.approx(-4 / 3 * a * rate * amplitude**3, rel=1e-2)
    assert (result["identification/joints/dissipation_deviation"].data > 0).all()
    names = [figure.name for figure in figures(result)]
    assert {"joint-forces", "joint-force-histories", "joint-dissipation"} <= {*names}


@pytest.mark.parametrize("start", [0.0, 1.9e8])
def test_a_preload_is_estimated_from_a_start_of_zero(start):
    law = joint_law(Cubic(), [JointParameter(start=start, true=2e8, signed=True)])
    k, c = JointParameter(start=9950, true=1e4), JointParameter(start=3.9, true=4.0)
    offset = JointParameter(start=0.0, true=2e-3, signed=True)
    bolt = Joint("bolt", (1, 2), k, c, laws=(law,), offset=offset)
    structure = lumped((1.0, 0.7), (Link((1,), 1.5e4, 5.0),), [bolt])
    problem = Problem.of(structure, experiment(80, 0.005, 12.0))
    spreads = {unknown.name: unknown.spread for unknown in problem.likelihood.unknowns}
    assert 1e-4 < spreads["bolt.offset"] < 0.1
    assert spreads["bolt.k3"] is None or 1e5 < spreads["bolt.k3"] < 1e11
    likelihood = problem.likelihood
    fit = refine(likelihood, starts(likelihood.unknowns)).fit
    deviations = likelihood.information(fit, fit.noise).deviations()
    assert np.abs((np.abs(fit.eta) - truth(likelihood.records[0])) / deviations).max() < 4  # of either sign


def test_passive_laws_are_not_accused():
    result = identify(microslip(900.0, 1000.0), experiment(60, 0.01, amplitude=12.0), OutputError())
    assert not any("creates energy" in text for text in diagnostic(result, "warnings"))


def test_the_force_of_the_record_does_not_follow_the_law():
    record = record_of("jenkins", 120, noise=0.002, amplitude=8.0)
    eta = truth(record)
    fit = record.fit(eta, record.data.values)
    motion, _ = record.joint_forces(fit)
    noise = 0.002 * record.data.rms
    _, rates = motion_sizes([record], [fit])
    shown = measured_forces(record, fit, noise, motion.deflections, motion.forces, float(rates[0]))
    apart = (shown.forces - motion.forces) / shown.deviations
    assert np.sqrt(np.mean(apart**2)) < 1.5
    assert np.median(shown.deviations) < 0.5 * np.abs(motion.forces).max()
    # With half the slip force in the model, the record still shows the true one.
    wrong = eta.copy()
    wrong[3] -= np.log(2)
    wrong_fit = record.fit(wrong, record.data.values)
    less, _ = record.joint_forces(wrong_fit)
    again = measured_forces(record, wrong_fit, noise, less.deflections, less.forces, float(rates[0]))
    middle = slice(10, -10)
    off = np.sqrt(np.mean((again.forces - motion.forces)[middle] ** 2))
    assert off < 0.5 * np.sqrt(np.mean((less.forces - motion.forces)[middle] ** 2))


def test_a_record_that_is_too_large_shows_no_forces(monkeypatch):
    from dynid.identification.diagnosis import joint_forces

    monkeypatch.setattr(joint_forces, "_MAX_NUMBERS", 10)
    (record,) = Problem.of(microslip(900.0, 1000.0), experiment(40)).likelihood.records
    fit = record.fit(truth(record), record.data.values)
    motion, _ = record.joint_forces(fit)
    assert measured_forces(record, fit, record.data.rms, motion.deflections, motion.forces, 90.0) is None
