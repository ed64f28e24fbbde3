"""Transfer functions as formulas: what the text says is the transfer function."""

import random
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sympy import Rational, sympify

import dynid
from dynid.bondgraph.formulas.symbolic import apply, quotient, variables
from dynid.bondgraph.formulas.transfer import formulas, nested, readable
from dynid.errors import UsageError
from tests.bondgraph.graphs import ISOLATOR, parse, solvable, written
from tests.bondgraph.random_graphs import random_graph
from tests.bondgraph.tableau import transfer_at

S = Fraction(17, 11)


def evaluated(text, values):
    """Evaluate a formula by SymPy at rational values."""
    return sympify(text, {name: Rational(v.numerator, v.denominator) for name, v in values.items()})


@settings(max_examples=100)
@given(seed=st.integers(), junctions=st.integers(1, 4), loops=st.sampled_from([0, 0, 1]))
def test_the_formula_of_a_random_graph_holds_at_other_values(seed, junctions, loops):
    rng = random.Random(seed)
    made = types, values, bonds, inputs, output = random_graph(rng, junctions, loops)
    graph = solvable(made)
    if graph is None:
        return
    others = {name: Fraction(rng.randint(1, 99), rng.randint(1, 99)) for name in values}
    expected = transfer_at(types, others, bonds, inputs, output, S)
    if expected is None:
        return
    for (_, source), text in formulas(graph).items():
        assert evaluated(text, {**others, "s": S}) == expected[source], text


def test_the_isolator_is_written_as_in_the_paper():
    (text,) = formulas(written(*ISOLATOR, "m_s.f")).values()
    types, values, bonds = parse(*ISOLATOR)
    expected = transfer_at(types, values, bonds, ["v_in"], ("m_s", "f"), S)["v_in"]
    assert evaluated(text, {**values, "s": S}) == expected
    numerator = text.partition(")/(")[0]
    assert "b" not in numerator, "the damper to ground is not in the numerator"


SCENE = """
dynid: 1
kind: bond-graph
parameters: {{m: {m}, zeta: {zeta}, k: {k}}}
graph:
  nodes:
    u: Se
    j: 1
    mass: {{type: I, value: {mass}}}
    damper: {{type: R, value: {damper}}}
    spring: {{type: C, value: 1/k}}
  bonds: [u -> j -> mass, j -> damper, j -> spring]
analysis: {{outputs: [mass.f], results: [transfer_function]}}
"""


def symbolic(folder, m=2, zeta="1/4", k=3, mass="2*m", damper="zeta*(m + k)**2"):
    scene = folder / "scene.yaml"
    scene.write_text(SCENE.format(m=m, zeta=zeta, k=k, mass=mass, damper=damper), encoding="utf-8")
    result = dynid.run(scene)
    return result.group_attrs["bond_graph/transfer_function/mass.f/u"].get("symbolic")


def test_a_scene_is_written_in_its_parameters(tmp_path):
    text = symbolic(tmp_path)
    values = {"m": Fraction(5), "zeta": Fraction(2, 3), "k": Fraction(7), "s": S}
    mass, damper, k = 2 * values["m"], values["zeta"] * (values["m"] + values["k"]) ** 2, values["k"]
    assert evaluated(text, values) == S / (mass * S**2 + damper * S + k)


def test_the_text_does_not_depend_on_the_parameters_values(tmp_path):
    assert symbolic(tmp_path) == symbolic(tmp_path, m=7, zeta="3", k="1/9")


@pytest.mark.parametrize("damper", ["sqrt(m*k)", "m**0.5", "m**20"])
def test_what_is_no_short_rational_function_has_no_formula(tmp_path, damper):
    assert symbolic(tmp_path, damper=damper) is None


def test_a_number_is_written_by_the_name_of_its_element(tmp_path):
    text = symbolic(tmp_path, mass="7", damper="zeta")
    values = {"mass": Fraction(3), "zeta": Fraction(5), "k": Fraction(2), "s": S}
    assert evaluated(text, values) == S / (3 * S**2 + 5 * S + 2)


@pytest.mark.parametrize("name", ["s", "m-1"])
def test_a_name_that_would_be_misread_leaves_no_formula(name):
    graph = written(f"Se u, 1 j, I {name} 3, R r 1", f"u -> j -> {name}, j -> r", "r.e")
    assert formulas(graph) == {}
    with pytest.raises(UsageError, match=f"^formulas cannot be written in the name '{name}': it "):
        nested(graph, graph.channels().values())


