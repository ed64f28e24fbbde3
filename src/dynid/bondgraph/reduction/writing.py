"""How formulas are written: one grammar, two hands (plain text that SymPy could read, and LaTeX)."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from fractions import Fraction
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynid.bondgraph.graph import Node

#: How tightly a written formula holds together; the weaker is bracketed inside the stronger.
SUM, SIGN, PRODUCT, FRACTION, POWER, ATOM = range(6)

#: A formula as written, and how tightly it holds together.
Written = tuple[str, int]


class Hand(ABC):
    """A way to write formulas; every method returns what is written and how tightly it holds together."""

    @abstractmethod
    def bracket(self, part: Written, least: int) -> str:
        """Return a part, in brackets where it holds together less tightly than needed."""

    @abstractmethod
    def name(self, name: str) -> Written:
        """Write a name."""

    @abstractmethod
    def value(self, node: Node) -> Written:
        """Write the value of a node: by the expression it was given, else by the node's name."""

    @abstractmethod
    def product(self, a: Written, b: Written) -> Written:
        """Write a b."""

    @abstractmethod
    def quotient(self, a: Written, b: Written) -> Written:
        """Write a / b."""

    @abstractmethod
    def power(self, base: Written, exponent: Written) -> Written:
        """Write a base to an exponent."""

    def integer(self, number: int) -> Written:
        """Write an integer."""
        return str(number), ATOM if number >= 0 else SIGN

    def negative(self, a: Written) -> Written:
        """Write -a."""
        return "-" + self.bracket(a, PRODUCT), SIGN

    def total(self, a: Written, b: Written) -> Written:
        """Write a + b."""
        return f"{self.bracket(a, SUM)} + {self.bracket(b, PRODUCT)}", SUM

    def difference(self, a: Written, b: Written) -> Written:
        """Write a - b."""
        return f"{self.bracket(a, SUM)} - {self.bracket(b, PRODUCT)}", SUM

    def scaled(self, coefficient: Written, variable: str) -> Written:
        """Write a coefficient times a variable, where there is one."""
        if not variable:
            return coefficient
        if coefficient[0] in ("1", "-1"):
            return self.name(variable) if coefficient[0] == "1" else self.negative(self.name(variable))
        if coefficient[1] == SIGN:  # the sign is that of the term
            return self.negative(self.product((coefficient[0][1:], PRODUCT), self.name(variable)))
        return self.product(coefficient, self.name(variable))

    def listed(self, terms: list[Written]) -> Written:
        """Write a sum of terms, a leading sign as a subtraction."""
        if not terms:
            return self.integer(0)
        if len(terms) == 1:
            return terms[0]
        texts = [terms[0][0]]
        texts += [f" - {text[1:]}" if text.startswith("-") else f" + {text}" for text, _ in terms[1:]]
        return "".join(texts), SUM


class Text(Hand):
    """Plain text, as SymPy and Python read it."""

    def bracket(self, part: Written, least: int) -> str:
        """Return a part, in brackets where it needs them."""
        return part[0] if part[1] >= least else f"({part[0]})"

    def name(self, name: str) -> Written:
        """Write a name as it is."""
        return name, ATOM

    def value(self, node: Node) -> Written:
        """Write the value of a node as the user wrote it."""
        return node.symbol, ATOM

    def product(self, a: Written, b: Written) -> Written:
        """Write a*b."""
        return f"{self.bracket(a, PRODUCT)}*{self.bracket(b, POWER)}", PRODUCT

    def quotient(self, a: Written, b: Written) -> Written:
        """Write a/b."""
        return f"{self.bracket(a, PRODUCT)}/{self.bracket(b, POWER)}", PRODUCT

    def power(self, base: Written, exponent: Written) -> Written:
        """Write base**exponent."""
        return f"{self.bracket(base, ATOM)}**{self.bracket(exponent, ATOM)}", POWER


class Latex(Hand):
    """LaTeX in mathematical mode."""

    def bracket(self, part: Written, least: int) -> str:
        r"""Return a part, in \left( \right) where it needs them."""
        return part[0] if part[1] >= least else rf"\left({part[0]}\right)"

    def name(self, name: str) -> Written:
        """Write a name with its subscript."""
        return latex_name(name), ATOM

    def value(self, node: Node) -> Written:
        """Write the value of a node by the tree of its expression."""
        if node.formula is None or not node.formula.names:
            return self.name(node.name)
        written: Written = node.formula.fold(self._leaf, self._apply)
        return written

    def product(self, a: Written, b: Written) -> Written:
        """Write factors side by side; a dot before a digit."""
        left, right = self.bracket(a, PRODUCT), self.bracket(b, PRODUCT)
        return left + (r" \cdot " if right[0].isdigit() else r" \, ") + right, PRODUCT

    def quotient(self, a: Written, b: Written) -> Written:
        """Write a fraction, its sign in front."""
        if a[1] == SIGN:
            return self.negative(self.quotient((a[0][1:], PRODUCT), b))
        return rf"\frac{{{a[0]}}}{{{b[0]}}}", FRACTION

    def power(self, base: Written, exponent: Written) -> Written:
        """Write the exponent above."""
        return f"{self.bracket(base, ATOM)}^{{{exponent[0]}}}", POWER

    def _leaf(self, item: Fraction | str) -> Written:
        if isinstance(item, str):
            return self.name(item)
        whole = self.integer(item.numerator)
        return whole if item.denominator == 1 else self.quotient(whole, self.integer(item.denominator))

    def _apply(self, operation: str, operands: list[Written]) -> Written:
        binary = {"+": self.total, "-": self.difference, "*": self.product, "/": self.quotient}
        if operation in binary:
            return binary[operation](*operands)
        first, *rest = operands
        match operation:
            case "**":
                return self.power(first, rest[0])
            case "pos":
                return first
            case "neg":
                return self.negative(first)
            case "sqrt":
                return rf"\sqrt{{{first[0]}}}", ATOM
            case "abs":
                return rf"\left|{first[0]}\right|", ATOM
            case "exp":
                return rf"\mathrm{{e}}^{{{first[0]}}}", POWER
        name = rf"\{'ln' if operation == 'log' else operation}"
        return rf"{name}\left({', '.join(text for text, _ in operands)}\right)", POWER


TEXT, LATEX = Text(), Latex()

_GREEK = re.compile(
    "alpha|beta|[gG]amma|[dD]elta|epsilon|zeta|eta|[tT]heta|iota|kappa|[lL]ambda|mu|nu|[xX]i|[pP]i|rho|[sS]igma|tau|"
    "[uU]psilon|[pP]hi|chi|[pP]si|[oO]mega"
)


def latex_name(name: str) -> str:
    r"""Typeset a name: `m_s` as m_{s}, `k12` as k_{12}, `omega_in` as \omega_{\mathrm{in}}."""
    head, *below = [part for part in name.split("_") if part] or [name]
    match = re.fullmatch(r"([^\W\d_]+)(\d+)", head)
    if match:
        head, below = match[1], [match[2], *below]
    return _word(head) + (f"_{{{','.join(_word(part) for part in below)}}}" if below else "")


def _word(word: str) -> str:
    if _GREEK.fullmatch(word):
        return f"\\{word}"
    if len(word) == 1 or word.isdigit():
        return word if word != "_" else r"\_"
    upright = word.replace("_", r"\_").replace("-", "{-}")
    return rf"\mathrm{{{upright}}}"
