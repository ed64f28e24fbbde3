"""Values and slopes of laws, on floats and at high precision, against mpmath at 60 digits."""

from fractions import Fraction

import flint
import mpmath
import pytest

from dynid.arithmetic.expression import parse
from dynid.arithmetic.numbers import OutOfRangeError
from dynid.bondgraph.operating_point.element_laws import Gradient

X, Y = Fraction(3, 4), Fraction(-5, 8)
CONSTANTS = {"a": Fraction(7, 3), "b": Fraction(1, 5), "n": Fraction(3)}

# Laws of x and y; Python reads the same text with the functions of mpmath.
LAWS = [
    "a*x + b*y",
    "+x - -y",
    "x/y - a/x + y/b",
    "(x + b)*(y - a)*x",
    "x**3 + y**2",
    "x**a",
    "x**y",
    "a**y",
    "sqrt(x + 1)",
    "exp(x*y)",
    "log(x - y)",
    "sin(a*x) + cos(b*y)",
    "cos(x)*sin(y)",
    "tan(x/2)*y",
    "x*abs(y) + y*abs(x)",
    "min(x, y, a)",
    "max(x**2, y, b)",
    "pi*x + sin(pi*y)",
    "sqrt(a)*x + exp(b)*log(a)*y",
    "x*sin(a) + y*cos(a) + tan(b)",
    "a**b*x",
    "sin(2)",
    "x*(a*b + 2) + y/(1 - a)",
    "y",
]
FUNCTIONS = {
    **{name: getattr(mpmath, name) for name in ("sqrt", "exp", "log", "sin", "cos", "tan", "pi")},
    **{"abs": abs, "min": min, "max": max},
}


def slopes(text, x, y, *, high, side=1.0):
    gradient = Gradient(parse(text), CONSTANTS, ("x", "y"), high)
    return gradient([flint.arb(one) for one in (x, y)] if high else (x, y), side)


def number(value):
    """Return a number of flint for mpmath, with all digits."""
    return mpmath.mpf(value.mid().str(60, radius=False)) if isinstance(value, flint.arb) else value


@pytest.mark.parametrize("text", LAWS)
@pytest.mark.parametrize(("high", "accuracy"), [(False, 2e-14), (True, 1e-45)])
def test_the_value_and_the_slopes_of_a_law_are_those_of_mpmath(text, high, accuracy):
    def law(x, y):
        a, b = (mpmath.mpf(CONSTANTS[name].numerator) / CONSTANTS[name].denominator for name in "ab")
        return mpmath.mpf(eval(text, FUNCTIONS | {"x": x, "y": y, "a": a, "b": b}))

    with mpmath.workdps(60), flint.ctx.workdps(60):
        point = (mpmath.mpf(float(X)), mpmath.mpf(float(Y)))
        expected = [law(*point)]
        with mpmath.workdps(120):
            expected += [mpmath.diff(law, point, order) for order in ((1, 0), (0, 1))]
        value, found = slopes(text, float(X), float(Y), high=high)
        for one, wanted in zip((value, *found), expected, strict=True):
            assert abs(number(one) - wanted) <= accuracy * max(1, abs(wanted)), (one, wanted)


@pytest.mark.parametrize("high", [False, True])
@pytest.mark.parametrize(
    ("text", "above", "below"),
    [
        ("abs(x - 1)", (1, 0), (-1, 0)),
        ("min(x, 2*y)", (1, 0), (0, 2)),
        ("max(3*x, 6*y)", (3, 0), (0, 6)),
        ("3*x + y", (3, 1), (3, 1)),
    ],
)
def test_slopes_of_a_kink_differ_by_side(text, above, below, high):
    for side, wanted in ((1.0, above), (-1.0, below)):
        _, found = slopes(text, 1.0, 0.5, high=high, side=side)
        assert tuple(map(float, found)) == wanted


@pytest.mark.parametrize("high", [False, True])
@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("1/x", "value"),
        ("log(x)", "value"),
        ("sqrt(x - 1)", "value"),
        ("(x - 1)**0.5", "value"),
        ("y/x", "value"),
        ("sqrt(x)", "slope"),
        ("x**0.5", "slope"),
    ],
)
def test_a_law_without_a_finite_value_or_slope_says_which(text, part, high):
    with pytest.raises(OutOfRangeError, match=f"the law has no finite {part} there"):
        slopes(text, 0.0, 0.5, high=high)


@pytest.mark.parametrize("text", ["exp(x)", "x**n", "x*x", "exp(x)*x**2"])
def test_a_value_beyond_the_largest_float_has_one_at_high_precision(text):
    with pytest.raises(OutOfRangeError, match="no finite value"):
        slopes(text, 1e200, 0.0, high=False)
    value, _ = slopes(text.replace("exp(x)", "exp(1000 + 0*x)"), 1e200, 0.0, high=True)
    assert value.is_finite()
