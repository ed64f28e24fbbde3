"""Scenes built in code say what the same scenes say in YAML, and are written so."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dynid
from dynid.errors import FileError, SceneError, UsageError

CONFIGS = Path(__file__).parents[1] / "configs"


def test_a_graph_built_in_code_is_the_graph_of_the_scene():
    built = dynid.GraphBuilder("Oscillator").parameters(m=2, k=800).node("F", "Se").node("body", 1)
    built.node("m", "I", "m").node("spring", "C", "1/k").node("damper", "R", 4)
    built.bond("F -> body -> m").bond("body -> spring").bond("body -> damper")
    built.expect("bond_graph/properties/m.f/F/order", 2)
    result = dynid.run(built.scene(outputs=["m.f"], frequency={"start": 1, "stop": 10, "points": 5}))
    group = "bond_graph/transfer_function/m.f/F"
    assert list(result[f"{group}/numerator"].data) == [0.5, 0]
    assert list(result[f"{group}/denominator"].data) == [1, 2, 400]
    assert result["bond_graph/frequency_response/response"].data.shape == (5, 1, 1)


def test_a_structure_built_in_code_is_identified_as_the_shipped_scene():
    built = dynid.StructureBuilder.lumped([2, 2, 1.5, 1, 1], "Suspension, 5 % noise (Yang, Table 2)")
    built.link([1], k=2.0e4, c=20).link([1, 2], k=3.0e4, c=30).link([4, 5], k=2.0e4, c=20)
    for name, dofs in (("upper", [2, 3]), ("lower", [3, 4])):
        built.joint(name, dofs, k={"start": 1.0e4, "true": 2.0e4}, c={"start": 10, "true": 20})
    built.excite(5, "multisine", amplitude=[100, 100, 100], frequency=[70, 110, 250])
    channels = [{"dof": dof, "quantity": "velocity"} for dof in (2, 3)]
    built.measure(channels, step=0.002, samples=800, simulate={"noise_ratio": 0.05, "seed": 1, "settle": 10})
    shipped = dynid.run(CONFIGS / "suspension_noisy.yaml")
    mine = dynid.run(built.scene())
    estimate = "identification/parameters/estimate"
    assert list(mine[estimate].data) == list(shipped[estimate].data)


def test_plain_data_are_checked_like_a_file():
    with pytest.raises(SceneError) as caught:
        dynid.GraphBuilder().node("F", "Se").node("m", "I").bond("F -> n").scene(outputs=["m.f"])
    said = str(caught.value)
    assert "I needs its value" in said
    assert "no node 'n'" in said


def test_a_name_that_is_given_twice_is_refused():
    built = dynid.GraphBuilder().node("m", "I", 2)
    with pytest.raises(UsageError, match="the node 'm' is given twice"):
        built.node("m", "I", 20)
    joined = dynid.StructureBuilder.lumped([1]).joint("j", [1], k=1)
    with pytest.raises(UsageError, match="the joint 'j' is given twice"):
        joined.joint("j", [1], k=2)


def test_faults_of_a_built_scene_name_the_value():
    built = dynid.GraphBuilder().node("F", "Se").node("b", "R", "q").bond("F -> b")
    with pytest.raises(SceneError, match=r":\d+:\d+: graph\.nodes\.b\.value: no parameter 'q'$"):
        built.scene(outputs=["b.f"])


def test_a_loop_around_a_mass_moves_its_pole():
    built = dynid.GraphBuilder().node("F", "Se").node("body", 1).node("m", "I", 2).node("b", "R", 4)
    built.bond("F -> body -> m").bond("body -> b")
    with pytest.raises(SceneError, match="'control' is not a key of analysis; write it at the top level"):
        built.scene(outputs=["m.f"], control={"loops": []})
    built.loop("m.f", "F", {"gain": 6}, setpoint="w")
    poles = dynid.run(built.scene(outputs=["m.f"]))["bond_graph/transfer_function/m.f/w/poles"].data
    assert poles == pytest.approx([-(4 + 6) / 2])


def test_a_builder_goes_on_after_a_scene_was_taken():
    built = dynid.GraphBuilder("R").node("F", "Se").node("b", "R", 4).bond("F -> b")
    first = built.scene(outputs=["b.f"])
    second = built.parameters(unused=1).scene(outputs=["b.e"])
    assert "unused" not in first.source.text
    assert "unused" in second.source.text


def test_paths_are_relative_to_the_folder_given(tmp_path):
    record = {"step": 0.1, "samples": 3, "file": {"path": "none.csv"}}
    built = dynid.StructureBuilder.lumped([1]).joint("j", [1], k={"start": 1}).excite(1, "step")
    built.measure([{"dof": 1, "quantity": "velocity"}], **record)
    with pytest.raises(dynid.errors.FileError, match=str(tmp_path / "none.csv")):
        dynid.run(built.scene(folder=tmp_path))


#: Words that YAML could take for something else, and any others.
NAMES = st.sampled_from(["on", "yes", "null", "e", "x_1"]) | st.from_regex(r"\A[a-zE][0-9aEon_-]{0,5}\Z")
MAGNITUDES = st.floats(1e-300, 1e300)
NUMBERS = st.one_of(
    MAGNITUDES,
    MAGNITUDES.map(np.float64),
    st.integers(1, 10**30),
    st.integers(1, 2**31).map(np.int64),
    st.fractions(min_value=Fraction(1, 10**6)).filter(bool),
    st.sampled_from(["p", "2*p", "p**2/3"]),
)
TITLES = st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=20)


@given(title=TITLES, elements=st.dictionaries(NAMES, st.tuples(st.sampled_from("ICR"), NUMBERS), min_size=1))
@settings(max_examples=20, deadline=None)
def test_any_graph_is_read_back_as_it_was_built(tmp_path_factory, title, elements):
    built = dynid.GraphBuilder(title).parameters(p=3).node("the-source", "Se").node("the-junction", 1)
    built.bond("the-source -> the-junction")
    for name, (kind, value) in elements.items():
        built.node(name, kind, value).bond(f"the-junction -> {name}")
    scene = built.scene(outputs=[f"{name}.f" for name in elements])
    assert_read_back(scene, tmp_path_factory.mktemp("graph") / "scene.yaml")


@given(
    title=TITLES,
    masses=st.lists(st.floats(1e-300, 1e150), min_size=1, max_size=5),
    joints=st.sets(NAMES, max_size=3),
)
@settings(max_examples=20, deadline=None)
def test_any_structure_is_read_back_as_it_was_built(tmp_path_factory, title, masses, joints):
    built = dynid.StructureBuilder.lumped(np.array(masses), title).link((1,), k=np.float32(3), c=0.5)
    built.excite(1, "multisine", amplitude=np.array([1.0, 2.0]), frequency=(3, 4.5))
    built.measure([{"dof": 1, "quantity": "velocity"}], step=0.01, samples=20, simulate={"noise_ratio": 0.01})
    for name in joints | {"first"}:
        built.joint(name, [1], k={"start": 10, "true": Fraction(1, 3)})
    assert_read_back(built.scene(), tmp_path_factory.mktemp("structure") / "scene.yaml")


def assert_read_back(scene, path):
    scene.write(path)
    again = dynid.load_scene(path)
    assert again == scene
    assert hash(again) == hash(scene)
    assert again.model == scene.model
    assert dynid.scene_from(again.source.data) == scene


def test_a_shipped_scene_is_written_as_it_stands_and_set_values_are_written_too(tmp_path):
    path = tmp_path / "half_car.yaml"
    shipped = CONFIGS / "half_car.yaml"  # of sub-models
    dynid.load_scene(shipped).write(path)
    assert path.read_text() == shipped.read_text()
    changed = dynid.load_scene(CONFIGS / "isolator.yaml", ["parameters.b=100"])
    changed.write(path)
    assert dynid.load_scene(path) == changed != dynid.load_scene(CONFIGS / "isolator.yaml")
    assert changed != "isolator"
    with pytest.raises(FileError):
        changed.write(tmp_path / "missing" / "scene.yaml")


def test_a_built_graph_is_longer_than_any_text_and_its_faults_have_their_places(monkeypatch):
    monkeypatch.setattr("dynid.scene.yaml.parser.MAX_CHARACTERS", 300)
    built = dynid.GraphBuilder().node("F", "Se").node("body", 1).bond("F -> body")
    for k in range(30):
        built.node(f"m{k}", "I", k + 1).bond(f"body -> m{k}")
    scene = built.scene(outputs=["m0.f"], results=["poles"])
    result = dynid.run(scene)
    assert result.attrs["scene"] == scene.source.text == scene.to_yaml()
    assert len(scene.source.text) > 300
    line, column = scene.source.marks["graph", "nodes", "m29"].key
    assert scene.source.text.splitlines()[line - 1][column - 1 :] == "m29:"
    with pytest.raises(SceneError, match=r":6:9: graph\.nodes\.m9: I needs its value"):
        dynid.scene_from(scene.source.data | {"graph": {"nodes": {"m9": "I"}, "bonds": ["m9 -> m9"]}})


def test_paths_are_texts_and_other_objects_are_refused(tmp_path):
    scene = {"kind": "study", "scene": tmp_path / "isolator.yaml", "vary": {"parameters.b": {"values": [1]}}}
    (tmp_path / "isolator.yaml").write_text((CONFIGS / "isolator.yaml").read_text())
    assert dynid.scene_from(scene).source.data["scene"] == str(tmp_path / "isolator.yaml")
    with pytest.raises(UsageError, match=r"a scene cannot hold \(1\+2j\), of type complex"):
        dynid.GraphBuilder().node("b", "R", 1 + 2j).scene(outputs=["b.f"])
