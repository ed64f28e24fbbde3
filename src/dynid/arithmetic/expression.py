"""Arithmetic expressions of numbers and names: their grammar, their values, and parameters by name.

Nothing is ever executed: a text is cut into tokens, parsed, and checked node by node. Its operations on
numbers are in `numbers`; an expression can also be folded over another kind of number, such as polynomials.
"""

from __future__ import annotations

import ast
import keyword
import math
import re
import unicodedata
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property, lru_cache
from typing import Any, TypeVar

from dynid.arithmetic.numbers import Number, OutOfRangeError, apply, as_number, pi, to_fraction
from dynid.errors import UsageError
from dynid.suggestions import did_you_mean, without_decimal_comma

__all__ = [
    "FUNCTIONS",
    "Expression",
    "ExpressionError",
    "Number",
    "OutOfRangeError",
    "parse",
    "resolve_parameters",
    "to_fraction",
]

T = TypeVar("T")

MAX_LENGTH = 1000
MAX_PARENTHESES = 100

# Stands for the points in names such as `m1.R` while Python's parser reads them; no name may hold it.
_POINT = "\N{MIDDLE DOT}"
# How many arguments each function takes; min and max take more, too.
FUNCTIONS = {"sqrt": 1, "exp": 1, "log": 1, "sin": 1, "cos": 1, "tan": 1, "abs": 1, "min": 2, "max": 2}
_ALLOWED = f"an expression is numbers, names, + - * / ** ( ), pi, and {' '.join(FUNCTIONS)}"

_NO_UNITS = "a value is a number in SI units, without its unit"

_BLANKS = str.maketrans("\t\n\r\f", "    ")
_TOKEN = re.compile(
    r"(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)|(?P<name>[^\W\d]\w*(?:\.\w+)*)|\*\*|[-+*/(),]|\s+"
)
_BINARY: dict[type[ast.operator], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Pow: "**",
}
_UNARY: dict[type[ast.unaryop], str] = {ast.UAdd: "pos", ast.USub: "neg"}


class ExpressionError(UsageError):
    """An expression that is not arithmetic, or has no value, and the column (from 1) where."""

    def __init__(self, sentence: str, text: str, column: int) -> None:
        shown = text if len(text) <= 60 else f"{text[:57]}…"
        super().__init__(f"{sentence} (at character {column} of '{shown}')")
        self.sentence = sentence
        self.column = column


def _parse_arithmetic(text: str) -> tuple[ast.expr, ...]:
    """Return the checked nodes of the syntax tree of a text in the order of evaluation, the root last."""
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"an expression has at most {MAX_LENGTH} characters", text, MAX_LENGTH + 1)
    if not text.strip():
        raise ExpressionError("an expression is missing", text, 1)
    if hint := without_decimal_comma(text):
        raise ExpressionError(f"a comma has no meaning in a number; {hint}", text, 1)
    _check_tokens(text)
    try:
        # On one line and in parentheses blanks mean nothing; places come out shifted by one.
        tree = ast.parse(f"({_readable(text)})", mode="eval").body
    except (SyntaxError, RecursionError, MemoryError) as error:
        column = min(max((getattr(error, "offset", None) or 2) - 1, 1), len(text))
        raise ExpressionError(
            "this is not arithmetic; an operand or operator is missing", text, column
        ) from None
    # Check every node, and list operands before operations; on a stack, so that depth needs no recursion.
    order: list[ast.expr] = []
    stack = [tree]
    while stack:
        node = stack.pop()
        problem = _node_problem(node)
        if problem:
            raise ExpressionError(problem, text, column_of(text, node))
        order.append(node)
        if isinstance(node, ast.Name):
            node.id = node.id.replace(_POINT, ".")
        elif isinstance(node, ast.BinOp):
            stack += [node.left, node.right]
        elif isinstance(node, ast.UnaryOp):
            stack.append(node.operand)
        elif isinstance(node, ast.Call):
            stack += node.args
    return tuple(reversed(order))


def _readable(text: str) -> str:
    """Return a text in which Python's parser finds one line and names without points; no place moves."""
    return _TOKEN.sub(
        lambda match: match.group().replace(".", _POINT) if match["name"] else match.group(), text
    ).translate(_BLANKS)


def renamed(text: str, names: Mapping[str, str]) -> str:
    """Return an expression with other names of some of its parameters; a text that is none stays."""

    def other(match: re.Match[str]) -> str:
        return names.get(match.group(), match.group()) if match["name"] else match.group()

    return _TOKEN.sub(other, text)


def column_of(text: str, node: ast.expr) -> int:
    """Return the column of a node in its expression, from 1."""
    before = f"({_readable(text)})".encode()[: node.col_offset]
    return max(len(before.decode()), 1)


def _operation_of(node: ast.expr) -> tuple[str, int]:
    """Return the operation of a checked node that is neither number nor name, and its operand count."""
    if isinstance(node, ast.BinOp):
        return _BINARY[type(node.op)], 2
    if isinstance(node, ast.UnaryOp):
        return _UNARY[type(node.op)], 1
    assert isinstance(node, ast.Call)
    assert isinstance(node.func, ast.Name)
    return node.func.id, len(node.args)


