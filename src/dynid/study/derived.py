"""Quantities of a study that follow from others, by expressions over all samples at once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import SceneError
from dynid.scene.arithmetic.expression import Expression, parse
from dynid.scene.kinds.study import study_model
from dynid.scene.schema.raw import mapping, written_key
from dynid.scene.schema.study import known_names

if TYPE_CHECKING:
    from dynid.scene.load import Scene

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


def derived_columns(
    study: Scene, base: Scene, columns: Mapping[str, Any], size: int
) -> dict[str, NDArray[np.float64]]:
    """Evaluate the `derive` of a study for every sample.

    Parameters
    ----------
    study
        The study.
    base
        The scene it varies: its parameters are known by their names too, as each sample has them.
    columns
        What is varied, by path.
    size
        The number of samples.

    Raises
    ------
    SceneError
        Where expressions refer to each other in a circle, or to what is no number.
    """
    return _Columns(study, base, columns, size).all()


class _Columns:
    """Columns by path or name, evaluated when they are asked for."""

    def __init__(self, study: Scene, base: Scene, columns: Mapping[str, Any], size: int) -> None:
        self.study = study
        self.model = study_model(study)
        self.base = base
        self.size = size
        self.known: dict[str, Any] = dict(columns)
        self.names = known_names(self.model, mapping(base.source.data, "parameters"))
        self._open: list[str] = []  # what is being evaluated

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
            self.known[path] = self._evaluated(path)
            self._open.pop()
        values = self.known[path]
        if not isinstance(values, np.ndarray | float):
            values = self.known[path] = self._numbers(path, values)
        return values

    def _numbers(self, path: str, values: Any) -> NDArray[np.float64]:
        if any(isinstance(value, bool) or not isinstance(value, int | float) for value in values):
            raise self._refused(f"{path} is not a number in every sample")
        return np.array(values, dtype=float)

    def _evaluated(self, path: str) -> Any:
        """Return what a derived quantity, or a parameter of the scene, is in every sample."""
        if path in self.model.derive:
            return self._value(parse(self.model.derive[path]), self.names)
        parameters = mapping(self.base.source.data, "parameters")
        raw = parameters[written_key(parameters, path.removeprefix("parameters."))]
        own = {str(name): f"parameters.{name}" for name in parameters}
        return self._value(parse(raw), own) if isinstance(raw, str) else float(raw)

    def _value(self, expression: Expression, names: Mapping[str, str]) -> Any:
        def leaf(item: Fraction | str) -> Any:
            if isinstance(item, Fraction):
                return float(item)
            return math.pi if item == "pi" else np.asarray(self._column(names[item]), dtype=float)

        # What is not finite is refused where it is set, as the failure of its sample.
        with np.errstate(all="ignore"):
            return np.asarray(expression.fold(leaf, lambda name, given: _OPERATIONS[name](*given)))

    def _refused(self, message: str) -> SceneError:
        target = next((name for name in self._open if name in self.model.derive), "")
        return SceneError([self.study.source.fault(("derive", target), message)])
