"""Content of bond graphs: the screen and the page agree, and their statements are correct."""

import numpy as np
import pytest

import dynid
from dynid.bondgraph.request import RESULTS
from dynid.cli.summary import summary
from dynid.report.content import content
from dynid.report.content.blocks import DefinitionList, NumberedList, Statement, TextTable
from dynid.result import Result
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source
from dynid.templates.chain import chain_scene

MASSES = """\
dynid: 1
kind: bond-graph
title: Two masses
graph:
  nodes: {F: Se, x: 1, m: {type: I, value: 2}, k: {type: C, value: 0.5}, b: {type: R, value: 1},
          z: 0, c: {type: C, value: 0.1}, y: 1, M: {type: I, value: 3}, d: {type: R, value: 0.2}}
  bonds: [F -> x, x -> m, x -> k, x -> b, x -> z, z -> c, z -> y, y -> M, y -> d]
analysis:
  outputs: [m.f, M.f]
  results: [RESULTS]
"""
EVERY = (
    "transfer_function, zeros, poles, properties, hidden_modes, sensitivities, reduction, prototype, "
    "causality, state_space, frequency_response, time_response"
)
GRIDS = "  frequency: {start: 0.1, stop: 10, points: 5}\n  time: {stop: 1, step: 0.25}\n"


def masses(results=EVERY, more=GRIDS):
    return f"{MASSES.replace('RESULTS', results)}{more}"


def run(text):
    return dynid.run(check_source(parse_source(text, "s.yaml")))


def screen(result):
    """Return what the terminal shows, as one line."""
    return " ".join(summary(result, "now", trace=True).split())


def page(result):
    """Return what the page says, as one line."""

    def texts(block):
        match block:
            case DefinitionList(items):
                return [text for name, lines in items for text in (name, *lines)]
            case TextTable(columns, rows, _, caption):
                return [*columns, *(text for row in rows for text in row), caption]
            case Statement(text):
                return [text]
            case NumberedList(items):
                return list(items)

    parts = content(result).sections
    found = [text for part in parts for block in part.blocks for text in (part.title, *texts(block))]
    return " ".join(" ".join(found).split())


def both_say(result, *phrases):
    for phrase in phrases:
        assert phrase in screen(result)
        assert phrase in page(result)


@pytest.fixture(scope="module")
def everything():
    return run(masses(more=f"  port: x -> z\n{GRIDS}"))


def test_the_port_and_the_system_inside(everything):
    """Behind the port a compliance c beside a mass with damper: Z_B; its zero is -d/M."""
    both_say(
        everything,
        "Z = Z_B/(1 + Z_B*Y_A)",
        "Z_eq = (s*M + d)/(s**2*c*M + s*c*d + 1)",
        "Z_eq = (s**2*m*k + s*k*b + 1)/(s*k)",
        "e_eq of F = 1",
        "-0.06667",
        "F = 1 gives e = 0, f = 0",
    )


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("effort", "an ideal effort source: e = e_eq whatever the flow; it has no Y_eq and f_eq"),
        ("flow", "an ideal flow source: f = f_eq whatever the effort; it has no Z_eq and e_eq"),
    ],
)
def test_a_source_alone_behind_the_port_is_ideal(kind, said):
    text = masses("prototype", "  port: F -> x\n")
    if kind == "flow":
        text = text.replace("F: Se", "F: Sf").replace("x: 1,", "x: 0,")
        text = text.replace("x -> z, z", "x -> o -> z, z").replace("z: 0,", "o: 1, z: 0,")
    result = run(text)
    assert result.group_attrs["bond_graph/port/source"]["form"] == said
    both_say(result, said)


def test_causality_and_the_equations_of_state(everything):
    both_say(
        everything,
        "p_m, q_k, q_c, p_M",
        "zero dynamics, with M.f held at zero by F: states of k (C)",
        "d/dt k.e = 1/k*x.f",
        "d/dt y.f = 1/M*z.e - d/M*y.f",
    )


def test_steps_of_the_reduction(everything):
    both_say(everything, "Z_y = s*M + d", "Y_z = s*c + 1/Z_y")


