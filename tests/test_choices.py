"""Every default choice names a benchmark that there is, and code takes its thresholds from there."""

import pytest

from dynid import choices
from dynid.bench import BENCHMARKS, benchmark
from dynid.choices import CHOICES, of_benchmark
from dynid.identification.estimators.passes import Filter
from dynid.lti.sampled import Sampled
from dynid.structure.modes import solver_for
from dynid.structure.reduction.masters import Masters


@pytest.mark.parametrize("name", CHOICES)
def test_a_choice_names_its_table(name):
    choice = CHOICES[name]
    assert choice.benchmark in BENCHMARKS
    assert benchmark(choice.benchmark).alternatives
    assert str(choice) == f"{choice.sentence.format(value=choice.value)} (bench {choice.benchmark})"
    assert choice.sentence.format(value=choice.value) in of_benchmark(choice.benchmark)
    assert str(choice.value).rstrip("0").rstrip(".") in str(choice).replace(",", "")


def test_what_is_chosen_is_what_is_said():
    assert Sampled([0.0, 1.0], 1.0).hold == choices.HOLD.value
    assert Filter().passes == choices.FILTER_PASSES.value
    assert Masters().choose == choices.MASTERS.value
    dense, few = choices.DENSE_MODES.value, choices.FEW_MODES.value
    assert solver_for(dense, 1, None) == "dense"
    assert solver_for(dense + few, (dense + few) // few, None) == choices.BACKEND.value
    assert solver_for(dense + few, dense, None) == "dense"


def test_what_is_chosen_is_among_the_alternatives_of_its_table():
    names = {name: [each.name for each in benchmark(name).alternatives] for name in BENCHMARKS}
    assert f"exponential-{choices.HOLD.value}" in names["propagation"]
    assert choices.BACKEND.value in names["modes"]
    assert choices.ESTIMATOR.value in names["estimators"]
    assert f"filter-{choices.FILTER_PASSES.value}" in names["estimators"]
    assert f"below-{choices.BASIS_BAND.value:g}-bands" in names["basis"]
    for name in ("zeros-poles", "loops"):
        assert {"exact", "float"} <= set(names[name])
