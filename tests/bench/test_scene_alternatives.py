"""Alternatives to the choices of a scene: each is measured or named, and its error is correct."""

import json

import numpy as np
import pytest

import dynid
from dynid.bench.scenes.measure import add_accuracy, aspect_of
from dynid.checks import compare
from dynid.cli.screen import section_lines
from dynid.errors import SceneError
from dynid.report.content import content
from dynid.report.content.bench import alternative_sections
from dynid.report.content.blocks import TextTable
from dynid.result import Result
from dynid.scene.kinds.reduction import read_reduction
from dynid.scene.load import check_source
from dynid.scene.run import run_scene
from dynid.scene.schema.base import ASPECTS, AccuracyModel, aspects_of
from dynid.scene.yaml.source import parse_source
from dynid.store import read_result, write_result

pytestmark = pytest.mark.thorough

MASS = {
    "dynid": 1,
    "kind": "bond-graph",
    "graph": {
        "nodes": {"F": "Se", "v": 1, "m": {"type": "I", "value": 2}, "b": {"type": "R", "value": 3}},
        "bonds": ["F -> v -> m", "v -> b"],
    },
    "analysis": {
        "outputs": ["m.f"],
        "time": {"stop": 4, "step": 0.05, "input": {"kind": "sine", "frequency": 7}},
    },
}
CHAIN = {
    "lumped": {
        "masses": [2, 2, 1.5, 1],
        "links": [{"dofs": [1], "k": 2e4, "c": 20}, {"dofs": [1, 2], "k": 3e4, "c": 30},
                  {"dofs": [3, 4], "k": 2e4, "c": 20}],
    }
}  # fmt: skip
RECORD = {
    "dynid": 1,
    "kind": "identification",
    "structure": CHAIN,
    "joints": {"j": {"dofs": [2, 3], "k": {"start": 1e4, "true": 2e4}, "c": {"start": 10, "true": 20}}},
    "excitation": [{"dof": 4, "kind": "random", "amplitude": 100, "seed": 3}],
    "measurement": {
        "step": 0.004,
        "samples": 150,
        "channels": [{"dof": 2, "quantity": "velocity"}, {"dof": 3, "quantity": "velocity"}],
        "simulate": {"noise_ratio": 0.02, "seed": 1},
    },
    "analysis": {"modes": {"count": 3}, "time": {"stop": 0.2, "step": 0.004, "input":
                 {"dof": 4, "kind": "sine", "frequency": 70}}},
}  # fmt: skip
BASES = {
    "dynid": 1,
    "kind": "reduction",
    "structure": CHAIN,
    "joints": {"j": {"dofs": [2, 3], "k": 2e4}},
    "reduction": [{"method": "guyan", "masters": [2, 4]}, {"method": "serep", "modes": {"count": 2}}],
}


def scene(data, **changes):
    return check_source(parse_source(json.dumps({**data, **changes}), "scene.yaml"))


def tried(data, **options):
    loaded = scene(data)
    result = Result(loaded.kind)
    add_accuracy(result, loaded, AccuracyModel(**{"repeats": 1, "budget": 120, **options}))
    return result


@pytest.mark.parametrize("data", [MASS, RECORD, BASES], ids=["graph", "identification", "reduction"])
def test_a_scene_offers_the_alternatives_that_the_schema_knows(data):
    loaded = scene(data)
    assert aspects_of(loaded.model) == list(ASPECTS[data["kind"]])  # these scenes have all of them
    for name, known in ASPECTS[data["kind"]].items():
        aspect = aspect_of(loaded, name)
        assert {each.name for each, _ in aspect.points} == set(known)
        assert aspect.chosen <= {(each.name, size) for each, size in aspect.points}
        assert aspect.chosen


def test_a_basis_in_plain_words_is_that_of_a_scene():
    for part, plain in zip(scene(BASES).model.reduction, BASES["reduction"], strict=True):
        assert read_reduction(plain) == part


@pytest.fixture(scope="module")
def mass():
    return dynid.run(scene(MASS, accuracy={"repeats": 2, "budget": 120}))


def test_figures_stand_as_those_of_a_benchmark(mass, tmp_path):
    for group, size in (
        ("engine/exact", 1),
        ("engine/float", 1),
        ("propagation/exact", 1),
        ("propagation/spline", 3),
    ):
        for column, units in (("time", "s"), ("memory", "B"), ("error", "")):
            variable = mass[f"accuracy/{group}/{column}"]
            assert (variable.dims, variable.units, variable.data.shape) == (("size",), units, (size,))
            assert np.all(np.isfinite(variable.data) & (variable.data >= 0))
    assert mass["accuracy/engine/exact/chosen"].data.tolist() == [True]
    assert mass["accuracy/engine/float/chosen"].data.tolist() == [False]
    assert "accuracy/engine/symbolic/error" not in mass  # formulas have no numbers
    assert mass["accuracy/engine/status"].data.tolist() == ["done"] * 3
    assert "chosen by default: exact" in mass.group_attrs["accuracy/engine"]["because"]
    write_result(mass, tmp_path / "a.h5")
    assert read_result(tmp_path / "a.h5").equals(mass)


def test_the_errors_of_holds_fall_as_their_orders_say(mass):
    """Halving the step takes a spline's error down by 2^4, a line's by 2^2, a constant's by 2."""
    for hold, order in (("spline", 4), ("linear", 2), ("zero", 1)):
        error = mass[f"accuracy/propagation/{hold}/error"].data
        found = np.log2(error[:-1] / error[1:])
        assert found == pytest.approx(order, abs=0.25), hold  # leading terms: steps are not yet small
    assert mass.value("accuracy/propagation/exact/error").tolist() == [0.0]


