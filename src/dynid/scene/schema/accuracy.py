"""The block `accuracy`: alternatives to the choices of a run, compared in time and error."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal

from pydantic import Field

from dynid.errors import Fault
from dynid.scene.schema.base import Section
from dynid.scene.schema.raw import listing, mapping, mapping_of, signals
from dynid.scene.yaml.source import Source
from dynid.suggestions import did_you_mean

_METHODS = (
    *("full", "serep", "guyan", "dynamic", "irs", "craig-bampton", "modal", "joint-aware"),
    "joint-aware-modes",  # without residual vectors
)
_SOLVERS = ("dense", "splu", "cholespy", "pardiso")
_HOLDS = ("spline", "linear", "zero")

#: For every kind of scene what is chosen in it, the quickest to try first, and among which alternatives.
ASPECTS: dict[str, dict[str, tuple[str, ...]]] = {
    "bond-graph": {"engine": ("exact", "float", "symbolic"), "propagation": ("exact", *_HOLDS)},
    "identification": {
        "modes": _SOLVERS,
        "propagation": ("exact", *_HOLDS),
        "estimator": ("auto", "output-error", "filter", "invariant-imbedding"),
        "hold": ("as-written", *_HOLDS),
        "basis": _METHODS,
    },
    "reduction": {"modes": _SOLVERS, "basis": _METHODS},
}
_ENGINE = {"transfer_function", "zeros", "poles", "properties", "hidden_modes"}


class AccuracyModel(Section):
    """Alternatives to the choices of a run, number of repeats, and time limit (s)."""

    alternatives: dict[str, list[str] | Literal["all"]] | None = Field(default=None, min_length=1)
    repeats: int = Field(default=3, ge=1, le=1000, strict=True)
    budget: float = Field(default=60.0, gt=0, le=1e6, strict=True)


def aspects_of(data: dict[str, Any]) -> list[str]:
    """Return what is chosen in a scene, as its plain data say; what is not as it should be counts as nothing.

    Parameters
    ----------
    data
        The scene, of a kind in which something is chosen.
    """
    return [name for name in ASPECTS[data["kind"]] if _PRESENT[name](data)]


def accuracy_faults(source: Source) -> list[Fault]:
    """Check that the alternatives are such, and that the scene has what they are alternatives for."""
    kind, given = source.data.get("kind"), mapping(mapping_of(source.data.get("accuracy")), "alternatives")
    if not given or not isinstance(kind, str) or kind not in ASPECTS:
        return []
    known, there, faults = ASPECTS[kind], aspects_of(source.data), []
    for aspect, names in given.items():
        path = ("accuracy", "alternatives", aspect)
        if aspect not in known:
            options = f"a scene of kind {kind} chooses {', '.join(known)}"
            message = f"'{aspect}' is nothing that is chosen; {options}{did_you_mean(str(aspect), known)}"
            faults.append(source.fault(path, message, key=True))
        elif aspect not in there:
            faults.append(source.fault(path, f"nothing in this scene is {_MISSING[aspect]}", key=True))
        for place, name in enumerate(names if aspect in known and isinstance(names, list) else []):
            if isinstance(name, str) and name not in known[aspect]:
                options = f"it is one of {', '.join(known[aspect])}{did_you_mean(name, known[aspect])}"
                faults.append(source.fault((*path, place), f"there is no alternative '{name}'; {options}"))
    return faults


_MISSING = {
    "engine": "computed by an engine: 'results' asks for no transfer function, zeros, poles or properties",
    "propagation": "propagated: there is no 'analysis.time', or an impulse or initial state alone drives it",
    "estimator": "estimated: there is no 'measurement'",
    "basis": "reduced for an estimate: there is no 'measurement', or a reduced model simulates it",
    "hold": "held: no force is known by samples alone",
    "modes": "asked for its modes: there is no 'analysis.modes'",
}


def _has_engine(data: dict[str, Any]) -> bool:
    results = mapping(data, "analysis").get("results")
    return not isinstance(results, list) or any(name in _ENGINE for name in results if isinstance(name, str))


def _is_propagated(data: dict[str, Any]) -> bool:
    analysis = mapping(data, "analysis")
    results = analysis.get("results")
    if "time" not in analysis or (isinstance(results, list) and "time_response" not in results):
        return False
    given = list(signals((), mapping(analysis, "time").get("input")))
    if not given and data.get("kind") == "identification" and not mapping(data, "initial"):
        given = list(signals((), data.get("excitation")))
    elif not given:
        return not mapping(data, "initial")  # a unit step, unless stored energy moves it
    return any(signal.get("kind") != "impulse" for _, signal in given)


def _is_measured(data: dict[str, Any]) -> bool:
    return bool(mapping(data, "measurement"))


def _records(data: dict[str, Any]) -> Iterable[dict[str, Any]]:
    measurement = mapping(data, "measurement")
    each = listing(measurement, "records") or [{}]
    yield from ({**measurement, **mapping_of(record)} for record in each)


def _has_basis(data: dict[str, Any]) -> bool:
    if data.get("kind") == "reduction":
        return True
    simulated = [mapping(record, "simulate").get("model") for record in _records(data)]
    return _is_measured(data) and "reduced" not in simulated


def _is_held(data: dict[str, Any]) -> bool:
    """Tell whether an estimator knows a force by samples: random ones, and files beside measured records."""
    if not _is_measured(data):
        return False
    for record in _records(data):
        known = ("random",) if "simulate" in record else ("random", "file")
        given = record.get("excitation", data.get("excitation"))
        if any(signal.get("kind") in known for _, signal in signals((), given)):
            return True
    return False


def _has_modes(data: dict[str, Any]) -> bool:
    return data.get("kind") == "reduction" or "modes" in mapping(data, "analysis")


_PRESENT = {
    "engine": _has_engine,
    "propagation": _is_propagated,
    "estimator": _is_measured,
    "basis": _has_basis,
    "hold": _is_held,
    "modes": _has_modes,
}
