"""Records of impacts and random forces: their modes, and what spoils them."""

import numpy as np
import pytest

from dynid.errors import UsageError
from dynid.modal.frf_matrix import FrfMatrix
from dynid.modal.modal_analysis import analyse
from dynid.modal.spectra import TimeRecord, defect, is_impact, spectra_of_records
from tests.modal.structures import modes, receptances

STEP = 1 / 512


def structure():
    """Return poles and shapes of five modes from 20 to 90 Hz, at three DOFs."""
    poles, shapes = modes(5, 3, damping=(0.006, 0.015), seed=3)
    return poles * 0.45, shapes


def responses_to(force, reference, noise, random):
    """Return displacements of all DOFs to a force that repeats itself, with noise of a part of their RMS."""
    poles, shapes = structure()
    long = max(len(force), round(30 / STEP))  # so that nothing is left when it begins again
    omega = 2 * np.pi * np.fft.rfftfreq(long, STEP)
    H = receptances(poles, shapes, (reference,), omega)[:, :, 0]
    values = np.fft.irfft(H * np.fft.rfft(force, long)[:, None], long, axis=0)[: len(force)]
    return values + noise * values.std(axis=0) * random.standard_normal(values.shape)


def impact(seed, seconds=8.0, reference=0, noise=0.01):
    """Return a record of an impact of 10 ms."""
    random = np.random.default_rng(seed)
    force = np.zeros(round(seconds / STEP))
    force[20:25] = (100 + 10 * random.standard_normal()) * np.sin(np.pi * np.arange(1, 6) / 6)
    names = ("a", "b", "c")
    values = responses_to(force, reference, noise, random)
    return TimeRecord(f"record {seed}", force[:, None], values, names, [names[reference]], STEP)


def random_record(seed, seconds=400.0):
    random = np.random.default_rng(seed)
    force = random.standard_normal(round(seconds / STEP))
    values = responses_to(force, 0, 0.01, random)
    return TimeRecord(f"record {seed}", force[:, None], values, ("a", "b", "c"), ["a"], STEP)


def analysed(spectra, references=("a",), **options):
    """Return the modal analysis of spectra between 12 and 100 Hz."""
    used = (spectra.omega > 2 * np.pi * 12) & (spectra.omega < 2 * np.pi * 100)
    pairs = [[(channel, reference) for reference in references] for channel in ("a", "b", "c")]
    values = np.array([[spectra.values[pair][used] for pair in row] for row in pairs]).transpose(2, 0, 1)
    variance = np.array([[spectra.variance[pair][used] for pair in row] for row in pairs]).transpose(2, 0, 1)
    frf = FrfMatrix(spectra.omega[used], values, np.sqrt(variance), np.ones(values.shape[1:]))
    points = [(("a", "b", "c").index(reference), column) for column, reference in enumerate(references)]
    if "window_rate" in options:
        frf = frf.windowed(1 / options["window_rate"])
    return analyse(frf, points, resolution=spectra.resolution, **options)


def errors(analysis):
    """Return errors of frequencies and damping ratios over their standard errors."""
    poles, _ = structure()
    reported = analysis.modes
    assert len(reported.omega) == len(poles)
    by_omega, by_damping, _ = reported.standard_errors
    omega, zeta = np.abs(poles), -poles.real / np.abs(poles)
    return (reported.omega - omega) / by_omega, (reported.damping - zeta) / by_damping


def test_modes_of_impacts_at_two_references():
    records = [impact(seed, reference=seed % 2) for seed in range(10)]
    spectra = spectra_of_records(records)
    assert spectra.notes == []
    analysis = analysed(spectra, ("a", "b"))
    for standard in errors(analysis):
        assert np.all(np.abs(standard) < 4.5)
    assert abs(analysis.reduced_chi2 - 1) < 0.15
    assert analysis.reciprocity > 1e-3


@pytest.mark.parametrize("window", [0.8, 0.5])
def test_an_exponential_window_is_corrected(window):
    records = [impact(seed, seconds=4.0, noise=0.002) for seed in range(8)]
    analysis = analysed(spectra_of_records(records, exponential=window), window_rate=1 / window)
    for standard in errors(analysis):
        assert np.all(np.abs(standard) < 4.5)
    assert np.all(analysis.fit.poles.real < -1 / window)


def test_random_records_with_long_segments():
    spectra = spectra_of_records([random_record(0)], segment=32.0)
    assert spectra.resolution == pytest.approx(1 / 32)
    for standard in errors(analysed(spectra)):
        assert np.all(np.abs(standard) < 4)


@pytest.mark.thorough
def test_leakage_leaves_no_standard_error():
    spectra = spectra_of_records([random_record(1, 60.0)], segment=2.0)
    reported = analysed(spectra).modes
    narrow = 2 * reported.damping * reported.omega / (2 * np.pi) * 2.0 < 4
    assert narrow.any()
    for error in reported.standard_errors[:2]:
        assert np.array_equal(np.isnan(error), narrow)


