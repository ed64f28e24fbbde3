"""Parameters that records do not determine: the others as if these were known, by an oracle of SciPy."""

import numpy as np
import pytest

from dynid import load_scene, run
from dynid.arithmetic.dependent import Dependent
from dynid.errors import NotIdentifiable
from dynid.identification.identify import identify
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.records.modal_measurement import ModalMeasurement
from dynid.lti.signals import Multisine
from dynid.parameters import Parameter, ParameterPrior
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.identification.cases import diagnostic, parameter
from tests.identification.maximum_likelihood import Record
from tests.identification.random_structures import case, suite
from tests.sample import sample

pytestmark = pytest.mark.thorough

SINES = Multisine([40.0] * 5, [15.0, 40.0, 70.0, 110.0, 160.0])
#: Random structures with a damper that is lost in the noise.
LOST = [3037, 3081, 3098]


def pair(stiff=1e9, *, prior=None, true=3.0):
    """Two masses on a joint, the second joint between them, beside a stiff link."""
    joints = [
        Joint("soft", (1,), JointParameter(start=6e3, true=9e3), JointParameter(start=6.0, true=9.0)),
        Joint("stiff", (1, 2), 1e3, JointParameter(start=2.0, true=true, prior=prior)),
    ]
    return lumped([1.0, 0.5], [Link((1, 2), stiff)], joints)


def measured(seed=1, noise=0.05):
    return Measurement(0.004, 800, (Channel(1, "velocity"),), Simulation(noise, seed))


def names_of(result, *, identifiable):
    flags = parameter(result, "identifiable")
    return [name for name, yes in zip(parameter(result, "name"), flags, strict=True) if yes == identifiable]


def assert_others_are_right(result, tolerance=4):
    known = parameter(result, "identifiable")
    off = (parameter(result, "estimate") - parameter(result, "true"))[known]
    assert np.all(np.abs(off / parameter(result, "standard_error")[known]) < tolerance)
    assert np.all(np.isinf(parameter(result, "standard_error")[~known]))
    assert not diagnostic(result, "converged")


def test_a_damper_without_effect_leaves_the_others():
    """It is on a mass of its own; the others are those of a model without that mass."""
    soft = Joint("soft", (1,), JointParameter(start=6e3, true=9e3), JointParameter(start=6.0, true=9.0))
    apart = Joint("apart", (3,), 2e3, JointParameter(start=2.0, true=3.0))
    links = [Link((1, 2), 2e4, 3.0)]
    result = identify(lumped([1.0, 0.5, 1.0], links, [soft, apart]), Experiment([Load(1, SINES)], measured()))
    assert names_of(result, identifiable=False) == ["apart.c"]
    assert parameter(result, "estimate")[2] == 2.0  # its start
    assert_others_are_right(result)
    assert diagnostic(result, "verdict").startswith("NOT converged: apart.c is not identifiable")
    assert any(text.startswith("apart.c is not identifiable") for text in diagnostic(result, "warnings"))
    assert "conditional" in result.group_attrs["identification/parameters"]["error_bars"]
    record = result.value("identification/measurement/measured")
    again = Measurement(0.004, 800, (Channel(1, "velocity"),), record)
    same = identify(lumped([1.0, 0.5], links, [soft]), Experiment([Load(1, SINES)], again))
    for name in ("estimate", "standard_error"):
        np.testing.assert_allclose(parameter(result, name)[:2], parameter(same, name), rtol=2e-3)


def test_a_prior_determines_what_the_record_does_not():
    result = identify(pair(prior=ParameterPrior(4.0, 0.1)), Experiment([Load(1, SINES)], measured()))
    assert names_of(result, identifiable=False) == []
    assert diagnostic(result, "converged")
    assert parameter(result, "estimate")[2] == pytest.approx(4.0, rel=0.02)


def series(starts, **more):
    """Two springs in series between two masses, and a third one to ground."""
    true = {"ka": 2e3, "kb": 5e3, "kg": 9e3}
    p = {name: Dependent.parameter(name, value) for name, value in true.items()}
    unknowns = [Parameter(name, starts[name], true=value, **more) for name, value in true.items()]
    links = [Link((1,), p["kg"], 3.0), Link((1, 2), p["ka"] * p["kb"] / (p["ka"] + p["kb"]), 1.0)]
    return lumped([1.0, 0.5], links, parameters=unknowns)


def test_springs_in_series_show_their_combination_and_leave_the_third():
    result = identify(series({"ka": 1.5e3, "kb": 7e3, "kg": 7e3}), Experiment([Load(1, SINES)], measured()))
    assert names_of(result, identifiable=True) == ["kg"]
    assert_others_are_right(result)
    (said,) = [text for text in diagnostic(result, "warnings") if "cannot be distinguished" in text]
    assert "1/ka + 1/kb" in said
    ka, kb, _ = parameter(result, "estimate")
    assert {ka, kb} & {1.5e3, 7e3}  # one is held, the combination is right
    assert 1 / (1 / ka + 1 / kb) == pytest.approx(1 / (1 / 2e3 + 1 / 5e3), rel=0.02)


def test_where_nothing_is_identifiable_the_record_is_refused():
    joints = [Joint(name, (1, 2), JointParameter(start=1e3, true=2e3)) for name in ("one", "other")]
    model = lumped([1.0, 0.5], [Link((1,), 5e3, 3.0), Link((1, 2), 0.0, 1.0)], joints)
    with pytest.raises(NotIdentifiable, match=r"one\.k \+ other\.k"):
        identify(model, Experiment([Load(1, SINES)], measured()))


