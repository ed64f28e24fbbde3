"""References in scenes to DOFs, nodes and files, found and checked by the types of their fields.

A field that names something is annotated with a `Reference`, such as `DOF`. One walk along the types of a
scene's model finds all references in the plain data of a scene, also where other keys are at fault.
"""

from __future__ import annotations

import types
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel

from dynid.errors import Fault
from dynid.scene.schema.later import Later
from dynid.scene.yaml.source import Source
from dynid.suggestions import did_you_mean

if TYPE_CHECKING:
    from dynid.structure.labels import DofNames


Path = tuple[Any, ...]


@dataclass(frozen=True)
class Reference:
    """Annotation of a field that refers to a DOF, a node or a file; `to` is the noun for it."""

    to: str


#: A degree of freedom of the structure: its label, its number from 1, or NODE:DIR.
DOF = Reference("DOF")
#: The same where a sign makes sense, NODE:-DIR.
SIGNED_DOF = Reference("signed DOF")
#: A node of a beam or frame: its number from 1.
NODE = Reference("node")
#: A file, relative to the folder of the scene.
FILE = Reference("file")


class Occurrence(NamedTuple):
    """One reference in a scene: its path, its value as written, and whether it is a key."""

    path: Path
    value: Any
    is_key: bool = False


@dataclass(frozen=True)
class _Shape:
    """A type reduced to its references, its models, and the shapes within, as the walk needs them."""

    references: frozenset[Reference] = frozenset()
    unloaded: frozenset[type[BaseModel] | Later] = frozenset()
    item: _Shape | None = None
    key: _Shape | None = None
    value: _Shape | None = None

    def __bool__(self) -> bool:
        return self != _Shape()

    def __or__(self, other: _Shape) -> _Shape:
        return _Shape(
            self.references | other.references,
            self.unloaded | other.unloaded,
            _joined(self.item, other.item),
            _joined(self.key, other.key),
            _joined(self.value, other.value),
        )

    @cached_property
    def models(self) -> frozenset[type[BaseModel]]:
        """The models of a mapping, loaded: asked for where a scene has one."""
        return frozenset(one.model() if isinstance(one, Later) else one for one in self.unloaded)

    @cached_property
    def fields(self) -> Mapping[str, _Shape]:
        """The shapes of their keys."""
        fields: dict[str, _Shape] = {}
        for model in self.models:
            for name, one in _fields(model).items():
                fields[name] = fields[name] | one if name in fields else one
        return fields


def _joined(one: _Shape | None, other: _Shape | None) -> _Shape | None:
    return one | other if one and other else one or other


