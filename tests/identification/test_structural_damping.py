"""Loss factors of joints identified from frequency responses and modes; the wrong kind of damping."""

import numpy as np
import pytest

from dynid.errors import UsageError
from dynid.identification.diagnosis.damping_kinds import other_damping
from dynid.identification.identify import identify
from dynid.identification.likelihood.modal_record import ModalRecord
from dynid.identification.problem import Problem
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.systems.frf_system import FrfSystem
from dynid.lti.signals import Multisine
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.identification.cases import diagnostic, in_bounds, parameter
from tests.identification.modal_cases import measured
from tests.identification.test_modes import slope

pytestmark = pytest.mark.thorough

BAND = (2.0, 60.0)
CHANNELS = tuple(Frf(Channel(dof, "displacement"), 1) for dof in (3, 7, 12))
TRUE = {"a": (2e4, 0.08, 3.0), "b": (3e4, 0.03, 2.0)}


def lines(low, high, count=250):
    return 2 * np.pi * np.linspace(low, high, count)


def unknown(true, start=0.7):
    return JointParameter(start=start * true, true=true)


def chain(damping="eta", start=0.7, joints="ab", masses=12):
    """Masses in a row on springs with a loss factor of 0.002; `damping`: what is unknown of the joints."""
    links, unknowns = [], []
    for i in range(masses):
        dofs = (i + 1,) if i == 0 else (i, i + 1)
        name = {4: "a", 8: "b"}.get(i, "")
        if not name:
            links.append(Link(dofs, 5e4, eta=0.002))
            continue
        k, eta, c = TRUE[name]
        parts = {"eta": unknown(eta, start), "c": unknown(c, start)}
        chosen = {key: parts[key] for key in damping.split()} if name in joints else {"eta": eta}
        unknowns.append(Joint(name, dofs, k=unknown(k, start), **chosen))
    return lumped(list(np.linspace(1, 2, 12))[:masses], links, unknowns)


def run(model, truth=None, noise=0.03, seed=1, omega=None, **options):
    measurement = FrfMeasurement(lines(*BAND) if omega is None else omega, CHANNELS, Simulation(noise, seed))
    return identify(model, measurement, truth=truth or model, **options)


