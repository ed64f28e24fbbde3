"""The compiled kernels give what NumPy gives, and are there only for those who gain by them."""

import math
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from dynid import native
from dynid.errors import Diverged, UsageError
from dynid.identification import least_squares
from dynid.identification.estimators import filter as filtering
from dynid.identification.estimators.filter import LINEARISED_DEVIATIONS, filter_pass
from dynid.identification.estimators.filter_passes import first_noise, wide_prior
from dynid.identification.likelihood.time_record import TimeLikelihood, TimeRecord
from dynid.identification.records.measurement import RecordData
from dynid.identification.systems import kernels
from dynid.identification.systems.parametric_model import ParametricModel, parametric_model
from dynid.identification.systems.prediction import free_prediction
from dynid.identification.systems.record_values import data
from dynid.lti.signals import Chirp, Step
from dynid.native import VARIABLE
from dynid.structure.joints import Joint
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.identification.cases import LOADS, VELOCITIES, simulated, suspension, unknown

needs_library = pytest.mark.skipif(native.found() is None, reason="installed without the library")


def paths(monkeypatch, fits, origin, spread=2.0):
    """Return the same pass both ways."""
    passes = []
    for wish in "01":
        monkeypatch.setenv(VARIABLE, wish)
        passes.append(one_pass(fits, origin, spread))
    return passes


def one_pass(fits, origin, spread=2.0):
    prior = wide_prior(fits, origin, spread)
    return filter_pass(fits.model, fits.data.values, prior, 0.1 * fits.data.rms, origin)


def fits_of(model, channels=VELOCITIES, loads=LOADS, step=0.002, samples=60, missing=()):
    measurement = simulated(0.05, 3, settle=0.5, samples=samples, channels=channels)
    measurement = type(measurement)(step, samples, channels, measurement.source)
    record = data(model, loads, measurement)
    values = record.values.copy()
    for place in missing:
        values[place] = np.nan
    return TimeRecord(parametric_model(model, loads, channels, measurement.record.times), RecordData(values))


def origin_of(model):
    return np.log([unknown.start for unknown in model.unknowns])


def assert_same(plain, kernel, tolerance):
    for one, other in zip(plain, kernel, strict=True):
        np.testing.assert_allclose(other, one, rtol=0, atol=tolerance * np.nanmax(np.abs(one)))


@pytest.mark.parametrize("missing", [[], [(0, 0), (5, 1), (6, 0), (6, 1)]])
@pytest.mark.parametrize(
    "channels",
    [VELOCITIES, (Channel(2, "acceleration"), Channel(5, "displacement"), Channel(3, "velocity"))],
)
def test_both_ways_give_the_same_numbers(monkeypatch, channels, missing):
    model = suspension()
    plain, kernel = paths(
        monkeypatch, fits_of(model, channels, samples=200, missing=missing), origin_of(model)
    )
    assert_same(plain, kernel, 1e-11)  # rounding, carried along by 200 nonlinear steps


def test_loads_that_do_not_act_are_as_if_they_were_not_there(monkeypatch):
    model = suspension()
    alone = fits_of(model)
    both = fits_of(model, loads=(*LOADS, Load(2, Step(50.0))))
    both = replace(both, model=both.model.driven_by([0]), data=alone.data)
    for one, other in zip(
        paths(monkeypatch, alone, origin_of(model)), paths(monkeypatch, both, origin_of(model)), strict=True
    ):
        assert_same(one, other, 1e-11)  # rounding, carried along by 60 nonlinear steps


@settings(max_examples=15, deadline=None)
@given(
    size=st.integers(1, 4),
    stiffness=st.floats(1.0, 1e5),
    damping=st.floats(0.0, 0.3),
    joint=st.integers(0, 3),
    step=st.sampled_from([1e-3, 1e-2]),
    order=st.sampled_from(["displacement", "velocity", "acceleration"]),
)
def test_any_small_model_goes_both_ways(size, stiffness, damping, joint, step, order):
    links = [Link((1,), stiffness, damping * stiffness**0.5)]
    links += [Link((i, i + 1), stiffness, damping * stiffness**0.5) for i in range(1, size)]
    place = 1 + joint % size
    model = lumped([1.0] * size, links, [Joint("j", (place,), unknown(stiffness, 0.8), unknown(3.0, 1.5))])
    fits = fits_of(model, (Channel(1 + (joint + 1) % size, order),), (Load(1, Step(1.0)),), step)
    with pytest.MonkeyPatch.context() as patch:
        try:
            # Both round differently, and each processor's linear algebra does, too; stiff models carry it
            # along: at most 2.4e-9 was seen.
            assert_same(*paths(patch, fits, origin_of(model), 0.3), 1e-7)
        except Diverged as lost:  # the first way: the second must say the same
            patch.setenv(VARIABLE, "1")
            with pytest.raises(Diverged, match=re.escape(lost.problem)):
                one_pass(fits, origin_of(model), 0.3)


