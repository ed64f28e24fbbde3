"""Synthesis of driving-point functions: random networks and sums, analysed back exactly and by a tableau."""

import random
from fractions import Fraction

import pytest
from flint import fmpq, fmpq_poly

from dynid.bondgraph.synthesis import forms
from dynid.bondgraph.synthesis.forms import FORMS, Driving, kind_of, realisations, realise
from dynid.bondgraph.synthesis.one_port import bond_graph
from dynid.bondgraph.synthesis.realisations import NoSuchForm, brune, cauer
from dynid.errors import NumericalError
from dynid.lti.positive_real import find_violation, lowest_terms
from tests.bondgraph.tableau import transfer_at
from tests.lti.test_positive_real import from_even_part, poly
from tests.sample import sample

S = fmpq_poly([0, 1])
ONE = fmpq_poly([1])
EVERY = {"LC": "IC", "RC": "RC", "RL": "RI", "RLC": "RIC"}


def rational(value):
    return fmpq(value.numerator, value.denominator)


def element(kind, value):
    """Return the impedance of an element as numerator and denominator."""
    v = rational(value)
    return {"R": (v * ONE, ONE), "I": (v * S, ONE), "C": (ONE, v * S)}[kind]


def in_series(a, b):
    return a[0] * b[1] + b[0] * a[1], a[1] * b[1]


def in_parallel(a, b):
    return a[0] * b[0], a[0] * b[1] + b[0] * a[1]


def value_of(rng):
    return Fraction(rng.randint(1, 99), rng.choice([1, 2, 5, 10, 100]))


def network(rng, kinds, depth):
    """Return the impedance of a random network of elements in series and parallel."""
    if depth == 0 or rng.random() < 0.1:
        return element(rng.choice(kinds), value_of(rng))
    join = rng.choice([in_series, in_parallel])
    return join(network(rng, kinds, depth - 1), network(rng, kinds, depth - 1))


def partial_fractions(rng, kinds, count):
    """Return a sum of impedances of two elements in parallel."""
    total = element(kinds[0], value_of(rng))
    for _ in range(count):
        total = in_series(total, in_parallel(*(element(rng.choice(kinds), value_of(rng)) for _ in range(2))))
    return total


def random_impedance(seed):
    """Return N and D of a random positive real function, and the letters of its elements."""
    rng = random.Random(seed)
    letters = list(EVERY.values())[seed % 4]
    if seed % 3:
        made = network(rng, letters, rng.choice([2, 3, 4]))
    else:
        made = partial_fractions(rng, letters, rng.randint(1, 5))
    return *lowest_terms(*made), letters


def from_tableau(one, s, output="e"):
    """Return the driving-point function of a realisation at a rational s, by a tableau of all equations."""
    nodes = one.graph.nodes
    types = {name: node.type for name, node in nodes.items()}
    values = {name: node.value for name, node in nodes.items() if node.value is not None}
    bonds = [tuple(bond) for bond in one.graph.bonds]
    return transfer_at(types, values, bonds, ["source"], ("source", output), s)["source"]


def quotient(numerator, denominator, s):
    value = numerator(rational(s)) / denominator(rational(s))
    return Fraction(int(value.p), int(value.q))


@pytest.mark.parametrize("seed", sample(range(100), 40))
def test_a_random_positive_real_impedance_is_synthesised_and_analysed_back(seed):
    numerator, denominator, letters = random_impedance(seed)
    assert find_violation(numerator, denominator) is None
    found, missing = realisations(Driving(numerator, denominator))
    names = {one.form for one in found}
    assert names | set(missing) == set(FORMS)
    assert "brune" in names
    if letters != "RIC":
        assert not missing
    s = Fraction(7, 3)
    wanted = quotient(numerator, denominator, s)
    for one in found:
        assert all(node.value > 0 for node in one.graph.nodes.values() if node.value is not None)
        assert one.residual <= (0 if one.form.startswith("cauer") else 1e-12)
        value = from_tableau(one, s)
        assert (
            value == wanted if one.residual == 0 else float(value) == pytest.approx(float(wanted), rel=1e-12)
        )
        elements = [node.type for node in one.graph.nodes.values() if node.type in "ICR"]
        assert set(elements) <= set(letters)
        if letters != "RIC":  # these forms are minimal
            degree = max(numerator.degree(), denominator.degree())
            assert len(elements) - elements.count("R") == degree


