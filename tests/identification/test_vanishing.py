"""Unknowns whose true value is 0, or that have no effect: what the result says of them."""

import numpy as np
import pytest

from dynid.arithmetic.dependent import Dependent
from dynid.identification.identify import identify
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.lti.signals import Chirp
from dynid.parameters import Parameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.identification.cases import diagnostic, parameter
from tests.sample import sample

pytestmark = pytest.mark.thorough

ABSENT = 1e-9  # as small a damper as none
LOADS = [Load(1, Chirp(10.0, 3.0, 40.0, 6.0))]
CHANNELS = (Channel(1, "velocity"), Channel(2, "velocity"))


def two_masses(k=300.0, c=2.0, d=ABSENT, scale="log"):
    """Two masses with a joint between them and a damper to ground that may be absent."""
    true, start = {"k": k, "c": c, "d": d}, {"k": 0.7 * k, "c": 1.0, "d": 0.5}
    p = {name: Dependent.parameter(name, value) for name, value in true.items()}
    links = [Link((1,), 300.0, 1.0), Link((1, 2), p["k"], p["c"]), Link((2,), 50.0, p["d"])]
    parameters = [
        Parameter(name, start[name], true=value, scale=scale if name == "d" else "log")
        for name, value in true.items()
    ]
    return lumped([1.0, 2.0], links, parameters=parameters)


def run(model, seed, noise=0.02):
    return identify(model, Experiment(LOADS, Measurement(0.02, 300, CHANNELS, Simulation(noise, seed))))


def said(result, words):
    return [text for text in diagnostic(result, "warnings").tolist() if words in text]


@pytest.mark.parametrize("seed", sample([1, 4, 7], 1))
def test_a_damper_that_is_absent_is_indistinguishable_from_0(seed):
    """Its likelihood is that of a linear parameter, whose interval holds 0."""
    result = run(two_masses(), seed)
    (text,) = said(result, "is indistinguishable from 0")
    assert text.startswith("d is")
    assert not said(result, "poorly known")
    assert diagnostic(result, "converged")
    linear = run(two_masses(d=0.0, scale="linear"), seed)
    assert not said(linear, "indistinguishable")
    estimate, error = parameter(linear, "estimate")[2], parameter(linear, "standard_error")[2]
    assert abs(estimate) < 1.96 * error
    assert parameter(result, "estimate")[2] == pytest.approx(estimate, abs=0.01 * error)
    np.testing.assert_allclose(
        parameter(result, "standard_error"), parameter(linear, "standard_error"), rtol=0.01
    )


def test_where_the_record_asks_for_less_than_no_damper_it_is_not_identifiable():
    """The others are those of a linear parameter, but for what less than none changes."""
    linear = run(two_masses(d=0.0, scale="linear"), 0)
    assert parameter(linear, "estimate")[2] < 0
    result = run(two_masses(), 0)
    assert parameter(result, "identifiable").tolist() == [True, True, False]
    off = parameter(result, "estimate") - parameter(linear, "estimate")
    assert np.all(np.abs(off / parameter(linear, "standard_error"))[:2] < 1)


def test_a_damper_that_is_there_is_not_said_to_be_absent():
    assert not said(run(two_masses(d=0.02), 1), "indistinguishable")


def test_a_damper_whose_joint_is_too_stiff_for_it_is_not_said_to_be_absent():
    """Nor is a large one contradicted by the record."""
    result = run(two_masses(k=1e4, c=50.0, d=0.3), 2, 0.05)
    assert not said(result, "indistinguishable from 0")
    assert said(result, "c is not identifiable from this record")
