"""The scene of the worst sample, run alone, gives the sample's numbers."""

from pathlib import Path

import numpy as np
import pytest

import dynid as package
from dynid.scene.yaml.source import parse_source
from dynid.store import read_result
from dynid.study.executors import SerialExecutor
from dynid.study.plan import make_plan
from dynid.study.run import run_study

pytestmark = pytest.mark.thorough

BASE = """\
# A mass on a damper, driven by a record.
dynid: 1
kind: bond-graph
title: A mass on a damper
parameters: {m: 2, c: 3}      # kg, N s/m
graph:
  nodes:
    F: Se
    m: {type: I, value: m}
    b: {type: R, value: c}    # a damper
    one: 1
  bonds: [F -> one -> m, one -> b]
analysis:
  inputs: [F]
  outputs: [m.f]
  time: {stop: 0.4, step: 0.1, input: {kind: file, path: force.csv}}
"""
STUDY = """\
dynid: 1
kind: study
title: Masses and dampers
scene: scenes/base.yaml
vary:
  parameters.m: {distribution: lognormal, mean: 2, std: 0.3}
  "parameters.c, graph.nodes.b.value": {values: [[3, c], [4.5, 2 * c], [1e-2, "7"]]}
  analysis.time.input: {values: [{kind: file, path: force.csv}, {kind: step}]}
derive: {ratio: c / m}
sampling: {method: random, samples: 12, seed: 5}
collect: [bond_graph/properties/m.f/F, bond_graph/transfer_function, bond_graph/time_response/response]
"""


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A folder with a study that has run."""
    folder = tmp_path_factory.mktemp("done")
    (folder / "scenes").mkdir()
    (folder / "out").mkdir()
    (folder / "scenes/base.yaml").write_text(BASE)
    (folder / "scenes/force.csv").write_text(
        "force\n" + "\n".join(map(str, [0.0, 1.5, -2.0, 3.0, 0.5])) + "\n"
    )
    (folder / "study.yaml").write_text(STUDY)
    run_study(make_plan(package.load_scene(folder / "study.yaml")), folder / "study.h5", SerialExecutor())
    return folder


@pytest.fixture
def study(done, monkeypatch):
    monkeypatch.chdir(done)
    return read_result("study.h5")


@pytest.mark.parametrize(
    ("path", "option", "pick"),
    [
        ("bond_graph/properties/m.f/F/dc_gain", "--max", np.nanargmax),
        ("bond_graph/properties/m.f/F/dc_gain", "--min", np.nanargmin),
        ("bond_graph/transfer_function/m.f/F/poles[1]", "--abs", np.nanargmax),
        ("bond_graph/time_response/response", "--abs", np.nanargmax),
    ],
)
def test_the_worst_sample_alone_gives_its_numbers(dynid, study, path, option, pick):
    code, out, err = dynid("study-worst", "study.h5", path, "-o", "out/worst.yaml", option)
    assert (code, err) == (0, "")
    values = np.abs(study[f"study/results/{path.partition('[')[0]}"].data).reshape(12, -1).max(axis=1)
    row = int(pick(values))
    assert out.startswith(f"Sample {row} of the study 'Masses and dampers'")
    alone = package.run("out/worst.yaml")
    for place in study:
        own = place.removeprefix("study/results/")
        if own == place or study[place].dims[:1] != ("sample",):
            continue
        found, expected = alone[own].data, study[place].data[row]
        if found.dtype.kind == "O":
            assert (found == expected).all()
        else:
            np.testing.assert_array_equal(found, expected)  # to the last bit


def test_the_text_of_the_scene_stays(dynid, study):
    dynid("study-worst", "study.h5", "bond_graph/properties/m.f/F/dc_gain", "-o", "out/worst.yaml")
    text = (package.load_scene("out/worst.yaml")).source.text
    assert "# A mass on a damper, driven by a record.\n" in text
    assert "# Written by: dynid study-worst study.h5 bond_graph/properties/m.f/F/dc_gain\n" in text
    assert "    # a damper  # set by the study; was c\n" in text
    data = parse_source(text).data
    row = int(np.nanargmax(study["study/results/bond_graph/properties/m.f/F/dc_gain"].data))
    assert data["parameters"]["m"] == study["study/samples/parameters.m"].data[row]
    assert data["parameters"]["c"] == study["study/samples/parameters.c"].data[row]
    assert isinstance(data["graph"]["nodes"]["b"]["value"], str)
    assert data["analysis"]["time"]["input"].get("path") in (None, "../scenes/force.csv")
    assert "ratio" not in data["parameters"]


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["bond_graph/properties/m.f/F/dc_gian", "-o", "w.yaml"], "did you mean"),
        (["dc_gain", "-o", "w.yaml"], "did you mean 'bond_graph/properties/m.f/F/dc_gain'?"),
        (["bond_graph/properties/m.f/F/dc_gain"], "Missing option '-o'"),
        (["bond_graph/properties/m.f/F/dc_gain", "-o", "study.h5"], "would overwrite the study"),
    ],
)
@pytest.mark.usefixtures("study")
def test_a_wrong_call_is_said(dynid, args, message):
    code, _, err = dynid("study-worst", "study.h5", *args)
    assert code == 2
    assert message in err


@pytest.mark.usefixtures("study")
def test_of_shards_and_after_the_scene_has_changed(dynid):
    for part in (1, 2):
        dynid("study", "study.yaml", "--executor", "serial", "-q", "--shard", f"{part}/2")
    dynid("study-merge", "study-1-of-2.h5", "study-2-of-2.h5", "-o", "merged.h5")
    path = "bond_graph/properties/m.f/F/dc_gain"
    dynid("study-worst", "study.h5", path, "-o", "out/one.yaml")
    Path("scenes/base.yaml").write_text("other: 1\n")
    dynid("study-worst", "merged.h5", path, "-o", "out/two.yaml")
    Path("scenes/base.yaml").write_text(BASE)
    one, two = (Path(f"out/{name}.yaml").read_text() for name in ("one", "two"))
    assert one.replace("study.h5", "") == two.replace("merged.h5", "")


def test_another_kind_of_result_is_refused(dynid, folder):
    dynid("run", folder / "small.yaml", "-q")
    code, _, err = dynid("study-worst", "small.h5", "a/b", "-o", "w.yaml")
    assert code == 2
    assert "not of a study" in err