@pytest.mark.parametrize("seed", range(3))
def test_steps_made_now_and_then_serve_as_well_as_those_of_every_sample(monkeypatch, seed):
    """What they leave out is no hundredth of a standard deviation, at any time."""
    monkeypatch.setenv(VARIABLE, "1")
    model, measurement = suspension(), simulated(0.05, seed, settle=10)
    joint = parametric_model(model, LOADS, VELOCITIES, measurement.record.times)
    fits = TimeRecord(joint, data(model, LOADS, measurement))
    origin, noise = origin_of(model), first_noise(TimeLikelihood((fits,)))[0]
    some, every = (
        filter_pass(joint, fits.data.values, wide_prior(fits, origin), noise, origin, part)
        for part in (LINEARISED_DEVIATIONS, 0.0)
    )
    assert np.abs((some.eta - every.eta) / every.deviations).max() < 0.01
    np.testing.assert_allclose(some.deviations[-1], every.deviations[-1], rtol=1e-3)


def test_steps_that_no_series_reaches_are_made_as_ever(monkeypatch):
    """Frequency times step passes the limit as the stiffness moves: both sorts of step in one pass."""
    model = lumped([1.0], [], [Joint("j", (1,), unknown(4e6, 0.1), unknown(40.0, 0.5))])
    fits = fits_of(model, (Channel(1, "velocity"),), (Load(1, Step(1.0)),), 2e-3, 120)
    made = []
    transition = ParametricModel.transition
    monkeypatch.setattr(ParametricModel, "transition", lambda *args: made.append(0) or transition(*args))
    plain, kernel = paths(monkeypatch, fits, origin_of(model))
    by_kernel = len(made)
    monkeypatch.setenv(VARIABLE, "0")
    one_pass(fits, origin_of(model))
    without = len(made) - by_kernel
    assert 0 < by_kernel - without < without
    assert_same(plain, kernel, 1e-9)


@pytest.mark.parametrize("missing", [[], [(0, 0), (5, 1), (6, 0), (6, 1)]])
@pytest.mark.parametrize("channels", [VELOCITIES, (Channel(2, "acceleration"), Channel(5, "displacement"))])
def test_fits_are_the_same_both_ways(monkeypatch, channels, missing):
    model = suspension()
    fits = fits_of(model, channels, samples=200, missing=missing)
    both = []
    for wish in "01":
        monkeypatch.setenv(VARIABLE, wish)
        fit = fits.fit(origin_of(model), fits.data.values)
        found = fits.information(fit, fit.noise)
        sizes = fits.residual_rms_of(origin_of(model) + np.array([[0.0], [0.1]]))
        assert_same(sizes[:1], [np.sqrt(np.nanmean(fit.residual**2, axis=0))], 1e-12)
        both.append((*fit.predicted, fit.noise, found.covariance(), found.total, sizes))
    assert_same(*both, 1e-10)  # rounding, times the condition of the state's sensitivities


