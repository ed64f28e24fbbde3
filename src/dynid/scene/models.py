"""Models that a scene uses (its own, of other files by `use:`, of dynid), and their faults before expansion.

All of them are raised before any instance is expanded, so that what an expansion makes is bounded beforehand:
each model is visited once, and the sizes of its instances are added up.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from dynid.arithmetic.expression import name_problem
from dynid.errors import Fault, FileError, SceneError
from dynid.scene.schema.raw import (
    MAX_COPIES,
    chain_ends,
    is_mapping_of_mappings,
    listing,
    mapping,
    mapping_of,
)
from dynid.scene.yaml.parser import Path as KeyPath
from dynid.scene.yaml.source import Source, parse_source, read_source
from dynid.suggestions import did_you_mean

#: The most files that use one another in a row.
_MAX_USE_DEPTH = 50


def library_names() -> list[str]:
    """Return the names of the models that come with dynid."""
    from importlib.resources import files

    entries = (entry.name for entry in files("dynid.library").iterdir())
    return sorted(name.removesuffix(".yaml") for name in entries if name.endswith(".yaml"))


def library_text(name: str) -> str:
    """Return the file of a model that comes with dynid."""
    from importlib.resources import files

    return files("dynid.library").joinpath(f"{name}.yaml").read_text(encoding="utf-8")


def is_instance(node: Any) -> bool:
    """Return True for a node that is an instance of a model."""
    return isinstance(node, dict) and "model" in node


def with_models(source: Source) -> Source:
    """Return a scene with all models that it uses under `models`, each with its place in its own file.

    Raises `SceneError` where two models have one name, or a file holds none or uses itself. Raises
    `FileError` if a file cannot be read.
    """
    faults: list[Fault] = []
    models, marks = dict(mapping(source.data, "models")), dict(source.marks)
    for used in _UsedFiles(faults).sources(source, (os.path.realpath(source.file),)):
        for name, model in mapping(used.data, "models").items():
            if name in models:
                first_file = marks["models", name].file
                message = f"there are two models '{name}'; the other is in {first_file}"
                faults.append(used.fault(("models", name), message, key=True))
            models[name] = model
        marks |= {
            path: mark for path, mark in used.marks.items() if path[:1] == ("models",) and len(path) > 1
        }
    if faults:
        raise SceneError(faults)
    library, graphs = set(library_names()), [mapping(source.data, "graph"), *models.values()]
    while graphs:
        for node in mapping(graphs.pop(), "nodes").values():
            name = node["model"] if is_instance(node) else None
            if isinstance(name, str) and name in library and name not in models:
                text = parse_source(library_text(name), f"{name}.yaml of the library")
                models |= text.data["models"]
                marks |= text.marks
                graphs.append(models[name])
    data = {key: value for key, value in source.data.items() if key != "use"}
    if models:
        data["models"] = models
    # A result holds the text of its scene, which shall not depend on other files.
    return replace(source, data=data, marks=marks, overridden=source.overridden or "use" in source.data)


class _UsedFiles:
    """The files that a scene uses, directly or through others, each read once."""

    def __init__(self, faults: list[Fault]) -> None:
        self.faults = faults
        self._read: set[str] = set()

    def sources(self, source: Source, above: tuple[str, ...]) -> Iterator[Source]:
        """Yield the files that a file uses, and those that these use; `above` are the files around."""
        names = mapping_of(source.data).get("use", [])
        for index, name in enumerate(names if isinstance(names, list) else [names]):
            path = ("use", index) if isinstance(names, list) else ("use",)
            if not isinstance(name, str) or not name or "\0" in name:
                self.faults.append(source.fault(path, "'use' names files of models"))
                continue
            file = os.path.normpath(Path(source.file).parent / name)
            identity = os.path.realpath(file)  # links may give a file any number of names
            if identity in above:
                self.faults.append(source.fault(path, f"'{name}' uses itself"))
            elif len(above) > _MAX_USE_DEPTH:
                message = f"more than {_MAX_USE_DEPTH} files use one another in a row; join some of them"
                self.faults.append(source.fault(path, message))
            elif identity not in self._read:
                self._read.add(identity)
                if used := self._used(source, path, name, file):
                    yield used
                    yield from self.sources(used, (*above, identity))

    def _used(self, source: Source, path: tuple[Any, ...], name: str, file: str) -> Source | None:
        try:
            used = read_source(file)
        except FileError as error:
            if Path(name).stem in library_names():
                message = f"the model '{Path(name).stem}' comes with dynid and needs no 'use': leave this out"
                self.faults.append(source.fault(path, message))
                return None
            message = f"{error.problem}; 'use' is relative to the folder of its file"
            raise FileError(str(source.fault(path, message))) from None
        if not isinstance(used.data, Mapping) or {"models", "use"}.isdisjoint(used.data):
            self.faults.append(source.fault(path, f"'{name}' has no 'models'"))
            return None
        return used


#: Keys of an instance that are no parameters of its model.
_INSTANCE_KEYS = ("model", "repeat", "chain", "copies")
#: Keys of instances and nodes, which no parameter of a model is called.
_RESERVED = (*_INSTANCE_KEYS, "type", "value", "domain", "ports", "law")
#: The most values (texts, numbers, lists, mappings) of all instances together: about 1 GB.
_MAX_VALUES = 4_000_000
#: The most models within one another; each takes two frames of Python's stack of 1,000.
_MAX_NESTING = 50
# A text counts once for so many characters: names of nodes grow with the names of the instances around them.
_CHARACTERS = 64

_COPY_NUMBER = re.compile("[1-9][0-9]{0,5}")
_NODE_NAME = re.compile(r"[\w-]+")
_MODEL_KEYS = ("title", "source", "ports", "parameters", "nodes", "bonds")


class Model(NamedTuple):
    """A model as written: its data, and where they stand."""

    name: str
    data: Mapping[Any, Any]

    @property
    def path(self) -> KeyPath:
        """The path of its mapping in the scene."""
        return ("models", self.name)

    @property
    def parameters(self) -> dict[str, Any]:
        """Its parameters with their usual values; None has to be given."""
        return {str(name): value for name, value in mapping(self.data, "parameters").items()}

    @property
    def ports(self) -> list[str]:
        """Its ports: nodes of it, or ends of its bonds that are no nodes."""
        return [str(port) for port in listing(self.data, "ports")]

    @property
    def nodes(self) -> dict[str, Any]:
        """Its nodes."""
        return {str(name): node for name, node in mapping(self.data, "nodes").items()}

    def outflow(self, port: str) -> int:
        """Return 1 where power is positive out of the model at a port, -1 where into it, 0 where it is free.

        It follows the bond within, at a port that is no node, and at a TF or GY: one bond in, and one out.
        """
        node = self.nodes.get(port)
        kind = node.get("type") if isinstance(node, dict) else node
        if port in self.nodes and kind not in ("TF", "GY"):
            return 0
        for text in listing(self.data, "bonds"):
            ends = chain_ends(text) if isinstance(text, str) else []
            if port in ends:
                return -1 if ends[0] == port else 1
        return 0


def model_faults(source: Source, models: Mapping[str, Model]) -> list[Fault]:
    """Return the faults of models, of their instances, and of what these make together."""
    checks = _Checks(source, models)
    for model in models.values():
        checks.check_model(model)
    checks.check_nodes(mapping(mapping(source.data, "graph"), "nodes"), ("graph",))
    checks.size_of(mapping(source.data, "graph"), ("graph",), ())
    return checks.faults


class _Size(NamedTuple):
    """The size of the nodes and bonds of a model: values, and models within one another."""

    values: int
    depth: int


class _Checks:
    def __init__(self, source: Source, models: Mapping[str, Model]) -> None:
        self.source, self.models = source, models
        self.faults: list[Fault] = []
        self._sizes: dict[str, _Size] = {}

    def _note(self, path: KeyPath, message: str, *, key: bool = True) -> None:
        self.faults.append(self.source.fault(path, message, key=key))

    def check_model(self, model: Model) -> None:
        """Note the faults of a model."""
        for key in model.data:
            if key not in _MODEL_KEYS:
                self._note((*model.path, key), f"unknown key '{key}'{did_you_mean(str(key), _MODEL_KEYS)}")
        if not model.data.get("nodes"):
            self._note(model.path, f"the model '{model.name}' needs the key 'nodes'")
        for name in mapping(model.data, "parameters"):
            problem = f"'{name}' is a key of nodes; use another name" if name in _RESERVED else ""
            if problem := problem or name_problem(str(name)):
                self._note((*model.path, "parameters", name), problem)
        texts = (text for text in listing(model.data, "bonds") if isinstance(text, str))
        ends = Counter(end for text in texts for end in chain_ends(text))
        nodes = model.nodes
        for index, port in enumerate(model.ports):
            path = (*model.path, "ports", index)
            if port in nodes:
                if is_instance(nodes[port]):
                    self._note(path, f"the port '{port}' is an instance; name a port of another name")
            elif ends[port] != 1:
                count = "none" if not ends[port] else str(ends[port])
                said = f"the port '{port}' is no node, so one bond of the model ends there, not {count}"
                self._note(path, said)
        self.check_nodes(mapping(model.data, "nodes"), model.path)

    def check_nodes(self, nodes: Mapping[Any, Any], path: KeyPath) -> None:
        """Note the faults of the nodes of a model, or of the graph, and of the instances among them."""
        for name, node in nodes.items():
            node_path = (*path, "nodes", name)
            if path[0] == "models" and not _NODE_NAME.fullmatch(str(name)):
                self._note(node_path, f"'{name}' cannot name a node; use letters, digits, _ and -")
            elif is_instance(node):
                self._check_instance(str(name), node, node_path)

    def _check_instance(self, name: str, node: Mapping[Any, Any], path: KeyPath) -> None:
        if problem := name_problem(name.rpartition(".")[2]):
            self._note(path, problem)
        model = self.models.get(str(node["model"]))
        if model is None:
            close = did_you_mean(str(node["model"]), [*self.models, *library_names()])
            self._note((*path, "model"), f"no model '{node['model']}'{close}", key=False)
            return
        self._check_names({key: key for key in node if key not in _INSTANCE_KEYS}, model, path)
        copies = copy_values(node)
        for parameter, value in model.parameters.items():
            values = [copy.get(parameter) for copy in copies.values()]
            everywhere = len(copies) == node.get("repeat") and None not in values
            if node.get(parameter, value) is None and not everywhere:
                self._note(path, f"'{name}' needs the parameter '{parameter}' of its model '{model.name}'")
        self._check_copies(node, model, path)
        self._check_copy_values(node, model, (*path, "copies"))

    def _check_names(self, keys: Iterable[Any], model: Model, path: KeyPath) -> None:
        parameters = model.parameters
        for key in keys:
            if str(key) not in parameters:
                close = did_you_mean(str(key), parameters) or f"; it has {', '.join(parameters) or 'none'}"
                self._note((*path, key), f"the model '{model.name}' has no parameter '{key}'{close}")

    def _check_copy_values(self, node: Mapping[Any, Any], model: Model, path: KeyPath) -> None:
        if "copies" not in node:
            return
        count, copies = node.get("repeat"), node["copies"]
        if type(count) is not int or not is_mapping_of_mappings(copies):
            message = "'copies' has values of single copies beside 'repeat': {2: {C: 3}}"
            self._note(path, message)
            return
        for number, values in copies.items():
            if not (_COPY_NUMBER.fullmatch(str(number)) and int(number) <= count):
                self._note((*path, number), f"there is no copy {number}; they count from 1 to {count}")
            self._check_names(values, model, (*path, number))
            for name, value in values.items():
                if value is None:
                    self._note((*path, number, name), f"'{name}' of copy {number} needs a value")

    def _check_copies(self, node: Mapping[Any, Any], model: Model, path: KeyPath) -> None:
        count, chain = node.get("repeat"), node.get("chain")
        if chain is not None and (count is None or not isinstance(chain, list) or len(chain) != 2):
            message = "'chain' is [port, port] beside 'repeat': of each copy, and of the next one"
            self._note((*path, "chain"), message)
            return
        for index, port in enumerate(map(str, chain or ())):
            if port not in model.ports:
                close = did_you_mean(port, model.ports) or f"; it has {', '.join(model.ports)}"
                message = f"the model '{model.name}' has no port '{port}'{close}"
                self._note((*path, "chain", index), message, key=False)
        if chain and count != 1:
            self._check_through(model, [str(port) for port in chain], (*path, "chain"))
        if count is not None and (type(count) is not int or not 1 <= count <= MAX_COPIES):
            message = f"'repeat' is a whole number from 1 to {MAX_COPIES:,}"
            self._note((*path, "repeat"), message, key=False)

    def _check_through(self, model: Model, chain: list[str], path: KeyPath) -> None:
        """Note a chain whose ports both lead into the model, or both out of it."""
        flows = [model.outflow(port) for port in chain if port in model.ports]
        if flows in ([1, 1], [-1, -1]):
            way = "out of" if flows[0] > 0 else "into"
            both = f"both '{chain[0]}' and '{chain[1]}'"
            message = f"power is positive {way} the model '{model.name}' at {both}"
            self._note(path, f"{message}; turn the bond of the model at one of them")

    def size_of(self, graph: Mapping[Any, Any], path: KeyPath, above: tuple[str, ...]) -> _Size:
        """Return what a model or the graph makes; note what is too deep, too large, or contains itself."""
        values, depth = _count(graph.get("bonds")) + _count(graph.get("parameters")), 0
        for name, node in mapping(graph, "nodes").items():
            values += _count(node) + _count(str(name))
            if is_instance(node):
                below = self._size_of_model(str(node["model"]), (*path, "nodes", name), above)
                depth = max(depth, below.depth + 1)
                count = node.get("repeat")
                copies = count if type(count) is int and count > 0 else 1
                values += copies * below.values * _count(str(name))
            if values > _MAX_VALUES:
                message = f"the instances of models make more than {_MAX_VALUES:,} values in this graph"
                self._note_once((*path, "nodes", name), f"{message}; use fewer copies", key=True)
                return _Size(0, depth)
        return _Size(values, depth)

    def _size_of_model(self, name: str, path: KeyPath, above: tuple[str, ...]) -> _Size:
        if name in above:
            cycle = " -> ".join([*above[above.index(name) :], name])
            self._note((*path, "model"), f"the model contains itself: {cycle}", key=False)
            return _Size(0, 0)
        if len(above) >= _MAX_NESTING:
            return self._too_deep(path)
        if (model := self.models.get(name)) is None:
            return _Size(0, 0)
        if name not in self._sizes:
            self._sizes[name] = self.size_of(model.data, model.path, (*above, name))
        elif len(above) + self._sizes[name].depth >= _MAX_NESTING:
            return self._too_deep(path)
        return self._sizes[name]

    def _too_deep(self, path: KeyPath) -> _Size:
        message = f"models stand more than {_MAX_NESTING} deep in one another; join some of them"
        self._note_once((*path, "model"), message, key=False)
        return _Size(0, 0)

    def _note_once(self, path: KeyPath, message: str, *, key: bool) -> None:
        """Note a fault in the innermost model that has it, not again in those around."""
        if all(fault.message != message for fault in self.faults):
            self._note(path, message, key=key)


def copy_values(node: Mapping[Any, Any]) -> dict[int, dict[str, Any]]:
    """Return the values of single copies of an instance by their numbers, as far as they can be read."""
    return {
        int(number): {str(name): value for name, value in values.items()}
        for number, values in mapping(node, "copies").items()
        if _COPY_NUMBER.fullmatch(str(number)) and isinstance(values, dict)
    }


def _count(value: Any) -> int:
    """Return the number of values in data as written, those that aliases share once for each alias."""
    if isinstance(value, dict):
        return 1 + sum(_count(str(key)) + _count(entry) for key, entry in value.items())
    if isinstance(value, list):
        return 1 + sum(map(_count, value))
    return 1 + len(value) // _CHARACTERS if isinstance(value, str) else 1
