"""Signals of scenes: built from their keys, and differentiated (their protocol is in `generator`)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dynid.arrays import Array
from dynid.lti.generator import RecordTimes, Signal, require
from dynid.lti.noise import Random, Sampled, WhiteNoise
from dynid.lti.waveforms import Chirp, Impact, Impulse, Multisine, Sine, Step

__all__ = [
    "Chirp",
    "Derivative",
    "Impact",
    "Impulse",
    "Multisine",
    "Random",
    "RecordTimes",
    "Sampled",
    "Shifted",
    "Signal",
    "Sine",
    "Step",
    "WhiteNoise",
    "signal",
]
_KINDS: dict[str, Any] = {
    "step": Step,
    "impulse": Impulse,
    "sine": Sine,
    "multisine": Multisine,
    "chirp": Chirp,
    "impact": Impact,
    "random": Random,
    "file": Sampled,
}
_KEYS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "step": (("amplitude", "start"), ()),
    "impulse": (("amplitude",), ()),
    "sine": (("amplitude", "frequency", "phase"), ()),
    "multisine": (("amplitude", "frequency", "phase"), ("amplitude", "frequency")),
    "chirp": (("amplitude", "start", "stop"), ("amplitude", "start", "stop")),
    "impact": (("amplitude", "duration"), ("amplitude", "duration")),
    "random": (("amplitude", "seed", "band", "hold"), ("amplitude", "seed")),
    "file": (("values", "hold"), ("values",)),
}
"""The keys of each kind: those it takes, and those it requires."""
#: Highest derivative of a signal that is no impulse; of a sampled one by its hold.
_SMOOTHNESS = {"sine": 9, "multisine": 9, "chirp": 9, "random": 9, "impact": 1}
_OF_HOLD = {"spline": 3, "linear": 1, "zero": 0}


def signal(kind: str, parameters: Mapping[str, Any], record: RecordTimes) -> Signal:
    """Return the signal of a scene's keys, those that the class of its kind documents.

    For ``file`` they are `values`, read beforehand, and optionally `hold`; the samples lie at the record's
    step, the first at its start. The record also sets a chirp's sweep and a random signal's lines.
    `UsageError` if the kind or a key is unknown, or a parameter is missing or invalid.
    """
    require(kind in _KINDS, f"there is no signal {kind!r}", f"Known are {', '.join(_KINDS)}.", (kind,))
    allowed, needed = _KEYS[kind]
    unknown = [key for key in parameters if key not in allowed]
    missing = [key for key in needed if key not in parameters]
    require(
        not unknown,
        f"a signal of kind {kind} does not take {', '.join(unknown)}",
        f"It takes {', '.join(allowed)}.",
        (kind, *unknown),
    )
    require(not missing, f"a signal of kind {kind} needs {', '.join(missing)}", names=(kind, *missing))
    from_record: dict[str, Any] = {}
    if kind == "chirp":
        from_record = {"duration": record.duration, "begin": record.start}
    elif kind == "random":
        settling = math.ceil(record.start / record.step - 1e-9)
        from_record = {"step": record.step, "samples": settling + record.samples}
    elif kind == "file":
        from_record = {"step": record.step, "start": record.start}
    signal_class = WhiteNoise if kind == "random" and parameters.get("band") is None else _KINDS[kind]
    arguments = {
        key: value for key, value in parameters.items() if signal_class is not WhiteNoise or key != "band"
    }
    built: Signal = signal_class(**arguments, **from_record)
    return built


@dataclass(frozen=True, eq=False)
class Derivative(Signal):
    """The derivative of a signal of some order: the same generator with another read-out."""

    kind: ClassVar[str] = "derivative"

    signal: Signal
    order: int

    def __post_init__(self) -> None:
        kind = self.signal.kind
        smooth = _OF_HOLD[self.signal.hold] if isinstance(self.signal, Sampled) else _SMOOTHNESS.get(kind, 0)
        require(
            self.order <= smooth,
            f"a signal of kind {kind} is not smooth enough to be a motion whose derivative of order "
            f"{self.order} acts",
            "Prescribe the acceleration, or use sines, a chirp, or samples with a spline hold.",
            (kind,),
        )

    @property
    def longest_step(self) -> float:
        """Longest step of the signal, s."""
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


@dataclass(frozen=True, eq=False)
class Shifted(Signal):
    """A multiple of a signal at an earlier time: ``gain * u(t - delay)``; a negative delay: later.

    Samples keep their first and last value before and after the time that they are known for; any other
    signal is zero before its t = 0.
    """

    kind: ClassVar[str] = "shifted"

    signal: Signal
    delay: float
    gain: float = 1.0

    def __post_init__(self) -> None:
        require(math.isfinite(self.delay) and math.isfinite(self.gain), "gain and delay must be finite")
        require(
            not (self.delay and self.signal.jump),
            "an impulse cannot be delayed",
            "Give it at its time, or use an impact.",
            (self.signal.kind,),
        )

    @property
    def jump(self) -> float:
        """Strength of the Dirac impulse at t = 0."""
        return self.gain * self.signal.jump

    @property
    def longest_step(self) -> float:
        """Longest step of the signal, s."""
        return self.signal.longest_step

    @property
    def _span(self) -> tuple[float, float]:
        """First and last time, s, at which the signal itself is evaluated."""
        if isinstance(self.signal, Sampled):
            return self.signal.start, self.signal.stop
        return 0.0, math.inf

    def generator(self) -> tuple[Array, Array]:
        """Return the signal's generator, with the read-out of the multiple."""
        G, h = self.signal.generator()
        return G, self.gain * h

    def states(self, times: Array, middles: Array) -> Array:
        """Return the signal's generator states at the earlier times."""
        first, last = self._span
        _, h = self.signal.generator()
        at, between = times - self.delay, middles - self.delay
        inside = (between >= first) & (between <= last)
        out = np.zeros((len(times), len(h)))
        out[inside] = self.signal.states(at[inside], between[inside])
        if isinstance(self.signal, Sampled):  # its state is a polynomial: the value alone is constant
            for outside, end in ((between < first, first), (between > last, last)):
                out[outside, 0] = float(self.signal.value(end))
        return out

    def breakpoints(self, start: float, stop: float) -> Array:
        """Return the signal's breakpoints, later by the delay, and its ends."""
        first, last = self._span
        begin, end = max(start - self.delay, first), min(stop - self.delay, last)
        times = self.signal.breakpoints(begin, end) if end >= begin else np.empty(0)
        ends = np.array([time for time in (first, last) if start - self.delay <= time <= stop - self.delay])
        return np.unique(np.concatenate([times, ends])) + self.delay