def test_sensitivities_are_what_one_percent_does(everything):
    """Against the roots of the characteristic polynomial with one value a little larger."""

    def poles(**changed):
        v = {"m": 2, "k": 0.5, "b": 1, "c": 0.1, "M": 3, "d": 0.2} | changed
        A = np.array(
            [
                [-v["b"] / v["m"], -1 / v["m"], -1 / v["m"], 0],
                [1 / v["k"], 0, 0, 0],
                [1 / v["c"], 0, 0, -1 / v["c"]],
                [0, 0, 1 / v["M"], -v["d"] / v["M"]],
            ]
        )
        found = np.linalg.eigvals(A)
        return sorted(found[found.imag > 0], key=abs)

    moved = 0.01 * (np.array(poles(k=0.5 * (1 + 1e-6))) - poles()) / 1e-6
    (grid,) = {
        block
        for part in content(everything).sections
        for block in part.blocks
        if isinstance(block, TextTable)
        and block.caption.startswith("Changes if a parameter")
        and len(block.columns) == 4
    }
    row = next(row for row in grid.rows if row[0] == "k")
    shown = [complex(text.replace(" ", "")) for text in row[1:3]]
    np.testing.assert_allclose(shown, moved, rtol=5e-3)  # three digits are shown
    assert row[3] == "0"  # the zero lies behind k
    assert f"k {' '.join(row[1:])}" in screen(everything)


@pytest.mark.parametrize("name", RESULTS)
def test_each_result_can_be_asked_for_alone(name):
    result = run(masses(name))
    assert screen(result).startswith("Two masses bond graph")
    assert "10 nodes, 9 bonds" in screen(result)
    assert "10 nodes, 9 bonds" in page(result)


HIDDEN = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {F: Se, x: 1, m: {type: I, value: 2}, b: {type: R, value: 1},
          G: Se, y: 1, k: {type: C, value: 0.5}, M: {type: I, value: 3}}
  bonds: [F -> x, x -> m, x -> b, G -> y, y -> k, y -> M]
analysis: {inputs: [F, G], outputs: [m.f, M.f], results: [RESULTS]}
"""


def test_hidden_modes_and_what_holds_them():
    result = run(HIDDEN.replace("RESULTS", "transfer_function, poles, hidden_modes"))
    both_say(
        result,
        "-0.5: uncontrollable; its energy is in m 100 %",
        "± 0.8165j: uncontrollable; its energy is in k 50 %, M 50 %",
        "ω_n = 0.8165 rad/s, ζ = 0",
        "none",
    )


def test_another_engine_and_another_reading_say_so():
    result = run(
        masses("transfer_function, zeros, poles, properties", "  engine: float\n  reading: binary\n")
    )
    both_say(
        result,
        "a verdict within them is left undecided",
        "very value is read as the double nearest to it (reading: binary)",
        "0.5 ∏(s − zeros) / ∏(s − poles)",
    )


def test_of_very_many_the_first_are_shown_and_the_others_counted():
    outputs = "m.f, m.e, k.f, k.e, b.f, b.e, c.f, c.e, M.f, M.e, d.f, d.e, m.p, k.q, c.q, M.p"
    result = run(masses().replace("outputs: [m.f, M.f]", f"outputs: [{outputs}]"))
    both_say(result, "… 4 more outputs in the file", "relative degree")
    assert "… 10 more channels in the file" in screen(result)  # the remarks on zeros
    for output in outputs.split(", "):
        assert f"{output} / F" in page(result)
    many = run(HIDDEN.replace("RESULTS", "transfer_function"))
    assert "more" not in screen(many).partition("left out")[0]


def test_a_formula_too_long_to_expand_is_nested():
    chain = chain_scene(12)
    asked = chain[chain.index("results: [") : chain.index("]", chain.index("results: [")) + 1]
    result = run(chain.replace(asked, "results: [transfer_function]\n  engine: symbolic"))
    group = "bond_graph/transfer_function/v12.f/force"
    program = str(result.value(f"{group}/program")).splitlines()
    assert f"nested, in {len(program)} assignments:" in screen(result)
    both_say(result, " ".join(program[0].split()), "more in the file")


CONFLICT = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {F: Sf, x: 1, m: {type: I, value: 2}, b: {type: R, value: 1}, y: 0, k: {type: C, value: 0.5},
          n: {type: C, value: 3}}
  bonds: [F -> x, x -> m, x -> b, x -> y, y -> k, y -> n]
analysis: {outputs: [k.e], results: [causality, transfer_function, poles]}
"""


def test_storages_that_depend_on_others_are_told():
    result = run(CONFLICT)
    meanings = [str(row["meaning"]) for row in result["bond_graph/causality/dependent_storages"].data]
    assert len(meanings) == 2  # the mass follows the source, one compliance the other
    both_say(result, *(" ".join(meaning.split()) for meaning in meanings))


def test_a_result_of_another_kind_shows_what_it_holds():
    result = Result("weather", "Tomorrow")
    result.add("sky/clouds", [0.1, 0.2], ("hour",), "m")
    said = screen(result)
    assert said.startswith("Tomorrow weather · now")
    assert "clouds" in said
