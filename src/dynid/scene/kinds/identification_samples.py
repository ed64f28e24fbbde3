"""Samples of an identification that differ in noise, starts or true values, run together.

What they share is computed once: the scene is read and checked, the structure assembled and reduced, the
record without noise simulated. Of each sample only the collected arrays are computed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, cast

from dynid.arithmetic.numbers import OutOfRangeError, to_fraction
from dynid.errors import DynidError
from dynid.identification.problem import SharedRecords
from dynid.identification.records.measurement import Experiment
from dynid.identification.records.simulation import Simulation
from dynid.result import Variable
from dynid.scene.batch import BatchKey, run_alone
from dynid.scene.kinds.identification import identified, setting, structure_of
from dynid.scene.kinds.measurements import experiments
from dynid.scene.load import Scene
from dynid.scene.outcomes import CollectedResult, SampleOutcome, gather
from dynid.scene.schema.quantities import Quantity
from dynid.structure.model import StructuralModel

if TYPE_CHECKING:
    from dynid.scene.schema.identification import IdentificationScene

Overrides = Sequence[Mapping[str, Any]]


def batched(
    template: Scene,
    overrides: Overrides,
    collect: tuple[str, ...],
) -> list[SampleOutcome] | None:
    """Run samples together where they differ in seeds, noise, starts and true values alone.

    Parameters
    ----------
    template, overrides, collect
        As for `dynid.scene.batch.run_batch`.

    Returns
    -------
    list of SampleOutcome, or None
        One a sample; None where something else varies, or more is requested than an identification.
    """
    paths = tuple(overrides[0]) if overrides else ()
    if not paths or any(tuple(one) != paths for one in overrides):
        return None
    family = BatchKey.of(template, paths)
    plan = _planned(family)
    if plan is None:
        return None
    found = [plan.run(one, collect) for one in overrides]
    return [
        SampleOutcome(values) if values is not None else run_alone(template, one, collect)
        for one, values in zip(overrides, found, strict=True)
    ]


def why_alone(template: Scene, paths: Sequence[str], collect: tuple[str, ...]) -> str:  # noqa: ARG001
    """Return why samples that differ at these paths are not run together; empty where they are."""
    model = cast("IdentificationScene", template.model)
    if model.graph is not None:
        return "samples of a graph are identified one by one"
    for path in paths:
        if _place(model, path) is None:
            return f"{path} is no seed, noise, or start or true value of a joint"
    measurement = model.measurement
    if (
        measurement is None
        or measurement.frf
        or measurement.modes
        or model.responses
        or model.identifiability
    ):
        return "more than an identification from records is asked for"
    family = BatchKey.of(template, paths)
    return "" if _planned(family) else "the scene as it stands cannot be run"


@lru_cache(maxsize=4)
def _planned(family: BatchKey) -> _RecordBatch | None:
    """Return the plan of a batch, made once a process; None where it cannot be run together."""
    model = cast("IdentificationScene", family.scene.model)
    places = [_place(model, path) for path in family.paths]
    measurement = model.measurement
    alone = model.graph is not None or model.responses or model.identifiability
    if alone or measurement is None or measurement.frf or measurement.modes or None in places:
        return None
    try:
        return _RecordBatch(
            family.scene, dict(zip(family.paths, cast("list[_VariedValue]", places), strict=True))
        )
    except DynidError:
        return None


class _VariedValue(NamedTuple):
    """A varied value: a key of the noise (no joint), or the start or true value of a parameter."""

    joint: str
    letter: str
    name: str


def _place(model: IdentificationScene, path: str) -> _VariedValue | None:
    """Return the value that a path refers to; None for one that cannot vary in a batch."""
    measurement = model.measurement
    match path.split("."):
        case ["measurement", "simulate", ("seed" | "noise_ratio" | "noise") as name]:
            simulate = None if measurement is None or measurement.records else measurement.simulate
            given = getattr(simulate, name, None)
            return _VariedValue("", "", name) if isinstance(given, int | Quantity) else None
        case ["joints", joint, ("k" | "c") as letter, ("start" | "true") as name] if joint in model.joints:
            parameter = getattr(model.joints[joint], letter)
            return _VariedValue(joint, letter, name) if getattr(parameter, name, None) is not None else None
    return None


class _RecordBatch:
    """Samples of one identification, with their common part.

    Parameters
    ----------
    scene
        The scene.
    places
        The value that each varied path refers to.
    """

    def __init__(self, scene: Scene, places: dict[str, _VariedValue]) -> None:
        self._scene, self._places = scene, places
        self._structure = structure_of(scene)
        self._setting = setting(scene, self._structure)
        self._same = not any(place.joint for place in places.values())
        changed = {place.name for place in places.values()}
        records = self._setting.measurements
        self._seeds = changed == {"seed"} and all(
            isinstance(one.measurement.source, Simulation) for one in records
        )
        self._common: SharedRecords | None = None
        truth = self._setting.truth
        if isinstance(truth, StructuralModel) and truth.basis is None and "true" not in changed:
            self._common = SharedRecords.of(*self._setting[:3], same=self._same)

    def _seeded(self, override: Mapping[str, Any]) -> list[Experiment]:
        """Return the records with the seed of a sample, which is all that varies."""
        (seed,) = override.values()
        return [
            Experiment(
                loads, replace(measurement, source=replace(cast("Simulation", measurement.source), seed=seed))
            )
            for loads, measurement in self._setting.measurements
        ]

    def run(self, override: Mapping[str, Any], collect: tuple[str, ...]) -> Mapping[str, Variable] | None:
        """Return the collected arrays of a sample; None for one that is to be run alone."""
        model = cast("IdentificationScene", self._scene.model)
        for path, place in self._places.items():
            changed = _changed(model, place, override[path])
            if changed is None:
                return None
            model = changed
        scene, result = Scene(self._scene.source, model), CollectedResult("identification", collect)
        try:
            structure = self._structure if self._same else structure_of(scene)
            if self._seeds:
                made = self._setting._replace(measurements=self._seeded(override))
            elif self._same:
                assert model.measurement is not None
                records = experiments(scene, model.excitation, model.measurement, structure)
                made = self._setting._replace(measurements=records)
            else:
                made = setting(scene, structure)
            identified(scene, made, common=self._common, into=result)
            return gather(result, collect)
        except DynidError:
            return None


def _changed(model: IdentificationScene, place: _VariedValue, raw: Any) -> IdentificationScene | None:
    """Return the scene with another value at a place; None for an expression or an invalid value."""
    value = raw
    if place.name != "seed":  # a number that double precision turns into neither zero nor infinity
        try:
            value = None if isinstance(raw, bool | str) else Quantity(to_fraction(raw))
            if value is None or float(value) == 0 != value.value:
                return None
        except (OutOfRangeError, OverflowError):
            return None
    if place.joint:
        joint = model.joints[place.joint]
        parameter = getattr(joint, place.letter)
        low, high = (None if bound is None else float(bound) for bound in (parameter.min, parameter.max))
        if value is None or not (low or 0.0) < float(value) <= (high or math.inf):
            return None
        other = joint.model_copy(update={place.letter: parameter.model_copy(update={place.name: value})})
        return model.model_copy(update={"joints": {**model.joints, place.joint: other}})
    if type(value) is not (int if place.name == "seed" else Quantity) or float(value) < 0:
        return None
    measurement = model.measurement
    assert measurement is not None
    assert measurement.simulate is not None
    simulate = measurement.simulate.model_copy(update={place.name: value})
    return model.model_copy(update={"measurement": measurement.model_copy(update={"simulate": simulate})})