def test_starts_are_those_of_the_scene_where_another_value_is_held():
    """A record that bounds a damper from above does not admit its start."""
    first = JointParameter(start=6e3, true=9e3)
    joints = [
        Joint("soft", (1,), first, JointParameter(start=6.0, true=9.0)),
        Joint("light", (2,), 4e3, JointParameter(start=80.0, true=1e-4)),
    ]
    result = identify(
        lumped([1.0, 0.7], [Link((1, 2), 2e4, 1.0)], joints), Experiment([Load(1, SINES)], measured())
    )
    assert names_of(result, identifiable=False) == ["light.c"]
    assert parameter(result, "start").tolist() == [6e3, 6.0, 80.0]
    assert parameter(result, "estimate")[2] < 1.0
    assert not parameter(result, "at_bound").any()
    assert_others_are_right(result)


def test_frequency_responses_and_modes():
    joints = [
        Joint("near", (1, 2), JointParameter(start=6e3, true=9e3)),
        Joint("far", (3,), JointParameter(start=1e4, true=2e4)),
    ]
    model = lumped([1.0, 0.5, 1.0], [Link((1,), 5e3, 3.0), Link((3,), 1e3, 1.0)], joints)
    lines = FrfMeasurement(np.linspace(20, 250, 60), (Frf(Channel(1, "velocity"), 1),), Simulation(0.02, 1))
    result = identify(model, lines)
    assert names_of(result, identifiable=False) == ["far.k"]
    assert_others_are_right(result)
    # The first three natural frequencies do not depend on dampers.
    damped = pair(stiff=2e4)
    K = np.array([[9e3 + 2.1e4, -2.1e4], [-2.1e4, 2.1e4]])
    root = np.diag([1.0, 2**0.5])
    omega = np.sqrt(np.linalg.eigvalsh(root @ K @ root)) * (1 + 1e-3 * np.array([1, -1]))
    result = identify(damped, ModalMeasurement(omega, omega_std=2e-3 * omega))
    assert names_of(result, identifiable=True) == ["soft.k"]
    assert_others_are_right(result)
    assert parameter(result, "estimate").tolist()[1:] == [6.0, 2.0]


@pytest.mark.parametrize("seed", sample(LOST, 0, *LOST[1:2]))
def test_the_others_are_those_of_the_oracle_with_the_lost_one_known(seed):
    """Estimates and errors are those of least squares of SciPy in which the lost parameter is a number."""
    this = case(seed)
    result = suite(this)
    lost = names_of(result, identifiable=False)
    assert lost
    own = dict(zip(parameter(result, "name"), parameter(result, "estimate"), strict=True))
    error = dict(zip(parameter(result, "name"), parameter(result, "standard_error"), strict=True))
    elements, unknowns = list(this.problem.elements), []
    for k, letter in this.problem.unknowns:
        if f"j{k}.{letter}" in lost:
            elements[k] = elements[k]._replace(**{letter: own[f"j{k}.{letter}"]})
        else:
            unknowns.append((k, letter))
    held = this.problem._replace(elements=tuple(elements), unknowns=tuple(unknowns))
    record = Record(held, this.record.values)
    names = [f"j{k}.{letter}" for k, letter in unknowns]
    eta = np.log([own[name] for name in names])
    deviance, noise = record.deviance(eta)
    best, least = record.fit(eta, noise)[:2]
    assert deviance - least < 0.01
    bound = record.deviations(eta, noise)
    assert np.all(np.abs(best - eta) < 0.1 * bound)
    errors = np.array([error[name] / own[name] for name in names])
    if diagnostic(result, "equivalent_optima") > 1:  # error bars are of all of them
        known = parameter(result, "identifiable")
        low, high, true = (parameter(result, name)[known] for name in ("low", "high", "true"))
        assert np.all((errors > bound) & (low < true) & (true < high))
    else:
        assert errors == pytest.approx(bound, rel=0.05)


@pytest.mark.parametrize("method", ["auto", "filter", "output-error"])
def test_what_a_record_bounds_on_neither_side_is_not_identifiable(method, tmp_path):
    """Noise makes an optimum of a damper beside a stiff spring, of which a thousandfold fits as well."""
    (tmp_path / "s.yaml").write_text(
        f"""
dynid: 1
kind: identification
structure: {{lumped: {{masses: [1.4, 0.6, 0.9], links: [{{dofs: [2, 3], k: 1.2e4, c: 8}}]}}}}
joints:
  base: {{dofs: [1], k: {{start: 8.0e3, true: 1.1e4}}, c: {{start: 6, true: 9}}}}
  rigid: {{dofs: [1, 2], k: 2.0e8, c: {{start: 3, true: 3}}}}
excitation: [{{dof: 3, kind: multisine, amplitude: [20, 20, 20, 20], frequency: [35, 60, 90, 125]}}]
measurement:
  step: 0.004
  samples: 700
  channels: [{{dof: 1, quantity: acceleration}}]
  simulate: {{noise_ratio: 0.05, seed: 8, settle: 6}}
estimator: {{method: {method}}}
derived: []
"""
    )
    result = run(load_scene(tmp_path / "s.yaml"))
    assert names_of(result, identifiable=False) == ["rigid.c"]
    assert_others_are_right(result)
