"""Sensitivities against differences of exact transfer functions, and against formulas by hand."""

import math
import random
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis, SensitivityParameter
from dynid.bondgraph.reduced_graph import characteristic_polynomials
from dynid.bondgraph.results.sensitivities import sensitivity
from dynid.errors import NumericalError, Singular
from dynid.lti.certified_roots import certified_roots, repeated
from tests.bondgraph.graphs import ISOLATOR, build, parse, port, reduced, transfers, written
from tests.bondgraph.random_graphs import random_graph

STEP = Fraction(1, 10**30)


def rates_of(graph, parameters=None):
    """Return {channel: (transfer function, sensitivity)} for the values of all nodes."""
    chosen = parameters or [
        SensitivityParameter(n, graph.graph.value(n), {n: Fraction(1)}) for n in graph.valued
    ]
    exact = transfers(graph)
    natural = characteristic_polynomials(graph)
    found = {}
    for (output, source), register in graph.channels().items():
        transfer = exact[str(output), source]
        hidden = repeated(certified_roots(natural[output]))
        rates = sensitivity(graph, register, transfer.zeros, transfer.poles, hidden, chosen)
        found[str(output), source] = (transfer, rates)
    return found


def by_differences(types, values, bonds, inputs, output, name):
    """Return dN/dp and dD/dp by central differences of exact polynomials, D monic; None if degrees change."""

    def polynomials(value):
        graph = reduced(types, {**values, name: value}, bonds, inputs, output)
        found = {}
        for (_, source), transfer in transfers(graph).items():
            lead = int(transfer.denominator.leading_coefficient())
            found[source] = [
                [Fraction(int(c), lead) for c in part.coeffs()]
                for part in (transfer.numerator, transfer.denominator)
            ]
        return found

    above, below = (polynomials(values[name] * (1 + sign * STEP)) for sign in (1, -1))
    width = 2 * STEP * values[name]
    return {
        source: [
            [(a - b) / width for a, b in zip(high, low, strict=True)] if len(high) == len(low) else None
            for high, low in zip(above[source], below[source], strict=True)
        ]
        for source in above
    }


def evaluate(coefficients, s):
    """Evaluate an ascending polynomial exactly at a double."""
    real, imag = Fraction(s.real), Fraction(s.imag)
    total = (Fraction(0), Fraction(0))
    for c in reversed(coefficients):
        total = (total[0] * real - total[1] * imag + c, total[0] * imag + total[1] * real)
    return complex(total[0], total[1])


def check_roots(rates, roots, polynomial, slope, column):
    lead = int(polynomial.leading_coefficient())
    derivative = [int(c) for c in polynomial.derivative().coeffs()]
    simple = [root for root in roots if root.multiplicity == 1]
    for root in simple:
        place = [r.value for r in roots for _ in range(r.multiplicity)].index(root.value)
        expected = -evaluate(slope, root.value) / evaluate(derivative, root.value) * lead
        got = rates[place, column]
        assert got == pytest.approx(expected, rel=1e-8, abs=1e-9 * (1 + abs(root.value)))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**9))
def test_roots_move_as_differences_of_exact_polynomials_say(seed):
    rng = random.Random(seed)
    types, values, bonds, inputs, output = random_graph(rng, rng.randint(1, 4), rng.randint(0, 1))
    output = ".".join(output)
    try:
        graph = reduced(types, values, bonds, inputs, output)
        found = rates_of(graph)
    except Singular:
        return
    for column, name in enumerate(graph.valued):
        try:
            slopes = by_differences(types, values, bonds, inputs, output, name)
        except Singular:
            continue
        for source, (numerator, denominator) in slopes.items():
            transfer, rates = found[output, source]
            steady = numerator is not None and denominator is not None
            if transfer.vanishes or not steady or len(denominator) != len(transfer.denominator.coeffs()):
                continue  # the degree itself changes with this parameter: a root comes from infinity
            check_roots(rates.poles, transfer.poles, transfer.denominator, denominator, column)
            # the numerator is normed by the denominator's lead
            if len(numerator) == transfer.numerator.length():
                lead = Fraction(int(transfer.numerator.leading_coefficient()))
                scale = lead / int(transfer.denominator.leading_coefficient())
                normed = [c / scale for c in numerator]
                top = normed[-1]
                own = [Fraction(int(c)) / lead for c in transfer.numerator.coeffs()]
                monic = [n - top * o for n, o in zip(normed, own, strict=True)]
                check_roots(rates.zeros, transfer.zeros, transfer.numerator, monic, column)