@pytest.mark.parametrize("seed", range(0, 100, 9))
def test_an_admittance_is_driven_by_an_effort_source(seed):
    denominator, numerator, _ = random_impedance(seed)
    wanted = Driving(*lowest_terms(numerator, denominator), admittance=True)
    for one in realisations(wanted)[0]:
        value = from_tableau(one, Fraction(5, 4), "f")
        assert one.graph.nodes["source"].type == "Se"
        expected = quotient(numerator, denominator, Fraction(5, 4))
        assert float(value) == pytest.approx(float(expected), rel=1e-12)


@pytest.mark.parametrize(
    ("numerator", "denominator", "kind"),
    [
        ([3], [1], "R"),
        ([2, 0], [1], "LC"),
        ([1, 0, 1], [1, 0], "LC"),
        ([1, 2], [1, 1], "RC"),
        ([1, 1], [1, 0], "RC"),
        ([1, 1], [1, 2], "RL"),
        ([1, 1], [1], "RL"),
        ([1, 1, 1], [1, 1, 4], "RLC"),
    ],
)
def test_the_elements_that_an_impedance_needs(numerator, denominator, kind):
    assert kind_of(*lowest_terms(poly(*numerator), poly(*denominator))) == kind


def test_cauer_forms_of_a_textbook_reactance():
    """Z = (s^4 + 10 s² + 9)/(s³ + 4 s) = s + 1/(s/6 + 1/(12/5 s + …)) by hand."""
    wanted = Driving(poly(1, 0, 10, 0, 9), poly(1, 0, 4, 0))
    first = realise(wanted, "cauer").graph.nodes
    assert [(n.name, n.value) for n in first.values() if n.value] == [
        ("I1", 1),
        ("C1", Fraction(1, 6)),
        ("I2", Fraction(12, 5)),
        ("C2", Fraction(5, 18)),
    ]
    second = realise(wanted, "cauer-2").graph.nodes  # 9/(4 s) + 1/(…)
    assert second["C1"].value == Fraction(4, 9)


def test_foster_forms_of_a_textbook_reactance():
    """(s^4 + 10 s² + 9)/(s³ + 4 s) = s + 9/(4 s) + (15/4) s/(s² + 4)."""
    one = realise(Driving(poly(1, 0, 10, 0, 9), poly(1, 0, 4, 0)), "foster")
    values = {n.name: n.value for n in one.graph.nodes.values() if n.value}
    assert values == {"I1": 1, "C1": Fraction(4, 9), "I2": Fraction(15, 16), "C2": Fraction(4, 15)}


def test_brunes_section_of_a_minimum_function_by_hand():
    """(s² + s + 1)/(s² + s + 4): ω1² = 2, Z = -j ω1/2 there, so 1/L1 + 1/L2 + 1/L3 = 0 with L2 C = 1/2."""
    one = realise(Driving(poly(1, 1, 1), poly(1, 1, 4)), "brune")
    nodes = one.graph.nodes
    inertia, capacity, n = (nodes[name].value for name in ("I1", "C1", "TF1"))
    # a capacitor in the common branch of perfectly coupled coils I, I/n², M = I/n; a load R behind
    first, common = inertia - inertia / n, inertia / n
    third = inertia / n**2 - inertia / n
    assert 1 / first + 1 / common + 1 / third == 0
    assert common * capacity == Fraction(1, 2)  # resonance at ω1² = 2
    assert nodes["R1"].value == Fraction(1, 4)
    assert one.residual == 0


EVEN_PARTS = {
    "a rational double zero": poly(1, 2) ** 2 * poly(1, 3) ** 2,
    "conjugate irrational double zeros": poly(1, 6, 7) ** 2,
    "a quadruple zero": poly(1, 2) ** 4,
    "zeros at 0 and at a frequency": poly(1, 2) ** 2 * poly(1, 0) ** 2,
    "almost a double zero": poly(1, 6, 7) ** 2 + poly("1e-12"),
    "a zero and a minimum": poly(1, "5/2") ** 2 * poly(1, -3, 7),
}


@pytest.mark.parametrize("name", EVEN_PARTS)
def test_brune_realises_functions_whose_real_part_touches_zero(name):
    numerator, denominator = lowest_terms(*from_even_part(EVEN_PARTS[name]))
    one = realise(Driving(numerator, denominator), "brune")
    assert one.residual <= 1e-13
    assert any(node.type == "TF" for node in one.graph.nodes.values())
    assert all(node.value > 0 for node in one.graph.nodes.values() if node.value is not None)
    wanted = quotient(numerator, denominator, Fraction(3, 2))
    assert float(from_tableau(one, Fraction(3, 2))) == pytest.approx(float(wanted), rel=1e-12)