def name_problem(name: str) -> str:
    """Return why a word cannot name a parameter; empty where it can."""
    if keyword.iskeyword(name):
        return f"'{name}' is a reserved word; use another name, such as '{name}_0'"
    if not name.replace(".", _POINT).isidentifier():
        return f"'{name}' cannot be a name; use letters, digits and _, beginning with a letter"
    if name in FUNCTIONS or name == "pi":
        return f"'{name}' is the name of a {'constant' if name == 'pi' else 'function'}; use another"
    return _spelling_problem(name)


def _spelling_problem(name: str) -> str:
    if name.startswith("__"):
        return f"'{name}' begins with two underscores; use another name"
    usual = unicodedata.normalize("NFKC", name)
    return "" if usual == name else f"'{name}' has a character that looks like another; write '{usual}'"


def _check_tokens(text: str) -> None:
    opened: list[int] = []
    position, number = 0, ""
    before = ""  # the operand before blanks
    while position < len(text):
        column = position + 1
        match = _TOKEN.match(text, position)
        if match is None:
            character = text[position]
            sentence = f"'{character}' has no meaning here; {_ALLOWED}"
            if character == "^":
                sentence = "'^' is not a power; write **"
            raise ExpressionError(sentence, text, column)
        token = match.group()
        if match["name"] or match["number"]:
            _check_operator(text, position, token, number, before)
        if match["name"]:
            problem = f"'{token}' has no meaning here; {_ALLOWED}" if keyword.iskeyword(token) else ""
            if problem := problem or _spelling_problem(token):
                raise ExpressionError(problem, text, column)
        if token == "(":
            opened.append(column)
            if len(opened) > MAX_PARENTHESES:
                raise ExpressionError(f"more than {MAX_PARENTHESES} nested parentheses", text, column)
        elif token == ")":
            if not opened:
                raise ExpressionError("this parenthesis closes nothing", text, column)
            opened.pop()
        number = match["number"] or ""
        before = match["name"] or number or (before if token.isspace() else "")
        position = match.end()
    if opened:
        sentence = "this parenthesis is not closed; between { } an expression with a comma stands in quotes"
        raise ExpressionError(sentence, text, opened[-1])


def _check_operator(text: str, position: int, token: str, number: str, before: str) -> None:
    """Raise where no operator stands before an operand: behind a `number`, or behind blanks and `before`."""
    column = position + 1
    if number:
        sentence = f"'{number}{token}' is neither a number nor a name; a product is written {number}*{token}"
        raise ExpressionError(f"{sentence}; {_NO_UNITS}", text, column - len(number))
    if re.match(r"[.0-9]", before) and not re.match(r"[.0-9]", token):
        sentence = f"'{before} {token}': {_NO_UNITS}; a product is written {before}*{token}"
        raise ExpressionError(sentence, text, column)
    if before and not keyword.iskeyword(token):
        raise ExpressionError(f"an operator is missing between '{before}' and '{token}'", text, column)


def _node_problem(node: ast.expr) -> str:
    if isinstance(node, ast.Constant):
        finite = isinstance(node.value, int) or (isinstance(node.value, float) and math.isfinite(node.value))
        return "" if finite else "the number is too large for double precision"
    if isinstance(node, ast.Name):
        return f"'{node.id}' is a function; write {node.id}(…)" if node.id in FUNCTIONS else ""
    if isinstance(node, ast.Call):
        if not isinstance(node.func, ast.Name):
            return "a product needs a *; only functions stand before a parenthesis"
        name, count = node.func.id, len(node.args)
        if name not in FUNCTIONS:
            hint = did_you_mean(name, FUNCTIONS)
            return f"no function '{name}'{hint or '; a product needs a *'}"
        if any(isinstance(argument, ast.Starred) for argument in node.args):
            return f"{name} takes numbers, without *"
        if count == FUNCTIONS[name] or (FUNCTIONS[name] == 2 and count > 2):
            return ""
        return (
            f"{name} takes {'one argument' if FUNCTIONS[name] == 1 else 'two arguments or more'}, not {count}"
        )
    if isinstance(node, ast.BinOp):
        return (
            "" if type(node.op) in _BINARY else "this operator has no meaning here; a quotient is written /"
        )
    if isinstance(node, ast.UnaryOp) and type(node.op) in _UNARY:
        return ""
    if isinstance(node, ast.Tuple) and node.elts:
        return "a comma has no meaning here; decimals stand behind a point"
    return f"this has no meaning here; {_ALLOWED}"


