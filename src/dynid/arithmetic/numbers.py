"""Real arithmetic: exact on fractions and irrational numbers, rounded on floats, and of bounded size.

An irrational number is a double and the term that it rounds. Computing with it is computing with doubles;
where a sum nearly cancels, it is decided exactly whether it is zero (`dynid.arithmetic.real_field`).
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Literal, Self

from dynid.arithmetic.terms import OutOfRangeError, Term

if TYPE_CHECKING:
    from dynid.arithmetic.real_field import RealField

__all__ = [
    "Irrational",
    "Number",
    "OutOfRangeError",
    "apply",
    "as_number",
    "coded",
    "decided",
    "field_of",
    "pi",
    "to_fraction",
]

MAX_BITS = 20_000
#: A sum, or a comparison, is decided exactly where this part of its terms or less is left of it: beyond it
#: the rounding errors of some 10^9 operations on doubles cannot reach.
CANCELLATION = 1e-6
#: Operations that may be zero although no operand is.
_VANISHING = frozenset({"+", "-", "sin", "cos", "tan", "log"})

#: The largest number of what is computed in floating point: its square, and the sum of 1e8 such, is finite.
LARGEST = 1e150

Number = Fraction | float


def to_fraction(value: float | Fraction, reading: Literal["decimal", "binary"] = "decimal") -> Fraction:
    """Return a finite number as a fraction.

    A float is read as the shortest decimal that prints it (0.1 is 1/10), or as its binary value.
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
    `OutOfRangeError` when it is not finite and real, too large, or undecidably near zero.
    """
    rounded = operands
    if any(isinstance(operand, Irrational) for operand in operands):
        if operation in ("pos", "min", "max"):
            return as_number(_OPERATIONS[operation](*operands))
        if operation == "**":
            base, exponent = operands
            # An exponent that is an integer by its exact meaning is one.
            if isinstance(exponent, Irrational) and abs(float(exponent) - round(float(exponent))) < 1e-6:
                operands = [base, decided(exponent.term)]
        rounded = [float(argument) if isinstance(argument, Irrational) else argument for argument in operands]
    try:
        result = _checked(_OPERATIONS[operation](*rounded))
    except OverflowError:
        raise OutOfRangeError("the result is too large for double precision") from None
    if isinstance(result, float) and all(isinstance(operand, Fraction) for operand in operands):
        if operation == "abs":
            return as_number(abs(operands[0]))
        return irrational(operation, operands, result)  # type: ignore[arg-type]
    return result


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
    integer = exponent == int(exponent)
    if base < 0 and not integer:
        raise OutOfRangeError("a negative number to a fractional power is not real")
    if isinstance(base, Fraction) and isinstance(exponent, Fraction) and integer:
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


# --- irrational numbers ---------------------------------------------------------------------------


def _operators(operation: str) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return an operator of irrational numbers, and the same with one on its right."""
    return (
        lambda a, b, _modulus=None: _applied(operation, a, b),
        lambda b, a, _modulus=None: _applied(operation, a, b),
    )


def _comparison(relation: Callable[[int, int], bool]) -> Callable[[Any, Any], bool]:
    return lambda a, b: relation(_sign(a, b), 0)


