"""Validation errors of pydantic as located faults in plain words."""

from __future__ import annotations

import types
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from dynid.errors import Fault
from dynid.scene.schema.quantities import AROUND, AT_KEY, Located
from dynid.scene.schema.raw import value_with_unit
from dynid.scene.schema.references import Later
from dynid.scene.yaml.source import Source, path_of
from dynid.suggestions import did_you_mean, nearest_values, shortened, without_decimal_comma

# Models with more keys than these have them in the manual, not in the message.
_FEW_KEYS = 8
_WANTED = {
    "string_type": "a text",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "int_parsing": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "list_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
}
_BOUNDS = {"greater_than_equal": "at least {ge:g}", "less_than_equal": "at most {le:,.12g}"}
#: Tags that distinguish the members of a union that are not models.
_FORMS = ("one", "list", "mapping", "text", "whole", "components")
_AS_PATH = "; write the whole path of a value, such as parameters.NAME or graph.nodes.NAME.value"
_ENDS = {"too_short": "least", "too_long": "most"}


def located_faults(source: Source, model: type[BaseModel], error: ValidationError) -> list[Fault]:
    """Return the errors of a validation as faults of the scene, each at its line and column."""
    errors: list[dict[str, Any]] = [dict(item) for item in error.errors(include_url=False)]
    unknown: dict[tuple[Any, ...], list[str]] = defaultdict(list)  # of each mapping
    for item in errors:
        if item["type"] == "extra_forbidden":
            unknown[tuple(item["loc"][:-1])].append(str(item["loc"][-1]))
    places: dict[tuple[Any, ...], list[dict[str, Any]]] = defaultdict(list)
    for item in errors:
        *holder, key = item["loc"] or ("",)
        # A missing key that is there under a similar name is reported as unknown already.
        similar = (name for name in unknown.get(tuple(holder), ()) if did_you_mean(name, [key]))
        if item["type"] != "missing" or not any(similar):
            places[_data_path(source.data, item["loc"])].append(item)
    faults = []
    for items in places.values():
        # The errors of the members of a union become one: the value must be one type or another.
        types = dict.fromkeys(_WANTED[item["type"]] for item in items if item["type"] in _WANTED)
        others = [item for item in items if item["type"] not in _WANTED]
        merged = others or [{**items[0], "wanted": " or ".join(types)}]
        faults += [_fault(source, model, item) for item in merged]
    return faults


def without_unknown_keys(data: Any, error: ValidationError) -> Any:
    """Return the data of a scene without unknown keys, so that its other faults are found as well."""
    strange = (item["loc"] for item in error.errors() if item["type"] == "extra_forbidden")
    unknown = {_unknown_key(data, loc) for loc in strange}

    def kept(section: Any, path: tuple[Any, ...]) -> Any:
        if isinstance(section, dict):
            entries = ((key, (*path, key), value) for key, value in section.items())
            return {key: kept(value, below) for key, below, value in entries if below not in unknown}
        if isinstance(section, list):
            return [kept(value, (*path, index)) for index, value in enumerate(section)]
        return section

    return kept(data, ())


def located(source: Source, faults: Iterable[Located]) -> list[Fault]:
    """Return faults by their paths in a scene, each at its line and column."""
    located_paths = ((_data_path(source.data, path), path, message) for path, message in faults)
    return [source.fault(at, message, key=path[-1:] == (AT_KEY,)) for at, path, message in located_paths]


