"""Universal Files: their data sets, units, and functions at nodal DOFs (58), read through pyuff."""

from __future__ import annotations

import contextlib
import io
import math
import tempfile
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError
from dynid.files.table import ColumnRequest, DataFile, DataTable
from dynid.files.universal_blocks import (
    HEADER,
    BlockError,
    DataSet,
    check_columns,
    data_sets,
    function_values,
)
from dynid.files.untrusted import MOST_NUMBERS, read_errors
from dynid.units import UnknownUnitError, readings, si_factor, unit_fits

EXTENSIONS = (".uff", ".unv")
"""The endings of Universal Files."""

#: Lines with numbers in columns of a fixed width by data set; those whose rows are joined, then split.
_IN_COLUMNS: dict[int, tuple[int, int | None]] = {18: (0, None), 55: (0, None), 2414: (12, 14)}
_JOINED = (15, 2420)
#: Types of functions of time, general or not.
_TIME = (0, 1)
#: Digits of an increment as the format prints it.
_INCREMENT_RTOL = 1e-5
#: Directions by their numbers in data sets 58: displacements along the node's axes, rotations about them.
_DIRECTIONS = ("", "x", "y", "z", "rx", "ry", "rz")
#: Quantities of ordinates by their specific data types.
_QUANTITIES = {8: "displacement", 9: "force", 11: "velocity", 12: "acceleration", 13: "force"}


class UniversalFunction(NamedTuple):
    """A data set 58: its name, type, abscissa and values; its ends, quantities and units.

    `response` and `reference` are node and signed direction, such as ``(20, "-z")``; the direction is empty
    for a scalar. `quantity` and `over` are those of ordinate and denominator, ``displacement``, ``velocity``,
    ``acceleration`` or ``force``, empty where the file does not say; `labels` are their units as printed, and
    `units` what follows from these and from the record of units. Values are as in the file. `x` and `values`
    (`points` of them) are empty where only headers are read. `step` is the increment of an even abscissa.
    """

    name: str
    kind: int
    x: NDArray[np.float64]
    values: NDArray[Any]
    points: int
    even: bool
    step: float
    response: tuple[int, str]
    reference: tuple[int, str]
    quantity: str
    over: str
    labels: tuple[str, str]
    units: _FunctionUnits


