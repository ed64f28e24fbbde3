"""Records whose channels or forces are delayed, against steady states under sums of sines."""

from dataclasses import dataclass

import numpy as np
import pytest

from dynid.arithmetic.dependent import Dependent
from dynid.errors import UsageError
from dynid.identification.estimators.filter_passes import Filter
from dynid.identification.estimators.imbedding import InvariantImbedding
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.identifiability import identifiability
from dynid.identification.identify import identify
from dynid.identification.records.measurement import Experiment, Measurement
from dynid.identification.records.preparation import BandPass, prepare
from dynid.lti.signals import Multisine, Sampled
from dynid.parameters import Parameter
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load

pytestmark = pytest.mark.thorough

LATE = Dependent.parameter("late", 0.0)
GROUP = "identification/parameters"
ORDERS = {"displacement": 0, "velocity": 1, "acceleration": 2}


@dataclass
class Rig:
    """A chain of three masses under a sum of sines, with a joint between the first two."""

    seed: int
    samples: int = 700

    def __post_init__(self) -> None:
        self.rng = rng = np.random.default_rng(self.seed)
        self.masses = rng.uniform(0.6, 2.4, 3)
        self.links = [(k, c) for k, c in zip(rng.uniform(1e4, 4e4, 3), rng.uniform(3, 15, 3), strict=True)]
        M, K, C = np.diag(self.masses), np.zeros((3, 3)), np.zeros((3, 3))
        for place, (k, c) in enumerate(self.links):
            v = np.eye(3)[place] - (np.eye(3)[place - 1] if place else 0)
            K, C = K + k * np.outer(v, v), C + c * np.outer(v, v)
        self.stiffness, self.damping = K, C
        natural = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real)
        self.step = 2 * np.pi / natural.max() / rng.uniform(8, 12)
        self.omega = np.sort(rng.uniform(0.1 * natural.min(), 1.2 * natural.max(), 120))
        self.lines = rng.standard_normal(120) + 1j * rng.standard_normal(120)
        self.H = np.array([np.linalg.solve(K - M * w * w + 1j * w * C, [0.0, 0.0, 1.0]) for w in self.omega])

    def force(self, late: float = 0.0, start: float = 0.0) -> np.ndarray:
        """Return the samples of the force, recorded `late`."""
        return self._sum(self.lines, start - late)

    def recorded(self, dof: int, quantity: str, late: float, start: float = 0.0) -> np.ndarray:
        """Return the samples of a channel, recorded `late`."""
        return self._sum(
            self.lines * self.H[:, dof - 1] * (1j * self.omega) ** ORDERS[quantity], start - late
        )

    def _sum(self, lines: np.ndarray, start: float) -> np.ndarray:
        times = start + self.step * np.arange(self.samples)
        return (np.exp(1j * np.outer(times, self.omega)) @ lines).real

    def noisy(self, values: np.ndarray, ratio: float) -> np.ndarray:
        """Return values with noise of a part of their RMS."""
        return values + ratio * np.sqrt(np.mean(values**2)) * self.rng.standard_normal(len(values))

    def model(self, *parameters):
        """Return the chain with its joint unknown."""
        known = [Link((1,), *self.links[0]), Link((2, 3), *self.links[2])]
        k, c = self.links[1]
        joint = Joint(
            "bolt", (1, 2), JointParameter(start=1.5 * k, true=k), JointParameter(start=0.6 * c, true=c)
        )
        return lumped(self.masses.tolist(), known, [joint], parameters=parameters)


def off(result) -> np.ndarray:
    """Return the errors of the estimates over their standard errors."""
    estimate, true, error = (
        result[f"{GROUP}/{name}"].data for name in ("estimate", "true", "standard_error")
    )
    return (estimate - true) / error


def left_out(result, group: str = "identification/measurement") -> int:
    return int(result.value(f"{group}/samples_left_out"))


