"""DOFs that a Universal File names, matched to those of the model: `channels: all`, and sensors of shapes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from dynid.errors import FileError, UsageError
from dynid.number_format import counted
from dynid.scene.schema.measurement import AllOfFile, MeasurementModel, RecordModel
from dynid.scene.yaml.source import Source
from dynid.suggestions import shortened

if TYPE_CHECKING:
    from dynid.files.universal_file import UniversalFile, UniversalFunction
    from dynid.scene.load import Scene
    from dynid.scene.schema.identification import IdentificationScene
    from dynid.scene.schema.modes import MatchModel, MeasuredModesModel
    from dynid.structure.labels import Label, Nodes
    from dynid.structure.matching import Matching
    from dynid.structure.model import StructuralModel
    from dynid.structure.named_dofs import Motion

_MOTIONS = ("displacement", "velocity", "acceleration")


def completed(scene: Scene[IdentificationScene]) -> Source:
    """Return the source of a valid scene with the channels and sensors that its files name, one by one.

    A record gets its channels, the columns of the file that they are, `step` and `samples` where these are
    absent, and where the scene has no excitation the forces in the file. Frequency responses get their
    channels with reference DOFs, and the coherences of these where all are wanted. Measured modes get the
    DOFs of their shapes. Raises `FileError` if a file cannot be read, or does not say what its functions are.
    Raises `UsageError` if nodes of the test are not found in the model.
    """
    model = scene.model
    measurement = model.measurement
    if measurement is None:
        return scene.source
    channels = any(isinstance(record.channels, AllOfFile) for record in measurement.each)
    shaped = _names_nodes(scene, measurement.modes)
    if not (channels or shaped):
        return scene.source
    from dynid.scene.kinds.parts import structure_of

    if getattr(model, "graph", None) is not None:
        raise UsageError(
            "a Universal File names nodes and directions, which a graph has not",
            remedy="List the channels: channels: [{output: …}].",
            names=("measurement.channels",),
        )
    test_model = _Model(structure_of(scene) if scene.kind == "identification" else None, {})
    data = dict(scene.source.data)
    if shaped:
        assert measurement.modes is not None
        modes = _shapes(scene, measurement.modes, data["measurement"]["modes"], test_model)
        data["measurement"] = {**data["measurement"], "modes": modes}
    if channels:
        data |= _with_channels(scene, measurement, data, test_model)
    if test_model.motions:
        data["motions"] = {**data.get("motions", {}), **test_model.motions}
    return replace(scene.source, data=data, overridden=True)


class _Model(NamedTuple):
    """A model, and the weighted sums of its DOFs that sensors between them measure, by name."""

    structure: StructuralModel | None  # none of a modal analysis, whose DOFs are those of the test
    motions: dict[Label, Motion]

    def named(self, end: tuple[int, str], motion: Motion) -> dict[str, Any]:
        """Return `dof` of a motion that is measured at an end, and `gain` of the opposite direction."""
        (label, weight), *others = motion.items()
        if others:
            weight, along = (-1.0, end[1][1:]) if end[1].startswith("-") else (1.0, end[1])
            parts = {dof: weight * factor for dof, factor in motion.items()}
            names = (f"test{k or ''} {end[0]}:{along}" for k in count())
            label = next(name for name in names if self.motions.get(name, parts) == parts)
            self.motions[label] = parts
        return {"dof": label} if weight > 0 else {"dof": label, "gain": -1}


def _with_channels(
    scene: Scene, measurement: MeasurementModel, data: Mapping[str, Any], model: _Model
) -> dict[str, Any]:
    measured = data["measurement"]
    if not measurement.records:
        listed, forces = _written_out(scene, measurement, measured, "measurement", model)
        driven = {"excitation": forces} if forces and "excitation" not in data else {}
        return {"measurement": listed, **driven}
    records = []
    pairs = zip(measurement.each, measured["records"], strict=True)
    for number, (record, written_record) in enumerate(pairs):
        if isinstance(record.channels, AllOfFile):
            path = f"measurement.records.{number}"
            listed, forces = _written_out(scene, record, written_record, path, model)
            stated = any("excitation" in holder for holder in (data, measured, written_record))
            records.append(listed if stated else {**listed, "excitation": forces})
        else:
            records.append(written_record)
    shared = {key: value for key, value in measured.items() if key != "match" and value != "all"}
    return {"measurement": {**shared, "records": records}}


def _names_nodes(scene: Scene, modes: MeasuredModesModel | None) -> bool:
    """Return True if modes come from a Universal File, and the scene names no DOFs of their shapes."""
    if modes is None or modes.file is None or modes.sensors is not None:
        return False
    from dynid.files.universal_file import is_universal

    return is_universal(scene.folder / modes.file.path)


def _shapes(
    scene: Scene, modes: MeasuredModesModel, written: Mapping[str, Any], model: _Model
) -> dict[str, Any]:
    """Return the keys of measured modes with the DOFs of their shapes; `written` are those in the scene."""
    from dynid.files.read_measured import read_modes
    from dynid.files.table import DataFile
    from dynid.files.universal_file import UniversalFile
    from dynid.scene.schema.modes import MatchModel
    from dynid.structure.labels import node_direction

    assert modes.file is not None
    path_of_modes, path = "measurement.modes", scene.folder / modes.file.path
    table = read_modes(path, modes.file.names, f"{path_of_modes}.file")
    source = UniversalFile(DataFile(path, f"{path_of_modes}.file"))
    test = _Test(scene, modes.match or MatchModel(), path_of_modes, source, model, "file")
    ends = [node_direction(dof) for dof in table.dofs]
    kept = {key: value for key, value in written.items() if key != "match"}
    return {**kept, "sensors": test.signed([(int(end[0]), end[1]) for end in ends if end])}


def _written_out(
    scene: Scene, record: RecordModel, written: Mapping[str, Any], record_path: str, model: _Model
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return the own (`written`) keys of a record with those that its file gives, and the forces."""
    from dynid.files.table import DataFile
    from dynid.files.universal_file import UniversalFile, is_universal
    from dynid.scene.schema.modes import MatchModel

    file_model = record.file if record.frf is None else record.frf.file
    assert file_model is not None
    assert file_model.path is not None
    where = f"{record_path}.file" if record.frf is None else f"{record_path}.frf.file"
    file = DataFile(scene.folder / file_model.path, where)
    if not is_universal(file.path):
        file.check()
        remedy = "List the channels; 'all' are those of a Universal File (.uff, .unv)."
        file.refuse("names no nodes and directions", remedy)
    test = _Test(scene, record.match or MatchModel(), record_path, UniversalFile(file), model)
    kept = {key: value for key, value in written.items() if key != "match"}
    if record.frf is None:
        listed, columns, forces = _record(record, test)
        return {**kept, **listed, "file": {**kept.get("file", {}), **columns}}, forces
    channels, columns = _responses(record, test)
    frf = {**kept["frf"], "file": {**kept["frf"]["file"], **columns}}
    return {**kept, "channels": channels, "frf": frf}, []


