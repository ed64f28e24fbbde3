"""Sentences on how a design was found."""

import numpy as np
import pytest

from dynid.report.content.design import DESIGN, statements
from dynid.result import Result


def designed(counts, ended, optimum=None, maxima=1, objectives=(), warnings=()):
    """Return a design from 8 starts, as far as its sentences read it."""
    result = Result("bond-graph")
    result.annotate(DESIGN, starts=8, ended=ended)
    result.add(f"{DESIGN}/optima/count", list(counts), ("optimum",))
    result.add(f"{DESIGN}/optima/objective", np.array(objectives, dtype=float), ("optimum",))
    if optimum is not None:
        result.add(f"{DESIGN}/optimum", optimum)
        result.add(f"{DESIGN}/active_maxima", maxima)
        result.add(f"{DESIGN}/stationarity", 3e-9)
    if warnings:
        result.add_axis(f"{DESIGN}/warnings", list(warnings))
    return result


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            {"counts": [8], "ended": 8},
            [("every target is met", "good"), ("8 of 8 starts ended in a solution, all in this one", "")],
        ),
        (
            {"counts": [1], "ended": 1},
            [("every target is met", "good"), ("1 of 8 starts ended in a solution", "")],
        ),
        (
            {"counts": [3], "ended": 5},
            [("every target is met", "good"), ("5 of 8 starts ended in a solution, 3 in this one", "")],
        ),
        (
            {"counts": [3, 2], "ended": 5, "objectives": [1, 2]},
            [
                ("every target is met", "good"),
                ("5 of 8 starts ended in a solution, 3 in this one; 1 other solution", ""),
            ],
        ),
        (
            {"counts": [3, 2, 1], "ended": 6, "objectives": [1, 2.5, np.inf], "optimum": True, "maxima": 2},
            [
                ("a minimum, 2 equal maxima: the first-order conditions hold to 3e-09", "good"),
                (
                    "6 of 8 starts ended in a solution, 3 in this one; 2 other local minima with 2.5, ∞",
                    "",
                ),
            ],
        ),
        (
            {"counts": [4], "ended": 4, "optimum": True},
            [
                ("a minimum: the first-order conditions hold to 3e-09", "good"),
                ("4 of 8 starts ended in a solution, all in this one", ""),
            ],
        ),
        (
            {"counts": [4], "ended": 4, "optimum": False, "warnings": ["no minimum", "at a limit"]},
            [
                ("warning: no minimum", "bad"),
                ("warning: at a limit", "bad"),
                ("4 of 8 starts ended in a solution, all in this one", ""),
            ],
        ),
    ],
)
def test_how_a_design_was_found(given, said):
    assert [(one.text, one.tone) for one in statements(designed(**given))] == said
