"""Quantities of a scene: numbers, parameter names or expressions, checked and resolved while validating."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Annotated, Any, NamedTuple

from pydantic import ValidationError, ValidationInfo
from pydantic_core import InitErrorDetails, PydanticCustomError
from pydantic_core.core_schema import CoreSchema, with_info_plain_validator_function

from dynid.arithmetic.dependent import Dependent, Real, substituted
from dynid.arithmetic.expression import Expression, ExpressionError, Number, parse, to_fraction
from dynid.arithmetic.numbers import LARGEST
from dynid.suggestions import did_you_mean


@dataclass(frozen=True)
class Quantity:
    """A resolved quantity."""

    value: Number  #: Its value at the reference values of the parameters: exact where the expression is.
    expression: Expression | None = None  #: The expression it was written as; None for a bare number.
    #: The same as a function of unknown and considered parameters; None where it depends on none.
    dependent: Dependent | None = field(default=None, compare=False)
    variable: bool = False  #: Whether it depends on variables of the graph; then `value` is a placeholder.

    @property
    def real(self) -> Real:
        """Its value, or the number that depends on parameters where it does: what models are built with."""
        return float(self.value) if self.dependent is None else self.dependent

    def __float__(self) -> float:
        return float(self.value)

    @property
    def exact(self) -> Fraction:
        """The value as a fraction; a float by the shortest decimal that prints it."""
        return self.value if type(self.value) is Fraction else to_fraction(self.value)


@dataclass(frozen=True)
class SceneNames:
    """Meaning of the names in a scene, collected before it is validated."""

    #: Values of the parameters that have one; unknown and considered ones have their reference values.
    parameters: Mapping[str, Number] = field(default_factory=dict)
    #: Those that are unknown or considered, or depend on such.
    dependent: Mapping[str, Dependent] = field(default_factory=dict)
    signed: frozenset[str] = frozenset()  #: Parameters of `scale: linear`, which may be zero or negative.
    linear: bool = False  #: Whether laws are refused: the linear graph is identified.
    #: Whether the scene identifies them, and its quantities depend on them; else these have their values.
    identifying: bool = False
    #: Parameters that are defined but have no value; they are reported once, where they are defined.
    faulty: frozenset[str] = frozenset()
    #: Node types by name (bond graphs); empty where they could not be read, which is reported once.
    nodes: Mapping[str, str] = field(default_factory=dict)
    #: References and setpoints of feedback loops, with the types of sources.
    references: Mapping[str, str] = field(default_factory=dict)
    complete: bool = True  #: Whether the parameters could be read at all; else any name may be one.

    @property
    def variables(self) -> Mapping[str, str]:
        """The nodes, and the sources of the closed loops."""
        return {**self.nodes, **self.references} if self.references else self.nodes


def fault(message: str) -> PydanticCustomError:
    """Return the error that a validator raises to report `message` at its place."""
    return PydanticCustomError("dynid", "{message}", {"message": message})


Located = tuple[tuple[str | int, ...], str]
"""A fault: its path from the value that is validated, and a message."""

#: In a path: the mapping or list around; at its end: the fault is that of the key, not of its value.
AROUND, AT_KEY = "..", "[key]"


def raise_faults(faults: Iterable[Located]) -> None:
    """Raise the faults of several keys of a section together, each at its path."""
    errors = [InitErrorDetails(type=fault(message), loc=path, input=None) for path, message in faults]
    if errors:
        raise ValidationError.from_exception_data("scene", errors)


def names_of(info: ValidationInfo) -> SceneNames:
    """Return the names of the scene that is being validated."""
    context = info.context
    return context if isinstance(context, SceneNames) else SceneNames()


def resolve(raw: Any, info: ValidationInfo, *, exact: bool = False) -> Quantity:
    """Resolve a quantity: a number, a parameter's name, or an expression of both.

    One that is `exact` enters exact arithmetic; others enter sums of squares, and their size is limited.
    """
    if isinstance(raw, bool) or not isinstance(raw, int | float | str):
        kinds = {bool: "true or false", dict: "a mapping", list: "a list", type(None): "nothing"}
        kind_of_value = next((word for kind, word in kinds.items() if isinstance(raw, kind)), repr(raw))
        raise fault(f"{kind_of_value} where a number, a parameter or an expression belongs")
    if isinstance(raw, int | float):
        if isinstance(raw, float) and not math.isfinite(raw):
            raise fault(f"{raw} is not a finite number")
        return _in_range(Quantity(to_fraction(raw)), exact)
    names = names_of(info)
    try:
        expression = parse(raw)
        known = names.parameters.keys() | names.faulty
        unknown = sorted(expression.names - known)
        if unknown and names.complete:
            parameters = [*names.parameters, *names.faulty]
            hints = (f"no parameter '{name}'{did_you_mean(name, parameters)}" for name in unknown)
            raise fault("; ".join(hints))
        if unknown or expression.names & names.faulty:
            return Quantity(Fraction(1))  # reported where it is defined; with any value the other checks run
        value = expression.evaluate(names.parameters)
        dependent = None
        if names.identifying and not expression.names.isdisjoint(names.dependent):
            values = names.parameters
            reals = {name: names.dependent.get(name, values[name]) for name in expression.names}
            dependent = substituted(expression, reals)
        return _in_range(Quantity(value, expression, dependent), exact)
    except ExpressionError as error:
        raise PydanticCustomError("expression", "{message}", {"message": str(error)}) from None


def _in_range(quantity: Quantity, exact: bool) -> Quantity:
    """Return a quantity, checked not to become infinity or zero in double precision, nor its square."""
    try:
        if float(quantity) == 0 != quantity.value:
            raise fault("the value is too close to zero for double precision")
    except OverflowError:
        raise fault("the value is too large for double precision") from None
    if not exact and abs(float(quantity)) > LARGEST:
        raise fault(f"{float(quantity):g} is too large: numbers reach {LARGEST:g}, whose square is finite")
    return quantity


class _Range(NamedTuple):
    """The values that a quantity may have, what is wrong with others, and the keywords of JSON Schema."""

    holds: Callable[[Number], bool]
    message: str
    bounds: dict[str, int]


_ANY = _Range(lambda _: True, "", {})
_POSITIVE = _Range(lambda value: value > 0, "is not positive", {"exclusiveMinimum": 0})
_NOT_NEGATIVE = _Range(lambda value: value >= 0, "is negative", {"minimum": 0})


class _In:
    """Annotation of a quantity in a range, without the cost of pydantic's own validators in dumping.

    `uncertain`: it may depend on unknown and considered parameters; `signed`: a value that depends on a
    parameter of `scale: linear` need not lie in the range; `remedy`: what to write instead.
    """

    def __init__(
        self, values: _Range, *, uncertain: bool = False, signed: bool = False, remedy: str = ""
    ) -> None:
        self._values, self._uncertain, self._signed, self._remedy = values, uncertain, signed, remedy

    def _check(self, raw: Any, info: ValidationInfo) -> Quantity:
        quantity = resolve(raw, info)
        depends = quantity.dependent.names if quantity.dependent is not None else frozenset()
        signed = self._signed and not names_of(info).signed.isdisjoint(depends)
        if not (signed or self._values.holds(quantity.value)):
            raise fault(f"{float(quantity):g} {self._values.message}")
        if depends and not self._uncertain:
            shown = ", ".join(f"'{name}'" for name in sorted(depends)[:3]) + ", …" * (len(depends) > 3)
            message = (
                f"this depends on {shown}, unknown or known with uncertainty; here a number belongs, or "
            )
            raise fault(f"{message}an expression of known parameters{self._remedy}")
        return quantity

    def __get_pydantic_core_schema__(self, _source: Any, _handler: Any) -> CoreSchema:
        return with_info_plain_validator_function(self._check)

    def __get_pydantic_json_schema__(self, _schema: CoreSchema, _handler: Any) -> dict[str, Any]:
        text = "a number, a parameter or an expression"
        return {"type": ["number", "string"], **self._values.bounds, "description": text}


Value = Annotated[Quantity, _In(_ANY)]
Positive = Annotated[Quantity, _In(_POSITIVE)]
NotNegative = Annotated[Quantity, _In(_NOT_NEGATIVE)]

# Quantities of models, which may depend on unknown and considered parameters.
Uncertain = Annotated[Quantity, _In(_ANY, uncertain=True)]
UncertainPositive = Annotated[Quantity, _In(_POSITIVE, uncertain=True)]
UncertainNotNegative = Annotated[Quantity, _In(_NOT_NEGATIVE, uncertain=True)]
UncertainSpring = Annotated[Quantity, _In(_NOT_NEGATIVE, uncertain=True, signed=True)]
"""A stiffness, damping or factor: not negative, but where it depends on a parameter of `scale: linear`."""
Start = Annotated[Quantity, _In(_POSITIVE, remedy="; to share an unknown, write its name alone, as `k: kb`")]
"""The start of an unknown that has no name of its own."""
