"""Measured modes in text, MATLAB and Universal Files.

A text file has one mode a row, and a header: `frequency`, `frequency_std`, `damping`, `damping_std`, of
backbones `amplitude` and `mode`, else the sensors' DOFs (``12``, ``13:z``), and the scatter of a sensor as
``std 12``; units stand behind the names, or in a row of their own. A MATLAB file has vectors (modes) and
matrices (sensors x modes).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.files import matlab
from dynid.files.hdf5_data import complex_datasets, modal_labels, present
from dynid.files.matlab import complex_columns, whole_numbers
from dynid.files.table import DataFile, DataTable
from dynid.files.text_table import complex_number, read_text
from dynid.files.universal_geometry import read_shapes
from dynid.structure.labels import Label
from dynid.suggestions import shortened
from dynid.units import angular_factor, si_factor, unit_fits, unit_of_field

#: Quantities of a file of modes, which are also the names under which they are looked for.
QUANTITIES = ("frequency", "frequency_std", "eigenvalue", "eigenvalue_std", "damping", "damping_std", "shape")
#: Of points of backbones.
_OF_AMPLITUDES = ("amplitude", "mode")
_OF_SHAPES = ("shape_std", "tests", "frequency_tests", "dofs")
_STD = "std "
#: Units of translations and rotations: of amplitudes, and side by side in a shape.
_MOTIONS = (("m", "rad"), ("m/s", "rad/s"), ("m/s2", "rad/s2"))


class ModalTable(NamedTuple):
    """Modes read from a file."""

    frequency: Array  # natural frequencies (r) in `unit`
    #: Mode shapes (sensors x r), real or complex, NaN where a sensor is missing; None without shapes.
    shape: NDArray[Any] | None = None
    #: DOFs of the sensors, such as ``12``, ``13:z`` or ``-13:z``; empty where the file does not name them.
    dofs: Sequence[Label] = ()
    damping: Array | None = None  # damping ratios (r), NaN of a mode without one; None where there are none
    #: Standard deviations, each as the values; None where there are none.
    frequency_std: Array | None = None
    damping_std: Array | None = None
    shape_std: Array | None = None
    # Covariance of frequencies, damping ratios, and real and imaginary parts of shapes, sensor by sensor.
    covariance: Array | None = None
    absolute: bool = False  # True of shapes of unit modal a, or if they are real, of unit modal mass
    unit: str = ""  # unit of the frequencies, ``Hz`` or ``rad/s``; empty where the file does not state it
    # Amplitudes at which the modes were measured (r), in an SI unit where the file states it, and the numbers
    # of the modes (r), from 1.
    amplitude: Array | None = None
    amplitude_unit: str = ""
    mode: Array | None = None


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


def _by_eigenvalue(vectors: Mapping[str, Array]) -> tuple[Array, Array | None, str] | None:
    """Return frequencies, scatter and unit of eigenvalues, rad^2/s^2, if these are given."""
    if "eigenvalue" not in vectors:
        return None
    omega, scatter = np.sqrt(vectors["eigenvalue"]), vectors.get("eigenvalue_std")
    return omega, None if scatter is None else scatter / (2 * omega), "rad/s"


def from_matlab(file: DataFile, names: Mapping[str, str]) -> ModalTable:
    """Return the modes in a MATLAB file."""
    variables, arrays = matlab.names(file.path), {}
    for key in (*QUANTITIES, *_OF_AMPLITUDES, *_OF_SHAPES):
        name = names.get(key, key)
        if name in variables or key in names:
            arrays[key] = complex_columns(file, [name], key)
    vectors = {
        key: np.asarray(arrays[key].real, dtype=float).ravel()
        for key in (*QUANTITIES[:-1], *_OF_AMPLITUDES, "frequency_tests")
        if key in arrays
    }
    if any(np.any(vectors.get(key, np.ones(1)) <= 0) for key in ("eigenvalue", "frequency_tests")):
        file.refuse("has an eigenvalue or a number of tests that is not positive", colon=True)
    by_eigenvalue = _by_eigenvalue(vectors)
    if by_eigenvalue is None and "frequency" not in vectors:
        listed = f"has no variable 'frequency'; it has {shortened(variables, 20)}"
        file.refuse(listed, "Name it: frequency: NAME, or eigenvalue: NAME.", key="path")
    frequency, scatter, unit = by_eigenvalue or (vectors["frequency"], vectors.get("frequency_std"), "")
    r, shape, shape_std = len(frequency), arrays.get("shape"), arrays.get("shape_std")
    for key in ("shape", "shape_std"):
        if key in arrays and arrays[key].shape[1] != r:
            file.refuse(
                f"'{names.get(key, key)}' has {arrays[key].shape[1]} columns, but there are {r} modes",
                key=key,
            )
    if shape is not None and shape_std is not None and shape.shape != shape_std.shape:
        file.refuse(f"'{names.get('shape_std', 'shape_std')}' is not as large as the shapes", key="shape_std")
    of_tests = arrays.get("tests")
    tests = None if of_tests is None else np.asarray(of_tests.real, dtype=float)
    dofs = whole_numbers(file, names.get("dofs", "dofs"), "dofs") if "dofs" in arrays else []
    return ModalTable(
        frequency,
        shape,
        dofs,
        vectors.get("damping"),
        _mean_scatter(file, scatter, vectors.get("frequency_tests"), "frequency_tests"),
        vectors.get("damping_std"),
        _mean_scatter(file, None if shape_std is None else shape_std.real, tests, "tests"),
        unit=unit,
        amplitude=vectors.get("amplitude"),
        mode=vectors.get("mode"),
    )


def from_text(file: DataFile, names: Mapping[str, str]) -> ModalTable:
    """Return the modes in a text file with one mode a row."""
    table = read_text(file, number=complex_number)
    if not table.names:
        file.refuse("has no header", "The first line names the columns: frequency, damping, and DOFs.")
    bare, units = zip(*(_name_and_unit(table, k) for k in range(len(table.names))), strict=True)
    at = {
        key: table.find(names[key], key) if key in names else bare.index(key)
        for key in (*QUANTITIES[:-1], "amplitude", *["mode"] * ("amplitude" in {*names, *bare}))
        if key in names or key in bare
    }
    columns = {key: np.asarray(table.values[:, k].real) for key, k in at.items()}
    stated = {key: units[k] for key, k in at.items()}
    unit = "" if not stated.get("frequency") else "Hz" if unit_fits(stated["frequency"], ["Hz"]) else "rad/s"
    for key, factor in _factors(file, stated, unit).items():
        columns[key] = factor * columns[key]
    by_eigenvalue = _by_eigenvalue(columns)
    if by_eigenvalue is None and "frequency" not in columns:
        file.refuse(f"has no column 'frequency'; it has {', '.join(bare)}", "Name it: frequency: NAME.")
    frequency, scatter, unit = by_eigenvalue or (columns["frequency"], columns.get("frequency_std"), unit)
    amplitude_unit = ""
    if stated.get("amplitude"):
        amplitude_unit, columns["amplitude"] = _in_si(file, stated["amplitude"], columns["amplitude"])
    unread = {names.get("shape", "shape"), "mode", "name"}
    places = {name: k for k, name in enumerate(bare) if k not in at.values() and name not in unread}
    sensors = [name for name in places if not name.startswith(_STD)]
    stds = {name.removeprefix(_STD).strip(): k for name, k in places.items() if name.startswith(_STD)}
    for name in stds:
        if name not in sensors:
            file.refuse(f"has the scatter of '{name}', but no column '{name}'")
    of_shapes = {places[name]: units[places[name]] for name in sensors}
    of_shapes |= {k: units[k] or units[places[name]] for name, k in stds.items()}
    sizes = _factors_of_shapes(file, of_shapes)
    shape = np.array([sizes[places[name]] * table.values[:, places[name]] for name in sensors])
    shape_std = np.full(shape.shape, np.nan)
    for row, name in enumerate(sensors):
        if name in stds:
            shape_std[row] = sizes[stds[name]] * table.values[:, stds[name]].real
    return ModalTable(
        frequency,
        (shape if np.any(np.nan_to_num(shape.imag)) else shape.real) if sensors else None,
        [int(name) if name.isdecimal() else name for name in sensors],
        columns.get("damping"),
        scatter,
        columns.get("damping_std"),
        shape_std if stds else None,
        unit=unit,
        amplitude=columns.get("amplitude"),
        amplitude_unit=amplitude_unit,
        mode=columns.get("mode"),
    )


def _name_and_unit(table: DataTable, column: int) -> tuple[str, str]:
    """Return name and unit of a column; what else stands in brackets is returned, and refused as a unit."""
    name, unit, _ = table.heading(column)
    bare, _, inside = name.partition("[")
    return bare.strip(), unit or unit_of_field(inside.rstrip("] "))


def _in_si(file: DataFile, stated: str, amplitude: Array) -> tuple[str, Array]:
    """Return the SI unit of amplitudes of a motion, and these in it."""
    for unit in (unit for motion in _MOTIONS for unit in motion):
        if unit_fits(stated, [unit]):
            return unit, si_factor(stated, [unit]) * amplitude
    file.refuse(f"has 'amplitude' in {stated}", "It is a displacement, velocity or acceleration.", colon=True)


def _factors(file: DataFile, stated: Mapping[str, str], unit: str) -> dict[str, float]:
    """Return the factors of stated units to ratios, rad^2/s^2, and `unit`; scatter has that of its value."""
    factors = {}
    for key, unit_of_key in stated.items():
        if key in _OF_AMPLITUDES:
            continue
        quantity = key.removesuffix("_std")
        text = unit_of_key or stated.get(quantity, "")
        if not text:
            continue
        if not stated.get(quantity):
            file.refuse(f"has '{key}' in {text}, but '{quantity}' without a unit", "Name both.", colon=True)
        try:
            if quantity == "frequency":
                factors[key] = angular_factor(text) / angular_factor(unit)
            elif quantity == "damping":
                factors[key] = si_factor(text, ["1"], what="a damping ratio")
            else:
                factors[key] = si_factor(text, ["rad2/s2"], what="an eigenvalue")
        except UsageError as error:
            file.refuse(f"'{key}': {error.problem}", error.remedy, colon=True)
    return factors


def _factors_of_shapes(file: DataFile, stated: Mapping[int, str]) -> dict[int, float]:
    """Return the factors of the columns of shapes and their scatter; in one unit they have any scale."""
    if len(set(stated.values())) <= 1:
        return dict.fromkeys(stated, 1.0)
    for motion in _MOTIONS:
        if all(unit_fits(unit, motion) for unit in stated.values()):
            return {column: si_factor(unit, motion) for column, unit in stated.items()}
    different = ", ".join(dict.fromkeys(unit or "no unit" for unit in stated.values()))
    file.refuse(
        f"has shapes in {different}, which are not one motion",
        "All are displacements (m, rad), velocities or accelerations, or all of them are in one unit.",
        colon=True,
    )


#: Group of a modal analysis in its result; most values whose covariance is used, an array of 800 MB.
_MODAL, _MAX_VALUES = "modal", 10_000


def from_hdf5(file: DataFile, names: Mapping[str, str]) -> ModalTable:
    """Return the modes in the result of a modal analysis, with their covariance and scale."""
    if names:
        file.refuse("has modes by their usual names", "Leave the name out.", key=next(iter(names)))
    if not present(file, [f"{_MODAL}/shape"]):
        file.refuse("is no result of a modal analysis", "Run a scene of kind modal-analysis.", key="path")

    def array(name: str) -> NDArray[Any]:
        return complex_datasets(file, f"{_MODAL}/{name}", "path")

    shape, (sensors, normalisation) = array("shape").T, modal_labels(file, _MODAL)
    real = "mass" in normalisation
    parts, (s, r) = 1 if real else 2, shape.shape
    if 2 * r + parts * s * r > _MAX_VALUES:
        file.refuse(
            f"has {r} modes at {s} sensors, whose covariance is too large",
            "Analyse a narrower band, or fewer sensors.",
            key="path",
        )
    common = array("covariance/common").real
    if (narrow := np.isnan(array("frequency_standard_error")).ravel()).any():
        file.refuse(
            f"mode {int(np.argmax(narrow)) + 1} has no standard errors, because of leakage",
            "Lengthen the segments of its records, or narrow the band.",
            key="path",
        )
    by_channel = array("covariance/by_channel").real.reshape(s, parts, r, -1)
    if len(common) != 2 * r + parts * s * r or len(sensors) != s:
        file.refuse("has a covariance that is not of its modes", "Run its scene again.", key="path")
    covariance = common @ common.T
    of_shapes = covariance[2 * r :, 2 * r :].reshape(parts, s, r, parts, s, r)
    for sensor, factor in enumerate(by_channel):
        of_shapes[:, sensor, :, :, sensor, :] += np.einsum("pmf,qnf->pmqn", factor, factor)
    frequency, damping = array("frequency").real.ravel(), array("damping").real.ravel()
    return ModalTable(
        frequency,
        shape.real if real else shape,
        [int(name) if name.isdecimal() else name for name in sensors],
        damping,
        array("frequency_standard_error").real.ravel(),
        array("damping_standard_error").real.ravel(),
        array("shape_standard_error").real.T,
        covariance,
        absolute="modal" in normalisation,
        unit="rad/s",
    )


def from_universal(file: DataFile, names: Mapping[str, str]) -> ModalTable:
    """Return the modes in a Universal File (data sets 55 and 2414)."""
    if names:
        file.refuse("has mode shapes, no named quantities", "Leave the name out.", key=next(iter(names)))
    modes = read_shapes(file)
    places = list(dict.fromkeys(dof for mode in modes for dof in mode.shape))
    damping = [math.nan if mode.damping is None else mode.damping for mode in modes]
    return ModalTable(
        np.array([mode.frequency for mode in modes]),
        np.array([[mode.shape.get(sensor, math.nan) for mode in modes] for sensor in places]),
        [f"{node}:{direction}" for node, direction in places],
        None if all(mode.damping is None for mode in modes) else np.array(damping),
        unit="rad/s",
    )
