"""Expectations and paths of `collect` that no run can meet, found before it is run.

`dynid check` refuses them; a run, of which they are the least part, reports them as not met at its end, and a
study with the samples that fail.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from dynid.bondgraph.analysis_request import MARGINS, PROPERTIES, ResultName
from dynid.scene.kinds.parameters import unknown_parameters
from dynid.scene.kinds.result_layout import ATTRIBUTES, ROOT_ATTRIBUTES, groups_in, is_of_scene, names_in
from dynid.scene.schema.joints import ParameterModel
from dynid.scene.schema.references import sections
from dynid.scene.schema.study import paths_of
from dynid.suggestions import did_you_mean, shortened

if TYPE_CHECKING:
    from dynid.errors import Fault
    from dynid.scene.load import Scene
    from dynid.scene.schema.bond_graph import BondGraphScene
    from dynid.scene.schema.identification import IdentificationScene
    from dynid.scene.schema.study import StudyScene

#: Attributes of a channel's properties that are named like one of these.
_NOTES = frozenset({"hidden_mode_note", "approximate"})
#: Arrays of complex numbers: their group, the number of names below it, and their own name.
_COMPLEX = frozenset(
    {
        *(("margins", 0, "poles"), ("energy", 0, "poles"), ("frequency_response", 0, "response")),
        *(("transfer_function", 2, "poles"), ("transfer_function", 2, "zeros")),
        ("properties", 2, "hidden_modes"),
    }
)
#: Groups of bond graphs with one group for each output or input, or for each output and in it each input.
_OF_CHANNELS: dict[tuple[str, ...], tuple[str, ...]] = {
    **{(name,): ("output", "input") for name in ("properties", "transfer_function", "sensitivities")},
    ("zero_input",): ("output",),
    ("source_performance",): ("input",),
    ("reduction", "dynamics"): ("output",),
    ("causality", "zero_dynamics"): ("output", "input"),
    ("port", "requested"): ("output", "input"),
}
#: Groups of bond graphs that come with a block of the scene, and how to write that.
_OF_BLOCKS = {
    "margins": "a graph without loops has no margins; close loops with 'control'",
    "sensitivity_functions": "a graph without loops has no sensitivity functions; close loops with 'control'",
    "root_locus": "a graph without loops has no root locus; close loops with 'control'",
    "port": "'port' needs the bond at which the graph is cut; name it in 'analysis.port'",
    "design": "'design' needs the block 'design'",
}
#: What separates the words of names of channels and DOFs, and the words that a scene need not write.
_WORD = re.compile(r"[^\w]+")
_CHANNEL_WORDS = frozenset(
    {"initial", "displacement", "velocity", "acceleration", "force", "e", "f", "q", "p"}
    | {"x", "y", "z", "rx", "ry", "rz"}
)
#: Axes that are numbered from 1.
_NUMBERED = frozenset(
    {"mode", "full_mode", "pole", "zero", "hidden_mode", "natural_mode", "optimum", "equilibrium"}
    | {"step", "branch", "direction"}
)
#: Groups of identifications whose axis `parameter` is that of the unknown ones.
_OF_PARAMETERS = frozenset(
    ("identification", name) for name in ("parameters", "rejected", "diagnostics", "equivalent_optima")
)
#: Dimensions without a coordinate.
_UNLABELLED = frozenset({"line", "master", "basis_mode", "end"})
#: The groups of bond graphs, with the results of which one has to be requested.
_GROUPS: dict[str, frozenset[ResultName]] = {
    "transfer_function": frozenset({"transfer_function", "zeros", "poles"}),
    "properties": frozenset(PROPERTIES),
    "frequency_response": frozenset({"frequency_response"}),
    "frequency_peaks": frozenset({"frequency_response"}),
    "time_response": frozenset({"time_response"}),
    "state_space": frozenset({"state_space"}),
    "sensitivities": frozenset({"sensitivities"}),
    "causality": frozenset({"causality"}),
    "energy": frozenset({"energy"}),
    "source_performance": frozenset({"source_performance"}),
    "reduction": frozenset({"reduction", "prototype"}),
}
#: Further groups of bond graphs, which come with blocks of the scene.
_OTHER_GROUPS = frozenset({"port", "margins", "sensitivity_functions", "root_locus", "operating_point"}) | {
    *("design", "zero_input", "need", "system")
}
#: The groups at the root of results, and the kinds of scene that have them; other kinds have others.
_ROOTS: dict[str, frozenset[str]] = {
    "bond_graph": frozenset({"bond-graph", "identification"}),
    "identification": frozenset({"identification"}),
    "reduction": frozenset({"reduction"}),
    "synthesis": frozenset({"synthesis"}),
    "structure": frozenset({"bond-graph", "identification", "reduction"}),
    "accuracy": frozenset({"bond-graph", "identification", "reduction"}),
}
#: Kinds whose results are known.
_KNOWN_KINDS = frozenset({"bond-graph", "identification", "reduction", "synthesis"})


class _ExpectedPath(NamedTuple):
    """A path in `expect` of a scene or in `collect` of a study, and its place there."""

    parts: tuple[str, ...]
    holder: Scene
    place: tuple[str | int, ...]

    def fault(self, problem: str) -> Fault:
        return self.holder.source.fault(self.place, problem)


def impossible_paths(scene: Scene, study: Scene | None = None) -> Iterator[Fault]:
    """Yield the paths of what the result does not have, and bounds of complex numbers.

    These are names that no group of a result has (`result_layout`), groups of other kinds and of results that
    are not requested, names of channels, loops and methods that the scene does not have, and dimensions and
    labels under `at` that no array there can have. What depends on the scene is left out where a study
    varies more than values, and names of channels where multiports or files give them.

    Parameters
    ----------
    scene
        The scene whose `expect` is checked.
    study
        The study that varies it; its `collect` is checked as well, except for patterns.
    """
    certain = _varies_values(study)
    for path in (*_expected(scene), *(_collected(study) if study is not None else ())):
        if problem := _problem(scene, path.parts, certain=certain, groups=path.holder is study):
            yield path.fault(problem)
    if scene.kind in _KNOWN_KINDS:
        yield from _impossible_labels(scene, certain=certain)
    if scene.kind == "bond-graph":
        yield from _bounds_of_complex_numbers(scene)


def _problem(scene: Scene, parts: tuple[str, ...], *, certain: bool, groups: bool) -> str:
    """Return the reason why a result has nothing at a path; empty where it may have."""
    root, *rest = parts
    if scene.kind not in _KNOWN_KINDS or root == "study" or (not rest and root in ROOT_ATTRIBUTES):
        return ""
    roots = [name for name, kinds in _ROOTS.items() if scene.kind in kinds]
    if root not in roots:
        there = did_you_mean(root, roots) or f"; it has {', '.join(roots)}"
        return f"a result of kind {scene.kind} has no group '{root}'{there}"
    problem = ""
    if root == "bond_graph" and scene.kind == "bond-graph" and len(rest) > 1:
        problem = _problem_of_graph(scene, rest, certain)
    elif root == "reduction" and len(rest) > 1 and certain:
        problem = _problem_of_method(scene, rest[0])
    elif root == "synthesis" and len(rest) > 1 and certain:
        from dynid.bondgraph.synthesis.forms import FORMS

        forms = [*(scene.model.forms or FORMS), "need"]
        problem = "" if rest[0] in forms else _not_among("form", rest[0], forms)
    problem = problem or _problem_of_layout(parts, _method_names(scene, parts), groups=groups)
    names = [parts[depth - 1] for depth in range(1, len(parts)) if is_of_scene(parts[:depth])]
    return problem or (_problem_of_words(scene, names) if certain and names else "")


def _problem_of_words(scene: Scene, names: Sequence[str]) -> str:
    """Return the first word in names of channels, DOFs or parameters that stands nowhere in the scene.

    They are made of the scene's words, by points and colons; those of channels that a file names are not.
    """
    words = _words(scene.source.data)
    strange = [word for name in names for word in _WORD.split(name) if not (word.isdigit() or word in words)]
    if not strange or "file" in words:
        return ""
    return f"nothing in the scene is called '{strange[0]}'{did_you_mean(strange[0], words)}"


def _words(data: Any) -> set[str]:
    """Return the words of a scene: its keys and texts, but for `expect`, split into words."""
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


def _method_names(scene: Scene, parts: tuple[str, ...]) -> list[str]:
    """Return the names of the reductions of a scene, which are arrays in `reduction/frf`."""
    from dynid.scene.schema.reduction import result_names

    if parts[:2] != ("reduction", "frf"):
        return []
    return result_names([reduction.method for reduction in scene.model.reduction])


def _problem_of_method(scene: Scene, name: str) -> str:
    names = [*_method_names(scene, ("reduction", "frf")), "frf", "need"]
    return "" if name in names else f"no reduction is called '{name}'{_similar_or_all(name, names)}"


def _problem_of_layout(parts: tuple[str, ...], further: Sequence[str], *, groups: bool) -> str:
    """Return the reason why no result has an array or attribute at a path; empty where one may.

    Parameters
    ----------
    parts
        The parts of the path.
    further
        Names of arrays that a group has beside those of the layout.
    groups
        True: a group may be meant, with all that is in it.
    """
    *group, name = parts
    *holder, array = group or ("",)
    if name in {*(names_in(tuple(group)) or ()), *further}:
        return ""
    if name in ATTRIBUTES and array in {*(names_in(tuple(holder)) or ()), *further}:
        return ""
    depth = next((k for k in range(1, len(parts) + 1) if names_in(parts[:k]) is None), 0)
    if not depth:
        return "" if groups else f"'{name}' is a group of arrays; name one of them"
    # the deepest group that results have, and what of it there is not
    above, missing, last = parts[: depth - 1], parts[depth - 1], depth == len(parts)
    names = names_in(above) or frozenset()
    of_parameters = above == ("identification", "parameters") and depth + 1 == len(parts)
    if of_parameters and (missing in names or name in names):
        array, label = (missing, name) if missing in names else (name, missing)
        path = f"{'/'.join(above)}/{array}"
        return f"'{path}' is an array of all parameters; write path: {path}, at: {{parameter: {label}}}"
    if missing in names and not last:
        return f"'{missing}' is no group, it has no '{'/'.join(parts[depth:])}'"
    candidates = sorted({*groups_in(above), *(names if last else ())}) or sorted(names)
    return f"there is no '{missing}' in {'/'.join(above)}{_similar_or_all(missing, candidates)}"


def _problem_of_graph(scene: Scene[BondGraphScene], rest: list[str], certain: bool) -> str:
    """Return the reason why the result of a bond graph has nothing at a path below `bond_graph`."""
    model = scene.model
    group, *below = rest
    groups = [*_GROUPS, *_OTHER_GROUPS]
    asked = model.analysis.asked()
    if group not in groups:
        return f"a bond graph has no results '{group}'{_similar_or_all(group, groups)}"
    if certain and group in _GROUPS and asked.isdisjoint(_GROUPS[group]):
        return _unrequested(group, next(iter(sorted(_GROUPS[group]))), model)
    if certain and group in _OF_BLOCKS and not _has_block(group, model):
        return _OF_BLOCKS[group]
    if group == "margins" and len(below) == 1 and below[0] not in MARGINS:
        return f"loops have no margin '{below[0]}'{_similar_or_all(below[0], sorted(MARGINS))}"
    if group == "root_locus" and len(below) > 1 and certain and model.control is not None:
        loops = [f"loop_{number}" for number in range(1, len(model.control.loops) + 1)]
        return "" if below[0] in loops else _not_among("loop", below[0], loops)
    labels = _labels_of_graph(scene) if certain else {}
    depth = next((k for k in (1, 2) if tuple(rest[:k]) in _OF_CHANNELS), 0)
    axes = _OF_CHANNELS.get(tuple(rest[:depth]), ())
    for axis, name in zip(axes, rest[depth:-1], strict=False):
        if axis in labels and name not in labels[axis]:
            return _not_among(axis, name, labels[axis])
    if group == "properties" and len(below) > 2:
        return _problem_of_property(below[2], asked, certain)
    return ""


def _impossible_labels(scene: Scene, *, certain: bool) -> Iterator[Fault]:
    """Yield the dimensions under `at` that no array at its path has, and labels that they cannot have."""
    for number, expectation in enumerate(scene.model.expect):
        parts = _parts(expectation.path)
        for dim, label in (expectation.at or {}).items():
            if problem := _problem_of_label(scene, parts, dim, label, certain=certain):
                yield scene.source.fault(("expect", number, "at", dim), problem)


def _problem_of_label(
    scene: Scene, parts: tuple[str, ...], dim: str, label: str | float, *, certain: bool
) -> str:
    """Return the reason why an array has no dimension of a name, or none with a label; empty where it may."""
    groups = [names for k in range(1, len(parts)) if (names := names_in(parts[:k])) is not None]
    dims = frozenset().union(*groups)
    if not dims or parts[0] not in _ROOTS:
        return ""
    if dim not in dims | _UNLABELLED:
        return f"'{parts[-1]}' has no dimension '{dim}'{did_you_mean(dim, dims)}"
    if dim in _NUMBERED:
        counted = not isinstance(label, str) and label >= 1 and float(label).is_integer()
        return "" if counted else f"there is no {dim} {label}; they are numbered from 1"
    labels = _labels(scene, parts).get(dim) if certain else None
    if labels is None or str(label) in labels:
        return ""
    if not labels:  # names that are made of the scene's words
        return _problem_of_words(scene, [str(label)])
    return f"there is no {dim} '{label}'{_similar_or_all(str(label), labels)}"


def _labels(scene: Scene, parts: tuple[str, ...]) -> dict[str, list[str]]:
    """Return the labels of axes of the arrays in a group, as far as the scene alone says them."""
    if scene.kind == "bond-graph" and parts[0] == "bond_graph":
        labels = _labels_of_graph(scene)
        axes_of_groups = {
            "margins": ("loop",),
            "sensitivity_functions": ("loop",),
            "reduction": ("output",),
        } | {
            "frequency_response": ("output", "input"),
            "frequency_peaks": ("output", "input"),
            "time_response": ("output", "source"),
        }
        axes = axes_of_groups.get(parts[1], ()) if len(parts) == 3 else ()
        return {axis: labels[axis] for axis in axes if axis in labels}
    if scene.kind == "identification" and parts[:2] in _OF_PARAMETERS:
        return dict.fromkeys(("parameter", "other"), _unknown_names(scene))
    if scene.kind == "reduction" and parts[0] == "reduction":
        return {"method": _method_names(scene, ("reduction", "frf"))}
    return {}


def _unknown_names(scene: Scene[IdentificationScene]) -> list[str]:
    """Return the names of the unknown parameters of a scene; none where others than `parameters` are."""
    if any(joint.start is not None for _, joint in sections(scene.model.joints, ParameterModel)):
        return []
    return [parameter.name for parameter in unknown_parameters(scene.model)]


def _has_block(group: str, model: BondGraphScene) -> bool:
    if group == "port":
        return model.analysis.port is not None
    return (model.design if group == "design" else model.control) is not None


def _labels_of_graph(scene: Scene[BondGraphScene]) -> dict[str, list[str]]:
    """Return the labels of axes of the results of a bond graph, as far as the scene alone says them."""
    model, labels = scene.model, {}
    if model.control is not None:
        labels["loop"] = [f"{loop.measured} -> {loop.source}" for loop in model.control.loops]
    if not any(node.ports for node in model.graph.nodes.values()):  # whose names are their own
        labels["output"] = [str(port) for port in model.analysis.outputs]
        labels["input"] = model.analysis.inputs or model.sources
        labels["source"] = model.sources
    return labels


def _problem_of_property(name: str, asked: frozenset[ResultName], certain: bool) -> str:
    properties = {name: None for names in (*PROPERTIES.values(), _NOTES) for name in names}
    if name not in properties:
        return f"no channel has the property '{name}'{_similar_or_all(name, list(properties))}"
    holders: list[ResultName] = [result for result, names in PROPERTIES.items() if name in names]
    if certain and holders and asked.isdisjoint(holders):
        return f"'{name}' comes with the result '{holders[0]}', which 'results' does not list; add it"
    return ""


def _unrequested(group: str, result: ResultName, model: BondGraphScene) -> str:
    block = {"frequency_response": "frequency", "time_response": "time"}.get(result, "")
    if block and getattr(model.analysis, block) is None:
        return f"'{group}' needs the block '{block}' in 'analysis'"
    return f"'{group}' comes with the result '{result}', which 'results' does not list; add it"


def _similar_or_all(name: str, candidates: Sequence[str]) -> str:
    return did_you_mean(name, candidates) or f"; there are: {shortened(sorted(candidates))}"


def _bounds_of_complex_numbers(scene: Scene) -> Iterator[Fault]:
    """Yield the bounds on complex numbers, which have no order, where no part of them is meant."""
    for number, expectation in enumerate(scene.model.expect):
        root, *groups = _parts(expectation.path)[:-1] or ("",)
        group, *between = groups if root == "bond_graph" and groups else ("",)
        name = expectation.path.strip("/").rpartition("/")[2]
        if expectation.part is None and (group, len(between), name) in _COMPLEX:
            for key in ("min", "max"):
                if getattr(expectation, key) is not None:
                    message = f"'{key}' needs real numbers, and '{name}' are complex; add part: real, "
                    yield scene.source.fault(("expect", number, key), f"{message}imaginary or magnitude")


def _expected(scene: Scene) -> Iterator[_ExpectedPath]:
    for number, expectation in enumerate(scene.model.expect):
        if parts := _parts(expectation.path):
            yield _ExpectedPath(parts, scene, ("expect", number, "path"))


def _collected(study: Scene[StudyScene]) -> Iterator[_ExpectedPath]:
    for number, path in enumerate(study.model.collect):
        if (parts := _parts(path)) and not any(letter in path for letter in "*?["):
            yield _ExpectedPath(parts, study, ("collect", number))


def _parts(path: str) -> tuple[str, ...]:
    """Return the parts of a path."""
    return tuple(path.strip("/").split("/"))


def _varies_values(study: Scene[StudyScene] | None) -> bool:
    """Return True if all samples of a study have the nodes, outputs and inputs of its scene."""
    if study is None:
        return True
    model = study.model
    paths = [path for key in model.vary for path in paths_of(key)] + list(model.derive)
    return all(path.startswith("parameters.") or path.endswith(".value") or "." not in path for path in paths)


def _not_among(what: str, name: str, candidates: list[str]) -> str:
    hint = did_you_mean(name, candidates) or f"; there are: {shortened(candidates)}"
    return f"'{name}' is not an {what}{hint}"