class UniversalFile:
    """Data sets of a Universal File."""

    def __init__(self, file: DataFile) -> None:
        try:
            pyuff: Any = import_module("pyuff")  # an extra: only users of this format need it
        except ImportError:
            file.refuse("is a Universal File, and pyuff is not installed", "Install it: dynid[formats].")
        file.check()
        if file.path.stat().st_size > 8 * MOST_NUMBERS:
            file.refuse(f"is larger than the {8 * MOST_NUMBERS} bytes that are read")
        self.file = file
        try:
            self._data_sets = data_sets(file.path.read_bytes())
        except BlockError as error:
            file.refuse(str(error))
        except OSError as error:
            file.refuse(f"cannot be read: {error.strerror or error}")
        self._source = pyuff.UFF
        self.kinds = [data_set.kind for data_set in self._data_sets]

    def sets(self, *kinds: int, header: bool = False) -> Iterator[dict[str, Any]]:
        """Yield the data sets of some kinds, in order; with `header` data sets 58 without their values."""
        for number, data_set in enumerate(self._data_sets, 1):
            if data_set.kind not in kinds:
                continue
            with self.errors():
                parsed = self._parsed(number, data_set)
                if data_set.kind == 58 and not header:
                    parsed["x"], parsed["data"] = function_values(data_set, parsed)
            yield parsed

    def _parsed(self, number: int, data_set: DataSet) -> dict[str, Any]:
        """Return what pyuff reads of a data set; of functions (58) the header."""
        if data_set.kind in _IN_COLUMNS:
            check_columns(data_set, *_IN_COLUMNS[data_set.kind])
        # pyuff joins the rows of some data sets, and reads files alone.
        lines = data_set.lines[:HEADER] if data_set.kind == 58 else data_set.lines
        margin = " " if data_set.kind in _JOINED else ""
        text = "".join(f"{margin}{line}\n" for line in lines[1:])
        with tempfile.TemporaryDirectory(prefix="dynid-") as folder:
            path = Path(folder, "one.uff")
            path.write_text(f"    -1\n{lines[0]}\n{text}    -1\n", encoding="utf-8", newline="\n")
            parsed = None
            with contextlib.suppress(Exception):  # of which pyuff says nothing
                parsed = self._source(str(path)).read_sets(0, header_only=True)
        if not isinstance(parsed, dict) or not parsed:
            raise ValueError(
                f"data set {number} (of type {data_set.kind}, from line {data_set.line}) is not as its "
                "format says"
            )
        return parsed

    def units(self) -> FileUnits:
        """Return the units of the file, of its record 164; SI where it has none."""
        records = set()
        for record in self.sets(164):
            records.add(units := FileUnits(float(record["length"]), float(record["force"]), recorded=True))
            if fault := units.fault(int(record["units_code"])):
                self.file.refuse(fault, "Correct the record.")
        if len(records) > 1:
            self.file.refuse("has several records of units (164) that differ", "Split the file.")
        return next(iter(records), FileUnits())

    def functions(self, *, header: bool = False) -> list[UniversalFunction]:
        """Return all data sets 58; with `header` without their values."""
        parsed, units = [], self.units()
        for number, data_set in enumerate(self.sets(58, header=header), 1):
            with self.errors():
                parsed.append(_function(self.file, number, data_set, units, header=header))
        return parsed

    @contextlib.contextmanager
    def errors(self) -> Iterator[None]:
        """Turn errors of pyuff, and of damaged contents, into located ones; what it prints is dropped."""
        file = self.file
        try:
            with (
                read_errors(file.path, "a Universal File"),
                np.errstate(all="ignore"),
                contextlib.redirect_stdout(io.StringIO()),
            ):
                yield
        except FileError as error:
            if error.names or not file.place:
                raise
            raise FileError(error.problem, remedy=error.remedy, names=[f"{file.place}.path"]) from None


def read_functions(file: DataFile) -> list[UniversalFunction]:
    """Return all data sets 58 of a Universal File."""
    return UniversalFile(file).functions()


def is_universal(path: Path) -> bool:
    """Return True of a Universal File, by its ending."""
    return path.suffix.lower() in EXTENSIONS


def read_columns(file: DataFile, request: ColumnRequest) -> DataTable:
    """Return the time histories of a Universal File as columns, in order."""
    request.layout.only(file)
    functions = [function for function in read_functions(file) if function.kind in _TIME]
    if not functions:
        file.refuse("holds no time history", "Data sets 58 of function type 1 are read.")
    times = functions[0].x
    for number, function in enumerate(functions, 1):
        if np.iscomplexobj(function.values):
            file.refuse(f"function {number} ({function.name}) is complex; a record is real")
        if function.x.shape != times.shape or not np.allclose(function.x, times, rtol=1e-9, atol=0):
            file.refuse(
                f"function {number} ({function.name}) has other times than the first",
                "Put records of different sampling into files of their own.",
            )
    coarse = 0.0 if functions[0].even else _stored_precision(times)
    names, units = ([*item] for item in zip(*((item.name, item.units) for item in functions), strict=True))
    values = np.column_stack([function.values for function in functions])
    # Names of functions repeat in practice; numbers distinguish them. None of them is a column of times.
    return DataTable(
        file,
        names,
        values,
        None,
        times,
        coarse * np.abs(times),
        timed=-1,
        units=[item.stated for item in units],
        doubts=[item.doubt for item in units],
    )


