"""Units of recorded values and of amplitudes, and sensitivities of sensors."""

from __future__ import annotations

import re
from typing import Annotated, Self

from pydantic import AfterValidator, model_validator

from dynid.scene.schema.base import Section
from dynid.scene.schema.quantities import Value, fault
from dynid.units import UnknownUnitError, readings, unit_fits


def _is_unit(text: str) -> str:
    try:
        readings(text)
    except UnknownUnitError as error:
        raise fault(str(error)) from None
    return text


UnitName = Annotated[str, AfterValidator(_is_unit)]
"""A unit such as `g`, `mm/s^2` or `(m/s2)/kN`."""


class SensitivityModel(Section):
    """Sensitivity of a sensor: recorded value over measured quantity, such as 0.1 V/g."""

    value: Value
    unit: UnitName

    @model_validator(mode="after")
    def _shows_something(self) -> Self:
        if self.value.value == 0:
            raise fault("the sensitivity is 0, and the sensor would show nothing")
        return self

    @property
    def recorded(self) -> str:
        """The unit recorded where nothing else gives it: the voltage or charge above the fraction line.

        `V` of `V.s/m` and `mV` of `mV/g`; all that stands there if nothing is a voltage or charge.
        """
        above = self.unit.partition("/")[0].strip("() ")
        electric = (one for one in re.split(r"[.·*\s-]+", above) if unit_fits(one, ("V", "C")))
        return next(electric, above)
