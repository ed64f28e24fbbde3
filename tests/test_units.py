"""Units: factors as exact fractions, readings of g and lb, texts that are none, headings of columns."""

import math
from fractions import Fraction as F

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynid.bondgraph.graph import UNITS
from dynid.errors import UsageError
from dynid.units import (
    UnknownUnitError,
    is_units_row,
    readings,
    si_factor,
    split_heading,
    unit_fits,
    units_that_fit,
)

# Definitions of NIST SP 811, appendix B: exact.
INCH, FOOT, POUND, GRAVITY = F("0.0254"), F("0.3048"), F("0.45359237"), F("9.80665")
POUND_FORCE = POUND * GRAVITY
ACCELERATIONS = {
    "m/s2": F(1),
    "m/s^2": F(1),
    "m/s²": F(1),
    "m/s**2": F(1),
    "m s-2": F(1),
    "m·s⁻²": F(1),
    "m/s/s": F(1),
    "mm/s^2": F(1, 1000),
    "cm/s2": F(1, 100),
    "g": GRAVITY,
    "gn": GRAVITY,
    "grms": GRAVITY,
    "G": GRAVITY,
    "mg": GRAVITY / 1000,
    "µg": GRAVITY / 10**6,
    "μg": GRAVITY / 10**6,
    "ft/s2": FOOT,
    "in/s2": INCH,
    "IN/S2": INCH,
    "gal": F(1, 100),
    "Gal": F(1, 100),
    "mGal": F(1, 10**5),
}
OTHERS = {
    ("m", "mm"): F(1, 1000),
    ("m", "um"): F(1, 10**6),
    ("m", "µm"): F(1, 10**6),
    ("m", "mil"): INCH / 1000,
    ("m", "in"): INCH,
    ("m", "millimeters"): F(1, 1000),
    ("m", "nautical_mile"): F(1852),
    ("m/s", "mph"): F(5280) * FOOT / 3600,
    ("N", "kilonewton"): F(1000),
    ("W", "hp"): 550 * FOOT * POUND_FORCE,
    ("Pa", "torr"): F(101325, 760),
    ("kg", "slinch"): POUND_FORCE / INCH,
    ("m/s", "MM/S"): F(1, 1000),
    ("m/s", "in/s"): INCH,
    ("m/s", "km/h"): F(1000, 3600),
    ("N", "kN"): F(1000),
    ("N", "MN"): F(10**6),
    ("N", "mN"): F(1, 1000),
    ("N", "lbf"): POUND_FORCE,
    ("N", "lb"): POUND_FORCE,
    ("N", "kgf"): GRAVITY,
    ("N", "dyn"): F(1, 10**5),
    ("N", "poundal"): POUND * FOOT,
    ("N", "cN"): F(1, 100),
    ("1", "%"): F(1, 100),
    ("N.m", "Nm"): F(1),
    ("N.m", "kN.m"): F(1000),
    ("N.m", "kN*m"): F(1000),
    ("N.m", "N-m"): F(1),
    ("N.m", "in-lbf"): INCH * POUND_FORCE,
    ("N.m", "lb ft"): FOOT * POUND_FORCE,
    ("kg", "g"): F(1, 1000),
    ("kg", "mg"): F(1, 10**6),
    ("kg", "lb"): POUND,
    ("kg", "t"): F(1000),
    ("kg", "slug"): POUND_FORCE / FOOT,
    ("s", "ms"): F(1, 1000),
    ("s", "µs"): F(1, 10**6),
    ("Pa", "bar"): F(10**5),
    ("Pa", "psi"): POUND_FORCE / INCH**2,
    ("V", "mV"): F(1, 1000),
    ("m3/s", "L/min"): F(1, 60_000),
    ("m/(N.s2)", "g/N"): GRAVITY,
    ("m/(N.s2)", "(m/s2)/kN"): F(1, 1000),
    ("m/(N.s)", "mm/s/N"): F(1, 1000),
    ("m/(N.s2)", "g/lbf"): GRAVITY / POUND_FORCE,
}


@pytest.mark.parametrize("unit", ACCELERATIONS)
def test_accelerations_have_their_exact_factors(unit):
    assert si_factor(unit, ["m/s2", "rad/s2"]) == pytest.approx(float(ACCELERATIONS[unit]), rel=4e-16)


@pytest.mark.parametrize(("si", "unit"), OTHERS)
def test_units_have_their_exact_factors(si, unit):
    assert si_factor(unit, [si]) == pytest.approx(float(OTHERS[si, unit]), rel=2e-15)


@pytest.mark.parametrize(
    ("si", "unit", "factor"),
    [
        ("rad", "deg", math.pi / 180),
        ("rad", "°", math.pi / 180),
        ("rad/s", "°/s", math.pi / 180),
        ("rad/s", "rpm", math.pi / 30),
        ("rad/s", "rev/s", 2 * math.pi),
        ("rad/s2", "deg/s2", math.pi / 180),
    ],
)
def test_angles_have_a_dimension_of_their_own(si, unit, factor):
    assert si_factor(unit, [si]) == pytest.approx(factor, rel=4e-16)
    assert not unit_fits(unit, [si.replace("rad", "m", 1)])
    assert not unit_fits("Hz", ["rad/s"])


def test_a_sensitivity_divides():
    assert si_factor("mV", ["m/s2"], over="V/g") == pytest.approx(1e-3 * 9.80665, rel=1e-15)
    assert si_factor("V", ["m/s2"], over="mV/(m/s2)") == pytest.approx(1e3, rel=1e-15)
    assert si_factor("V", ["N", "N.m"], over="mV/lbf") == pytest.approx(1e3 * float(POUND_FORCE), rel=1e-15)
    with pytest.raises(UsageError, match=r"recorded unit over that of the quantity: V/\(m/s2\)\."):
        si_factor("V", ["m/s2"], over="V/N")