def test_only_what_a_run_gives_again_is_compared(mass):
    again = tried(MASS)
    alone = Result("bond-graph")
    for path, variable in mass.items():
        if path.startswith("accuracy/"):
            alone.add(path, variable.data, variable.dims, variable.units)
    said = [str(each) for each in compare(again, alone, atol=1e-14)]
    assert [each for each in said if each.startswith("accuracy/engine/float/") or "/time" in each] == []
    assert compare(again, mass) != []


def test_screen_and_page_name_every_alternative_and_the_choice(mass):
    titles = [part.title for part in content(mass).sections]
    assert [title for title in titles if title.startswith("Alternatives")] == [
        "Alternatives: engine",
        "Alternatives: propagation",
    ]
    rows = {row[0] for part in content(mass).sections for block in part.blocks if isinstance(block, TextTable)
            for row in block.rows}  # fmt: skip
    known = {name for names in ASPECTS["bond-graph"].values() for name in names}
    assert known <= rows
    said = section_lines(alternative_sections(mass))
    chosen = [line.split()[0] for line in said if "→ chosen" in line]
    assert chosen == ["exact", "exact"]  # the engine, and the way a motion is propagated
    assert all(any(line.startswith(f"    {name} ") for line in said) for name in known)
    assert list(alternative_sections(Result("bond-graph"))) == []


def test_what_the_budget_does_not_hold_is_named():
    result = tried(MASS, budget=1e-3)
    every = [text for name in ("engine", "propagation") for text in result[f"accuracy/{name}/status"].data]
    assert len(every) == 7
    assert all("budget of 0.001 s" in text for text in every)
    assert not [path for path in result if path.endswith("/time")]


def test_what_cannot_be_chosen_says_why():
    analysis = {**MASS["analysis"], "results": ["poles"]}
    result = tried({**MASS, "analysis": analysis})
    status = dict(zip(*(result[f"accuracy/engine/{c}"].data for c in ("alternative", "status")), strict=True))
    assert status == {"exact": "done", "float": "done",
                      "symbolic": "formulas alone: zeros, poles and properties need numbers"}  # fmt: skip
    assert "accuracy/propagation/status" not in result


def test_only_what_is_asked_for_is_tried_beside_the_choice():
    result = tried(MASS, alternatives={"engine": ["float"]})
    assert result["accuracy/engine/alternative"].data.tolist() == ["exact", "float"]
    assert not [path for path in result if path.startswith("accuracy/propagation")]


def test_estimators_are_measured_by_truth_and_bound():
    result = tried(RECORD, alternatives={"estimator": ["filter", "output-error"], "hold": ["linear"]})
    own = run_scene(scene(RECORD))
    get = {name: own[f"identification/parameters/{name}"].data for name in ("estimate", "true", "cramer_rao")}
    error = np.sqrt(np.mean((get["estimate"] / get["true"] - 1) ** 2))
    bound = np.sqrt(np.mean((get["cramer_rao"] / get["true"]) ** 2))
    group = "accuracy/estimator"
    assert result[f"{group}/auto/error"].data == pytest.approx([error])
    assert result[f"{group}/auto/bound"].data == pytest.approx([bound])
    assert result[f"{group}/output-error/error"].data == pytest.approx([error], rel=0.05)  # one optimum
    assert result[f"{group}/filter/size"].data.tolist() == [1, 2, 3, 4]
    assert result["accuracy/hold/as-written/chosen"].data.tolist() == [True]
    assert result["accuracy/hold/linear/error"].data[0] != result["accuracy/hold/as-written/error"].data[0]


def test_bases_and_solvers_are_measured_by_the_full_structure():
    result, own = tried(BASES), run_scene(scene(BASES))
    for method in ("guyan", "serep"):
        found = result[f"accuracy/basis/{method}/error"].data
        chosen = result[f"accuracy/basis/{method}/chosen"].data
        least = min(own[f"reduction/{name}/frequencies"].data.size for name in ("guyan", "serep"))
        error = np.abs(own[f"reduction/{method}/frequency_error"].data[:least]).max()
        assert found[chosen] == pytest.approx([error])
    assert result["accuracy/modes/dense/chosen"].data.tolist() == [True]
    assert result["accuracy/modes/splu/error"].data == pytest.approx([0], abs=1e-10)  # another algorithm


@pytest.mark.parametrize(
    ("block", "fault"),
    [
        (
            "{alternatives: {engin: all}}",
            "15:27: 'engin' is no choice of a run; a scene of kind bond-graph chooses engine, propagation"
            "; did you mean 'engine'?",
        ),
        (
            "{alternatives: {engine: [exat]}}",
            "15:36: there is no alternative 'exat'; it is one of exact, float, symbolic; "
            "did you mean 'exact'?",
        ),
        ("{alternatives: {propagation: all}}", "15:27: nothing in this scene is propagated"),
        ("{alternatives: {engine: some}}", "15:35: "),
        ("{budget: 0}", "15:20: "),
        ("{repeats: 1.5}", "15:21: "),
        ("{repeat: 2}", "15:12: 'repeat' is not a key of accuracy; did you mean 'repeats'?"),
    ],
)
def test_a_block_that_makes_no_sense_is_refused_at_its_place(block, fault):
    text = """\
dynid: 1
kind: bond-graph
graph:
  nodes:
    F: Se
    v: 1
    m: {type: I, value: 2}
    b: {type: R, value: 3}
  bonds:
    - F -> v -> m
    - v -> b
analysis:
  outputs:
    - m.f
"""
    with pytest.raises(SceneError) as caught:
        check_source(parse_source(f"{text}accuracy: {block}\n", "scene.yaml"))
    (found,) = (str(each) for each in caught.value.faults)
    assert found.startswith(f"scene.yaml:{fault}")
