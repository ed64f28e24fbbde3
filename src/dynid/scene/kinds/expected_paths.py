"""Expectations and paths of `collect` that no run can meet, found before it is run.

`dynid check` refuses them; a run, of which they are the least part, reports them as not met at its end, and a
study with the samples that fail.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

from dynid.bondgraph.analysis_request import MARGINS, PROPERTIES, ResultName
from dynid.errors import DynidError
from dynid.scene.kinds.expected_labels import (
    derived_pairs,
    labels_of_graph,
    method_names,
    not_among,
    problem_of_label,
    problem_of_words,
    similar_or_all,
)
from dynid.scene.kinds.expected_requests import (
    GROUPS,
    OTHER_GROUPS,
    absence_in_graph,
    absence_in_identification,
    absence_in_structure,
    analysis_of,
)
from dynid.scene.kinds.result_layout import ATTRIBUTES, ROOT_ATTRIBUTES, groups_in, is_of_scene, names_in
from dynid.scene.schema.study import paths_of
from dynid.suggestions import did_you_mean

if TYPE_CHECKING:
    from dynid.errors import Fault
    from dynid.scene.load import Scene
    from dynid.scene.schema.bond_graph import AnalysisModel
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
    labels under `at` that no array there can have. What depends on the scene is left out where a study varies
    more than values, and names of channels where multiports or files give them. Of a `study` that varies the
    scene `collect` is checked as well, except for patterns.
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
    if root == "bond_graph" and certain and getattr(scene.model, "graph", None) is None:
        problem = "a structure has no results 'bond_graph'"
    elif root == "bond_graph" and len(rest) > 1:
        problem = _problem_of_graph(scene, rest, certain)
    elif root == "structure" and rest and certain:
        problem = absence_in_structure(scene, rest[0])
    elif root == "identification" and len(rest) > 1 and certain:
        problem = absence_in_identification(scene.model, rest) or _problem_of_pair(scene, rest)
    elif root == "reduction" and len(rest) > 1 and certain:
        problem = _problem_of_method(scene, rest[0])
    elif root == "synthesis" and len(rest) > 1 and certain:
        from dynid.bondgraph.synthesis.forms import FORMS

        forms = [*(scene.model.forms or FORMS), "need"]
        problem = "" if rest[0] in forms else not_among("form", rest[0], forms)
    problem = problem or _problem_of_layout(parts, method_names(scene, parts), groups=groups)
    names = [parts[depth - 1] for depth in range(1, len(parts)) if is_of_scene(parts[:depth])]
    return problem or (problem_of_words(scene, names) if certain and names else "")


def _problem_of_pair(scene: Scene, rest: list[str]) -> str:
    """Return the reason why nothing is derived of an output and an input; empty where it may be."""
    if rest[0] != "derived" or rest[1] not in ("zeros", "gains", "frequency_response"):
        return ""
    try:
        pairs = derived_pairs(scene)
    except DynidError:  # which the preparation of the run reports
        return ""
    outputs = list(dict.fromkeys(output for output, _ in pairs))
    inputs = list(dict.fromkeys(name for output, name in pairs if output in rest[2:3]))
    axes = (("output", outputs), ("input", inputs))
    for (axis, names), name in zip(axes, rest[2:], strict=False):
        if name not in names:
            return not_among(axis, name, names)
    return ""


def _problem_of_method(scene: Scene, name: str) -> str:
    names = [*method_names(scene, ("reduction", "frf")), "frf", "need"]
    return "" if name in names else f"no reduction is called '{name}'{similar_or_all(name, names)}"


def _problem_of_layout(parts: tuple[str, ...], further: Sequence[str], *, groups: bool) -> str:
    """Return the reason why no result has an array or attribute at a path; empty where one may.

    `further` are names of arrays beside those of the layout; with `groups` a group may be meant.
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
    return f"there is no '{missing}' in {'/'.join(above)}{similar_or_all(missing, candidates)}"


def _problem_of_graph(scene: Scene, rest: list[str], certain: bool) -> str:
    """Return the reason why the result of a graph has nothing at a path below `bond_graph`."""
    model, analysis = scene.model, analysis_of(scene)
    group, *below = rest
    groups = [*GROUPS, *OTHER_GROUPS]
    if analysis is None:
        return "'bond_graph' has the results of an analysis; add the block 'analysis'" if certain else ""
    asked = analysis.asked()
    if group not in groups:
        return f"a bond graph has no results '{group}'{similar_or_all(group, groups)}"
    for name in (group, "/".join(rest[:2])) if certain else ():
        if problem := absence_in_graph(model, analysis, name):
            return problem
    if group == "margins" and len(below) == 1 and below[0] not in MARGINS:
        return f"loops have no margin '{below[0]}'{similar_or_all(below[0], sorted(MARGINS))}"
    if group == "root_locus" and len(below) > 1 and certain and model.control is not None:
        loops = [f"loop_{number}" for number in range(1, len(model.control.loops) + 1)]
        return "" if below[0] in loops else not_among("loop", below[0], loops)
    labels = labels_of_graph(scene) if certain else {}
    depth = next((k for k in (1, 2) if tuple(rest[:k]) in _OF_CHANNELS), 0)
    axes = _OF_CHANNELS.get(tuple(rest[:depth]), ())
    for axis, name in zip(axes, rest[depth:-1], strict=False):
        if axis in labels and name not in labels[axis]:
            return not_among(axis, name, labels[axis])
    if group == "properties" and len(below) > 2:
        return _problem_of_property(below[2], asked, certain)
    if group == "transfer_function" and len(below) == 3 and certain:
        return _problem_of_channel(below[2], analysis)
    return ""


def _problem_of_channel(name: str, analysis: AnalysisModel) -> str:
    """Return the reason why a channel has no array of a name; empty where it may have."""
    holders: dict[str, ResultName] = {"zeros": "zeros", "poles": "poles"}
    holders |= dict.fromkeys(("numerator", "denominator", "gain"), "transfer_function")
    holder = holders.get(name)
    if holder is not None and holder not in analysis.asked():
        return f"'{name}' comes with the result '{holder}', which 'results' does not list; add it"
    if name in ("numerator", "denominator") and analysis.engine == "float":
        return f"'engine: float' forms no '{name}': expect zeros, poles and gain, or write 'engine: exact'"
    if name == "gain" and analysis.engine == "exact":
        return "the exact engine has 'numerator' and 'denominator' in place of 'gain'"
    return ""


def _impossible_labels(scene: Scene, *, certain: bool) -> Iterator[Fault]:
    """Yield the dimensions under `at` that no array at its path has, and labels that they cannot have."""
    for number, expectation in enumerate(scene.model.expect):
        parts = _parts(expectation.path)
        for dim, label in (expectation.at or {}).items():
            if problem := problem_of_label(scene, parts, dim, label, certain=certain):
                yield scene.source.fault(("expect", number, "at", dim), problem)


def _problem_of_property(name: str, asked: frozenset[ResultName], certain: bool) -> str:
    properties = {name: None for names in (*PROPERTIES.values(), _NOTES) for name in names}
    if name not in properties:
        return f"no channel has the property '{name}'{similar_or_all(name, list(properties))}"
    holders: list[ResultName] = [result for result, names in PROPERTIES.items() if name in names]
    if certain and holders and asked.isdisjoint(holders):
        return f"'{name}' comes with the result '{holders[0]}', which 'results' does not list; add it"
    return ""


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
