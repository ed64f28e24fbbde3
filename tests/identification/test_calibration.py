"""Slopes of the estimates by gains and trigger delay, against estimating anew with other gains and delays.

The oracle knows the matrices and the signals as formulas: a steady state from the receptance (of a spline:
its polynomials, exponential by exponential) plus any free motion, fitted by scipy.
"""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.linalg import expm

from dynid.identification.diagnosis import posterior
from dynid.identification.estimators.auto import Auto
from dynid.identification.estimators.maximum_likelihood import Huber
from dynid.identification.identify import identify
from dynid.identification.planning.plan import PlanRequest, plan
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Experiment, Measurement
from dynid.lti.signals import Multisine, Sampled
from dynid.native import VARIABLE
from dynid.parameters import ParameterPrior
from dynid.report.content.blocks import TextTable
from dynid.report.content.identifiability import (
    calibration_caveats,
    calibration_sections,
    calibration_sentences,
)
from dynid.result import Result, Selection
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from dynid.structure.reduction.methods import reduce
from tests.identification.cases import LOADS, parameter, simulated, suspension

pytestmark = pytest.mark.thorough

TRUE = np.array([2.0e4, 20.0, 1.2e4, 9.0])
ORDERS = {"displacement": 0, "velocity": 1, "acceleration": 2}


def structure(low=None, prior=None):
    """Four masses; two joints unknown, k and c of each."""
    joints = [
        Joint(
            "a",
            (1, 2),
            JointParameter(start=1.5e4, true=2e4),
            JointParameter(start=low or 15.0, true=20.0, low=low, prior=prior),
        ),
        Joint("b", (3, 4), JointParameter(start=1e4, true=1.2e4), JointParameter(start=12.0, true=9.0)),
    ]
    return lumped([2.0, 1.0, 1.5, 1.0], [Link((1,), 2e4, 15), Link((2, 3), 3e4, 12)], joints)


def matrices(theta):
    """Mass, damping and stiffness of `structure`, term by term."""
    M = np.diag([2.0, 1.0, 1.5, 1.0])

    def tied(first, second, third):
        matrix = np.zeros((4, 4))
        matrix[0, 0] += first[0]
        for (i, j), value in (((0, 1), first[1]), ((1, 2), second), ((2, 3), third)):
            matrix[np.ix_([i, j], [i, j])] += value * np.array([[1, -1], [-1, 1]])
        return matrix

    return M, tied((15, theta[1]), 12, theta[3]), tied((2e4, theta[0]), 3e4, theta[2])


