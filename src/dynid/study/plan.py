"""The plan of a study: from what varies, and how it is sampled, to the values of every sample."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.result import Scalar
from dynid.scene.kinds.study import base_scene, study_model
from dynid.scene.schema.study import Listed, grid_groups, paths_of
from dynid.study.derived import derived_columns
from dynid.study.designs import correlated, quantiles, spread, unit_samples

if TYPE_CHECKING:
    from dynid.scene.load import Scene
    from dynid.scene.schema.study import StudyFactor, StudyScene


@dataclass(frozen=True)
class Plan:
    """Every sample of a study, in order.

    Parameters
    ----------
    study
        The study.
    base
        The scene that it varies.
    columns
        What was varied or derived, by path or name: a value for each sample.
    settings
        The paths among them that are set in the scene; the rest are there to be read.
    size
        The number of samples.
    attrs
        How the samples came about: attributes of the group `study`.
    """

    study: Scene
    base: Scene
    columns: Mapping[str, Sequence[Any] | NDArray[Any]]
    settings: tuple[str, ...]
    size: int
    attrs: Mapping[str, Scalar]

    @cached_property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """The columns as arrays, of numbers or texts."""
        return {path: as_column(values) for path, values in self.columns.items()}

    @property
    def seed(self) -> int:
        """The seed of its sampling."""
        return study_model(self.study).sampling.seed

    @property
    def collect(self) -> tuple[str, ...]:
        """Paths that are gathered from each result."""
        return tuple(study_model(self.study).collect)

    def override(self, number: int) -> dict[str, Any]:
        """Return what a sample sets in the scene, by dotted path."""
        return {path: _plain(self.columns[path][number]) for path in self.settings}

    def overrides(self, numbers: Sequence[int] | NDArray[np.int64]) -> list[dict[str, Any]]:
        """Return what samples set in the scene."""
        if not self.settings:
            return [{} for _ in numbers]
        columns = [self.values(path, numbers) for path in self.settings]
        return [dict(zip(self.settings, row, strict=True)) for row in zip(*columns, strict=True)]

    def values(self, path: str, numbers: Sequence[int] | NDArray[np.int64]) -> list[Any]:
        """Return what samples have at a path."""
        column = self.columns[path]
        if isinstance(column, np.ndarray):
            values: list[Any] = column[np.asarray(numbers)].tolist()
            return values
        return [_plain(column[number]) for number in numbers]


def as_column(values: Sequence[Any] | NDArray[Any]) -> NDArray[Any]:
    """Return values of one path as an array: of numbers, else of texts (lists and mappings as JSON)."""
    if isinstance(values, np.ndarray):
        return values
    if all(type(value) in (int, float) for value in values):
        return np.array(values, dtype=None if any(type(value) is int for value in values) else float)
    if all(isinstance(value, bool) for value in values):
        return np.array(values, dtype=bool)
    texts = np.empty(len(values), dtype=object)
    texts[:] = [value if isinstance(value, str) else json.dumps(value) for value in values]
    return texts


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def make_plan(study: Scene) -> Plan:
    """Work out every sample of a study.

    Raises
    ------
    FileError, SceneError
        Where the scene that it varies cannot be read, or is at fault.
    """
    model, base = study_model(study), base_scene(study)
    columns, size, attrs = _sampled(model)
    settings = [*columns, *(target for target in model.derive if "." in target)]
    columns |= derived_columns(study, base, columns, size)
    return Plan(study, base, columns, tuple(settings), size, {**attrs, "size": size, "base": model.scene})


def _sampled(model: StudyScene) -> tuple[dict[str, Any], int, dict[str, Scalar]]:
    """Return the values of every path that varies, their number, and how they came about."""
    sampling = model.sampling
    attrs: dict[str, Scalar] = {"method": sampling.method, "varied": "\n".join(_each_path(model))}
    if sampling.method == "grid":
        places, size = _grid_places(model)
        picked = {key: _take(_listed(factor), places[key]) for key, factor in model.vary.items()}
        return _by_path(picked), size, attrs
    if sampling.method == "list":
        picked = {key: _listed(factor) for key, factor in model.vary.items()}
        return _by_path(picked), len(next(iter(picked.values()))), attrs
    count = sampling.samples or 0
    unit = unit_samples(sampling.method, count, len(model.vary), sampling.seed, sampling.indices)
    keys = list(model.vary)
    pairs = [
        (keys.index(one.between[0]), keys.index(one.between[1]), one.value) for one in sampling.correlation
    ]
    unit = correlated(unit, pairs, strata=sampling.method == "latin-hypercube")
    if sampling.indices:
        attrs |= {"design": "saltelli", "base_samples": count, "factors": "\n".join(keys)}
    picked = {key: quantiles(model.vary[key], unit[:, place]) for place, key in enumerate(keys)}
    return _by_path(picked), len(unit), attrs


def _grid_places(model: StudyScene) -> tuple[dict[str, NDArray[np.int64]], int]:
    """Return for each key the number of its value in every sample; the last group varies fastest."""
    groups = grid_groups(model)
    lengths = [len(_listed(model.vary[group[0]])) for group in groups]
    size = int(np.prod(lengths, dtype=np.int64))
    places = np.unravel_index(np.arange(size), lengths)
    return {key: place for group, place in zip(groups, places, strict=True) for key in group}, size


def _listed(factor: StudyFactor) -> Sequence[Any] | NDArray[Any]:
    """Return the values of a factor on a grid or in a list."""
    return factor.values if isinstance(factor, Listed) else spread(factor)


def _take(values: Sequence[Any] | NDArray[Any], places: NDArray[np.int64]) -> Sequence[Any] | NDArray[Any]:
    return values[places] if isinstance(values, np.ndarray) else [values[place] for place in places]


def _by_path(picked: Mapping[str, Sequence[Any] | NDArray[Any]]) -> dict[str, Any]:
    """Give the values of several paths under one key to each of them."""
    columns: dict[str, Any] = {}
    for key, values in picked.items():
        paths = paths_of(key)
        if len(paths) == 1:
            columns[paths[0]] = values
        else:
            columns |= {path: [value[place] for value in values] for place, path in enumerate(paths)}
    return columns


def _each_path(model: StudyScene) -> Iterator[str]:
    for key in model.vary:
        yield from paths_of(key)