class _Test:
    """A test in a Universal File, and where it lies in a model."""

    def __init__(
        self,
        scene: Scene,
        match: MatchModel,
        path: str,
        source: UniversalFile,
        model: _Model,
        key: str = "channels",
    ) -> None:
        self.match, self.place, self.source, self.model = match, path, source, model
        self.key = f"{path}.{key}"
        self.nodes = self._nodes(scene.folder)
        self.how = self._located(lambda: _matching(match))

    def _nodes(self, folder: Path) -> Nodes | None:
        from dynid.files.read_structure import read_nodes
        from dynid.files.universal_geometry import has_nodes, nodes_of

        if self.match.geometry is None:
            return nodes_of(self.source) if has_nodes(self.source) else None
        try:
            return read_nodes(folder / self.match.geometry).nodes
        except FileError as error:
            names = (f"{self.place}.match.geometry",)
            raise FileError(error.problem, remedy=error.remedy, names=names) from None

    def _located(self, motions: Any) -> Any:
        """Return what a function makes, its errors located in this part of the scene."""
        try:
            return motions()
        except UsageError as error:
            names = [f"{self.place}.{name}" for name in error.names if self.match.model_fields_set]
            raise UsageError(error.problem, remedy=error.remedy, names=[*names, self.key]) from None

    def quantity(self, function: UniversalFunction) -> str:
        """Return what a function measures, as the file says, else as the scene does."""
        return function.quantity or self.match.quantity or ""

    def unit(self, function: UniversalFunction) -> dict[str, str]:
        """Return `unit` where the scene decides it, or the quantity; else it is read with the values."""
        units = function.units
        if not function.quantity:
            from dynid.files.universal_file import function_units

            ends = function.response[1], function.over, function.reference[1]
            units = function_units(self.quantity(function), *ends, function.labels, self.source.units())
        if self.match.units is not None:
            units = units._replace(doubt="")
            if self.match.units == "record":
                units = units._replace(label=units.record)
        changed = units.stated and units.stated != function.units.stated
        return {"unit": units.stated} if changed else {}

    def dofs(self, ends: Sequence[tuple[int, str]]) -> list[dict[str, Any]]:
        """Return for ends of functions `dof`, and `gain` where these have the opposite direction."""
        from dynid.structure.matching import matched_dofs

        structure = self.model.structure
        if structure is None:
            return [{"dof": f"{node}:{along}"} for node, along in ends]
        motions: list[Motion] = self._located(lambda: matched_dofs(structure, ends, self.how, self.nodes))
        return [self.model.named(end, motion) for end, motion in zip(ends, motions, strict=True)]

    def signed(self, ends: Sequence[tuple[int, str]]) -> list[Label]:
        """Return DOFs for ends, with a sign where these have the opposite direction."""
        from dynid.structure.labels import node_direction

        labels: list[Label] = []
        for motion in self.dofs(ends):
            node = node_direction(motion["dof"]) if "gain" in motion else None
            labels.append(motion["dof"] if node is None else f"{node[0]}:-{node[1]}")
        return labels

    def refuse(self, functions: Sequence[tuple[int, UniversalFunction]], said: str, remedy: str) -> None:
        """Raise the fault of functions, by their numbers; none of them: no fault."""
        if not functions:
            return
        names = [f"{number} ({function.name})" for number, function in functions]
        self.source.file.refuse(f"{said}: functions {shortened(names, 6)}", remedy)


