"""The scene of a result as plain data, and the unit of frequencies that it chooses for reports.

The scene was checked when it was run, and is not checked again.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.errors import DynidError, UsageError
from dynid.scene.schema.raw import unit_of_frequencies
from dynid.units import HERTZ, RADIANS, FrequencyUnit

if TYPE_CHECKING:
    from collections.abc import Mapping

    from dynid.arithmetic.expression import Expression, Number
    from dynid.result import Result

_REMEDY = "Run the scene again."
_DESIGN = "bond_graph/design"


@dataclass(frozen=True)
class PlainScene:
    """A scene as plain data.

    Parameters
    ----------
    data
        Texts, numbers, Booleans, lists and mappings.
    parameters
        Values of its parameters.
    """

    data: dict[str, Any]
    parameters: Mapping[str, Number]

    def number(self, raw: Any) -> float:
        """Return the value of a quantity: a number, a parameter's name, or an expression."""
        expression = self.expression(raw)
        return float(raw if expression is None else expression.evaluate(self.parameters))

    def exact(self, raw: Any) -> Fraction:
        """Return the value of a quantity as a fraction; a float is its shortest decimal representation."""
        from dynid.arithmetic.expression import to_fraction

        expression = self.expression(raw)
        return to_fraction(raw if expression is None else expression.evaluate(self.parameters))

    def unknown(self, raw: Any) -> bool:
        """Return True for a quantity that depends on a parameter which is to be estimated."""
        given = self.data.get("parameters") or {}
        expression, seen = self.expression(raw), set[str]()
        names = set() if expression is None else set(expression.names)
        while names:
            seen |= names
            entries = [given.get(name) for name in names]
            if any(isinstance(entry, dict) and "start" in entry for entry in entries):
                return True
            behind = [part.names for entry in entries if (part := self.expression(entry)) is not None]
            names = set().union(*behind) - seen
        return False

    def expression(self, raw: Any) -> Expression | None:
        """Return the expression of a quantity; None for a number."""
        from dynid.arithmetic.expression import parse

        return parse(raw) if isinstance(raw, str) else None


def scene_of(result: Result) -> PlainScene:
    """Return the scene whose text a result holds; free parameters of a design have their designed values.

    Raises
    ------
    UsageError
        Where it holds none, or one that this version of dynid does not read.
    """
    designed: dict[str, float] = {}
    if f"{_DESIGN}/value" in result:
        names, values = (result[f"{_DESIGN}/{part}"].data.tolist() for part in ("name", "value"))
        designed = dict(zip(names, values, strict=True))
    return plain_scene(str(result.attrs.get("scene", "")), designed)


def plain_scene(text: str, values: Mapping[str, float] | None = None) -> PlainScene:
    """Return the scene of a text, with other values of some parameters; raises as `scene_of`."""
    from dynid.arithmetic.expression import resolve_parameters
    from dynid.scene.schema.raw import reference_values

    data = plain_data(text)
    if not data:
        raise UsageError("the result does not hold the text of its scene", remedy=_REMEDY)
    with readable():
        written = reference_values(data.get("parameters", {})) | dict(values or {})
        return PlainScene(data, resolve_parameters(written)[0])


@lru_cache(maxsize=4)
def plain_data(text: str) -> dict[str, Any]:
    """Return the data of a scene in the current format; empty where its text cannot be read."""
    if not text:
        return {}
    from dynid.errors import SceneError
    from dynid.scene.composition import composed
    from dynid.scene.load import as_current
    from dynid.scene.yaml.source import parse_source

    try:
        data = composed(as_current(parse_source(text, "<scene of the result>"))).data
    except SceneError:
        return {}
    return data if isinstance(data, dict) else {}


@contextmanager
def readable() -> Iterator[None]:
    """Report errors in the data of a scene as such: its file may have been changed after the run."""
    try:
        yield
    except DynidError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        problem = f"the scene in the result cannot be read ({type(error).__name__}: {error})"
        raise UsageError(problem, remedy=_REMEDY) from error


def listed(value: Any) -> list[Any]:
    """Return a list, also of a single entry or of nothing."""
    return value if isinstance(value, list) else [] if value is None else [value]


def in_hertz(result: Result) -> bool:
    """Return True if the scene of a result, or the scene that a study varies, is written in Hz."""
    if result.kind == "study" and "study/scene" in result:
        return _in_hertz(str(result.value("study/scene")))
    return _in_hertz(str(result.attrs.get("scene", "")))


def frequency_unit(result: Result) -> FrequencyUnit:
    """Return the unit of frequencies in the scene of a result."""
    return HERTZ if in_hertz(result) else RADIANS


@lru_cache(maxsize=4)
def _in_hertz(scene: str) -> bool:
    return "Hz" in scene and unit_of_frequencies(plain_data(scene)) is HERTZ


class PeakResponses(NamedTuple):
    """Largest magnitude of every channel (output x input), its frequency in `unit`, and what to say of it.

    The note says that a frequency is an end of the range, beyond which the magnitude may be larger; else ''.
    """

    magnitude: NDArray[np.float64]
    at: NDArray[np.float64]
    unit: str
    note: NDArray[Any]


def peak_responses(result: Result, group: str) -> PeakResponses:
    """Return the largest magnitudes of frequency responses, refined between the frequencies if stored so."""
    unit = frequency_unit(result)
    own = group.replace("frequency_response", "frequency_peaks")
    omega = result[f"{group}/omega"].data
    if f"{own}/omega" in result:
        where, largest = result[f"{own}/omega"].data, result[f"{own}/magnitude"].data
    else:
        sizes = np.abs(result[f"{group}/response"].data)
        where, largest = omega[sizes.argmax(axis=0)], sizes.max(axis=0)
    note = np.full(where.shape, "", dtype=object)
    if len(omega) > 1:
        for end, name in ((omega.min(), "lower"), (omega.max(), "upper")):
            note[np.isfinite(largest) & (where == end)] = f", the {name} end of the range"
    return PeakResponses(largest, where * unit.factor, unit.name, note)


def frequency_span(result: Result, group: str) -> tuple[float, float, str]:
    """Return the first and the last frequency of a group of responses, and their unit."""
    omega, unit = result[f"{group}/omega"].data, frequency_unit(result)
    return float(omega[0]) * unit.factor, float(omega[-1]) * unit.factor, unit.name


def time_courses(result: Result, group: str) -> list[tuple[str, NDArray[Any]]]:
    """Return the responses over time of a group by output, or by output and source."""
    data = result[f"{group}/response"].data
    outputs = [str(output) for output in result[f"{group}/output"].data]
    if data.ndim == 2:
        return list(zip(outputs, data.T, strict=True))
    sources = [str(source) for source in result[f"{group}/source"].data]
    return [
        (f"{output} to {source}", data[:, k, m])
        for k, output in enumerate(outputs)
        for m, source in enumerate(sources)
    ]
