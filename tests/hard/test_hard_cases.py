"""Every hard case meets its bound, or is refused in words that help."""

import numpy as np
import pytest

from tests.hard.case import Refusal, distance
from tests.hard.catalogue import HALVES, cases

CASES = cases()
FEWEST = 120  # without those whose data are missing


def _marked(case):
    missing = case.needs is not None and not case.needs.exists()
    marks = [pytest.mark.slow] * case.slow + [pytest.mark.skipif(missing, reason=f"no data at {case.needs}")]
    return pytest.param(case, id=case.name.replace(" ", "_"), marks=marks)


@pytest.mark.thorough
@pytest.mark.parametrize("case", [_marked(case) for case in CASES])
def test_it_meets_its_bound_or_is_refused_with_a_remedy(case):
    if case.refused:
        error = case.refusal()
        assert error.remedy
        assert "\n" not in str(error)
    else:
        assert case.error() <= case.bound


def test_the_suite_is_whole():
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)
    assert len(names) >= FEWEST
    assert {case.half for case in CASES} == set(HALVES)
    assert all(case.source for case in CASES)
    assert all(case.bound == 0 for case in CASES if case.refused)


@pytest.mark.parametrize(
    ("found", "known", "apart"),
    [
        (1.0, 1.0, 0.0),
        (1.5, 1.0, 0.5),
        (np.inf, np.inf, 0.0),
        (-np.inf, np.inf, np.inf),
        (np.nan, 1.0, np.inf),
        (np.inf, 1.0, np.inf),
        (0.1, 0.0, np.inf),
        ([0.1, 2.0], [0.0, 2.0], 0.05),
        ([1.0], [1.0, 1.0], np.inf),
        (True, False, np.inf),
        (3, 4, np.inf),
        ("stable", "stable", 0.0),
        ("unstable", "^stable", np.inf),
    ],
)
def test_distances(found, known, apart):
    assert distance(found, known) == pytest.approx(apart)


def test_roots_are_compared_one_to_one():
    known = {"poles": np.array([1j, -1j, -1.0, -1.0])}
    assert distance({"poles": np.array([-1.0, -1j, -1.0, 1j])}, known) == 0.0
    assert distance({"poles": np.array([-1.0, -1j, 1j, 1j])}, known) > 1


def test_a_refusal_must_say_what_it_should():
    case = next(case for case in CASES if case.refused)
    with pytest.raises(AssertionError, match="other words"):
        type(case)(**{**vars(case), "answer": Refusal("nobody says this")}).refusal()
