"""The derivative of a signal, as a signal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dynid.lti.generator import Array, Signal, require

#: How often the signals can be differentiated before an impulse appears; a sampled one by its hold.
_SMOOTHNESS = {"sine": 9, "multisine": 9, "chirp": 9, "random": 9, "impact": 1}
_OF_HOLD = {"spline": 3, "linear": 1, "zero": 0}


@dataclass(frozen=True, eq=False)
class Derivative:
    """The derivative of a signal: the same generator, another read-out.

    Parameters
    ----------
    signal
        The signal.
    order
        How often it is differentiated.

    Raises
    ------
    UsageError
        If that makes an impulse somewhere.
    """

    kind: ClassVar[str] = "derivative"
    pace: ClassVar[str] = "frequency"

    signal: Signal
    order: int

    def __post_init__(self) -> None:
        kind = self.signal.kind
        smooth = (
            _OF_HOLD.get(getattr(self.signal, "hold", ""), 0) if kind == "file" else _SMOOTHNESS.get(kind)
        )
        require(
            self.order <= (smooth or 0),
            f"a signal of kind {kind} is not smooth enough to be a motion whose derivative of order "
            f"{self.order} acts",
            "Prescribe the acceleration, or use sines, a chirp, or samples with a spline hold.",
            (kind,),
        )

    @property
    def jump(self) -> float:
        """No Dirac impulse."""
        return 0.0

    @property
    def longest_step(self) -> float:
        """That of the signal."""
        return self.signal.longest_step

    def generator(self) -> tuple[Array, Array]:
        """Return the signal's generator, with the read-out of the derivative."""
        G, h = self.signal.generator()
        return G, np.asarray(h @ np.linalg.matrix_power(G, self.order))

    def states(self, times: Array, middles: Array) -> Array:
        """Return the signal's generator states."""
        return self.signal.states(times, middles)

    def breakpoints(self, start: float, stop: float) -> Array:
        """Return the signal's breakpoints."""
        return self.signal.breakpoints(start, stop)

    def value(self, times: ArrayLike) -> Array:
        """Return the derivative at `times`, inside the signal's range."""
        t = np.asarray(times, dtype=float)
        flat = t.ravel()
        return np.asarray((self.states(flat, flat) @ self.generator()[1]).reshape(t.shape))
