"""Small wrongs in a module, one at a time."""

from __future__ import annotations

import ast
import copy
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

_COMPARED = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE), ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,), ast.NotIn: (ast.In,),
}  # fmt: skip
_ARITHMETIC = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult, ast.Pow: ast.Mult, ast.BitOr: ast.BitAnd, ast.BitAnd: ast.BitOr,
}  # fmt: skip
_BLOCKS = ("body", "orelse", "finalbody", "handlers", "cases")
_NOT_VALUES = {*_BLOCKS, "annotation", "returns", "decorator_list"}


@dataclass(frozen=True)
class Mutant:
    """One wrong.

    `number` among those of its module; `key` says what it is, wherever in the file it stands; `lines` are
    those of the statement, which a test must reach; `names` are what a statement outside functions defines.
    """

    module: str
    number: int
    key: str
    lines: range
    names: tuple[str, ...]


class _Change(NamedTuple):
    """Something new in the place of a node's field, or of an entry of it, in a statement of a scope."""

    statement: ast.stmt
    scope: str
    holder: ast.AST
    field: str
    index: int | None
    new: object

    def swap(self) -> _Change:
        """Make the change; return the one that takes it back."""
        held = getattr(self.holder, self.field)
        if self.index is None:
            setattr(self.holder, self.field, self.new)
            return self._replace(new=held)
        old, held[self.index] = held[self.index], self.new
        return self._replace(new=old)


def mutants(module: str, source: str) -> list[Mutant]:
    """Return every wrong of a module's source."""
    found, seen = [], Counter()
    for number, change in enumerate(_of_block(ast.parse(source), "")):
        statement = change.statement
        before = _head(statement)
        back = change.swap()
        after = "pass" if isinstance(change.new, ast.Pass) else _head(statement)
        back.swap()
        key = f"{module}:{change.scope}: {' → '.join(_differing(before, after))}"
        seen[key] += 1
        if seen[key] > 1:
            key += f" #{seen[key]}"
        body = next((block for name in _BLOCKS if (block := getattr(statement, name, None))), None)
        last = getattr(body[0], "lineno", statement.end_lineno) - 1 if body else statement.end_lineno
        found.append(Mutant(module, number, key, range(statement.lineno, max(last, statement.lineno) + 1),
                            () if change.scope else _defined(statement)))  # fmt: skip
    return found


def mutated(source: str, number: int) -> ast.Module:
    """Return a module with one of its wrongs."""
    tree = ast.parse(source)
    change = next(change for place, change in enumerate(_of_block(tree, "")) if place == number)
    change.swap()
    return ast.fix_missing_locations(tree)


def _head(statement: ast.stmt) -> str:
    """Write a statement without the statements inside it."""
    alone = copy.copy(statement)
    for name in _BLOCKS:
        if getattr(alone, name, None):
            setattr(alone, name, [ast.Pass()] if name == "body" else [])
    return " ".join(ast.unparse(alone).removesuffix("pass").split())


def _differing(before: str, after: str, around: int = 24) -> tuple[str, str]:
    """Return two texts without what they have in common, but for some characters around the difference."""
    if after == "pass":
        return before[:80], after
    start = _alike(before, after)
    end = min(_alike(before[::-1], after[::-1]), len(before) - start, len(after) - start)
    left, right = max(start - around, 0), max(end - around, 0)
    return before[left : len(before) - right], after[left : len(after) - right]


def _alike(one: str, other: str) -> int:
    """Count the characters that two texts begin with."""
    pairs = enumerate(zip(one, other, strict=False))
    return next((place for place, (a, b) in pairs if a != b), min(len(one), len(other)))


def _defined(statement: ast.stmt) -> tuple[str, ...]:
    return tuple(
        n.id for n in ast.walk(statement) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
    )


