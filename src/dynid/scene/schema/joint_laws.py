"""Nonlinear laws of joints in a scene, by their kinds."""

from __future__ import annotations

from fractions import Fraction
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PlainValidator,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticCustomError

from dynid.arithmetic.expression import ExpressionError, parse
from dynid.scene.schema.base import Section
from dynid.scene.schema.joints import LawParameterModel, LawValue
from dynid.scene.schema.quantities import Quantity, fault, names_of, resolve
from dynid.scene.schema.structure import Direction
from dynid.suggestions import did_you_mean


def _only(values: str) -> Any:
    """Return a check that a parameter is positive, or not negative."""

    def check(parameter: LawParameterModel) -> LawParameterModel:
        for key, number in parameter.numbers.items():
            if number < 0 or (number == 0 and (values == "positive" or key != "value")):
                said = "positive" if values == "positive" or key != "value" else "0 or positive"
                raise fault(f"{number:g} is not {said}")
        return parameter

    return AfterValidator(check)


_PositiveLawValue = Annotated[LawValue, _only("positive")]
_LawValueOrZero = Annotated[LawValue, _only("not negative")]
_Exponent = Annotated[float, Field(ge=0, le=20)]


class _LawModel(Section):
    """A law of a joint; between points of one component of it."""

    component: Direction | None = None


class PowerLaw(_LawModel):
    """``a |d|^d |v|^v``, times the signs of the variables in `signed`."""

    kind: Literal["power"]
    d: _Exponent = 0.0
    v: _Exponent = 0.0
    signed: list[Literal["d", "v"]] = Field(default=[], max_length=2)
    a: LawValue

    @model_validator(mode="after")
    def _is_smooth(self) -> Self:
        for name, exponent in (("d", self.d), ("v", self.v)):
            if 0 < exponent < 1:
                raise fault(
                    f"the exponent {exponent:g} of '{name}' has an infinite slope at 0; take 1 or more"
                )
            if exponent == 0 and name in self.signed:
                raise fault(
                    f"the sign of '{name}' alone makes the force jump at 0; give '{name}' an exponent "
                    "of 1 or more, or describe slip by a law of kind 'jenkins'"
                )
        if self.d == 0 and self.v == 0:
            raise fault("a power law has an exponent of 'd', of 'v', or of both")
        return self


class CubicLaw(_LawModel):
    """``k3 d^3``."""

    kind: Literal["cubic"]
    k3: LawValue


class QuadraticDampingLaw(_LawModel):
    """``c2 |v| v``."""

    kind: Literal["quadratic_damping"]
    c2: _PositiveLawValue


class CoulombLaw(_LawModel):
    """``fs tanh(v/v0)``."""

    kind: Literal["coulomb"]
    fs: _PositiveLawValue
    v0: _PositiveLawValue


class IwanLaw(_LawModel):
    """Sliders whose slip forces are distributed, by four parameters."""

    kind: Literal["iwan"]
    kt: _PositiveLawValue
    fs: _PositiveLawValue
    chi: LawValue
    beta: _LawValueOrZero

    @field_validator("chi")
    @classmethod
    def _is_integrable(cls, chi: LawParameterModel) -> LawParameterModel:
        for number in chi.numbers.values():
            if number <= -1:
                raise fault(f"{number:g} is not above -1; there the sliders would have no stiffness together")
        return chi


class JenkinsLaw(_LawModel):
    """A spring and a slider in series."""

    kind: Literal["jenkins"]
    kt: _PositiveLawValue
    fs: _PositiveLawValue


class BoucWenLaw(_LawModel):
    """``kz z`` with ``z' = v (1 - alpha |z|^n)`` for v z > 0 and ``v (1 + delta |z|^n)`` for v z < 0."""

    kind: Literal["bouc_wen"]
    kz: _PositiveLawValue
    alpha: LawValue
    delta: LawValue
    n: Annotated[float, Field(ge=1, le=20)] = 1.0


class GapLaw(_LawModel):
    """A spring and a damper beyond a clearance."""

    kind: Literal["gap"]
    kg: _PositiveLawValue
    clearance: _LawValueOrZero
    cg: _LawValueOrZero = Field(default_factory=lambda: LawParameterModel.model_construct(value=Quantity(0)))
    side: Literal["both", "positive", "negative"] = "both"


class _ForceExpression(BaseModel):
    """The expression of a force: its text, and the parameters of the scene in it."""

    model_config = ConfigDict(arbitrary_types_allowed=True)

    text: str
    parameters: dict[str, Quantity]


def _force(raw: Any, info: ValidationInfo) -> _ForceExpression:
    """Read a force as an expression of d, v and parameters, which vanishes at rest."""
    if not isinstance(raw, str):
        raise fault("the force is an expression of the deflection d and its rate v, such as 1.0e9*d**3")
    names = names_of(info)
    try:
        expression = parse(raw)
    except ExpressionError as error:
        raise PydanticCustomError("expression", "{message}", {"message": str(error)}) from None
    parameters = {*names.parameters, *names.faulty}
    for name in sorted({"d", "v"} & parameters):
        raise fault(
            f"'{name}' is the {'deflection' if name == 'd' else 'rate'} here, and a parameter: rename that"
        )
    if expression.names.isdisjoint({"d", "v"}):
        raise fault("the force depends neither on the deflection d nor on its rate v")
    used = sorted(expression.names - {"d", "v"})
    if names.complete and (missing := [name for name in used if name not in parameters]):
        hints = (f"no parameter '{name}'{did_you_mean(name, [*parameters, 'd', 'v'])}" for name in missing)
        raise fault("; ".join(hints))
    quantities = {name: resolve(name, info) for name in used}
    try:
        rest = {"d": Fraction(0), "v": Fraction(0)}
        at_rest = expression.evaluate({**{name: quantities[name].value for name in used}, **rest})
    except ExpressionError as error:
        raise fault(
            f"the force has no value at rest, d = v = 0 ({error}): it jumps or is infinite there; "
            "describe slip by a law of kind 'jenkins'"
        ) from None
    if at_rest:
        raise fault(
            f"the force is {float(at_rest):g} at rest, d = v = 0; it has to vanish there: subtract it"
        )
    return _ForceExpression(text=raw, parameters=quantities)


class ExpressionLaw(_LawModel):
    """A force as an expression of deflection d, its rate v and parameters."""

    kind: Literal["expression"]
    f: Annotated[_ForceExpression, PlainValidator(_force), WithJsonSchema({"type": "string"})]
