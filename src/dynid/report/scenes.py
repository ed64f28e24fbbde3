"""The scene of a result, and the unit of frequencies that it chooses for reports."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.errors import SceneError, UsageError
from dynid.result import Result
from dynid.scene.schema.raw import unit_of_frequencies
from dynid.units import HERTZ, RADIANS, FrequencyUnit

if TYPE_CHECKING:
    from dynid.scene.load import Scene

_DESIGN = "bond_graph/design"


def scene_of(result: Result) -> Scene:
    """Return the scene whose text a result holds; free parameters of a design have their designed values.

    Raises
    ------
    UsageError
        Where it holds none, or one that this version of dynid does not read.
    """
    designed: tuple[tuple[str, float], ...] = ()
    if f"{_DESIGN}/value" in result:
        names, values = (result[f"{_DESIGN}/{column}"].data.tolist() for column in ("name", "value"))
        designed = tuple(zip(names, values, strict=True))
    return scene_of_text(str(result.attrs.get("scene", "")), designed)


@lru_cache(maxsize=4)
def scene_of_text(text: str, designed: tuple[tuple[str, float], ...] = ()) -> Scene:
    """Return the scene of a text, with designed values; raises as `scene_of`."""
    from dynid.scene.load import validated
    from dynid.scene.yaml.source import parse_source

    remedy = "Run the scene again."
    if not text:
        raise UsageError("the result does not hold the text of its scene", remedy=remedy)
    try:
        scene = validated(parse_source(text, "<scene of the result>"))
        if designed:
            from dynid.scene.kinds.design import designed_scene

            scene = designed_scene(scene, dict(designed))
    except SceneError as error:
        raise UsageError(f"the scene in the result cannot be read ({error})", remedy=remedy) from error
    return scene


@lru_cache(maxsize=4)
def plain_data(text: str) -> dict[str, Any]:
    """Return the data of a scene in the current format, not validated; empty if it cannot be read."""
    if not text:
        return {}
    from dynid.scene.composition import composed
    from dynid.scene.load import as_current
    from dynid.scene.yaml.source import parse_source

    try:
        data = composed(as_current(parse_source(text, "<scene of the result>"))).data
    except SceneError:
        return {}
    return data if isinstance(data, dict) else {}


def estimates(result: Result) -> dict[str, float]:
    """Return the estimates of an identification by name; none where they are rejected, or there are none."""
    group = "identification/parameters"
    if f"{group}/estimate" not in result:
        return {}
    names, values = (result[f"{group}/{column}"].data.tolist() for column in ("parameter", "estimate"))
    return dict(zip(names, values, strict=True))


def frequency_unit(result: Result) -> FrequencyUnit:
    """Return the unit of frequencies in the scene of a result, or in the scene that a study varies."""
    if result.kind == "study" and "study/scene" in result:
        return _unit_of(str(result.value("study/scene")))
    return _unit_of(str(result.attrs.get("scene", "")))


@lru_cache(maxsize=4)
def _unit_of(scene: str) -> FrequencyUnit:
    return unit_of_frequencies(plain_data(scene)) if "Hz" in scene else RADIANS


def in_hertz(result: Result) -> bool:
    """Return True if the frequencies of a result are in Hz."""
    return frequency_unit(result) is HERTZ


class _PeakResponses(NamedTuple):
    """Largest magnitude of every channel (output x input), its frequency in `unit`, and what to say of it.

    The note says that a frequency is an end of the range, beyond which the magnitude may be larger; else ''.
    """

    magnitude: NDArray[np.float64]
    at: NDArray[np.float64]
    unit: str
    note: NDArray[Any]


def peak_responses(result: Result, group: str) -> _PeakResponses:
    """Return the largest magnitudes of frequency responses, refined between the frequencies if stored so."""
    unit = frequency_unit(result)
    peaks = group.replace("frequency_response", "frequency_peaks")
    omega = result[f"{group}/omega"].data
    if f"{peaks}/omega" in result:
        where, largest = result[f"{peaks}/omega"].data, result[f"{peaks}/magnitude"].data
    else:
        sizes = np.abs(result[f"{group}/response"].data)
        where, largest = omega[sizes.argmax(axis=0)], sizes.max(axis=0)
    note = np.full(where.shape, "", dtype=object)
    if len(omega) > 1:
        for end, name in ((omega.min(), "lower"), (omega.max(), "upper")):
            note[np.isfinite(largest) & (where == end)] = f", the {name} end of the range"
    return _PeakResponses(largest, where * unit.factor, unit.name, note)


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
