import math
from fractions import Fraction

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from dynid.arithmetic.expression import (
    ExpressionError,
    OutOfRangeError,
    parse,
    resolve_parameters,
    to_fraction,
)
from dynid.arithmetic.numbers import Irrational


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 + 2*3", 7), ("-2**2", -4), ("2**3**2", 512), ("2**-3", Fraction(1, 8)),
        ("0.1 + 0.2", Fraction(3, 10)),
        ("1e3", 1000), (".5", Fraction(1, 2)), ("1/3 - 1/3", 0), ("sqrt(4/9)", Fraction(2, 3)), ("--2", 2),
        ("min(3, 1/2, 2)", Fraction(1, 2)), ("max(1, 2)", 2), ("abs(-3)", 3), ("A**2 * I_f", 2),
        ("(1\n + 2)", 3),
        ("1**10**300", 1), ("0**0", 1), ("ω*2", 3), ("+".join(["1"] * 500), 500), ("-" * 998 + "1", 1),
        ("10**400 * 10**400", 10**800), ("sqrt(10**800)", 10**400),
    ],
)  # fmt: skip
def test_exact_values(text, value):
    found = parse(text).evaluate({"A": Fraction(1, 100), "I_f": 2 * 10**4, "ω": Fraction(3, 2)})
    assert type(found) is Fraction
    assert found == value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2*pi", 2 * math.pi), ("sqrt(2)", math.sqrt(2)), ("exp(1) + 1", math.e + 1), ("log(2)", math.log(2)),
        ("sin(1)*cos(1)/tan(1)", math.sin(1) * math.cos(1) / math.tan(1)), ("2**0.5", 2**0.5), ("x*2", 0.5),
        ("exp(0)**3", 1.0), ("(-exp(0))**3", -1.0), ("max(1/3, pi)", math.pi),
        ("sqrt(pi)", math.sqrt(math.pi)),
    ],
)  # fmt: skip
def test_irrational_values_and_floats(text, value):
    found = parse(text).evaluate({"x": 0.25})
    assert type(found) is (float if text == "x*2" else Irrational)
    assert float(found) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "column", "words"),
    [
        ("a.", 2, "'.'"), ("f(x)", 1, "no function 'f'"), ("1 + sqr(2)", 5, "did you mean 'sqrt'"),
        ("sqrt", 1, "function"), ("sqrt()", 1, "one argument"), ("sqrt(1, 2)", 1, "one argument"),
        ("min(1)", 1, "two arguments"), ("sqrt(*x)", 1, "without"), ("(1, 2)", 1, "no meaning"),
        ("()", 1, "no meaning"),
        ("0,5", 1, "decimals stand behind a point"),
        ("2(3)", 1, "needs a *"), ("x(3)", 1, "no function"), ("2m", 1, "2*m"), ("1_000", 1, "neither"),
        ("0x10", 1, "neither"), ("1j", 1, "neither"), ("lambda: 1", 1, "'lambda'"),
        ("x if y else z", 3, "'if'"),
        ("[1]", 1, "'['"), ("x[0]", 2, "'['"), ("'a'", 1, "no meaning"), ('f"{x}"', 2, "no meaning"),
        ("(a:=1)", 3, "':'"),
        ("a == b", 3, "'='"), ("a < b", 3, "'<'"), ("a // b", 1, "operator"), ("a % b", 3, "'%'"),
        ("a ^ 2", 3, "**"),
        ("a and b", 3, "'and'"), ("not a", 1, "'not'"), ("[x for x in y]", 1, "'['"),
        ("__import__", 1, "underscores"),
        ("ﬁ + 1", 1, "'fi'"),
        ("a b", 3, "an operator is missing between 'a' and 'b'"), ("2 * 3 4", 7, "between '3' and '4'"),
        ("0.6 Ohm", 5, "a number in SI units, without its unit"), ("5  ms", 4, "without its unit"),
        ("2*5 in", 5, "without its unit"), ("10 µF", 4, "without its unit"),
        ("0.6Ohm", 1, "without its unit"),
        ("0,02", 1, "decimals stand behind a point: did you mean 0.02?"),
        (" -3,5e-2", 1, "did you mean -3.5e-2?"), ("1,000", 1, "did you mean 1.000 or 1000?"),
        ("x2 m", 4, "between 'x2' and 'm'"),
        ("1 +", 3, "missing"), ("(1", 1, "not closed"),
        ("min(1", 4, "in quotes"),
        ("1)+(2", 2, "closes nothing"), ("", 1, "missing"), ("  ", 1, "missing"), ("1e999", 1, "too large"),
        ("(" * 300 + ")" * 300, 101, "nested"), ("x" * 1001, 1001, "1000 characters"), ("a; b", 2, "';'"),
        ("a\\b", 2, "no meaning"),
        ("None", 1, "'None'"), ("True", 1, "'True'"), ("pi(2)", 1, "no function"), ("007", 1, "arithmetic"),
        ("ωω + 1/ * 2", 8, "missing"),
    ],
)  # fmt: skip
def test_anything_but_arithmetic_is_refused(text, column, words):
    with pytest.raises(ExpressionError) as caught:
        parse(text)
    assert words in caught.value.sentence
    if words not in ("missing", "arithmetic"):
        assert caught.value.column == column