def _function(
    file: DataFile, number: int, data_set: Any, units: FileUnits, *, header: bool
) -> UniversalFunction:
    """Return a data set that has as many points as it claims."""
    values = np.asarray(() if header else data_set["data"])
    x = np.asarray(() if header else data_set["x"], dtype=float)
    claimed = int(data_set["num_pts"])
    if not header and (values.ndim != 1 or len(values) != claimed or x.shape != values.shape or not claimed):
        file.refuse(
            f"function {number} claims {claimed} points, but {values.size} can be read", "It is damaged."
        )
    response, reference = _end(data_set, "rsp"), _end(data_set, "ref")
    quantity, over = (
        _QUANTITIES.get(int(data_set.get(f"{axis}_spec_data_type", 0)), "")
        for axis in ("ordinate", "orddenom")
    )
    labels = _label(data_set, "ordinate"), _label(data_set, "orddenom")
    step = float(data_set["abscissa_inc"])
    if np.isfinite(step) and step > 0:  # six digits are printed
        step = _of_whole_rate(step, 0.5 * 10 ** (np.floor(np.log10(step)) - 5))
    return UniversalFunction(
        str(data_set.get("id1", "")).strip() or f"function {number}",
        int(data_set["func_type"]),
        x,
        values,
        claimed,
        int(data_set["abscissa_spacing"]) == 1,
        step,
        response,
        reference,
        quantity,
        over,
        labels,
        function_units(quantity, response[1], over, reference[1], labels, units),
    )


def _of_whole_rate(step: float, rounding: float) -> float:
    """Return the step of the only whole rate within a rounding of it, else the step."""
    if step <= rounding:
        return step
    low, high = np.ceil(1 / (step + rounding)), np.floor(1 / (step - rounding))
    return float(1 / low) if low == high else step


def mean_step(x: NDArray[np.float64]) -> float:
    """Return the mean increment of an abscissa between points that may be missing; 0 of fewer than two."""
    if len(x) < 2:
        return 0.0
    steps, rounding = np.diff(x), _stored_precision(x) * float(abs(x[0]) + abs(x[-1]))
    usual = float(np.median(steps))
    intervals = len(steps)
    if usual > 4 * rounding:
        intervals = int(np.maximum(np.round(steps / usual), 1).sum())
    return _of_whole_rate(float(x[-1] - x[0]) / intervals, rounding / intervals)


def _stored_precision(x: NDArray[np.float64]) -> float:
    """Return the relative rounding of abscissae that are stored one by one: six digits in text."""
    if np.array_equal(x, [float(f"{value:.5e}") for value in x]):
        return _INCREMENT_RTOL
    single = np.array_equal(x, x.astype(np.float32))
    return float(np.finfo(np.float32 if single else np.float64).eps)


def _end(data_set: Any, end: str) -> tuple[int, str]:
    """Return node and signed direction of the response or reference."""
    number = int(data_set[f"{end}_dir"])
    direction = _DIRECTIONS[abs(number)] if abs(number) < len(_DIRECTIONS) else ""
    return int(data_set[f"{end}_node"]), "-" * (number < 0 and bool(direction)) + direction


def _label(data_set: Any, which: str) -> str:
    """Return a printed unit; empty where there is none."""
    label = str(data_set.get(f"{which}_axis_units_lab", "")).strip()
    return "" if label.upper() == "NONE" else label


#: How many units are one metre, and one newton.
_LENGTHS = {name: 1 / si_factor(name, ["m"]) for name in ("m", "cm", "mm", "um", "in", "ft")}
_FORCES = {name: 1 / si_factor(name, ["N"]) for name in ("N", "cN", "mN", "kN", "kgf", "lbf", "poundal")}
#: Units by their code in a record 164; 9 is any.
_CODES = {
    1: ("m", "N"),
    2: ("ft", "lbf"),
    3: ("m", "kgf"),
    4: ("ft", "poundal"),
    5: ("mm", "mN"),
    6: ("cm", "cN"),
    7: ("in", "lbf"),
    8: ("mm", "kgf"),
    10: ("mm", "N"),
}
#: Factors have six digits at least.
_FACTOR_DIGITS = 1e-5
_PER_TIME = {"displacement": "", "velocity": "/s", "acceleration": "/s2"}