def test_the_isolator_moves_as_its_equations_say():
    graph = written(*ISOLATOR, "m_s.f")
    ((transfer, rates),) = rates_of(graph).values()
    m, A, I_f, C = (float(graph.graph.value(n)) for n in ("m_s", "tuning", "I_f", "C_a"))
    names = graph.valued
    omega = 1 / math.sqrt(I_f * C)  # eq 20: the zeros are at ± j / sqrt(I_f C_a), whatever the rest
    upper = [root.value.imag > 0 for root in transfer.zeros].index(True)
    expected = {"m_s": 0, "b": 0, "tuning": 0, "I_f": -omega / (2 * I_f), "C_a": -omega / (2 * C)}
    for name, rate in expected.items():
        assert rates.zeros[upper, names.index(name)] == pytest.approx(1j * rate, rel=1e-12)
    mass = m + A**2 * I_f  # T(inf) = A_p^2 I_f / mass
    slopes = {
        "m_s": -(A**2) * I_f / mass**2,
        "b": 0,
        "tuning": 2 * A * I_f * m / mass**2,
        "I_f": A**2 * m / mass**2,
    }
    for name, rate in slopes.items():
        assert rates.high_frequency_gain[names.index(name)] == pytest.approx(rate, rel=1e-12)
    assert not rates.dc_gain.any()


def test_a_parameter_behind_several_nodes_counts_through_all_of_them():
    graph = written("Se u, 1 j, I m 2, R b 6", "u -> j, j -> m, j -> b", "m.f")  # pole -b/m
    both = SensitivityParameter(
        "p", Fraction(2), {"m": Fraction(1), "b": Fraction(3)}
    )  # m = p, b = 3 p: the pole stays
    ((_, rates),) = rates_of(graph, [both]).values()
    assert rates.poles[0, 0] == 0
    assert rates.dc_gain[0] == pytest.approx(-3 / 36, rel=1e-12)  # T(0) = 1/b


def test_a_double_pole_that_parts_has_no_rate():
    graph = written("Se u, 1 j, I m 1, R b 2, C k 1", "u -> j, j -> m, j -> b, j -> k", "m.f")  # (s + 1)^2
    ((transfer, rates),) = rates_of(graph).values()
    assert [(root.value, root.multiplicity) for root in transfer.poles] == [(-1, 2)]
    assert np.isinf(rates.poles).all()


def test_an_infinite_gain_that_moves_has_no_rate_and_one_that_stays_has_none_to_tell():
    graph = written("Se u, 1 j, I m 2", "u -> j, j -> m", "m.f")  # 1/(s m)
    ((_, rates),) = rates_of(graph).values()
    assert np.isinf(rates.dc_gain[0])
    assert rates.high_frequency_gain[0] == 0
    assert rates.poles[0, 0] == 0


def test_a_stiff_graph_is_as_accurate_as_a_mild_one():
    nodes = "Se u, 1 a, I m 1/1000000000000, R r 1000000, 0 j, C c 1/1000000000, 1 b, R q 1/1000, I l 1000"
    bonds = "u -> a, a -> m, a -> r, a -> j, j -> c, j -> b, b -> q, b -> l"
    types, values, pairs = parse(nodes, bonds)
    graph = reduced(types, values, pairs, ["u"], "l.f")
    ((transfer, rates),) = rates_of(graph).values()
    for column, name in enumerate(graph.valued):
        ((_, denominator),) = by_differences(types, values, pairs, ["u"], "l.f", name).values()
        derivative = [int(c) for c in transfer.denominator.derivative().coeffs()]
        lead = int(transfer.denominator.leading_coefficient())
        for place, root in enumerate(transfer.poles):
            expected = -evaluate(denominator, root.value) / evaluate(derivative, root.value) * lead
            size = abs(root.value) / float(values[name])
            assert abs(rates.poles[place, column] - expected) < 1e-9 * size


def test_the_result_names_parameters_and_roots():
    types, values, pairs = parse(*ISOLATOR)
    question = Analysis(("v_in",), (port("m_s.f"),), frozenset({"sensitivities"}))
    result = analyse(build(types, values, pairs), question)
    group = "bond_graph/sensitivities/m_s.f/v_in"
    assert list(result[f"{group}/parameter"].data) == ["m_s", "b", "tuning", "I_f", "C_a"]
    per_unit, relative = (result[f"{group}/pole_sensitivity{end}"].data for end in ("", "_relative"))
    assert relative == pytest.approx(per_unit * result[f"{group}/value"].data)
    # scaling every impedance moves no pole: m_s, b and I_f up, C_a down by the same part
    together = relative @ np.array([1, 1, 0, 1, -1])
    assert together == pytest.approx(0, abs=1e-9)


def test_a_sensitivity_beyond_doubles_is_an_error_in_words():
    nodes = f"Se u, 1 j, I m 2, R b 3, C k 1/{10**320}"
    graph = written(nodes, "u -> j -> m, j -> b, j -> k", "m.f")
    question = Analysis(graph.inputs, graph.outputs, frozenset({"sensitivities"}))
    with pytest.raises(NumericalError):
        analyse(graph.graph, question)
