"""Scenes of kind `modal-analysis`: frequency responses, or records with or without excitation, and a band."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, Self

from pydantic import Field, model_validator

from dynid.scene.schema.base import SceneModel, Section
from dynid.scene.schema.measurement import ChannelModel, MeasurementModel
from dynid.scene.schema.quantities import AT_KEY, Located, NotNegative, Positive, fault, raise_faults
from dynid.scene.schema.references import sections
from dynid.scene.schema.signals import Signals


class ModalBandModel(Section):
    """The band in which modes are sought."""

    low: NotNegative
    high: Positive
    unit: Literal["rad/s", "Hz"] = "rad/s"

    @model_validator(mode="after")
    def _is_a_range(self) -> Self:
        if float(self.high) <= float(self.low):
            raise fault("'high' is not above 'low'")
        return self


class ModalOptionsModel(Section):
    """What is known of the shapes."""

    shapes: Literal["complex", "real"] = "complex"
    reciprocal: bool | Literal["auto"] = "auto"


class ModalAnalysisScene(SceneModel):
    """Modes, with their covariance, from measured frequency responses or from records of time.

    Records without `excitation` are responses to ambient excitation.
    """

    kind: Literal["modal-analysis"]
    excitation: Signals = []
    measurement: MeasurementModel
    band: ModalBandModel
    exponential: Positive | None = None
    segment: Positive | None = None
    modes: ModalOptionsModel = Field(default_factory=ModalOptionsModel)

    @property
    def output_only(self) -> bool:
        """True of records without excitation."""
        return self.measurement.frf is None and not self.excitation and not self._excited

    @property
    def _excited(self) -> list[bool]:
        """Of each record with an excitation of its own True; empty where none has one."""
        excited = [bool(record.excitation) for record in self.measurement.each]
        return excited if any(excited) else []

    @model_validator(mode="after")
    def _is_measured(self) -> Self:
        raise_faults([*self._measurement_faults(), *self._channel_faults()])
        return self

    def _measurement_faults(self) -> Iterator[Located]:
        measurement = self.measurement
        if measurement.modes is not None:
            yield ("measurement", "modes", AT_KEY), "modes are what is sought; leave 'modes' out"
        frf = measurement.frf
        if frf is not None and frf.simulate is not None:
            yield ("measurement", "frf", "simulate", AT_KEY), _NO_MODEL
        if frf is not None and frf.band is not None:
            yield ("measurement", "frf", "band", AT_KEY), "the band of a modal analysis is its key 'band'"
        if frf is not None and self.excitation:
            yield ("excitation", AT_KEY), "frequency responses are of unit forces; leave 'excitation' out"
        if any(record.simulate is not None for record in measurement.each):
            yield ("measurement", AT_KEY), _NO_MODEL
        if frf is not None and self.segment is not None:
            yield ("segment", AT_KEY), "a 'segment' is of records of time; leave it out"
        if frf is None and not self.excitation and not all(self._excited):
            yield ("measurement", AT_KEY), _MIXED
        if self.output_only:
            yield from self._output_faults()

    def _output_faults(self) -> Iterator[Located]:
        for key, what in (("exponential", "windows impacts"), ("segment", "is of records with forces")):
            if getattr(self, key) is not None:
                yield (key, AT_KEY), f"'{key}' {what}, and these have no 'excitation'; leave it out"
        if "modes" in self.model_fields_set:
            yield ("modes", AT_KEY), "modes of responses alone are complex and of no scale; leave 'modes' out"

    def _channel_faults(self) -> Iterator[Located]:
        for path, channel in sections(self, ChannelModel):
            if channel.output is not None:
                yield (*path, "output", AT_KEY), "a shape is of DOFs; write 'dof' and 'quantity'"
            if getattr(channel, "clock", None) is not None:
                said = "channels of a modal analysis have one clock; leave it out, and resample the channel"
                yield (*path, "clock", AT_KEY), said
            if channel.dofs is not None:
                yield (*path, "dofs", AT_KEY), "a shape has one DOF a channel; write 'dof'"


_MIXED = "some records have an 'excitation' and others none; analyse them apart"
_NO_MODEL = "there is no model to simulate; read the measurement from a 'file'"