@dataclass
class Record:
    """A record of the oracle: what drives it, where, what is read, and the measured values."""

    loads: list  # (DOF or None for the ground, amplitudes, frequencies) or (DOF, samples)
    channels: list  # (DOF, quantity)
    step: float = 0.004
    samples: int = 150
    measured: np.ndarray = field(default=None)

    @property
    def times(self):
        return self.step * np.arange(self.samples)

    def direction(self, dof, M):
        return -M @ np.ones(4) if dof is None else np.eye(4)[dof - 1]

    def forced(self, theta, gains, delay):
        """One motion that the loads force (times x channels)."""
        M, C, K = matrices(theta)
        y = np.zeros((self.samples, len(self.channels)))
        for place, (dof, *given) in enumerate(self.loads):
            direction = gains[place] * self.direction(dof, M)
            if len(given) == 1:
                y += self.splined(M, C, K, direction, given[0], delay)
                continue
            for amplitude, omega in zip(*given, strict=True):
                x = np.linalg.solve(K + 1j * omega * C - omega**2 * M, direction * amplitude)
                phase = np.exp(1j * omega * (self.times - delay))
                for c, (read, quantity) in enumerate(self.channels):
                    y[:, c] += np.imag((1j * omega) ** ORDERS[quantity] * x[read - 1] * phase)
        return y

    def splined(self, M, C, K, direction, values, delay):
        """The response from rest to a cubic spline that comes later by `delay`, polynomial by polynomial."""
        pieces = CubicSpline(self.times, values)
        A, B = companion(M, C, K, direction)
        system = np.zeros((12, 12))
        system[:8, :8], system[:8, 8] = A, B
        system[8:11, 9:12] = np.eye(3)  # u, u', u'', u'''
        state, y, steps = np.zeros(8), [], {}
        knots = pieces.x[1:-1] + delay
        for k, t in enumerate(self.times):
            if k:
                here = self.times[k - 1]
                for stop in [*knots[(knots > here) & (knots < t)], t]:
                    # The polynomial at the middle of the interval goes on to both of its ends.
                    piece = np.clip(np.searchsorted(knots, (here + stop) / 2), 0, pieces.c.shape[1] - 1)
                    length = round(stop - here, 12)
                    if length not in steps:
                        steps[length] = expm(system * length)
                    state = (steps[length] @ [*state, *jet(pieces, piece, here - delay)])[:8]
                    here = stop
            piece = np.clip(np.searchsorted(knots, t - 1e-9), 0, pieces.c.shape[1] - 1)
            u = jet(pieces, piece, t - delay)[0]
            y.append(self.read(state, (A @ state + B * u)[4:]))
        return np.array(y)

    def read(self, state, acceleration):
        every = (state[:4], state[4:], acceleration)
        return [every[ORDERS[quantity]][dof - 1] for dof, quantity in self.channels]

    def free(self, theta):
        """The free motions (times x channels x 8)."""
        A, _ = companion(*matrices(theta), np.zeros(4))
        rows = np.array(
            [np.vstack([np.eye(8), A[4:]])[dof - 1 + 4 * ORDERS[quantity]] for dof, quantity in self.channels]
        )
        Phi, X, seen = expm(A * self.step), np.eye(8), []
        for _ in self.times:
            seen.append(rows @ X)
            X = Phi @ X
        return np.array(seen)

    def simulated(self, ratio=0.0, seed=0):
        """The record at the true values, with some free motion and noise; and the noise's deviations."""
        y = self.forced(TRUE, np.ones(len(self.loads)), 0.0)
        y += self.free(TRUE) @ (1e-3 * np.r_[1, -2, 1, 3, 40, 10, -60, 20])
        rms = np.sqrt(np.mean(y**2, axis=0))
        noise = ratio * rms * np.random.default_rng(seed).standard_normal(y.shape)
        return replace(self, measured=y + noise), 0.02 * rms

    def experiment(self, noise):
        loads = []
        for dof, *given in self.loads:
            signal = Multisine(*given) if len(given) == 2 else Sampled(given[0], self.step)
            loads.append(Load(dof, signal, "acceleration" if dof is None else None))
        channels = tuple(Channel(*channel) for channel in self.channels)
        return Experiment(loads, Measurement(self.step, self.samples, channels, self.measured, noise))


