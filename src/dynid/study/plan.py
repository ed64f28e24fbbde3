"""Plan of a study: the values of every sample, from an experimental design or derived by expressions."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.expression import Expression, parse
from dynid.errors import SceneError, UsageError
from dynid.result import Scalar
from dynid.scene.kinds.study import study_model
from dynid.scene.schema.base import DefinedParameter
from dynid.scene.schema.study import (
    Listed,
    Normal,
    Spread,
    Triangular,
    Uniform,
    grid_groups,
    known_names,
    paths_of,
)

if TYPE_CHECKING:
    from dynid.scene.load import Scene
    from dynid.scene.schema.quantities import Quantity
    from dynid.scene.schema.study import StudyFactor, StudyScene


def spread(factor: StudyFactor) -> NDArray[Any]:
    """Return the values of a factor on a grid: evenly spaced, or at equal steps of probability."""
    count = cast("int", getattr(factor, "points", None))
    if not isinstance(factor, Spread):
        return cast("NDArray[Any]", quantiles(factor, (np.arange(count) + 0.5) / count))
    start, stop = factor.start, factor.stop
    if factor.scale == "log":
        values = np.geomspace(float(start), float(stop), count)
    else:
        step = (stop.exact - start.exact) / max(1, count - 1)
        is_integer = start.exact.denominator == step.denominator == 1
        if is_integer and abs(start.exact) <= 2**53:  # seeds, sizes, numbers of modes
            return np.array([int(start.exact + step * index) for index in range(count)], dtype=np.int64)
        values = np.linspace(float(start), float(stop), count)
    values[[0, -1]] = float(start), float(stop) if count > 1 else float(start)
    return values


def quantiles(factor: StudyFactor, unit: NDArray[np.float64]) -> NDArray[Any] | Sequence[Any]:
    """Return the quantiles of a factor's distribution at probabilities strictly between 0 and 1.

    A range is uniform on its scale; listed values are equally likely.
    """
    if isinstance(factor, Listed):
        count = len(factor.values)
        return [factor.values[index] for index in np.minimum((unit * count).astype(int), count - 1)]
    if isinstance(factor, Spread):
        return _between(float(factor.start), float(factor.stop), unit, factor.scale == "log")
    if isinstance(factor, Uniform):
        if factor.distribution == "integer":
            low, high = int(factor.low.exact), int(factor.high.exact)
            return low + np.minimum((unit * (high - low + 1)).astype(np.int64), high - low)
        return _between(float(factor.low), float(factor.high), unit, factor.distribution == "loguniform")
    if isinstance(factor, Triangular):
        left, mode, right = float(factor.low), float(factor.mode), float(factor.high)
        below = left + np.sqrt(unit * (right - left) * (mode - left))
        above = right - np.sqrt((1 - unit) * (right - left) * (right - mode))
        return np.where(unit * (right - left) < mode - left, below, above)
    return _normal(factor, unit)


def _between(low: float, high: float, unit: NDArray[np.float64], log: bool) -> NDArray[np.float64]:
    if log:
        return math.copysign(1, low) * np.exp(
            math.log(abs(low)) + unit * (math.log(abs(high)) - math.log(abs(low)))
        )
    return low + unit * (high - low)


def _normal(factor: Normal, unit: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return quantiles of a Gaussian or lognormal distribution, truncated at its bounds."""
    from scipy.special import ndtr, ndtri

    mean, std = float(factor.mean), float(factor.std)
    log = factor.distribution == "lognormal"
    if log:  # mean and deviation of the logarithm, from those of the value
        variance = math.log1p((std / mean) ** 2)
        mean, std = math.log(mean) - variance / 2, math.sqrt(variance)

    def score(bound: Quantity | None, absent: float) -> float:
        if bound is None:
            return absent
        value = float(bound)
        if log:
            value = math.log(value) if value > 0 else -math.inf
        return (value - mean) / std

    low, high = score(factor.low, -math.inf), score(factor.high, math.inf)
    if low > 0:  # probabilities of the upper tail, close to 1, would lose digits
        scores = -ndtri(ndtr(-low) + unit * (ndtr(-high) - ndtr(-low)))
    else:
        scores = ndtri(ndtr(low) + unit * (ndtr(high) - ndtr(low)))
    values = mean + std * np.clip(scores, low, high)
    return cast("NDArray[np.float64]", np.exp(values) if log else values)


def unit_samples(
    method: str, count: int, factors: int, seed: int, indices: bool = False
) -> NDArray[np.float64]:
    """Return points inside the unit cube (samples x factors); equal seeds give equal points.

    Methods: `random`, `latin-hypercube` (one point at random in each of `count` strata of each factor) or
    `sobol` (scrambled; a power of two is balanced). With `indices` it is Saltelli's design for Sobol indices:
    `count * (factors + 2)` points, the blocks A, B and, for each factor i, A with its column i from B.

    References
    ----------
    A. Saltelli et al., "Variance based sensitivity analysis of model output", Comput. Phys. Commun. 181
    (2010) 259-270.
    """
    if method == "random":
        points = np.random.default_rng(seed).random((count, factors))
    elif method == "latin-hypercube":
        points = _latin_hypercube(count, factors, seed)
    elif indices:
        both = _sobol(count, 2 * factors, seed)
        A, B = both[:, :factors], both[:, factors:]
        mixed = [np.where(np.arange(factors) == factor, B, A) for factor in range(factors)]
        return np.concatenate([A, B, *mixed])
    else:
        points = _sobol(count, factors, seed)
    return _inside(points)


