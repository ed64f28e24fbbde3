"""Nonlinear laws of joints in scenes: their keys, names, faults, and time responses."""

import numpy as np
import pytest

import dynid
from dynid.errors import SceneError, UsageError
from dynid.scene.kinds.parts import structure_of
from dynid.scene.load import load_scene
from dynid.structure.joint_laws import LAWS

BODY = """
dynid: 1
kind: identification
{more}
structure: {{lumped: {{masses: [1, 2], links: [{{dofs: [1], k: 900, c: 3}}, {{dofs: [2], k: 400}}]}}}}
joints:
  bolt:
    dofs: [1, 2]
    {rest}
    laws: [{laws}]
excitation: [{{dof: 1, kind: multisine, amplitude: [30, 20], frequency: [20, 50], phase: [0, 1]}}]
analysis: {{outputs: [{{dof: 2, quantity: velocity}}], {asked}}}
"""
TIME = "time: {step: 0.005, stop: 0.5}"


def scene(folder, *laws, more="", rest="k: 100", asked=TIME):
    path = folder / "scene.yaml"
    path.write_text(BODY.format(laws=", ".join(laws), more=more, rest=rest, asked=asked))
    return load_scene(path)


@pytest.mark.parametrize(
    ("laws", "names", "scales"),
    [
        (["{kind: cubic, k3: {start: -2}}"], ["bolt.k3"], ["linear"]),
        (
            ["{kind: jenkins, kt: {start: 2}, fs: 3}", "{kind: jenkins, kt: 1, fs: {start: 3}}"],
            ["bolt.kt", "bolt.jenkins_2.fs"],
            ["log", "log"],
        ),
        (
            [
                "{kind: power, d: 1, v: 1, signed: [v], a: {start: 1}}",
                "{kind: quadratic_damping, c2: {start: 1}}",
            ],
            ["bolt.a", "bolt.c2"],
            ["linear", "log"],
        ),
        (
            ["{kind: bouc_wen, kz: {start: 1}, alpha: {start: 2}, delta: 0, n: 2}"],
            ["bolt.kz", "bolt.alpha"],
            ["log", "linear"],
        ),
        (["{kind: gap, kg: 1, clearance: {start: 1.0e-3, max: 1}}"], ["bolt.clearance"], ["log"]),
        (
            [
                "{kind: iwan, kt: 1, fs: {start: 2}, chi: {start: -0.5}, beta: 0}",
                "{kind: coulomb, fs: 1, v0: {start: 2}}",
            ],
            ["bolt.fs", "bolt.chi", "bolt.coulomb.v0"],
            ["log", "linear", "log"],
        ),
    ],
)  # fmt: skip
def test_unknown_parameters_of_laws_have_names_and_scales(tmp_path, laws, names, scales):
    model = structure_of(scene(tmp_path, *laws))
    assert [unknown.name for unknown in model.unknowns] == names
    assert [unknown.scale for unknown in model.unknowns] == scales


def test_laws_share_parameters_of_the_scene_and_an_offset(tmp_path):
    laws = ["{kind: expression, f: h*d**3 + 2*g*abs(v)*v}", "{kind: cubic, k3: 2*h}"]
    offset = "offset: {start: 0, prior: {value: 1, relative_deviation: 1}}"
    model = structure_of(scene(tmp_path, *laws, more="parameters: {h: {start: 5}, g: 3}", rest=offset))
    assert [unknown.name for unknown in model.unknowns] == ["bolt.offset", "h"]
    tangent = model.slopes({"bolt.offset": 0.1, "h": 5.0})[1]["K"]
    assert tangent == pytest.approx(3 * 0.1**2 * (1 + 2) * np.array([[1, -1], [-1, 1]]), rel=1e-6)


@pytest.mark.parametrize(
    ("laws", "options", "said"),
    [
        (["{kind: cubik, k3: 1}"], {}, "cubik"),
        (["{kind: jenkins, kt: 1}"], {}, "fs"),
        (["{kind: jenkins, kt: 1, fs: -2}"], {}, "-2 is not positive"),
        (["{kind: jenkins, kt: 1, fs: {start: 1, value: 2}}"], {}, "either a 'start'"),
        (["{kind: cubic, k3: {value: 2, true: 1}}"], {}, "belong beside 'start'"),
        (["{kind: cubic, k3: {start: 2, max: 1}}"], {}, "does not lie between"),
        (["{kind: gap, kg: 1, clearance: -1}"], {}, "-1 is not 0 or positive"),
        (["{kind: gap, kg: 1, clearance: {start: 0}}"], {}, "0 is not positive"),
        (["{kind: iwan, kt: 1, fs: 1, chi: -1, beta: 1}"], {}, "-1 is not above -1"),
        (["{kind: coulomb, fs: 1, v0: 0}"], {}, "0 is not positive"),
        (["{kind: power, d: 0.5, a: 1}"], {}, "infinite slope"),
        (["{kind: power, d: 1, signed: [v], a: 1}"], {}, "makes the force jump"),
        (["{kind: power, a: 1}"], {}, "has an exponent"),
        (["{kind: expression, f: 3*x*d}"], {}, "no parameter 'x'"),
        (["{kind: expression, f: 3}"], {}, "an expression of the deflection"),
        (["{kind: expression, f: 3*g}"], {"more": "parameters: {g: 1}"}, "depends neither"),
        (["{kind: expression, f: 3*d + 1}"], {}, "is 1 at rest"),
        (["{kind: expression, f: d/abs(d)}"], {}, "jumps or is infinite"),
        (["{kind: expression, f: 3*(d}"], {}, "3*(d"),
        (["{kind: expression, f: 3*d}"], {"more": "parameters: {d: 1}"}, "rename that"),
        (["{kind: jenkins, kt: 1, fs: 2}"], {"rest": "offset: 1"}, "shifts no law"),
        (["{kind: cubic, k3: 1, component: x}"], {}, "has a 'component'"),
    ],
)  # fmt: skip
def test_faults_of_laws_are_one_sentence_at_their_place(tmp_path, laws, options, said):
    with pytest.raises(SceneError) as error:
        dynid.run(scene(tmp_path, *laws, **options))
    assert said in str(error.value)
    assert "scene.yaml:" in str(error.value)


