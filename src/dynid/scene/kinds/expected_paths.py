"""Expectations and paths of `collect` that no run can meet, found before it is run.

`dynid check` and `dynid run` refuse them; a study reports them with the samples that fail. Groups that follow
from the data, such as `equivalent_optima`, are left to the run.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from dynid.bondgraph.analysis_request import MARGINS, PROPERTIES, ResultName, available_results
from dynid.errors import DynidError, Fault
from dynid.scene.kind import resolve
from dynid.scene.kinds.expected_labels import (
    analysis_of,
    method_names,
    names_at,
    problem_of_label,
    problem_of_words,
    similar_or_all,
    structure_in,
)
from dynid.scene.kinds.graph_parts import has_law
from dynid.scene.kinds.result_layout import (
    ATTRIBUTES,
    RECORD,
    ROOT_ATTRIBUTES,
    Parts,
    groups_in,
    names_in,
    pattern_of,
)
from dynid.scene.schema.references import sections
from dynid.suggestions import did_you_mean, shortened

if TYPE_CHECKING:
    from dynid.scene.load import Scene
    from dynid.scene.schema.bond_graph import AnalysisModel
    from dynid.scene.schema.identification import IdentificationScene
    from dynid.scene.schema.study import StudyScene

#: Attributes of a channel's properties that are named like one of these.
_NOTES = frozenset({"hidden_mode_note", "approximate"})
#: Attributes of a channel whatever is requested of it.
_OF_CHANNELS = frozenset({"engine", "reading", "unit", "approximate"})
#: Arrays of complex numbers.
_COMPLEX = frozenset(
    {"bond_graph/margins/poles", "bond_graph/energy/poles", "bond_graph/frequency_response/response"}
    | {"bond_graph/sampled/poles"}
    | {f"bond_graph/transfer_function/<output>/<input>/{name}" for name in ("poles", "zeros")}
    | {"bond_graph/properties/<output>/<input>/hidden_modes"}
)
#: The groups at the root of results of known kinds, and the kinds of scene that have them.
_ROOTS: dict[str, tuple[str, ...]] = {
    "bond_graph": ("bond-graph", "identification"),
    "identification": ("identification",),
    "reduction": ("reduction",),
    "synthesis": ("synthesis",),
    "modal": ("modal-analysis",),
    "structure": ("bond-graph", "identification", "reduction"),
    "response": ("identification",),
    "accuracy": ("bond-graph", "identification", "reduction"),
}
#: The groups of bond graphs, with the results of which one has to be requested; none: by a key of the scene.
_RESULTS: dict[str, frozenset[ResultName]] = {
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
    "system": frozenset({"properties"}),
    "zero_input": frozenset({"transfer_function"}),
    **dict.fromkeys(("margins", "sensitivity_functions", "root_locus", "sampled"), frozenset({"properties"})),
    **dict.fromkeys(("port", "operating_point", "design", "state_feedback", "need"), frozenset()),
}
_COMES_WITH = "'{group}' comes with {cause}, which the scene does not have"
_BLOCK = "'{group}' needs the block '{key}' in 'analysis'"
#: Groups that come with a key of the scene or a condition, and the reason why they are absent without it.
_NEEDS: dict[str, tuple[str, str]] = {
    **{
        f"bond_graph/{name}": (key, f"a graph without loops has no {what}; close loops with 'control'")
        for name, key, what in (
            ("margins", "control or lines", "margins"),
            ("sensitivity_functions", "control", "sensitivity functions"),
            ("root_locus", "control", "root locus"),
        )
    },
    "bond_graph/sampled": ("sample", "no loop is sampled; state the 'sample' of its controller"),
    "bond_graph/state_feedback": (
        "control.states",
        "no states are fed back; write 'lqr' or 'placement' in 'control'",
    ),
    "structure/joints": ("joint laws", "'joints' come with nonlinear 'laws' of joints"),
    "response/backbone": (
        "responses.harmonic_balance.backbone",
        "'backbone' comes with 'harmonic_balance' in 'responses'",
    ),
    "response/harmonic_balance": (
        "responses.harmonic_balance",
        "'harmonic_balance' needs the block 'harmonic_balance' in 'responses'",
    ),
    "structure/damping": ("equivalent", "'damping' comes with its 'equivalent'"),
    "structure/complex_modes": (
        "loss factors",
        "'complex_modes' come with loss factors 'eta', or a 'gyroscopic' matrix",
    ),
    "structure/campbell": ("analysis.campbell", _BLOCK.format(group="campbell", key="campbell")),
    "identification/nonlinearity": (
        "linear joints in time",
        "'nonlinearity' is of linear joints and records of time",
    ),
    "identification/joints": ("joint laws", "'joints' come with nonlinear 'laws' of joints"),
    "bond_graph/port": (
        "analysis.port",
        "'port' needs the bond at which the graph is cut; name it in 'analysis.port'",
    ),
    "bond_graph/design": ("design", "'design' needs the block 'design'"),
    "bond_graph/design/frequency_response": (
        "analysis.frequency",
        _BLOCK.format(group="frequency_response", key="frequency"),
    ),
    "bond_graph/design/compared": (
        "design.compare",
        "'compared' is of the designs to 'compare'; name their values in 'design'",
    ),
    "bond_graph/zero_input": ("initial", "'zero_input' is of stored energy; give it in 'initial'"),
    "bond_graph/operating_point": (
        "laws",
        "a graph without laws has no operating point; write a 'law' or an 'operating_point'",
    ),
    "structure/modes": ("analysis.modes", _BLOCK.format(group="modes", key="modes")),
    "structure/time_response": ("analysis.time", _BLOCK.format(group="time_response", key="time")),
    **{
        f"structure/{name}": ("analysis.frequency", _BLOCK.format(group=name, key="frequency"))
        for name in ("frequency_response", "frequency_peaks")
    },
    **{
        f"identification/{name}": (key, _COMES_WITH.format(group=name, cause=cause))
        for name, key, cause in (
            ("robust", "huber", "the loss 'huber' of the 'estimator'"),
            ("laws", "estimator.laws", "candidates: the 'laws' of the 'estimator'"),
            ("posterior", "posterior_check", "'posterior_check: true'"),
            ("identifiability", "identifiability", "'identifiability: true'"),
            ("modes", "measurement.modes", "measured 'modes'"),
            ("held_out", "measurement.held_out", "records 'held_out' of the measurement"),
            ("noise", "noise", "a 'noise' of the kind coloured or proportional"),
            ("model_error", "reduction", "a 'reduction' and records of the full structure"),
        )
    },
}
_OF_TIME = frozenset({"history", "first_pass", "states", "innovations", "residual_spectrum"})


def impossible_paths(scene: Scene, study: Scene[StudyScene] | None = None) -> Iterator[Fault]:
    """Yield the paths of what the result does not have, and bounds of complex numbers.

    These are names that no group of a result has (`result_layout`), groups of other kinds and of results that
    are not requested, names of channels, loops and methods that the scene does not have, and dimensions and
    labels under `at` that no array there can have. What depends on the scene is left out where a study varies
    more than values, and names of channels where multiports or files give them. Of a `study` that varies the
    scene `collect` is checked as well, except for patterns.
    """
    if not any(scene.kind in kinds for kinds in _ROOTS.values()):
        return
    certain = study is None or all(
        path.startswith("parameters.") or path.endswith(".value") or "." not in path
        for path in [*study.model.varied, *study.model.derive]
    )
    paths: list[tuple[Scene, tuple[str | int, ...], str]] = [
        (scene, ("expect", k, "path"), expected.path) for k, expected in enumerate(scene.model.expect)
    ]
    if study is not None:
        collected = enumerate(study.model.collect)
        paths += [(study, ("collect", k), path) for k, path in collected if not set(path) & set("*?[")]
    refused = set()
    for holder, place, path in paths:
        if problem := _problem(scene, _parts(path), certain=certain, groups=holder is study):
            refused.add(place)
            yield holder.source.fault(place, problem)
    for number, expectation in enumerate(scene.model.expect):
        if ("expect", number, "path") in refused:
            continue  # labels of what does not exist
        parts = _parts(expectation.path)
        array = "/".join((*(pattern_of(parts[:-1]) or ()), parts[-1]))
        for dim, label in (expectation.at or {}).items():
            if problem := problem_of_label(scene, parts, dim, label, certain=certain):
                yield scene.source.fault(("expect", number, "at", dim), problem)
        if scene.kind == "bond-graph" and expectation.part is None and array in _COMPLEX:
            for key in ("min", "max"):
                if getattr(expectation, key) is not None:
                    message = f"'{key}' needs real numbers, and '{parts[-1]}' are complex; add part: real, "
                    yield scene.source.fault(("expect", number, key), f"{message}imaginary or magnitude")


def _parts(path: str) -> Parts:
    return tuple(path.strip("/").split("/"))


def _problem(scene: Scene, parts: Parts, *, certain: bool, groups: bool) -> str:
    """Return the reason why a result has nothing at a path; empty where it may have."""
    root, *rest = parts
    if root == "study" or (not rest and root in ROOT_ATTRIBUTES):
        return ""
    roots = [name for name, kinds in _ROOTS.items() if scene.kind in kinds]
    if root not in roots:
        there = did_you_mean(root, roots) or f"; it has {', '.join(roots)}"
        return f"a result of kind {scene.kind} has no group '{root}'{there}"
    if certain and root == "bond_graph" and getattr(scene.model, "graph", None) is None:
        return "a structure has no results 'bond_graph'"
    problem = ""
    if certain and len(rest) >= (1 if root == "structure" else 2):
        problem = _absence(scene, parts) or _problem_of_names(scene, parts)
    if root == "bond_graph" and len(rest) > 1:
        problem = problem or _problem_of_graph(scene, rest, certain=certain)
    problem = problem or _problem_of_layout(parts, method_names(scene, parts), groups=groups)
    patterns = ((name, pattern_of(parts[: k + 1]) or ("",)) for k, name in enumerate(parts[:-1]))
    names = [name for name, pattern in patterns if pattern[-1] in ("<output>", "<input>", "<name>")]
    return problem or (problem_of_words(scene, names) if certain and names else "")


def _absence(scene: Scene, parts: Parts) -> str:
    """Return the reason why a scene has no results in a group; empty where it may have."""
    (root, group, *below), reason = parts, ""
    analysis = analysis_of(scene) if root == "bond_graph" else None
    if root == "structure":
        reason = _absence_in_structure(scene, group)
    elif root == "identification" and group != "need":
        reason = _absence_in_identification(scene.model, group, below[0])
    elif root == "bond_graph" and analysis is None:
        reason = "'bond_graph' has the results of an analysis; add the block 'analysis'"
    elif root == "bond_graph" and group == "need" and scene.kind == "identification":
        reason = "the scope of an identified graph stands in 'identification/need'"
    needs = (_NEEDS.get("/".join(parts[:depth]), ("", "")) for depth in (2, 3))
    reason = reason or next((said for key, said in needs if key and not _has(scene.model, key)), "")
    results = _RESULTS.get(group, frozenset()) if below[-1] not in _OF_CHANNELS else frozenset[ResultName]()
    if reason or analysis is None or not results:
        return reason
    lines, sampled = scene.model.graph.lines > 0, _has(scene.model, "sample")
    available = available_results(sampled=sampled, lines=lines)
    if available.isdisjoint(results):
        with_what = " and ".join(["lines"] * lines + ["sampled loops"] * sampled)
        return f"a graph with {with_what} has no results '{group}'"
    if not (analysis.asked() & available).isdisjoint(results):
        return ""
    with_array = [result for result, arrays in PROPERTIES.items() if below[-1] in arrays]
    result = min(results) if results.isdisjoint(with_array) else with_array[0]
    block = {"frequency_response": "frequency", "time_response": "time"}.get(result, "")
    if block and getattr(analysis, block) is None:
        return _BLOCK.format(group=group, key=block)
    return _unlisted(group, result)


def _absence_in_structure(scene: Scene, group: str) -> str:
    """Return the reason why a scene has no results of its structure in a group; empty where it may have."""
    graph = getattr(scene.model, "graph", None)
    if graph is not None:
        # of structures in a graph there is a doubt of their nodes alone
        structures = any(node.type == "structure" for node in graph.nodes.values())
        return "" if group == "nodes" and structures else "a graph has no results of a structure"
    if group == "geometry":
        try:
            nodes = structure_in(scene).nodes
        except DynidError:  # which the preparation of the run reports
            return ""
        return "a structure without positions of nodes has no 'geometry'" if nodes is None else ""
    if group == "joints" and _has(scene.model, "joint laws") and not _has(scene.model, "analysis.time"):
        return _BLOCK.format(group=group, key="time")
    if f"structure/{group}" in _NEEDS and scene.kind == "reduction":
        return f"a comparison of reductions has no results 'structure/{group}'; they stand in 'reduction'"
    return ""


def _unlisted(name: str, result: ResultName) -> str:
    return f"'{name}' comes with the result '{result}', which 'results' does not list; add it"


def _sections(model: Any, reference: str) -> list[Any]:
    """Return the sections of a model in `dynid.scene.schema`, which is loaded here."""
    return [section for _, section in sections(model, resolve(f"dynid.scene.schema.{reference}"))]


def _has(model: Any, key: str) -> bool:
    """Return True for a scene with a key, given by its dotted path, or with a condition of `_NEEDS`."""
    match key:
        case "control or lines":  # a line has loops of its own
            return model.control is not None or model.graph.lines > 0
        case "laws":
            nodes = model.graph.nodes.values()
            return getattr(model, "operating_point", None) is not None or any(map(has_law, nodes))
        case "sample":
            return model.control is not None and bool(model.control.sampled)
        case "joint laws":
            return any(joint.laws for joint in _sections(model, "joints:JointModel"))
        case "loss factors":
            files = _sections(model, "structure:MatricesModel")  # which may have complex stiffnesses
            return bool(files) or any(getattr(part, "eta", None) for part in _sections(model, "base:Section"))
        case "linear joints in time":
            timed = model.measurement is not None and any(not record.frf for record in model.measurement.each)
            joints = _sections(model, "joints:JointModel")
            linear = bool(joints) and not any(joint.laws for joint in joints)
            return timed and linear and model.graph is None and not model.measurement.modes_alone
        case "equivalent":
            return any(damping.equivalent for damping in _sections(model, "structure:DampingModel"))
        case "huber":
            return bool(model.estimator.loss == "huber")
        case "noise":
            return any(_sections(record.noise, "measurement:NoiseModel") for record in model.measurement.each)
        case "reduction":
            records = model.measurement.each
            simulated = [record.frf.simulate if record.frf else record.simulate for record in records]
            full = not any(simulate is not None and simulate.model == "reduced" for simulate in simulated)
            return model.is_reduced and model.measurement.modes is None and full
    section = model
    for name in key.split("."):
        section = getattr(section, name, None)
    return bool(section)


def _absence_in_identification(model: IdentificationScene, group: str, name: str) -> str:
    """Return the reason why an identification has no results of its records at a path, or derives none."""
    measurement, estimator = model.measurement, model.estimator
    if measurement is None:
        return "nothing is identified without the block 'measurement'"
    if group == "derived":
        kind = "zeros" if name == "gains" else name
        named = kind in ("poles", "zeros", "modes", "frequency_response")
        if measurement.modes_alone and named:
            return "nothing is derived from measured modes alone; these are of records"
        if model.derived == []:
            return "nothing is derived: 'derived' is empty; list what is to be"
        listed = model.derived is None or kind in model.derived
        return "" if listed or not named else f"'{kind}' is not in the list 'derived'; add it"
    if group not in _OF_TIME | {"measurement"}:
        return ""
    if measurement.modes_alone:
        return f"measured modes alone have no '{group}'; it is of records"
    if measurement.frf is not None and group in _OF_TIME:
        return f"frequency responses have no '{group}'; it is of records of time"
    passes = estimator.method in ("filter", "sigma-point") and estimator.passes != 1
    methods = {"innovations": passes, "first_pass": passes or estimator.method == "auto"}
    if not methods.get(group, True):
        return f"'{group}' comes with several passes of the method 'filter' of the 'estimator'"
    count = len(measurement.each)
    records = [f"{RECORD}{number}" for number in range(1, count + 1)]
    if count > 1 and name not in records:
        return f"each record has a group of its own; there are: {shortened(records)}"
    return f"there is one record; leave '{name}' out" if count == 1 and name.startswith(RECORD) else ""


def _problem_of_names(scene: Scene, parts: Parts) -> str:
    """Return the reason why a scene has no channel, loop, method or form that a path names."""
    for depth in range(2, len(parts)):
        pattern, name = pattern_of(parts[:depth]) or ("",), parts[depth - 1]
        names = names_at(scene, pattern[-1], parts)
        if names is not None and name not in names:
            if pattern[-1] == "<method>":
                return f"no reduction is called '{name}'{similar_or_all(name, names)}"
            hint = did_you_mean(name, names) or f"; there are: {shortened(names)}"
            what = pattern[-1].strip("<>")
            return f"'{name}' is not {'an' if what[0] in 'io' else 'a'} {what}{hint}"
    return ""


def _problem_of_layout(parts: Parts, further: Sequence[str], *, groups: bool) -> str:
    """Return the reason why no result has a path, with `further` arrays; `groups`: a group may be meant."""
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
    candidates = {*groups_in(above), *(names if last else ())} or names
    return f"there is no '{missing}' in {'/'.join(above)}{similar_or_all(missing, candidates)}"


def _problem_of_graph(scene: Scene, rest: Sequence[str], *, certain: bool) -> str:
    """Return the reason why the result of a graph has no property, margin or array of a channel."""
    group, *below = rest
    analysis = analysis_of(scene)
    if analysis is None:
        return ""
    if group not in _RESULTS:
        return f"a bond graph has no results '{group}'{similar_or_all(group, _RESULTS)}"
    if group == "margins" and len(below) == 1 and below[0] not in MARGINS:
        return f"loops have no margin '{below[0]}'{similar_or_all(below[0], MARGINS)}"
    if group == "properties" and len(below) > 2:
        name = below[2]
        known = {name for names in (*PROPERTIES.values(), _NOTES) for name in names}
        if name not in known:
            return f"no channel has the property '{name}'{similar_or_all(name, known)}"
        holders = [result for result, names in PROPERTIES.items() if name in names]
        if certain and holders and analysis.asked().isdisjoint(holders):
            return _unlisted(name, holders[0])
    if group == "transfer_function" and len(below) == 3 and certain:
        return _problem_of_channel(below[2], analysis)
    return ""


def _problem_of_channel(name: str, analysis: AnalysisModel) -> str:
    """Return the reason why a channel has no array of a name; empty where it may have."""
    holders: dict[str, ResultName] = {"zeros": "zeros", "poles": "poles"}
    holders |= dict.fromkeys(("numerator", "denominator", "gain"), "transfer_function")
    holder = holders.get(name)
    if holder is not None and holder not in analysis.asked():
        return _unlisted(name, holder)
    if name in ("numerator", "denominator") and analysis.engine == "float":
        return f"'engine: float' forms no '{name}': expect zeros, poles and gain, or write 'engine: exact'"
    if name == "gain" and analysis.engine == "exact":
        return "the exact engine has 'numerator' and 'denominator' in place of 'gain'"
    return ""