@pytest.mark.parametrize(
    ("text", "column", "words"),
    [
        ("9**9**9", 1, "binary digits"), ("2**10**9", 1, "binary digits"),
        ("0.5**-10**9", 1, "binary digits"),
        ("1 + 1/0", 5, "division by zero"), ("0**-1", 1, "division by zero"),
        ("0.0**(-1/2)", 1, "division by zero"),
        ("log(0)", 1, "logarithm"), ("log(-1)", 1, "logarithm"), ("sqrt(-1)", 1, "square root"),
        ("(-1)**0.5", 1, "not real"), ("exp(1000)", 1, "too large"), ("exp(700)*exp(700)", 1, "too large"),
        ("exp(1) + 10**400", 1, "too large"), ("sin(10**400)", 1, "too large"),
        ("sqrt(2/10**800)", 1, "too small"),
        ("1.5**10**6", 1, "binary digits"), ("x + stifness", 5, "did you mean 'stiffness'"),
        ("bad + 1", 1, "infinite"),
        ("exp(1)**10**400", 1, "too large"), ("9**6000 * 9**6000", 1, "binary digits"),
    ],
)  # fmt: skip
def test_what_has_no_value_ends_at_once_with_a_sentence(text, column, words):
    with pytest.raises(ExpressionError) as caught:
        parse(text).evaluate({"x": 1, "stiffness": 2, "bad": math.inf})
    assert words in caught.value.sentence
    assert caught.value.column == column


LITERALS = st.integers(0, 50).map(lambda n: (str(n), Fraction(n)))
LITERALS |= st.decimals(0, 100, places=3).map(lambda d: (str(d), Fraction(str(d))))
LITERALS |= st.just(("a", Fraction(-7, 3)))


@st.composite
def arithmetic(draw, depth=4):
    """Text and exact value, the value worked out with fractions alone."""
    if depth == 0 or draw(st.booleans()):
        return draw(LITERALS)
    (left, a), (right, b) = draw(arithmetic(depth - 1)), draw(arithmetic(depth - 1))
    operator = draw(st.sampled_from("+-*/^n"))
    if operator == "n":
        return f"-({left})", -a
    if operator == "^":
        power = draw(st.integers(-3, 3))
        assume(a != 0 or power >= 0)
        return f"({left})**{power}", a**power
    if operator == "/":
        assume(b != 0)
        return f"({left})/({right})", a / b
    return f"({left}) {operator} ({right})", {"+": a + b, "-": a - b, "*": a * b}[operator]


@given(arithmetic())
@settings(max_examples=100)
def test_random_arithmetic_is_exact(case):
    text, value = case
    assume(len(text) < 1000)
    assert parse(text).evaluate({"a": Fraction(-7, 3)}) == value


