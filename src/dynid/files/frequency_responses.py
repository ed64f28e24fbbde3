"""Frequency response functions read from text, HDF5, MATLAB and Universal File Format 58."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, NoReturn, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray
from dynid.file_access import supplied
from dynid.files.hdf5_data import complex_datasets, present
from dynid.files.matlab import complex_columns
from dynid.files.table import DataFile, Heading
from dynid.files.text_table import complex_number, read_text
from dynid.files.universal_file import UniversalFunction, read_functions
from dynid.suggestions import did_you_mean, shortened
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
    """Return the frequency responses in a text file, with the headings of their columns.

    Without a name and a header the first column is that of the frequencies.
    """
    table = read_text(file, number=complex_number)
    at = next((k for k, name in enumerate(table.names) if _is_frequency(name)), 0)
    if layout.frequency is not None:
        at = table.find(layout.frequency, "frequency")
    elif table.names and not _is_frequency(table.names[at]):
        columns = ", ".join(table.names)
        file.refuse(f"has no column of frequencies; it has {columns}", "Name it: frequency: NAME.")
    used = [k for k in range(table.values.shape[1]) if k != at]
    responses = table.values[:, used]
    if layout.columns is not None:
        first = [column[0] if isinstance(column, list) else column for column in layout.columns]
        used = [table.find(name, "columns") for name in first]
    elif not np.any(np.nan_to_num(responses.imag)):  # real and imaginary parts by turns
        if len(used) % 2:
            file.refuse(
                f"has {len(used)} columns of real numbers beside the frequencies",
                "Real and imaginary parts stand by turns; or name the pairs: columns: [[REAL, IMAGINARY]].",
                key="columns",
            )
        used, responses = used[::2], responses[:, ::2] + 1j * responses[:, 1::2]

    def column(names: Sequence[ColumnName], key: str) -> NDArray[Any]:
        return table.values[:, [table.find(names[0], key)]]

    measured = _measured(file, layout, column, table.values[:, [at]], lambda: responses)
    return measured._replace(headings=[table.heading(k) for k in used], of_lines=table.heading(at))


def from_hdf5(file: DataFile, layout: ResponseLayout) -> MeasuredResponses:
    """Return the frequency responses in an HDF5 file; frequencies stand beside those that no scene names."""

    def column(names: Sequence[ColumnName], key: str) -> NDArray[Any]:
        texts = [str(name) for name in names]
        return complex_datasets(file, next(iter(present(file, texts)), texts[0]), key)

    folder = next(iter(present(file, _MEASURED)), "").rpartition("/")[0]
    standard = [*(f"{folder}/{name}".lstrip("/") for name in _FREQUENCY), *_FREQUENCY]
    omega = column(standard if layout.frequency is None else [layout.frequency], "frequency")
    return _measured(file, layout, column, omega, lambda: column(_MEASURED, "columns"))


def from_matlab(file: DataFile, layout: ResponseLayout) -> MeasuredResponses:
    """Return the frequency responses in a MATLAB file, whose variables have no order."""

    def column(names: Sequence[ColumnName], key: str) -> NDArray[Any]:
        return complex_columns(file, [str(name) for name in names], key)

    def default() -> NoReturn:
        file.refuse("has variables; none of them is known to be a response", "Name them: columns: […].")

    omega = column(_FREQUENCY if layout.frequency is None else [layout.frequency], "frequency")
    return _measured(file, layout, column, omega, default)


def from_arrays(file: DataFile, layout: ResponseLayout) -> MeasuredResponses:
    """Return the frequency responses in arrays that stand in place of a file; by default all of them."""
    arrays = supplied(file.path)

    def column(names: Sequence[ColumnName], key: str) -> NDArray[Any]:
        name = next((name for name in names if name in arrays), None)
        if name is None:
            hint = did_you_mean(str(names[0]), arrays) or f"; it has {shortened([*arrays])}"
            file.refuse(f"has no array '{names[0]}'{hint}", key=key)
        return np.asarray(arrays[name]).reshape(len(arrays[name]), -1)

    frequency = _FREQUENCY if layout.frequency is None else [layout.frequency]
    others = [name for name in arrays if name not in frequency]
    omega = column(frequency, "frequency")
    return _measured(
        file, layout, column, omega, lambda: np.column_stack([column([name], "columns") for name in others])
    )


def _measured(
    file: DataFile,
    layout: ResponseLayout,
    column: Callable[[Sequence[ColumnName], str], NDArray[Any]],
    omega: NDArray[Any],
    default: Callable[[], NDArray[Any]],
) -> MeasuredResponses:
    """Return responses; `column` reads the first of some names, `default` all responses if none is named.

    Columns that are named in pairs are real and imaginary parts.
    """
    lines = _real(file, omega, "the frequencies", "frequency")[:, 0]
    deviation, coherence = (
        _real(file, np.column_stack([column([name], key) for name in names]), key, key) if names else None
        for key, names in (("deviation", layout.deviation), ("coherence", layout.coherence))
    )
    parts = []
    for name in layout.columns or ():
        if isinstance(name, list):
            real, imaginary = (
                _real(file, column([part], "columns"), f"'{part}'", "columns") for part in name
            )
            parts.append(real + 1j * imaginary)
        else:
            parts.append(column([name], "columns"))
    if len({len(values) for values in parts}) > 1:
        file.refuse("has columns of different lengths", key="columns")
    values = default() if layout.columns is None else np.concatenate(parts, axis=1)
    return MeasuredResponses(lines, np.asarray(values, dtype=complex), deviation, coherence)


def _real(file: DataFile, values: NDArray[Any], what: str, key: str) -> Array:
    if np.iscomplexobj(values) and np.any(np.nan_to_num(values.imag)):
        file.refuse(f"{what} must be real", key=key)
    return np.asarray(values.real, dtype=float)


def _is_frequency(name: str) -> bool:
    return re.sub(r"[\[(].*", "", split_heading(name)[0]).strip().lower() in _FREQUENCY


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
            names = [function.name for function in candidates]
            hint = "" if named else did_you_mean(str(name), names)
            has = f"{len(named) or 'no'} {what} '{name}'"
            listed = f"there are {len(candidates)}: {shortened(list(dict.fromkeys(names)), 8)}"
            file.refuse(f"has {has}{hint}; {listed}", "Give its number among them.", key=key)
        chosen += named
    return chosen