def _latin_hypercube(count: int, factors: int, seed: int) -> NDArray[np.float64]:
    """Return the points of `scipy.stats.qmc.LatinHypercube`, without its import, which takes a second."""
    rng = np.random.default_rng(seed).spawn(1)[0]
    below = rng.random((count, factors))
    strata = np.tile(np.arange(1, count + 1), (factors, 1))
    for factor in strata:
        rng.shuffle(factor)
    points: NDArray[np.float64] = (strata.T - below) / count
    return points


def _sobol(count: int, factors: int, seed: int) -> NDArray[np.float64]:
    from scipy.stats import qmc

    drawn = qmc.Sobol(factors, scramble=True, rng=np.random.default_rng(seed)).random_base2(
        max(0, int(count - 1).bit_length())
    )
    points: NDArray[np.float64] = drawn[:count]
    return _inside(points)


def _inside(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Clip probabilities to inside (0, 1): the ends of unbounded distributions are infinite."""
    return np.clip(points, 2.0**-54, 1 - 2.0**-53)


def correlated(
    unit: NDArray[np.float64], pairs: Sequence[tuple[int, int, float]], strata: bool
) -> NDArray[np.float64]:
    """Return points of the unit cube (samples x factors) whose normal scores have given correlations.

    `pairs` are pairs of factors with their correlation. With `strata` the values of each factor are reordered
    (Iman & Conover), which keeps a Latin hypercube; else by a Gaussian copula. Raises `UsageError` if the
    correlation matrix is not positive definite.

    References
    ----------
    R. L. Iman, W. J. Conover, "A distribution-free approach to inducing rank correlation among input
    variables", Commun. Stat. B 11 (1982) 311-334.
    """
    if not pairs:
        return unit
    from scipy.special import ndtr, ndtri

    correlations = np.eye(unit.shape[1])
    for row, column, value in pairs:
        correlations[row, column] = correlations[column, row] = value
    try:
        root = np.linalg.cholesky(correlations)
    except np.linalg.LinAlgError:
        raise UsageError(
            "no values have these correlations at once: their matrix is not positive definite",
            remedy="Make them smaller, or give those of the remaining pairs too.",
            names=["sampling.correlation"],
        ) from None
    scores = ndtri(unit)
    if not strata:
        return _inside(ndtr(scores @ root.T))
    if len(unit) > unit.shape[1]:
        sample_correlations = np.atleast_2d(np.corrcoef(scores, rowvar=False))
        scores = np.linalg.solve(
            np.linalg.cholesky(sample_correlations), ((scores - scores.mean(0)) / scores.std(0)).T
        ).T
    target = scores @ root.T
    ordered = np.sort(unit, axis=0)
    ranks = np.argsort(np.argsort(target, axis=0, kind="stable"), axis=0, kind="stable")
    return np.take_along_axis(ordered, ranks, axis=0)


@dataclass(frozen=True)
class Plan:
    """Plan of a study: all samples, in order."""

    study: Scene
    base: Scene  # the scene that is varied
    columns: Mapping[str, Sequence[Any] | NDArray[Any]]  # varied and derived values, by path or name
    settings: tuple[str, ...]  # the paths among them that are set in the scene
    size: int
    attrs: Mapping[str, Scalar]  # of the group `study`: method, design, size

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
        """Paths that are collected from each result."""
        return tuple(study_model(self.study).collect)

    def override(self, number: int) -> dict[str, Any]:
        """Return the values that a sample sets in the scene, by dotted path."""
        return {path: _plain(self.columns[path][number]) for path in self.settings}

    def overrides(self, numbers: Sequence[int] | NDArray[np.int64]) -> list[dict[str, Any]]:
        """Return the values that samples set in the scene, as by `override`."""
        if not self.settings:
            return [{} for _ in numbers]
        columns = [self.values(path, numbers) for path in self.settings]
        return [dict(zip(self.settings, row, strict=True)) for row in zip(*columns, strict=True)]

    def values(self, path: str, numbers: Sequence[int] | NDArray[np.int64]) -> list[Any]:
        """Return the values of samples at a path."""
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
    """Return the plan of a study, with the values of every sample.

    Raises `SceneError` if expressions of `derive` refer to each other in a circle, or to a value that is no
    number.
    """
    model, base = study_model(study), study.base
    factors, size, attrs = _sampled(model)
    columns: dict[str, Any] = {}
    for key, values in factors.items():
        paths = paths_of(key)
        if len(paths) == 1:
            columns[paths[0]] = values
        else:
            columns |= {path: [value[index] for value in values] for index, path in enumerate(paths)}
    settings = [*columns, *(target for target in model.derive if "." in target)]
    columns |= _Columns(study, base, columns, size).all()
    return Plan(study, base, columns, tuple(settings), size, {**attrs, "size": size, "base": model.scene})


def _sampled(
    model: StudyScene,
) -> tuple[Mapping[str, Sequence[Any] | NDArray[Any]], int, dict[str, Scalar]]:
    """Return the values of every factor, their number, and the attributes of the sampling."""
    sampling = model.sampling
    attrs: dict[str, Scalar] = {"method": sampling.method, "varied": "\n".join(model.varied)}
    if sampling.method in ("grid", "list"):
        listed = {
            key: factor.values if isinstance(factor, Listed) else spread(factor)
            for key, factor in model.vary.items()
        }
        if sampling.method == "list":
            return listed, len(next(iter(listed.values()))), attrs
        groups = grid_groups(model)  # the last one varies fastest
        lengths = [len(listed[group[0]]) for group in groups]
        size = int(np.prod(lengths, dtype=np.int64))
        places = np.unravel_index(np.arange(size), lengths)
        place_of = {key: index for group, index in zip(groups, places, strict=True) for key in group}
        return (
            {
                key: values[place_of[key]]
                if isinstance(values, np.ndarray)
                else [values[index] for index in place_of[key]]
                for key, values in listed.items()
            },
            size,
            attrs,
        )
    count = sampling.samples or 0
    unit = unit_samples(sampling.method, count, len(model.vary), sampling.seed, sampling.indices)
    keys = list(model.vary)
    pairs = [
        (keys.index(correlation.between[0]), keys.index(correlation.between[1]), correlation.value)
        for correlation in sampling.correlation
    ]
    unit = correlated(unit, pairs, strata=sampling.method == "latin-hypercube")
    if sampling.indices:
        attrs |= {"design": "saltelli", "base_samples": count, "factors": "\n".join(keys)}
    drawn = {key: quantiles(model.vary[key], unit[:, index]) for index, key in enumerate(keys)}
    return drawn, len(unit), attrs


#: NumPy functions of the operators of expressions.
_OPERATIONS: dict[str, Any] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "**": np.power,
    "neg": np.negative,
    "pos": np.positive,
    "sqrt": np.sqrt,
    "exp": np.exp,
    "log": np.log,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "abs": np.abs,
    "min": lambda *values: np.minimum.reduce(np.broadcast_arrays(*values)),
    "max": lambda *values: np.maximum.reduce(np.broadcast_arrays(*values)),
}


class _Columns:
    """Columns by path or name, evaluated on demand; expressions may use the parameters of the base scene."""

    def __init__(self, study: Scene, base: Scene, columns: Mapping[str, Any], size: int) -> None:
        self.study = study
        self.model = study_model(study)
        self.base = base
        self.size = size
        self.known: dict[str, Any] = dict(columns)
        self.names = known_names(self.model, base.model.parameters)
        self._open: list[str] = []  # paths in evaluation

    def all(self) -> dict[str, NDArray[np.float64]]:
        return {
            target: np.array(np.broadcast_to(self._column(target), (self.size,)))
            for target in self.model.derive
        }

    def _column(self, path: str) -> Any:
        if path in self._open:
            raise self._refused(f"it is defined by itself: {' -> '.join([*self._open, path])}")
        if path not in self.known:
            self._open.append(path)
            if path in self.model.derive:
                self.known[path] = self._value(parse(self.model.derive[path]), self.names)
            else:  # a parameter of the scene
                parameters = self.base.model.parameters
                entry = parameters[path.removeprefix("parameters.")]
                defined = isinstance(entry, DefinedParameter)
                reference_path = f"{path}.{entry.reference_key}" if defined else ""  # such as kb.start
                expression = entry.reference.expression if defined else None
                if isinstance(entry, str):
                    expression = parse(entry)
                if reference_path in self.known or reference_path in self.model.derive:
                    self.known[path] = self._column(reference_path)
                elif expression is not None:
                    paths = {name: f"parameters.{name}" for name in parameters}
                    self.known[path] = self._value(expression, paths)
                else:
                    self.known[path] = float(entry.reference if defined else entry)
            self._open.pop()
        values = self.known[path]
        if not isinstance(values, np.ndarray | float):
            if any(isinstance(value, bool) or not isinstance(value, int | float) for value in values):
                raise self._refused(f"{path} is not a number in every sample")
            values = self.known[path] = np.array(values, dtype=float)
        return values

    def _value(self, expression: Expression, names: Mapping[str, str]) -> Any:
        def leaf(item: Fraction | str) -> Any:
            if isinstance(item, Fraction):
                return float(item)
            return math.pi if item == "pi" else np.asarray(self._column(names[item]), dtype=float)

        # A value that is not finite is rejected when it is set: its sample fails.
        with np.errstate(all="ignore"):
            return np.asarray(expression.fold(leaf, lambda name, operands: _OPERATIONS[name](*operands)))

    def _refused(self, message: str) -> SceneError:
        target = next((name for name in self._open if name in self.model.derive), "")
        return SceneError([self.study.source.fault(("derive", target), message)])