def _of_block(owner: ast.AST, scope: str, *, in_class: bool = False) -> Iterator[_Change]:
    """Yield the wrongs of all statements of a block, whether of a module, a function or a loop."""
    for field in _BLOCKS:
        for index, statement in enumerate(getattr(owner, field, [])):
            inner = f"{scope}.{statement.name}".lstrip(".") if hasattr(statement, "name") else scope
            if isinstance(statement, ast.ClassDef):
                yield from _of_block(statement, inner, in_class=True)
            elif isinstance(statement, ast.FunctionDef):
                for place in ("defaults", "kw_defaults"):
                    yield from _of_field(statement, inner, statement.args, place)
                yield from _of_block(statement, inner)
            elif isinstance(statement, ast.ExceptHandler | ast.match_case):
                yield from _of_block(statement, scope)
            elif not in_class and not _declares(statement, scope):
                if scope and _removable(statement):
                    yield _Change(
                        statement, scope, owner, field, index, ast.copy_location(ast.Pass(), statement)
                    )
                yield from _of_node(statement, scope, statement)
                yield from _of_block(statement, scope)


def _declares(statement: ast.stmt, scope: str) -> bool:
    """Tell whether a statement says something about types and names, or is a docstring."""
    if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
        return True
    plain = isinstance(statement, ast.Assign) and "TypeVar" not in ast.dump(statement.value)
    return not scope and not plain


def _removable(statement: ast.stmt) -> bool:
    if isinstance(statement, ast.Assign):
        return not isinstance(statement.targets[0], ast.Name | ast.Tuple)
    if isinstance(statement, ast.Expr):
        return isinstance(statement.value, ast.Call)
    return isinstance(statement, ast.AugAssign | ast.Delete | ast.Raise | ast.Continue | ast.Break)


def _of_node(statement: ast.stmt, scope: str, node: ast.AST) -> Iterator[_Change]:
    """Yield the wrongs of a node and of what is in it, but for the statements there."""
    for field, index, new in _alternatives(node):
        yield _Change(statement, scope, node, field, index, new)
    if not isinstance(node, ast.JoinedStr):  # the wording of a message
        for field in node._fields:
            if field not in _NOT_VALUES:
                yield from _of_field(statement, scope, node, field)


def _of_field(statement: ast.stmt, scope: str, holder: ast.AST, field: str) -> Iterator[_Change]:
    value = getattr(holder, field, None)
    for index, child in enumerate(value if isinstance(value, list) else [value]):
        if isinstance(child, ast.AST) and not isinstance(child, ast.stmt):
            for new in _instead(child):
                yield _Change(
                    statement, scope, holder, field, index if isinstance(value, list) else None, new
                )
            yield from _of_node(statement, scope, child)


def _alternatives(node: ast.AST) -> Iterator[tuple[str, int | None, object]]:
    """Yield what a node may have instead: a field, the entry of it, what is new there."""
    match node:
        case ast.Compare(ops=ops):
            for index, op in enumerate(ops):
                yield from (("ops", index, other()) for other in _COMPARED[type(op)])
        case ast.BinOp(op=op) | ast.AugAssign(op=op) if type(op) in _ARITHMETIC:
            yield "op", None, _ARITHMETIC[type(op)]()
        case ast.BoolOp(op=op):
            yield "op", None, ast.And() if isinstance(op, ast.Or) else ast.Or()
        case ast.Call(func=ast.Attribute(attr="add" | "mul"), args=[_, _]):
            pass  # sums and products are the same either way round
        case ast.Call(args=[first, second, *rest]):
            if ast.dump(first) != ast.dump(second) and not isinstance(first, ast.Starred):
                yield "args", None, [second, first, *rest]
        case ast.comprehension(ifs=[_]):
            yield "ifs", None, []
        case ast.If(test=test) | ast.IfExp(test=test) if isinstance(
            test, ast.Name | ast.Call | ast.Attribute
        ):
            yield "test", None, ast.UnaryOp(ast.Not(), test)
        case ast.Return(value=ast.expr() as value) if ast.dump(value) != ast.dump(ast.Constant(None)):
            yield "value", None, ast.Constant(None)


def _instead(node: ast.AST) -> Iterator[ast.expr]:
    """Yield what may stand in the place of a node."""
    match node:
        case ast.UnaryOp(op=ast.Not() | ast.USub() | ast.Invert(), operand=operand):
            yield operand
        case ast.Constant(value=bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(value=int(value) | float(value)):
            yield ast.Constant(value + 1 if isinstance(value, int) or value == 0 else 2 * value)
        case ast.Constant(value=str(value)) if value and " " not in value:  # a word, no sentence
            yield ast.Constant(f"{value}x")
