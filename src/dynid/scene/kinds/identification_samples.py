"""Samples of an identification that differ in noise, starts or true values, run together.

What they share is computed once: the scene is read and checked, the structure assembled and reduced, the
record without noise simulated. Of each sample only the collected arrays are computed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, cast

from dynid.arithmetic.numbers import OutOfRangeError, to_fraction
from dynid.errors import DynidError
from dynid.identification.problem import SharedRecords
from dynid.identification.records.measurement import Experiment, Simulation
from dynid.result import Selection
from dynid.scene.batch import NotShared, Overrides
from dynid.scene.kinds.identification import Setting, estimates_alone, identified, setting
from dynid.scene.kinds.measurements import experiments
from dynid.scene.kinds.parts import structure_of
from dynid.scene.load import Scene
from dynid.scene.outcomes import SampleOutcome, SampleOutcomes, gather
from dynid.scene.schema.identification import IdentificationScene
from dynid.scene.schema.quantities import Quantity
from dynid.structure.model import StructuralModel


class _VariedValue(NamedTuple):
    """A varied value: a key of the noise (no joint), or the start or true value of a parameter."""

    joint: str
    letter: str
    name: str


def _varied(model: IdentificationScene, path: str) -> _VariedValue:
    measurement = model.measurement
    match path.split("."):
        case ["measurement", "simulate", ("seed" | "noise_ratio" | "noise") as name]:
            simulate = None if measurement is None or measurement.records else measurement.simulate
            if isinstance(getattr(simulate, name, None), int | Quantity):
                return _VariedValue("", "", name)
        case ["joints", joint, ("k" | "c") as letter, ("start" | "true") as name] if joint in model.joints:
            if getattr(getattr(model.joints[joint], letter), name, None) is not None:
                return _VariedValue(joint, letter, name)
    raise NotShared(f"{path} is no seed, noise, or start or true value of a joint")


class IdentificationSamples:
    """Samples of one identification from records that differ in seeds, noise, starts and true values."""

    def __init__(
        self, scene: Scene[IdentificationScene], paths: Sequence[str], collect: tuple[str, ...]
    ) -> None:
        model = scene.model
        if model.graph is not None:
            raise NotShared("samples of a graph are identified one by one")
        self._varied = {path: _varied(model, path) for path in paths}
        measurement = model.measurement
        from_records = measurement is not None and measurement.modes is None and measurement.frf is None
        if not (from_records and estimates_alone(model, Selection("identification", collect))):
            raise NotShared("more than an identification from records is asked for")
        self._scene, self._collect = scene, collect
        self._structure = structure_of(scene)
        self._setting = setting(scene, self._structure)
        self._same = not any(varied.joint for varied in self._varied.values())
        names = {varied.name for varied in self._varied.values()}
        self._seeds = names == {"seed"} and all(
            isinstance(record.measurement.source, Simulation) for record in self._setting.measurements
        )
        self._common: SharedRecords | None = None
        truth = self._setting.truth
        if isinstance(truth, StructuralModel) and truth.basis is None and "true" not in names:
            self._common = SharedRecords.of(*self._setting[:3], same=self._same)

    def run(self, overrides: Overrides) -> SampleOutcomes:
        """Return the outcomes of samples; those with other values, or an error, are pending."""
        return SampleOutcomes.of([self._outcome(override) for override in overrides])

    def _outcome(self, override: Mapping[str, Any]) -> SampleOutcome | None:
        model = self._scene.model
        for path, varied in self._varied.items():
            changed = _changed(model, varied, override[path])
            if changed is None:
                return None
            model = changed
        scene, result = replace(self._scene, model=model), Selection("identification", self._collect)
        try:
            structure = self._structure if self._same else structure_of(scene)
            inputs = self._setting_of(scene, structure, override)
            identified(scene, inputs, common=self._common, into=result)
            return SampleOutcome(gather(result, self._collect))
        except DynidError:
            return None

    def _setting_of(
        self, scene: Scene[IdentificationScene], structure: StructuralModel, override: Mapping[str, Any]
    ) -> Setting:
        if not self._same:
            return setting(scene, structure)
        if not self._seeds:
            model = scene.model
            assert model.measurement is not None
            records = experiments(scene, model.excitation, model.measurement, self._structure)
            return self._setting._replace(measurements=records)
        (seed,) = override.values()
        records = [
            Experiment(
                loads, replace(measurement, source=replace(cast("Simulation", measurement.source), seed=seed))
            )
            for loads, measurement in self._setting.measurements
        ]
        return self._setting._replace(measurements=records)


def _changed(model: IdentificationScene, varied: _VariedValue, raw: Any) -> IdentificationScene | None:
    """Return the scene with another value; None for an expression or an invalid value."""
    value = raw
    if varied.name != "seed":  # a number that double precision turns into neither zero nor infinity
        try:
            value = None if isinstance(raw, bool | str) else Quantity(to_fraction(raw))
            if value is None or float(value) == 0 != value.value:
                return None
        except (OutOfRangeError, OverflowError):
            return None
    if varied.joint:
        joint = model.joints[varied.joint]
        parameter = getattr(joint, varied.letter)
        low, high = (None if bound is None else float(bound) for bound in (parameter.min, parameter.max))
        if value is None or not (low or 0.0) < float(value) <= (high or math.inf):
            return None
        changed_parameter = parameter.model_copy(update={varied.name: value})
        changed_joint = joint.model_copy(update={varied.letter: changed_parameter})
        return model.model_copy(update={"joints": {**model.joints, varied.joint: changed_joint}})
    if type(value) is not (int if varied.name == "seed" else Quantity) or float(value) < 0:
        return None
    measurement = model.measurement
    assert measurement is not None
    assert measurement.simulate is not None
    simulate = measurement.simulate.model_copy(update={varied.name: value})
    return model.model_copy(update={"measurement": measurement.model_copy(update={"simulate": simulate})})
