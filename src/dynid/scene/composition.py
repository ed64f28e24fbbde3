"""Sub-models of bond graphs: instances of models, flattened into one graph before a scene is checked.

Everything behind sees a flat graph: the node `rotor` of the instance `m1` is `m1.rotor`, the parameter `R`
of its model is the parameter `m1.R`, and the third copy in a chain is `line.3`. Faults in a model are
reported where the model is written, in its own file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

from dynid.arithmetic.expression import renamed
from dynid.errors import Fault, SceneError
from dynid.scene.models import Model, copy_values, is_instance, model_faults, with_models
from dynid.scene.schema.raw import (
    chain_ends,
    chain_fault,
    law_variable,
    listing,
    mapping,
    mapping_of,
    written_key,
)
from dynid.scene.yaml.parser import MAX_FAULTS, Positions
from dynid.scene.yaml.parser import Path as KeyPath
from dynid.scene.yaml.source import Source

# Keys of a node, at any depth, whose texts are names and not expressions.
_NAMING = frozenset({"type", "domain", "path", "name", "dof", "dofs", "fix", "direction", "ports"}) | {
    *("labels", "method", "masters", "unit", "scale")
}


def composed(source: Source) -> Source:
    """Return a scene with every instance of a model replaced by the nodes and bonds of the model.

    A scene without models is returned as it is; another remembers what it was made from (`Source.written`).
    Raises `SceneError` with the faults of models, instances and their ports. Raises `FileError` if a file of
    models cannot be read.
    """
    data = source.data
    if not isinstance(data, dict):
        return source
    instances = any(map(is_instance, mapping(mapping(data, "graph"), "nodes").values()))
    if not instances and {"models", "use"}.isdisjoint(data):
        return source
    return _Flattening(with_models(source)).result()


class _Flattening:
    """The flat graph of a scene, instance by instance."""

    def __init__(self, source: Source) -> None:
        self.source = source
        models = mapping(source.data, "models")
        self.models = {str(name): Model(str(name), mapping_of(data)) for name, data in models.items()}
        self.faults: list[Fault] = []
        self.nodes: dict[str, Any] = {}
        self.parameters: dict[str, Any] = {}
        self.bonds: list[tuple[str, str, Positions]] = []
        self.marks: dict[KeyPath, Positions] = {}
        # Of every port of an instance: the instance's place, and the bonds that end there from outside.
        self.ports: dict[str, tuple[Positions, list[Positions]]] = {}
        self.open: set[str] = set()  # ports that are no nodes
        self.aliases: dict[str, str] = {}  # the ports of a chain: of its first and its last copy
        self._below: dict[KeyPath, dict[Any, list[tuple[KeyPath, Positions]]]] = {}

    def result(self) -> Source:
        """Return the flat scene."""
        data = {key: value for key, value in self.source.data.items() if key != "models"}
        if not mapping(data, "graph"):
            message = "models are for a 'graph'; there is none"
            raise SceneError([self.source.fault(("models",), message, key=True)])
        replaced = (("graph", "nodes"), ("graph", "bonds"))
        for path, mark in self.source.marks.items():
            if path[:1] not in (("models",), ("use",)) and (path[:2] not in replaced or len(path) == 2):
                self.marks[path] = mark
        self.faults += model_faults(self.source, self.models)
        self._raise()
        self._add_graph("", mapping(data, "graph"), ("graph",), {})
        self._raise()
        for port, (mark, ends) in self.ports.items():
            holder, _, name = port.rpartition(".")
            if not ends:
                message = f"port '{name}' of '{holder}' has no bond; connect it"
                self._note(Fault(mark.file, *mark.key, message))
            elif len(ends) > 1:
                message = f"port '{name}' of '{holder}' has {len(ends)} bonds; put a junction between"
                for end in ends[1:]:
                    self._note(Fault(end.file, *end.value, message))
        self._raise()
        bonds = self._connected()
        self._raise()
        for number, (_, _, mark_of_bond) in enumerate(bonds):
            self.marks["graph", "bonds", number] = mark_of_bond
        texts = [f"{tail} -> {head}" for tail, head, _ in bonds]
        data["graph"] = {**mapping(data, "graph"), "nodes": self.nodes, "bonds": texts}
        if self.parameters:
            data["parameters"] = {**mapping(data, "parameters"), **self.parameters}
        return replace(self.source, data=data, marks=self.marks, written=self.source)

    def _note(self, fault: Fault) -> None:
        self.faults.append(fault)
        if len(self.faults) >= MAX_FAULTS:  # each copy of a model repeats its faults
            self._raise()

    def _raise(self) -> None:
        if self.faults:
            raise SceneError(dict.fromkeys(self.faults))

    # Instances

    def _add_graph(
        self, prefix: str, graph: Mapping[Any, Any], path: KeyPath, names: Mapping[str, str]
    ) -> None:
        """Add nodes and bonds under a prefix; `names` are the flat names of parameters by those within."""
        nodes = mapping(graph, "nodes")
        marks = self._marks((*path, "nodes"))
        for name, node in nodes.items():
            flat, node_path = f"{prefix}{name}", (*path, "nodes", name)
            if is_instance(node):
                self._instantiate(flat, node, node_path, names)
                continue
            self.nodes[flat] = (
                _inner(node, names, prefix, nodes) if prefix and isinstance(node, dict) else node
            )
            for below, mark in marks.get(name, ()):
                self.marks["graph", "nodes", flat, *below] = mark
        for number, text in enumerate(listing(graph, "bonds")):
            self._bond(prefix, text, (*path, "bonds", number), nodes)

    def _marks(self, path: KeyPath) -> dict[Any, list[tuple[KeyPath, Positions]]]:
        """Return the marks below every key of a mapping, with their paths from there."""
        length = len(path)
        if path not in self._below:
            self._below[path] = {}
            for marked, mark in self.source.marks.items():
                if len(marked) > length and marked[:length] == path:
                    self._below[path].setdefault(marked[length], []).append((marked[length + 1 :], mark))
        return self._below[path]

    def _bond(self, prefix: str, text: Any, path: KeyPath, nodes: Mapping[Any, Any]) -> None:
        mark = self._mark(path)
        if problem := chain_fault(text):
            self._note(self.source.fault(path, problem))
            return
        ends = chain_ends(text)
        flat = []
        for end in ends:
            name = self.aliases.get(f"{prefix}{end}", f"{prefix}{end}")
            holder = end.partition(".")[0]
            node = nodes.get(holder, nodes.get(int(holder)) if holder.isdecimal() else None)
            if is_instance(node) and name not in self.ports:
                model = self.models[str(node["model"])]
                copies = [holder] if node.get("repeat") is None else [f"{holder}.1", f"{holder}.2"]
                copies = copies[: node.get("repeat") or 1]
                ports = [f"{copy}.{port}" for copy in copies for port in model.ports]
                ports += ["…"] if (node.get("repeat") or 1) > 2 else []
                what = f"'{end}' is no port" if "." in end else f"'{end}' is an instance of {node['model']}"
                message = f"bond '{text}': {what}; bonds attach at {', '.join(ports) or 'ports'}"
                self._note(self.source.fault(path, message))
            flat.append(name)
        for tail, head in pairwise(flat):
            self._connect(tail, head, mark)

    def _mark(self, path: KeyPath) -> Positions:
        return self.source.marks.get(path, Positions((1, 1), (1, 1), self.source.file))

    def _connect(self, tail: str, head: str, mark: Positions) -> None:
        for end in (tail, head):
            if end in self.ports:
                self.ports[end][1].append(mark)
        self.bonds.append((tail, head, mark))

    def _instantiate(
        self, flat: str, node: Mapping[Any, Any], path: KeyPath, names: Mapping[str, str]
    ) -> None:
        model = self.models[str(node["model"])]
        count = node.get("repeat")
        copies = [flat] if count is None else [f"{flat}.{number}" for number in range(1, count + 1)]
        scopes = self._arguments(flat, node, path, names)
        mark, unconnected = self._mark(path), [port for port in model.ports if port not in model.nodes]
        for number, copy in enumerate(copies, 1):
            self._add_graph(f"{copy}.", model.data, model.path, scopes.get(number, scopes[0]))
            self.ports |= {f"{copy}.{port}": (mark, []) for port in model.ports}
            self.open |= {f"{copy}.{port}" for port in unconnected}
        if copies != [flat]:
            right, left = (str(port) for port in listing(node, "chain") or ("", ""))
            backward = bool(right) and (model.outflow(right) < 0 or model.outflow(left) > 0)
            for copy_before, copy_after in pairwise(copies) if right else ():
                ends = (f"{copy_before}.{right}", f"{copy_after}.{left}")
                self._connect(*(ends[::-1] if backward else ends), mark)
            if right:
                self.aliases |= {f"{flat}.{left}": f"{copies[0]}.{left}"}
                self.aliases |= {f"{flat}.{right}": f"{copies[-1]}.{right}"}

    def _arguments(
        self, flat: str, node: Mapping[Any, Any], path: KeyPath, names: Mapping[str, str]
    ) -> dict[int, dict[str, str]]:
        """Add the parameters of an instance; return their flat names by copy (0: shared) and name."""
        model = self.models[str(node["model"])]
        usual, copies = model.parameters, copy_values(node)
        changed = {number: _changed(values, usual, node) for number, values in copies.items()}
        shared = {name: f"{flat}.{name}" for name in usual}
        if changed and len(changed) == node.get("repeat"):
            unshared = set.intersection(*changed.values())
        else:
            unshared = set()
        scopes = {0: shared}
        for number, changes in {0: shared.keys() - unshared, **changed}.items():
            scopes[number] = scope = shared | {name: f"{flat}.{number}.{name}" for name in changes if number}
            for name in (name for name in usual if name in changes):
                if name in copies.get(number, {}):
                    key = written_key(node["copies"], str(number))
                    value_path, around = (*path, "copies", key, name), names
                elif name in node:
                    value_path, around = (*path, name), names
                else:
                    value_path, around = (*model.path, "parameters", name), scope
                value = copies.get(number, {}).get(name, node.get(name, usual[name]))
                self._add_parameter(scope[name], _scoped(value, around), value_path)
        return scopes

    def _add_parameter(self, flat: str, value: Any, path: KeyPath) -> None:
        if flat in mapping(self.source.data, "parameters"):
            holder = flat.rpartition(".")[0]
            message = f"'{flat}' is a parameter of the instance '{holder}'; use another name"
            self._note(self.source.fault(("parameters", flat), message, key=True))
        self.parameters[flat] = value
        for below, mark in self._marks(path[:-1]).get(path[-1], ()):
            self.marks["parameters", flat, *below] = mark

    # Ports

    def _connected(self) -> list[tuple[str, str, Positions]]:
        """Return the bonds, those that meet at an open port as one."""
        at: dict[str, list[int]] = {}
        for number, (tail, head, _) in enumerate(self.bonds):
            for end in (tail, head):
                if end in self.open:
                    at.setdefault(end, []).append(number)
        bonds: dict[int, tuple[str, str, Positions]] = dict(enumerate(self.bonds))
        for port, numbers in at.items():
            first, second = (bonds[number] for number in numbers)
            if first[1] != port:
                first, second = second, first
                numbers.reverse()
            if first[1] != port or second[0] != port:
                mark = max(first, second, key=lambda bond: bond[2].file == self.source.file)[2]
                message = f"the arrows at port '{port}' contradict each other; turn that of one bond"
                self._note(Fault(mark.file, *mark.value, message))
                continue
            kept, dropped = sorted(numbers)
            bonds[kept] = (first[0], second[1], bonds[max(numbers)][2])
            del bonds[dropped]
            for end in (first[0], second[1]):  # of which one may be another open port
                if end in at:
                    at[end] = [kept if number == dropped else number for number in at[end]]
        return [bonds[number] for number in sorted(bonds)]


def _changed(values: Mapping[str, Any], usual: Mapping[str, Any], node: Mapping[Any, Any]) -> set[str]:
    """Return the parameters of a copy that its values change: these, and usual values that depend on them."""
    changed = set(values)
    while True:
        names = {name: f"{name}'" for name in changed}
        candidates = usual.keys() - changed - node.keys()
        others = {name for name in candidates if _scoped(usual[name], names) != usual[name]}
        if not others:
            return changed
        changed |= others


class _Scope(dict[str, str]):
    """Flat names in an expression of a node: of parameters, and of the variables of nodes, which win."""

    def __init__(self, names: Mapping[str, str], prefix: str, nodes: Mapping[Any, Any]) -> None:
        super().__init__(names)
        self._prefix, self._nodes = prefix, {str(name) for name in nodes}

    def get(self, name: str, default: Any = None) -> Any:
        """Return the flat name."""
        holder, _, quantity = name.rpartition(".")
        if quantity in ("e", "f", "q", "p") and holder.partition(".")[0] in self._nodes:
            return f"{self._prefix}{name}"
        return super().get(name, default)


def _inner(node: Mapping[Any, Any], names: Mapping[str, str], prefix: str, nodes: Mapping[Any, Any]) -> Any:
    """Return a node of a model with flat names in its expressions; the own variable of a law stays."""
    scope = _Scope(names, prefix, nodes)
    flat = _scoped({key: value for key, value in node.items() if key != "law"}, scope)
    if "law" in node:
        law = node["law"]
        for key in law if isinstance(law, dict) else ():
            variable = law_variable(str(node.get("type")), str(key))
            inside = _Scope({name: flat for name, flat in names.items() if name != variable}, prefix, nodes)
            law = {**law, key: _scoped(law[key], inside)}
        flat["law"] = law
    return flat


def _scoped(value: Any, names: Mapping[str, str]) -> Any:
    """Return data with the parameters in expressions under their flat names."""
    if isinstance(value, str):
        return renamed(value, names)
    if isinstance(value, list):
        return [_scoped(entry, names) for entry in value]
    if isinstance(value, dict):
        return {key: entry if key in _NAMING else _scoped(entry, names) for key, entry in value.items()}
    return value
