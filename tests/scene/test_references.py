"""References in scenes are found by the types of the fields that hold them."""

from dynid.scene.schema.identification import IdentificationScene
from dynid.scene.schema.measurement import RecordModel
from dynid.scene.schema.reduction import ReductionScene
from dynid.scene.schema.references import DOF, FILE, NODE, SIGNED_DOF, references, sections
from dynid.scene.schema.signals import SignalPart
from dynid.scene.schema.structure import StructureModel


def paths(found):
    return [".".join(map(str, one.path)) for one in found]


def test_dofs_stand_wherever_a_field_is_one_and_keys_are_marked():
    data = {
        "structure": {"matrices": {"mass": "M.mtx", "labels": ["a", "b"]}},  # labels define DOFs
        "joints": {"j": {"dofs": [1, "b"], "k": {"start": 1}}},
        "excitation": {"kind": "step", "dof": 3},  # a single signal needs no list
        "measurement": {"records": [{"channels": [{"dofs": [1, 2]}, {"reference": {"dof": 4}}]}]},
        "initial": {5: {"x": 1}},
        "unknown": {"dof": 9},
    }
    found = [one for kind in (DOF, SIGNED_DOF) for one in references(IdentificationScene, data, kind)]
    assert sorted(paths(found)) == [
        "excitation.dof",
        "initial.5",
        "joints.j.dofs.0",
        "joints.j.dofs.1",
        "measurement.records.0.channels.0.dofs.0",
        "measurement.records.0.channels.0.dofs.1",
        "measurement.records.0.channels.1.reference.dof",
    ]
    assert [one.value for one in found if one.is_key] == [5]


def test_a_value_of_the_wrong_form_has_no_references():
    data = {"joints": ["j"], "excitation": [3, {"dof": {"a": 1}}], "measurement": None, "reduction": "guyan"}
    assert list(references(IdentificationScene, data, DOF)) == []


def test_files_of_a_structure_and_nodes_of_a_frame():
    matrices = {"matrices": {"mass": "M.mtx", "stiffness": {"path": "K.h5:/K"}, "damping": {"alpha": 1}}}
    assert paths(references(StructureModel, matrices, FILE)) == ["matrices.mass", "matrices.stiffness.path"]
    frame = {"frame": {"members": [{"nodes": [1, 7]}], "supports": [{"node": 2, "fix": ["u"]}]}}
    assert paths(references(StructureModel, frame, NODE)) == [
        "frame.members.0.nodes.0",
        "frame.members.0.nodes.1",
        "frame.supports.0.node",
    ]


def test_the_masters_of_one_reduction_or_of_several():
    data = {"reduction": [{"method": "guyan", "masters": [1, 2]}, {"method": "modal", "residuals": [3]}]}
    assert [one.value for one in references(ReductionScene, data, DOF)] == [1, 2, 3]
    assert [
        one.value for one in references(IdentificationScene, {"reduction": data["reduction"][0]}, DOF)
    ] == [1, 2]


def test_sections_are_found_by_the_model_that_they_derive_from():
    data = {
        "dynid": 1,
        "kind": "identification",
        "structure": {"lumped": {"masses": [1]}},
        "joints": {"j": {"dofs": [1], "k": {"start": 1, "true": 2}}},
        "excitation": [{"kind": "sine", "dof": 1, "frequency": 1}],
        "analysis": {"time": {"stop": 1, "step": 1, "input": {"kind": "step", "dof": 1}}},
        "measurement": {
            **{"step": 1, "samples": 9, "channels": [{"dof": 1, "quantity": "velocity"}], "simulate": {}},
            "records": [{"excitation": {"kind": "impulse", "dof": 1}}],
        },
    }
    scene = IdentificationScene.model_validate(data)
    signals = [signal.kind for _, signal in sections(scene, SignalPart)]
    assert sorted(signals) == ["impulse", "sine", "step"]
    records = [path for path, _ in sections(scene, RecordModel)]
    assert records == [("measurement",), ("measurement", "records", 0)]


def test_a_scene_of_no_known_kind_names_no_files():
    from dynid.scene.files import file_places

    data = {"structure": {"matrices": {"mass": "M.mtx", "stiffness": "K.mtx"}}}
    assert list(file_places({"kind": "nothing", **data})) == []
    assert [place[-1] for place in file_places({"kind": "reduction", **data})] == ["mass", "stiffness"]
