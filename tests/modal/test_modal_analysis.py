"""Modes from frequency responses: none missed, none spurious, and standard errors that cover the truth."""

import re

import numpy as np
import pytest

from dynid.errors import NumericalError, UsageError
from dynid.modal.frf_matrix import FrfMatrix
from dynid.modal.modal_analysis import analyse
from dynid.modal.modal_model import ModalModel
from tests.modal import monte_carlo
from tests.modal.structures import OMEGA, measured, modes, receptances, standardised

pytestmark = pytest.mark.thorough


def driving(references):
    return [(response, column) for column, response in enumerate(references)]


CASES = {
    "two references": ({}, (0, 5), 0.02, {}),
    "one reference": ({}, (6,), 0.02, {}),
    "a pair 0.1 % apart, 5 % noise": ({"close": (3,)}, (0, 5), 0.05, {}),
    "light": ({"damping": (0.001, 0.001)}, (0, 5), 0.02, {}),
    "heavy": ({"damping": (0.05, 0.05)}, (0, 5), 0.02, {}),
    "complex shapes": ({"phase": 0.3}, (0, 5), 0.02, {}),
    "not reciprocal": ({}, (0, 5), 0.02, {"reciprocal": False}),
    "real shapes": ({}, (0, 5), 0.02, {"real": True}),
    "three modes": ({"count": 3, "responses": 10}, (0, 5), 0.02, {}),
}


def coverage(case, seeds):
    """Return the coverage of 95 % intervals of frequencies, damping and shapes, and chi-squared."""
    options, references, noise, choices = CASES[case]
    poles, shapes = modes(**options)
    standard, ratios = [], []
    for seed in seeds:
        analysis = analyse(measured(poles, shapes, references, noise, seed), driving(references), **choices)
        assert len(analysis.modes.omega) == len(poles), f"seed {seed}"
        ratios.append(analysis.reduced_chi2)
        # The scale of a mode that the reference hardly moves is not Gaussian.
        moved = np.max(np.abs(shapes[list(references)]), axis=0) > 0.03
        by_omega, by_damping, by_shape = standardised(analysis, poles, shapes)
        standard.append((by_omega, by_damping, by_shape[:, moved]))
    errors = [np.concatenate([np.ravel(entry[k]) for entry in standard]) for k in range(3)]
    return [np.mean(np.abs(error) < 1.96) for error in errors], np.median(ratios)


@pytest.mark.parametrize("case", CASES)
def test_standard_errors_cover_the_truth(case):
    (by_omega, by_damping, by_shape), ratio = coverage(case, range(2))
    assert by_omega > 0.75
    assert by_damping > 0.75
    assert by_shape > 0.88
    assert abs(ratio - 1) < 0.04


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_standard_errors_cover_95_percent(case):
    covers, ratio = coverage(case, range(60))
    assert all(0.92 <= cover <= 0.98 for cover in covers), covers
    assert abs(ratio - 1) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_pole_that_wanders_at_an_edge_is_left_out_after_a_few_steps(seed, monkeypatch):
    case, evaluations, evaluate = monte_carlo.CASES["thirty-modes"], [], ModalModel.evaluate

    def counted(*arguments):
        evaluations.append(1)
        return evaluate(*arguments)

    monkeypatch.setattr(ModalModel, "evaluate", counted)
    poles, shapes = modes(**case.structure)
    omega = np.linspace(OMEGA[0], OMEGA[-1], case.lines)
    frf = measured(poles, shapes, case.references, case.noise, seed, omega)
    assert len(analyse(frf, driving(case.references)).modes.omega) == len(poles)
    assert len(evaluations) < 25  # 60 to 100 of a pole that wanders to the end


def test_exact_responses_give_the_modes_to_round_off():
    poles, shapes = modes(5, 6)
    exact = receptances(poles, shapes, (0, 2), OMEGA)
    frf = FrfMatrix(OMEGA, exact, 1e-9 * np.abs(exact), np.ones((6, 2)))
    reported = analyse(frf, driving((0, 2))).modes
    assert np.allclose(reported.omega, np.abs(poles), rtol=1e-9)
    assert np.allclose(reported.damping, -poles.real / np.abs(poles), rtol=1e-7)
    exact_shapes = (shapes / np.sqrt(2j * poles.imag)).T
    assert np.allclose(
        reported.shape**2, exact_shapes**2, rtol=1e-6, atol=1e-9 * np.abs(exact_shapes).max() ** 2
    )
    assert reported.normalisation == "modal a of 1"


def test_real_shapes_have_unit_modal_mass():
    poles, shapes = modes(4, 5)
    exact = receptances(poles, shapes, (1,), OMEGA)
    reported = analyse(
        FrfMatrix(OMEGA, exact, 1e-9 * np.abs(exact), np.ones((5, 1))), [(1, 0)], real=True
    ).modes
    assert reported.normalisation == "unit modal mass"
    assert np.allclose(np.abs(reported.shape), np.abs(shapes.T), rtol=1e-6)
    assert not reported.shape.imag.any()


@pytest.mark.parametrize("options", [{}, {"real": True}, {"reciprocal": [(0, 0), (2, 1)]}], ids=str)
def test_gradient_and_information_are_those_of_differences(options):
    poles, shapes = modes(3, 4, phase=0.0 if "real" in options else 0.2)
    frf = measured(poles, shapes, (0, 2))
    model, start = ModalModel(frf, **options), poles * (1 + 1e-4j)
    L, free = model._gauge(ModalModel(frf, real="real" in options).start(start))
    fit = model.evaluate(start, L, free)
    step = 1e-6 * np.abs(start[0])
    for index, change in ((0, step), (3, 1j * step)):  # parts of the first pole
        moved = [model.evaluate(start + sign * change * np.eye(3)[0], L, free).chi2 for sign in (1, -1)]
        slope = (moved[0] - moved[1]) / (2 * step)
        assert np.isclose(
            -2 * fit.gradient[index], slope, rtol=1e-5, atol=1e-3 * np.sqrt(fit.information[index, index])
        )