def test_defects_are_left_out_by_name():
    good, double, clipped, response = (impact(seed) for seed in range(4))
    double.force[300:305] = 0.4 * double.force[20:25]
    clipped.force[21:24] = clipped.force[21]
    at = int(np.argmax(response.values[:, 1]))
    response.values[at - 1 : at + 2, 1] = response.values[:, 1].max()
    assert not defect(good)
    assert "a double hit, 547 ms later with 40 % of the force" in defect(double)
    assert defect(clipped) == "the force is clipped"
    assert defect(response) == "channel b is clipped"
    notes = spectra_of_records([good, double, clipped, response]).notes
    assert [note.partition(" is")[0] for note in notes] == ["record 1", "record 2", "record 3"]
    with pytest.raises(UsageError, match="no impact is without a defect: record 2"):
        spectra_of_records([clipped])


def test_records_that_have_not_decayed_are_named():
    assert spectra_of_records([impact(1, noise=0.0)]).cut_off == ()
    short = impact(0, seconds=0.5, noise=0.0)
    assert spectra_of_records([short]).cut_off == ("record 0",)
    assert spectra_of_records([short], exponential=0.2).cut_off == ("record 0",)
    assert spectra_of_records([short], exponential=0.05).cut_off == ()


def test_a_single_impact_has_no_scatter():
    spectra = spectra_of_records([impact(0)])
    assert set(spectra.variance.values()) == {None}


def test_records_that_do_not_go_together_are_refused():
    assert is_impact(impact(0).force)
    noise = random_record(0, 8.0)
    assert not is_impact(noise.force)
    with pytest.raises(UsageError, match="record 0 is no impact, and others are"):
        spectra_of_records([impact(1), noise])
    with pytest.raises(UsageError, match="different steps or lengths"):
        spectra_of_records([impact(1), impact(2, seconds=4.0)])
    with pytest.raises(UsageError, match="an exponential window is for impacts"):
        spectra_of_records([noise], exponential=1.0)
    with pytest.raises(UsageError, match="fewer than two"):
        spectra_of_records([noise], segment=7.0)


def several(seed=0, seconds=100.0, mixed=0.0):
    """Return a record of two random forces at once, the second mixed with the first."""
    random = np.random.default_rng(seed)
    forces = random.standard_normal((round(seconds / STEP), 2))
    forces[:, 1] = mixed * forces[:, 0] + (1 - mixed) * forces[:, 1]
    values = sum(responses_to(force, k, 0.0, random) for k, force in enumerate(forces.T))
    values = values + 0.01 * values.std(axis=0) * random.standard_normal(values.shape)
    return TimeRecord(f"record {seed}", forces, values, ("a", "b", "c"), ["a", "b"], STEP)


@pytest.mark.thorough
def test_several_forces_at_once_are_separated():
    poles, _ = structure()
    analysis = analysed(spectra_of_records([several(0), several(1)], segment=12.5), ("a", "b"))
    reported = analysis.modes
    assert len(reported.omega) == len(poles)
    assert np.all(np.abs(reported.omega - np.abs(poles)) < 4.5 * reported.standard_errors[0])
    assert analysis.reciprocity > 1e-3


def test_forces_that_are_nearly_one_are_named_or_refused():
    (note,) = spectra_of_records([several(mixed=0.6)], segment=10.0).notes
    assert note.startswith("forces a, b have a coherence of 0.7")
    with pytest.raises(UsageError, match="the 2 forces cannot be separated by 19 segments"):
        spectra_of_records([several(mixed=1.0)], segment=10.0)
    alone = several(1)._replace(references=["a"], forces=several(1).forces[:, :1])
    with pytest.raises(UsageError, match="channel a is recorded with a force alone and with others at once"):
        spectra_of_records([several(), alone], segment=10.0)
    hits = np.hstack([impact(0).forces, impact(1).forces])
    with pytest.raises(UsageError, match="record 0 has impacts at 2 DOFs at once"):
        spectra_of_records([impact(0)._replace(forces=hits, references=["a", "b"])])


def test_the_scale_counts_what_a_short_record_cuts_off():
    poles, shapes = structure()
    spectra = spectra_of_records([impact(seed, seconds=3.0, noise=1e-3) for seed in range(3)])
    duration = 2 * np.pi / (spectra.omega[1] - spectra.omega[0])
    exact = (shapes / np.sqrt(2j * poles.imag)).T[0, 0] ** 2
    errors = [
        abs(analysed(spectra, duration=d).modes.shape[0, 0] ** 2 / exact - 1) for d in (duration, np.inf)
    ]
    assert errors[0] < 5e-4
    assert errors[1] > 5e-3
