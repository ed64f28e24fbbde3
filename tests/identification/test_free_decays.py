"""Fits in decays that channels share: the fits of every channel by itself, and exact free responses."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.least_squares import tall_qr
from dynid.identification.likelihood import shared_decays, time_record
from dynid.identification.likelihood.nonlinearity import nonlinearity
from dynid.identification.likelihood.shared_decays import fit_from
from dynid.identification.problem import Problem
from dynid.identification.records.measurement import Experiment
from dynid.identification.systems import free_decays, kernels, prediction
from dynid.identification.systems.prediction import sensitive_runs
from dynid.parameters import starts
from dynid.structure.ports import Channel
from tests.identification.cases import LOADS, parameter, run, simulated, suspension
from tests.identification.test_kernels import fits_of, needs_library

CHANNELS = tuple(Channel(dof, quantity) for dof in (1, 2, 4) for quantity in ("displacement", "acceleration"))


@pytest.fixture
def shared(monkeypatch):
    """Fits share decays however small the record is."""
    monkeypatch.setattr(free_decays, "SHARED_DECAYS", replace(free_decays.SHARED_DECAYS, value=0))


@pytest.mark.usefixtures("shared")
@pytest.mark.parametrize("sign", [1, -1], ids=["decaying", "growing"])
def test_weighted_decays_are_the_free_response(sign, monkeypatch):
    record = fits_of(suspension(), CHANNELS[:4])
    eta = starts(record.unknowns)
    at = record.model.at(eta)
    at = at._replace(A=sign * at.A)
    monkeypatch.setattr(type(record.model), "at", lambda *_: at)
    decays = free_decays.free_decays(record.model, eta)
    times = record.model.times - record.model.times[0]
    for c, row in enumerate(at.C):
        exact = np.array([row @ expm(at.A * t) for t in times])
        np.testing.assert_allclose(decays.by_state(c), exact, atol=1e-11 * np.abs(exact).max())


@needs_library
@pytest.mark.usefixtures("shared")
@pytest.mark.parametrize("block", [1, 7, 150], ids="blocks of {} samples".format)
def test_a_fit_in_shared_decays_is_that_of_each_channel(block, monkeypatch):
    monkeypatch.setattr(prediction, "_LONGEST_RUN", block)
    record = fits_of(suspension(), CHANNELS, samples=150)
    eta, values = starts(record.unknowns) + 0.1, record.data.values
    noise = record.data.rms * np.linspace(0.5, 2, len(CHANNELS))
    assert record.decays(eta) is not None
    shared = [
        record.fit(eta, values, noise),
        record.residual(eta),
        list(record.channelwise(record.fit(eta, values))),
    ]
    monkeypatch.setattr(time_record, "free_decays", lambda *_: None)
    alone = [
        record.fit(eta, values, noise),
        record.residual(eta),
        list(record.channelwise(record.fit(eta, values))),
    ]
    np.testing.assert_allclose(shared[0].predicted.start, alone[0].predicted.start, rtol=1e-8)
    np.testing.assert_allclose(shared[0].predicted.outputs, alone[0].predicted.outputs, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(shared[0].noise, alone[0].noise, rtol=1e-9)
    np.testing.assert_array_equal(shared[0].counts, alone[0].counts)
    for ours, theirs in zip(shared[0].triangles, alone[0].triangles, strict=True):
        size = np.linalg.norm(theirs, axis=0)
        np.testing.assert_allclose(
            ours.T @ ours / np.outer(size, size), theirs.T @ theirs / np.outer(size, size), atol=1e-10
        )
    np.testing.assert_allclose(shared[1], alone[1], atol=1e-9 * np.abs(alone[1]).max())
    for (c, ours), (d, theirs) in zip(shared[2], alone[2], strict=True):
        assert c == d
        for x, y in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(x, y, atol=1e-9 * np.abs(y).max())


@needs_library
@pytest.mark.usefixtures("shared", "complete")
def test_default_results_cost_less_than_ten_times_the_estimate(monkeypatch):
    work = []

    def counted(model, *arguments):
        work.append(len(model.times) * model.states**2 * (1 + model.parameters))
        return sensitive_runs(model, *arguments)

    monkeypatch.setattr(shared_decays, "sensitive_runs", counted)
    measurement = simulated(0.05, channels=CHANNELS, samples=250)
    record = Problem.of(suspension(0.8), [Experiment(LOADS, measurement)]).likelihood
    estimate = OutputError().run(record, starts(record.unknowns))
    requested = sum(work)
    work.clear()
    result = run(suspension(0.8), measurement)
    assert requested > 0
    assert sum(work) < 10 * requested
    # Large records begin with a fit of their first part.
    assert list(result.value("identification/stages/stage")) == ["the start"]
    error = np.log(parameter(result, "estimate")) - estimate.fit.eta
    deviations = parameter(result, "standard_error") / parameter(result, "estimate")
    assert np.abs(error / deviations).max() < 1e-3


@pytest.mark.usefixtures("shared")
def test_channels_with_gaps_and_poles_that_coincide_share_none(monkeypatch):
    gapped = fits_of(suspension(), CHANNELS, missing=[(3, 1)])
    assert gapped.decays(starts(gapped.unknowns)) is None
    record = fits_of(suspension(), CHANNELS)
    defective = np.eye(record.model.states) + np.eye(record.model.states, k=1)
    at = record.model.at(starts(record.unknowns))
    monkeypatch.setattr(type(record.model), "at", lambda *_: at._replace(A=defective))
    assert free_decays.free_decays(record.model, starts(record.unknowns)) is None


@needs_library
@pytest.mark.usefixtures("shared")
def test_the_derivatives_of_a_long_record_are_never_held_at_once(monkeypatch):
    monkeypatch.setattr(prediction, "_LONGEST_RUN", 200)
    record = fits_of(suspension(), CHANNELS, samples=8000)
    eta, values = starts(record.unknowns), record.data.values
    decays = record.decays(eta)
    assert decays.factors[0].shape == (len(values), record.model.states)
    tracemalloc.start()
    fit_from(record.model, kernels.steps_at(record.model, eta), decays, record.model.initial, values)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # Outputs, residuals, direct terms, states, blocks; all derivatives with a copy were twice the unknowns.
    assert peak < (6 + len(eta) / 2) * values.nbytes


@needs_library
@pytest.mark.usefixtures("shared")
def test_the_score_test_in_shared_decays_is_that_of_each_channel(monkeypatch):
    measurement = simulated(0.05, channels=CHANNELS, samples=300)
    likelihood = Problem.of(suspension(0.8), [Experiment(LOADS, measurement)]).likelihood
    fit = likelihood.fit(starts(likelihood.unknowns))
    shared = nonlinearity(likelihood, fit, white=True)
    monkeypatch.setattr(time_record, "free_decays", lambda *_: None)
    single = nonlinearity(likelihood, fit, white=True)
    np.testing.assert_allclose(np.log(shared.p), np.log(single.p), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose([shared.left, shared.degrees], [single.left, single.degrees], rtol=1e-9)


def test_small_records_share_none():
    record = fits_of(suspension(), CHANNELS)
    assert record.decays(starts(record.unknowns)) is None


@pytest.mark.parametrize("condition", [1, 1e7, 1e14, np.inf], ids="condition {:g}".format)
def test_tall_matrices_are_factorised_to_rounding_however_conditioned(condition):
    rng = np.random.default_rng(1)
    singular = np.geomspace(1, 1 / condition, 40) if np.isfinite(condition) else np.eye(40)[0]
    rows, columns = (np.linalg.qr(rng.standard_normal((size, 40)))[0] for size in (500, 40))
    matrix = (rows * singular) @ columns.T * np.geomspace(1e-100, 1e100, 40)
    Q, R = tall_qr(matrix)
    np.testing.assert_allclose(Q.T @ Q, np.eye(40), atol=1e-14)
    np.testing.assert_array_equal(R, np.triu(R))
    assert (np.abs(matrix - Q @ R).max(axis=0) <= 1e-14 * np.linalg.norm(matrix, axis=0)).all()
