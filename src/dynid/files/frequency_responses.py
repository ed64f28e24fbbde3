"""Frequency response functions read from text, HDF5, MATLAB and Universal File Format 58."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray
from dynid.files.hdf5_data import complex_datasets, present
from dynid.files.matlab import complex_columns
from dynid.files.table import DataFile, Heading
from dynid.files.text_table import complex_number, read_text
from dynid.files.universal_file import UniversalFunction, read_functions
from dynid.units import split_heading

ColumnName: TypeAlias = str | int

#: Names of a column of frequencies; a unit may stand behind it in brackets.
_FREQUENCY = ("omega", "frequency", "freq", "w", "f")
#: Where responses and their frequencies are looked for in HDF5 when a scene names none.
_MEASURED = ("measured", "response", "identification/measurement/measured")
#: Function types of a data set 58: frequency response, coherence.
_FRF, _COHERENCE = 4, 6
#: Up to which part lines may differ: in text a Universal File has six digits of their distance.
_LINE_RTOL = 1e-5


class ResponseLayout(NamedTuple):
    """The columns of a file of frequency responses, by name or by number from 1.

    `columns` are the responses, complex or as pairs [real, imaginary]; `frequency` is the column of the
    lines; `deviation` and `coherence` have one column for each response. None: see `read_responses`.
    """

    columns: Sequence[ColumnName | list[ColumnName]] | None = None
    frequency: ColumnName | None = None
    deviation: Sequence[ColumnName] | None = None
    coherence: Sequence[ColumnName] | None = None


class MeasuredResponses(NamedTuple):
    """Frequency responses read from a file.

    `omega` (L) as in the file, `values` (L x columns), `deviation` and `coherence` (alike) if requested;
    what `quantities` the file says they are (empty: it does not), and whether its frequencies are in Hz; the
    `headings` of the columns, and that of the frequencies; `note` is a warning.
    """

    omega: Array
    values: ComplexArray
    deviation: Array | None = None
    coherence: Array | None = None
    quantities: Sequence[str] = ()
    in_hertz: bool = False
    headings: Sequence[Heading] = ()
    of_lines: Heading = Heading("", "")
    note: str = ""

    @property
    def columns(self) -> dict[str, NDArray[Any]]:
        """Arrays with one column for each channel, by name."""
        arrays = {"values": self.values, "deviation": self.deviation, "coherence": self.coherence}
        return {name: array for name, array in arrays.items() if array is not None}

    def at(self, lines: NDArray[np.bool_]) -> MeasuredResponses:
        """Return some of the lines."""
        return self._replace(
            omega=self.omega[lines],
            values=self.values[lines],
            deviation=None if self.deviation is None else self.deviation[lines],
            coherence=None if self.coherence is None else self.coherence[lines],
        )


def from_text(file: DataFile, layout: ResponseLayout) -> MeasuredResponses:
    """Return the frequency responses in a text file, with the headings of their columns."""
    columns = _TextResponses(file)
    measured = _measured(columns, layout)
    lines = columns.table.heading(columns.at)
    return measured._replace(headings=columns.headings(layout.columns), of_lines=lines)


def from_hdf5(file: DataFile, layout: ResponseLayout) -> MeasuredResponses:
    """Return the frequency responses in an HDF5 file."""
    return _measured(_Hdf5Responses(file), layout)


def from_matlab(file: DataFile, layout: ResponseLayout) -> MeasuredResponses:
    """Return the frequency responses in a MATLAB file."""
    return _measured(_MatlabResponses(file), layout)


def _measured(source: _ResponseFile, layout: ResponseLayout) -> MeasuredResponses:
    file = source.file
    omega = _real(file, source.frequency(layout.frequency), "the frequencies", "frequency")[:, 0]
    deviation, coherence = (
        _real(file, np.column_stack([source.column(column, name) for column in columns]), name, name)
        if columns
        else None
        for name, columns in (("deviation", layout.deviation), ("coherence", layout.coherence))
    )
    return MeasuredResponses(omega, _paired(source, layout.columns), deviation, coherence)


def _real(file: DataFile, values: NDArray[Any], what: str, key: str) -> Array:
    if np.iscomplexobj(values) and np.any(np.nan_to_num(values.imag)):
        file.refuse(f"{what} must be real", key=key)
    return np.asarray(values.real, dtype=float)


def _paired(table: _ResponseFile, columns: Sequence[ColumnName | list[ColumnName]] | None) -> ComplexArray:
    """Return the columns of responses; those that are named in pairs are real and imaginary parts."""
    if columns is None:
        return np.asarray(table.every(), dtype=complex)
    parts = []
    for column in columns:
        if isinstance(column, list):
            real, imaginary = (
                _real(table.file, table.column(name, "columns"), f"'{name}'", "columns") for name in column
            )
            parts.append(real + 1j * imaginary)
        else:
            parts.append(table.column(column, "columns"))
    if len({len(values) for values in parts}) > 1:
        table.file.refuse("has columns of different lengths", key="columns")
    return np.concatenate(parts, axis=1).astype(complex)


def _is_frequency(name: str) -> bool:
    return re.sub(r"[\[(].*", "", split_heading(name)[0]).strip().lower() in _FREQUENCY


class _ResponseFile(ABC):
    """Columns of a file of one format (L x columns)."""

    def __init__(self, file: DataFile) -> None:
        self.file = file

    @abstractmethod
    def frequency(self, name: ColumnName | None) -> NDArray[Any]:
        """Return the lines: the named column, else one with a known name."""

    @abstractmethod
    def column(self, name: ColumnName, key: str) -> NDArray[Any]:
        """Return the named column or columns; `key` is their key in the scene."""

    @abstractmethod
    def every(self) -> NDArray[Any]:
        """Return all responses; the scene names none."""


class _TextResponses(_ResponseFile):
    """Columns of a text file."""

    def __init__(self, file: DataFile) -> None:
        super().__init__(file)
        self.table = read_text(file, number=complex_number)
        self.at = next((k for k, name in enumerate(self.table.names) if _is_frequency(name)), 0)

    def frequency(self, name: ColumnName | None) -> NDArray[Any]:
        """Return the lines; without a name and a header the first column."""
        if name is None and self.table.names and not _is_frequency(self.table.names[self.at]):
            columns = ", ".join(self.table.names)
            self.file.refuse(f"has no column of frequencies; it has {columns}", "Name it: frequency: NAME.")
        self.at = self.at if name is None else self.table.find(name, "frequency")
        return self.table.values[:, [self.at]]

    def column(self, name: ColumnName, key: str) -> NDArray[Any]:
        """Return a column."""
        return self.table.values[:, [self.table.find(name, key)]]

    def headings(self, columns: Sequence[ColumnName | list[ColumnName]] | None) -> list[Heading]:
        """Return the headings of responses; of pairs that of the real part."""
        if columns is None:
            alternate = 1 if self._complex else 2
            return [self.table.heading(k) for k in self._others[::alternate]]
        first = [column[0] if isinstance(column, list) else column for column in columns]
        return [self.table.heading(self.table.find(name, "columns")) for name in first]

    @property
    def _others(self) -> list[int]:
        return [k for k in range(self.table.values.shape[1]) if k != self.at]

    @property
    def _complex(self) -> bool:
        return bool(np.any(np.nan_to_num(self.table.values[:, self._others].imag)))

    def every(self) -> NDArray[Any]:
        """Return all columns but the frequencies: complex ones, or real and imaginary parts by turns."""
        others, values = self._others, self.table.values[:, self._others]
        if self._complex:
            return values
        if len(others) % 2:
            self.file.refuse(
                f"has {len(others)} columns of real numbers beside the frequencies",
                "Real and imaginary parts stand by turns; or name the pairs: columns: [[REAL, IMAGINARY]].",
                key="columns",
            )
        return np.asarray(values[:, ::2] + 1j * values[:, 1::2])


class _Hdf5Responses(_ResponseFile):
    """Datasets of an HDF5 file."""

    def frequency(self, name: ColumnName | None) -> NDArray[Any]:
        """Return the lines: the named dataset, else one of the known names beside the responses."""
        if name is not None:
            return self._read([str(name)], "frequency")
        at = next(iter(present(self.file, _MEASURED)), "")
        folder = at.rpartition("/")[0]
        siblings = [f"{folder}/{standard}".lstrip("/") for standard in _FREQUENCY]
        return self._read([*siblings, *_FREQUENCY], "frequency")

    def column(self, name: ColumnName, key: str) -> NDArray[Any]:
        """Return a dataset: one column or several."""
        return self._read([str(name)], key)

    def every(self) -> NDArray[Any]:
        """Return the dataset of the measured responses."""
        return self._read(_MEASURED, "columns")

    def _read(self, names: Sequence[str], key: str) -> NDArray[Any]:
        """Return the first of these datasets in the file, as columns."""
        name = next(iter(present(self.file, names)), names[0])
        return complex_datasets(self.file, name, key)


class _MatlabResponses(_ResponseFile):
    """Variables of a MATLAB file."""

    def frequency(self, name: ColumnName | None) -> NDArray[Any]:
        """Return the lines: the named variable, else one of the known names."""
        return complex_columns(self.file, _FREQUENCY if name is None else [str(name)], "frequency")

    def column(self, name: ColumnName, key: str) -> NDArray[Any]:
        """Return a variable: one column or several."""
        return complex_columns(self.file, [str(name)], key)

    def every(self) -> NDArray[Any]:
        """Refuse: variables have no order."""
        self.file.refuse("has variables; none of them is known to be a response", "Name them: columns: […].")


def from_universal(file: DataFile, layout: ResponseLayout) -> MeasuredResponses:
    """Return the frequency responses in a Universal File, and the coherences that the scene names."""
    functions = read_functions(file)
    responses = _chosen(file, functions, _FRF, "frequency response", layout.columns, "columns")
    lines = responses[0].x
    coherence = None
    parts = list(responses)
    if layout.coherence:
        parts += (several := _chosen(file, functions, _COHERENCE, "coherence", layout.coherence, "coherence"))
        coherence = np.column_stack([function.values.real for function in several])
    if layout.deviation:
        file.refuse("holds functions, no deviations", "Give their coherence.", key="deviation")
    for function in parts:
        if function.x.shape != lines.shape or not np.allclose(function.x, lines, rtol=_LINE_RTOL, atol=0):
            file.refuse(
                f"the function {function.name} has other lines than the first",
                "Put responses at different lines into files of their own.",
            )
    values = np.column_stack([function.values for function in responses]).astype(complex)
    quantities = [function.quantity for function in responses]
    headings = [Heading(response.name, response.units.stated, response.units.doubt) for response in responses]
    return MeasuredResponses(lines, values, None, coherence, quantities, in_hertz=True, headings=headings)


def _chosen(
    file: DataFile,
    functions: Sequence[UniversalFunction],
    kind: int,
    what: str,
    columns: Sequence[Any] | None,
    key: str,
) -> list[UniversalFunction]:
    """Return the functions of a type by name, or by number among those of the type; default: all."""
    candidates = [function for function in functions if function.kind == kind]
    if not candidates:
        file.refuse(f"holds no {what}", f"Data sets 58 of function type {kind} are read.")
    chosen = []
    for name in range(1, len(candidates) + 1) if columns is None else columns:
        if isinstance(name, list):
            file.refuse("holds complex functions, no pairs of columns", key=key)
        named = [function for function in candidates if function.name == name]
        if isinstance(name, int) and 1 <= name <= len(candidates):
            named = [candidates[name - 1]]
        if len(named) != 1:
            has = f"{len(named) or 'no'} {what} '{name}'"
            file.refuse(f"has {has}; there are {len(candidates)}", "Give its number among them.", key=key)
        chosen += named
    return chosen
