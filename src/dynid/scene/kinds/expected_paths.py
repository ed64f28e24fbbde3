"""Expectations of bond graphs whose paths no run of the scene can give, found before it is run.

`dynid check` refuses them; a run, of which they are the least part, reports them as not met at its end.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple, cast

from dynid.bondgraph.request import PROPERTIES, ResultName
from dynid.scene.schema.raw import MULTIPORTS, node_types, references
from dynid.suggestions import did_you_mean, shortened

if TYPE_CHECKING:
    from dynid.errors import Fault
    from dynid.scene.load import Scene
    from dynid.scene.schema.bond_graph import BondGraphScene

#: The groups that have one group for each output, and in it one for each input.
_OF_CHANNELS = ("properties", "transfer_function", "sensitivities")


class _Path(NamedTuple):
    """The path of an expectation in a group of channels, and its number in the scene."""

    number: int
    group: str
    output: str
    source: str
    name: str


def impossible_paths(scene: Scene) -> Iterator[Fault]:
    """Yield the expectations of outputs, inputs and properties that a bond graph does not have.

    Of graphs with multiports and structures, whose channels have names of their own, only properties.
    """
    if scene.kind != "bond-graph":
        return
    data, model = scene.source.data, cast("BondGraphScene", scene.model)
    types = node_types(data) | references(data)
    outputs = [str(port) for port in model.analysis.outputs]
    sources = [str(name) for name in model.analysis.inputs or ()]
    sources = sources or [name for name, kind in types.items() if kind in ("Se", "Sf")]
    certain = not any(kind in MULTIPORTS for kind in types.values())
    known = {name: None for names in PROPERTIES.values() for name in names}
    for path in _paths(model):
        problem = ""
        if certain and path.output not in outputs:
            problem = _not_among("output", path.output, outputs)
        elif certain and path.source not in sources:
            problem = _not_among("input", path.source, sources)
        elif path.group == "properties" and path.name not in known:
            # Without a similar name it may be one of an attribute.
            close = did_you_mean(path.name, known)
            problem = f"no channel has the property '{path.name}'{close}" if close else ""
        if problem:
            yield scene.source.fault(("expect", path.number, "path"), problem)


def unrequested_paths(scene: Scene, model: BondGraphScene) -> Iterator[Fault]:
    """Yield the expectations of properties of results that the scene does not request."""
    asked = model.analysis.asked()
    for path in (path for path in _paths(model) if path.group == "properties"):
        holders: list[ResultName] = [one for one, names in PROPERTIES.items() if path.name in names]
        if holders and asked.isdisjoint(holders):
            message = f"'{path.name}' comes with the result '{holders[0]}', which 'results' does not list"
            yield scene.source.fault(("expect", path.number, "path"), f"{message}; add it")


def _paths(model: BondGraphScene) -> Iterator[_Path]:
    for number, expectation in enumerate(model.expect):
        root, *parts = expectation.path.strip("/").split("/")
        if root == "bond_graph" and len(parts) > 3 and parts[0] in _OF_CHANNELS:
            yield _Path(number, *parts[:4])


def _not_among(what: str, name: str, known: list[str]) -> str:
    return f"'{name}' is not an {what}{did_you_mean(name, known) or f'; there are: {shortened(known)}'}"
