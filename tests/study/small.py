"""A study that costs nearly nothing, for tests of how studies are run."""

import numpy as np

from dynid.scene.load import load_scene
from dynid.store import read_result
from dynid.study.plan import make_plan

SCENE = """\
dynid: 1
kind: bond-graph
title: A mass on a damper
parameters: {m: 2, b: 1}
graph:
  nodes: {F: Se, m: {type: I, value: m}, b: {type: R, value: b}, one: 1}
  bonds: [F -> one -> m, one -> b]
analysis:
  inputs: [F]
  outputs: [m.f]
expect:
  - {path: bond_graph/properties/m.f/F/dc_gain, max: 1}
"""

STUDY = """\
dynid: 1
kind: study
title: Masses on dampers
scene: mass.yaml
vary:
  parameters.m: {start: 1, stop: 4, points: 4}
  parameters.b: {values: [0.5, 1, -2]}
collect:
  - bond_graph/properties/m.f/F/dc_gain
  - bond_graph/properties/m.f/F/stable
  - bond_graph/transfer_function/m.f/F/poles
"""


def written(folder, study=STUDY, scene=SCENE):
    """Write both scenes into a folder; return the study's file."""
    (folder / "mass.yaml").write_text(scene)
    (folder / "masses.yaml").write_text(study)
    return folder / "masses.yaml"


def planned(folder, study=STUDY, scene=SCENE):
    """Return the plan of a study written into a folder."""
    return make_plan(load_scene(written(folder, study, scene)))


def datasets(path):
    """Return everything under study/ of a file, for comparison."""
    result = read_result(path, partial=True)
    attrs = {group: values for group, values in result.group_attrs.items() if group.startswith("study")}
    return {path: variable for path, variable in result.items() if path.startswith("study/")}, attrs


def assert_same(one, other):
    """Check that two files hold the same arrays, types, axes and attributes under study/, bit by bit."""
    (mine, my_attrs), (theirs, their_attrs) = datasets(one), datasets(other)
    assert my_attrs == their_attrs
    assert mine.keys() == theirs.keys()
    for path, variable in mine.items():
        assert variable.equals(theirs[path]), path
        if variable.data.dtype.kind != "O":
            assert variable.data.tobytes() == theirs[path].data.tobytes(), path
    assert np.array_equal(mine["study/sample"].data, np.arange(len(mine["study/sample"].data)))
