"""Scenes of kind `synthesis`: their faults, what a run writes, the exported graphs."""

import re

import numpy as np
import pytest

import dynid
from dynid.cli import main
from dynid.errors import NumericalError, SceneError
from dynid.report.figure import figures
from dynid.scene.explanation import explain
from dynid.store import read_result

MINIMUM = "impedance: {numerator: [1, 1, 1], denominator: [1, 1, r]}\nparameters: {r: 4}\n"
LADDER = "admittance: {numerator: [1, 4, 3], denominator: [1, 2.1]}\ndomain: electrical\n"


def written(tmp_path, body, name="wanted.yaml"):
    path = tmp_path / name
    path.write_text(f"dynid: 1\nkind: synthesis\ntitle: Wanted\n{body}")
    return path


@pytest.fixture
def command(tmp_path, monkeypatch, capsys):
    """Return a function that runs a command in the folder of the test; exit code and screen are its value."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        with pytest.raises(SystemExit) as ended:
            main([*map(str, arguments)])
        captured = capsys.readouterr()
        return ended.value.code or 0, captured.out + captured.err

    return call


def test_a_run_holds_elements_nodes_and_bonds_of_every_form(tmp_path):
    result = dynid.run(dynid.load_scene(written(tmp_path, LADDER)))
    forms = list(result["synthesis/form"].data)
    assert forms == ["cauer", "cauer-2", "foster", "foster-2", "brune"]
    assert result["synthesis/residual"].data == pytest.approx(0, abs=1e-13)
    assert result.value("synthesis/positive_real") is True
    assert list(result["synthesis/cauer/element"].data) == ["C1", "R1", "C2", "R2"]
    assert list(result["synthesis/cauer/exact"].data) == ["1", "10/19", "361/99", "33/190"]
    assert result["synthesis/cauer/value"].data == pytest.approx([1, 10 / 19, 361 / 99, 33 / 190])
    assert list(result["synthesis/cauer/node_type"].data).count("Se") == 1
    assert result["synthesis/cauer/bond"].data[0] == "source -> parallel1"
    assert result["synthesis/zeros"].data == pytest.approx([-1, -3])
    np.testing.assert_array_equal(result["synthesis/foster/numerator"].data, [1, 4, 3])
    about = result.group_attrs["synthesis"]
    assert (about["kind"], about["degree"], about["unit"]) == ("RC", 2, "A/V")


def test_forms_that_do_not_exist_are_left_out_with_reasons(tmp_path):
    result = dynid.run(dynid.load_scene(written(tmp_path, MINIMUM)))
    assert list(result["synthesis/form"].data) == ["brune"]
    why = result["synthesis/need/why"].data[0]
    assert why.startswith("cauer: the continued fraction needs a negative element; cauer-2: ")
    asked = dynid.run(dynid.load_scene(written(tmp_path, MINIMUM + "forms: [brune]\n")))
    assert asked["synthesis/need/why"].data[0] == "not requested"


@pytest.mark.parametrize("form", ["cauer", "foster-2", "brune"])
def test_an_exported_graph_has_the_wanted_transfer_function(tmp_path, command, form):
    written(tmp_path, LADDER)
    assert command("run", "wanted.yaml", "-q")[0] == 0
    code, said = command("export", "wanted.h5", "--scene", "--form", form, "-o", "graph.yaml")
    assert (code, f"the {form} form" in said) == (0, True)
    code, said = command("run", "graph.yaml")
    assert code == 0, said
    assert "2 of 2 expectations met" in said
    result = read_result(tmp_path / "graph.h5")
    group = "bond_graph/transfer_function/source.f/source"
    assert result[f"{group}/numerator"].data == pytest.approx([1, 4, 3], rel=1e-13)
    assert result[f"{group}/denominator"].data == pytest.approx([1, 2.1], rel=1e-13)


def test_the_first_form_is_exported_and_others_are_refused(tmp_path, command):
    written(tmp_path, MINIMUM)
    command("run", "wanted.yaml", "-q")
    assert command("export", "wanted.h5", "--scene")[0] == 0
    assert "type: TF" in (tmp_path / "wanted.brune.yaml").read_text()
    code, said = command("export", "wanted.h5", "--scene", "--form", "brun")
    assert (code, "no form 'brun'; did you mean 'brune'?" in said) == (2, True)
    code, said = command("export", "wanted.h5", "--csv", "--form", "brune")
    assert (code, "Pass --scene, too" in said) == (2, True)


def test_a_form_of_what_is_no_synthesis_is_refused(tmp_path, command):
    (tmp_path / "g.yaml").write_text(
        "dynid: 1\nkind: bond-graph\ngraph:\n  nodes: {s: Se, r: {type: R, value: 1}}\n  bonds: [s -> r]\n"
        "analysis: {outputs: [r.f]}\n"
    )
    command("run", "g.yaml", "-q")
    code, said = command("export", "g.h5", "--scene", "--form", "brune")
    assert (code, "g.h5 is no synthesis" in said) == (2, True)


def test_long_values_are_exact_in_the_exported_scene(tmp_path):
    """Continued fractions of long decimals have values of more digits than an expression may have."""
    from fractions import Fraction

    from dynid.bondgraph.synthesis.forms import Driving, realise
    from dynid.scene.kinds.synthesis import scene_of_realisation

    numerator, denominator = [Fraction(1)], [Fraction(1)]
    for k in range(1, 14):
        sigma, zero = Fraction(f"{k}.{'1234567890123' * 2}"), Fraction(f"{k}.{'5678901234567' * 2}")
        for roots, root in ((denominator, sigma), (numerator, zero)):
            shifted = [*roots, Fraction(0)]
            roots[:] = [a + root * b for a, b in zip(shifted, [Fraction(0), *roots], strict=True)]
    wanted = Driving.of(numerator, denominator)
    one = realise(wanted, "cauer")
    assert one.residual == 0
    assert max(len(str(node.value)) for node in one.graph.nodes.values()) > 1000
    path = tmp_path / "long.yaml"
    path.write_text(scene_of_realisation(one, wanted, "Long"))
    scene = dynid.load_scene(path)
    read = {name: node.value.exact for name, node in scene.model.graph.nodes.items() if node.value}
    assert read == {name: node.value for name, node in one.graph.nodes.items() if node.value is not None}


def test_the_double_of_a_coefficient_is_another_function(tmp_path):
    body = "impedance: {numerator: [1, 0.1], denominator: [1, 0]}\nforms: [cauer]\n"
    values = [
        dynid.run(dynid.load_scene(written(tmp_path, body + more)))["synthesis/cauer/exact"].data[-1]
        for more in ("", "reading: binary\n")
    ]
    assert values == ["10", "36028797018963968/3602879701896397"]


@pytest.mark.parametrize(
    ("body", "line", "message"),
    [
        ("", 1, "a synthesis needs either an 'impedance' or an 'admittance'"),
        (MINIMUM + LADDER, 1, "a synthesis needs either an 'impedance' or an 'admittance'"),
        ("impedance: {numerator: [1], denominator: [0, 0]}", 4, "the denominator is zero"),
        ("impedance: {numerator: [0], denominator: [1]}", 4, "the function is zero: there is nothing to"),
        ("impedance: {numerator: [q], denominator: [1]}", 4, "no parameter 'q'"),
        ("impedance: {numerator: [], denominator: [1]}", 4, "'numerator' is empty"),
        (f"impedance: {{numerator: {[1] * 102}, denominator: [1]}}", 4, "at most 101"),
        (MINIMUM + "forms: [brun]\n", 6, "did you mean 'brune'"),
        (MINIMUM + "forms: [brune, brune]\n", 6, "'brune' is listed twice"),
        (MINIMUM + "forms: []\n", 6, "'forms' is empty"),
        (MINIMUM + "domain: steam\n", 6, "steam"),
        (MINIMUM + "analysis: {}\n", 6, "analysis"),
    ],
)
def test_a_fault_of_a_synthesis_has_its_place(tmp_path, body, line, message):
    with pytest.raises(SceneError) as caught:
        dynid.load_scene(written(tmp_path, body))
    fault = caught.value.faults[0]
    assert message in fault.message
    assert fault.line == line


@pytest.mark.parametrize("asked", ["run", "check"])
def test_a_function_that_is_not_positive_real_is_refused(tmp_path, command, asked):
    written(tmp_path, "impedance: {numerator: [1, 0.999999999999, 1], denominator: [1, 1, 4]}\n")
    code, said = command(asked, "wanted.yaml")
    assert code == 3
    where = r":4:1: the impedance is not positive real: its real part is -\d\.\d+e-1\d at ω = 1\.41"
    assert re.search(where, said)
    assert "No passive bond graph has it" in said
    assert not list(tmp_path.glob("*.h5"))


def test_a_named_form_that_does_not_exist_is_refused_at_its_key(tmp_path, command):
    scene = written(tmp_path, MINIMUM + "forms: [brune, foster]\n")
    code, said = command("run", scene)
    assert code == 3
    assert ":6:1: the function has no foster form: the poles -0.5 ± 1.936j of Z" in said
    with pytest.raises(NumericalError, match="no foster form"):
        dynid.run(dynid.load_scene(scene))


def test_an_explanation_lists_the_forms(tmp_path):
    facts = [fact.text for fact in explain(dynid.load_scene(written(tmp_path, MINIMUM))).facts]
    assert facts[0] == "a positive real impedance of degree 2: RLC"
    assert "brune: 9 nodes, 9 bonds" in facts
    assert "no cauer: the continued fraction needs a negative element" in facts
    spoiled = MINIMUM.replace("[1, 1, 1]", "[1, -1, 1]")
    assert "real part" in str(explain(dynid.load_scene(written(tmp_path, spoiled))).obstacle)


def test_screen_page_and_figures_of_a_synthesis(tmp_path, command):
    written(tmp_path, LADDER)
    said = command("run", "wanted.yaml", "--report", "wanted.html")[1]
    assert "Y(s)    (s^2 + 4 s + 3) / (s + 2.1) A/V" in said
    assert "positive real, of degree 2, of R and C alone" in said
    assert "cauer: C1 = 1.000 F, R1 = 0.5263 Ω" in said
    assert "Driving-point admittance" in (tmp_path / "wanted.html").read_text()
    drawn = {figure.name: figure for figure in figures(read_result(tmp_path / "wanted.h5"))}
    assert next(iter(drawn)) == "bond-graph-cauer"
    assert "foster form" in drawn["bond-graph-foster"].title
    assert "R1" in drawn["bond-graph-brune"].draw().svg


def test_a_synthesis_may_be_swept(tmp_path, command):
    written(tmp_path, MINIMUM)
    (tmp_path / "sweep.yaml").write_text(
        "dynid: 1\nkind: study\nscene: wanted.yaml\nvary: {parameters.r: {values: [4, 2, 1.5, 5]}}\n"
        "collect: [synthesis/brune/residual, synthesis/positive_real]\n"
    )
    assert command("study", "sweep.yaml", "-q", "--executor", "serial")[0] == 0
    assert list(read_result(tmp_path / "sweep.h5")["study/exit_code"].data) == [0, 0, 0, 3]