class Irrational(Fraction):
    """A number that is the value of a term.

    As a `Fraction` it is the shortest decimal that prints the double, or what the term was coded as
    (`RealField.coded`); its operations go on with the term.
    """

    __slots__ = ("_coded", "_double", "term")

    _coded: tuple[int, int] | None
    _double: float
    term: Term

    def __new__(cls, term: Term, double: float, coded: Fraction | None = None) -> Self:
        """Return the value of a term, which rounds to a double."""
        self = object.__new__(cls)
        self.term, self._double = term, double
        self._coded = None if coded is None else (coded.numerator, coded.denominator)
        return self

    @property
    def _ratio(self) -> tuple[int, int]:
        if self._coded is None:
            decimal = Fraction(repr(self._double))
            self._coded = decimal.numerator, decimal.denominator
        return self._coded

    @property
    def _numerator(self) -> int:  # in place of the slot of `Fraction`
        return self._ratio[0]

    @property
    def _denominator(self) -> int:
        return self._ratio[1]

    def __reduce__(self) -> Any:
        return type(self), (self.term, self._double, None if self._coded is None else Fraction(*self._coded))

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: Any) -> Self:
        return self

    def __float__(self) -> float:
        return self._double

    def __hash__(self) -> int:  # type: ignore[override]  # of `complex`
        return hash(self._double)

    def __bool__(self) -> bool:
        return True

    def __eq__(self, other: object) -> bool:
        return _number(other) and _sign(self, other) == 0

    __lt__ = _comparison(operator.lt)
    __le__ = _comparison(operator.le)
    __gt__ = _comparison(operator.gt)
    __ge__ = _comparison(operator.ge)
    __add__, __radd__ = _operators("+")
    __sub__, __rsub__ = _operators("-")
    __mul__, __rmul__ = _operators("*")
    __truediv__, __rtruediv__ = _operators("/")
    __pow__, __rpow__ = _operators("**")

    def __neg__(self) -> Any:
        return _applied("neg", self)

    def __pos__(self) -> Self:
        return self

    def __abs__(self) -> Any:
        return -self if self._double < 0 else self


def _number(value: object) -> bool:
    return isinstance(value, int | float | Fraction)


def _applied(operation: str, *operands: Any) -> Any:
    """Return the result of an operator, of which an operand is irrational."""
    if not all(map(_number, operands)):
        return NotImplemented
    return apply(
        operation, [Fraction(operand) if isinstance(operand, int) else operand for operand in operands]
    )


def pi() -> Irrational:
    """Return pi."""
    return Irrational(_PI, math.pi)


_PI = Term("pi")


def irrational(operation: str, numbers: Iterable[Fraction], double: float) -> Fraction:
    """Return the value of an operation on exact numbers of which a double is known."""
    arguments = tuple(numbers)
    operands = (argument.term if isinstance(argument, Irrational) else argument for argument in arguments)
    term = Term(operation, tuple(operands))
    scale = max(abs(float(argument)) for argument in arguments) if operation in ("+", "-") else 1.0
    if operation in _VANISHING and abs(double) <= CANCELLATION * scale:
        return decided(term)
    if operation == "tan" and abs(double) >= 1 / CANCELLATION:
        return decided(term)
    return Irrational(term, double) if double else Fraction(0)


def decided(term: Term) -> Fraction:
    """Return the value of a term: a plain fraction where it is rational, else correctly rounded."""
    from dynid.arithmetic.real_field import RealField

    value = RealField([term]).simplified(term)
    return Irrational(term, value) if isinstance(value, float) else value


def field_of(numbers: Iterable[object], order: int = 0) -> RealField | None:
    """Return the field of numbers, for a system of some order; None where all are rational."""
    terms = [number.term for number in numbers if isinstance(number, Irrational)]
    if not terms:
        return None
    from dynid.arithmetic.real_field import RealField

    return RealField(terms, order)


def coded(number: Fraction, field: RealField) -> Fraction:
    """Return a number of a field, coded: a plain fraction where it is rational."""
    if not isinstance(number, Irrational):
        return number
    value = field.simplified(number.term)
    return Irrational(number.term, value, field.coded(number.term)) if isinstance(value, float) else value


def rounded(number: Fraction) -> Fraction:
    """Return a plain fraction: the number, or an irrational one rounded to `ROUNDED_BITS` bits."""
    if not isinstance(number, Irrational):
        return Fraction(number)
    from flint import ctx

    from dynid.arithmetic.real_field import ROUNDED_BITS, RealField

    with ctx.workprec(ROUNDED_BITS):
        middle = RealField([number.term]).enclosure(number.term).mid().fmpq()
    return Fraction(int(middle.p), int(middle.q))


def _sign(fraction: Fraction, irrational: Any) -> int:
    """Return the sign of the difference of two numbers."""
    try:
        a, b = float(fraction), float(irrational)
    except OverflowError:  # of a fraction or an integer
        return -1 if irrational > 0 else 1
    if abs(a - b) > CANCELLATION * max(abs(a), abs(b)) or isinstance(irrational, float):
        return (a > b) - (a < b)
    difference = fraction - (Fraction(irrational) if isinstance(irrational, int) else irrational)
    return (difference > 0) - (difference < 0)
