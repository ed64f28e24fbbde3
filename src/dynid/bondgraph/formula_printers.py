"""Formula printers: one grammar for plain text that SymPy could read and for LaTeX."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterable
from fractions import Fraction
from functools import reduce
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from dynid.bondgraph.graph import Node


#: Precedence of a printed formula; the weaker is bracketed inside the stronger.
SUM, SIGN, PRODUCT, FRACTION, POWER, ATOM = range(6)

#: A formula as printed, and its precedence.
Printed = tuple[str, int]
ONE: Printed = ("1", ATOM)


class PrintedFraction(NamedTuple):
    """A formula as one fraction, so that a quotient of quotients is written as one quotient."""

    top: Printed
    bottom: Printed = ONE


class FormulaPrinter(ABC):
    """A notation of formulas; every method returns the printed text and its precedence."""

    @abstractmethod
    def bracket(self, printed: Printed, precedence: int) -> str:
        """Return a part, in brackets where its precedence is lower than needed."""

    @abstractmethod
    def name(self, name: str) -> Printed:
        """Write a name."""

    @abstractmethod
    def number(self, value: Fraction) -> PrintedFraction:
        """Write a number that the user wrote as a decimal."""

    @abstractmethod
    def call(self, function: str, operands: list[Printed]) -> Printed:
        """Write a function of an expression."""

    @abstractmethod
    def product(self, a: Printed, b: Printed) -> Printed:
        """Write a b."""

    @abstractmethod
    def quotient(self, a: Printed, b: Printed) -> Printed:
        """Write a / b."""

    @abstractmethod
    def power(self, base: Printed, exponent: Printed) -> Printed:
        """Write a base to an exponent."""

    def integer(self, number: int) -> Printed:
        """Write an integer."""
        return str(number), ATOM if number >= 0 else SIGN

    def negative(self, a: Printed) -> Printed:
        """Write -a."""
        return "-" + self.bracket(a, PRODUCT), SIGN

    def monomial(self, coefficient: int, powers: Iterable[tuple[Printed, int]]) -> Printed:
        """Write a term of a polynomial."""
        factors = [base if power == 1 else self.power(base, self.integer(power)) for base, power in powers]
        if abs(coefficient) != 1 or not factors:
            factors.insert(0, self.integer(abs(coefficient)))
        product = reduce(self.product, factors)
        return self.negative(product) if coefficient < 0 else product

    def value(self, node: Node) -> PrintedFraction:
        """Write the value of a node: by the expression it was given, else by the node's name."""
        if node.formula is None or not node.formula.names:
            return PrintedFraction(self.given(node.name))

        def leaf(item: Fraction | str) -> PrintedFraction:
            return PrintedFraction(self.given(item)) if isinstance(item, str) else self.number(item)

        written: PrintedFraction = node.formula.fold(leaf, self._apply)
        return written

    def given(self, name: str) -> Printed:
        """Write a name of the scene; `s` is the Laplace variable's, so that a value called so is s_value."""
        return self.name("s_value" if name == "s" else name)

    def whole(self, fraction: PrintedFraction) -> Printed:
        """Write a fraction."""
        top, bottom = fraction
        if bottom[1] == SIGN:
            top, bottom = self._opposite(top), _unsigned(bottom)
        return top if bottom == ONE else self.quotient(top, bottom)

    def times(self, a: PrintedFraction, b: PrintedFraction) -> PrintedFraction:
        """Multiply fractions."""
        return PrintedFraction(self._joined(a.top, b.top), self._joined(a.bottom, b.bottom))

    def divided(self, a: PrintedFraction, b: PrintedFraction) -> PrintedFraction:
        """Divide fractions."""
        return self.times(a, PrintedFraction(b.bottom, b.top))

    def squared(self, a: PrintedFraction) -> PrintedFraction:
        """Square a fraction."""
        parts = (_unsigned(printed) for printed in a)
        return PrintedFraction(
            *(printed if printed == ONE else self.power(printed, self.integer(2)) for printed in parts)
        )

    def opposite(self, a: PrintedFraction) -> PrintedFraction:
        """Turn the sign of a fraction."""
        return PrintedFraction(self._opposite(a.top), a.bottom)

    def _opposite(self, a: Printed) -> Printed:
        return _unsigned(a) if a[1] == SIGN else self.negative(a)

    def _joined(self, a: Printed, b: Printed) -> Printed:
        """Multiply without ones, a sign in front."""
        if SIGN in (a[1], b[1]):
            positive = self._joined(_unsigned(a), _unsigned(b))
            return positive if a[1] == b[1] else self.negative(positive)
        if ONE in (a, b):
            return b if a == ONE else a
        return self.power(a, self.integer(2)) if a == b else self.product(a, b)

    def _apply(self, operation: str, operands: list[PrintedFraction]) -> PrintedFraction:
        match operation, operands:
            case "*", [a, b]:
                return self.times(a, b)
            case "/", [a, b]:
                return self.divided(a, b)
            case "neg", [a]:
                return self.opposite(a)
            case "pos", [a]:
                return a
        written = [self.whole(operand) for operand in operands]
        binary = {"+": self.total, "-": self.difference, "**": self.power}
        printed = binary[operation](*written) if operation in binary else self.call(operation, written)
        return PrintedFraction(printed)

    def total(self, a: Printed, b: Printed) -> Printed:
        """Write a + b."""
        if b[1] == SIGN:
            return self.difference(a, _unsigned(b))
        return f"{self.bracket(a, SUM)} + {self.bracket(b, PRODUCT)}", SUM

    def difference(self, a: Printed, b: Printed) -> Printed:
        """Write a - b."""
        if b[1] == SIGN:
            return self.total(a, _unsigned(b))
        return f"{self.bracket(a, SUM)} - {self.bracket(b, PRODUCT)}", SUM

    def scaled(self, coefficient: Printed, variable: str) -> Printed:
        """Write a coefficient times a variable, where there is one."""
        if not variable:
            return coefficient
        if coefficient[0] in ("1", "-1"):
            return self.name(variable) if coefficient[0] == "1" else self.negative(self.name(variable))
        if coefficient[1] == SIGN:  # the sign is that of the term
            return self.negative(self.product((coefficient[0][1:], PRODUCT), self.name(variable)))
        return self.product(coefficient, self.name(variable))

    def listed(self, terms: list[Printed]) -> Printed:
        """Write a sum of terms, a leading sign as a subtraction."""
        if not terms:
            return self.integer(0)
        if len(terms) == 1:
            return terms[0]
        texts = [terms[0][0]]
        texts += [f" - {text[1:]}" if text.startswith("-") else f" + {text}" for text, _ in terms[1:]]
        return "".join(texts), SUM