class FileUnits(NamedTuple):
    """Units of a file: how many of them are one metre, and one newton; and whether a record 164 says so."""

    length: float = 1.0
    force: float = 1.0
    recorded: bool = False

    @property
    def names(self) -> tuple[str, str]:
        """Names of the units of length and force; empty of uncommon ones."""
        return _name(_LENGTHS, self.length), _name(_FORCES, self.force)

    def fault(self, code: int) -> str:
        """Return what is wrong with a record of these factors and this code; empty if nothing is."""
        if not all(math.isfinite(factor) and factor > 0 for factor in (self.length, self.force)):
            return f"its record of units (164) has the factors {self.length:g}, {self.force:g}"
        if code in _CODES and self.names != _CODES[code]:
            said = " and ".join(_CODES[code])
            return (
                f"its record of units (164) says {said} (code {code}), but has the factors {self.length:g}, "
                f"{self.force:g}"
            )
        return ""


class _FunctionUnits(NamedTuple):
    """Unit of a function by its `label` and the `record` of units (empty: none), and why in doubt."""

    label: str = ""
    record: str = ""
    doubt: str = ""

    @property
    def stated(self) -> str:
        """The unit; empty where it is not stated, or in doubt."""
        return "" if self.doubt else self.label or self.record


def function_units(
    quantity: str, along: str, over: str, across: str, labels: tuple[str, str], units: FileUnits
) -> _FunctionUnits:
    """Return the unit of a function by its quantity over another, directions, labels, and file."""
    label = _labelled(labels)
    if not quantity:
        plain = units.length == units.force == 1
        doubt = "" if label or plain else "its type does not say what it is, and its file is not in SI units"
        return _FunctionUnits(label, "", doubt)
    si = _unit(quantity, along, over, across, ("m", "N"))
    if label and not unit_fits(label, [si]):
        product = _quotient(label, _unit(over, across, "", "", ("m", "N"))) if over else ""
        if not (product and unit_fits(product, [si])):
            return _FunctionUnits(
                label, "", f"its type says {quantity}{f' over {over}' if over else ''}, its label {label}"
            )
        label = product
    if not units.recorded:
        return _FunctionUnits(label)
    if not all(units.names):
        doubt = (
            "" if label else f"of its units {units.length:g} are one metre, and {units.force:g} one newton"
        )
        return _FunctionUnits(label, "", doubt)
    record = _unit(quantity, along, over, across, units.names)
    doubt = f"its label says {label}, the record of units (164) {record}"
    return _FunctionUnits(label, record, "" if not label or _same(label, record, si) else doubt)


def _name(units: dict[str, float], factor: float) -> str:
    return next((name for name, size in units.items() if abs(factor / size - 1) < _FACTOR_DIGITS), "")


def _unit(quantity: str, along: str, over: str, across: str, names: tuple[str, str]) -> str:
    """Return the unit of a quantity, over that of another, made of units of length and force."""
    length, force = names
    turning = along.lstrip("-").startswith("r")
    if quantity == "force":
        above = f"{force}.{length}" if turning else force
    else:
        above = f"{'rad' if turning else length}{_PER_TIME[quantity]}"
    return _quotient(above, _unit(over, across, "", "", names)) if over else above


def _quotient(above: str, below: str) -> str:
    return f"({above})/({below})"


def _labelled(labels: tuple[str, str]) -> str:
    """Return the unit that the labels of the axes are; empty where they are none."""
    above, below = labels
    text = _quotient(above, below) if above and below else above
    try:
        readings(text)
    except UnknownUnitError:
        return ""
    return text


def _same(unit_a: str, unit_b: str, si: str) -> bool:
    """Return True if two units of the dimension of a third are the same."""
    factors = [
        [unit.factor for unit in readings(text) if any(unit.dimension == of.dimension for of in readings(si))]
        for text in (unit_a, unit_b)
    ]
    return any(abs(a / b - 1) < _FACTOR_DIGITS for a in factors[0] for b in factors[1])