def test_laws_act_on_one_deflection(tmp_path):
    text = BODY.format(laws="{kind: cubic, k3: 1}", more="", rest="k: 1", asked=TIME)
    (tmp_path / "scene.yaml").write_text(
        text.replace("masses: [1, 2]", "masses: [1, 2, 1]").replace("dofs: [1, 2]\n", "dofs: [1, 2, 3]\n")
    )
    with pytest.raises(SceneError, match="laws act on one deflection, and 'dofs' names 3"):
        load_scene(tmp_path / "scene.yaml")


@pytest.mark.parametrize(
    "law",
    [
        "{kind: power, v: 2, signed: [v], a: -1}",
        "{kind: bouc_wen, kz: 1, alpha: -1, delta: 0}",
        "{kind: bouc_wen, kz: 1, alpha: 1, delta: -1}",
    ],
)
def test_laws_that_create_energy_are_refused_at_their_place(tmp_path, law):
    loaded = scene(tmp_path, law)
    with pytest.raises(UsageError, match="create") as error:
        dynid.run(loaded)
    assert loaded.locate(error.value).line == 10


def test_a_time_response_has_joint_forces_and_their_work(tmp_path):
    laws = ["{kind: jenkins, kt: 500, fs: 2}", "{kind: cubic, k3: 1000}"]
    result = dynid.run(scene(tmp_path, *laws))
    joints = {
        name: result[f"structure/joints/{name}"].data for name in ("deflection", "force", "work", "regime")
    }
    slipping = joints["regime"][:, 0] != 0
    assert 0 < np.count_nonzero(slipping) < len(slipping)
    slide = joints["force"][:, 0] - 1000 * joints["deflection"][:, 0] ** 3
    assert np.abs(slide[slipping]) == pytest.approx(2.0, rel=1e-12)
    assert np.abs(slide).max() <= 2 * (1 + 1e-9)
    assert joints["work"][-1, 0] > 0
    assert result.group_attrs["structure/joints"]["events"] > 3


def test_linear_analyses_say_that_they_use_tangents(tmp_path):
    asked = "frequency: {start: 1, stop: 9, points: 3}, modes: {count: 1}"
    result = dynid.run(scene(tmp_path, "{kind: jenkins, kt: 500, fs: 2}", asked=asked))
    for group in ("structure/frequency_response", "structure/modes"):
        assert "tangents at rest" in result.group_attrs[group]["note"]
    linear = dynid.run(scene(tmp_path, rest="k: 600", asked=asked))
    assert result["structure/modes/omega"].data == pytest.approx(linear["structure/modes/omega"].data)


def test_every_law_has_a_model_in_scenes():
    from dynid.scene.schema import joint_laws

    kinds = {
        model.model_fields["kind"].annotation.__args__[0]
        for model in vars(joint_laws).values()
        if isinstance(model, type) and "kind" in getattr(model, "model_fields", {})
    }
    assert kinds == {*LAWS}


def test_responses_beyond_the_amplitudes_of_the_records_say_so(tmp_path):
    more = (
        "measurement: {step: 0.005, samples: 150, channels: [{dof: 1, quantity: velocity}, "
        "{dof: 2, quantity: velocity}], simulate: {noise_ratio: 0.01, seed: 1}}"
    )
    law = "{kind: cubic, k3: {start: 900, true: 1000}}"
    for amplitude, beyond in ((20, False), (300, True)):
        drive = f"{{dof: 1, kind: sine, amplitude: {amplitude}, frequency: 22}}"
        asked = f"time: {{step: 0.005, stop: 0.2, input: [{drive}]}}"
        result = dynid.run(scene(tmp_path, law, more=more, asked=asked))
        note = result.group_attrs.get("structure/time_response", {}).get("note", "")
        assert ("in the records by" in note) == beyond
    assert result["identification/joints/range"].data.shape == (1,)


