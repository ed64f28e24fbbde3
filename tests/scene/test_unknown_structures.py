"""Structures of scenes whose quantities name unknown parameters."""

import numpy as np
import pytest

from dynid.errors import SceneError
from dynid.scene.kinds.structures import build_structure
from dynid.scene.load import load_scene

ANALYSIS = (
    "analysis: {inputs: [1], outputs: [{dof: 1, quantity: displacement}], frequency: {start: 1, stop: 9}}"
)


def structure_of(folder, text, kind="identification"):
    (folder / "scene.yaml").write_text(f"dynid: 1\nkind: {kind}\n{text}\n{ANALYSIS}\n")
    scene = load_scene(folder / "scene.yaml")
    return build_structure(scene, scene.model.structure, scene.model.joints)


def test_every_quantity_of_a_beam_may_be_unknown(tmp_path):
    model = structure_of(
        tmp_path,
        """
parameters:
  EI: {start: 100, true: 120}
  r: {start: 2}
  L: {start: 3}
  m: {start: 0.5}
  kb: {start: 9, true: 10}
  z: {start: 0.02}
  unused: {start: 1}
  sure: 7
structure:
  beam:
    elements: 3
    length: L
    EI: [EI, 2*EI, 90]
    rhoA: r
    supports: [{node: 1, fix: [w]}]
    masses: [{node: 2, m: m, J: m/9}]
    springs: [{node: 4, direction: w, k: kb + sure}]
    damping: {ratio: z}
joints:
  one: {dofs: [1], k: kb, c: {start: 0.1}}
  two: {dofs: [w_3], k: 2*kb, m: m}
""",
    )
    assert [(one.name, one.unit) for one in model.unknowns if one.name in model.names] == [
        ("one.c", "N.m.s/rad"), ("EI", "N.m^2"), ("r", "kg/m"), ("L", "m"), ("m", "kg"), ("kb", "N.m/rad"),
        ("z", ""),
    ]  # fmt: skip
    values = {"one.c": 0.1, "EI": 110.0, "r": 2.2, "L": 3.1, "m": 0.4, "kb": 11.0, "z": 0.03}
    numbers = structure_of(
        tmp_path,
        """
structure:
  beam:
    elements: 3
    length: 3.1
    EI: [110, 220, 90]
    rhoA: 2.2
    supports: [{node: 1, fix: [w]}]
    masses: [{node: 2, m: 0.4, J: 0.4/9}]
    springs: [{node: 4, direction: w, k: 18}]
    damping: {ratio: 0.03}
joints: {one: {dofs: [1], k: 11, c: 0.1}, two: {dofs: [w_3], k: 22, m: 0.4}}
""",
    )
    for found, wanted in zip(model.with_joints(values), numbers.with_joints(), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
    assert model.K[0, 0] == pytest.approx(4 * 120)  # the reference is the true value


def test_a_frame_and_point_masses_may_be_unknown(tmp_path):
    plane = structure_of(
        tmp_path,
        """
parameters: {x: {start: 2, scale: linear}, EA: {start: 50}, al: {start: 0.1}, J: {start: 0.0, scale: linear}}
structure:
  frame:
    nodes: [[0, 0], [x, 1]]
    members: [{nodes: [1, 2], EA: EA, EI: 3, rhoA: 1, hinges: [2]}]
    supports: [{node: 1, fix: [u, w, theta]}]
    masses: [{node: 2, J: J}]
    damping: {alpha: al}
""",
    )
    assert plane.dofs == ("u_2", "w_2", "theta_2")
    assert {one.name: one.unit for one in plane.unknowns} == {"x": "", "EA": "N", "al": "1/s", "J": "kg.m^2"}
    points = structure_of(
        tmp_path,
        """
parameters: {m: {start: 2}, k: {start: 5}}
structure: {lumped: {masses: [m, 3*m], links: [{dofs: [1], k: k}, {dofs: [1, 2], k: 4, c: k/100}]}}
""",
    )
    np.testing.assert_allclose(points.with_joints({"m": 4.0})[0], np.diag([4.0, 12.0]))
    np.testing.assert_allclose(points.slopes({})[1]["C"], [[0.01, -0.01], [-0.01, 0.01]])


def test_matrices_in_parts(tmp_path):
    def written(name, matrix):
        n = len(matrix)
        numbers = "\n".join(map(str, np.array(matrix, dtype=float).ravel()))
        (tmp_path / name).write_text(f"%%MatrixMarket matrix array real general\n{n} {n}\n{numbers}\n")

    written("M.mtx", [[2, 0], [0, 3]])
    written("K0.mtx", [[5, 0], [0, 0]])
    written("K1.mtx", [[1, -1], [-1, 1]])
    model = structure_of(
        tmp_path,
        """
parameters: {theta: {start: 7}, s: 2}
structure:
  matrices:
    mass: M.mtx
    stiffness: [K0.mtx, {path: K1.mtx, factor: theta*s}]
    damping: {path: K1.mtx, factor: 0.5}
""",
    )
    np.testing.assert_array_equal(model.K, [[19, -14], [-14, 14]])
    np.testing.assert_array_equal(model.C, [[0.5, -0.5], [-0.5, 0.5]])
    np.testing.assert_array_equal(model.slopes({"theta": 1.0})[0]["K"], [[2, -2], [-2, 2]])


@pytest.mark.parametrize(("labels", "unit"), [("", ""), (", labels: [theta_1, w_2]", "N.m/rad")])
def test_a_shared_stiffness_has_a_unit_where_labels_say_what_its_dofs_are(tmp_path, labels, unit):
    np.savetxt(tmp_path / "A.txt", np.eye(2))
    text = f"""
parameters: {{s: {{start: 7}}}}
structure: {{matrices: {{mass: A.txt, stiffness: A.txt{labels}}}}}
joints: {{j: {{dofs: [1], k: {{value: s}}}}}}
"""
    (unknown,) = structure_of(tmp_path, text).unknowns
    assert (unknown.name, unknown.unit) == ("s", unit)


def test_a_missing_part_is_located(tmp_path):
    with pytest.raises(SceneError, match=r"scene\.yaml:7:\d+: no parameter 'thet'"):
        structure_of(
            tmp_path,
            """
structure:
  matrices:
    mass: M.mtx
    stiffness: [{path: K.mtx, factor: thet}]""".strip("\n").replace(
                "structure:", "parameters: {theta: {start: 1}}\nstructure:"
            ),
        )


def test_in_a_comparison_of_reductions_an_unknown_has_its_reference_value(tmp_path):
    (tmp_path / "scene.yaml").write_text("""
dynid: 1
kind: reduction
parameters: {k: {start: 5, true: 6}}
structure: {lumped: {masses: [1, 2], links: [{dofs: [1], k: k}, {dofs: [1, 2], k: 4}]}}
reduction: [{method: guyan, masters: [2]}]
""")
    scene = load_scene(tmp_path / "scene.yaml")
    model = build_structure(scene, scene.model.structure, scene.model.joints)
    assert model.K[0, 0] == 10.0
    assert not model.names


@pytest.mark.parametrize(
    "part",
    [
        "lumped: {masses: [1, 2], links: [{dofs: [1], k: 50, c: -x}, {dofs: [2], k: 50}, "
        "{dofs: [1, 2], k: -x}]}",
        "lumped: {masses: [1, 2], links: [{dofs: [1], k: 50}, {dofs: [2], k: 50}]}}\n"
        "joints: {j: {dofs: [1, 2], k: -x, c: 0}",
        "beam: {elements: 1, length: 1, EI: 90, rhoA: 1, supports: [{node: 1, fix: [w, theta]}], "
        "springs: [{node: 2, direction: w, k: -x}]}",
    ],
)
def test_stiffness_and_damping_may_be_negative_where_the_parameter_may(tmp_path, part):
    text = "parameters: {x: {start: 1, true: 3, scale: linear}}\nstructure: {" + part + "}\n"
    model = structure_of(tmp_path, text)
    with_x, without = (model.with_joints({"x": x})[2] for x in (3.0, 0.0))
    assert (with_x - without).diagonal().min() == pytest.approx(-3)
    with pytest.raises(SceneError, match="-3 is negative"):
        structure_of(tmp_path, text.replace("linear", "log"))


def test_masses_stay_positive_whatever_the_scale(tmp_path):
    with pytest.raises(SceneError, match="-3 is negative"):
        structure_of(
            tmp_path,
            "parameters: {x: {start: 1, true: -3, scale: linear}}\n"
            "structure: {lumped: {masses: [1, x], links: [{dofs: [1], k: 5}, {dofs: [1, 2], k: 5}]}}",
        )
