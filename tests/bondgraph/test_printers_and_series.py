"""Printed values and truncated series, against Python's arithmetic and polynomials of flint."""

import random
from fractions import Fraction

import pytest
from flint import nmod, nmod_poly

from dynid.arithmetic.expression import parse
from dynid.bondgraph.floating.series import LaurentSeries
from dynid.bondgraph.formula_printers import ONE, TEXT
from dynid.bondgraph.graph import Node

VALUES = {"a": Fraction(3), "b": Fraction(5, 7), "c": Fraction(-2), "s_value": Fraction(11)}


@pytest.mark.parametrize(
    "text",
    [
        "+a",
        "+a*+b",
        "a + -b",
        "a - -b",
        "a + -b*c",
        "-a - -b*-c",
        "-(a + b)",
        "-(a - b)/c",
        "a/(-b)",
        "(a/b)/(c/a)",
        "a*(b + c)*s",
        "(a + b)**2 - (a - -c)**3",
        "2*a + (-b) - (-c)",
        "a/b/c + a*b/c",
    ],
)
def test_a_printed_value_is_the_value(text):
    printed, _ = TEXT.whole(TEXT.value(Node("n", "R", Fraction(1), parse(text))))
    wanted = eval(text, {**VALUES, "s": VALUES["s_value"]})
    assert eval(printed.replace("^", "**"), dict(VALUES)) == wanted
    assert "--" not in printed.replace(" ", "")


@pytest.mark.parametrize(
    ("coefficient", "variable", "printed"),
    [("3", "", "3"), ("1", "x", "x"), ("-1", "x", "-x"), ("-4", "x", "-4*x"), ("7", "x", "7*x")],
)
def test_a_coefficient_stands_before_its_variable(coefficient, variable, printed):
    given = TEXT.integer(int(coefficient))
    assert TEXT.scaled(given, variable)[0] == printed
    assert TEXT.scaled(ONE, variable)[0] == (variable or "1")


P = 10007


def series(rng, terms):
    start = rng.randint(-3, 3)
    coefficients = [nmod(rng.choice([0, 1, rng.randrange(P)]), P) for _ in range(terms)]
    coefficients[-1] = nmod(1, P)
    return LaurentSeries(start, coefficients, terms), nmod_poly([int(c) for c in coefficients], P), start


@pytest.mark.parametrize("seed", range(20))
def test_truncated_series_are_those_of_polynomials(seed):
    rng = random.Random(seed)
    (one, p, i), (other, q, j) = series(rng, 8), series(rng, 8)
    low, shift = min(i, j), nmod_poly([0, 1], P)
    cases = {
        "+": (one + other, p * shift ** (i - low) + q * shift ** (j - low), low),
        "-": (one - other, p * shift ** (i - low) - q * shift ** (j - low), low),
        "*": (one * other, p * q, i + j),
        "3": (one * 3, p * 3, i),
    }
    for name, (found, whole, start) in cases.items():
        for k, coefficient in enumerate(found.coefficients):
            place = found.start + k - start
            assert int(coefficient) == int(whole[place]), name
        assert all(int(whole[k]) == 0 for k in range(found.start - start)), name
    back = one * other / other
    assert back.start == one.start
    for k, coefficient in enumerate(back.coefficients):
        assert coefficient == one.coefficients[k]


def test_nothing_times_a_series_is_nothing():
    one = LaurentSeries(-2, [nmod(3, P), nmod(4, P)], 2)
    nothing = one * 0
    assert nothing.coefficients == []
    total = one + nothing
    assert (total.start, total.coefficients) == (one.start, one.coefficients)
    with pytest.raises(ArithmeticError):
        one / nothing
    gone = one - one
    assert (gone.start, gone.coefficients) == (0, [])
