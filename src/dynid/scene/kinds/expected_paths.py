"""Expectations and paths of `collect` that no run of a bond graph can meet, found before it is run.

`dynid check` refuses them; a run, of which they are the least part, reports them as not met at its end, and a
study with the samples that fail.
"""

from __future__ import annotations

from collections.abc import Iterator
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


class _Wanted(NamedTuple):
    """A path in `expect` of a scene or in `collect` of a study, and its place there."""

    parts: tuple[str, ...]
    holder: Scene
    place: tuple[str | int, ...]

    def fault(self, problem: str) -> Fault:
        return self.holder.source.fault(self.place, problem)


def impossible_paths(scene: Scene, study: Scene | None = None) -> Iterator[Fault]:
    """Yield the paths of what a bond graph does not have (outputs, margins), and bounds of complex numbers.

    Of graphs with multiports and structures, whose channels have names of their own, only properties and
    margins; also where a study varies more than values.

    Parameters
    ----------
    scene
        The scene whose `expect` is checked.
    study
        The study that varies it; its `collect` is checked as well, except for patterns.
    """
    if scene.kind != "bond-graph":
        return
    data, model = scene.source.data, cast("BondGraphScene", scene.model)
    types = node_types(data) | references(data)
    outputs = [str(port) for port in model.analysis.outputs]
    sources = [str(name) for name in model.analysis.inputs or ()]
    sources = sources or [name for name, kind in types.items() if kind in ("Se", "Sf")]
    certain = not any(kind in MULTIPORTS for kind in types.values()) and _varies_values(study)
    known = {name: None for names in (*PROPERTIES.values(), _NOTES) for name in names}
    for path in (*_expected(scene), *_collected(study)):
        group, *rest = path.parts
        problem = ""
        if group == "margins" and certain and model.control is None:
            problem = "a graph without loops has no margins; close loops with 'control'"
        elif group == "margins" and len(rest) == 1 and rest[0] not in MARGINS:
            there = f"; there are: {shortened(sorted(MARGINS))}"
            problem = f"loops have no margin '{rest[0]}'{did_you_mean(rest[0], MARGINS) or there}"
        elif group not in _OF_CHANNELS or len(rest) < 3:
            continue
        elif certain and rest[0] not in outputs:
            problem = _not_among("output", rest[0], outputs)
        elif certain and rest[1] not in sources:
            problem = _not_among("input", rest[1], sources)
        elif group == "properties" and rest[2] not in known:
            # Without a similar name it may be one of an attribute.
            close = did_you_mean(rest[2], known)
            problem = f"no channel has the property '{rest[2]}'{close}" if close else ""
        if problem:
            yield path.fault(problem)
    yield from _bounds_of_complex_numbers(scene)


def _bounds_of_complex_numbers(scene: Scene) -> Iterator[Fault]:
    """Yield the bounds on complex numbers, which have no order, where no part of them is meant."""
    for number, expectation in enumerate(scene.model.expect):
        group, *between = _parts(expectation.path)[:-1] or ("",)
        name = expectation.path.strip("/").rpartition("/")[2]
        if expectation.part is None and (group, len(between), name) in _COMPLEX:
            for key in ("min", "max"):
                if getattr(expectation, key) is not None:
                    message = f"'{key}' needs real numbers, and '{name}' are complex; add part: real, "
                    yield scene.source.fault(("expect", number, key), f"{message}imaginary or magnitude")


def unrequested_paths(scene: Scene, model: BondGraphScene) -> Iterator[Fault]:
    """Yield the expectations of properties of results that the scene does not request."""
    asked = model.analysis.asked()
    for path in _expected(scene):
        if path.parts[0] != "properties" or len(path.parts) < 4:
            continue
        name = path.parts[3]
        holders: list[ResultName] = [one for one, names in PROPERTIES.items() if name in names]
        if holders and asked.isdisjoint(holders):
            message = f"'{name}' comes with the result '{holders[0]}', which 'results' does not list"
            yield path.fault(f"{message}; add it")


def _expected(scene: Scene) -> Iterator[_Wanted]:
    for number, expectation in enumerate(scene.model.expect):
        if parts := _parts(expectation.path):
            yield _Wanted(parts, scene, ("expect", number, "path"))


def _collected(study: Scene | None) -> Iterator[_Wanted]:
    for number, path in enumerate(cast("StudyScene", study.model).collect if study else ()):
        if (parts := _parts(path)) and not any(letter in path for letter in "*?["):
            yield _Wanted(parts, cast("Scene", study), ("collect", number))


def _parts(path: str) -> tuple[str, ...]:
    """Return the parts of a path below the group of bond graphs; none of others."""
    root, *parts = path.strip("/").split("/")
    return tuple(parts) if root == "bond_graph" else ()


def _varies_values(study: Scene | None) -> bool:
    """Return True if all samples of a study have the nodes, outputs and inputs of its scene."""
    if study is None:
        return True
    model = cast("StudyScene", study.model)
    paths = [path for key in model.vary for path in paths_of(key)] + list(model.derive)
    return all(path.startswith("parameters.") or path.endswith(".value") or "." not in path for path in paths)


def _not_among(what: str, name: str, known: list[str]) -> str:
    return f"'{name}' is not an {what}{did_you_mean(name, known) or f'; there are: {shortened(known)}'}"
