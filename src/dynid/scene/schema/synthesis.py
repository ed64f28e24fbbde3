"""Scenes of kind `synthesis`: a wanted driving-point impedance or admittance."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from dynid.bondgraph.analysis_request import Reading
from dynid.bondgraph.synthesis.forms import Form
from dynid.scene.schema.base import SceneModel, Section, once
from dynid.scene.schema.bond_graph import Domain
from dynid.scene.schema.quantities import Value, fault

_Coefficients = Annotated[list[Value], Field(min_length=1, max_length=101)]


class RationalModel(Section):
    """A rational function of s by its coefficients in descending powers."""

    numerator: _Coefficients
    denominator: _Coefficients

    @model_validator(mode="after")
    def _is_a_function(self) -> Self:
        if not any(coefficient.value for coefficient in self.denominator):
            raise fault("the denominator is zero")
        if not any(coefficient.value for coefficient in self.numerator):
            raise fault("the function is zero: there is nothing to synthesise")
        return self


class SynthesisScene(SceneModel):
    """A wanted driving-point function and the forms of its bond graph."""

    kind: Literal["synthesis"]
    impedance: RationalModel | None = None
    admittance: RationalModel | None = None
    forms: Annotated[list[Form], Field(min_length=1), once()] | None = None
    domain: Domain | None = None
    reading: Reading = "decimal"

    @model_validator(mode="after")
    def _one_function(self) -> Self:
        if (self.impedance is None) == (self.admittance is None):
            raise fault("a synthesis needs either an 'impedance' or an 'admittance'")
        return self

    @property
    def function(self) -> RationalModel:
        """The wanted function."""
        function = self.impedance or self.admittance
        assert function is not None
        return function