def unknown_delay(seed: int, estimator=None):
    """Return an identification with an unknown delay of a channel, and that delay in samples."""
    rig = Rig(seed)
    late = rig.rng.uniform(0.1, 5) * (-1) ** seed
    values = [rig.recorded(1, "acceleration", 0.0), rig.recorded(3, "velocity", late * rig.step)]
    channels = (Channel(1, "acceleration"), Channel(3, "velocity", delay=LATE))
    source = np.column_stack([rig.noisy(column, 0.02) for column in values])
    model = rig.model(Parameter("late", 0.0, late * rig.step, scale="linear"))
    result = identify(
        model,
        Experiment(
            [Load(3, Sampled(rig.force(), rig.step))], Measurement(rig.step, rig.samples, channels, source)
        ),
        estimator,
    )
    return result, late


@pytest.mark.parametrize(
    "seed", [3, 4, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 1, 2, *range(5, 60)))]
)
def test_an_unknown_delay_of_either_sign_is_estimated_within_its_error_bars(seed):
    result, late = unknown_delay(seed)
    assert result.value("identification/diagnostics/converged")
    assert not result.value("identification/diagnostics/lacks_fit")
    assert np.abs(off(result)).max() < 4.5
    assert left_out(result) in (np.ceil(abs(late)), np.ceil(abs(late)) + 1)
    measured = result["identification/measurement/measured"].data
    assert len(measured) == 700 - left_out(result)
    assert not np.isnan(result["identification/measurement/predicted"].data).any()


@pytest.mark.parametrize("estimator", [OutputError(), Filter(3)])
def test_estimators_without_other_starts_find_a_delay_too(estimator):
    result, _ = unknown_delay(40, estimator)
    assert np.abs(off(result)).max() < 6  # the filter's fixed point is near the optimum, not at it
    assert left_out(result) > 0


@pytest.mark.parametrize(
    ("delays", "force", "expected"),
    [
        ((0.0, 2.0), 0.0, (2, 0)),
        ((0.0, 1.3), 0.0, (2, 0)),
        ((0.0, -1.3), 0.0, (0, 2)),
        ((3.0, -2.0), 0.0, (3, 2)),
        ((0.0, 0.0), 1.6, (0, 2)),  # a force that is recorded late: its last values come after the record
        ((0.0, 0.0), -1.6, (2, 0)),
    ],
)
def test_known_delays_leave_out_the_samples_whose_inputs_are_not_known(delays, force, expected):
    rig = Rig(11, 500)
    kinds = ((1, "displacement"), (3, "velocity"))
    each = list(zip(kinds, delays, strict=True))
    values = [rig.noisy(rig.recorded(*kind, late * rig.step), 0.02) for kind, late in each]
    channels = tuple(Channel(*kind, delay=late * rig.step) for kind, late in each)
    load = Load(3, Sampled(rig.force(force * rig.step), rig.step), delay=-force * rig.step)
    result = identify(
        rig.model(), Experiment([load], Measurement(rig.step, 500, channels, np.column_stack(values)))
    )
    assert left_out(result) == sum(expected)
    times = result["identification/measurement/time"].data
    np.testing.assert_allclose(times[0], expected[0] * rig.step, rtol=1e-12)
    np.testing.assert_array_equal(
        result["identification/measurement/measured"].data,
        np.column_stack(values)[expected[0] : 500 - expected[1]],
    )
    assert np.abs(off(result)).max() < 4.5
    assert not result.value("identification/diagnostics/lacks_fit")


@pytest.mark.parametrize("late", [1.3, pytest.param(-1.3, marks=pytest.mark.slow)])
def test_invariant_imbedding_takes_known_delays(late):
    rig = Rig(12, 120)
    values = [rig.recorded(1, "displacement", 0.0), rig.recorded(3, "velocity", late * rig.step)]
    channels = (Channel(1, "displacement"), Channel(3, "velocity", delay=late * rig.step))
    source = np.column_stack([rig.noisy(column, 0.02) for column in values])
    load = Load(3, Sampled(rig.force(), rig.step))
    estimator = InvariantImbedding(tolerance=1e-3)
    result = identify(
        rig.model(), Experiment([load], Measurement(rig.step, 120, channels, source)), estimator
    )
    assert left_out(result) == 2
    assert np.all(result[f"{GROUP}/error_percent"].data < [0.5, 5])