def _shape(annotation: Any, metadata: Iterable[Any] = ()) -> _Shape:
    """Return the shape of a type; of a union what any member has."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    metadata = tuple(metadata)
    shape = _Shape(
        frozenset(one for one in metadata if isinstance(one, Reference)),
        frozenset(one for one in metadata if isinstance(one, Later) and one.reference),
    )
    if origin is Annotated:
        return shape | _shape(arguments[0], arguments[1:])
    if origin in (Union, types.UnionType):
        for member in arguments:
            shape |= _shape(member)
    elif origin is list:
        shape |= _Shape(item=_shape(arguments[0]) or None)
    elif origin is dict:
        shape |= _Shape(key=_shape(arguments[0]) or None, value=_shape(arguments[1]) or None)
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        shape |= _Shape(unloaded=frozenset([annotation]))
    return shape


@cache
def _fields(model: type[BaseModel]) -> dict[str, _Shape]:
    """Return the shapes of the keys of a model that hold references or models."""
    fields = {name: _shape(one.annotation, one.metadata) for name, one in model.model_fields.items()}
    return {name: one for name, one in fields.items() if one}


def _walk(shape: _Shape, value: Any, path: Path) -> Iterator[tuple[_Shape, Occurrence]]:
    """Yield every value in plain data with its shape; one that does not fit its type is not entered."""
    yield shape, Occurrence(path, value)
    if isinstance(value, list) and shape.item:
        for place, entry in enumerate(value):
            yield from _walk(shape.item, entry, (*path, place))
    elif isinstance(value, dict):
        # A single entry may stand without the list.
        if shape.item and (not shape.unloaded or shape.fields.keys().isdisjoint(value)):
            yield from _walk(shape.item, value, path)
        for key, entry in value.items():
            if shape.key and shape.key.references:
                yield shape.key, Occurrence((*path, key), key, is_key=True)
            if shape.value:
                yield from _walk(shape.value, entry, (*path, key))
            elif key in shape.fields:
                yield from _walk(shape.fields[key], entry, (*path, key))


def references(model: type[BaseModel], data: Any, to: Reference) -> Iterator[Occurrence]:
    """Yield the references of a kind in the plain data of a scene, or of a section of one.

    Parameters
    ----------
    model
        The model of the data, which need not be valid.
    data
        The data.
    to
        The kind of reference, such as `DOF`.
    """
    for shape, found in _walk(_shape(model), data, ()):
        if to in shape.references and not isinstance(found.value, dict | list):
            yield found


def sections(model: type[BaseModel], data: Any, of: type[BaseModel]) -> Iterator[tuple[Path, dict[Any, Any]]]:
    """Yield the mappings in the plain data of a scene that a model, or one derived from it, describes."""
    for shape, found in _walk(_shape(model), data, ()):
        if isinstance(found.value, dict) and any(issubclass(one, of) for one in shape.models):
            yield found.path, found.value


def dof_faults(source: Source, model: type[BaseModel], names: DofNames, at: Path = ()) -> list[Fault]:
    """Return the faults of DOFs that a scene names and its structure lacks.

    Parameters
    ----------
    source
        The scene.
    model
        The model of the part that names them.
    names
        The names of the structure's DOFs. Where their labels are texts, a number counts them from 1.
    at
        The place of that part; absent: the scene.
    """
    part = source.data
    for key in at:
        part = part[key]
    labels = names.labels
    there = f"; the structure has {len(labels)}"
    if labels[0] != 1:
        there += f" ({labels[0]} … {labels[-1]})"
    faults = []
    for signed, (path, dof, is_key) in [
        *((False, found) for found in references(model, part, DOF)),
        *((True, found) for found in references(model, part, SIGNED_DOF)),
    ]:
        if isinstance(dof, bool) or not isinstance(dof, int | str) or dof == "":
            continue
        if path[0] == "structures":  # within a part, whose own DOFs have the names that it gives them
            continue
        if (isinstance(dof, int) and dof < 1) or names.has(dof, signed=signed):
            continue
        message = names.misnamed(dof, signed=signed)
        if message is None and isinstance(dof, str):
            texts = (label for label in labels if isinstance(label, str))
            message = f"there is no DOF '{dof}'{did_you_mean(dof, texts) or there}"
        message = message or f"there is no DOF {dof}{there}"
        faults.append(source.fault((*at, *path), message, key=is_key))
    return faults


def node_faults(model: type[BaseModel], data: Any, count: int) -> Iterator[tuple[Path, str]]:
    """Yield the references to nodes that a beam or frame lacks, each with a message."""
    for path, node, _ in references(model, data, NODE):
        if isinstance(node, int) and node > count:
            yield path, f"there is no node {node}; there are {count}"


#: A degree of freedom: its direction and its node.
Freedom = tuple[str, int]


def beam_labels(elements: int, fixed: Iterable[Freedom]) -> list[int | str]:
    """Return the labels of the free degrees of freedom of a beam.

    Parameters
    ----------
    elements
        The number of its elements, in a row.
    fixed
        The degrees of freedom that its supports fix.
    """
    return _free(elements + 1, ("w", "theta"), set(fixed))


def frame_labels(
    nodes: int,
    members: Iterable[tuple[Sequence[int], Sequence[int], int]],
    fixed: Iterable[Freedom],
    turning: Iterable[int],
) -> list[int | str]:
    """Return the labels of the free degrees of freedom of a frame, those at nodes within members last.

    Parameters
    ----------
    nodes
        The number of given nodes.
    members
        Of each: its two nodes, which ends are hinged (1, 2), and its number of elements.
    fixed
        The degrees of freedom that the supports fix.
    turning
        The nodes with a rotary inertia or a rotational spring, which rotate even between hinges.
    """
    carried, inner = set(turning), 0
    for ends, hinges, elements in members:
        carried |= {node for end, node in enumerate(ends, 1) if end not in hinges}
        inner += elements - 1
    held = set(fixed) | {("theta", node) for node in range(1, nodes + 1) if node not in carried}
    return _free(nodes + inner, ("u", "w", "theta"), held)


def _free(nodes: int, directions: Sequence[str], fixed: Set[Freedom]) -> list[int | str]:
    return [f"{d}_{node}" for node in range(1, nodes + 1) for d in directions if (d, node) not in fixed]
