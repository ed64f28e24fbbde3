"""The signals of scenes, in continuous time (their common protocol is in `generator`)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from dynid.lti.generator import Record, Signal, require
from dynid.lti.pulses import Impact, Impulse, Step
from dynid.lti.sampled import Random, Sampled
from dynid.lti.sines import Chirp, Multisine, Sine
from dynid.lti.white import White

__all__ = [
    "Chirp",
    "Impact",
    "Impulse",
    "Multisine",
    "Random",
    "Record",
    "Sampled",
    "Signal",
    "Sine",
    "Step",
    "White",
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
"""Of each kind the keys it takes, and those it needs."""


def signal(kind: str, parameters: Mapping[str, Any], record: Record) -> Signal:
    """Build a signal from a scene's words.

    Parameters
    ----------
    kind
        ``step`` ``impulse`` ``sine`` ``multisine`` ``chirp`` ``impact`` ``random`` ``file``.
    parameters
        The keys that the class of that kind documents; for ``file``: `values`, read beforehand, and
        optionally `hold`. The samples of a file lie at the record's step, the first at its start.
    record
        The record, which sets a chirp's sweep and a random signal's lines.

    Raises
    ------
    UsageError
        If the kind is unknown or the parameters make no sense.
    """
    require(kind in _KINDS, f"there is no signal {kind!r}", f"Known are {', '.join(_KINDS)}.", (kind,))
    _check_keys(kind, parameters)
    made = White if kind == "random" and parameters.get("band") is None else _KINDS[kind]
    given = {key: value for key, value in parameters.items() if made is not White or key != "band"}
    built: Signal = made(**given, **_from_record(kind, record))
    return built


def _from_record(kind: str, record: Record) -> dict[str, Any]:
    """Return what the record sets of a signal."""
    if kind == "chirp":
        return {"duration": record.duration, "begin": record.start}
    if kind == "random":
        settling = math.ceil(record.start / record.step - 1e-9)
        return {"step": record.step, "samples": settling + record.samples}
    if kind == "file":
        return {"step": record.step, "start": record.start}
    return {}


def _check_keys(kind: str, parameters: Mapping[str, Any]) -> None:
    """Refuse keys that the kind does not take, and miss those that it needs."""
    taken, needed = _KEYS[kind]
    unknown = [key for key in parameters if key not in taken]
    missing = [key for key in needed if key not in parameters]
    require(
        not unknown,
        f"a signal of kind {kind} does not take {', '.join(unknown)}",
        f"It takes {', '.join(taken)}.",
        (kind, *unknown),
    )
    require(not missing, f"a signal of kind {kind} needs {', '.join(missing)}", names=(kind, *missing))