def test_each_of_several_records_leaves_out_its_own():
    rig, late = Rig(21), Parameter("late", 0.0, 2.4 * Rig(21).step, scale="linear")
    experiments = []
    for start, own in ((0.0, 0.0), (7.3, 1.0)):
        values = rig.recorded(1, "acceleration", late.true + own * rig.step, start)
        channel = Channel(1, "acceleration", delay=Dependent.parameter("late", 0.0) + own * rig.step)
        other = rig.recorded(3, "velocity", 0.0, start)
        source = np.column_stack([rig.noisy(column, 0.02) for column in (other, values)])
        channels = (Channel(3, "velocity"), channel)
        load = Load(3, Sampled(rig.force(start=start), rig.step))
        experiments.append(Experiment([load], Measurement(rig.step, rig.samples, channels, source)))
    result = identify(rig.model(late), experiments)
    assert np.abs(off(result)).max() < 4.5
    groups = [f"identification/measurement/record_{k}" for k in (1, 2)]
    assert [left_out(result, group) for group in groups] == [3, 4]


def test_a_record_that_begins_later_leaves_out_only_what_its_force_needs():
    rig = Rig(31, 900)
    recorded = rig.recorded(1, "velocity", 0.0), rig.recorded(3, "velocity", 1.7 * rig.step)
    values = np.column_stack([rig.noisy(column, 0.02) for column in recorded])
    channels = (Channel(1, "velocity"), Channel(3, "velocity", delay=1.7 * rig.step))
    load = Load(3, Sampled(rig.force(), rig.step))
    whole = Experiment([load], Measurement(rig.step, 900, channels, values))
    filtered = prepare(whole, [BandPass(0.0, 1.05 * float(rig.omega[-1]), 4)])
    assert filtered.measurement.start > 0
    assert left_out(identify(rig.model(), filtered, OutputError())) == 2
    # A force that was recorded from before the record on is known wherever its delayed channels need it.
    later = Measurement(rig.step, 800, channels, values[100:], start=100 * rig.step)
    result = identify(rig.model(), Experiment([load], later))
    assert left_out(result) == 0
    assert np.abs(off(result)).max() < 4.5


def test_signals_in_closed_form_act_from_the_beginning_on():
    rig = Rig(33)
    phases = np.angle(rig.lines) + np.pi / 2
    sines = Multisine(np.abs(rig.lines).tolist(), rig.omega.tolist(), phases.tolist())
    channels = (Channel(1, "velocity"), Channel(3, "velocity", delay=1.7 * rig.step))
    values = np.column_stack([rig.recorded(1, "velocity", 0.0), rig.recorded(3, "velocity", 1.7 * rig.step)])
    result = identify(
        rig.model(), Experiment([Load(3, sines)], Measurement(rig.step, rig.samples, channels, values))
    )
    assert left_out(result) == 2
    assert np.abs(result[f"{GROUP}/error_percent"].data).max() < 1e-6


def test_delays_that_leave_no_sample_are_refused():
    rig = Rig(35, 60)
    channels = (Channel(1, "velocity", delay=59.5 * rig.step),)
    measurement = Measurement(rig.step, 60, channels, rig.recorded(1, "velocity", 0.0)[:, None])
    with pytest.raises(UsageError, match="leave 0 of 60 samples at which every input is known"):
        identify(rig.model(), Experiment([Load(3, Sampled(rig.force(), rig.step))], measurement))


def test_bounds_before_the_fit_take_the_same_samples():
    rig = Rig(37)
    bounds = []
    for late in (0.0, 2.0 * rig.step):
        channels = (Channel(3, "velocity", delay=late),)
        measurement = Measurement(rig.step, 700, channels, rig.recorded(3, "velocity", late)[:, None])
        load = Load(3, Sampled(rig.force(), rig.step))
        result = identifiability(rig.model(), [Experiment([load], measurement)])
        bounds.append(result["identification/identifiability/relative_bound"].data)
    np.testing.assert_allclose(*bounds, rtol=0.05)
