"""What was written once is read for ever; what a later version wrote is refused in a sentence."""

import h5py
import pytest

import dynid
import dynid.scene.load
import dynid.store.reader
from dynid.errors import FileError, SceneError
from dynid.result import Result
from dynid.store import write_result

SCENE = """\
dynid: {number}
kind: bond-graph
{key}:
  nodes: {{F: Se, m: {{type: I, value: 2}}, "1": 1}}
  bonds: [F -> 1, 1 -> m]
analysis: {{inputs: [F], outputs: [m.f], results: [poles]}}
"""


def test_a_scene_of_an_older_format_is_read_and_kept_as_written(tmp_path, monkeypatch):
    def rename(data):
        return {("graph" if key == "bondgraph" else key): value for key, value in data.items()}

    monkeypatch.setitem(dynid.scene.load.STEPS, 0, rename)
    scene = tmp_path / "old.yaml"
    scene.write_text(SCENE.format(number=0, key="bondgraph"))
    result = dynid.run(scene)
    assert result["bond_graph/transfer_function/m.f/F/poles"].data == [0]
    assert result.attrs["scene"] == scene.read_text()


@pytest.mark.parametrize(
    ("number", "said"),
    [
        (2, "old.yaml:1:8: the scene has format 2; this dynid reads formats up to 1: update dynid"),
        (0, "old.yaml:1:8: 'dynid' cannot be 0; it can only be 1"),
    ],
)
def test_a_scene_of_an_unknown_format_is_refused(tmp_path, monkeypatch, number, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old.yaml").write_text(SCENE.format(number=number, key="graph"))
    with pytest.raises(SceneError) as caught:
        dynid.load_scene("old.yaml")
    assert str(caught.value) == said


def written(folder, number):
    """Write a result, and say that it has some format."""
    result = Result("reduction", "old")
    result.add("reduction/serep/mass", [[2.0]], ("a", "b"), "kg")
    write_result(result, folder / "old.h5")
    with h5py.File(folder / "old.h5", "a") as file:
        file.attrs["format"] = number
    return folder / "old.h5"


def test_a_result_of_an_older_format_is_read(tmp_path, monkeypatch):
    def rename(old):
        new = Result(old.kind, old.title, old.attrs)
        for path, variable in old.items():
            new.add(path.replace("mass", "M"), variable.data, variable.dims, variable.units)
        return new

    monkeypatch.setitem(dynid.store.reader.STEPS, 0, rename)
    assert set(dynid.open_result(written(tmp_path, 0))) == {"reduction/serep/M"}


@pytest.mark.parametrize(
    ("number", "said"), [(2, "reads formats up to 1.*Update dynid"), (0, "no dynid has ever written")]
)
def test_a_result_of_an_unknown_format_is_refused(tmp_path, number, said):
    with pytest.raises(FileError, match=said):
        dynid.open_result(written(tmp_path, number))
