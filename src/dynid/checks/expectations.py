"""Expectations of a scene (`expect:`) checked on its result, and their JUnit file."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.checks.comparison import RTOL, as_array, close, word, words_of
from dynid.number_format import general
from dynid.result import Result, Scalar, Variable, coordinate_path
from dynid.suggestions import did_you_mean, did_you_mean_path, shortened


@dataclass(frozen=True)
class CheckOutcome:
    """The outcome of one expectation, with its message."""

    passed: bool
    path: str
    expected: str
    found: str
    message: str


class _Unmet(Exception):
    """Raised with the reason where an expectation is not met."""


@dataclass(frozen=True)
class LabelledAxis:
    """A dimension with its labels; without a coordinate, numbers from 1."""

    dim: str
    labels: NDArray[Any]
    units: str = ""

    def find(self, label: Any) -> int | None:
        """Return the index of a label: texts are compared exactly, numbers to rounding."""
        if self.labels.dtype.kind == "O" or isinstance(label, str):
            hits = [index for index, entry in enumerate(self.labels) if entry == label]
        else:
            hits = list(np.flatnonzero(np.isclose(self.labels, label, rtol=RTOL, atol=0)))
        return int(hits[0]) if hits else None

    def hint(self, label: Any) -> str:
        """Return what may be meant by a label that is default: a similar text, else the labels there are."""
        similar = did_you_mean(label, map(str, self.labels)) if isinstance(label, str) else ""
        return similar or f"; there are: {shortened([word(entry) for entry in self.labels]) or 'none'}"


def axis_of(result: Mapping[str, Variable], path: str, dim: str, length: int) -> LabelledAxis:
    """Return a dimension of an array, with the coordinate in its group or the nearest one above."""
    coordinate = result.get(coordinate_path(result, path, dim) or "")
    if coordinate is None or coordinate.shape != (length,) or coordinate.dtype.names:
        return LabelledAxis(dim, np.arange(1, length + 1))
    return LabelledAxis(dim, coordinate.data, coordinate.units)


def check_expectations(result: Result, expectations: Iterable[Mapping[str, Any]]) -> list[CheckOutcome]:
    """Check a result against a scene's `expect` list.

    Parameters
    ----------
    result
        The result.
    expectations
        Mappings with `path` (of an array, or of an attribute of a group or array), optionally `at`
        (dimension: label, to select entries by coordinate, or by number from 1 where there is none), and
        one or more of `value` (with `rtol`, default 1e-9, and `atol`, default 0), `min`, `max` and
        `max_abs`. A single value or bound holds for every entry of an array; a complex number is
        [re, im] or a text such as 1+2j. With `part` (real, imaginary or magnitude), that of complex numbers
        is compared; with `unit` Hz, frequencies in rad/s are compared in Hz.

    Returns
    -------
    list of CheckOutcome
        One for each expectation, in order. NaN meets none. Of several entries that miss, the message names
        the one that misses most: relative to its tolerance, to its `max_abs`, or beyond `min` and `max`.
    """
    return [_check(result, expectation) for expectation in expectations]


def _check(result: Result, expectation: Mapping[str, Any]) -> CheckOutcome:
    path = str(expectation["path"]).strip("/")
    expected, answer = expected_words(expectation), "nothing"
    unit = f" {expectation['unit']}" if "unit" in expectation else ""
    try:
        index, axes = _select(result, path, expectation.get("at", {}))
        picked = _lookup(result, path)
        data = _compared(picked, np.asarray(picked.data[index], dtype=picked.dtype), expectation)
        verb = f"has the {_PARTS[expectation['part']]}" if "part" in expectation else "is"
        unit = unit or (f" {picked.units}" if picked.units else "")
        answer = short if (short := _short_words(data)) == "-" else short + unit
        named: dict[tuple[int, ...], str] = {}
        for demand in _demands(data, data.shape, expectation):
            misses = demand.misses()
            if not len(misses) or (worst := tuple(misses[0])) in named:
                continue
            labels = [f"{axis.dim} {word(axis.labels[at])}" for axis, at in zip(axes, worst, strict=True)]
            where = f" at {', '.join(labels)}" if labels else ""
            count = f" ({len(misses)} of {data.size} entries miss)" if data.size > 1 else ""
            bound = demand.expected[worst]
            said = _undefined(picked, data[worst]) or f"{_missing_word(data[worst], bound)}{unit}"
            named[worst] = f"{verb} {said}{where}, {demand.words}{word(bound)}{unit}{count}"
        if named:
            raise _Unmet("; ".join(named.values()))
    except _Unmet as unmet:
        return CheckOutcome(False, path, expected, answer, f"{path.rpartition('/')[2]} {unmet}")
    return CheckOutcome(True, path, expected, answer, f"{path.rpartition('/')[2]} is {answer}")


def _short_words(data: NDArray[Any]) -> str:
    """Return a few values as text, numbers with at most six digits; one value without brackets."""
    if data.dtype.names or data.size > 6:
        return words_of(data)
    if data.dtype.kind not in "fc":
        return words_of(data.reshape(()) if data.size == 1 else data)
    texts = []
    for value in data.ravel().tolist():
        if isinstance(value, complex):
            texts.append("-" if np.isnan(value) else f"{value:.6g}")
        else:
            texts.append(general(value, 6))
    return texts[0] if data.size == 1 else f"[{', '.join(texts)}]"


def _undefined(variable: Variable, value: Any) -> str:
    """Return why a value is not defined, where its array says so; else ''."""
    reason = variable.attrs.get("undefined", "")
    return f"not defined ({reason})" if reason and value != value else ""


def _missing_word(value: Any, bound: Any) -> str:
    """Return a value that misses what is expected, with the fewest digits, at least four, that show it."""
    real = all(np.asarray(number).dtype.kind == "f" and np.isfinite(number) for number in (value, bound))
    if not real or float(value).is_integer():
        return word(value)
    tolerance = abs(value - bound) / 10
    texts = (f"{value:.{digits}g}" for digits in range(4, 17))
    return next((text for text in texts if abs(float(text) - value) <= tolerance), word(value))


#: Parts of complex numbers that an expectation may be of, in words.
_PARTS = {"real": "real part", "imaginary": "imaginary part", "magnitude": "magnitude"}


def _compared(variable: Variable, data: NDArray[Any], expectation: Mapping[str, Any]) -> NDArray[Any]:
    """Return the part of entries that is expected, in the unit of the expectation: rad/s or Hz."""
    if component := expectation.get("part"):
        if data.dtype.kind != "c":
            raise _Unmet(f"is {words_of(data)}, which is not complex: leave out 'part'")
        data = (
            np.abs(data)
            if component == "magnitude"
            else np.asarray(data.real if component == "real" else data.imag)
        )
    if "unit" not in expectation:
        return data
    if variable.units != "rad/s":
        raise _Unmet(f"is in {variable.units or 'no unit'}, which is no frequency: leave out 'unit'")
    return data / (2 * math.pi) if expectation["unit"] == "Hz" else data


def expected_words(expectation: Mapping[str, Any]) -> str:
    """Return the text of an expectation, without its path."""
    words = {"value": "=", "min": ">=", "max": "<=", "max_abs": "|.| <="}
    parts = [f"{sign} {word(expectation[key])}" for key, sign in words.items() if key in expectation]
    where = ", ".join(f"{dim} {_label(label)}" for dim, label in expectation.get("at", {}).items())
    unit = f" {expectation['unit']}" if "unit" in expectation else ""
    prefix = f"{_PARTS[expectation['part']]} " if "part" in expectation else ""
    return f"{'at ' + where + ' ' if where else ''}{prefix}{' and '.join(parts)}{unit}"


def _label(label: object) -> object:
    """Return a label as the scene has it: YAML numbers are read as floats."""
    return int(label) if isinstance(label, float) and label.is_integer() else label


def samples_meet(
    samples: Mapping[str, Variable],
    count: int,
    sample: Callable[[int], Result],
    expectations: Iterable[Mapping[str, Any]],
) -> NDArray[np.bool_]:
    """Return a mask (sample x expectation) of the expectations that each sample meets, for all at once.

    `samples` are arrays by path, the samples along their first axis; `sample` returns the result of one.
    """
    first = sample(0)
    columns = []
    for expectation in expectations:
        dims = expectation.get("at", {})
        labels = [
            variable.data for variable in samples.values() for dim in dims if variable.dims[1:] == (dim,)
        ]
        if any(not np.array_equal(data, np.broadcast_to(data[0], data.shape)) for data in labels):
            columns.append(np.array([_check(sample(index), expectation).passed for index in range(count)]))
        else:
            columns.append(_met(samples, count, first, expectation))
    return np.column_stack(columns)


def _met(
    samples: Mapping[str, Variable], count: int, first: Result, expectation: Mapping[str, Any]
) -> NDArray[np.bool_]:
    path = str(expectation["path"]).strip("/")
    met = np.ones(count, dtype=bool)
    if path not in samples:
        met[:] = _check(first, expectation).passed
        return met
    try:
        index, _ = _select(first, path, expectation.get("at", {}))
        data = _compared(samples[path], samples[path].data[(slice(None), *index)], expectation)
        for demand in _demands(data, data.shape[1:], expectation):
            met &= demand.met.reshape(count, -1).all(axis=1)
    except _Unmet:
        met[:] = False
    return met


def _select(result: Result, path: str, at: Mapping[str, Any]) -> tuple[tuple[Any, ...], list[LabelledAxis]]:
    """Return the index of the selected entries, and their axes."""
    variable = _lookup(result, path)
    shape = variable.data.shape
    axes = [axis_of(result, path, dim, length) for dim, length in zip(variable.dims, shape, strict=True)]
    index: list[Any] = [slice(None)] * len(axes)
    names = [axis.dim for axis in axes]
    for dim, label in at.items():
        if dim not in names:
            raise _Unmet(f"has no dimension '{dim}'{did_you_mean(dim, names)}")
        number = names.index(dim)
        entry = axes[number].find(label)
        if entry is None:
            raise _Unmet(f"has no {dim} {_label(label)}{axes[number].hint(label)}")
        index[number] = entry
    return tuple(index), [axis for axis, entry in zip(axes, index, strict=True) if isinstance(entry, slice)]


def _lookup(result: Result, path: str) -> Variable:
    if path in result:
        return result[path]
    attrs = {name: value for name, value in result.attrs.items() if name != "scene"}
    scalars: dict[str, Scalar] = {"kind": result.kind, "title": result.title, **attrs}
    for group, values in result.group_attrs.items():
        scalars |= {f"{group}/{name}": value for name, value in values.items()}
    for name, variable in result.items():
        scalars |= {f"{name}/{attr}": value for attr, value in variable.attrs.items()}
    if path not in scalars:
        if status := _status(result, path):
            raise _Unmet(f"has no value; {status}")
        raise _Unmet(f"is not in the result: no '{path}'{did_you_mean_path(path, [*result, *scalars])}")
    value = scalars[path]
    return Variable((), as_array(value))


@dataclass(frozen=True)
class _Demand:
    """What is expected of all entries of an array."""

    met: NDArray[Any]  # mask of the entries that meet it
    words: str  # before the expected value
    compared: NDArray[Any]  # the entries, or their magnitudes
    expected: NDArray[Any]  # the expected values
    tolerance: NDArray[Any]  # unit in which a miss is large

    def misses(self) -> NDArray[np.intp]:
        """Return the indices of the entries that miss, the worst one first: miss x axis."""
        places = np.argwhere(~self.met)
        if self.compared.dtype.kind not in "ifc":
            return places
        missing = ~self.met
        with np.errstate(all="ignore"):
            miss = np.abs(self.compared[missing] - self.expected[missing])
            excess = miss / self.tolerance[missing]
        # NaN, and any miss where nothing is tolerated, is beyond all others; of those the largest is worst.
        order = np.lexsort([-np.where(np.isnan(key), np.inf, key) for key in (miss, excess)])
        return places[order]


def _status(result: Result, path: str) -> str:
    """Return the status that says why an array was left out, where its group has one; else ''."""
    group, _, name = path.rpartition("/")
    for path_of_status, variable in result.items():
        if (
            path_of_status.rpartition("/")[0] == group
            and name in str(variable.attrs.get("status_of", "")).split()
        ):
            said = str(variable.data)
            return "" if said == "defined" else f"{path_of_status.rpartition('/')[2]}: {said}"
    return ""


def _demands(data: NDArray[Any], shape: tuple[int, ...], expectation: Mapping[str, Any]) -> Iterator[_Demand]:
    """Yield each demand on data of the shape given, or on samples of them along a further first axis."""
    kind = data.dtype.kind
    if not expectation.keys() & {"value", "min", "max", "max_abs"}:
        raise _Unmet(f"is {words_of(data)}, but nothing is expected of it: give value, min, max or max_abs")
    if "value" in expectation:
        expected = _like(expectation["value"], shape, kind)
        rtol, atol = float(expectation.get("rtol", RTOL)), float(expectation.get("atol", 0.0))
        tolerance = np.zeros(shape)
        if kind in "ifc":
            with np.errstate(all="ignore"):
                tolerance = np.asarray(atol + rtol * np.abs(expected))
        yield _Demand(close(data, expected, rtol, atol), "expected ", data, expected, tolerance)
    for key, sign in (("min", "at least "), ("max", "at most ")):
        if key in expectation:
            if kind not in "if":
                remedy = ": add 'part', which is real, imaginary or magnitude" if kind == "c" else ""
                raise _Unmet(f"is {words_of(data)}, expected a real number for '{key}'{remedy}")
            bound = _like(expectation[key], shape, kind)
            met = np.asarray(data >= bound if key == "min" else data <= bound)
            yield _Demand(met, f"expected {sign}", data, bound, np.ones(shape))
    if "max_abs" in expectation:
        if kind not in "ifc":
            raise _Unmet(f"is {words_of(data)}, expected a number for 'max_abs'")
        bound, size = _like(expectation["max_abs"], shape, "f"), np.asarray(np.abs(data))
        yield _Demand(np.asarray(size <= bound), "expected a magnitude of at most ", size, bound, bound)


def _like(value: Any, shape: tuple[int, ...], kind: str) -> NDArray[Any]:
    """Return an expected value in the shape of the data; one value holds for every entry."""
    if kind not in "bOifc":
        raise _Unmet("is a table, which cannot be compared with a value")
    if 0 in shape and value != []:
        raise _Unmet(f"is empty, expected {value}")
    flat = _flatten(value, shape, kind)
    dtype = {"b": bool, "O": object, "c": complex}.get(kind, float)
    filled: NDArray[Any] = np.empty(len(flat), dtype=dtype)
    filled[:] = flat
    return filled.reshape(shape)


def _flatten(value: Any, shape: tuple[int, ...], kind: str) -> list[Any]:
    if not shape:
        return [_leaf(value, kind)]
    if not isinstance(value, list):
        return [_leaf(value, kind)] * math.prod(shape)
    if len(value) != shape[0]:
        raise _Unmet(f"has {shape[0]} entries, expected {len(value)}")
    return [leaf for entry in value for leaf in _flatten(entry, shape[1:], kind)]


def _leaf(value: Any, kind: str) -> Any:
    if kind == "b" and isinstance(value, bool):
        return value
    if kind == "O" and isinstance(value, str):
        return value
    if kind in "ifc" and not isinstance(value, bool):
        number = _number(value)
        if number is not None and (kind == "c" or number.imag == 0):
            return number if kind == "c" else number.real
    what = {"b": "a Boolean", "O": "a text", "c": "a complex number"}.get(kind, "a real number")
    raise _Unmet(f"is {what}, expected {word(value)}")


def _number(value: Any) -> complex | None:
    try:
        if isinstance(value, list):
            real, imaginary = value
            return complex(real, imaginary)
        return complex(value.replace(" ", "") if isinstance(value, str) else value)
    except (ValueError, TypeError, OverflowError):
        return None


_NOT_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")


def junit_xml(outcomes: Iterable[CheckOutcome], name: str, error: str = "", seconds: float = 0.0) -> str:
    """Return outcomes as a JUnit XML document, one test case each, in a suite with a name.

    `error` is the message of the error that ended the run before anything was checked: a case of its own.
    `seconds`: what the run took, stated of the suite.
    """
    from xml.etree import ElementTree

    cases = list(outcomes)
    failures = sum(not case.passed for case in cases)
    totals = {
        "name": _xml(name),
        "tests": str(len(cases) + bool(error)),
        "failures": str(failures),
        "errors": str(int(bool(error))),
        "time": f"{seconds:.3f}",
    }
    root = ElementTree.Element("testsuites", totals)
    suite = ElementTree.SubElement(root, "testsuite", totals | {"skipped": "0"})
    for case in cases:
        label = f"{case.path} {case.expected}"
        item = {"classname": _xml(name), "name": _xml(label), "time": "0"}
        element = ElementTree.SubElement(suite, "testcase", item)
        if not case.passed:
            failure = {"message": _xml(case.message), "type": "expectation"}
            ElementTree.SubElement(element, "failure", failure).text = _xml(case.message)
    if error:
        item = {"classname": _xml(name), "name": "run", "time": "0"}
        element = ElementTree.SubElement(suite, "testcase", item)
        about = {"message": _xml(error), "type": "error"}
        ElementTree.SubElement(element, "error", about).text = _xml(error)
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def _xml(text: str) -> str:
    return _NOT_XML.sub("�", text)