@pytest.mark.parametrize("noise", [None, np.array([1e-3, 10.0])])
def test_the_first_state_of_a_fit_is_the_shortest_of_the_best(monkeypatch, noise):
    """Of a mass that no channel sees it stays at zero; against the pseudo-inverse of all rows."""
    links = [Link((1,), 400.0, 2.0), Link((1, 2), 900.0, 1.0), Link((3,), 100.0, 1.0)]
    model = lumped([1.0, 2.0, 1.0], links, [Joint("j", (2,), unknown(300.0, 200.0), unknown(3.0, 2.0))])
    fits = fits_of(model, (Channel(1, "velocity"), Channel(2, "acceleration")), (Load(1, Step(1.0)),), 0.01)
    monkeypatch.setenv(VARIABLE, "auto")
    eta = origin_of(model)
    fit = fits.fit(eta, fits.data.values, noise)
    assert not fit.predicted.start[[2, 5]].any()
    free, _ = free_prediction(fits.model, eta)
    level = fits.data.rms if noise is None else noise
    rows = ((free.by_state @ fits.root) / level[:, None]).reshape(-1, 6)
    best = fits.root @ np.linalg.pinv(rows, 1e-10) @ ((fits.data.values - free.forced) / level).ravel()
    np.testing.assert_allclose(fit.predicted.start, best, rtol=0, atol=1e-11 * np.abs(best).max())


@pytest.mark.parametrize("wish", ["0", "auto"])
@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
@pytest.mark.parametrize(
    ("rows", "columns", "rank"), [(1, 1, 1), (9, 4, 4), (30, 10, 7), (90, 5, 3), (3, 8, 2), (6, 2, 0)]
)
def test_ranges_and_solutions_of_given_rank(monkeypatch, wish, scale, rows, columns, rank):
    """Of a product whose factors have orthonormal columns: known range, shortest solution by hand."""
    monkeypatch.setenv(VARIABLE, wish)
    rng = np.random.default_rng(7)
    U, V = (np.linalg.qr(rng.standard_normal((size, rank)))[0] for size in (rows, columns))
    s, right = 10.0 ** -np.arange(rank), rng.standard_normal(rows)
    matrix = U * s @ V.T
    found = least_squares.basis(scale * matrix, 1e-9)
    np.testing.assert_allclose(found @ found.T, U @ U.T, atol=1e-9)
    np.testing.assert_allclose(found.T @ found, np.eye(rank), atol=1e-14)
    x = least_squares.least_squares(scale * matrix, scale * right, 1e-9)
    np.testing.assert_allclose(x, V @ ((U.T @ right) / s), rtol=0, atol=1e-8 * max([1.0, *(1 / s)]))


@settings(max_examples=25, deadline=None)
@given(rows=st.integers(1, 300), columns=st.integers(1, 20), seed=st.integers(0, 1000))
@example(rows=1, columns=15, seed=707)  # rounding of rounding: the squares leave the range
def test_triangles_keep_lengths_and_angles(rows, columns, seed):
    """Against the rows themselves, whose products with each other a triangle of them keeps."""
    values = (
        np.random.default_rng(seed).standard_normal((rows, 2, columns)) * 10.0 ** np.arange(-2, 0)[:, None]
    )
    grams = np.einsum("tci,tcj->cij", values, values)
    by_kernel, counts = kernels.triangles(
        values[..., :-1].copy(), values[..., :0], values[..., -1].copy(), np.ones(2)
    )
    assert counts.tolist() == [rows, rows]
    for found in (least_squares.triangular_factors(values), by_kernel):
        np.testing.assert_array_equal(found, np.triu(found))
        size = np.sqrt(np.einsum("cii->ci", grams))
        error = (np.einsum("cki,ckj->cij", found, found) - grams) / size[:, :, None] / size[:, None]
        assert np.abs(error).max() < 1e-13


def test_intervals_of_several_lengths(monkeypatch):
    """A chirp whose own breakpoints and substeps fall between the samples."""
    model = suspension()
    chirp = Chirp(100.0, 20.0, 200.0, 0.4)
    fits = fits_of(model, loads=(Load(5, chirp), Load(1, Step(3.0, 0.5031))), samples=80)
    assert len(fits.model.line.nodes) > 80
    assert_same(*paths(monkeypatch, fits, origin_of(model)), 1e-10)


@pytest.mark.parametrize("wish", ["0", "1"])
def test_a_run_away_is_named_both_ways(monkeypatch, wish):
    model = suspension()
    fits = fits_of(model)
    monkeypatch.setenv(VARIABLE, wish)
    monkeypatch.setattr(filtering, "RUNAWAY", 0.05)
    with pytest.raises(Diverged, match="away from"):
        one_pass(fits, origin_of(model))


