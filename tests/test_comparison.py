"""What the comparison and the limits say in numbers is what was measured, or what the code has."""

import re
from pathlib import Path

import pytest

from dynid import defaults
from dynid.bondgraph.floating import spectrum
from dynid.bondgraph.results import prototype, sensitivities
from dynid.scene.schema.study import MAX_SAMPLES
from dynid.structure import damping, frf, model

DOCS = Path(__file__).parents[1] / "docs"
COMPARISON, LIMITS, ACCURACY = (
    (DOCS / f"{page}.md").read_text() for page in ("comparison", "limits", "accuracy")
)
_ROW = re.compile(r"^\| ([\d,]*) \| ([\w-]+) \| ([\d.]+) (\S+) \| .*? \| (\S+) \|", re.MULTILINE)
UNITS = {"µs": 1e-6, "ms": 1e-3, "s": 1.0}


def measured(benchmark, size, name):
    """Return seconds and error of an alternative at a size, from the tables of speed against error."""
    _, _, section = ACCURACY.partition(f"\n## {benchmark}\n")
    rows, at = section.partition("\n## ")[0], ""
    for row in re.findall(
        r"^\| ([\d,]*) \| ([\w-]+) \| ([\d.]+) (\S+) \| .*? \| (\S+) \|", rows, re.MULTILINE
    ):
        at = row[0] or at
        if (at, row[1]) == (size, name):
            return float(row[2]) * UNITS[row[3]], float(row[4])
    raise LookupError(f"{benchmark} at {size}: {name}")


@pytest.mark.parametrize(
    ("text", "benchmark", "size", "name", "seconds", "error"),
    [
        ("| dynid, exact | 15 ms", "zeros-poles", "20", "exact", 15e-3, 0),
        ("142 ms, no error", "zeros-poles", "100", "exact", 142e-3, 0),
        ("| control | 2.8 ms, 1.7e-14", "zeros-poles", "20", "control", 2.8e-3, 1.7e-14),
        ("35 ms, 1.7e-14", "zeros-poles", "100", "control", 35e-3, 1.7e-14),
        ("1.7 ms at 8", "symbolic", "8", "nested", 1.7e-3, 0),
        ("60 ms at 200", "symbolic", "200", "nested", 60e-3, 0),
        ("434 ms | 1.2", "estimators", "800", "filterpy", 434e-3, 1.2),
        ("41 ms, and", "estimators", "800", "dynamax", 41e-3, 1.2),
        ("384 ms | 0.98", "estimators", "800", "least-squares", 384e-3, 0.98),
        ("327 ms without", "estimators", "800", "auto-numpy", 327e-3, 0.97),
        ("26 ms compiled", "estimators", "800", "auto", 26e-3, 0.97),
        ("7 ms | 1.2", "estimators", "800", "filter-1", 7e-3, 1.2),
    ],
)
def test_figures_beside_other_tools_are_those_of_the_tables(text, benchmark, size, name, seconds, error):
    assert text in COMPARISON
    found, off = measured(benchmark, size, name)
    assert seconds / 3 < found < 3 * seconds  # a table made anew on another day
    assert off == pytest.approx(error, rel=0.25)


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("{} storage elements; 80 on more", defaults.EXACT_ROOTS.value),
        ("storage elements; {} on more than 4 loops", defaults.EXACT_ROOTS_ON_LOOPS.value),
        ("on more than {} loops", defaults.MANY_LOOPS.value),
        ("{}; 150 on more", defaults.EXACT_POLYNOMIALS.value),
        ("; {} on more than 4 loops | float", defaults.EXACT_POLYNOMIALS_ON_LOOPS.value),
        ("{} storage elements | refused; frequency", spectrum._LARGEST),
        ("| sensitivities | {} storage elements", sensitivities._STORAGES),
        ("prototypes | {} storage elements", prototype._STORAGES),
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
