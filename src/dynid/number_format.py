"""Numbers in text: significant digits, errors, units, roots."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

#: Most roots in a list.
MOST_ROOTS = 12
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: Spaces within roots, equations with a number, between thousands, and between a number and its unit.
_JOINT = re.compile(
    r" (?=± )|(?<=±) | (?== [-−\d∞])|(?<= =) (?=[-−\d∞])|(?<=\d) (?=(?:\d{3}|Hz|rad/s|%)(?!\w))"
)
#: Most decimals of a number.
_MOST_DECIMALS = 6
#: Least p-value that is written as a number.
_LEAST_P = 1e-300


def quantity(value: float, error: float | None = None) -> str:
    """Return a number with at least four significant digits and spaces between thousands.

    With a small standard error it is written to the second digit of the error.
    """
    if not math.isfinite(value):
        return "-" if math.isnan(value) else ("∞" if value > 0 else "-∞")
    size = abs(value)
    if size and not 1e-4 <= size < 1e7:
        digits = _exponent(value, 15) + 1 - _exponent(error, 1) if error and error < size else 0
        return f"{value:.{min(15, digits)}e}" if digits > 4 else f"{value:.4g}"
    step = min(error, size / 100) / 10 if error else size / 1e3
    decimals = -math.floor(math.log10(step)) if step else 0
    if error:
        return _fixed(value, min(decimals, _reliable(value)))
    return _fixed(value, max(0, min(_MOST_DECIMALS, decimals)))


def with_error(value: float, error: float) -> str:
    """Return a number and its standard error, both to the second significant digit of the error.

    An error below the sixth decimal is a power of ten; very large and very small numbers share one with it.
    """
    if not (math.isfinite(value) and math.isfinite(error) and error > 0):
        return f"{quantity(value)} ± {quantity(error)}"
    digits = 1 - _exponent(error, 1)
    if value and not 1e-4 <= abs(value) < 1e7:
        decimals = max(1, min(15, _exponent(value, 15) + digits))
        mantissa, _, power = f"{value:.{decimals}e}".partition("e")
        return f"({mantissa} ± {error / 10.0 ** int(power):.{decimals}f})e{power}"
    if digits > _MOST_DECIMALS:
        return f"{_fixed(value, min(digits, _reliable(value)))} ± {error:.1e}"
    return f"{_fixed(value, digits)} ± {_fixed(error, digits)}"


def significant(value: float, digits: int) -> str:
    """Return a number with this many significant digits, trailing zeros included, for columns of a table."""
    text = f"{value:#.{digits}g}"
    return text.removesuffix(".")


def general(value: float, digits: int = 4) -> str:
    """Return a number with at most this many significant digits; "-" where it is unknown, ∞ if infinite."""
    return f"{value:.{digits}g}" if math.isfinite(value) else quantity(value)


def limit(value: float) -> str:
    """Return a gain or a degree, which may be infinite: with four digits, unless it is whole or short."""
    if not (math.isfinite(value) and abs(value) < 1e7):
        return quantity(value)
    if value == round(value):
        return _fixed(value + 0.0, 0)
    return short if float(short := f"{value:.4g}") == value else quantity(value)


def unit_text(unit: str) -> str:
    """Return a unit in mathematical notation: `N.s/m` is N·s/m, `m/s2` is m/s², `1` is nothing."""
    text = "" if unit == "1" else unit.replace(".", "·").replace("^0·5", "^½")
    return re.sub(r"(?<=[A-Za-z])\^?(-?\d)", lambda match: match[1].translate(_RAISED), text)


def sentence(text: str) -> str:
    """Return a text with a capital, and a full stop unless it ends with a stop or a question mark."""
    return f"{text[0].upper()}{text[1:]}{'' if text.endswith(('.', '?')) else '.'}"


def unbroken(text: str) -> str:
    """Return a text with no-break spaces within `± 2j`, `f_n = 3 Hz` and the like."""
    return _JOINT.sub("\N{NO-BREAK SPACE}", text)


def headed(name: str, unit: str) -> str:
    """Return a heading: a name, with its unit in brackets if it has one."""
    return f"{name} [{text}]" if (text := unit_text(unit)) else name


def counted(count: int, what: str) -> str:
    """Return a count with its noun: 1 bond, 2 keys, 3 frequencies."""
    several = f"{what[:-1]}ies" if what[-1] == "y" and what[-2] not in "aeou" else f"{what}s"
    return f"{count:,} {what if count == 1 else several}"


def span_text(low: float, high: float, digits: int = 4) -> str:
    """Return a range, or one number where both ends print alike."""
    first, last = f"{low:.{digits}g}", f"{high:.{digits}g}"
    return first if first == last else f"{first} … {last}"


def frequency_text(omega: float, digits: int = 4) -> str:
    """Return an angular frequency with its frequency in Hz, for sentences of scenes in either unit."""
    return f"{omega:.{digits}g} rad/s ({omega / math.tau:.{min(digits, 6)}g} Hz)"


def root_text(root: complex, *, hertz: bool = False) -> str:
    """Return a real root, or a conjugate pair, rad/s.

    `hertz` adds the unit, and behind a complex root its natural frequency f_n = |s| / 2π in Hz.
    """
    if root.imag == 0:
        said = f"{root.real:.4g}"
    else:
        said = f"± {root.imag:.4g}j" if root.real == 0 else f"{root.real:.4g} ± {root.imag:.4g}j"
    if not hertz:
        return said
    if root.imag == 0:
        return f"{said} rad/s"
    return f"{said} rad/s ({'f_n = ' if root.real else ''}{abs(root) / math.tau:.4g} Hz)"


def roots_text(roots: NDArray[np.complex128], *, hertz: bool = False) -> str:
    """Return a list of roots, conjugate pairs as one; `hertz` as of `root_text`."""
    if not len(roots):
        return "none"
    shown = [root_text(root, hertz=hertz) for root in roots if root.imag >= 0]
    more = f", … ({len(roots)} in all)" if len(shown) > MOST_ROOTS else ""
    return f"{', '.join(shown[:MOST_ROOTS])}{'' if hertz else ' rad/s'}{more}"


def percent(value: float) -> str:
    """Return a percentage with two significant digits, whole from a hundred on, a power of ten if tiny."""
    if not math.isfinite(value):
        return "-"
    value += 0.0  # no negative zero
    if 99.5 <= abs(value) < 1e6 or not value:  # 99.5 rounds to 100
        return f"{value:.0f} %"
    return f"{significant(value, 2) if abs(value) >= 1e-3 else f'{value:.1e}'} %"


def short_percent(value: float) -> str:
    """Return a percentage with at most two significant digits, whole from a hundred on."""
    return f"{value:.0f} %" if 99.5 <= abs(value) < 1e6 else f"{value:.2g} %"


def p_text(p: float, digits: int = 2) -> str:
    """Return a p-value as an equation, or as the inequality where it is too small for a number."""
    return f"p = {p:.{digits}g}" if not p < _LEAST_P else f"p < {_LEAST_P:g}"


def share_text(share: float) -> str:
    """Return a part of a whole as a percentage, with so many digits that less than all is not 100 %."""
    missing = 100 * (1 - share)
    if missing <= 0:
        return "100 %"
    decimals = max(2, -math.floor(math.log10(missing)))
    if decimals > _MOST_DECIMALS:
        return f"more than {100 - 10.0**-_MOST_DECIMALS:.{_MOST_DECIMALS}f} %"
    return f"{100 * share:.{decimals}f} %"


def time_text(seconds: float) -> str:
    """Return a time with its unit; "-" where it is unknown."""
    if math.isnan(seconds):
        return "-"
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= 0.9995 * size:  # which three digits show as 1
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"


def memory_text(size: float) -> str:
    """Return a size of memory given in bytes; "-" below the resolution of the system."""
    return f"{size / 1e6:.3g} MB" if size >= 1e5 else "-"


def _exponent(value: float, digits: int) -> int:
    """Return the power of ten of a number rounded to `digits` decimals."""
    return int(f"{value:.{digits}e}".partition("e")[2])


def _reliable(value: float) -> int:
    """Return the number of decimals that a double of this size holds."""
    return 15 - len(str(int(abs(value))))


def _fixed(value: float, decimals: int) -> str:
    """Return a number with spaces between thousands; negative `decimals` round to tens and so on."""
    return f"{round(value, decimals):,.{max(0, decimals)}f}".replace(",", " ")