def _fault(source: Source, model: type[BaseModel], error: dict[str, Any]) -> Fault:
    loc, kind = tuple(error["loc"]), error["type"]
    strange = kind in ("extra_forbidden", "invalid_key")
    path = _unknown_key(source.data, loc) if strange else _data_path(source.data, loc)
    if strange:
        name = _dotted(path[:-1]) or "a scene"
        holder = _model_at(model, loc[:-1])
        fields = holder.model_fields if holder else {}
        keys = [field.alias or key for key, field in fields.items()]
        hint = _misplaced(model, path) or did_you_mean(str(loc[-1]), keys) or _elsewhere(source, path)
        hint = hint or _one_level_below(holder, str(loc[-1]))
        if not hint and 0 < len(keys) <= _FEW_KEYS:
            hint = f"; its keys are {', '.join(keys)}"
        message = f"'{loc[-1]}' is not a key of {name}{hint}"
        return source.fault(path, message, key=True)
    if kind == "missing":
        example = ": write dynid: 1" if (*path, loc[-1]) == ("dynid",) else ""
        named = path[:-1] in (("graph", "nodes"), ("joints",))
        hint = _elsewhere(source, path) if named else ""
        message = f"{_dotted(path) or 'a scene'} needs the key '{loc[-1]}'{example}{hint}"
        return source.fault((*path, loc[-1]), message, key=True)
    if kind == "union_tag_not_found":
        tag = _tag(error)
        for key in (present for present in error["input"] if did_you_mean(str(present), [tag])):
            message = f"'{key}' is not a key of {_dotted(path)}; did you mean '{tag}'?"
            return source.fault((*path, key), message, key=True)
        return source.fault((*path, tag), f"{_dotted(path)} needs the key '{tag}'", key=True)
    number = kind in ("expression", "float_type", "float_parsing", "int_type", "int_parsing")
    message = (value_with_unit(source, path) if number else "") or _message(kind, error, path)
    tag_path = (*path, _tag(error)) if kind == "union_tag_invalid" else path
    return source.fault(tag_path, message, key=loc[-1:] == (AT_KEY,))


def _elsewhere(source: Source, path: Sequence[Any]) -> str:
    """Return the whole path that `--set` or a study may mean by a wrong one; '' for keys of the file."""
    origin = source.fault(path, "").file
    dotted = origin.removeprefix("--set ")
    if origin == source.file:
        return ""
    value: Any = (source.written or source).data
    nearest = nearest_values(dotted, value)
    for key in path_of(source, dotted):
        value = value[key]
    shown = "…" if isinstance(value, dict | list) else value
    written = [f"--set {path}={shown}" if dotted != origin else f"'{path}'" for path in nearest]
    return f"; did you mean {shortened(written, 3, ' or ')}?" if nearest else _AS_PATH


def _misplaced(model: type[BaseModel], path: Sequence[Any]) -> str:
    """Return the place of a key that belongs into the analysis, or from there to the top level of a scene."""
    if len(path) == 2 and path[0] == "analysis" and path[1] in model.model_fields:
        return "; write it at the top level of the scene, outside 'analysis'"
    if len(path) != 1:
        return ""
    if path[0] == "modes" and "reduction" in get_args(model.model_fields["kind"].annotation):
        return (
            "; a scene of kind 'identification' lists modes, by analysis: {modes: {count: 10}}: "
            "dynid new structure"
        )
    field = model.model_fields.get("analysis")
    options = _unwrapped(field.annotation) if field else ()
    if not any(_is_model(option) and path[0] in option.model_fields for option in options):
        return ""
    example = ": analysis: {modes: {count: 10}}" if path[0] == "modes" else ""
    return f"; write it under 'analysis'{example}"


def _one_level_below(holder: type[BaseModel] | None, key: str) -> str:
    """Return the sections of a section that have a key; '' if none has."""
    holding = [
        f"'{field.alias or name}'"
        for name, field in (holder.model_fields if holder else {}).items()
        if any(_is_model(option) and key in option.model_fields for option in _unwrapped(field.annotation))
    ]
    return f"; write it under {' or '.join(holding)}" if holding else ""


def _message(kind: str, error: dict[str, Any], path: Sequence[Any]) -> str:
    value: Any = error.get("input")
    context: dict[str, Any] = error.get("ctx", {})
    if kind in ("dynid", "expression"):
        return str(error["msg"])
    key = f"'{path[-1]}'" if path and isinstance(path[-1], str) else "this entry"
    if kind in ("literal_error", "union_tag_invalid"):
        expected = str(context.get("expected") or context.get("expected_tags"))
        options = [option.strip(" '\"") for option in expected.replace(" or ", ", ").split(",")]
        if kind == "union_tag_invalid":
            key, value = f"'{_tag(error)}'", value[_tag(error)]
        choice = f"is one of {', '.join(options)}" if len(options) > 1 else f"can only be {options[0]}"
        return f"{key} cannot be {_shown(value)}; it {choice}{did_you_mean(str(value), options)}"
    if kind in _WANTED:
        hint = without_decimal_comma(value) if isinstance(value, str) and "number" in error["wanted"] else ""
        return f"{key} must be {error['wanted']}, not {_shown(value)}{f'; {hint}' if hint else ''}"
    if kind in _BOUNDS:
        return f"{key} must be {_BOUNDS[kind].format(**context)}, not {_shown(value)}"
    if kind == "too_short" and context.get("min_length") == 1:
        return f"{key} is empty"
    if kind in ("too_short", "too_long"):
        bound = context.get("min_length") or context.get("max_length")
        count = context["actual_length"]
        count = len(value) if count is None and isinstance(value, list | dict) else count
        return f"{key} has {count} entries; it takes at {_ENDS[kind]} {bound}"
    message = str(error["msg"])
    return f"{key} is {_shown(value)}: {message[:1].lower()}{message[1:]}"


