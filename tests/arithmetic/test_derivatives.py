"""Derivatives of expressions: exact where the expressions are, else as differences say."""

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynid.arithmetic.dependent import Dependent, differentiate, independent_parameters, substituted
from dynid.arithmetic.expression import ExpressionError, parse


def slopes(text, **parameters):
    return dict(differentiate(parse(text), independent_parameters(parameters)).slopes)


def test_a_rational_expression_has_an_exact_derivative():
    found = slopes("A**2 * I / (m - 1)", A=Fraction(1, 100), I=20000, m=11)
    assert found == {"A": Fraction(2 * 20000, 1000), "I": Fraction(1, 10**5), "m": Fraction(-2, 100)}


def test_parameters_of_parameters_are_followed_to_the_numbers():
    assert slopes("2*m_e", m_e="A**2 * I", A=3, I=5) == {"A": 2 * 2 * 3 * 5, "I": 2 * 9}


def test_constants_have_no_derivative():
    assert slopes("2*pi + 3**2") == {}


def test_a_derivative_that_does_not_exist_is_refused_with_its_place():
    with pytest.raises(ExpressionError, match="division by zero"):
        slopes("sqrt(x)", x=0)


@pytest.mark.parametrize(
    "text",
    [
        "sqrt(x)", "exp(x)", "log(x)", "sin(x)", "cos(x)", "tan(x)", "abs(-x)", "min(x, 9)", "max(x, y)",
        "x**y", "x**-2", "2**x", "x/y - y/x", "-(+x)*y", "x**0.5",
    ],
)  # fmt: skip
@given(x=st.floats(0.3, 1.2), y=st.floats(1.3, 3.0))
def test_every_operation_agrees_with_differences(text, x, y):
    step = 1e-6
    found = slopes(text, x=x, y=y)
    functions = {name: getattr(math, name) for name in ("sqrt", "exp", "log", "sin", "cos", "tan")}

    def at(x, y):
        return eval(text, {**functions, "abs": abs, "min": min, "max": max}, {"x": x, "y": y})

    by_x = (at(x + step, y) - at(x - step, y)) / (2 * step)
    by_y = (at(x, y + step) - at(x, y - step)) / (2 * step)
    # central differences in doubles are good to about 1e-9
    assert float(found.get("x", 0)) == pytest.approx(by_x, rel=1e-7, abs=1e-7)
    assert float(found.get("y", 0)) == pytest.approx(by_y, rel=1e-7, abs=1e-7)


@given(st.floats(0.1, 10), st.floats(0.1, 10))
def test_a_dependent_number_has_the_slopes_of_its_expression_at_the_reference(x, y):
    known = {"x": Dependent.parameter("x", Fraction(x)), "y": Dependent.parameter("y", Fraction(y))}
    value, slopes = substituted(parse("x**2 * exp(y) / (1 + x)"), known).at({})
    assert value == pytest.approx(x**2 * math.exp(y) / (1 + x), rel=1e-14)
    assert slopes["x"] == pytest.approx((x**2 + 2 * x) / (1 + x) ** 2 * math.exp(y), rel=1e-13)
    assert slopes["y"] == pytest.approx(value, rel=1e-14)


def test_expressions_of_equal_texts_are_equal():
    assert parse("2*x") == parse("2*x")
    assert hash(parse("2*x")) == hash(parse("2*x"))
    assert parse("2*x") != parse("x*2")