@given(st.text("ab1.+-*/()^, _esqrt'\"[]:=\n", max_size=30) | st.text(max_size=20))
@settings(max_examples=200)
def test_random_texts_give_a_number_or_a_sentence(text):
    value, column = 0, 1
    try:
        value = parse(text).evaluate({"a": 2, "b": 0.5})
    except ExpressionError as error:
        column = error.column
    assert 1 <= column <= max(len(text), 1)
    assert abs(value) < math.inf


def test_names_and_folding_over_another_kind_of_number():
    expression = parse("2*pi*sqrt(k/m) - -k")
    assert expression.names == {"k", "m"}
    shown = expression.fold(str, lambda operation, operands: f"({operation} {' '.join(operands)})")
    assert shown == "(- (* (* 2 pi) (sqrt (/ k m))) (neg k))"


@pytest.mark.parametrize(
    ("value", "reading", "expected"),
    [
        (0.1, "decimal", Fraction(1, 10)),
        (0.1, "binary", Fraction(0.1)),
        (3, "binary", 3),
        (1e-300, "decimal", Fraction("1e-300")),
    ],
)
def test_reading_of_floats(value, reading, expected):
    assert to_fraction(value, reading) == expected


@pytest.mark.parametrize("value", [True, math.inf, math.nan, "1", None])
def test_what_is_no_finite_number_has_no_fraction(value):
    with pytest.raises(OutOfRangeError):
        to_fraction(value)


def test_parameters_refer_to_each_other_in_any_order():
    values, faults = resolve_parameters({"m_e": "A**2 * I", "I": 2.0e4, "A": "a/10", "a": 0.1})
    assert not faults
    assert values == {"a": Fraction(1, 10), "A": Fraction(1, 100), "I": 20000, "m_e": 2}


def test_a_parameter_waits_for_all_that_it_refers_to():
    values, faults = resolve_parameters({"sum": "a + b + c", "a": "1 + 1", "b": "a + 1", "c": "b * a"})
    assert not faults
    assert values == {"a": 2, "b": 3, "c": 6, "sum": 11}


def test_long_chains_of_parameters_do_not_recurse():
    values, faults = resolve_parameters({f"p{i}": f"p{i + 1} + 1" for i in range(5000)} | {"p5000": 1})
    assert not faults
    assert values["p0"] == 5001


def test_all_faulty_parameters_are_told_and_only_they():
    raw = {
        "fine": 1, "c": "c + 1", "d": "e", "e": "f", "f": "d", "h": "fne*2", "sin": 1, "pi": 3, "1x": 1,
        "t": True, "n": None, "l": [1], "i": math.inf, "z": "1/0", "after": "z + 1",
        "lambda": 1, "q": "fine.real", "__x": 1,
    }  # fmt: skip
    values, faults = resolve_parameters(raw)
    assert values == {"fine": 1}
    assert faults.keys() == raw.keys() - {"fine", "after"}
    assert "d -> e -> f -> d" in faults["e"]
    assert "c -> c" in faults["c"]
    assert "did you mean 'fine'" in faults["h"]
    assert "function" in faults["sin"]
    assert "division by zero" in faults["z"]
    assert "true" in faults["t"]
    assert "reserved" in faults["lambda"]


def test_a_parameter_downstream_of_a_cycle_is_not_blamed():
    _, faults = resolve_parameters({"a": "b", "b": "a", "user": "a + 1"})
    assert faults.keys() == {"a", "b"}


def test_a_long_cycle_is_shortened_in_the_message_of_each_parameter():
    _, faults = resolve_parameters({f"p{k}": f"p{(k + 1) % 2000}" for k in range(2000)})
    assert len(faults) == 2000
    assert faults["p7"] == (
        "'p7' is defined by itself: p0 -> p1 -> p2 -> p3 -> (1994 more) -> p1998 -> p1999 -> p0"
    )