def _tag(error: dict[str, Any]) -> str:
    return str(error["ctx"]["discriminator"]).strip("'()")  # a key, or a function of its name


def _shown(value: Any) -> str:
    kinds: dict[type, str] = {dict: "a mapping", list: "a list", type(None): "nothing"}
    kinds[bool] = str(value).lower()
    text = next((word for kind, word in kinds.items() if isinstance(value, kind)), repr(value))
    return text if len(text) < 60 else f"{text[:57]}…"


def _data_path(data: Any, loc: Iterable[Any]) -> tuple[Any, ...]:
    """Return the part of the location of an error that exists in the data (it names union members too)."""
    path: list[Any] = []
    holders = [data]
    for step in loc:
        holder, key = holders[-1], step
        if step == AROUND:
            path.pop()
            holders.pop()
            continue
        if isinstance(holder, dict):
            if step not in holder and isinstance(step, str) and step.isdecimal():
                key = int(step)
            exists = key in holder
        else:
            exists = isinstance(holder, list) and isinstance(step, int) and step < len(holder)
        if exists:
            path.append(key)
            holders.append(holder[key])
    return tuple(path)


def _unknown_key(data: Any, loc: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the path of an unknown key; a union member in its location may have the name of another key."""
    without = (loc[:index] + loc[index + 1 :] for index in range(len(loc) - 1))
    paths = [_data_path(data, some) for some in (loc, *without)]
    return next((path for path in paths if path[-1:] == loc[-1:]), paths[0])


def _dotted(path: Iterable[Any]) -> str:
    return ".".join(str(key) for key in path)


def _model_at(model: Any, loc: Sequence[Any]) -> type[BaseModel] | None:
    """Return the model at the location of an error, whose key it names."""
    current: Any = model
    for step in loc:
        options = list(_unwrapped(current))
        models = [option for option in options if _is_model(option)]
        chosen = None  # the member of a discriminated union whose tag is in the location
        for option in models:
            fields = (option.model_fields.get(key) for key in ("kind", "method", "distribution"))
            tags = (get_args(field.annotation) for field in fields if field is not None)
            if chosen is None and any(step in tag for tag in tags):
                chosen = option
        if len(models) == 1 and step in models[0].model_fields:
            field = models[0].model_fields[step]
            later = next(
                (
                    annotation.model()
                    for annotation in field.metadata
                    if isinstance(annotation, Later) and annotation.reference
                ),
                None,
            )
            current = later or field.annotation
        elif chosen is not None:
            current = chosen
        elif step in _FORMS:
            continue
        else:  # of a mapping or list, its entries
            current = Union[tuple(get_args(option)[-1] for option in options if get_args(option)) or (None,)]  # noqa: UP007
    return next((option for option in _unwrapped(current) if _is_model(option)), None)


def _unwrapped(annotation: Any) -> Iterable[Any]:
    """Yield the plain types in an annotation: members of unions, without metadata."""
    origin = get_origin(annotation)
    if origin in (Union, types.UnionType):
        for member in get_args(annotation):
            yield from _unwrapped(member)
    elif hasattr(annotation, "__metadata__"):
        later = next((mark for mark in annotation.__metadata__ if isinstance(mark, Later)), None)
        plain = get_args(annotation)[0]
        yield from _unwrapped(plain if later is None else later.model(plain))
    else:
        yield annotation


def _is_model(option: Any) -> bool:
    return isinstance(option, type) and issubclass(option, BaseModel)
