"""Grammar of expressions: a text is cut into tokens, parsed, and checked node by node."""

from __future__ import annotations

import ast
import keyword
import math
import re
import unicodedata
from fractions import Fraction

from dynid.errors import UsageError
from dynid.suggestions import did_you_mean

MAX_LENGTH = 1000
MAX_PARENTHESES = 100

# How many arguments each function takes; min and max take more, too.
FUNCTIONS = {"sqrt": 1, "exp": 1, "log": 1, "sin": 1, "cos": 1, "tan": 1, "abs": 1, "min": 2, "max": 2}
_ALLOWED = f"an expression is numbers, names, + - * / ** ( ), pi, and {' '.join(FUNCTIONS)}"

_BLANKS = str.maketrans("\t\n\r\f", "    ")
_TOKEN = re.compile(
    r"(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)|(?P<name>[^\W\d]\w*)|\*\*|[-+*/(),]|\s+"
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
    """An expression that is not arithmetic, or has no value.

    Parameters
    ----------
    sentence
        What is wrong.
    text
        The expression.
    column
        Where in it, from 1.
    """

    def __init__(self, sentence: str, text: str, column: int) -> None:
        shown = text if len(text) <= 60 else f"{text[:57]}…"
        super().__init__(f"{sentence} (at character {column} of '{shown}')")
        self.sentence = sentence
        self.column = column


def parse_arithmetic(text: str) -> tuple[ast.expr, ...]:
    """Check a text and give the nodes of its tree in the order of evaluation, the root last.

    Raises
    ------
    ExpressionError
        When the text is anything but arithmetic on numbers and names.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"an expression has at most {MAX_LENGTH} characters", text, MAX_LENGTH + 1)
    if not text.strip():
        raise ExpressionError("an expression is missing", text, 1)
    _check_tokens(text)
    try:
        # On one line and in parentheses blanks mean nothing; places come out shifted by one.
        tree = ast.parse(f"({text.translate(_BLANKS)})", mode="eval").body
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
        if isinstance(node, ast.BinOp):
            stack += [node.left, node.right]
        elif isinstance(node, ast.UnaryOp):
            stack.append(node.operand)
        elif isinstance(node, ast.Call):
            stack += node.args
    return tuple(reversed(order))


def column_of(text: str, node: ast.expr) -> int:
    """Give the place of a node in its expression, from 1."""
    before = f"({text})".encode()[: node.col_offset]
    return max(len(before.decode()), 1)


def operation_of(node: ast.expr) -> tuple[str, int]:
    """Give the operation of a checked node that is neither number nor name, and its operand count."""
    if isinstance(node, ast.BinOp):
        return _BINARY[type(node.op)], 2
    if isinstance(node, ast.UnaryOp):
        return _UNARY[type(node.op)], 1
    assert isinstance(node, ast.Call)
    assert isinstance(node.func, ast.Name)
    return node.func.id, len(node.args)


def literal_of(node: ast.Constant) -> Fraction:
    """Give a checked literal exactly, as the decimal it is written as."""
    return Fraction(repr(node.value))


def name_problem(name: str) -> str:
    """Say why a word cannot name a parameter; nothing when it can."""
    if keyword.iskeyword(name):
        return f"'{name}' is a reserved word; use another name, such as '{name}_0'"
    if not name.isidentifier():
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
    while position < len(text):
        column = position + 1
        match = _TOKEN.match(text, position)
        if match is None:
            raise ExpressionError(_strange(text[position]), text, column)
        token = match.group()
        if number and (match["name"] or match["number"]):
            sentence = (
                f"'{number}{token}' is neither a number nor a name; a product is written {number}*{token}"
            )
            raise ExpressionError(sentence, text, column - len(number))
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
        position = match.end()
    if opened:
        sentence = "this parenthesis is not closed; between { } an expression with a comma stands in quotes"
        raise ExpressionError(sentence, text, opened[-1])


def _strange(character: str) -> str:
    if character == "^":
        return "'^' is not a power; write **"
    return f"'{character}' has no meaning here; {_ALLOWED}"


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