def test_joints_between_rotations_have_units_of_angles(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text("""
dynid: 1
kind: identification
structure: {beam: {elements: 2, length: 0.6, EI: 400, rhoA: 3, supports: [{node: 1, fix: [w]}]}}
joints:
  hinge:
    dofs: [theta_1]
    k: 2.0e3
    laws: [{kind: cubic, k3: {start: 1.0e6}}, {kind: jenkins, kt: {start: 8.0e3}, fs: {start: 8}}]
excitation: [{dof: w_3, kind: multisine, amplitude: [30], frequency: [90]}]
analysis: {outputs: [{dof: w_3}], time: {step: 0.005, stop: 0.05}}
""")
    loaded = load_scene(path)
    assert {unknown.name: unknown.unit for unknown in structure_of(loaded).unknowns} == {
        "hinge.k3": "N.m/rad3", "hinge.kt": "N.m/rad", "hinge.fs": "N.m",
    }  # fmt: skip
    joints = {
        name: variable.units for name, variable in dynid.run(loaded).items() if "structure/joints" in name
    }
    assert joints["structure/joints/deflection"] == "rad"
    assert joints["structure/joints/rate"] == "rad/s"
    assert joints["structure/joints/force"] == "N.m"
    assert joints["structure/joints/work"] == "J"


_STEADY = """
dynid: 1
kind: identification
structure: {lumped: {masses: [1], links: [{dofs: [1], k: 1000, c: 2}]}}
joints: {j: {dofs: [1], laws: [{kind: cubic, k3: 1.0e5}]}}
responses:
  harmonic_balance: {dof: 1, amplitude: 1, start: 4, stop: 6, unit: Hz}
"""


def steady(folder, *change):
    (folder / "scene.yaml").write_text(_STEADY.replace(*change) if change else _STEADY)
    return load_scene(folder / "scene.yaml")


def test_steady_states_are_requested_in_a_scene(tmp_path):
    from dynid.report.content.responses import steady_sections
    from dynid.report.figure import figures

    result = dynid.run(steady(tmp_path))
    omega = result["response/harmonic_balance/omega"].data
    assert omega[[0, -1]] == pytest.approx(2 * np.pi * np.array([4, 6]))
    assert result["response/harmonic_balance/amplitude"].units == "m"
    (section,) = steady_sections(result)
    assert "under the force 1 cos ωt at 1" in str(section)
    assert "0 folds of the curve, 0 unstable states" in str(section)
    (figure,) = (figure for figure in figures(result) if figure.name == "steady-states")
    assert figure.table.columns[-1] == "stable"


_STEPPED = """
dynid: 1
kind: identification
structure: {lumped: {masses: [1], links: [{dofs: [1], k: 1000, c: 2}]}}
joints: {j: {dofs: [1], laws: [{kind: cubic, k3: {start: 9.0e4}}]}}
measurement:
  channels: [{dof: 1, quantity: displacement, reference: {dof: 1, amplitude: 1}}]
  frf: {unit: Hz, file: {path: sines.csv, frequency: f, columns: [[re, im]]}}
"""


@pytest.mark.thorough
def test_laws_are_identified_from_stepped_sines_in_a_file(tmp_path):
    from dynid.structure.nonlinear.steady_states import harmonic_balance

    model = structure_of(steady(tmp_path))
    curve = harmonic_balance(model, 1, 1.0, 8 * np.pi, 10 * np.pi, stability=False, backbone=False)
    omega, first = (curve[f"response/harmonic_balance/{name}"].data for name in ("omega", "response"))
    rows = [
        f"{w / (2 * np.pi):.17g},{x.real:.17g},{x.imag:.17g}" for w, x in zip(omega, first[:, 1], strict=True)
    ]
    (tmp_path / "sines.csv").write_text("\n".join(["f,re,im", *rows]))
    (tmp_path / "scene.yaml").write_text(_STEPPED)
    result = dynid.run(load_scene(tmp_path / "scene.yaml"))
    assert result["identification/parameters/estimate"].data == pytest.approx(1e5, rel=1e-8)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ((", amplitude: 1}", "}"), "cannot identify nonlinear 'laws'; state the 'amplitude'"),
        (("amplitude: 1}", "sweep: down}"), "a 'sweep' is that of a stepped sine"),
        (("{dof: 1, amplitude: 1}", "{source: F, amplitude: 1}"), "not of the source of a graph"),
    ],
)
def test_stepped_sines_that_make_no_sense_are_refused(tmp_path, change, message):
    (tmp_path / "scene.yaml").write_text(_STEPPED.replace(*change))
    with pytest.raises(SceneError, match=message):
        load_scene(tmp_path / "scene.yaml")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("stop: 6", "stop: 4"), "'start' and 'stop' are the same frequency"),
        (("dof: 1, amplitude", "dof: 3, amplitude"), "no DOF 3|there is no DOF"),
        (("amplitude: 1,", "amplitude: 0,"), "0 is not positive"),
        (("laws: [{kind: cubic, k3: 1.0e5}]", "k: 10"), "no joint has nonlinear 'laws'"),
    ],
)
def test_steady_states_that_make_no_sense_are_refused(tmp_path, change, message):
    with pytest.raises(SceneError, match=message):
        steady(tmp_path, *change)