class _TextPrinter(FormulaPrinter):
    """Plain text, as SymPy and Python read it."""

    def bracket(self, printed: Printed, precedence: int) -> str:
        """Return a part, in brackets where it needs them."""
        return printed[0] if printed[1] >= precedence else f"({printed[0]})"

    def name(self, name: str) -> Printed:
        """Write a name as it is."""
        return name, ATOM

    def number(self, value: Fraction) -> PrintedFraction:
        """Write a decimal."""
        text = repr(float(value)).removesuffix(".0")
        if Fraction(text) == value:
            return PrintedFraction((text, ATOM))
        return PrintedFraction(self.integer(value.numerator), self.integer(value.denominator))

    def call(self, function: str, operands: list[Printed]) -> Printed:
        """Write f(a, b)."""
        return f"{function}({', '.join(text for text, _ in operands)})", ATOM

    def product(self, a: Printed, b: Printed) -> Printed:
        """Write a*b."""
        return f"{self.bracket(a, PRODUCT)}*{self.bracket(b, POWER)}", PRODUCT

    def quotient(self, a: Printed, b: Printed) -> Printed:
        """Write a/b, its sign in front."""
        if a[1] == SIGN:
            return self.negative(self.quotient(_unsigned(a), b))
        return f"{self.bracket(a, PRODUCT)}/{self.bracket(b, POWER)}", PRODUCT

    def power(self, base: Printed, exponent: Printed) -> Printed:
        """Write base**exponent."""
        return f"{self.bracket(base, ATOM)}**{self.bracket(exponent, ATOM)}", POWER


