"""Every default choice names a benchmark that there is, and code takes its thresholds from there."""

import ast
import re
from pathlib import Path

import pytest

import dynid
from dynid import defaults
from dynid.bench import BENCHMARKS, benchmark
from dynid.defaults import CHOICES, LIMITS, of_benchmark
from dynid.identification.estimators.filter_passes import Filter
from dynid.lti.noise import Sampled
from dynid.structure.modes import solver_for
from dynid.structure.reduction.masters import Masters


@pytest.mark.parametrize("name", CHOICES)
def test_a_choice_names_its_table(name):
    choice = CHOICES[name]
    assert choice.benchmark in BENCHMARKS
    assert benchmark(choice.benchmark).alternatives
    assert (
        str(choice) == f"{choice.sentence.format(value=choice.value)} (see `dynid bench {choice.benchmark}`)"
    )
    assert choice.sentence.format(value=choice.value) in of_benchmark(choice.benchmark)
    assert str(choice.value).rstrip("0").rstrip(".") in str(choice).replace(",", "")


def test_what_is_chosen_is_what_is_said():
    assert Sampled([0.0, 1.0], 1.0).hold == defaults.HOLD.value
    assert Filter().passes == defaults.FILTER_PASSES.value
    assert Masters().choose == defaults.MASTERS.value
    dense, few = defaults.DENSE_MODES.value, defaults.FEW_MODES.value
    assert solver_for(dense, 1, None) == "dense"
    assert solver_for(dense + few, (dense + few) // few, None) == defaults.BACKEND.value
    assert solver_for(dense + few, dense, None) == "dense"


def test_what_is_chosen_is_among_the_alternatives_of_its_table():
    names = {name: [each.name for each in benchmark(name).alternatives] for name in BENCHMARKS}
    assert f"exponential-{defaults.HOLD.value}" in names["propagation"]
    assert defaults.BACKEND.value in names["modes"]
    assert defaults.ESTIMATOR.value in names["estimators"]
    assert f"filter-{defaults.FILTER_PASSES.value}" in names["estimators"]
    assert f"below-{defaults.BASIS_BAND.value:g}-bands" in names["basis"]
    for name in ("zeros-poles", "loops"):
        assert {"exact", "float"} <= set(names[name])
    assert {"dense", "sparse"} <= set(names["pencils"])
    assert benchmark("pencils").default(defaults.SPARSE_REFINEMENT.value - 1) == "dense"
    assert benchmark("pencils").default(defaults.SPARSE_REFINEMENT.value) == "sparse"


@pytest.mark.parametrize("name", LIMITS)
def test_a_limit_says_what_it_is(name):
    assert f"{LIMITS[name].value:,}" in str(LIMITS[name])
    assert name not in CHOICES


#: What constants are called that choose a way by a size.
CHOOSING = re.compile(r"_?(DENSE|SPARSE|LARGE|SMALL|FEW|MANY|SHORT|LONG|BIG)")
#: Those that choose none, or hardly one.
OTHERS = {
    "structure.modes.sparse": "beyond it an answer is refused",
}


def choosing(path):
    """Yield the constants of a module that are called as if they chose a way, and are written there."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if not isinstance(node, ast.Assign):
            continue
        names = [name for target in node.targets for name in ast.walk(target) if isinstance(name, ast.Name)]
        values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
        for name, value in zip(names, values, strict=False):
            if CHOOSING.fullmatch(name.id) and not isinstance(value, ast.Attribute):
                yield name.id


@pytest.mark.thorough
def test_what_chooses_a_way_stands_in_the_registry():
    root = Path(dynid.__file__).parent
    found = {
        ".".join(path.relative_to(root).with_suffix("").parts)
        for floor in ("bondgraph", "structure", "identification", "lti")
        for path in (root / floor).rglob("*.py")
        if any(choosing(path))
    }
    assert found == set(OTHERS)