@dataclass(frozen=True)
class Expression:
    """A checked arithmetic expression.

    Its steps are the nodes of its syntax tree in the order of evaluation: numbers, names, arithmetic and
    calls of the known functions, and nothing else.
    """

    text: str
    steps: tuple[ast.expr, ...] = field(compare=False)  # nodes of equal texts are not equal

    @cached_property
    def names(self) -> frozenset[str]:
        """The names that need a value."""
        return frozenset(node.id for node in self.steps if isinstance(node, ast.Name)) - {"pi"}

    def fold(self, leaf: Callable[[Fraction | str], T], apply: Callable[[str, list[T]], T]) -> T:
        """Evaluate over any kind of number, without recursion.

        `leaf` gives a literal (`Fraction`) or a name (`str`; `pi` is one) a value, `apply` operations (`+ - *
        / **`, `neg`, `pos`, or a function's name); what it raises as `OutOfRangeError` becomes an
        `ExpressionError`.
        """
        stack: list[T] = []
        for node in self.steps:
            try:
                if isinstance(node, ast.Constant | ast.Name):
                    stack.append(leaf(node.id if isinstance(node, ast.Name) else Fraction(repr(node.value))))
                else:
                    operation, count = _operation_of(node)
                    operands = stack[len(stack) - count :]
                    del stack[len(stack) - count :]
                    stack.append(apply(operation, operands))
            except OutOfRangeError as error:
                raise ExpressionError(str(error), self.text, column_of(self.text, node)) from None
        return stack[0]

    def evaluate(self, env: Mapping[str, Number]) -> Number:
        """Return the value: exact (a `Fraction`, which may be irrational) unless a float is involved.

        `ExpressionError` when a name has no value, or the value is not finite, real and of reasonable size.
        """

        def leaf(item: Fraction | str) -> Number:
            if isinstance(item, Fraction):
                return item
            if item == "pi":
                return pi()
            if item not in env:
                raise OutOfRangeError(f"no parameter '{item}'{did_you_mean(item, env)}")
            return as_number(env[item])

        return self.fold(leaf, apply)


@lru_cache(maxsize=1024)  # copies of a model repeat their expressions
def parse(text: str) -> Expression:
    """Return the expression of a text, which is arithmetic on numbers, names, `pi` and known functions."""
    return Expression(text, _parse_arithmetic(text))


def resolve_parameters(raw: Mapping[str, Any]) -> tuple[dict[str, Number], dict[str, str]]:
    """Return the values of parameters, which may refer to each other in any order, and messages of faults.

    Numbers are read as the decimals they are written as. A parameter that depends on one at fault has neither
    value nor message.
    """
    faults: dict[str, str] = {}
    expressions: dict[str, Expression] = {}
    values: dict[str, Number] = {}
    for name, value in raw.items():
        try:
            problem = f"{name} cannot be a name; it is not a word"
            if problem := name_problem(name) if isinstance(name, str) else problem:
                raise OutOfRangeError(problem)
            if isinstance(value, str):
                expression = parse(value)
                for unknown in sorted(used for used in expression.names if used not in raw):
                    raise OutOfRangeError(f"no parameter '{unknown}'{did_you_mean(unknown, map(str, raw))}")
                expressions[name] = expression
            elif value is None or isinstance(value, list | dict):
                raise OutOfRangeError("a parameter is a number or an expression")
            else:
                values[name] = to_fraction(value)
        except (ExpressionError, OutOfRangeError) as error:
            faults[str(name)] = str(error)
    _evaluate_in_order(expressions, values, faults)
    waiting = {
        name: expressions[name].names for name in expressions if name not in values and name not in faults
    }
    for cycle in _cycles(waiting):
        chain = [*cycle, cycle[0]]
        if len(chain) > 8:  # each message repeats the cycle; in full, they would grow with its square
            chain[4:-3] = [f"({len(chain) - 7} more)"]
        faults |= {name: f"'{name}' is defined by itself: {' -> '.join(chain)}" for name in cycle}
    return values, faults


def _evaluate_in_order(
    expressions: Mapping[str, Expression], values: dict[str, Number], faults: dict[str, str]
) -> None:
    missing = {name: sum(used not in values for used in expressions[name].names) for name in expressions}
    users: dict[str, list[str]] = defaultdict(list)
    for name, expression in expressions.items():
        for used in expression.names:
            users[used].append(name)
    ready = [name for name, count in missing.items() if count == 0]
    while ready:
        name = ready.pop()
        try:
            values[name] = expressions[name].evaluate(values)
        except ExpressionError as error:
            faults[name] = str(error)
            continue
        for user in users[name]:
            missing[user] -= 1
            if missing[user] == 0:
                ready.append(user)


def _cycles(waiting: Mapping[str, Iterable[str]]) -> list[list[str]]:
    """Return the cycles of definitions, following from each the first one that it refers to."""
    following = {
        name: min((need for need in needs if need in waiting), default="") for name, needs in waiting.items()
    }
    cycles: list[list[str]] = []
    walked: set[str] = set()
    for start in sorted(waiting):
        chain: dict[str, None] = {}
        name = start
        while name and name not in walked and name not in chain:
            chain[name] = None
            name = following[name]
        if name in chain:
            names = list(chain)
            cycles.append(names[names.index(name) :])
        walked |= chain.keys()
    return cycles
