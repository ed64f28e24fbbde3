"""Numbers that depend on parameters: values, derivatives, and multiples of the same expression."""

import cmath

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynid.arithmetic.dependent import Dependent, like_terms, sqrt

X, Y = Dependent.parameter("x", 2.0), Dependent.parameter("y", 3.0)
positive = st.floats(0.1, 10.0)
numbers = st.recursive(
    st.sampled_from([X, Y]) | positive,
    lambda inner: st.tuples(st.sampled_from("+*/"), inner, inner).map(
        lambda one: {"+": lambda a, b: a + b, "*": lambda a, b: a * b, "/": lambda a, b: a / b}[one[0]](
            *one[1:]
        )
    ),
    max_leaves=8,
)


@given(numbers, positive, positive)
def test_a_multiple_is_the_number(number, x, y):
    if not isinstance(number, Dependent):
        return
    (found,) = like_terms([number])
    one, other = number.at({"x": x, "y": y}), found.core.at({"x": x, "y": y})
    assert found.factor * other.value == pytest.approx(one.value, rel=1e-12)
    for name in ("x", "y"):
        slope = found.factor * other.slopes.get(name, 0.0)
        assert slope == pytest.approx(one.slopes.get(name, 0.0), rel=1e-11, abs=1e-12 * abs(one.value))


def test_multiples_of_one_expression_have_one_core():
    found = like_terms([X / 8.0, 3 * X, -X * Y, Y * X, (2 * X) ** 3, X**3 / 5, 2.0 / X, 1 / (4 * X), X + Y])
    cores = [id(one.core) for one in found]
    assert cores[0] == cores[1]
    assert cores[2] != cores[3]  # the order of a product is that of its expression
    assert cores[4] == cores[5]
    assert cores[6] == cores[7]
    assert [one.factor for one in found] == [1 / 8, 3, -1, 1, 8, 1 / 5, 2, 1 / 4, 1]


def test_a_multiple_beyond_double_precision_stays_whole():
    tiny = 1e-200 * Dependent.parameter("z", 1e200)
    (found,) = like_terms([tiny**2])
    assert found.factor * float(found.core) == pytest.approx(1.0)
    assert like_terms([0 * X])[0].factor == 1.0


def test_absent_parameters_have_their_reference_values():
    assert (X * Y).at({"y": 5.0}) == (10.0, {"x": 5.0, "y": 2.0})


def test_lengths():
    found = sqrt(X**2 + 1.5**2)
    assert found.at({"x": 2.0}).value == pytest.approx(2.5)
    exact = cmath.sqrt((2.0 + 1e-30j) ** 2 + 1.5**2).imag / 1e-30
    assert found.at({"x": 2.0}).slopes["x"] == pytest.approx(exact, rel=1e-15)
    assert sqrt(X * X).at({"x": 7.0}) == (7.0, {"x": 1.0})