def _matching(match: MatchModel) -> Matching:
    import numpy as np

    from dynid.structure.matching import Matching

    options: dict[str, Any] = {"by": match.by, "pairs": match.nodes}
    if match.tolerance is not None:
        options["tolerance"] = float(match.tolerance)
    if match.origin is not None:
        options["origin"] = np.array([float(x) for x in match.origin])
    if match.axes is not None:
        options["axes"] = np.array([[float(x) for x in row] for row in match.axes])
    return Matching(**options)


def _chosen(
    test: _Test, kinds: Sequence[int], columns: Sequence[Any] | None, what: str
) -> list[tuple[int, UniversalFunction]]:
    """Return functions of some types with their numbers among these: the named ones, else all."""
    candidates = [function for function in test.source.functions(header=True) if function.kind in kinds]
    if not candidates:
        test.source.file.refuse(f"holds no {what}", f"Data sets 58 of function type {kinds[-1]} are read.")
    numbered = list(enumerate(candidates, 1))
    if columns is None:
        return numbered
    chosen = []
    for name in columns:
        named = [candidate for candidate in numbered if name in (candidate[0], candidate[1].name)]
        if len(named) != 1:
            test.source.file.refuse(
                f"has {counted(len(named), what) if named else 'no ' + what} '{name}', of {len(candidates)}",
                "Give its number among them.",
                key="columns",
            )
        chosen += named
    return chosen