def test_without_the_library_numpy_does_the_same(monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    model = suspension()
    fits = fits_of(model, samples=30)
    with_library = one_pass(fits, origin_of(model))
    monkeypatch.setattr(native, "found", lambda: None)
    assert not native.compiled()
    assert_same(one_pass(fits, origin_of(model)), with_library, 1e-11)
    monkeypatch.setenv(VARIABLE, "1")
    with pytest.raises(UsageError, match=r"installed without its library\. Install it again"):
        native.compiled()


def test_the_library_is_asked_for_by_a_variable(monkeypatch):
    monkeypatch.setenv(VARIABLE, "0")
    assert not native.compiled()
    monkeypatch.setenv(VARIABLE, "yes")
    with pytest.raises(UsageError, match=r"DYNID_COMPILED is 'yes'\. Set it to 0, 1 or auto"):
        native.compiled()


def test_what_is_no_library_of_this_version_is_passed_over(tmp_path):
    (tmp_path / "library.so").write_bytes(b"no library")
    assert native._loaded(tmp_path / "library.so") is None
    assert native._loaded(tmp_path / "absent.so") is None


@needs_library
def test_arguments_that_the_library_cannot_take_are_refused():
    with pytest.raises(ValueError, match="contiguous"):
        native.structure(each=np.zeros((4, 4))[:, ::2])


@needs_library
def test_the_library_that_every_machine_runs_gives_the_same(monkeypatch):
    """The one with wide registers, beside that of any processor."""
    model = suspension()
    fits = fits_of(model, samples=100)
    plain = native._loaded(next(Path(native.__file__).parent.glob("library.plain.*")))
    wide = one_pass(fits, origin_of(model))
    monkeypatch.setattr(native, "found", lambda: plain)
    assert_same(one_pass(fits, origin_of(model)), wide, 1e-11)


@needs_library
def test_lengths_of_rows_neither_overflow_nor_vanish():
    """Squares of the ordinary; rows in their own units as soon as one is extreme."""
    for rows in ([[3.0, 4.0], [5.0, 12.0]], [[3e200, 4e200], [0.0, 0.0]], [[3e-200, 4e-200], [1.0, 0.0]]):
        S, lengths = kernels.padded(np.array(rows)), np.zeros(2)
        native.call("dynid_lengths", S, 2, S.shape[1], lengths)
        np.testing.assert_allclose(lengths, [math.hypot(*row) for row in rows], rtol=1e-15)
    gaps = np.array([[1.0, np.nan], [np.nan, 2.0], [2.0, np.nan]])
    found, counts = kernels.triangles(np.ones((3, 2, 1)), np.zeros((3, 2, 1)), gaps, np.ones(2))
    assert counts.tolist() == [2, 1]
    for factor, rows in zip(found, ([[1, 0, 1], [1, 0, 2]], [[1, 0, 2]]), strict=True):
        np.testing.assert_allclose(factor.T @ factor, np.array(rows).T @ np.array(rows), atol=1e-14)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")
def test_the_library_stays_within_its_arrays(tmp_path):
    """Compiled anew with checks of every address, which run in the memory of all of Python."""
    sources = sorted(Path(native.__file__).parent.glob("*.c"))
    flags = ["-g", "-O1", "-std=gnu11", "-fPIC", "-shared", "-Wno-psabi", "-mavx2", "-mfma"]
    checks = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    target = tmp_path / "library.so"
    subprocess.run(["gcc", *flags, *checks, *map(str, sources), "-o", str(target), "-lm"], check=True)
    runtime = [
        subprocess.run(["gcc", f"-print-file-name={name}"], check=True, capture_output=True, text=True)
        for name in ("libasan.so", "libubsan.so")
    ]
    environment = {
        **os.environ,
        "LD_PRELOAD": " ".join(each.stdout.strip() for each in runtime),
        "ASAN_OPTIONS": "detect_leaks=0",
        "PYTHONMALLOC": "malloc",
    }
    files = ["tests/identification/test_kernels.py", "tests/bondgraph/test_compiled_response.py"]
    script = (
        "import pathlib, pytest, sys; from dynid import native\n"
        f"library = native._loaded(pathlib.Path({str(target)!r}))\n"
        "native.found = lambda: library\n"
        f"sys.exit(pytest.main(['-q', '-x', '-p', 'no:cacheprovider', *{files}]))"
    )
    root = Path(__file__).parents[2]
    subprocess.run([sys.executable, "-c", script], check=True, env=environment, cwd=root, timeout=900)


@needs_library
@pytest.mark.parametrize("norm", [3.9, 7.9, 15.9, 31.9])
def test_the_longest_steps_are_exact_and_read_nothing_behind_the_table_of_forces(monkeypatch, norm):
    """Halved so often that the series just reaches them, they take all degrees of the table."""
    monkeypatch.setenv(VARIABLE, "1")
    table = kernels._forcing

    def followed_by_nothing(*args):
        forcing, turned = table(*args)
        room = np.full(2 * forcing.size, np.nan)
        room[: forcing.size] = forcing.ravel()
        return room[: forcing.size].reshape(forcing.shape), turned

    monkeypatch.setattr(kernels, "_forcing", followed_by_nothing)
    model = lumped([1.0], [], [Joint("j", (1,), unknown(4e4, 0.1), unknown(40.0, 0.5))])
    channels, loads, eta = (Channel(1, "velocity"),), (Load(1, Step(1.0)),), origin_of(model)
    scaled = np.abs(fits_of(model, channels, loads).model.at(eta).A).sum(axis=0).max()  # 1-norm
    joint = fits_of(model, channels, loads, norm / scaled, 9).model
    at, missed = kernels.linear(joint, eta), np.zeros(1, dtype=bool)
    native.call("dynid_prepare", kernels.tables(joint), at.members, missed)
    assert not missed.any()
    expected = kernels.linear(joint, eta)
    kernels.place(expected, 0, joint.transition(eta, norm / scaled))
    assert_same([expected.forward], [at.forward], 1e-12)  # rounding, squared up to three times


@needs_library
def test_a_table_of_forces_takes_no_more_than_its_limit(monkeypatch):
    joint = fits_of(suspension()).model
    size = kernels._forcing(joint, joint.affine)[0].size
    for limit in (size, size // 3, 1):
        monkeypatch.setattr(kernels, "FORCING_TABLE", replace(kernels.FORCING_TABLE, value=limit))
        assert kernels._forcing(joint, joint.affine)[0].size <= limit


@needs_library
def test_forces_too_many_for_a_table_give_the_same_pass(monkeypatch):
    fits = [fits_of(suspension()) for _ in range(2)]
    monkeypatch.setenv(VARIABLE, "1")
    origin = np.log([unknown.start for unknown in suspension().unknowns])
    with_table = one_pass(fits[0], origin)
    monkeypatch.setattr(kernels, "FORCING_TABLE", replace(kernels.FORCING_TABLE, value=0))
    without = one_pass(fits[1], origin)
    assert len(kernels._forcing(fits[1].model, fits[1].model.affine)[0]) == 0
    np.testing.assert_allclose(without.eta, with_table.eta, rtol=1e-10)


@needs_library
@pytest.mark.parametrize("samples", [5, 256, 600])
def test_long_records_are_fitted_block_by_block(monkeypatch, samples):
    """With gaps, and across the ends of blocks: what sensitivities of all samples at once give."""
    model = suspension()
    fits = fits_of(model, samples=samples, missing=[(2, 0), (samples - 1, 1)])
    eta = origin_of(model)
    plain = fits.fit(eta, fits.data.values)
    assert fits.predicted(plain) is not None
    monkeypatch.setattr("dynid.identification.likelihood.time_record._MAX_KEPT_NUMBERS", 0)
    monkeypatch.setattr("dynid.identification.likelihood.time_record._MAX_BLOCK_NUMBERS", 1)
    longer = replace(fits)
    fit = longer.fit(eta, longer.data.values)
    assert longer.channel_blocks() == [slice(0, 1), slice(1, 2)]
    np.testing.assert_array_equal(fit.triangles, plain.triangles)
    np.testing.assert_array_equal(fit.residual, plain.residual)
    residual = longer.residual(eta)
    np.testing.assert_allclose(residual, plain.residual, rtol=0, atol=1e-12 * fits.data.rms.max())
    by_all = fits.predicted(plain)
    for channel, part in longer.channelwise(fit):
        np.testing.assert_array_equal(part.by_state[:, 0], by_all.by_state[:, channel])
        np.testing.assert_array_equal(part.by_parameter[:, 0], by_all.by_parameter[:, channel])
