"""Real arithmetic on fractions and floats: exact where the operation is, and of bounded size."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from fractions import Fraction
from typing import Any, Literal

from dynid.arithmetic.irrational import Irrational, decided, irrational

MAX_BITS = 20_000

#: The largest number of what is computed in floating point: its square, and the sum of 1e8 such, is finite.
LARGEST = 1e150

Number = Fraction | float


class OutOfRangeError(ArithmeticError):
    """An operation has no finite real value of reasonable size; the message is one sentence."""


def to_fraction(value: float | Fraction, reading: Literal["decimal", "binary"] = "decimal") -> Fraction:
    """Return a number as a fraction.

    Parameters
    ----------
    value
        A finite number.
    reading
        How a float is read: as the shortest decimal that prints it (0.1 is 1/10), or as its binary value.

    Raises
    ------
    OutOfRangeError
        When it is not a finite number.
    """
    checked = as_number(value)
    if isinstance(checked, Irrational) and reading == "binary":
        return Fraction(float(checked))
    if isinstance(checked, Fraction):
        return checked
    return Fraction(repr(checked)) if reading == "decimal" else Fraction(checked)


def as_number(value: object) -> Number:
    """Return a value as a `Fraction` or a float, checked to be a finite real number."""
    if isinstance(value, bool) or not isinstance(value, int | float | Fraction):
        raise OutOfRangeError(
            f"{str(value).lower() if isinstance(value, bool) else repr(value)} is not a number"
        )
    if isinstance(value, Irrational):
        return value
    return _checked(float(value) if isinstance(value, float) else Fraction(value))


def apply(operation: str, operands: list[Number]) -> Number:
    """Return the result of an operation or function of expressions on numbers.

    It is exact where all operands are: a fraction, or an irrational number that keeps its meaning.

    Raises
    ------
    OutOfRangeError
        When there is no finite real result, it is too large, or it cannot be decided whether it is zero.
    """
    rounded = operands
    if any(isinstance(operand, Irrational) for operand in operands):
        if operation in ("pos", "min", "max"):
            return as_number(_OPERATIONS[operation](*operands))
        if operation == "**":
            operands = _exact_power(*operands)
        rounded = [float(each) if isinstance(each, Irrational) else each for each in operands]
    try:
        result = _checked(_OPERATIONS[operation](*rounded))
    except OverflowError:
        raise OutOfRangeError("the result is too large for double precision") from None
    if isinstance(result, float) and all(isinstance(operand, Fraction) for operand in operands):
        if operation == "abs":
            return abs(operands[0])
        return irrational(operation, operands, result)  # type: ignore[arg-type]
    return result


def _exact_power(base: Number, exponent: Number) -> list[Number]:
    """Return the operands of a power; an exponent that is an integer by its exact meaning is one."""
    if isinstance(exponent, Irrational) and abs(float(exponent) - round(float(exponent))) < 1e-6:
        exponent = decided(exponent.term)
    return [base, exponent]


def _checked(value: Number) -> Number:
    if isinstance(value, float):
        if math.isnan(value):
            raise OutOfRangeError("the value is not a number (nan)")
        if math.isinf(value):
            raise OutOfRangeError("the value is infinite, or too large for double precision")
    elif _bits(value) > MAX_BITS:
        raise OutOfRangeError(_TOO_LONG)
    return value


_TOO_LONG = f"the exact value has more than {MAX_BITS:,} binary digits"


def _bits(value: Fraction) -> int:
    return max(value.numerator.bit_length(), value.denominator.bit_length())


def _float(value: Number) -> float:
    result = float(value)
    if result == 0 and value != 0:
        raise OutOfRangeError("the value is too small for double precision")
    return result


def _alike(function: Callable[[Any, Any], Any]) -> Callable[[Number, Number], Number]:
    def both(a: Number, b: Number) -> Number:
        if isinstance(a, Fraction) and isinstance(b, Fraction):
            return Fraction(function(a, b))
        return float(function(_float(a), _float(b)))

    return both


def _divide(a: Number, b: Number) -> Number:
    if b == 0:
        raise OutOfRangeError("division by zero")
    return _alike(operator.truediv)(a, b)


def _power(base: Number, exponent: Number) -> Number:
    if base == 0 and exponent < 0:
        raise OutOfRangeError("division by zero: zero to a negative power")
    whole = exponent == int(exponent)
    if base < 0 and not whole:
        raise OutOfRangeError("a negative number to a fractional power is not real")
    if isinstance(base, Fraction) and isinstance(exponent, Fraction) and whole:
        # A number of n bits is at least 2**(n - 1), so that the size is known before the work is done.
        if (_bits(base) - 1) * abs(exponent) > MAX_BITS:
            raise OutOfRangeError(_TOO_LONG)
        return Fraction(base ** int(exponent))
    return math.pow(_float(base), _float(exponent))


def _sqrt(value: Number) -> Number:
    if value < 0:
        raise OutOfRangeError("the square root of a negative number is not real")
    if isinstance(value, Fraction):
        root = Fraction(math.isqrt(value.numerator), math.isqrt(value.denominator))
        if root * root == value:
            return root
    return math.sqrt(_float(value))


def _log(value: Number) -> float:
    if value <= 0:
        raise OutOfRangeError("the logarithm of zero or of a negative number does not exist")
    return math.log(_float(value))


def _through_float(function: Callable[[float], float]) -> Callable[[Number], float]:
    return lambda value: function(_float(value))


_OPERATIONS: dict[str, Callable[..., Number]] = {
    "+": _alike(operator.add),
    "-": _alike(operator.sub),
    "*": _alike(operator.mul),
    "/": _divide,
    "**": _power,
    "neg": operator.neg,
    "pos": operator.pos,
    "sqrt": _sqrt,
    "exp": _through_float(math.exp),
    "log": _log,
    "sin": _through_float(math.sin),
    "cos": _through_float(math.cos),
    "tan": _through_float(math.tan),
    "abs": abs,
    "min": min,
    "max": max,
}
