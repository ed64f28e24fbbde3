"""Expectations and paths of `collect` that no run can meet, found before it is run.

`dynid check` refuses them; a run, of which they are the least part, reports them as not met at its end, and a
study with the samples that fail.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple, cast

from dynid.bondgraph.request import MARGINS, PROPERTIES, ResultName
from dynid.scene.schema.raw import MULTIPORTS, node_types, references
from dynid.scene.schema.study import paths_of
from dynid.suggestions import did_you_mean, shortened

if TYPE_CHECKING:
    from dynid.errors import Fault
    from dynid.scene.load import Scene
    from dynid.scene.schema.bond_graph import BondGraphScene
    from dynid.scene.schema.study import StudyScene

#: Attributes of a channel's properties that are named like one of these.
_NOTES = frozenset({"hidden_mode_note"})
#: Arrays of complex numbers: their group, the number of names below it, and their own name.
_COMPLEX = frozenset(
    {
        *(("margins", 0, "poles"), ("energy", 0, "poles"), ("frequency_response", 0, "response")),
        *(("transfer_function", 2, "poles"), ("transfer_function", 2, "zeros")),
        ("properties", 2, "hidden_modes"),
    }
)
#: The groups that have one group for each output, and in it one for each input.
_OF_CHANNELS = ("properties", "transfer_function", "sensitivities")
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
    *("design", "zero_input", "need", "structures", "system", "sampled")
}
#: The groups at the root of results, and the kinds of scene that have them; other kinds have others.
_ROOTS: dict[str, frozenset[str]] = {
    "bond_graph": frozenset({"bond-graph", "identification"}),
    "identification": frozenset({"identification"}),
    "reduction": frozenset({"reduction"}),
    "synthesis": frozenset({"synthesis"}),
    "structure": frozenset({"bond-graph", "identification", "reduction"}),
    "accuracy": frozenset({"bond-graph", "identification", "reduction"}),
    "response": frozenset({"identification"}),
}
#: Kinds whose results are known.
_KNOWN_KINDS = frozenset({"bond-graph", "identification", "reduction", "synthesis"})
#: Arrays of groups that have the same ones in every result.
_ARRAYS: dict[str, frozenset[str]] = {
    "identification/parameters": frozenset(
        {"parameter", "name", "unit", "start", "true", "estimate", "standard_error", "standard_error_total"}
        | {"cramer_rao", "at_bound", "error_percent", "other", "correlation", "standard_error_scaled"}
        | {"identifiable", "error_bars"}
    ),
    "identification/diagnostics": frozenset(
        {"optimum", "settled", "converged", "explained", "redundancy", "signal_p", "signal_explained"}
        | {"lack_of_fit_p", "lacks_fit", "residual_rms", "residual_ratio", "whiteness_p", "white"}
        | {"log_likelihood", "bic", "observations", "free_parameters", "noise_p", "warnings", "condition"}
        | {"equivalent_optima", "channel_lack_of_fit_p", "parameter", "distance_to_optimum", "channel"}
        | {"starts", "starts_agreed", "passes", "residual_mean", "residual_mean_p", "residual_kurtosis"}
        | {"residual_kurtosis_p", "residual_largest", "residual_largest_p", "outliers", "lag", "verdict"}
        | {"autocorrelation", "autocorrelation_band", "channel_whiteness_p", "noise_contradicted"}
        | {"channel_noise_p", "noise_ratio", "nonlinear_p"}
    ),
    "reduction": frozenset(
        {"T", "mass", "damping", "stiffness", "masters", "modes", "condition", "frequencies", "reference"}
        | {"frequency_uncertainty", "reference_uncertainty", "frequency_error", "mac", "orthogonality"}
        | {"energy_error", "coordinate", "mode", "full_mode", "part", "mass_without_joints"}
        | {"damping_without_joints", "stiffness_without_joints"}
    ),
    "bond_graph/transfer_function": frozenset(
        {"numerator", "denominator", "zeros", "poles", "zero_error_bound", "pole_error_bound", "symbolic"}
        | {"numerator_power", "denominator_power", "zero", "pole", "unit"}
    ),
    "bond_graph/frequency_response": frozenset({"omega", "output", "input", "response", "unit"}),
    "bond_graph/time_response": frozenset(
        {"time", "output", "source", "response", "input", "unit", "input_unit", "zero_state", "zero_input"}
    ),
}


class _Wanted(NamedTuple):
    """A path in `expect` of a scene or in `collect` of a study, and its place there."""

    parts: tuple[str, ...]
    holder: Scene
    place: tuple[str | int, ...]

    def fault(self, problem: str) -> Fault:
        return self.holder.source.fault(self.place, problem)


def impossible_paths(scene: Scene, study: Scene | None = None) -> Iterator[Fault]:
    """Yield the paths of what the result does not have, and bounds of complex numbers.

    These are groups of other kinds, groups and properties of results that are not requested, names that are
    nearly those of arrays, and of bond graphs outputs, inputs and margins that they do not have; the latter
    not of graphs with multiports and structures, whose channels have names of their own, and where a study
    varies more than values.

    Parameters
    ----------
    scene
        The scene whose `expect` is checked.
    study
        The study that varies it; its `collect` is checked as well, except for patterns.
    """
    certain = _varies_values(study)
    for path in (*_expected(scene), *_collected(study)):
        if problem := _problem(scene, path.parts, certain=certain):
            yield path.fault(problem)
    if scene.kind == "bond-graph":
        yield from _bounds_of_complex_numbers(scene)


def _problem(scene: Scene, parts: tuple[str, ...], *, certain: bool) -> str:
    """Return the reason why a result has nothing at a path; empty where it may have."""
    root, *rest = parts
    if not rest or scene.kind not in _KNOWN_KINDS or root == "study":
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
    return problem or _misspelt(parts)


def _problem_of_method(scene: Scene, name: str) -> str:
    from dynid.scene.schema.reduction import ReductionScene, result_names

    methods: list[str] = [part.method for part in cast("ReductionScene", scene.model).reduction]
    known = [*result_names(methods), "frf", "need"]
    return "" if name in known else f"no reduction is called '{name}'{_similar_or_all(name, known)}"


def _misspelt(parts: tuple[str, ...]) -> str:
    """Return the problem of a last name that is nearly one of the arrays of its group."""
    for group, names in _ARRAYS.items():
        prefix = tuple(group.split("/"))
        between = {"reduction": 1, "bond_graph/transfer_function": 2}.get(group, 0)
        if parts[: len(prefix)] != prefix or len(parts) != len(prefix) + between + 1:
            continue
        if parts[-1] not in names and parts[1] not in ("frf", "need"):
            # Without a similar name it may be one of an attribute.
            close = did_you_mean(parts[-1], names)
            return f"there is no '{parts[-1]}' in {group}{close}" if close else ""
    return ""


def _problem_of_graph(scene: Scene, rest: list[str], certain: bool) -> str:
    """Return the reason why the result of a bond graph has nothing at a path below `bond_graph`."""
    data, model = scene.source.data, cast("BondGraphScene", scene.model)
    types = node_types(data) | references(data)
    group, *below = rest
    groups = [*_GROUPS, *_OTHER_GROUPS]
    asked = model.analysis.asked()
    certain_channels = certain and not any(kind in MULTIPORTS for kind in types.values())
    if group not in groups:
        return f"a bond graph has no results '{group}'{_similar_or_all(group, groups)}"
    if certain and group in _GROUPS and asked.isdisjoint(_GROUPS[group]):
        return _unrequested(group, next(iter(sorted(_GROUPS[group]))), model)
    if group == "margins" and certain_channels and model.control is None:
        return "a graph without loops has no margins; close loops with 'control'"
    if group == "margins" and len(below) == 1 and below[0] not in MARGINS:
        return f"loops have no margin '{below[0]}'{_similar_or_all(below[0], sorted(MARGINS))}"
    if group not in _OF_CHANNELS or len(below) < 3:
        return ""
    outputs = [str(port) for port in model.analysis.outputs]
    sources = [str(name) for name in model.analysis.inputs or ()]
    sources = sources or [name for name, kind in types.items() if kind in ("Se", "Sf")]
    if certain_channels and below[0] not in outputs:
        return _not_among("output", below[0], outputs)
    if certain_channels and below[1] not in sources:
        return _not_among("input", below[1], sources)
    return _problem_of_property(below[2], asked, certain) if group == "properties" else ""


def _problem_of_property(name: str, asked: frozenset[ResultName], certain: bool) -> str:
    known = {name: None for names in (*PROPERTIES.values(), _NOTES) for name in names}
    if name not in known:
        # Without a similar name it may be one of an attribute.
        close = did_you_mean(name, known)
        return f"no channel has the property '{name}'{close}" if close else ""
    holders: list[ResultName] = [one for one, names in PROPERTIES.items() if name in names]
    if certain and holders and asked.isdisjoint(holders):
        return f"'{name}' comes with the result '{holders[0]}', which 'results' does not list; add it"
    return ""


def _unrequested(group: str, result: ResultName, model: BondGraphScene) -> str:
    block = {"frequency_response": "frequency", "time_response": "time"}.get(result, "")
    if block and getattr(model.analysis, block) is None:
        return f"'{group}' needs the block '{block}' in 'analysis'"
    return f"'{group}' comes with the result '{result}', which 'results' does not list; add it"


def _similar_or_all(name: str, known: Sequence[str]) -> str:
    return did_you_mean(name, known) or f"; there are: {shortened(sorted(known))}"


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


def _expected(scene: Scene) -> Iterator[_Wanted]:
    for number, expectation in enumerate(scene.model.expect):
        if parts := _parts(expectation.path):
            yield _Wanted(parts, scene, ("expect", number, "path"))


def _collected(study: Scene | None) -> Iterator[_Wanted]:
    for number, path in enumerate(cast("StudyScene", study.model).collect if study else ()):
        if (parts := _parts(path)) and not any(letter in path for letter in "*?["):
            yield _Wanted(parts, cast("Scene", study), ("collect", number))


def _parts(path: str) -> tuple[str, ...]:
    """Return the parts of a path."""
    return tuple(path.strip("/").split("/"))


def _varies_values(study: Scene | None) -> bool:
    """Return True if all samples of a study have the nodes, outputs and inputs of its scene."""
    if study is None:
        return True
    model = cast("StudyScene", study.model)
    paths = [path for key in model.vary for path in paths_of(key)] + list(model.derive)
    return all(path.startswith("parameters.") or path.endswith(".value") or "." not in path for path in paths)


def _not_among(what: str, name: str, known: list[str]) -> str:
    return f"'{name}' is not an {what}{did_you_mean(name, known) or f'; there are: {shortened(known)}'}"
