"""Numbers as a reader wants them: as many digits as mean something."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

#: Most roots that are listed.
MOST_ROOTS = 12
#: Decimals that a reader still counts.
_MOST_DECIMALS = 6


def quantity(value: float, error: float | None = None) -> str:
    """Write a number with four significant digits or more, thousands apart.

    Parameters
    ----------
    value
        The number.
    error
        Its standard error: the number is written to the error's second digit where that is finer, and not
        beyond what is asked for where it is large.
    """
    if not math.isfinite(value):
        return "-" if math.isnan(value) else ("∞" if value > 0 else "-∞")
    size = abs(value)
    if size and not 1e-4 <= size < 1e7:
        return f"{value:.4g}"
    step = min(error, size / 100) / 10 if error else size / 1e3
    decimals = -math.floor(math.log10(step)) if step else 0
    if error:
        return _fixed(value, min(decimals, _reliable(value)))
    return _fixed(value, max(0, min(_MOST_DECIMALS, decimals)))


def with_error(value: float, error: float) -> str:
    """Write a number and its standard error, both to the error's second significant digit.

    An error below the sixth decimal is written as a power of ten; so are both where the number is one.

    Parameters
    ----------
    value
        The number.
    error
        Its standard error.
    """
    if not (math.isfinite(value) and math.isfinite(error) and error > 0):
        return f"{quantity(value)} ± {quantity(error)}"
    digits = 1 - _exponent(error, 1)
    if value and not 1e-4 <= abs(value) < 1e7:
        return f"{value:.{max(1, min(15, _exponent(value, 15) + digits))}e} ± {error:.1e}"
    if digits > _MOST_DECIMALS:
        return f"{_fixed(value, min(digits, _reliable(value)))} ± {error:.1e}"
    return f"{_fixed(value, digits)} ± {_fixed(error, digits)}"


def limit(value: float) -> str:
    """Write a gain or a degree, which may be infinite."""
    return f"{value:.6g}".replace("inf", "∞")


def counted(count: int, what: str) -> str:
    """Write a number of things: 1 bond, 2 bonds, 3 frequencies."""
    several = f"{what[:-1]}ies" if what.endswith("cy") else f"{what}s"
    return f"{count:,} {what if count == 1 else several}"


def span_text(low: float, high: float, digits: int = 4) -> str:
    """Write a range, or one number where both ends print alike."""
    first, last = f"{low:.{digits}g}", f"{high:.{digits}g}"
    return first if first == last else f"{first} … {last}"


def root_text(root: complex) -> str:
    """Write a root, or the upper one of a conjugate pair for both."""
    if root.imag == 0:
        return f"{root.real:.4g}"
    return f"± {root.imag:.4g}j" if root.real == 0 else f"{root.real:.4g} ± {root.imag:.4g}j"


def roots_text(roots: NDArray[np.complex128]) -> str:
    """Write roots, conjugate pairs as one."""
    if not len(roots):
        return "none"
    shown = [root_text(root) for root in roots if root.imag >= 0]
    more = f", … ({len(roots)} in all)" if len(shown) > MOST_ROOTS else ""
    return ", ".join(shown[:MOST_ROOTS]) + more


def percent(value: float) -> str:
    """Write per cents with two significant digits, from a hundred on whole."""
    if not math.isfinite(value):
        return "-"
    value += 0.0  # no minus zero
    return f"{value:.0f} %" if 100 <= abs(value) < 1e6 else f"{value:.2g} %"


def time_text(seconds: float) -> str:
    """Write a time."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"


def memory_text(size: float) -> str:
    """Write a size of memory, bytes; what is below what the system tells apart is none."""
    return f"{size / 1e6:.3g} MB" if size >= 1e5 else "-"


def _exponent(value: float, digits: int) -> int:
    """Return the power of ten of a number as it is written with so many decimals."""
    return int(f"{value:.{digits}e}".partition("e")[2])


def _reliable(value: float) -> int:
    """Return how many decimals of a number a double holds."""
    return 15 - len(str(int(abs(value))))


def _fixed(value: float, decimals: int) -> str:
    """Write a number with these decimals, thousands apart; below 0 they are tens, hundreds and so on."""
    return f"{round(value, decimals):,.{max(0, decimals)}f}".replace(",", " ")
