"""The block `accuracy`: alternatives to the choices of a run, compared in time and error."""

from __future__ import annotations

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
_SOLVERS = ("dense", "ldl", "splu", "cholespy", "pardiso")
_HOLDS = ("spline", "linear", "zero")

#: The choices in every kind of scene, the quickest to try first, and their alternatives.
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
    """Return the aspects in which a scene chooses between alternatives; invalid parts count as missing.

    Parameters
    ----------
    data
        The scene as plain data, of a kind with alternatives.
    """
    analysis, is_reduction = mapping(data, "analysis"), data["kind"] == "reduction"
    measurement = mapping(data, "measurement")
    results, measured = analysis.get("results"), bool(measurement)
    records = [{**measurement, **mapping_of(one)} for one in listing(measurement, "records") or [{}]]
    simulated = [mapping(record, "simulate").get("model") for record in records]
    # Samples of a force are those of random signals, and of files beside measured records.
    sampled = any(
        signal.get("kind") in (("random",) if "simulate" in record else ("random", "file"))
        for record in records
        for _, signal in signals((), record.get("excitation", data.get("excitation")))
    )
    present = {
        "engine": not isinstance(results, list)
        or any(name in _ENGINE for name in results if isinstance(name, str)),
        "propagation": _is_propagated(data),
        "estimator": measured,
        "basis": is_reduction or (measured and "reduced" not in simulated and "graph" not in data),
        "hold": measured and sampled,
        "modes": is_reduction or "modes" in analysis,
    }
    return [name for name in ASPECTS[data["kind"]] if present[name]]


def accuracy_faults(source: Source) -> list[Fault]:
    """Return the faults of the alternatives: unknown ones, and choices that the scene does not make."""
    kind, given = source.data.get("kind"), mapping(mapping_of(source.data.get("accuracy")), "alternatives")
    if not given or not isinstance(kind, str) or kind not in ASPECTS:
        return []
    known, there, faults = ASPECTS[kind], aspects_of(source.data), []
    for aspect, names in given.items():
        path = ("accuracy", "alternatives", aspect)
        if aspect not in known:
            options = f"a scene of kind {kind} chooses {', '.join(known)}"
            message = f"'{aspect}' is no choice of a run; {options}{did_you_mean(str(aspect), known)}"
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
    "basis": "reduced for an estimate: a record of a structure is, unless a reduced model simulates it",
    "hold": "held: no force is known by samples alone",
    "modes": "asked for its modes: there is no 'analysis.modes'",
}


def _is_propagated(data: dict[str, Any]) -> bool:
    """Return True if a time response is computed from signals that are more than an impulse."""
    analysis = mapping(data, "analysis")
    results = analysis.get("results")
    if "time" not in analysis or (isinstance(results, list) and "time_response" not in results):
        return False
    given = list(signals((), mapping(analysis, "time").get("input")))
    of_structure = data.get("kind") == "identification" and "graph" not in data
    if not given and of_structure and not mapping(data, "initial"):
        given = list(signals((), data.get("excitation")))
    elif not given:
        return not mapping(data, "initial")  # a unit step, unless stored energy moves it
    return any(signal.get("kind") != "impulse" for _, signal in given)
