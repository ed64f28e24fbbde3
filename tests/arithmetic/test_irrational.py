"""Irrational numbers: what is zero, equal or rational is so exactly; what is not, is rounded correctly."""

import copy
import math
import pickle
import random
from fractions import Fraction
from itertools import pairwise

import mpmath
import pytest

from dynid.arithmetic.expression import ExpressionError, parse
from dynid.arithmetic.numbers import Irrational, OutOfRangeError, apply, coded, field_of


def value(text, **names):
    return parse(text).evaluate({name: value(x) if isinstance(x, str) else x for name, x in names.items()})


IDENTITIES = """
sqrt(7)*sqrt(11) - sqrt(77)
sqrt(1.3e-3/4.1e-9)*sqrt(4.1e-9) - sqrt(1.3e-3)
5**0.5 - sqrt(5)
25**0.5 - 5
343**(1/3) - 7
(1/5)**(2/3)*25**(1/3) - 1
sqrt(18) - 3*sqrt(2)
sqrt(7 + 4*sqrt(3)) - 2 - sqrt(3)
sqrt(2 + sqrt(3)) - (sqrt(6) + sqrt(2))/2
sqrt(2 + sqrt(3))*sqrt(2 - sqrt(3)) - 1
sqrt(7 + 2*sqrt(10)) - sqrt(2) - sqrt(5)
(9 + 4*sqrt(5))**(1/3) - (3 + sqrt(5))/2
(17 + 12*sqrt(2))**0.25 - 1 - sqrt(2)
sqrt(sqrt(5) + 2)*sqrt(sqrt(5) - 2) - 1
cos(pi/4) - sqrt(2)/2
sin(pi/3) - sqrt(3)/2
tan(pi/6)*sqrt(3) - 1
4*sin(pi/10) - sqrt(5) + 1
8*cos(pi/7)*cos(2*pi/7)*cos(3*pi/7) - 1
cos(pi*0.12) - sin(pi*0.38)
sqrt(2 + sqrt(2 + sqrt(2))) - 2*cos(pi/16)
sqrt(1 - cos(pi/7)**2) - sin(pi/7)
sin(5*pi/14) - cos(pi/7)
tan(3*pi/8) - 1 - sqrt(2)
cos(pi/10) - sqrt(10 + 2*sqrt(5))/4
sin(3*pi/11 + pi/6) - sin(3*pi/11)*sqrt(3)/2 - cos(3*pi/11)/2
exp(log(7)) - 7
log(9) - 2*log(3)
log(10) - log(2) - log(5)
log(sqrt(3)) - log(3)/2
exp(1.5*log(3)) - 3*sqrt(3)
log(2*exp(3)) - 3 - log(2)
exp(1)*exp(1/3) - exp(4/3)
3**pi/3**(pi - 2) - 9
sqrt(3)**sqrt(3) - exp(sqrt(3)*log(3)/2)
sin(2)**2 + cos(2)**2 - 1
sin(1.5) - 2*sin(0.75)*cos(0.75)
cos(1) - 1 + 2*sin(0.5)**2
sin(1 + pi/3) - sin(1)/2 - sqrt(3)/2*cos(1)
tan(2) - sin(2)/cos(2)
sqrt(pi)**2 - pi
sqrt(pi**2 + 2*pi + 1) - pi - 1
sqrt(4*pi**2 + log(3)**2)**2 - 4*pi**2 - log(3)**2
abs(1 - sqrt(5)) - sqrt(5) + 1
min(sqrt(3), 2) - max(sqrt(3), 1)
0*sqrt(3)
sin(pi)
cos(3*pi/2)
""".strip().split("\n")


@pytest.mark.parametrize("text", IDENTITIES)
def test_an_identity_is_exactly_zero(text):
    found = value(text)
    assert type(found) is Fraction
    assert found == 0