def test_rounded_coefficients_have_their_poles_and_zeros_near_the_axis_removed():
    """After an irrational section nothing is exact: poles within the precision of the axis are on it."""
    numerator, denominator = lowest_terms(
        *in_series(
            in_parallel(element("I", Fraction(2)), element("C", Fraction(1, 3))), (poly(1, 2), poly(1, 5))
        )
    )
    nudge = fmpq(1, 1 << 400)
    port = brune(numerator, denominator + nudge * poly(1, 0), 512, exact=False)
    graph = bond_graph(port)
    kinds = sorted(node.type for node in graph.nodes.values() if node.type in "RIC")
    assert kinds == ["C", "I", "I", "R", "R"]
    tank = sorted(float(n.value) for n in graph.nodes.values() if n.type in "IC")
    assert any(value == pytest.approx(1 / 3, rel=1e-60) for value in tank)


def test_values_have_more_digits_where_doubles_do_not_give_the_coefficients(monkeypatch):
    wanted = Driving(*lowest_terms(*from_even_part(EVEN_PARTS["conjugate irrational double zeros"])))
    irrational = realise(wanted, "brune")
    assert 0 < irrational.residual <= forms.TOLERANCE
    assert all(n.value == Fraction(repr(float(n.value))) for n in irrational.graph.nodes.values() if n.value)
    monkeypatch.setattr(forms, "TOLERANCE", 1e-20)
    assert realise(wanted, "brune").residual < 1e-20
    monkeypatch.setattr(forms, "TOLERANCE", -1.0)
    with pytest.raises(NumericalError, match="has the coefficients of the function only to"):
        realise(wanted, "brune")


def test_values_of_more_bits_than_a_scene_holds_are_rounded(monkeypatch):
    monkeypatch.setattr(forms, "_EXACT_PRECISIONS", ((40, 30),))
    one = realise(Driving(*random_impedance(1)[:2]), "cauer")
    assert 0 < one.residual < 1e-25


@pytest.mark.parametrize("form", FORMS)
def test_values_beyond_the_range_of_doubles_are_refused(form):
    wanted = Driving(poly("1e300", "1e300"), poly("1e-300", "2e-300"))
    assert find_violation(*wanted.impedance) is None
    with pytest.raises(NumericalError, match="is outside the range of doubles"):
        realise(wanted, form)


def test_a_form_that_does_not_exist_is_refused_with_its_reason():
    wanted = Driving(poly(1, 1, 1), poly(1, 1, 4))
    reasons = realisations(wanted)[1]
    assert reasons["cauer"] == "the continued fraction needs a negative element"
    assert reasons["foster"] == "the poles -0.5 ± 1.936j of Z are neither real nor on the imaginary axis"
    assert reasons["foster-2"] == "the poles -0.5 ± 0.866j of Y are neither real nor on the imaginary axis"
    with pytest.raises(NoSuchForm, match="no cauer form: the continued fraction") as caught:
        realisations(wanted, ("brune", "cauer"))
    assert caught.value.names == ("forms",)


@pytest.mark.parametrize(
    ("numerator", "denominator", "reason"),
    [
        ([1, 4, 4], [1, 2, 1], "the pole -1 of Z has multiplicity 2"),
        ([8, 9, 2], [2, 9, 8], "the partial fractions of Z have the negative constant -0.330673"),
    ],
)
def test_what_partial_fractions_cannot_realise(numerator, denominator, reason):
    wanted = Driving(*lowest_terms(poly(*numerator), poly(*denominator)))
    assert realisations(wanted)[1]["foster"] == reason


def test_a_ladder_of_three_kinds_of_elements_has_a_cauer_form():
    """R + s L in series before C parallel to G, twice: a lossy line."""
    line = element("R", Fraction(3))
    for k in range(1, 4):
        line = in_parallel(in_parallel(element("C", Fraction(1, k)), element("R", Fraction(9 * k))), line)
        line = in_series(in_series(element("I", Fraction(k, 2)), element("R", Fraction(k))), line)
    port = cauer(*lowest_terms(*line))
    values = [node.value for node in bond_graph(port).nodes.values() if node.type == "I"]
    assert values == [Fraction(3, 2), 1, Fraction(1, 2)]
