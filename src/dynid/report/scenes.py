"""The scene that a result came from, as plain data: checked when it was run, and not checked again."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from dynid.errors import DynidError, UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from dynid.result import Result
    from dynid.scene.arithmetic.expression import Expression, Number

_REMEDY = "Run the scene again."


@dataclass(frozen=True)
class PlainScene:
    """What a scene says.

    Parameters
    ----------
    data
        Texts, numbers, truth values, lists and mappings.
    parameters
        The values of its parameters.
    """

    data: dict[str, Any]
    parameters: Mapping[str, Number]

    def number(self, raw: Any) -> float:
        """Return the value of a quantity: a number, a parameter's name, or an expression."""
        expression = self.expression(raw)
        return float(raw if expression is None else expression.evaluate(self.parameters))

    def exact(self, raw: Any) -> Fraction:
        """Return the same as a fraction; a float by the shortest decimal that prints it."""
        from dynid.scene.arithmetic.expression import to_fraction

        expression = self.expression(raw)
        return to_fraction(raw if expression is None else expression.evaluate(self.parameters))

    def expression(self, raw: Any) -> Expression | None:
        """Return the expression that a quantity is written as; None for a bare number."""
        from dynid.scene.arithmetic.expression import parse

        return parse(raw) if isinstance(raw, str) else None


def scene_of(result: Result) -> PlainScene:
    """Return the scene whose text a result bears.

    Raises
    ------
    UsageError
        Where it bears none, or one that this dynid does not read.
    """
    from dynid.scene.arithmetic.expression import resolve_parameters

    data = plain_data(str(result.attrs.get("scene", "")))
    if not data:
        raise UsageError("the result does not hold the text of its scene", remedy=_REMEDY)
    with readable():
        given = {str(name): value for name, value in data.get("parameters", {}).items()}
        return PlainScene(data, resolve_parameters(given)[0])


@lru_cache(maxsize=4)
def plain_data(text: str) -> dict[str, Any]:
    """Return what the text of a scene says, in today's format; nothing where it cannot be read."""
    if not text:
        return {}
    from dynid.errors import SceneError
    from dynid.scene.formats import as_current
    from dynid.scene.yaml.source import parse_source

    try:
        data = as_current(parse_source(text, "<scene of the result>")).data
    except SceneError:
        return {}
    return data if isinstance(data, dict) else {}


@contextmanager
def readable() -> Iterator[None]:
    """Say in words that a scene is not what it was when it was run: a file may have been changed since."""
    try:
        yield
    except DynidError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        problem = f"the scene in the result cannot be read ({type(error).__name__}: {error})"
        raise UsageError(problem, remedy=_REMEDY) from error


def listed(value: Any) -> list[Any]:
    """Return a list, also where one entry stands for itself or nothing is given."""
    return value if isinstance(value, list) else [] if value is None else [value]