@pytest.mark.parametrize(
    ("unit", "expected", "message"),
    [
        (
            "kg",
            ["m/s2"],
            "the unit kg does not fit: an acceleration is in m/s2. Units that fit: m/s2, mm/s2, g, mg",
        ),
        ("mm", ["N", "N.m"], "Units that fit: N, N.m, kN"),
        ("foo", ["m/s2"], "'foo' is no unit; units that fit: m/s2, mm/s2, g"),
        ("m/foo", ["m"], "'m/foo' is no unit: 'foo' is unknown"),
        ("KPA", ["m"], "the unit KPA does not fit"),
        ("hZ", ["1/s"], "'hZ' is no unit; did you mean Hz?"),
        ("m/", ["m"], "a name is missing at its end"),
        ("N..m", ["m"], "a name is missing before '.'"),
        ("(m", ["m"], "a parenthesis is not balanced"),
        ("m)", ["m"], "a parenthesis is not balanced"),
        ("m^99", ["m"], "the power 99 is too large"),
        ("2 m", ["m"], "'2 m' cannot be read"),
        ("m;s", ["m"], "';s' cannot be read"),
        ("", ["m"], "'' is no unit"),
        ("m" * 61, ["m"], "is no unit"),
        ("degC", ["K"], "'degC' is no unit"),
        ("°C", ["K"], "'°C' is no unit with a factor: the scale of temperature has an offset"),
        ("W/°F", ["W"], "'W/°F' is no unit with a factor"),
        ("deg C", ["K"], "'deg C' is no unit with a factor"),
        ("dB", ["m"], "'dB' is no unit"),
        ("percent", ["m"], "'percent' is no unit"),
    ],
)
def test_what_is_no_unit_or_does_not_fit_is_refused_with_those_that_do(unit, expected, message):
    with pytest.raises(UsageError) as caught:
        si_factor(unit, expected, what="an acceleration")
    assert message in str(caught.value)


def test_units_that_fit_a_quantity_without_common_units_are_itself():
    assert units_that_fit(["m/(N.s)"]) == ["m/(N.s)"]
    assert set(units_that_fit(["kg"])) == {"kg", "g", "mg", "lb"}


ATOMS = st.sampled_from(["m", "mm", "s", "ms", "N", "kN", "kg", "rad", "V", "Pa", "in", "lbf"])
PARTS = st.lists(st.tuples(ATOMS, st.integers(-3, 3).filter(bool)), min_size=1, max_size=4)
FORMS = st.sampled_from([("^", "."), ("**", "*"), ("", "."), ("", " "), ("^", "·"), ("", "-")])


@given(PARTS, FORMS)
def test_products_of_powers_multiply(parts, form):
    sign, dot = form
    text = dot.join(
        f"{name}{sign if power != 1 else ''}{power if power != 1 else ''}" for name, power in parts
    )
    (found,) = readings(text)
    factor, dimension = 1.0, [0] * 6
    for name, power in parts:
        (one,) = readings(name)
        factor *= one.factor**power
        dimension = [a + power * b for a, b in zip(dimension, one.dimension, strict=True)]
    assert found.factor == pytest.approx(factor, rel=1e-14)
    assert found.dimension == tuple(dimension)
    (quotient,) = readings(f"({text})/({text})")
    assert quotient.dimension == (0,) * 6
    assert quotient.factor == pytest.approx(1, rel=1e-14)


@given(st.text(max_size=12))
def test_any_text_is_a_unit_or_refused(text):
    try:
        found = readings(text)
    except UnknownUnitError:
        return
    assert all(math.isfinite(one.factor) and one.factor > 0 for one in found)


@pytest.mark.parametrize(
    ("heading", "name", "unit"),
    [
        ("Time (s)", "Time", "s"),
        ("acc 12+Z [g]", "acc 12+Z", "g"),
        ("Force [N]", "Force", "N"),
        ("Force[kN]", "Force", "kN"),
        ("t / ms", "t", "ms"),
        ("Kraft in kN", "Kraft", "kN"),
        ("slip in x", "slip in x", ""),
        ("a / (m/s²)", "a", "m/s²"),
        ("H ((m/s2)/N)", "H", "(m/s2)/N"),
        ("H [(m/s2)/kN]", "H", "(m/s2)/kN"),
        ("x (in) [mm]", "x (in)", "mm"),
        ("x [furlong]", "x [furlong]", ""),
        ("B [T]", "B", "T"),
        ("acc (T)", "acc (T)", ""),  # remarks stand in parentheses, too
        ("T [°C]", "T", "°C"),  # refused where it is used
        ("damping (%)", "damping", "%"),
        ("acc (left)", "acc (left)", ""),
        ("acc (L)", "acc (L)", ""),
        ("acc (1)", "acc (1)", ""),
        ("a/b", "a/b", ""),
        ("acc [left]", "acc [left]", ""),
        ("[g]", "[g]", ""),
        (" v ", "v", ""),
    ],
)
def test_headings_are_names_with_units(heading, name, unit):
    assert split_heading(heading) == (name, unit)


@pytest.mark.parametrize(
    ("fields", "found"),
    [
        (["s", "g", "N"], True),
        (["(s)", "[m/s²]", "-", ""], True),
        (["s", "left"], False),
        (["Hz", "%", "°C"], True),
        (["nan", "NA"], False),
        (["", "-"], False),
        (["0", "1"], False),
    ],
)
def test_a_row_of_units_is_recognised(fields, found):
    assert is_units_row(fields) is found


def test_units_of_the_domains_of_bond_graphs_are_known():
    for domain in UNITS.values():
        for unit in domain.values():
            (found,) = readings(unit)
            assert found.factor == 1, unit
