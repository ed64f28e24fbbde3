"""DOFs as keys in text, as JSON writes them, are the same DOFs."""

import json
import re

import numpy as np
import pytest
import yaml

from dynid.errors import DynidError
from dynid.scene.load import load_scene
from dynid.scene.run import run_scene

CHAIN = {
    "masses": [2, 2, 1.5],
    "links": [{"dofs": [1], "k": 2.0e4, "c": 6}, {"dofs": [1, 2], "k": 3.0e4, "c": 9}],
}
MODES = [
    {"frequency": 62.9, "shape": {1: 0.5, 2: 0.75, 3: 1.0}, "shape_std": {1: 0.1, 2: 0.1, 3: 0.2}},
    {"frequency": 130.0, "shape": {1: 1.0, 2: 0.5, 3: -0.9}},
]
SURVEY = {
    "dynid": 1, "kind": "identification", "structure": {"lumped": CHAIN},
    "joints": {"lower": {"dofs": [2, 3], "k": {"start": 1.0e4}}},
    "measurement": {"modes": {"values": MODES}},
}  # fmt: skip
RESPONSE = {
    "dynid": 1, "kind": "identification", "structure": {"lumped": CHAIN},
    "joints": {"lower": {"dofs": [2, 3], "k": 1.0e4}},
    "motions": {"mean": {1: 0.5, 3: 0.5}},
    "initial": {3: {"x": 0.01}, 1: {"v": 0.2}},
    "analysis": {
        "outputs": [{"dof": "mean", "quantity": "displacement"}], "time": {"stop": 0.1, "step": 1.0e-3}
    },
}  # fmt: skip


@pytest.mark.parametrize(
    ("scene", "path"),
    [(SURVEY, "identification/parameters/estimate"), (RESPONSE, "structure/time_response/response")],
    ids=["survey", "response"],
)
def test_dofs_as_keys_of_json_are_dofs(tmp_path, scene, path):
    text = json.dumps(scene)
    assert '"3": ' in text
    (tmp_path / "texts.yaml").write_text(text)
    (tmp_path / "numbers.yaml").write_text(yaml.safe_dump(scene))
    one, other = (run_scene(load_scene(tmp_path / f"{name}.yaml")) for name in ("texts", "numbers"))
    assert list(one) == list(other)
    np.testing.assert_array_equal(one[path].data, other[path].data)


@pytest.mark.parametrize("key", ["4", "0", "007", "1.0", "-1", "99999999999999999999999"])
def test_texts_that_are_no_dofs_are_refused_by_what_there_is(tmp_path, key):
    scene = json.loads(json.dumps(RESPONSE))
    scene["motions"] = {"mean": {key: 1.0}}
    (tmp_path / "x.yaml").write_text(json.dumps(scene))
    with pytest.raises(
        DynidError, match=f"there is no DOF '?{re.escape(key)}'?.*The structure has the DOFs 1 to 3"
    ):
        run_scene(load_scene(tmp_path / "x.yaml"))
