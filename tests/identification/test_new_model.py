"""A kind of model that the suite does not know, in one file: every estimator takes it as it is.

An RLC ladder, its matrices written down as functions of its values, with derivatives by hand.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from dynid.identification.estimators.auto import Auto
from dynid.identification.estimators.filter_passes import Filter
from dynid.identification.estimators.imbedding import InvariantImbedding
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.identifiability import identifiability
from dynid.identification.identify import identify
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.systems.linear_system import LinearSystem, StateVariable
from dynid.lti.signals import Chirp, Impulse
from dynid.lti.state_space import Matrices
from dynid.lti.time_response import propagate
from dynid.parameters import Parameter, true_values

pytestmark = pytest.mark.usefixtures("complete")

TRUE = {"R": 2.0, "L": 0.5, "C": 0.1, "G": 0.3}


class Ladder(LinearSystem):
    """Voltage u on R and L in series, C and a conductance G across: L i' = u - R i - v, C v' = i - G v.

    The channel is the current, or the voltage on L, which follows u directly.
    """

    states = (StateVariable("i", "A"), StateVariable("v", "V"))

    def __init__(self, unknowns, loads, channels):
        self.unknowns, self.signals = tuple(unknowns), [load.signal for load in loads]
        self.names = [channel.name for channel in channels]

    def at(self, values):
        R, L, C, G = (values[name] for name in "RLCG")
        A = np.array([[-R / L, -1 / L], [1 / C, -G / C]])
        B = np.array([[1 / L], [0.0]])
        rows = {"i": [1.0, 0.0], "vL": [-R, -1.0], "v": [0.0, 1.0]}
        direct = {"i": 0.0, "vL": 1.0, "v": 0.0}
        Cm = np.array([rows[name] for name in self.names])
        D = np.array([[[direct[name]] for name in self.names]])
        dA, dB = np.zeros((4, 2, 2)), np.zeros((4, 2, 1))
        dA[0, 0, 0] = -1 / L
        dA[1, 0] = -A[0] / L
        dA[2, 1] = -A[1] / C
        dA[3, 1, 1] = -1 / C
        dB[1] = -B / L
        dC = np.zeros((4, *Cm.shape))
        dC[0, [name == "vL" for name in self.names], 0] = -1.0
        return Matrices(A, B, Cm, D, dA, dB, dC, np.zeros((4, *D.shape)))

    def prior(self, values, length):  # noqa: ARG002
        return np.diag([values["L"] ** -0.5, values["C"] ** -0.5])


@dataclass(frozen=True)
class LadderModel:
    """The ladder before loads and channels are chosen."""

    unknowns: tuple

    @property
    def parameters(self):
        return self.unknowns

    def with_parameters(self, parameters):
        return replace(self, unknowns=tuple(parameters))

    def system(self, loads, channels):
        return Ladder(self.unknowns, loads, channels)

    def simulated(self, loads, channels, times, source):  # noqa: ARG002
        system = self.system(loads, channels).state_space(true_values(self.unknowns))
        return propagate(system, [load.signal for load in loads], times)


@dataclass(frozen=True)
class Terminal:
    """A channel of the ladder."""

    name: str
    unit: str
    gain: float = 1.0
    offset: float = 0.0
    delay: float = 0.0

    @property
    def gain_name(self):
        return f"gain of {self.name}"

    def unit_load(self, place):
        return Source(Impulse(1.0), place)


@dataclass(frozen=True)
class Source:
    """The voltage source."""

    signal: object
    name: str = "u"
    unit: str = "V"
    gain_name: str = "gain of u"
    motion: None = None
    dof: None = None
    gain: float = 1.0
    delay: float = 0.0


CHANNELS = (Terminal("i", "A"), Terminal("vL", "V"))


def model(factor):
    return LadderModel(tuple(Parameter(name, factor * value, value) for name, value in TRUE.items()))


def measurement(noise=0.02):
    return Measurement(0.02, 500, CHANNELS, Simulation(noise, 3))


def assert_found(result):
    group = "identification/parameters"
    error = result.value(f"{group}/estimate") - np.array(list(TRUE.values()))
    assert np.all(np.abs(error) < 4 * result.value(f"{group}/cramer_rao"))
    bars, bound = result.value(f"{group}/standard_error"), result.value(f"{group}/cramer_rao")
    np.testing.assert_allclose(bars, bound, rtol=0.3)


@pytest.mark.parametrize(
    "estimator",
    [Auto(), Filter(3), OutputError(), InvariantImbedding(tolerance=1e-3)],
    ids=lambda one: one.name,
)
def test_every_estimator_of_records_takes_it(estimator):
    assert_found(
        identify(model(0.7), Experiment([Source(Chirp(1.0, 0.5, 15.0, 10.0))], measurement()), estimator)
    )


def test_frequency_responses_take_it():
    lines = FrfMeasurement(
        np.linspace(0.5, 20, 60), tuple(Frf(one, "u") for one in CHANNELS), Simulation(0.02, 2)
    )
    assert_found(identify(model(0.5), lines))


def test_its_identifiability_is_its_bound():
    loads, own = [Source(Chirp(1.0, 0.5, 15.0, 10.0))], measurement()
    found = identifiability(model(0.7), [Experiment(loads, own)])
    bound = identify(model(0.7), Experiment(loads, own)).value("identification/parameters/cramer_rao")
    np.testing.assert_allclose(found.value("identification/identifiability/bound"), bound, rtol=1e-6)
    poles = found.value("identification/identifiability/modal_sensitivity/pole")
    exact = np.linalg.eigvals(Ladder((), [], CHANNELS).at(TRUE).A)
    np.testing.assert_allclose(poles, exact[exact.imag > 0], rtol=1e-12)


def test_its_responses_have_the_derivatives_of_the_formula():
    """H = 1/(R + L s + 1/(G + C s)) of the current, by central differences."""
    omega, h = np.array([0.3, 4.0, 30.0]), 1e-7
    system = Ladder((), [Source(Impulse(1.0))], CHANNELS[:1])
    H, slopes = system.response(TRUE, omega)

    def exact(values):
        s = 1j * omega
        return 1 / (values["R"] + values["L"] * s + 1 / (values["G"] + values["C"] * s))

    np.testing.assert_allclose(H[:, 0, 0], exact(TRUE), rtol=1e-13)
    for k, name in enumerate(TRUE):
        up, down = ({**TRUE, name: TRUE[name] * (1 + sign * h)} for sign in (1, -1))
        wanted = (exact(up) - exact(down)) / (2 * h * TRUE[name])
        np.testing.assert_allclose(slopes[:, 0, 0, k], wanted, rtol=1e-6)