def _record(record: RecordModel, test: _Test) -> tuple[dict[str, Any], dict[str, Any], list[dict[str, Any]]]:
    """Return the keys of a record, those of its file, and the forces that drive it."""
    from dynid.files.universal_file import mean_step

    assert record.file is not None
    functions = _chosen(test, (0, 1), record.file.columns, "time history")
    _check_known(test, functions)
    forces = [numbered for numbered in functions if test.quantity(numbered[1]) == "force"]
    sensors = [numbered for numbered in functions if test.quantity(numbered[1]) != "force"]
    if not sensors:
        test.source.file.refuse("holds no motion", "Data sets 58 say so by their specific data types.")
    driven = test.dofs([function.response for _, function in forces])
    measured = test.dofs([function.response for _, function in sensors])
    channels = [
        {**dof, "quantity": test.quantity(function), **test.unit(function)}
        for dof, (_, function) in zip(measured, sensors, strict=True)
    ]
    _check_different(test, sensors, channels)
    excitation = [
        {**dof, "kind": "file", "path": record.file.path, "column": number, **test.unit(function)}
        for dof, (number, function) in zip(driven, forces, strict=True)
    ]
    listed: dict[str, Any] = {"channels": channels}
    at, first = sensors[0]
    if record.step is None:
        listed["step"] = first.step
    if record.step is None and not first.even:  # its times are stored one by one
        histories = [function for function in test.source.functions() if function.kind in (0, 1)]
        listed["step"] = mean_step(histories[at - 1].x)
        if not 0 < listed["step"] < math.inf:
            test.source.file.refuse("has times that do not increase", "Give the 'step' that they have.")
    if record.samples is None:
        listed["samples"] = first.points
    return listed, {"columns": [number for number, _ in sensors]}, excitation


def _check_known(test: _Test, functions: Sequence[tuple[int, UniversalFunction]]) -> None:
    test.refuse(
        [function for function in functions if test.quantity(function[1]) not in (*_MOTIONS, "force")],
        "does not say that these are motions or forces",
        "Give the quantity (match: {quantity: acceleration}), or name the functions to use: columns: […].",
    )
    test.refuse(
        [function for function in functions if not function[1].response[1]],
        "gives no node and direction of these",
        "List the channels, or name the functions to use: columns: […].",
    )


def _check_different(
    test: _Test, functions: Sequence[tuple[int, UniversalFunction]], channels: Sequence[Any]
) -> None:
    for at, channel in enumerate(channels):
        before = channels.index(channel)
        test.refuse(
            [functions[before], functions[at]] if before < at else [],
            f"measures the {channel['quantity']} at {channel['dof']} twice",
            "Name the functions to use: columns: […].",
        )


def _responses(record: RecordModel, test: _Test) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Return the channels of frequency responses with their references, and the columns of the file."""
    assert record.frf is not None
    assert record.frf.file is not None
    functions = _chosen(test, (4,), record.frf.file.columns, "frequency response")
    _check_known(test, functions)
    test.refuse(
        [
            numbered
            for numbered in functions
            if test.quantity(numbered[1]) == "force" or numbered[1].over not in ("", "force")
        ],
        "holds what is no motion over a force",
        "Name the functions to use: columns: […].",
    )
    test.refuse(
        [numbered for numbered in functions if not numbered[1].reference[1]],
        "gives no reference node and direction of these",
        "List the channels, or name the functions to use: columns: […].",
    )
    responses = test.dofs([function.response for _, function in functions])
    references = test.dofs([function.reference for _, function in functions])
    channels = []
    for (_, function), response, reference in zip(functions, responses, references, strict=True):
        gain = response.pop("gain", 1) * reference.pop("gain", 1)
        quantity = test.quantity(function)
        channel = {**response, "quantity": quantity, "reference": reference, **test.unit(function)}
        channels.append(channel if gain > 0 else {**channel, "gain": -1})
    _check_different(test, functions, channels)
    file = {"columns": [number for number, _ in functions]}
    if isinstance(record.frf.file.coherence, AllOfFile):
        coherences = _chosen(test, (6,), None, "coherence")
        by_ends = {(numbered.response, numbered.reference): number for number, numbered in coherences}
        test.refuse(
            [
                numbered
                for numbered in functions
                if (numbered[1].response, numbered[1].reference) not in by_ends
            ],
            "holds no coherence of these",
            "Name the coherences, or leave them out.",
        )
        file["coherence"] = [by_ends[numbered.response, numbered.reference] for _, numbered in functions]
    return channels, file
