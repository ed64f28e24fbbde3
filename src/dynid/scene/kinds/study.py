"""Scenes of kind `study`: the scene that a study varies, and the faults of both together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

from dynid.arithmetic.expression import ExpressionError, parse
from dynid.errors import Fault, FileError, SceneError, UsageError
from dynid.scene.load import Scene, check_source
from dynid.scene.schema.study import (
    MAX_SAMPLES,
    Listed,
    Spread,
    StudyFactor,
    StudyScene,
    Triangular,
    Uniform,
    grid_length,
    grid_size,
    known_names,
    names_of_factor,
    paths_of,
)
from dynid.scene.yaml.source import read_source, set_values
from dynid.suggestions import did_you_mean

if TYPE_CHECKING:
    from dynid.result import Result


def run(scene: Scene, _: Result | None = None) -> Result:
    """Raise the error that a study is not run as one scene."""
    remedy = f"Run it with: dynid study {scene.source.file}"
    raise UsageError("this is a study: many runs of a scene", remedy=remedy)


def study_model(scene: Scene[StudyScene]) -> StudyScene:
    """Return the model of a study.

    Raises `UsageError` where the scene is not a study.
    """
    if scene.kind != "study":
        problem = f"{scene.source.file} is a scene of kind {scene.kind}, not a study"
        raise UsageError(problem, remedy=f"Run it with: dynid run {scene.source.file}")
    return scene.model


def base_scene(scene: Scene) -> Scene:
    """Return the scene that a study varies.

    Raises `FileError` where it cannot be read. Raises `SceneError` with all faults of it.
    """
    source = read_source(scene.folder / study_model(scene).scene)
    # Reported before it is checked: a chain of studies may be a cycle.
    if isinstance(source.data, dict) and source.data.get("kind") == "study":
        message = "this is a study itself; a study varies another scene"
        raise SceneError([scene.source.fault(("scene",), message)])
    return check_source(source)


def check_study(scene: Scene) -> None:
    """Check the keys of a study together, and that the scene that it varies accepts its values.

    Raises `FileError` where the scene it varies cannot be read. Raises `SceneError` with all faults of the
    study, or those of the scene it varies.
    """
    model = study_model(scene)
    faults = [scene.source.fault(path, message) for path, message in _study_faults(model)]
    try:
        base = scene.base
    except FileError as error:
        raise FileError(str(scene.source.fault(("scene",), str(error)))) from None
    except SceneError as error:
        raise SceneError([*faults, *error.faults]) from None
    if not faults:
        faults = list(refused(scene, model, base))
    if faults:
        raise SceneError(faults)


Located = tuple[tuple[str | int, ...], str]


def _study_faults(model: StudyScene) -> Iterator[Located]:
    yield from _path_faults(model)
    yield from _group_faults(model)
    yield from _sampling_faults(model)
    for target, text in model.derive.items():
        try:
            parse(text)  # the names of the scene's parameters are known when it has been read
        except ExpressionError as error:
            yield ("derive", target), str(error)
        if not all(target.split(".")) or "/" in target:
            yield ("derive", target), f"'{target}' is neither a name nor a dotted path into the scene"


def _path_faults(model: StudyScene) -> Iterator[Located]:
    """Yield the faults of paths: given twice, or several with lists of values of another length."""
    counts = Counter(model.varied)
    targets = [*counts, *(path for path in model.derive if "." in path)]
    for key, factor in model.vary.items():
        paths = paths_of(key)
        for path in paths:
            if not path or not all(path.split(".")) or "/" in path:
                yield ("vary", key), f"'{path}' is no dotted path into the scene, such as parameters.b"
            elif counts[path] > 1 or path in model.derive:
                yield ("vary", key), f"{path} is set twice"
            elif above := next((target for target in targets if path.startswith(f"{target}.")), None):
                yield ("vary", key), f"{path} is a part of {above}, which is set as well"
        if len(paths) > 1 and not isinstance(factor, Listed):
            yield ("vary", key), "several paths together take 'values' only: a list of values for each"
        elif len(paths) > 1:
            for index, value in enumerate(cast("Listed", factor).values):
                if not isinstance(value, list) or len(value) != len(paths):
                    yield ("vary", key, "values", index), f"this entry takes a list of {len(paths)} values"
        if len(names_of_factor(key, factor)) != len(paths):
            yield ("vary", key, "name"), f"'name' has not the {len(paths)} names of {key}"


def _group_faults(model: StudyScene) -> Iterator[Located]:  # noqa: C901 - one check after the other
    """Yield the faults of groups of paths that vary together on a grid, and of the number of samples."""
    seen: set[str] = set()
    lengths = {key: grid_length(factor) for key, factor in model.vary.items()}
    for number, group in enumerate(model.zip):
        for index, key in enumerate(group):
            if key not in model.vary:
                yield ("zip", number, index), _not_varied(key, model)
            elif key in seen:
                yield ("zip", number, index), f"'{key}' is in 'zip' twice"
            seen.add(key)
        counts = {lengths[key] for key in group if lengths.get(key) is not None}
        if len(counts) > 1:
            said = ", ".join(f"{key} has {lengths[key]}" for key in group if key in lengths)
            yield ("zip", number), f"what goes together has the same number of values: {said}"
    method = model.sampling.method
    if model.zip and method != "grid":
        yield ("zip",), f"'zip' joins values of a grid; '{method}' has none"
    if method in ("grid", "list"):
        for key, length in lengths.items():
            if length is None:
                yield ("vary", key), f"'{key}' needs 'points' for the method '{method}'"
    counts = {length for length in lengths.values() if length is not None}
    if method == "list" and len(counts) > 1:
        said = ", ".join(f"{key} has {length}" for key, length in lengths.items())
        yield ("vary",), f"a list takes the same number of values of each: {said}"
    if method == "grid" and not any(length is None for length in lengths.values()):
        count = grid_size(model)
        if count > MAX_SAMPLES:
            yield ("vary",), f"{count:.3g} samples are too many for one study; at most {MAX_SAMPLES:.0e}"


def _not_varied(key: str, model: StudyScene) -> str:
    """Return the message for a key that `vary` lacks, also for the end of one: b of parameters.b."""
    path = next((varied for varied in model.vary if varied.endswith(f".{key}")), "")
    hint = f"; did you mean '{path}'?" if path else did_you_mean(key, model.vary)
    return f"'{key}' is not in 'vary'{hint}"


def _sampling_faults(model: StudyScene) -> Iterator[Located]:
    sampling = model.sampling
    drawn = sampling.method in ("random", "latin-hypercube", "sobol")
    if drawn and sampling.samples is None:
        yield ("sampling", "samples"), f"'{sampling.method}' needs the number of 'samples'"
    if not drawn and sampling.samples is not None:
        yield ("sampling", "samples"), f"a {sampling.method} has as many samples as its values give"
    if sampling.indices and sampling.method != "sobol":
        yield ("sampling", "indices"), "Sobol indices need 'method: sobol'"
    if sampling.indices and sampling.correlation:
        yield ("sampling", "indices"), "Sobol indices are of values that are drawn independently"
    if sampling.indices and (sampling.samples or 0) * (len(model.vary) + 2) > MAX_SAMPLES:
        yield ("sampling", "samples"), f"indices of {len(model.vary)} values take too many samples"
    if sampling.correlation and not drawn:
        yield ("sampling", "correlation"), f"the values of a {sampling.method} are not drawn"
    for number, pair in enumerate(sampling.correlation):
        for index, key in enumerate(pair.between):
            where = ("sampling", "correlation", number, "between", index)
            if key not in model.vary:
                yield where, _not_varied(key, model)
            elif isinstance(model.vary[key], Listed):
                yield where, f"'{key}' is a choice of values, which has no correlation"
        if pair.between[0] == pair.between[1]:
            yield ("sampling", "correlation", number), "a value is not correlated with itself"


def refused(scene: Scene, model: StudyScene, base: Scene) -> Iterator[Fault]:
    """Yield the faults of paths that the scene lacks, or of which it rejects every value."""
    parameters = list(base.model.parameters)
    names = known_names(model, parameters)
    for target, text in model.derive.items():
        for name in sorted(parse(text).names - names.keys()):
            message = f"there is no '{name}' among what is varied{did_you_mean(name, names)}"
            yield scene.source.fault(("derive", target), message)
    needs = {
        target: [names[name] for name in sorted(parse(text).names & names.keys())]
        for target, text in model.derive.items()
    }
    for cycle in _cycles(needs):
        message = f"'{cycle[0]}' is defined by itself: {' -> '.join([*cycle, cycle[0]])}"
        yield scene.source.fault(("derive", cycle[0]), message)
    for section, paths in (
        ("vary", [(key, path) for key in model.vary for path in paths_of(key)]),
        ("derive", [(path, path) for path in model.derive]),
    ):
        for key, path in paths:
            holder, _, rest = path.partition(".")
            name = rest if rest in parameters else rest.partition(".")[0]  # of a part, as kb.start
            if holder == "parameters" and name not in parameters:
                message = f"{model.scene} has no parameter '{name}'{did_you_mean(name, parameters)}"
                yield scene.source.fault((section, key), message, key=True)
    for key, factor in model.vary.items():
        reasons = []
        for values in _examples(key, factor):
            try:
                check_source(set_values(base.source, values))
            except SceneError as error:
                reasons.append("; ".join(fault.message for fault in error.faults))
            else:
                break
        else:
            yield scene.source.fault(("vary", key), reasons[0], key=True)


def _cycles(needs: Mapping[str, Sequence[str]]) -> Iterator[list[str]]:
    sorted_out: set[str] = set()
    for start in needs:
        chain: list[str] = []
        stack = [(start, 0)]
        while stack:
            target, depth = stack.pop()
            del chain[depth:]
            if target in chain:
                yield chain[chain.index(target) :]
                sorted_out |= set(chain)
            elif target in needs and target not in sorted_out:
                chain.append(target)
                stack += [(needed, depth + 1) for needed in needs[target]]
        sorted_out.add(start)


def _examples(key: str, factor: StudyFactor) -> Iterator[Mapping[str, Any]]:
    """Yield example values of a factor: ends and middle."""
    paths = paths_of(key)
    if isinstance(factor, Listed):
        some = [factor.values[index] for index in (0, len(factor.values) // 2, -1)]
        yield from (dict(zip(paths, value if len(paths) > 1 else [value], strict=True)) for value in some)
        return
    if isinstance(factor, Spread):
        ends = (factor.start, factor.stop)
    elif isinstance(factor, Uniform | Triangular):
        ends = (factor.low, factor.high)
    else:
        ends = (factor.mean, factor.mean)
    low, high = (int(end.value) if end.exact.denominator == 1 else float(end) for end in ends)
    yield from ({paths[0]: value} for value in (low, high, (low + high) / 2))