class _LatexPrinter(FormulaPrinter):
    """LaTeX in mathematical mode."""

    def bracket(self, printed: Printed, precedence: int) -> str:
        r"""Return a part, in \left( \right) where it needs them."""
        return printed[0] if printed[1] >= precedence else rf"\left({printed[0]}\right)"

    def name(self, name: str) -> Printed:
        """Write a name with its subscript."""
        return latex_name(name), ATOM

    def number(self, value: Fraction) -> PrintedFraction:
        """Write an integer or a fraction."""
        return PrintedFraction(self.integer(value.numerator), self.integer(value.denominator))

    def product(self, a: Printed, b: Printed) -> Printed:
        """Write factors side by side; a dot before a digit."""
        left, right = self.bracket(a, PRODUCT), self.bracket(b, PRODUCT)
        return left + (r" \cdot " if right[0].isdigit() else r" \, ") + right, PRODUCT

    def quotient(self, a: Printed, b: Printed) -> Printed:
        """Write a fraction, its sign in front."""
        if a[1] == SIGN:
            return self.negative(self.quotient(_unsigned(a), b))
        return rf"\frac{{{a[0]}}}{{{b[0]}}}", FRACTION

    def power(self, base: Printed, exponent: Printed) -> Printed:
        """Write the exponent above."""
        return f"{self.bracket(base, ATOM)}^{{{exponent[0]}}}", POWER

    def call(self, function: str, operands: list[Printed]) -> Printed:
        """Write a function by its sign where it has one."""
        first = operands[0][0]
        match function:
            case "sqrt":
                return rf"\sqrt{{{first}}}", ATOM
            case "abs":
                return rf"\left|{first}\right|", ATOM
            case "exp":
                return rf"\mathrm{{e}}^{{{first}}}", POWER
        name = rf"\{'ln' if function == 'log' else function}"
        return rf"{name}\left({', '.join(text for text, _ in operands)}\right)", POWER


TEXT, LATEX = _TextPrinter(), _LatexPrinter()


def _unsigned(a: Printed) -> Printed:
    """Return a formula without its leading sign."""
    if a[1] != SIGN:
        return a
    return ONE if a[0] == "-1" else (a[0][1:], PRODUCT)


_GREEK = re.compile(
    "alpha|beta|[gG]amma|[dD]elta|epsilon|zeta|eta|[tT]heta|iota|kappa|[lL]ambda|mu|nu|[xX]i|[pP]i|rho|[sS]igma|tau|"
    "[uU]psilon|[pP]hi|chi|[pP]si|[oO]mega"
)


def latex_name(name: str) -> str:
    r"""Typeset a name: `m_s` as m_{s}, `k12` as k_{12}, `omega_in` as \omega_{\mathrm{in}}."""
    head, *below = [word for word in name.split("_") if word] or [name]
    match = re.fullmatch(r"([^\W\d_]+)(\d+)", head)
    if match:
        head, below = match[1], [match[2], *below]
    return _word(head) + (f"_{{{','.join(_word(word) for word in below)}}}" if below else "")


def _word(word: str) -> str:
    if _GREEK.fullmatch(word):
        return f"\\{word}"
    if len(word) == 1 or word.isdigit():
        return word if word != "_" else r"\_"
    upright = word.replace("_", r"\_").replace("-", "{-}")
    return rf"\mathrm{{{upright}}}"