@pytest.mark.parametrize("names", ["Träger Dämpfung", "Ω φ", "質量 減衰"])
def test_names_may_be_of_any_alphabet(names):
    m, r = names.split()
    graph = written(f"Se u, 1 j, I {m} 3, R {r} 2", f"u -> j -> {m}, j -> {r}", f"{r}.e")
    (text,) = formulas(graph).values()
    assert evaluated(text, {"s": S, m: Fraction(3), r: Fraction(2)}) == 2 / (3 * S + 2)


def test_a_name_of_a_source_or_junction_does_no_harm():
    (text,) = formulas(written("Se s, 1 m-1, I m 3, R r 1", "s -> m-1 -> m, m-1 -> r", "r.e")).values()
    assert evaluated(text, {"s": S, "m": Fraction(3), "r": Fraction(1)}) == 1 / (3 * S + 1)


def test_what_outgrows_a_page_is_left_out():
    stages = 12
    nodes = "Se u" + "".join(f", 1 a{k}, R r{k} 1, I m{k} 1, 0 b{k}, C c{k} 1" for k in range(stages))
    bonds = "u -> a0" + "".join(f", a{k} -> r{k}, a{k} -> m{k}, a{k} -> b{k} -> c{k}" for k in range(stages))
    bonds += "".join(f", b{k} -> a{k + 1}" for k in range(stages - 1))
    assert formulas(written(nodes, bonds, "u.f")) == {}


def test_a_channel_that_vanishes_reads_zero():
    found = formulas(written("Se u, Se w, 0 j, R r 2, R q 3", "u -> j -> r, w -> q", "r.f"))
    texts = {source: text for (_, source), text in found.items()}
    assert texts == {"u": "1/r", "w": "0"}


@pytest.mark.parametrize("name", ["I", "E", "pi", "S", "N", "Q", "lambda", "gamma", "beta", "zeta"])
def test_names_that_mean_something_elsewhere_are_just_names(name):
    """The text is arithmetic on the scene's names; a reader's SymPy must be told that they are symbols."""
    (text,) = formulas(written(f"Se u, R {name} 2", f"u -> {name}", f"{name}.f")).values()
    assert text == f"1/{name}"


def test_formulas_compute_as_rational_functions_do():
    named, one = variables(["a", "b"], 1000)
    a, b = named["a"], named["b"]

    def said(operation, *operands):
        return sympify(quotient(*apply(operation, list(operands)).lowest_terms())[0])

    assert said("-", a, b) == sympify("a - b")
    assert said("pos", a) == sympify("a")
    assert said("neg", a) == sympify("-a")
    assert said("/", one, a - b) == sympify("1/(a - b)")
    assert said("/", a - a, b) == 0
    with pytest.raises(ZeroDivisionError, match="a pivot is zero"):
        apply("/", [a, b - b])
    with pytest.raises(KeyError):
        apply("**", [a, b])


def test_a_quotient_has_its_sign_in_front():
    from flint import fmpz_mpoly_ctx

    ring = fmpz_mpoly_ctx.get(["a", "b"], "lex")
    a, b = ring.gens()
    assert sympify(quotient(a + b, -a)[0]) == sympify("-(a + b)/a")
    assert quotient(a + b, -a)[0].startswith("-")


def test_a_factor_that_numerator_and_denominator_share_is_not_written():
    graph = written(
        "Se u, 1 a, 0 b, GY g 33/10, TF n 5/7, I m 25, R r 1",
        "u -> a -> m, b -> a -> g -> n -> b -> r",
        "r.f",
    )
    ((above, below),) = readable(graph).values()
    assert above.gcd(below) == 1
    assert (len(above), len(below)) == (1, 2)  # n g/(s n^2 m r + g^2)


@settings(max_examples=100)
@given(seed=st.integers(), junctions=st.integers(1, 5), loops=st.sampled_from([0, 1, 2]))
def test_the_assignments_of_a_nested_formula_end_in_the_transfer_function(seed, junctions, loops):
    rng = random.Random(seed)
    made = types, values, bonds, inputs, output = random_graph(rng, junctions, loops)
    graph = solvable(made)
    if graph is None:
        return
    expected = transfer_at(types, values, bonds, inputs, output, S)
    if expected is None:
        return
    for (_, source), register in graph.channels().items():
        known = {name: Rational(v.numerator, v.denominator) for name, v in {**values, "s": S}.items()}
        for line in nested(graph, [register]).split("\n"):
            name, _, text = line.partition(" = ")
            known[name] = sympify(text, known)
        assert (name, known[name]) == ("T", expected[source])
