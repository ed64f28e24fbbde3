"""Units of measured quantities: the factor to SI and the dimension of a text such as `mm/s2` or `(m/s2)/kN`.

Two names have two readings, of which the dimension decides: `g` (also `mg`, `ug`) is standard gravity or
gram, `lb` is pound or pound-force. Angles have a dimension of their own, so that `rad/s` and `1/s` are not
confused.

Factors: B. N. Taylor, A. Thompson, The International System of Units, NIST SP 330 (2008) and SP 811, app. B.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import product
from typing import NamedTuple, NoReturn

from dynid.errors import UsageError

GRAVITY = 9.80665
"""Standard gravity, m/s2."""

_BASES = ("m", "kg", "s", "A", "K", "rad")


class Unit(NamedTuple):
    """A unit: a value in it times `factor` is the value in SI; exponents of m, kg, s, A, K and rad."""

    factor: float
    dimension: tuple[int, ...]

    def __mul__(self, other: Unit) -> Unit:  # type: ignore[override]
        return Unit(
            self.factor * other.factor,
            tuple(a + b for a, b in zip(self.dimension, other.dimension, strict=True)),
        )

    def __truediv__(self, other: Unit) -> Unit:
        return self * other**-1

    def __pow__(self, power: int) -> Unit:
        # Dividing by the decimal keeps 1/1000 exact to rounding where a product with 0.001 does not.
        factor = self.factor**power if power >= 0 else 1 / self.factor**-power
        return Unit(factor, tuple(power * a for a in self.dimension))


class FrequencyUnit(NamedTuple):
    """A unit of frequencies, the symbol of a frequency in it, and the factor to it from rad/s."""

    name: str
    symbol: str
    factor: float

    def text(self, omega: float, digits: int = 4) -> str:
        """Write an angular frequency (rad/s) in this unit."""
        return f"{self.factor * omega:.{digits}g} {self.name}"


RADIANS = FrequencyUnit("rad/s", "ω", 1.0)
HERTZ = FrequencyUnit("Hz", "f", 1 / (2 * math.pi))


def _of(**powers: int) -> tuple[int, ...]:
    return tuple(powers.get(base, 0) for base in _BASES)


_NONE = _of()
_LENGTH, _MASS, _TIME, _ANGLE = _of(m=1), _of(kg=1), _of(s=1), _of(rad=1)
_ACCELERATION, _FORCE, _MOMENT = _of(m=1, s=-2), _of(m=1, kg=1, s=-2), _of(m=2, kg=1, s=-2)
_PRESSURE, _VOLUME, _ENERGY = _of(m=-1, kg=1, s=-2), _of(m=3), _MOMENT
_CHARGE = _of(A=1, s=1)

_POUND = 0.45359237
_POUND_FORCE = 4.4482216152605
_INCH, _FOOT = 0.0254, 0.3048

_PREFIXES = {
    "p": 1e-12, "n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "d": 0.1, "h": 1e2, "k": 1e3, "M": 1e6, "G": 1e9,
}  # fmt: skip
_LONG_PREFIXES = {
    "": 1.0, "nano": 1e-9, "micro": 1e-6, "milli": 1e-3, "centi": 1e-2, "deci": 0.1, "hecto": 1e2,
    "kilo": 1e3, "mega": 1e6, "giga": 1e9,
}  # fmt: skip

#: Units with the prefixes that are read before them, and their names in full.
_PREFIXED: dict[str, tuple[Unit, str, str]] = {
    "m": (Unit(1, _LENGTH), "pnumcdk", "meter metre"),
    "s": (Unit(1, _TIME), "pnum", "second"),
    "N": (Unit(1, _FORCE), "numcdkMG", "newton"),
    "Nm": (Unit(1, _MOMENT), "umkM", ""),
    "Pa": (Unit(1, _PRESSURE), "umhkMG", "pascal"),
    "bar": (Unit(1e5, _PRESSURE), "umk", ""),
    "Hz": (Unit(1, _of(s=-1)), "mkMG", "hertz"),
    "V": (Unit(1, _of(m=2, kg=1, s=-3, A=-1)), "numkM", "volt"),
    "A": (Unit(1, _of(A=1)), "pnumk", "ampere amp"),
    "C": (Unit(1, _CHARGE), "pnumk", "coulomb"),
    "W": (Unit(1, _of(m=2, kg=1, s=-3)), "numkMG", "watt"),
    "J": (Unit(1, _ENERGY), "numkMG", "joule"),
    "Wh": (Unit(3600, _ENERGY), "mkM", ""),
    "K": (Unit(1, _of(K=1)), "um", "kelvin"),
    "rad": (Unit(1, _ANGLE), "num", "radian"),
    "strain": (Unit(1, _NONE), "num", ""),
    "ohm": (Unit(1, _of(m=2, kg=1, s=-3, A=-2)), "umkMG", ""),
    "F": (Unit(1, _of(m=-2, kg=-1, s=4, A=2)), "pnum", "farad"),
    "H": (Unit(1, _of(m=2, kg=1, s=-2, A=-2)), "num", "henry"),
    "Wb": (Unit(1, _of(m=2, kg=1, s=-2, A=-1)), "num", "weber"),
    "T": (Unit(1, _of(kg=1, s=-2, A=-1)), "num", "tesla"),
    "L": (Unit(1e-3, _VOLUME), "umcdh", "liter litre"),
    "l": (Unit(1e-3, _VOLUME), "umcdh", ""),
}

_SINGLE: dict[str, Unit] = {
    **dict.fromkeys(("in", "inch", "inches"), Unit(_INCH, _LENGTH)),
    **dict.fromkeys(("ft", "feet", "foot"), Unit(_FOOT, _LENGTH)),
    **dict.fromkeys(("mil", "mils", "thou"), Unit(2.54e-5, _LENGTH)),
    **dict.fromkeys(("yd", "yard", "yards"), Unit(3 * _FOOT, _LENGTH)),
    **dict.fromkeys(("mi", "mile", "miles"), Unit(5280 * _FOOT, _LENGTH)),
    **dict.fromkeys(("nmi", "nautical_mile"), Unit(1852, _LENGTH)),
    **dict.fromkeys(("micron", "microns"), Unit(1e-6, _LENGTH)),
    **dict.fromkeys(("angstrom", "Å"), Unit(1e-10, _LENGTH)),
    **dict.fromkeys(("kg", "kilogram", "kilograms"), Unit(1, _MASS)),
    **dict.fromkeys(("gram", "grams"), Unit(1e-3, _MASS)),
    **dict.fromkeys(("milligram", "milligrams"), Unit(1e-6, _MASS)),
    **dict.fromkeys(("t", "tonne", "tonnes"), Unit(1e3, _MASS)),
    "lbm": Unit(_POUND, _MASS),
    **dict.fromkeys(("oz", "ounce", "ounces"), Unit(_POUND / 16, _MASS)),
    "slug": Unit(_POUND_FORCE / _FOOT, _MASS),
    **dict.fromkeys(("slinch", "blob"), Unit(_POUND_FORCE / _INCH, _MASS)),
    "sec": Unit(1, _TIME),
    "msec": Unit(1e-3, _TIME),
    "usec": Unit(1e-6, _TIME),
    **dict.fromkeys(("min", "minute", "minutes"), Unit(60, _TIME)),
    **dict.fromkeys(("h", "hr", "hour", "hours"), Unit(3600, _TIME)),
    **dict.fromkeys(("day", "days"), Unit(86_400, _TIME)),
    **dict.fromkeys(("knot", "knots", "kt"), Unit(1852 / 3600, _of(m=1, s=-1))),
    "mph": Unit(5280 * _FOOT / 3600, _of(m=1, s=-1)),
    "kph": Unit(1 / 3.6, _of(m=1, s=-1)),
    **dict.fromkeys(("deg", "degree", "degrees", "°"), Unit(math.pi / 180, _ANGLE)),
    "arcmin": Unit(math.pi / 10_800, _ANGLE),
    "arcsec": Unit(math.pi / 648_000, _ANGLE),
    **dict.fromkeys(("gon", "grad"), Unit(math.pi / 200, _ANGLE)),
    **dict.fromkeys(("rev", "turn", "revolution", "revolutions"), Unit(2 * math.pi, _ANGLE)),
    **dict.fromkeys(("rpm", "RPM"), Unit(math.pi / 30, _of(rad=1, s=-1))),
    **dict.fromkeys(("gn", "grms", "gRMS", "gpk", "G", "g_0"), Unit(GRAVITY, _ACCELERATION)),
    **dict.fromkeys(("gal", "Gal"), Unit(1e-2, _ACCELERATION)),
    "mGal": Unit(1e-5, _ACCELERATION),
    "lbf": Unit(_POUND_FORCE, _FORCE),
    **dict.fromkeys(("kip", "kips", "klbf"), Unit(1e3 * _POUND_FORCE, _FORCE)),
    "ozf": Unit(_POUND_FORCE / 16, _FORCE),
    **dict.fromkeys(("kgf", "kp", "kilopond"), Unit(GRAVITY, _FORCE)),
    "gf": Unit(1e-3 * GRAVITY, _FORCE),
    **dict.fromkeys(("tf", "tonf"), Unit(1e3 * GRAVITY, _FORCE)),
    **dict.fromkeys(("dyn", "dyne", "dynes"), Unit(1e-5, _FORCE)),
    "poundal": Unit(_POUND * _FOOT, _FORCE),
    "Nmm": Unit(1e-3, _MOMENT),
    "psi": Unit(_POUND_FORCE / _INCH**2, _PRESSURE),
    "ksi": Unit(1e3 * _POUND_FORCE / _INCH**2, _PRESSURE),
    "psf": Unit(_POUND_FORCE / _FOOT**2, _PRESSURE),
    "atm": Unit(101325, _PRESSURE),
    "torr": Unit(101325 / 760, _PRESSURE),
    "mmHg": Unit(133.322387415, _PRESSURE),
    "inHg": Unit(25.4 * 133.322387415, _PRESSURE),
    "hp": Unit(550 * _FOOT * _POUND_FORCE, _of(m=2, kg=1, s=-3)),
    **dict.fromkeys(("cal", "calorie", "calories"), Unit(4.184, _ENERGY)),
    "kcal": Unit(4184, _ENERGY),
    **dict.fromkeys(("Btu", "BTU"), Unit(1055.05585262, _ENERGY)),
    "erg": Unit(1e-7, _ENERGY),
    "eV": Unit(1.602176634e-19, _ENERGY),
    **dict.fromkeys(("gallon", "gallons"), Unit(231 * _INCH**3, _VOLUME)),
    "cc": Unit(1e-6, _VOLUME),
    **dict.fromkeys(("P", "poise"), Unit(0.1, _of(m=-1, kg=1, s=-1))),
    "cP": Unit(1e-3, _of(m=-1, kg=1, s=-1)),
    "St": Unit(1e-4, _of(m=2, s=-1)),
    "cSt": Unit(1e-6, _of(m=2, s=-1)),
    "gauss": Unit(1e-4, _of(kg=1, s=-2, A=-1)),
    "Ω": Unit(1, _of(m=2, kg=1, s=-3, A=-2)),
    "siemens": Unit(1, _of(m=-2, kg=-1, s=3, A=2)),  # S is a second where all is written in capitals
    "mS": Unit(1e-3, _of(m=-2, kg=-1, s=3, A=2)),
    "%": Unit(1e-2, _NONE),
    "ppm": Unit(1e-6, _NONE),
}

#: Names of two readings.
_DOUBLE: dict[str, tuple[Unit, Unit]] = {
    "g": (Unit(GRAVITY, _ACCELERATION), Unit(1e-3, _MASS)),
    "mg": (Unit(1e-3 * GRAVITY, _ACCELERATION), Unit(1e-6, _MASS)),
    "ug": (Unit(1e-6 * GRAVITY, _ACCELERATION), Unit(1e-9, _MASS)),
    **dict.fromkeys(("lb", "lbs"), (Unit(_POUND, _MASS), Unit(_POUND_FORCE, _FORCE))),
}

_TABLE: dict[str, tuple[Unit, ...]] = {
    **{
        prefix + name: (Unit(_PREFIXES.get(prefix, 1.0) * unit.factor, unit.dimension),)
        for name, (unit, prefixes, _) in _PREFIXED.items()
        for prefix in ("", *prefixes)
    },
    **{
        f"{prefix}{name}{plural}": (Unit(factor * unit.factor, unit.dimension),)
        for unit, _, names in _PREFIXED.values()
        for name in names.split()
        for prefix, factor in _LONG_PREFIXES.items()
        for plural in ("", "s")
    },
    **{name: (unit,) for name, unit in _SINGLE.items()},
    **_DOUBLE,
}

#: Names that some instruments write in capitals, with the rest of the unit; `MV` might be two units.
_IN_CAPITALS = "m mm cm s ms sec in ft kg lb lbf rad deg rev kN Hz kHz Pa kPa bar psi min"
_CAPITALS = {name.upper(): name for name in _IN_CAPITALS.split()}

#: Names that are no units in parentheses in a heading, where they may be a side or a sensor.
_REMARKS = {"1", "A", "C", "F", "H", "K", "L", "P", "T", "l", "t", "h", "J", "W"}

#: Shown where a unit does not fit, of each dimension the ones that occur in laboratories.
_SHOWN = (
    "m mm um in ft mil m/s mm/s in/s m/s2 mm/s2 g mg ft/s2 in/s2 gal rad mrad deg rad/s deg/s rpm "
    "rad/s2 deg/s2 N kN MN lbf kgf N.m kN.m Nmm lbf.in lbf.ft kg g lb s ms us Hz kHz "
    "Pa kPa MPa bar psi V mV A mA pC m3 L m3/s L/min K W kW J N.s %"
)

_TOKEN = re.compile(
    r"""\s*(?:(?P<name>[^\W\d]+|[°%])(?P<attached>[+-]?\d+)?
    |(?P<power>(?:\^|\*\*)\s*(?:[+-]?\d+|\(\s*[+-]?\d+\s*\)))
    |(?P<one>1(?![\d.]))
    |(?P<mark>[/()·⋅×*.-]))\s*""",
    re.VERBOSE,
)
#: Scales with an offset: no factor converts them, and `°C` is no degree times coulomb.
_TEMPERATURE = re.compile(r"(°|deg(ree)?s?)\s*[CF](?![^\W\d])")
_MAX_UNIT_CHARACTERS = 60
_MOST_POWER = 9


class UnknownUnitError(ValueError):
    """A text that is no unit."""


def unit_fits(text: str, expected: Sequence[str]) -> bool:
    """Return True if a text is a unit of the dimension of one of these units; none: if it is a unit."""
    try:
        return any(_fitting(reading, expected) for reading in readings(text))
    except UnknownUnitError:
        return False


def si_factor(text: str, expected: Sequence[str] = (), *, over: str = "", what: str = "") -> float:
    """Return the factor that converts values in a unit into SI.

    The unit must have a dimension of one of the units `expected`, if there are any. It is divided by the unit
    of a sensitivity (`over`). `what` is the quantity that is measured, for messages. Raises `UsageError` if
    the text is no unit, or has another dimension; it names units that fit.
    """
    try:
        factors = [above / below for above, below in product(readings(text), readings(over or "1"))]
    except UnknownUnitError as error:
        fitting_units = (
            f"; units that fit: {', '.join(units_that_fit(expected))}" if expected and not over else ""
        )
        raise UsageError(f"{error}{fitting_units}") from None
    fitting = [factor for factor in factors if _fitting(factor, expected)]
    if fitting:
        return fitting[0].factor
    _refuse(text, expected, over, what)


_WITH_UNIT = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\W\d].*|[°%].*)", re.DOTALL)
#: What a value in SI is in, by its dimension the first one.
_IN_SI = "kg m s A K rad m/s m/s2 rad/s N N/m N.s/m N.m N.m/rad Pa V C ohm W Wb m2 m3 m3/s kg/m kg/m3 kg.m2"


def split_value(text: str) -> tuple[float, str, Unit] | None:
    """Return the number in a text such as `15 ms`, its unit, and what that is.

    None of a text that is none, and of `g` and `lb`, which have two readings.
    """
    match = _WITH_UNIT.fullmatch(text)
    if match is None:
        return None
    try:
        units = readings(match[2])
    except UnknownUnitError:
        return None
    return (float(match[1]), match[2].strip(), units[0]) if len(units) == 1 else None


def si_unit(unit: str, meaning: Unit) -> str:
    """Return the unit in SI of a quantity that is given in another one; empty where it has no usual name."""
    if meaning.factor == 1:
        return unit
    return next((name for name in _IN_SI.split() if readings(name)[0].dimension == meaning.dimension), "")


def angular_factor(text: str | None) -> float:
    """Return the factor that converts frequencies in a unit into rad/s: 2π of Hz, 1 of rad/s or no unit.

    Raises `UsageError` if the text is no unit of a frequency.
    """
    if text is None:
        return 1.0
    factor = si_factor(text, ["Hz", "rad/s"], what="the frequency")
    return 2 * math.pi * factor if unit_fits(text, ["Hz"]) else factor


def _refuse(text: str, expected: Sequence[str], over: str, what: str) -> NoReturn:
    kind = f"{what} is" if what else "the values are"
    if over:
        product = f"{text}/{as_factor(expected[0])}"
        raise UsageError(
            f"values in {text} over a sensitivity in {over} are no {' or '.join(expected)}, in which {kind}",
            remedy=f"A sensitivity is in the recorded unit over that of the quantity: {product}.",
        )
    raise UsageError(
        f"the unit {text} does not fit: {kind} in {' or '.join(expected)}",
        remedy=f"Units that fit: {', '.join(units_that_fit(expected))}.",
    )


def as_factor(unit: str) -> str:
    """Return a unit as a factor: in parentheses if it is compound."""
    return f"({unit})" if set(unit) & set("/. ") else unit


def units_that_fit(expected: Sequence[str]) -> list[str]:
    """Return common units of the dimensions of these units; those themselves where none is common."""
    shown = [text for text in _SHOWN.split() if unit_fits(text, expected)]
    return list(dict.fromkeys([*expected, *shown]))


def _fitting(unit: Unit, expected: Sequence[str]) -> bool:
    return not expected or any(
        unit.dimension == si_reading.dimension for si in expected for si_reading in readings(si)
    )


@cache
def readings(text: str) -> tuple[Unit, ...]:
    """Return the units that a text may mean: one, or two of `g` and `lb`.

    The text has names with powers (`s2`, `s^-2`, `s²`), products (`.`, `·`, `*`, `-`, a space), quotients (a
    further one divides again) and parentheses. Raises `UnknownUnitError` if it is no unit.
    """
    plain = _plain(text)
    if not plain or len(plain) > _MAX_UNIT_CHARACTERS:
        raise UnknownUnitError(f"'{text[:_MAX_UNIT_CHARACTERS]}' is no unit")
    if _TEMPERATURE.search(plain):
        raise UnknownUnitError(f"'{text}' is no unit with a factor: the scale of temperature has an offset")
    tokens, at = [], 0
    while at < len(plain):
        match = _TOKEN.match(plain, at)
        if match is None:
            raise UnknownUnitError(f"'{text}' is no unit: '{plain[at:]}' cannot be read")
        tokens.append(match)
        at = match.end()
    stream = _Tokens(text, tokens)
    units = stream.product()
    if stream.rest:
        raise UnknownUnitError(f"'{text}' is no unit: a parenthesis is not balanced")
    return tuple(dict.fromkeys(units))


def _plain(text: str) -> str:
    return unicodedata.normalize("NFKC", text).replace("μ", "u").replace("−", "-").strip()


class _Tokens:
    """The tokens of a unit, read once from left to right."""

    def __init__(self, text: str, tokens: Sequence[re.Match[str]]) -> None:
        self.text, self.rest = text, list(tokens)

    def product(self) -> tuple[Unit, ...]:
        """Return the readings of factors and divisors up to the end or a closing parenthesis."""
        units: tuple[Unit, ...] = (Unit(1.0, _NONE),)
        sign, pending = 1, True
        while self.rest and self.rest[0]["mark"] != ")":
            mark = self.rest[0]["mark"]
            if mark and mark != "(":
                if pending:
                    self._fail(mark)
                self.rest.pop(0)
                sign, pending = -1 if mark == "/" else 1, True
                continue
            factor = self._factor()
            units = tuple(a * b**sign for a, b in product(units, factor))
            sign, pending = 1, False
        if pending:
            self._fail(self.rest[0][0] if self.rest else "")
        return units

    def _factor(self) -> tuple[Unit, ...]:
        token = self.rest.pop(0)
        power = token["attached"]
        if token["mark"] == "(":
            units = self.product()
            if not self.rest:
                raise UnknownUnitError(f"'{self.text}' is no unit: a parenthesis is not balanced")
            self.rest.pop(0)
        elif token["one"]:
            units = (Unit(1.0, _NONE),)
        elif token["name"]:
            units = _named(token["name"], self.text)
        else:
            self._fail(token[0])
        if self.rest and self.rest[0]["power"] and power is None:
            power = self.rest.pop(0)["power"].lstrip("^* (").rstrip(") ")
        exponent = int(power or 1)
        if abs(exponent) > _MOST_POWER:
            raise UnknownUnitError(f"'{self.text}' is no unit: the power {exponent} is too large")
        return tuple(unit**exponent for unit in units)

    def _fail(self, at: str) -> NoReturn:
        where = f" before '{at.strip()}'" if at.strip() else " at its end"
        raise UnknownUnitError(f"'{self.text}' is no unit: a name is missing{where}")


def _named(name: str, text: str) -> tuple[Unit, ...]:
    """Return the readings of one name: of the table, or of some in capitals."""
    if name in _TABLE:
        return _TABLE[name]
    if name in _CAPITALS and text.upper() == text:
        return _TABLE[_CAPITALS[name]]
    hint = f": '{name}' is unknown" if name != text else ""
    alike = [candidate for candidate in _TABLE if candidate.lower() == name.lower()]
    meant = f"; did you mean {' or '.join(alike)}?" if alike else ""
    raise UnknownUnitError(f"'{text}' is no unit{hint}{meant}")


_HEADINGS = (
    (r"(.*)\[([^\[\]]+)\]$", True),
    (r"(.*?)\((.+)\)$", False),
    (r"(.*\S)\s+(?:/|in\s)\s*(.+)$", False),
)


def split_heading(heading: str) -> tuple[str, str]:
    """Return the name and the unit in a heading: `acc 12+Z [g]`, `Time (s)`, `t / ms`; empty: no unit.

    In parentheses or behind a slash some letters are no units, as remarks stand there, too.
    """
    bare = heading.strip()
    for pattern, in_brackets in _HEADINGS:
        match = re.match(pattern, bare)
        inside = "" if match is None else match[2].strip()
        if match is None or not match[1].strip(" /") or (not in_brackets and inside in _REMARKS):
            continue
        if _states_unit(inside):
            return match[1].rstrip(" /"), inside
    return bare, ""


def is_units_row(fields: Sequence[str]) -> bool:
    """Return True if fields are units and empty ones or dashes."""
    return any(_units_in(fields)) and all(unit is not None for unit in _units_in(fields))


def unit_of_field(field: str) -> str:
    """Return the unit in a field of a row of units, without brackets; empty of a dash."""
    bare = field.strip().strip("[]").strip()
    if bare.startswith("(") and bare.endswith(")") and bare.count("(") == 1:
        bare = bare[1:-1].strip()
    return "" if bare in ("-", "–", "—", "1") else bare


def _units_in(fields: Sequence[str]) -> Iterator[str | None]:
    """Yield the unit in each field, empty of an empty one, None of what is none."""
    for field in fields:
        bare = unit_of_field(field)
        yield bare if not bare or _states_unit(bare) else None


def _states_unit(text: str) -> bool:
    """Return True if a text is a unit, or a scale of temperature, which `readings` refuses."""
    try:
        readings(text)
    except UnknownUnitError:
        return _TEMPERATURE.fullmatch(_plain(text)) is not None
    return True