def companion(M, C, K, direction):
    A = np.block([[np.zeros((4, 4)), np.eye(4)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    return A, np.concatenate([np.zeros(4), np.linalg.solve(M, direction)])


def jet(pieces, piece, time):
    """Value and derivatives of a piece of a spline, which goes on beyond its ends."""
    c3, c2, c1, c0 = pieces.c[:, piece]
    s = time - pieces.x[piece]
    return [c0 + s * (c1 + s * (c2 + s * c3)), c1 + s * (2 * c2 + s * 3 * c3), 2 * c2 + 6 * s * c3, 6 * c3]


def fitted(records, noises, change, held=(), prior=None, steps=3):
    """Estimate anew: the logarithms where the weighted squares are least, initial states projected out.

    `change` of a record gives its loads' gains, its delay and its channels' gains.
    """
    free = [k for k in range(4) if k not in held]

    def residual(eta):
        theta = TRUE.copy()
        for place, value in dict(held).items():
            theta[place] = value
        theta[free] = np.exp(eta)
        out = [] if prior is None else [[(np.log(prior[1]) - eta[free.index(prior[0])]) / prior[2]]]
        for place, (record, noise) in enumerate(zip(records, noises, strict=True)):
            gains, delay, scales = change(place)
            left = ((record.measured * scales - record.forced(theta, gains, delay)) / noise).ravel()
            span = (record.free(theta) / noise[:, None]).reshape(-1, 8)
            Q = np.linalg.qr(span / np.linalg.norm(span, axis=0))[0]
            out.append(left - Q @ (Q.T @ left))
        return np.concatenate(out)

    # Gauss–Newton from the truth with its derivatives, which is a fraction of a deviation off.
    found = np.log(TRUE[free])
    both = [(residual(found + e), residual(found - e)) for e in 1e-5 * np.eye(len(free))]
    J = np.column_stack([(ahead - behind) / 2e-5 for ahead, behind in both])
    for _ in range(steps):
        found = found - np.linalg.lstsq(J, residual(found))[0]
    eta = np.full(4, np.nan)
    eta[free] = found
    return eta


def refitted(records, noises, quantity, step, **known):
    """Central difference of the estimates by a quantity, given by its name."""

    def at(sign):
        def change(place):
            record = records[place]
            factor = np.exp(sign * step)
            gains = [factor if name == quantity else 1.0 for name in gains_of(record)]
            scales = [factor if f"gain of {dof}.{what}" == quantity else 1.0 for dof, what in record.channels]
            return gains, sign * step * (quantity == "trigger delay"), np.array(scales)

        return fitted(records, noises, change, **known)

    return (at(1) - at(-1)) / (2 * step)


def gains_of(record):
    return [
        "acceleration gain of base" if dof is None else f"force gain of {dof}" for dof, *_ in record.loads
    ]


SINES = ([60.0, 40.0, 50.0], [47.0, 101.0, 160.0])
TWO_FORCES = Record(
    [(4, *SINES), (1, [30.0], [77.0]), (4, [20.0], [133.0])],
    [(2, "velocity"), (3, "acceleration"), (4, "displacement")],
)
SHAKEN = Record([(None, [3.0, 2.0], [55.0, 140.0])], [(1, "velocity"), (4, "acceleration")])
RANDOM = Record(
    [(4, 40 * np.random.default_rng(4).standard_normal(80))],
    [(2, "acceleration"), (4, "velocity")],
    samples=80,
)


def slopes(result):
    group = "identification/considered"
    table = result[f"{group}/slope"].data
    names = [str(name) for name in result[f"{group}/quantity"].data]
    assert table.shape == (len(result[f"{group}/parameter"].data), len(names))
    known = ("mass ", "stiffness ", "clock")  # see test_known_parts.py
    return {name: slope for name, slope in zip(names, table.T, strict=True) if not name.startswith(known)}


def found_by_dynid(records, noises, model=None, **options):
    each = [record.experiment(noise) for record, noise in zip(records, noises, strict=True)]
    return slopes(identify(model or structure(), each, **options))


def assert_slopes(found, records, noises, tolerance, **known):
    names = dict.fromkeys(name for record in records for name in gains_of(record))
    assert set(found) >= {*names, "trigger delay"}
    for name, slope in found.items():
        step = 1e-6 if name == "trigger delay" else 1e-4
        wanted = refitted(records, noises, name, step, **known)
        there = ~np.isnan(wanted)
        size = np.abs(wanted[there]).max()
        assert slope[there] == pytest.approx(wanted[there], abs=tolerance * size), name
        assert np.all(slope[~there] == 0), name


@pytest.mark.parametrize(
    "records",
    [
        pytest.param([TWO_FORCES], id="forces", marks=pytest.mark.slow),
        pytest.param([SHAKEN], id="base", marks=pytest.mark.slow),
        pytest.param([RANDOM], id="spline"),
        pytest.param([SHAKEN, replace(TWO_FORCES, step=0.003, samples=100)], id="records"),
    ],
)
def test_without_noise_the_slopes_are_those_of_estimating_anew(monkeypatch, records):
    made, noises = zip(*(record.simulated() for record in records), strict=True)
    monkeypatch.setenv(VARIABLE, "0")
    found = found_by_dynid(made, noises)
    # Central differences: truncation is about 1e-8, and rounding of the fits over the step 1e-9.
    assert_slopes(found, made, noises, 1e-5)
    monkeypatch.setenv(VARIABLE, "1")
    for name, slope in found_by_dynid(made, noises).items():
        assert slope == pytest.approx(found[name], abs=1e-7 * np.abs(found[name]).max())


def test_a_prior_takes_its_part():
    made, noise = SHAKEN.simulated()
    given = ParameterPrior(TRUE[1], 0.004)
    prior = (1, TRUE[1], np.sqrt(np.log1p(0.004**2)))
    found = found_by_dynid([made], [noise], structure(prior=given))
    assert_slopes(found, [made], [noise], 1e-5, prior=prior)
    free = found_by_dynid([made], [noise])
    name = "acceleration gain of base"
    assert np.abs(found[name][1]) < 0.5 * np.abs(free[name][1])


def test_an_estimate_at_its_bound_stays_there():
    made, noise = SHAKEN.simulated()
    bound = TRUE[1] * (1 + 1e-6)  # a millionth off: what is left of the record is no more than that
    found = found_by_dynid([made], [noise], structure(low=bound))
    assert_slopes(found, [made], [noise], 1e-4, held={1: bound})


def test_with_noise_the_slopes_hold_to_its_order():
    made, noise = TWO_FORCES.simulated(0.02, 8)
    # Gauss–Newton leaves out products of second derivatives and residuals, which are 2 % of the signal.
    assert_slopes(found_by_dynid([made], [noise]), [made], [noise], 0.05, steps=8)


def test_missing_samples_have_no_part():
    made, noise = SHAKEN.simulated()
    gone = made.measured.copy()
    gone[::5, 1] = np.nan
    part = slopes(identify(structure(), [replace(made, measured=gone).experiment(noise)]))
    sums = sum(part[f"gain of {channel}"] for channel in ("1.velocity", "4.acceleration"))
    assert sums == pytest.approx(-part["acceleration gain of base"], rel=1e-7)
    whole = found_by_dynid([made], [noise])
    assert not np.allclose(part["gain of 1.velocity"], whole["gain of 1.velocity"], rtol=1e-3)


def test_gains_of_all_channels_undo_that_of_the_force():
    """The system is linear, and its initial state is free."""
    made, noise = RANDOM.simulated(0.05, 3)
    found = found_by_dynid([made], [noise])
    sensors = found["gain of 2.acceleration"] + found["gain of 4.velocity"]
    residual = 0.05  # what the force does to the prediction, the gains do to the record
    assert sensors == pytest.approx(-found["force gain of 4"], abs=residual)


def test_a_reduction_that_keeps_all_modes_changes_nothing():
    made, noise = TWO_FORCES.simulated()
    small = reduce(structure(), "craig-bampton", masters=[1, 2, 4], modes=[1])
    full, reduced = (found_by_dynid([made], [noise], model) for model in (structure(), small))
    for name, slope in full.items():
        assert reduced[name] == pytest.approx(slope, abs=1e-6 * np.abs(slope).max())


def test_a_ring_down_has_no_force_to_calibrate():
    record = Record([], [(1, "velocity"), (3, "velocity")])
    made, noise = record.simulated()
    found = found_by_dynid([made], [noise])
    assert set(found) == {"gain of 1.velocity", "gain of 3.velocity"}
    # Both alike only scale the motion, which nobody knows.
    both = found["gain of 1.velocity"] + found["gain of 3.velocity"]
    assert both == pytest.approx(0, abs=1e-6 * np.abs(found["gain of 1.velocity"]).max())
    assert np.abs(found["gain of 1.velocity"]).max() > 1e-3


LINES = np.linspace(20, 260, 60)
FRFS = [(2, "acceleration", 4), (3, "velocity", 4), (2, "acceleration", 1)]


def responses(theta):
    M, C, K = matrices(theta)
    out = []
    for omega in LINES:
        H = np.linalg.inv(K + 1j * omega * C - omega**2 * M)
        out.append([(1j * omega) ** ORDERS[what] * H[dof - 1, force - 1] for dof, what, force in FRFS])
    return np.array(out)


def test_slopes_of_frequency_responses_are_those_of_estimating_anew():
    measured = responses(TRUE)
    noise = 0.01 * np.sqrt(np.mean(np.abs(measured) ** 2, axis=0))
    channels = tuple(Frf(Channel(dof, what), force) for dof, what, force in FRFS)
    result = identify(structure(), FrfMeasurement(LINES, channels, measured, noise.tolist()))
    found = slopes(result)

    def estimate(name, change):
        factors = np.array(
            [[f"force gain of {force}" == name, f"gain of {dof}.{what}" == name] for dof, what, force in FRFS]
        )
        model, data = np.exp(change * factors).T
        late = np.exp(-1j * LINES[:, None] * change * (name == "trigger delay"))

        def residual(eta):
            left = (measured * data - responses(np.exp(eta)) * model * late) / noise
            return np.concatenate([left.real, left.imag]).ravel()

        eta = np.log(TRUE)
        both = [(residual(eta + e), residual(eta - e)) for e in 1e-5 * np.eye(4)]
        J = np.column_stack([(ahead - behind) / 2e-5 for ahead, behind in both])
        for _ in range(3):
            eta = eta - np.linalg.lstsq(J, residual(eta))[0]
        return eta

    sensors = ["gain of 2.acceleration", "gain of 3.velocity"]
    assert list(found) == ["force gain of 4", "force gain of 1", "trigger delay", *sensors]
    for name, slope in found.items():
        step = 1e-7 if name == "trigger delay" else 1e-4
        wanted = (estimate(name, step) - estimate(name, -step)) / (2 * step)
        assert slope == pytest.approx(wanted, abs=1e-5 * np.abs(wanted).max()), name


def test_samples_that_a_robust_loss_bounds_have_no_part():
    """Estimated anew with Huber's loss, by the estimator itself: few samples change sides in a small step."""
    made, noise = TWO_FORCES.simulated(0.02, 5)
    made.measured[[20, 70, 71], [0, 1, 2]] += 40 * noise[[0, 1, 2]]

    def run(factor):
        moved = [
            (dof, *given) if dof != 4 else (dof, [factor * a for a in given[0]], given[1])
            for dof, *given in made.loads
        ]
        return identify(structure(), [replace(made, loads=moved).experiment(None)], Huber(Auto()))

    step = 1e-3
    ahead, behind = (np.log(parameter(run(np.exp(sign * step)), "estimate")) for sign in (1, -1))
    wanted = (ahead - behind) / (2 * step)
    found = slopes(run(1.0))["force gain of 4"]
    # The robust deviation and the inner iteration, which stops at 1 % of a standard error, move as well.
    assert found == pytest.approx(wanted, abs=0.05 * np.abs(wanted).max())


def test_a_plan_predicts_the_slopes():
    loads, measured = LOADS, simulated(1e-6, samples=300)
    planned = plan(suspension(), [Experiment(loads, measured)], PlanRequest(sensors=1, lines=1))
    found = identify(suspension(), [Experiment(loads, measured)])
    # The channels' weights differ: the plan knows the noise, 300 residuals determine it to 4 %.
    for name, slope in slopes_of(planned, found).items():
        assert slope[0] == pytest.approx(slope[1], abs=0.02 * np.abs(slope[1]).max()), name


def slopes_of(*results):
    each = [slopes(result) for result in results]
    assert all(one.keys() == each[0].keys() for one in each)
    return {name: [one[name] for one in each] for name in each[0]}


def test_what_is_not_identifiable_has_no_slope():
    """Two springs in parallel: only their sum is identifiable."""
    joints = [Joint(name, (2, 3), JointParameter(start=1e4, true=1e4)) for name in ("one", "other")]
    model = lumped([2, 2, 1], [Link((1,), 2e4, 20), Link((1, 2), 3e4, 30), Link((3,), 1e4, 9)], joints)
    planned = plan(
        model, [Experiment((Load(1, LOADS[0].signal),), simulated(0.01, samples=200))], PlanRequest(1, 1)
    )
    assert np.isnan(planned["identification/considered/slope"].data).all()
    assert list(calibration_sentences(planned)) == []


def test_slopes_are_computed_only_where_they_are_wanted(monkeypatch):
    def refused(*_):
        raise AssertionError

    experiment = Experiment(LOADS, simulated(0.05, samples=200))
    into = Selection("identification", ["identification/considered/slope"])
    found = identify(suspension(), [experiment], into=into)
    assert found["identification/considered/slope"].data.shape == (4, 13)
    monkeypatch.setattr(posterior, "calibration_slopes", refused)
    into = Selection("identification", ["identification/parameters/estimate"])
    identify(suspension(), [experiment], into=into)


def result_with(slope, change, errors, quantities=("force gain of 5", "trigger delay", "gain of 2.velocity")):
    result = Result("identification")
    group = "identification/considered"
    result.add_axis(f"{group}/parameter", ["a.k", "a.c"])
    result.add_axis(f"{group}/quantity", list(quantities))
    result.add(f"{group}/change", change, ("quantity",))
    result.add(f"{group}/slope", slope, ("parameter", "quantity"))
    result.add("identification/parameters/estimate", [2.0, 4.0], ("parameter",))
    result.add("identification/parameters/standard_error", 2 * np.array(errors) * [1, 2], ("parameter",))
    return result


def test_the_largest_relative_effect_is_printed_beside_that_in_standard_errors():
    slope = [[0.2, 6.5, 0.0], [0.1, 46.0, 0.0]]
    said = list(calibration_sentences(result_with(slope, [0.01, 0.002, 0.01], [0.00002, 0.001])))
    assert said == [
        "a gain error of 1 % in the force at DOF 5 would bias a.k by +0.2 % (100 standard errors)",
        "a trigger delay of one sample (2 ms) would bias a.k by +1.3 % (650 standard errors) "
        "and a.c by +9.2 % (92 standard errors)",
        "the error bars do not include these errors",
    ]


def test_the_largest_effects_are_printed():
    change = [0.01, 0.002, 0.01]
    slope = [[0.2, 10.0, 0.0], [-1.6, 5.0, 0.003]]
    assert list(calibration_sentences(result_with(slope, change, [0.001, 0.01]))) == [
        "a gain error of 1 % in the force at DOF 5 would bias a.k by +0.2 % (2 standard errors) "
        "and a.c by -1.6 % (1.6 standard errors)",
        "a trigger delay of one sample (2 ms) would bias a.k by +2 % (20 standard errors)",
        "the error bars do not include these errors",
    ]
    assert list(calibration_sentences(result_with(slope, change, [0.1, 0.1]))) == [
        "a gain error of 1 % in the force at DOF 5 would bias a.c by -1.6 % (0.16 standard errors)",
        "a trigger delay of one sample (2 ms) would bias a.k by +2 % (0.2 standard errors)",
    ]
    (caveat,) = calibration_caveats(result_with(slope, change, [0.001, 0.01]))
    assert (caveat.tone, caveat.reader) == ("bad", "page")
    assert caveat.text == (
        "a trigger delay of one sample (2 ms) would bias a.k by +2 % (20 standard errors); "
        "the intervals include neither errors of gains nor of delays"
    )
    (caveat,) = calibration_caveats(result_with(slope, change, [0.1, 0.1]))
    assert caveat.text.endswith("would bias a.k by +2 % (0.2 standard errors)")
    assert caveat.tone == ""
    assert not list(calibration_caveats(Result("identification")))
    (part,) = calibration_sections(result_with(slope, change, [0.1, 0.1]))
    grid = next(block for block in part.blocks if isinstance(block, TextTable))
    assert grid.rows[0] == ("a gain error of 1 % in the force at DOF 5", "+0.2 %", "-1.6 %")
    assert grid.rows[2] == ("a gain error of 1 % in 2.velocity", "-", "+0.003 %")
    assert not list(calibration_sections(Result("identification")))
