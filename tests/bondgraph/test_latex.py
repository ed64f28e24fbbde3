"""LaTeX of the trace: it is well formed, and it says what the text says."""

import random
import re
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dynid
from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from dynid.bondgraph.formula_printers import latex_name
from tests.bondgraph.graphs import solvable
from tests.bondgraph.random_graphs import random_graph


def group(text, start):
    """Return the content of the braces that open at `start`, and the place behind them."""
    depth = 0
    for place in range(start, len(text)):
        depth += {"{": 1, "}": -1}.get(text[place], 0)
        if depth == 0:
            return text[start + 1 : place], place + 1
    raise AssertionError(f"unbalanced braces: {text}")


def as_python(latex):
    """Translate LaTeX without names into Python arithmetic."""
    latex = latex.replace(r"\left(", "(").replace(r"\right)", ")").replace(r"\,", "*").replace(r"\cdot", "*")
    while (place := latex.find(r"\frac")) >= 0:
        top, middle = group(latex, place + len(r"\frac"))
        bottom, end = group(latex, middle)
        latex = f"{latex[:place]}(({top})/({bottom})){latex[end:]}"
    latex = re.sub(r"\^\{(\d+)\}", r"**\1", latex)
    assert not re.search(r"[\\{}]", latex), latex
    return latex


def values_of(steps, field, separator, given):
    """Evaluate all definitions in order, and return the value of the last."""
    known = dict(given)
    for row in steps:
        for definition in row[field].split(separator):
            name, _, formula = definition.partition(" = ")
            names = sorted(known, key=len, reverse=True)
            pattern = "|".join(re.escape(known_name) for known_name in names)
            code = re.sub(rf"(?<!\w)({pattern})(?!\w)", lambda match: f"v[{names.index(match[1])}]", formula)  # noqa: B023
            code = as_python(code) if field == "latex" else code
            code = re.sub(r"(?<![\w\[*])(\d+)(?![\w\]])", r"Fraction(\1)", code)
            known[name] = eval(code, {"v": [known[n] for n in names], "Fraction": Fraction})
    return known[name]


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(), junctions=st.integers(1, 4), loops=st.sampled_from([0, 0, 1]))
def test_latex_and_text_of_a_random_trace_have_the_same_value(seed, junctions, loops):
    rng = random.Random(seed)
    made = _, values, _, inputs, _ = random_graph(rng, junctions, loops)
    graph = solvable(made)
    if graph is None:
        return
    result = analyse(graph.graph, Analysis(graph.inputs, graph.outputs, frozenset({"reduction"})))
    steps = result.value("bond_graph/reduction/steps")
    known = {**values, "s": Fraction(13, 7), **{name: Fraction(rng.randint(1, 9)) for name in inputs}}
    # merges and constraints speak of common variables that are known only at the end
    known |= {
        f"{letter}_{name}": Fraction(rng.randint(1, 9))
        for name in graph.structure.junctions
        for letter in "ef"
    }
    texts = values_of(steps, "equation", "; ", known)
    typeset = {latex_name(name): value for name, value in known.items()}
    assert values_of(steps, "latex", r";\quad ", typeset) == texts


@pytest.mark.parametrize(
    ("name", "typeset"),
    [
        ("m_s", "m_{s}"),
        ("s", "s"),
        ("k12", "k_{12}"),
        ("omega_in", r"\omega_{\mathrm{in}}"),
        ("e_eq_base", r"e_{\mathrm{eq},\mathrm{base}}"),
        ("body", r"\mathrm{body}"),
        ("m-1", r"\mathrm{m{-}1}"),
        ("Z_A", "Z_{A}"),
        ("x_1_2", "x_{1,2}"),
        ("7", "7"),
        ("_", r"\_"),
    ],
)
def test_names_are_typeset(name, typeset):
    assert latex_name(name) == typeset


SCENE = """
dynid: 1
kind: bond-graph
parameters: {zeta: 1/4, k: 3, m: 2}
graph:
  nodes: {u: Se, j: 1, a: {type: I, value: 2*m}, b: {type: R, value: 'DAMPER'}, c: {type: C, value: -1/(-k)}}
  bonds: [u -> j -> a, j -> b, j -> c]
analysis: {outputs: [u.f], results: [prototype]}
"""


@pytest.mark.parametrize(
    ("written", "typeset"),
    [
        ("zeta*(m + k)**2", r"\zeta \, \left(m + k\right)^{2}"),
        ("2*sqrt(k*m)*zeta", r"2 \, \sqrt{k \, m} \, \zeta"),
        ("m*2", r"m \cdot 2"),
        ("k*0.5", r"\frac{k}{2}"),
        ("max(k, -m)", r"\max\left(k, -m\right)"),
        ("abs(k)/log(m)", r"\frac{\left|k\right|}{\ln\left(m\right)}"),
        ("k*exp(-m)", r"k \, \mathrm{e}^{-m}"),
        ("k - (m - k)", r"\left(k - \left(m - k\right)\right)"),
    ],
)
def test_expressions_are_typeset_from_their_tree(tmp_path, written, typeset):
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE.replace("DAMPER", written), encoding="utf-8")
    (system,) = dynid.run(scene).value("bond_graph/reduction/system_a_latex")
    assert typeset.removeprefix(r"\left(").removesuffix(r"\right)") in system
    assert system.startswith(r"Z_{A} = \frac{k}{s} + ")


@pytest.mark.parametrize(
    "written",
    [
        "1/k",
        "-1/k",
        "k/(-m)",
        "1/(k/m)/zeta",
        "-(k - m)/(m + k)",
        "(1/k)**2",
        "0.1*k",
        "1/(1/k + 1/m)",
        "--k",
        "k*k*m",
    ],
)
@pytest.mark.parametrize("kind", ["R", "I", "C", "TF", "GY"])
def test_quotients_of_quotients_are_one_quotient_of_the_same_value(tmp_path, written, kind):
    behind, bond = (", y: {type: R, value: 7}", " -> y") if kind in ("TF", "GY") else ("", "")
    nodes = f"u: Se, j: 1, x: {{type: I, value: 1}}, a: {{type: {kind}, value: '{written}'}}{behind}"
    text = (
        SCENE.partition("graph:")[0] + f"graph: {{nodes: {{{nodes}}}, bonds: [u -> j -> x, j -> a{bond}]}}\n"
    )
    scene = tmp_path / "scene.yaml"
    scene.write_text(text + "analysis: {outputs: [x.f], results: [prototype]}\n", encoding="utf-8")
    (system,) = dynid.run(scene).value("bond_graph/reduction/system_a")
    names = {"zeta": Fraction(1, 4), "k": Fraction(3), "m": Fraction(2), "s": Fraction(5), "y": Fraction(7)}
    value = eval(written, dict(names))
    impedance = {"R": value, "I": 5 * value, "C": 1 / (5 * value), "TF": 7 * value**2, "GY": value**2 / 7}
    found = eval(system.partition(" = ")[2], dict(names))
    assert float(found) == pytest.approx(float(impedance[kind]), rel=1e-14)
    assert "/(1/k)" not in system
    assert "--" not in system
