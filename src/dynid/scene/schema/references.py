"""References in scenes to DOFs, nodes and files, found and checked by the types of their fields.

A field that names something is annotated with a `Reference`, such as `DOF`. One walk along the types of a
scene's model finds all references in the plain data of a scene, also where other keys are at fault.
"""

from __future__ import annotations

import types
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, GetCoreSchemaHandler, TypeAdapter, ValidationInfo
from pydantic_core import CoreSchema, core_schema

from dynid.scene.kind import resolve
from dynid.scene.schema.quantities import AT_KEY, Located
from dynid.suggestions import did_you_mean

if TYPE_CHECKING:
    from dynid.structure.labels import DofNames


T = TypeVar("T", bound=BaseModel)

Path = tuple[Any, ...]


@dataclass(frozen=True)
class Later:
    """Annotation of a field whose model is made ready, and its module loaded, at the first value of it."""

    reference: str = ""  #: The model, or the union of models, as ``module:name``; default: the annotated one.

    def model(self, annotated: Any = None) -> Any:
        """Return the model or union, loaded now."""
        return resolve(self.reference) or annotated

    def __get_pydantic_core_schema__(self, source: Any, _: GetCoreSchemaHandler) -> CoreSchema:
        def validated(raw: Any, info: ValidationInfo) -> BaseModel:
            section: BaseModel = _adapter(self.model(source)).validate_python(raw, context=info.context)
            return section

        # The JSON Schema of scenes finds the model there.
        metadata = {"model": lambda: self.model(source)}
        return core_schema.with_info_plain_validator_function(validated, metadata=metadata)


@cache
def _adapter(model: Any) -> TypeAdapter[Any]:
    return TypeAdapter(model)


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


class _Occurrence(NamedTuple):
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
        return frozenset().union(
            *(_shape(mark.model()).models if isinstance(mark, Later) else {mark} for mark in self.unloaded)
        )

    @cached_property
    def fields(self) -> Mapping[str, _Shape]:
        """The shapes of their keys."""
        fields: dict[str, _Shape] = {}
        for model in self.models:
            for name, shape in _fields(model).items():
                fields[name] = fields[name] | shape if name in fields else shape
        return fields


def _joined(first: _Shape | None, second: _Shape | None) -> _Shape | None:
    return first | second if first and second else first or second


def _shape(annotation: Any, metadata: Iterable[Any] = ()) -> _Shape:
    origin, arguments = get_origin(annotation), get_args(annotation)
    metadata = tuple(metadata)
    shape = _Shape(
        frozenset(mark for mark in metadata if isinstance(mark, Reference)),
        frozenset(mark for mark in metadata if isinstance(mark, Later) and mark.reference),
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
    fields = {name: _shape(field.annotation, field.metadata) for name, field in model.model_fields.items()}
    return {name: field_shape for name, field_shape in fields.items() if field_shape}


def _walk(shape: _Shape, value: Any, path: Path) -> Iterator[tuple[_Shape, _Occurrence]]:
    """Yield every value in a section with its shape; one that does not fit its type is not entered."""
    yield shape, _Occurrence(path, value)
    if isinstance(value, BaseModel):
        value = entries(value)
    if isinstance(value, list) and shape.item:
        for index, entry in enumerate(value):
            yield from _walk(shape.item, entry, (*path, index))
    elif isinstance(value, dict):
        # A single entry may stand without the list.
        if shape.item and (not shape.unloaded or shape.fields.keys().isdisjoint(value)):
            yield from _walk(shape.item, value, path)
        for key, entry in value.items():
            if shape.key and shape.key.references:
                yield shape.key, _Occurrence((*path, key), key, is_key=True)
            if shape.value:
                yield from _walk(shape.value, entry, (*path, key))
            elif key in shape.fields:
                yield from _walk(shape.fields[key], entry, (*path, key))


def references(model: type[BaseModel], data: Any, to: Reference) -> Iterator[_Occurrence]:
    """Yield the references of a kind in a section.

    The section is valid, or plain data, which need not be valid.
    """
    for shape, occurrence in _walk(_shape(model), data, ()):
        if to in shape.references and not isinstance(occurrence.value, dict | list | BaseModel):
            yield occurrence


def entries(section: BaseModel) -> dict[Any, Any]:
    """Return the values that a scene gives the keys of a section, by the names of the keys in the scene."""
    fields, names = type(section).model_fields, section.model_fields_set
    values = {fields[name].alias or name: getattr(section, name) for name in names}
    return {name: value for name, value in values.items() if value is not None}


def sections(holder: Any, of: type[T], path: Path = ()) -> Iterator[tuple[Path, T]]:
    """Yield the sections of a type within a valid section, each with its path."""
    if isinstance(holder, of):
        yield path, holder
    if isinstance(holder, BaseModel):
        holder = entries(holder)
    if isinstance(holder, dict | list):
        for key, value in holder.items() if isinstance(holder, dict) else enumerate(holder):
            yield from sections(value, of, (*path, key))


def dof_faults(section: BaseModel, names: DofNames) -> Iterator[Located]:
    """Yield the DOFs that a valid section names and its structure lacks.

    Where the labels of DOFs are texts, a number counts them from 1.
    """
    labels = names.labels
    there = f"; the structure has {len(labels)}"
    if labels[0] != 1:
        there += f" ({labels[0]} … {labels[-1]})"
    for reference in (DOF, SIGNED_DOF):
        signed = reference is SIGNED_DOF
        for path, dof, is_key in references(type(section), section, reference):
            if path[0] == "structures":  # within a part, whose own DOFs have the names that it gives them
                continue
            if names.has(dof, signed=signed):
                continue
            message = names.misnamed(dof, signed=signed)
            if message is None and isinstance(dof, str):
                texts = (label for label in labels if isinstance(label, str))
                message = f"there is no DOF '{dof}'{did_you_mean(dof, texts) or there}"
            yield (*path, AT_KEY) if is_key else path, message or f"there is no DOF {dof}{there}"


def node_faults(section: BaseModel, count: int) -> Iterator[Located]:
    """Yield the nodes that a valid section names and its beam or frame lacks."""
    for path, node, _ in references(type(section), section, NODE):
        if isinstance(node, int) and node > count:
            yield path, f"there is no node {node}; there are {count}"


#: A degree of freedom: its direction and its node.
Freedom = tuple[str, int]


def beam_labels(elements: int, fixed: Iterable[Freedom]) -> list[int | str]:
    """Return the labels of the free degrees of freedom of a beam."""
    return _free(elements + 1, ("w", "theta"), set(fixed))


def frame_labels(
    nodes: int,
    members: Iterable[tuple[Sequence[int], Sequence[int], int]],
    fixed: Iterable[Freedom],
    turning: Iterable[int],
) -> list[int | str]:
    """Return the labels of the free degrees of freedom of a frame, those at nodes within members last.

    Of each member: its two nodes, which ends are hinged (1, 2), and its number of elements. Nodes that are
    `turning` have a rotary inertia or a rotational spring: they rotate even between hinges.
    """
    carried, inner = set(turning), 0
    for ends, hinges, elements in members:
        carried |= {node for end, node in enumerate(ends, 1) if end not in hinges}
        inner += elements - 1
    held = set(fixed) | {("theta", node) for node in range(1, nodes + 1) if node not in carried}
    return _free(nodes + inner, ("u", "w", "theta"), held)


def _free(nodes: int, directions: Sequence[str], fixed: Set[Freedom]) -> list[int | str]:
    return [f"{d}_{node}" for node in range(1, nodes + 1) for d in directions if (d, node) not in fixed]
