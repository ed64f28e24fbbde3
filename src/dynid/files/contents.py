"""Contents of a file, of any format that is read, and the lines of a scene that name them."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from dynid.errors import DynidError, FileError
from dynid.file_access import check_readable
from dynid.files.formats import FORMATS, TEXT_TABLE, FileFormat, named_by_content
from dynid.files.frequency_responses import ResponseLayout
from dynid.files.read_matrix import USUAL, named_as
from dynid.files.recordings import Recording
from dynid.files.spreadsheet import lines_of, sheets_of
from dynid.files.table import ColumnRequest, DataFile, DataTable, TableLayout
from dynid.files.text_table import read_lines
from dynid.files.universal_file import UniversalFile
from dynid.structure.matrices import is_sparse
from dynid.units import unit_fits

#: Rates that differ by less are one.
_RATE_DIGITS = 9
#: Relative differences that rounding of stamps makes: of mean and median step, of a rate and a whole one.
_ROUNDED_STEP, _WHOLE_RATE = 0.01, 1e-6
#: Rows of an array for each of its columns if these are channels, at least.
_LEAST_ROWS = 4
#: Columns that lines of a scene name.
_MAX_NAMED = 12


class _FileEntry(NamedTuple):
    """One thing in a file: its name in scenes, what it is, its size, unit, step and start (s), remarks."""

    name: str
    what: str
    size: str = ""
    unit: str = ""
    step: float | None = None
    start: float | None = None
    note: str = ""


class _FileContents(NamedTuple):
    """The format of a file, what is in it, lines of a scene that read it, and what could not be read."""

    format: str
    entries: list[_FileEntry]
    scene: list[str]
    faults: list[str]


def contents_of(path: Path) -> _FileContents:
    """Return what is in a file.

    Raises `FileError` where the file cannot be read as any format with its ending.
    """
    check_readable(path)
    with path.open("rb") as stream:
        start = stream.read(1024)
    suffix = path.suffix.lower()
    formats = [
        form
        for form in FORMATS
        if suffix in form.extensions and (form.recognised is None or form.recognised(start))
    ]
    entries: list[_FileEntry] = []
    scene: list[str] = []
    faults: list[str] = []
    names: list[str] = []
    listed_contents: set[str] = set()
    for form in formats or [TEXT_TABLE]:
        if entries and form.name in _GUESSED:
            continue
        for content, lister in _listers(form).items():
            if content in listed_contents:
                continue
            try:
                listed = [*lister(form, path)]
            except DynidError as error:
                faults += [] if form.name in _GUESSED else [str(error)]
                continue
            entries += [item for item in listed if isinstance(item, _FileEntry)]
            scene += [item for item in listed if isinstance(item, str)]
            names += [form.name] if listed else []
            listed_contents |= {content} if listed else set()
        if form.recognised is not None:
            break  # the first format that recognises a file reads it
    if not entries:
        ending = f"ends in {suffix}" if suffix else "has no ending"
        what = (
            "holds nothing that is read" if formats else f"{ending}, as no format does, and is no text table"
        )
        remedy = "" if formats else f"Formats end in {', '.join(_endings())}."
        nothing = FileError(f"{path} {what}", remedy=remedy)
        if formats and faults:
            nothing = FileError("; ".join(dict.fromkeys(faults)))
        raise named_by_content(path, ["columns"], nothing, [form.name for form in formats])
    return _FileContents(" or ".join(dict.fromkeys(names)), entries, scene, [*dict.fromkeys(faults)])


def _listers(form: FileFormat) -> dict[str, _Lister]:
    """Return what lists the contents of a format: a function for all, or one for each content."""
    if form.name in _OF_FORMATS:
        return {form.name: _OF_FORMATS[form.name]}
    return {content: lister for content, lister in _OF_CONTENTS.items() if getattr(form, content) is not None}


def _endings() -> list[str]:
    return list(dict.fromkeys(ending for form in FORMATS for ending in form.extensions))


_Listed: TypeAlias = Iterator[_FileEntry | str]
_Lister: TypeAlias = Callable[[FileFormat, Path], _Listed]


def _size(shape: Sequence[int]) -> str:
    return " x ".join(map(str, shape)) or "1"


def _word(text: str | int) -> str:
    """Return a name as YAML, quoted where it has to be."""
    plain = isinstance(text, int) or re.fullmatch(r"[A-Za-z_][\w./+-]*", text)
    return str(text) if plain and str(text).lower() not in _TRUTH else json.dumps(text, ensure_ascii=False)


_TRUTH = ("yes", "no", "on", "off", "true", "false", "null", "y", "n")
_MOTIONS = {
    "acceleration": ("m/s2", "rad/s2"),
    "velocity": ("m/s", "rad/s"),
    "displacement": ("m", "rad"),
}


def _scene_of_record(
    path: Path, keys: str, columns: Mapping[str | int, str], samples: int, step: float | None
) -> Iterator[str]:
    """Yield the lines that read columns, by name with unit: forces as excitation, the others as channels."""
    forces = [name for name, unit in columns.items() if unit and unit_fits(unit, ["N", "N.m"])]
    sensors = [name for name in columns if name not in forces]
    file = f"path: {_word(path.name)}{keys}"
    note = "# a smooth curve between its samples; else state hold: linear or hold: zero\n"
    for name in forces[:_MAX_NAMED]:
        yield f"{note}excitation: [{{dof: …, kind: file, {file}, column: {_word(name)}}}]"
        note = ""
    if not sensors:
        return
    motions = [
        next((motion for motion, units in _MOTIONS.items() if unit_fits(columns[name] or "-", units)), "…")
        for name in sensors[:_MAX_NAMED]
    ]
    more = ", …" if len(sensors) > _MAX_NAMED else ""
    yield "\n".join(
        [
            "measurement:",
            f"  step: {'…' if step is None else f'{step:.12g}'}",
            f"  samples: {samples}",
            f"  file: {{{file}, columns: [{', '.join(map(_word, sensors[:_MAX_NAMED]))}{more}]}}",
            "  channels:",
            *(f"    - {{dof: …, quantity: {motion}}}" for motion in motions),
        ]
    )


def _recording(form: FileFormat, path: Path) -> _Listed:
    assert form.recording is not None
    recording: Recording = form.recording(DataFile(path))
    groups: dict[tuple[str, int, float | None, float | None], dict[str | int, str]] = {}
    stems = Counter(channel.values.rpartition(":")[0] for channel in recording.channels)
    for channel in recording.channels:
        columns_of, _, number = channel.values.rpartition(":")
        if columns_of and number != "0" and _LEAST_ROWS * stems[columns_of] > channel.length:
            continue  # of a matrix, which is listed as such
        if channel.what:
            yield _FileEntry(channel.path, channel.what, str(channel.length))
            continue
        clock = recording.time_of(channel, recording.channels)
        times = None
        if clock is not None and clock is not channel:
            times = np.asarray(recording.array(clock.values), dtype=float)
        elif channel.times or channel.step:
            times = recording.times(channel)
        step = _round_step(times)
        start = None if times is None or not len(times) else float(times[0])
        what = "times" if clock is channel else "channel"
        yield _FileEntry(channel.path, what, str(channel.length), channel.heading[1], step, start)
        if what == "channel":
            group = groups.setdefault((channel.group, channel.length, step, start), {})
            group[channel.name] = channel.heading[1]
    if any(channel.path == "modal/frequency" for channel in recording.channels):  # of a modal analysis
        yield f"measurement: {{modes: {{file: {_word(path.name)}}}}}"
        return
    for (name, samples, step, _), columns in groups.items():
        if samples > 1:
            keys = f", group: {_word(name)}" if name else ""
            yield from _scene_of_record(path, keys, columns, samples, step)


def _round_step(times: np.ndarray | None) -> float | None:
    """Return the step of times, that of a whole rate within rounding; None of fewer than two.

    It is the mean where none is missing: stamps may be rounded to few digits.
    """
    if times is None or len(times) < 2:
        return None
    step = float(np.median(np.diff(times)))
    if not step > 0:
        return None
    mean = float(times[-1] - times[0]) / (len(times) - 1)
    step = mean if abs(mean - step) < _ROUNDED_STEP * step else step
    if abs(round(1 / step) * step - 1) < _WHOLE_RATE:
        return 1 / round(1 / step)
    rate = round(1 / step, _RATE_DIGITS - max(0, round(float(np.log10(1 / step)))))
    return 1 / rate if rate else step


def _workbook(_: FileFormat, path: Path) -> _Listed:
    file = DataFile(path)
    for sheet in sheets_of(file):
        try:
            table = read_lines(file, lines_of(file, sheet))
        except FileError as error:
            yield _FileEntry(sheet, "sheet", note=f"not read: {error}")
            continue
        yield from _table(table, path, f", sheet: {_word(sheet)}", f"{sheet}: ")


def _text(form: FileFormat, path: Path) -> _Listed:
    """Yield the columns of a text, real ones or frequency responses."""
    assert form.columns is not None
    assert form.responses is not None
    file, responses = DataFile(path), None
    with suppress(FileError):
        responses = form.responses(file, ResponseLayout())
    try:
        table = form.columns(file, ColumnRequest(None, TableLayout()))
    except FileError:
        if responses is None:
            raise
    else:
        listed = responses is not None and bool(table.names) and table.times is None
        if not listed or "damping" in {table.heading(k).name for k in table.data}:
            yield from _table(table, path)
            return
    assert responses is not None
    if "damping" in {heading.name for heading in responses.headings}:
        yield from _modes(form, path)
        return
    for number, heading in enumerate(responses.headings, 1):
        name, size = heading.name or f"column {number}", str(len(responses.omega))
        yield _FileEntry(name, "frequency response", size, heading.unit)
    unit = "" if responses.of_lines.unit else ", unit: Hz"
    yield f"measurement: {{frf: {{file: {{path: {_word(path.name)}}}{unit}}}, channels: […]}}"


def _table(table: DataTable, path: Path, keys: str = "", above: str = "") -> _Listed:
    """Yield the columns of a table."""
    step = _round_step(table.times)
    rows = len(table.values)
    columns: dict[str | int, str] = {}
    for number in range(table.values.shape[1]):
        name, unit, doubt = table.heading(number)
        what = "column" if number in table.data else "times"
        start = None if table.times is None or not rows else float(table.times[0])
        yield _FileEntry(
            f"{above}{name or f'column {number + 1}'}", what, str(rows), unit, step, start, doubt
        )
        if what == "column":
            columns[name if name and table.names.count(table.names[number]) == 1 else number + 1] = unit
    if {"frequency", "eigenvalue"} & {*columns}:
        yield f"measurement: {{modes: {{file: {_word(path.name)}}}}}"
    elif rows > 1 and columns:
        yield from _scene_of_record(path, keys, columns, rows, step)


_ROLES = ("mass", "stiffness", "damping", "structural")


def _matrices(form: FileFormat, path: Path) -> _Listed:
    assert form.matrices is not None
    members: Mapping[str, tuple[int, ...] | str] = form.matrices.members(path)
    shapes = {name: shape for name, shape in members.items() if not isinstance(shape, str)}
    for name, shape in members.items():
        if isinstance(shape, str):
            if form.recording is None or not shape.startswith("an array of"):  # of one axis, and listed
                yield _FileEntry(name, shape)
        elif len(shape) == 2 and min(shape) > 1:
            yield _FileEntry(name, "matrix", _size(shape))
        elif form.recording is None:
            yield _FileEntry(name, "vector", _size(shape))
    roles = {role: named_as(shapes, role)[:1] for role in (*_ROLES, "A", "B")}
    quoted = {
        role: f"{role}: {{path: {_word(path.name)}, name: {_word(names[0])}}}"
        for role, names in roles.items()
        if names
    }
    if roles["mass"] and roles["stiffness"]:
        listed = ", ".join(quoted[role] for role in _ROLES if role in quoted)
        yield f"structure: {{matrices: {{{listed}}}}}"
    elif roles["A"] and roles["B"]:
        yield f"structure: {{matrices: {{state_space: {{path: {_word(path.name)}}}}}}}"


def _matrix(form: FileFormat, path: Path) -> _Listed:
    assert form.matrix is not None
    matrix = form.matrix(path).matrix
    entries = int(matrix.nnz) if is_sparse(matrix) else int(np.count_nonzero(matrix))
    yield _FileEntry(path.name, "matrix", _size(matrix.shape), note=f"{entries} entries")
    stem = path.stem.lower()
    usual = (role for role in ("mass", "stiffness") if any(name.lower() in stem for name in USUAL[role][1:]))
    role = next(usual, "stiffness")
    other = "mass" if role == "stiffness" else "stiffness"
    yield f"structure: {{matrices: {{{role}: {_word(path.name)}, {other}: …}}}}"


def _nodes(form: FileFormat, path: Path) -> _Listed:
    assert form.nodes is not None
    if form.matrices is not None and form.mesh is None and form.name != "Nastran OUTPUT2":
        return  # positions there are matrices, listed as such
    stored = form.nodes(path)
    xyz = stored.nodes.xyz
    if not len(xyz):
        return
    extent = ", ".join(
        f"{axis} {low:.6g} to {high:.6g}"
        for axis, low, high in zip("xyz", xyz.min(axis=0), xyz.max(axis=0), strict=True)
    )
    yield _FileEntry("nodes", "nodes", str(len(xyz)), note=extent)
    for name, members in stored.nodes.sets.items():
        yield _FileEntry(name, "set of nodes", str(len(members)))
    if stored.modes is not None:
        yield _FileEntry("modes", "modes", str(len(stored.modes.frequencies)))
    yield f"structure: {{matrices: {{…, nodes: {_word(path.name)}}}}}"


def _mesh(form: FileFormat, path: Path) -> _Listed:
    assert form.mesh is not None
    mesh = form.mesh(path, ())
    yield _FileEntry("mesh", "nodes", str(len(mesh.xyz)))
    for kind, cells in mesh.cells:
        if len(cells):
            yield _FileEntry(kind, "elements", str(len(cells)))
    for name, parts in mesh.groups.items():
        yield _FileEntry(str(name), "group of elements", str(sum(len(part) for part in parts)))
    for name, members in mesh.sets.items():
        yield _FileEntry(str(name), "set of nodes", str(len(members)))
    if any(len(cells) for _, cells in mesh.cells):
        yield f"structure: {{solid: {{mesh: {_word(path.name)}, materials: …}}}}"


_KINDS = dict(
    enumerate(
        (
            "function",
            "time history",
            "auto spectrum",
            "cross spectrum",
            "frequency response",
            "transmissibility",
            "coherence",
            "auto correlation",
            "cross correlation",
            "power spectral density",
        )
    )
)


def _functions(form: FileFormat, path: Path) -> _Listed:
    """Yield functions and shapes of a Universal File."""
    source = UniversalFile(DataFile(path))
    kinds: list[int] = []
    for function in source.functions(header=True):
        ends = [f"{node}:{direction}" for node, direction in (function.response, function.reference) if node]
        even = function.step if function.even else None
        kinds.append(function.kind)
        what = _KINDS.get(function.kind, f"function of type {function.kind}")
        unit, note = function.units.stated, " over ".join(ends)
        yield _FileEntry(function.name, what, str(function.points), unit, even, None, note)
    if 4 in kinds:
        yield f"measurement: {{frf: {{file: {{path: {_word(path.name)}}}}}, channels: all}}"
    elif 0 in kinds or 1 in kinds:
        yield f"measurement: {{file: {{path: {_word(path.name)}}}, channels: all}}"
    if {15, 2411} & {*source.kinds}:
        yield from _nodes(form, path)
    if {55, 2414} & {*source.kinds}:
        yield from _modes(form, path)


def _modes(form: FileFormat, path: Path) -> _Listed:
    assert form.modes is not None
    try:
        modes = form.modes(DataFile(path), {})
    except FileError as error:
        yield _FileEntry("results", "not read", note=error.problem.removeprefix(f"{path} "))
        return
    turn, name = (2 * np.pi, "Hz") if modes.unit == "rad/s" else (1.0, modes.unit)
    frequency = modes.frequency / turn
    band = f"{frequency.min():.6g} to {frequency.max():.6g} {name}".rstrip() if len(frequency) else ""
    yield _FileEntry("modes", "modes", f"{len(frequency)} at {len(modes.dofs)} DOFs", note=band)
    unit = "" if modes.unit else ", unit: Hz"
    yield f"measurement: {{modes: {{file: {_word(path.name)}{unit}}}}}"


_OF_CONTENTS: dict[str, _Lister] = {
    "recording": _recording,
    "matrices": _matrices,
    "matrix": _matrix,
    "nodes": _nodes,
    "mesh": _mesh,
}
"""What lists a content of a file, by its field of `FileFormat`."""

_OF_FORMATS: dict[str, _Lister] = {"Universal File": _functions, "text table": _text, "workbook": _workbook}
"""What lists all contents of a format, by its name."""

_GUESSED = ("table of nodes", "rows of a matrix")
"""Formats of text that a file with their ending may be, or not."""
