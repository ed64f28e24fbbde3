"""Labels in `at` of expectations that no result has: names, frequencies, times and numbers along axes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.graph import SOURCES, STORAGES
from dynid.errors import DynidError
from dynid.scene.kinds.parameters import quantities, unknown_parameters
from dynid.scene.kinds.result_layout import OF_RECORDS, RECORD, Parts, names_in
from dynid.suggestions import did_you_mean, shortened

if TYPE_CHECKING:
    from dynid.identification.records.measurement import Measurement
    from dynid.parameters import Parameter
    from dynid.scene.load import Scene
    from dynid.scene.schema.bond_graph import AnalysisModel, BondGraphScene
    from dynid.scene.schema.identification import IdentificationScene
    from dynid.structure.model import StructuralModel

#: What separates the words of names of channels and DOFs, and the words that a scene need not write.
_WORD = re.compile(r"[^\w]+")
_CHANNEL_WORDS = frozenset(
    {"initial", "displacement", "velocity", "acceleration", "force", "e", "f", "q", "p"}
    | {"x", "y", "z", "rx", "ry", "rz"}
)
#: Axes that are numbered from 1.
_NUMBERED = frozenset(
    {"mode", "full_mode", "pole", "zero", "hidden_mode", "natural_mode", "optimum", "equilibrium"}
    | {"step", "branch", "direction", "pair", "lag", "computed", "definition", "blind_direction"}
    | {f"{polynomial}root" for polynomial in ("", "a_", "b_", "missed_", "foreign_")}
)
#: Groups of graphs over the frequencies of the analysis, and those whose number of roots storages bound.
_OVER_FREQUENCY = frozenset({"frequency_response", "energy", "source_performance", "sensitivity_functions"})
_WITH_ROOTS = frozenset(
    {"transfer_function", "properties", "energy", "sensitivities", "port", "reduction", "root_locus"}
)
_ROOT_AXES = frozenset({"mode", "pole", "zero", "natural_mode", "hidden_mode", "branch"})
#: Axes of groups whose labels are those of the channels and loops of the graph.
_CHANNEL_AXES = {
    **dict.fromkeys(("margins", "sensitivity_functions"), ("loop",)),
    **dict.fromkeys(("frequency_response", "frequency_peaks"), ("output", "input")),
    "reduction": ("output",),
    "time_response": ("output", "source"),
}
#: Groups of identifications of which not every time is stored.
_HISTORIES = frozenset({"history", "first_pass", "states"})
#: Groups of identifications whose axis `parameter` is that of the unknown ones.
_OF_PARAMETERS = frozenset(
    ("identification", name) for name in ("parameters", "rejected", "diagnostics", "equivalent_optima")
)
#: Relative difference within which expectations select a number on an axis (`dynid.checks.comparison.RTOL`).
_LABEL_RTOL = 1e-9
_FRF = ("reduction", "frf")
#: Dimensions without a coordinate.
_UNLABELLED = frozenset({"line", "master", "basis_mode", "end"})


def problem_of_words(scene: Scene, names: Sequence[str]) -> str:
    """Return the first word in names of channels, DOFs or parameters that stands nowhere in the scene.

    They are made of the scene's words, by points and colons; those of channels that a file names are not.
    """
    words = _words(scene.source.data)
    strange = [word for name in names for word in _WORD.split(name) if not (word.isdigit() or word in words)]
    if not strange or "file" in words:
        return ""
    return f"nothing in the scene is called '{strange[0]}'{did_you_mean(strange[0], words)}"


def _words(data: Any) -> set[str]:
    words, waiting = set(_CHANNEL_WORDS), [value for key, value in data.items() if key != "expect"]
    for key in data.keys() - {"expect"}:
        words.add(str(key))
    while waiting:
        entry = waiting.pop()
        if isinstance(entry, dict):
            waiting += [*entry, *entry.values()]
        elif isinstance(entry, list):
            waiting += entry
        elif isinstance(entry, str):
            words.update(_WORD.split(entry))
    return words


def analysis_of(scene: Scene) -> AnalysisModel | None:
    """Return the analysis of the graph of a scene, if it has one."""
    model: BondGraphScene | IdentificationScene = scene.model
    return model.analysis if model.kind == "bond-graph" else model.graph_analysis


@lru_cache(maxsize=1)
def structure_in(scene: Scene) -> StructuralModel:
    """Return the structure of a reduction or of an identification, or raise the error of its building."""
    if scene.kind == "reduction":
        from dynid.scene.kinds.structures import build_structure

        return build_structure(scene, scene.model.structure, scene.model.joints)
    from dynid.scene.kinds.parts import structure_of

    return structure_of(scene)


def method_names(scene: Scene, parts: Parts) -> list[str]:
    """Return the names of the reductions of a scene, which are arrays in `reduction/frf`."""
    if parts[:2] != _FRF:
        return []
    from dynid.scene.schema.reduction import result_names

    return result_names([reduction.method for reduction in scene.model.reduction])


def names_at(scene: Scene, placeholder: str, parts: Parts) -> list[str] | None:
    """Return the names that a scene has for a part of a path; None where the run alone says them."""
    if placeholder == "<method>":
        return [*method_names(scene, _FRF), "frf", "need"]
    if placeholder == "<form>":
        from dynid.bondgraph.synthesis.forms import FORMS

        return [*(scene.model.forms or FORMS), "need"]
    if placeholder == "<loop>":
        return [f"loop_{number}" for number in range(1, len(scene.model.control.loop_names) + 1)]
    if placeholder not in ("<output>", "<input>"):
        return None
    if parts[0] == "bond_graph":
        return _labels_of_graph(scene).get(placeholder.strip("<>"))
    pairs = []
    try:
        for record in _records(scene):
            if isinstance(record, tuple):
                loads, measurement = record
                pairs += [(channel.name, load.name) for channel in measurement.channels for load in loads]
            else:
                pairs += [(function.channel.name, str(function.force)) for function in record.channels]
    except DynidError:  # which the preparation of the run reports
        return None
    if placeholder == "<output>":
        return list(dict.fromkeys(output for output, _ in pairs))
    return list(dict.fromkeys(name for output, name in pairs if output == parts[3]))


def problem_of_label(scene: Scene, parts: Parts, dim: str, label: str | float, *, certain: bool) -> str:
    """Return the reason why an array has no dimension of a name, or none with a label; empty where it may."""
    groups = [names for k in range(1, len(parts)) if (names := names_in(parts[:k])) is not None]
    dims = frozenset().union(*groups)
    if not dims:
        return ""
    if dim not in dims | _UNLABELLED:
        return f"'{parts[-1]}' has no dimension '{dim}'{did_you_mean(dim, dims)}"
    if dim in _NUMBERED and (isinstance(label, str) or label < 1 or not float(label).is_integer()):
        return f"there is no {dim} {label}; they are numbered from 1"
    try:
        return _problem_in_scene(scene, parts, dim, label) if certain else ""
    except DynidError:  # which the preparation of the run reports
        return ""


def _problem_in_scene(scene: Scene, parts: Parts, dim: str, label: str | float) -> str:
    """Return the reason why a dimension has no such label in a scene."""
    if dim in _NUMBERED:
        count = _max_count(scene, parts, dim)
        exists = count is None or float(label) <= count
        return "" if exists else f"there is no {dim} {label:g}; there are {count} at most"
    if dim in ("omega", "time"):
        return _problem_of_grid(scene, parts, dim, label)
    of_channels = dim == "channel" and parts[0] == "identification"
    labels = _channels(scene, parts) if of_channels else _labels(scene, parts).get(dim)
    if labels is None or str(label) in labels:
        return ""
    return f"there is no {dim} '{label}'{similar_or_all(str(label), labels)}"


def _labels(scene: Scene, parts: Parts) -> dict[str, list[str]]:
    """Return the labels of axes of the arrays in a group, as far as the scene alone says them."""
    if parts[0] == "bond_graph":
        labels = _labels_of_graph(scene)
        axes = _CHANNEL_AXES.get(parts[1], ()) if len(parts) == 3 else ()
        return {axis: labels[axis] for axis in axes if axis in labels}
    if scene.kind == "identification" and parts[:2] in _OF_PARAMETERS:
        names = [unknown.name for unknown in _unknowns(scene)]
        return {"parameter": names, "other": names}
    if scene.kind == "reduction" and parts[0] == "reduction":
        return {"method": method_names(scene, _FRF)}
    return {}


def _problem_of_grid(scene: Scene, parts: Parts, dim: str, label: str | float) -> str:
    """Return the reason why a grid that the scene gives has no such frequency or time."""
    grid = _frequencies(scene, parts) if dim == "omega" else _times(scene, parts)
    if grid is None:
        return ""
    unit = "rad/s" if dim == "omega" else "s"
    if isinstance(label, str):
        return f"there is no {dim} '{label}'; a number is meant, {unit}"
    if np.isclose(grid, label, rtol=_LABEL_RTOL, atol=0).any():
        return ""
    near = np.unique(grid[np.clip(np.searchsorted(grid, label) + np.array([-1, 0]), 0, len(grid) - 1)])
    neighbours = " and ".join(map(repr, near.tolist()))
    return f"there is no {dim} {label:g} on the grid; next to it: {neighbours} {unit}"


def _frequencies(scene: Scene, parts: Parts) -> NDArray[np.float64] | None:
    """Return the frequencies of a group, rad/s, where the scene gives them."""
    from dynid.scene.kinds.signals import angular_frequencies

    grid = None
    if parts[0] == "bond_graph" and parts[1] in _OVER_FREQUENCY | {"port", "design"}:
        analysis = analysis_of(scene)
        if parts[1] in _OVER_FREQUENCY or parts[2] == "frequency_response":
            grid = analysis.frequency if analysis is not None else None
    elif parts[:2] == ("structure", "frequency_response"):
        grid = scene.model.structure_analysis.frequency
    elif parts[:2] == _FRF:
        grid = scene.model.frequency
    elif parts[0] == "identification" and parts[1] in ("measurement", "residual_spectrum"):
        return _axis_of_record(scene, parts, "omega")
    elif parts[:3] == ("identification", "derived", "frequency_response") and scene.model.derived:
        analysis = scene.model.structure_analysis or scene.model.graph_analysis
        grid = analysis.frequency if analysis is not None else None
    return None if grid is None else angular_frequencies(grid)


def _times(scene: Scene, parts: Parts) -> NDArray[np.float64] | None:
    """Return the times of a response or a record, s, where the scene gives them."""
    from dynid.scene.kinds.signals import record_of

    if "/".join(parts[:2]) in OF_RECORDS:
        return _axis_of_record(scene, parts, "time")
    if parts[1:2] != ("time_response",):
        return None
    analysis = analysis_of(scene) if parts[0] == "bond_graph" else scene.model.structure_analysis
    return None if analysis is None or analysis.time is None else record_of(analysis.time).times


@lru_cache(maxsize=1)
def _measured(scene: Scene[IdentificationScene]) -> list[Any]:
    """Return the records of an identification with their loads, its frequency responses, and its modes."""
    from dynid.scene.kinds.identified_graphs import identified_graph
    from dynid.scene.kinds.measurements import measurements_of

    model = structure_in(scene) if scene.model.graph is None else identified_graph(scene)[0]
    return measurements_of(scene, model)


def _records(scene: Scene[IdentificationScene]) -> list[Any]:
    """Return the records of an identification with their loads, or its frequency responses."""
    measured = scene.model.measurement
    return _measured(scene)[: -1 if measured is not None and measured.modes is not None else None]


def _channels(scene: Scene[IdentificationScene], parts: Parts) -> list[str] | None:
    """Return the names of channels in a group; None beside measured modes, which have others."""
    records, of_record = _records(scene), "/".join(parts[:2]) in OF_RECORDS
    if scene.model.measurement is None or (scene.model.measurement.modes is not None and not of_record):
        return None
    names = [
        f"{RECORD}{number}.{channel.name}" if len(records) > 1 and not of_record else channel.name
        for number, record in enumerate(records, 1)
        for channel in (record[1] if isinstance(record, tuple) else record).channels
    ]
    return list(dict.fromkeys(names))


def _axis_of_record(scene: Scene[IdentificationScene], parts: Parts, dim: str) -> NDArray[np.float64] | None:
    """Return the times of a record, or the lines of its spectra or of frequency responses."""
    from dynid.identification.likelihood.state_deviations import stored_rows
    from dynid.identification.residual_tests import spectral_lines

    records = _records(scene)
    number = parts[2].removeprefix(RECORD) if len(parts) > 3 else "1"
    if not number.isdigit() or not 1 <= int(number) <= len(records):
        return None
    record = records[int(number) - 1]
    if not isinstance(record, tuple):
        return np.asarray(record.omega) if dim == "omega" else None
    measurement: Measurement = record[1]
    delays = (delay for key, delay in quantities(scene.model) if key == "delay")
    delayed = any(float(delay) or delay.dependent for delay in delays)  # they may shorten records
    delayed &= not any(getattr(channel, "clock", None) for channel in measurement.channels)  # those do not
    if dim == "omega":
        return None if delayed else spectral_lines(measurement.samples, measurement.step)
    stored = parts[1] in _HISTORIES and not delayed
    rows = stored_rows(measurement.samples) if stored else slice(None)
    return np.arange(measurement.samples, dtype=np.float64)[rows] * measurement.step


def _max_count(scene: Scene, parts: Parts, dim: str) -> int | None:
    """Return the largest number on a numbered axis; None where the run alone says it."""
    if scene.kind == "identification" and parts[:2] == ("identification", "modes") and dim == "mode":
        modes = scene.model.measurement.modes
        return len(modes.values) if modes.file is None else len(_measured(scene)[-1].omega)
    requested = None
    if scene.kind == "identification" and parts[:2] == ("structure", "modes"):
        requested = scene.model.structure_analysis.modes.count
    counts = [count for count in (requested, _size(scene, parts, dim)) if count is not None]
    return min(counts) if counts else None


def _has_more_roots(scene: Scene) -> bool:
    """Return True where sampled controllers or lines bring roots beyond those of the storages."""
    control = scene.model.control
    return scene.model.graph.lines > 0 or (control is not None and control.sampled)


@lru_cache(maxsize=1)
def _storages(scene: Scene) -> int:
    """Return the number of storages of the graph of a scene, with those of its controllers."""
    if scene.kind == "bond-graph":
        from dynid.scene.kinds.bond_graph import built_graph, with_few_starts

        built = built_graph(with_few_starts(scene))
    else:
        from dynid.scene.kinds.identified_graphs import identified_graph

        built = identified_graph(scene)[1]
    return sum(node.type in STORAGES for node in built.graph.nodes.values())


def _size(scene: Scene, parts: Parts, dim: str) -> int | None:
    """Return the number that bounds a numbered axis: of storages, modes, starts, steps or unknowns."""
    if parts[:3] == ("bond_graph", "design", "optima"):
        return scene.model.design.starts if scene.model.design is not None else None
    if dim == "direction":
        return len(_unknowns(scene))
    if dim == "step":
        return _steps(scene, parts[1])
    if parts[0] == "bond_graph":
        counted = dim in _ROOT_AXES and parts[1] in _WITH_ROOTS and not _has_more_roots(scene)
        return _storages(scene) if counted else None
    if dim not in ("mode", "full_mode"):
        return None
    if scene.kind == "reduction" and parts[0] == "reduction":
        from dynid.scene.schema.reduction import max_size

        reduction = scene.model.reduction[method_names(scene, _FRF).index(parts[1])]
        size, full = max_size(reduction), structure_in(scene).size
        return full if size is None else min(size, full)
    with_modes = parts[:2] in (("structure", "modes"), ("identification", "derived"))
    if scene.kind == "identification" and with_modes and scene.model.graph is None:
        return structure_in(scene).size
    return None


@lru_cache(maxsize=2)
def _steps(scene: Scene, group: str) -> int | None:
    """Return the number of steps of the reductions of a graph; None where its values follow from the run."""
    from dynid.bondgraph.decomposition.equivalents import Decomposition
    from dynid.bondgraph.reduced_graph import ReducedGraph
    from dynid.scene.kinds.bond_graph import question

    model = scene.model
    if scene.kind != "bond-graph" or model.design is not None or model.operating_point is not None:
        return None
    graph, analysis = question(scene)
    graph = graph.rounded() if analysis.reading == "binary" else graph
    if group == "reduction":
        reduced: Any = ReducedGraph(graph, analysis.inputs, analysis.outputs, traced=True)
    elif analysis.port is not None:
        reduced = Decomposition(graph, analysis.port, analysis.inputs, tuple(analysis.initial))
    else:
        return None
    return sum(len(reduction.steps) for reduction in reduced.reductions.values())


def _unknowns(scene: Scene[IdentificationScene]) -> Sequence[Parameter]:
    model = scene.model
    return unknown_parameters(model) if model.graph is not None else structure_in(scene).unknowns


def _labels_of_graph(scene: Scene) -> dict[str, list[str]]:
    """Return the labels of axes of the results of a graph, as far as the scene alone says them."""
    model, analysis, labels = scene.model, analysis_of(scene), dict[str, list[str]]()
    if model.control is not None:
        labels["loop"] = model.control.loop_names
    if analysis is not None and not any(node.ports for node in model.graph.nodes.values()):
        sources = [name for name, node in model.graph.nodes.items() if node.type in SOURCES]
        sources += model.control.signals if model.control is not None else ()
        labels["output"] = [str(port) for port in analysis.outputs]
        labels["input"] = analysis.inputs or sources
        labels["source"] = sources
    return labels


def similar_or_all(name: str, candidates: Iterable[str]) -> str:
    """Return the end of a message about a name: a similar one, else those there are."""
    there = sorted(candidates)
    return did_you_mean(name, there) or f"; there are: {shortened(there)}"