def test_a_wrong_gain_of_a_reference_is_found_not_reciprocal():
    poles, shapes = modes()
    frf = measured(poles, shapes)
    spoiled = FrfMatrix(frf.omega, frf.values * [1, 1.1], frf.deviation * [1, 1.1], frf.scale)
    assert analyse(frf, driving((0, 5))).reciprocity > 1e-3
    analysis = analyse(spoiled, driving((0, 5)))
    assert analysis.reciprocity < 1e-6
    assert not analysis.model.own
    assert len(analysis.modes.omega) == len(poles)


@pytest.mark.parametrize("proportional", [False, True])
def test_unknown_noise_is_estimated(proportional):
    poles, shapes = modes(5, 4)
    frf = measured(poles, shapes, (0, 2), noise=0.02)
    unknown = FrfMatrix(
        frf.omega, frf.values, np.abs(frf.values) if proportional else np.ones(frf.values.shape),
        np.ones((4, 2)), estimated=True, shaped=proportional,
    )  # fmt: skip
    analysis = analyse(unknown, driving((0, 2)), proportional=proportional)
    assert len(analysis.modes.omega) == 5
    deviation = analysis.model.frf.deviation * analysis.model.frf.scale
    assert np.median(deviation / frf.deviation) == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("phase", [0.0, 0.3])
def test_real_shapes_are_tested(phase):
    poles, shapes = modes(5, 4, phase=phase)
    omega = np.linspace(OMEGA[0], OMEGA[-1], 300)
    analysis = analyse(measured(poles, shapes, (0, 2), omega=omega), driving((0, 2)))
    assert (analysis.real_shapes > 1e-3) == (phase == 0)


def test_a_lack_of_fit_shows_where_the_noise_is_estimated():
    poles, shapes = modes(3, 4)
    ripple = 1 + 0.1 * np.sin(2 * np.pi * np.arange(len(OMEGA)) / 20)[:, None, None]  # of a second hit
    values = ripple * measured(poles, shapes, (0,)).values
    unknown = FrfMatrix(OMEGA, values, np.abs(values), np.ones((4, 1)), estimated=True)
    analysis = analyse(unknown, driving((0,)))
    assert analysis.bar_scale > 1
    assert analysis.reduced_chi2 == pytest.approx(1, abs=0.02)


@pytest.mark.thorough
def test_a_mode_that_one_reference_cannot_separate_is_added_or_said():
    poles, shapes = modes(close=(3,))
    analysis = analyse(measured(poles, shapes, (0,)), [(0, 0)])
    assert len(analysis.modes.omega) == len(poles) or analysis.bar_scale > 1


def test_a_mode_just_beyond_the_band_leaves_no_lack_of_fit():
    poles, shapes = modes(5, 6)
    omega = np.linspace(OMEGA[0], 0.98 * poles[-1].imag, 400)
    analysis = analyse(measured(poles, shapes, (0, 2), omega=omega), driving((0, 2)))
    assert len(analysis.modes.omega) == 4
    assert analysis.bar_scale == 1


def test_missing_lines_of_a_pair_are_left_out():
    poles, shapes = modes(4, 5)
    frf = measured(poles, shapes, (0, 2))
    frf.values[100:130, 1, 0] = np.nan
    analysis = analyse(frf, driving((0, 2)))
    assert len(analysis.modes.omega) == 4
    assert analysis.model.frf.count == 2 * frf.values.size - 60


def test_noise_alone_has_no_mode_to_report():
    random = np.random.default_rng(0)
    noise = random.standard_normal((200, 3, 1)) + 1j * random.standard_normal((200, 3, 1))
    with pytest.raises(NumericalError, match=r"no (mode|pole)"):
        analyse(FrfMatrix(OMEGA[:200], noise, np.full(noise.shape, np.sqrt(2)), np.ones((3, 1))), [])


def test_a_band_of_few_lines_is_refused():
    poles, shapes = modes(3, 4)
    with pytest.raises(UsageError, match="12 lines"):
        measured(poles, shapes, (0,), omega=OMEGA[:12])


@pytest.mark.thorough
def test_doubts_are_said():
    from dynid.modal.write_result import add_analysis
    from dynid.result import Result

    poles, shapes = modes(5, 6)
    frf = measured(poles, shapes, (0, 2))
    spoiled = FrfMatrix(frf.omega, frf.values * [1, 1.1], 0.5 * frf.deviation * [1, 1.1], frf.scale)
    result = Result("modal-analysis")
    analysis = analyse(spoiled, driving((0, 2)))
    add_analysis(result, analysis, "abcdef", "ac", np.ones((600, 6)), ["a note"])
    note, lack, reciprocity = result["modal/warnings"].data[:3]
    assert note == "a note"
    ratio, factor = map(float, re.findall(r"(?:is|are) ([\d.]+)", lack))
    assert ratio == pytest.approx(4, rel=0.05)
    assert factor == pytest.approx(2, rel=0.03)
    assert reciprocity.startswith("the responses are not reciprocal")
    assert result.value("modal/fit/lacks_fit")


def test_a_negative_modal_mass_is_refused():
    poles, shapes = modes(3, 4)
    exact = -receptances(poles, shapes, (0,), OMEGA)
    frf = FrfMatrix(OMEGA, exact, 1e-3 * np.abs(exact), np.ones((4, 1)))
    with pytest.raises(NumericalError, match="negative modal mass"):
        analyse(frf, [(0, 0)], real=True)