@pytest.mark.parametrize("damping", ["eta", "eta c"])
def test_derivatives_of_responses_are_exact(damping):
    model = chain(damping)
    system = FrfSystem.of(model, CHANNELS)
    omega, eta = lines(*BAND, 40), np.log([item.true for item in model.unknowns])
    found = system.response(omega, eta).slopes
    for k in range(len(eta)):
        moved = {
            h: system.response(omega, eta + h * np.eye(len(eta))[k]).values
            for h in (2e-4, -2e-4, 1e-4, -1e-4)
        }
        table = [(moved[h] - moved[-h]) / (2 * h) for h in (2e-4, 1e-4)]
        wanted = (4 * table[1] - table[0]) / 3
        np.testing.assert_allclose(found[..., k], wanted, rtol=0, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.parametrize("complex_shapes", [False, True])
def test_derivatives_of_modes_are_exact_and_modes_give_the_loss_factors_back(complex_shapes):
    model = chain()
    modal = measured(
        model, noise=0.0, damping=True, complex_shapes=complex_shapes, modes=range(5), dofs=(2, 4, 6, 8, 11)
    )
    record = ModalRecord.of(model, modal, 9)
    eta = np.log([item.true for item in model.unknowns])
    fit = record.fit(eta, record.data.values)
    assert np.nanmax(np.abs(fit.residual)) < 1e-9
    for k in range(len(eta)):
        wanted = slope(record, eta, k)
        size = np.nanmax(np.abs(wanted))
        np.testing.assert_allclose(fit.by_parameter[..., k], wanted, rtol=0, atol=1e-7 * size)
    assert np.abs(parameter(identify(model, modal), "error_percent")).max() < 1e-4


def test_clean_responses_give_the_loss_factors_back_exactly():
    assert np.abs(parameter(run(chain(), noise=0.0), "error_percent")).max() < 1e-7


def covered(seeds):
    """Estimates over their errors, in standard errors (seeds x 4)."""
    found = [run(chain(start=1.0), seed=seed) for seed in seeds]
    assert all(diagnostic(one, "converged") for one in found)
    errors = [parameter(one, "estimate") - parameter(one, "true") for one in found]
    return np.array(errors) / [parameter(one, "standard_error") for one in found]


def test_intervals_cover():
    z = covered(range(6))
    assert np.abs(z).max() < 4
    assert 0.5 < np.sqrt(np.mean(z**2)) < 1.5


@pytest.mark.slow
def test_intervals_cover_in_many_records():
    z = covered(range(200))
    assert 0.92 <= np.mean(np.abs(z) < 1.96) <= 0.98


@pytest.mark.usefixtures("complete")
def test_dampers_do_not_explain_structural_damping_and_the_loss_factor_is_suggested():
    viscous = chain("c")
    found = run(viscous, truth=chain())
    assert not diagnostic(found, "converged")
    assert "does not explain" in str(diagnostic(found, "verdict"))
    first = str(diagnostic(found, "warnings")[0])
    assert "a, b dissipate as structural damping: write eta instead of c (a.eta = 0.0" in first
    back = run(chain(), truth=viscous)
    said = "a, b dissipate as dampers: write c instead of eta"
    assert any(said in str(text) for text in diagnostic(back, "warnings"))


@pytest.mark.usefixtures("complete")
def test_one_joint_of_two_has_the_other_damping():
    both, mixed = chain("c"), chain().joints
    truth = chain().joined([mixed[0], both.joints[1]])
    found = run(both, truth=truth)
    assert "explained where a dissipates as structural damping" in str(diagnostic(found, "warnings")[0])


@pytest.mark.usefixtures("complete")
def test_no_kind_of_damping_explains_a_wrong_mass():
    masses = np.linspace(1, 2, 12) * np.where(np.arange(12) == 5, 1.2, 1.0)
    model = chain("c")
    truth = lumped(
        list(masses),
        [Link((i,) if i == 1 else (i - 1, i), 5e4) for i in range(1, 13) if i not in (5, 9)],
        model.joints,
    )
    problem = Problem.of(model, FrfMeasurement(lines(*BAND), CHANNELS, Simulation(0.03, 1)), truth=truth)
    eta = np.log([item.true for item in model.unknowns])
    tried = list(other_damping(problem.likelihood, eta))
    assert tried
    assert not any(one.explains and not one.comparison.lacks_fit for one in tried)


def test_damper_and_loss_factor_of_one_joint_are_alike_in_a_narrow_band():
    """Bounds of eta and c of a: 300 and 2,400 % in 9 … 11.5 Hz, 0.3 and 1.2 % in 2 … 60 Hz."""
    narrow = run(chain("eta c", start=1.0, joints="a"), omega=lines(9.0, 11.5))
    said = [str(text) for text in diagnostic(narrow, "warnings")]
    assert not diagnostic(narrow, "converged")
    assert any("a.eta and a.c can hardly be distinguished between" in text for text in said)
    wide = run(chain("eta c", start=1.0, joints="a"))
    assert diagnostic(wide, "converged")
    assert not any("hardly be distinguished" in str(text) for text in diagnostic(wide, "warnings"))
    assert in_bounds(wide).max() < 5


def test_a_record_of_time_is_refused_with_the_remedy():
    model = chain()
    measurement = Measurement(0.01, 100, (Channel(3, "displacement"),), Simulation(0.0, 1))
    with pytest.raises(UsageError, match="is not causal: it has no record of time") as raised:
        identify(model, Experiment((Load(1, Multisine([5.0], [1.0], [0.0])),), measurement))
    assert "equivalent" in raised.value.remedy
    with pytest.raises(UsageError, match="no static response"):
        run(model, omega=lines(0.0, 10.0))
