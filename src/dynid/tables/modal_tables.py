"""Measured modes read from text, MATLAB and Universal Files; other formats add a reader to `READERS`.

A text file has one mode a row, and a header: `frequency`, `frequency_std`, `damping`, `damping_std`, the
sensors' DOFs (``12``, ``13:z``), and the scatter of a sensor as ``std 12``. A MATLAB file has vectors (modes)
and matrices (sensors x modes).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.structure.matrices import Label
from dynid.tables.matlab import complex_columns, whole_numbers
from dynid.tables.read import existing, file_format
from dynid.tables.table import DataFile
from dynid.tables.text import complex_number, read_text
from dynid.tables.universal_shapes import read_shapes

Array = NDArray[np.float64]

#: Quantities of a file of modes, which are also the names under which they are looked for.
QUANTITIES = ("frequency", "frequency_std", "eigenvalue", "eigenvalue_std", "damping", "damping_std", "shape")
_OF_SHAPES = ("shape_std", "tests", "frequency_tests", "dofs")
_STD = "std "


class ModalTable(NamedTuple):
    """Modes read from a file.

    Attributes
    ----------
    frequency
        Natural frequencies (r); `unit` is ``Hz``, ``rad/s``, or empty where the file does not state it.
    shape
        Mode shapes (sensors x r), real or complex, NaN where a sensor is missing; None without shapes.
    dofs
        DOFs of the sensors, such as ``12``, ``13:z`` or ``-13:z``; empty where the file does not name them.
    damping
        Damping ratios (r), NaN of a mode without one; None where there are none.
    frequency_std, damping_std, shape_std
        Standard deviations, each as the values; None where there are none.
    unit
        Unit of the frequencies.
    """

    frequency: Array
    shape: NDArray[Any] | None = None
    dofs: Sequence[Label] = ()
    damping: Array | None = None
    frequency_std: Array | None = None
    damping_std: Array | None = None
    shape_std: Array | None = None
    unit: str = ""


def read_modes(path: Path, names: Mapping[str, str], place: str) -> ModalTable:
    """Return the modes in a file.

    Parameters
    ----------
    path
        A text file (`.csv`, `.txt`, `.dat`), a MATLAB file (`.mat`), or a file of a format of `READERS`.
    names
        The names of quantities in the file, where they differ from `QUANTITIES`, ``shape_std``, ``tests``
        (of each value of a shape, or of each mode: the scatter is that of a single test, and the mean of n
        tests scatters by a root of n less), ``frequency_tests`` and ``dofs``.
    place
        The dotted place of the file in the scene, for errors.

    Raises
    ------
    FileError
        Where the file cannot be read, a quantity is missing, or numbers are invalid.
    """
    file = existing(path, place)
    found = READERS.get(file_format(path), _text)(file, names)
    bad = ~(np.isfinite(found.frequency) & (found.frequency >= 0))
    if bad.any():
        number = int(np.argmax(bad)) + 1
        file.refuse(f"mode {number} has no frequency", "Leave it out, or give it one.", colon=True)
    for name in ("frequency_std", "damping_std", "shape_std"):
        values = getattr(found, name)
        if values is not None and np.any(np.nan_to_num(values) < 0):
            file.refuse(f"'{name}' is negative somewhere", colon=True)
    return found


def _mean_scatter(file: DataFile, scatter: Array | None, tests: Array | None, key: str) -> Array | None:
    """Return the scatter of means of so many tests, of that of a single test."""
    if scatter is None or tests is None:
        return scatter
    if np.any(tests < 1):
        file.refuse("has a number of tests below 1", key=key)
    try:
        return np.asarray(scatter / np.sqrt(np.broadcast_to(tests, scatter.shape)))
    except ValueError:
        file.refuse(f"'{key}' has the shape {tests.shape}, the scatter {scatter.shape}", key=key)


def _by_eigenvalue(given: Mapping[str, Array]) -> tuple[Array, Array | None, str] | None:
    """Return frequencies, scatter and unit of eigenvalues, rad^2/s^2, if these are given."""
    if "eigenvalue" not in given:
        return None
    omega, scatter = np.sqrt(given["eigenvalue"]), given.get("eigenvalue_std")
    return omega, None if scatter is None else scatter / (2 * omega), "rad/s"


def _matlab(file: DataFile, names: Mapping[str, str]) -> ModalTable:
    """Return the modes in a MATLAB file."""
    from dynid.structure.readers.matlab import names as known_names

    known, found = known_names(file.path), {}
    for key in (*QUANTITIES, *_OF_SHAPES):
        name = names.get(key, key)
        if name in known or key in names:
            found[key] = complex_columns(file, [name], key)
    vectors = {
        key: np.asarray(found[key].real, dtype=float).ravel()
        for key in (*QUANTITIES[:-1], "frequency_tests")
        if key in found
    }
    if any(np.any(vectors.get(key, np.ones(1)) <= 0) for key in ("eigenvalue", "frequency_tests")):
        file.refuse("has an eigenvalue or a number of tests that is not positive", colon=True)
    by_eigenvalue = _by_eigenvalue(vectors)
    if by_eigenvalue is None and "frequency" not in vectors:
        file.refuse(
            "has no variable 'frequency'", "Name it: frequency: NAME, or eigenvalue: NAME.", key="path"
        )
    frequency, scatter, unit = by_eigenvalue or (vectors["frequency"], vectors.get("frequency_std"), "")
    r, shape, shape_std = len(frequency), found.get("shape"), found.get("shape_std")
    for key in ("shape", "shape_std"):
        if key in found and found[key].shape[1] != r:
            file.refuse(
                f"'{names.get(key, key)}' has {found[key].shape[1]} columns, but there are {r} modes", key=key
            )
    if shape is not None and shape_std is not None and shape.shape != shape_std.shape:
        file.refuse(f"'{names.get('shape_std', 'shape_std')}' is not as large as the shapes", key="shape_std")
    of_tests = found.get("tests")
    tests = None if of_tests is None else np.asarray(of_tests.real, dtype=float)
    dofs = whole_numbers(file, names.get("dofs", "dofs"), "dofs") if "dofs" in found else []
    return ModalTable(
        frequency,
        shape,
        dofs,
        vectors.get("damping"),
        _mean_scatter(file, scatter, vectors.get("frequency_tests"), "frequency_tests"),
        vectors.get("damping_std"),
        _mean_scatter(file, None if shape_std is None else shape_std.real, tests, "tests"),
        unit,
    )


def _text(file: DataFile, names: Mapping[str, str]) -> ModalTable:
    """Return the modes in a text file with one mode a row."""
    table = read_text(file, number=complex_number)
    if not table.names:
        file.refuse("has no header", "The first line names the columns: frequency, damping, and DOFs.")
    units = {name: name.partition("[")[2].rstrip("] ") for name in table.names}
    bare = [name.partition("[")[0].strip() for name in table.names]
    columns: dict[str, Array] = {}
    for key in QUANTITIES[:-1]:
        wanted = names.get(key, key)
        if wanted in bare:
            columns[key] = np.asarray(table.values[:, bare.index(wanted)].real)
        elif key in names:
            file.refuse(f"has no column '{wanted}'", key=key)
    by_eigenvalue = _by_eigenvalue(columns)
    if by_eigenvalue is None and "frequency" not in columns:
        file.refuse(f"has no column 'frequency'; it has {', '.join(bare)}", "Name it: frequency: NAME.")
    frequency, scatter, unit = by_eigenvalue or (columns["frequency"], columns.get("frequency_std"), "")
    if not by_eigenvalue:
        unit = units[table.names[bare.index(names.get("frequency", "frequency"))]]
    used = {names.get(key, key) for key in QUANTITIES} | {"mode", "name"}
    places = {name: k for k, name in enumerate(bare) if name not in used}
    sensors = [name for name in places if not name.startswith(_STD)]
    stds = {name.removeprefix(_STD).strip(): k for name, k in places.items() if name.startswith(_STD)}
    for name in stds:
        if name not in sensors:
            file.refuse(f"has the scatter of '{name}', but no column '{name}'")
    shape = table.values[:, [places[name] for name in sensors]].T
    shape_std = np.full(shape.shape, np.nan)
    for row, name in enumerate(sensors):
        if name in stds:
            shape_std[row] = table.values[:, stds[name]].real
    return ModalTable(
        frequency,
        (shape if np.any(np.nan_to_num(shape.imag)) else shape.real) if sensors else None,
        [int(name) if name.isdecimal() else name for name in sensors],
        columns.get("damping"),
        scatter,
        columns.get("damping_std"),
        shape_std if stds else None,
        unit,
    )


def _universal(file: DataFile, names: Mapping[str, str]) -> ModalTable:
    """Return the modes in a Universal File (data sets 55 and 2414)."""
    if names:
        file.refuse("has mode shapes, no named quantities", "Leave the name out.", key=next(iter(names)))
    modes = read_shapes(file.path, file.place)
    places = list(dict.fromkeys(dof for mode in modes for dof in mode.shape))
    damping = [math.nan if mode.damping is None else mode.damping for mode in modes]
    return ModalTable(
        np.array([mode.frequency for mode in modes]),
        np.array([[mode.shape.get(place, math.nan) for mode in modes] for place in places]),
        [f"{node}:{direction}" for node, direction in places],
        None if all(mode.damping is None for mode in modes) else np.array(damping),
        unit="rad/s",
    )


#: Readers by the format of `tables.read.file_format`: each gets the file and the names that the scene gives.
READERS: dict[str, Callable[[DataFile, Mapping[str, str]], ModalTable]] = {
    "matlab": _matlab,
    "text": _text,
    "uff": _universal,
}
