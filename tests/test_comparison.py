"""What the comparison and the limits say in numbers is what was measured, or what the code has."""

import re
from pathlib import Path

import pytest

from dynid import defaults
from dynid.bondgraph.floating import spectrum
from dynid.bondgraph.results import prototype_results, sensitivities
from dynid.scene.schema.study import MAX_SAMPLES
from dynid.structure import damping, frf, model

DOCS = Path(__file__).parents[1] / "docs"
COMPARISON, LIMITS, ACCURACY = (
    (DOCS / f"{page}.md").read_text() for page in ("comparison", "limits", "accuracy")
)
_ROW = re.compile(r"^\| ([\d,]*) \| ([\w-]+) \| .*? \| .*? \| (\S+) \|", re.MULTILINE)


def measured(benchmark, size, name):
    """Return the error of an alternative at a size, from the tables of speed against error."""
    _, _, section = ACCURACY.partition(f"\n## {benchmark}\n")
    at = ""
    for row in _ROW.findall(section.partition("\n## ")[0]):
        at = row[0] or at
        if (at, row[1]) == (size, name):
            return float(row[2])
    raise LookupError(f"{benchmark} at {size}: {name}")


@pytest.mark.parametrize(
    ("text", "benchmark", "size", "name", "error"),
    [
        ("| dynid, exact | no error |", "zeros-poles", "100", "exact", 0),
        ("| control | 1.7e-14 |", "zeros-poles", "20", "control", 1.7e-14),
        ("| 1.7e-14 | A |", "zeros-poles", "100", "control", 1.7e-14),
        ("| 1.1 | 1.2 |", "estimators", "800", "filterpy", 1.2),
        ("(P) | 1.2 |", "estimators", "800", "dynamax", 1.2),
        ("| 1 | 0.98 |", "estimators", "800", "least-squares", 0.98),
        ("C library | 0.97 |", "estimators", "800", "auto", 0.97),
        ("| 0.02 | 1.2 |", "estimators", "800", "filter-1", 1.2),
    ],
)
def test_errors_beside_other_tools_are_those_of_the_tables(text, benchmark, size, name, error):
    assert text in COMPARISON
    assert measured(benchmark, size, name) == pytest.approx(error, rel=0.25)


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("{} storage elements; 80 on more", defaults.EXACT_ROOTS.value),
        ("storage elements; {} on more than 4 loops", defaults.EXACT_ROOTS_ON_LOOPS.value),
        ("on more than {} loops", defaults.MANY_LOOPS.value),
        ("{}; 150 on more", defaults.EXACT_POLYNOMIALS.value),
        ("; {} on more than 4 loops | float", defaults.EXACT_POLYNOMIALS_ON_LOOPS.value),
        ("{} storage elements | refused; frequency", spectrum._MAX_DENSE_STORAGES),
        ("| sensitivities | {} storage elements", sensitivities._MAX_SENSITIVITY_STORAGES),
        ("prototypes | {} storage elements", prototype_results._MAX_PROTOTYPE_SIZE),
        ("| dense modes | {} DOFs", defaults.DENSE_MODES.value),
        ("{} DOFs | ask for a number", defaults.ALL_MODES.value),
        ("ratios of all modes | {} DOFs", damping._MOST_MODAL),
        ("dense matrices | {} DOFs", model._MOST_DENSE),
        ("undamped pole | {} DOFs", frf._MOST_AT_A_POLE),
    ],
)
def test_sizes_are_those_of_the_code(text, number):
    assert text.format(f"{number:,}") in LIMITS


def test_the_largest_study():
    assert f"at most {MAX_SAMPLES:.0e} samples".replace("+0", "") in LIMITS
