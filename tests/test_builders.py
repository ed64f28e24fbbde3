"""Scenes built in code say what the same scenes say in YAML."""

from pathlib import Path

import pytest

import dynid
from dynid.errors import SceneError

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