@pytest.mark.parametrize(
    "text",
    [
        "sqrt(2) + sqrt(3) - 3.1462643699419723",
        "exp(pi) - pi - 19.999099979189475",
        "sqrt(1000001) - 1000.000499999875",
        "exp(pi*sqrt(163)) - 262537412640768744",  # 7.5e-13 of 2.6e17
        "sin(11) + 0.9999902065507035",
        "sqrt(2)*sqrt(3) - sqrt(6.000000000000001)",
        "sqrt(5 + 2*sqrt(6)) - sqrt(2) - sqrt(3.0000000000001)",
        "log(2**100 + 1) - 100*log(2)",
        "10**9*(sqrt(10**18 + 1) - 10**9)",
    ],
)
def test_what_only_nearly_cancels_is_rounded_correctly(text):
    found = value(text)
    assert isinstance(found, Irrational)
    with mpmath.workdps(80):
        names = ("sqrt", "exp", "log", "sin")
        numbers = text.replace("3.1462643699419723", "mpf('3.1462643699419723')")
        for decimal in ("19.999099979189475", "1000.000499999875", "0.9999902065507035"):
            numbers = numbers.replace(f" {decimal}", f" mpf('{decimal}')")
        for decimal in ("6.000000000000001", "3.0000000000001"):
            numbers = numbers.replace(f"({decimal})", f"(mpf('{decimal}'))")
        known = {name: getattr(mpmath, name) for name in names} | {"pi": mpmath.pi, "mpf": mpmath.mpf}
        known["sqrt"] = lambda x: mpmath.sqrt(mpmath.mpf(x))
        expected = float(eval(numbers, known))
    assert float(found) == pytest.approx(expected, rel=4e-16)


def test_comparisons_and_powers_by_the_exact_meaning():
    a, b = value("sqrt(2)*sqrt(3)"), value("sqrt(6)")
    assert a == b
    assert not a < b
    assert a <= b
    assert value("sqrt(2)") < value("sqrt(2 + 10**(-20))")
    assert value("(-2)**(sqrt(3)*sqrt(3))") == -8
    assert value("sqrt(sqrt(2)*sqrt(8) - 4)") == 0
    with pytest.raises(ExpressionError, match="division by zero"):
        value("1/(sqrt(8) - 2*sqrt(2))")
    with pytest.raises(ExpressionError, match="division by zero"):
        value("tan(pi/2)")
    with pytest.raises(ExpressionError, match="not real"):
        value("sqrt(sqrt(2) - 1.5)")


def test_an_irrational_number_computes_as_a_fraction_with_its_double():
    root = value("sqrt(2)")
    assert float(root) == math.sqrt(2)
    assert float(2 / root + root - 1) == pytest.approx(2 * math.sqrt(2) - 1, rel=1e-15)
    assert root**2 - 2 == 0
    assert Fraction(3) * root == root * 3
    assert -abs(-root) == -root
    assert hash(root) == hash(value("sqrt(2)"))
    assert Fraction(root) == Fraction(repr(math.sqrt(2)))
    for again in (copy.deepcopy(root), pickle.loads(pickle.dumps(root))):
        assert again - root == 0
    assert root * 0.5 == 0.5 * math.sqrt(2)
    assert type(apply("*", [root, 0.5])) is float


def test_a_field_knows_what_is_rational():
    numbers = [value("sqrt(2)*sqrt(8)"), value("cos(pi/3)"), value("exp(log(2)/2)*sqrt(2)"), value("sqrt(3)")]
    field = field_of(numbers)
    assert [coded(number, field) for number in numbers[:3]] == [4, Fraction(1, 2), 2]
    assert isinstance(coded(numbers[3], field), Irrational)
    assert field_of([Fraction(1, 3)]) is None


@pytest.mark.parametrize("seed", range(6))
def test_coded_numbers_add_and_multiply_as_the_numbers_they_stand_for(seed):
    """Sums of products of random roots that vanish are divisible by the prime, and no others."""
    rng = random.Random(seed)
    primes = rng.sample([2, 3, 5, 7, 11, 13], 4)
    roots = [value(f"sqrt({p})") for p in primes]
    mixed = [value(f"sqrt({p * q})") for p, q in pairwise(primes)]
    field = field_of([*roots, *mixed])
    a, b = ([Fraction(*coded(x, field).as_integer_ratio()) for x in xs] for xs in (roots, mixed))
    for k, product in enumerate(b):
        zero = a[k] * a[k + 1] - product
        assert zero.numerator % field.prime == 0
        assert abs(zero) < Fraction(1, 2**1000)
    one = a[0] * a[1] * a[2] - a[3]
    assert one.numerator % field.prime != 0


def test_what_neither_decides_is_refused_with_both_terms(monkeypatch):
    """Two terms whose enclosures are not told apart, and whose residues differ."""
    monkeypatch.setattr("dynid.arithmetic.real_field._MAX_PRECISION", 256)
    tiny = "exp(1) + 10**(-90) - exp(1) - 10**(-90)*(1 + 10**(-200)*sqrt(2))"
    with pytest.raises((ExpressionError, OutOfRangeError), match="cannot be decided"):
        value(tiny)
