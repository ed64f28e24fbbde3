"""Sub-models of bond graphs: instances of models, flattened into one graph before a scene is checked.

Everything behind sees a flat graph: the node `rotor` of the instance `m1` is `m1.rotor`, the parameter `R`
of its model is the parameter `m1.R`, and the third copy in a chain is `line.3`. Faults in a model are
reported where the model is written, in its own file.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

from dynid.arithmetic.expression import name_problem, renamed
from dynid.errors import Fault, SceneError
from dynid.scene.model_files import is_instance, library_names, with_models
from dynid.scene.schema.raw import chain_ends, chain_fault, listing, mapping, mapping_of, own_variable
from dynid.scene.yaml.parser import Path as KeyPath
from dynid.scene.yaml.parser import Positions
from dynid.scene.yaml.source import Source
from dynid.suggestions import did_you_mean

#: Keys of instances and nodes, which no parameter of a model is called.
RESERVED = ("type", "value", "model", "domain", "ports", "repeat", "chain", "law")
#: The most copies of an instance, and nodes of a flattened graph.
MOST_COPIES, MOST_NODES = 100_000, 1_000_000

_MODEL_KEYS = ("title", "source", "ports", "parameters", "nodes", "bonds")
# Keys of a node, at any depth, whose texts are names and not expressions.
_NAMING = frozenset({"type", "domain", "path", "name", "dof", "dofs", "fix", "direction", "ports"}) | {
    *("labels", "method", "masters", "unit", "scale")
}


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


class _End(NamedTuple):
    """An end of a bond at a port of an instance: where it is written, and the text of the bond."""

    place: Positions
    text: str


def composed(source: Source) -> Source:
    """Return a scene with every instance of a model replaced by the nodes and bonds of the model.

    A scene without models is returned as it is; another remembers what it was made from (`Source.written`).

    Raises
    ------
    SceneError
        With the faults of models, instances and their ports.
    FileError
        If a file of models cannot be read.
    """
    data = source.data
    if not isinstance(data, dict):
        return source
    instances = any(map(is_instance, mapping(mapping(data, "graph"), "nodes").values()))
    if not instances and {"models", "use"}.isdisjoint(data):
        return source
    return _Flattening(with_models(source)).result()


@dataclass(eq=False)
class _Flattening:
    """The flat graph of a scene, instance by instance."""

    source: Source

    def __post_init__(self) -> None:
        self.faults: list[Fault] = []
        self.nodes: dict[str, Any] = {}
        self.parameters: dict[str, Any] = {}
        self.bonds: list[tuple[str, str, Positions]] = []
        self.marks: dict[KeyPath, Positions] = {}
        # Of every port of an instance: the instance's place, and the bonds that end there from outside.
        self.ports: dict[str, tuple[Positions, list[_End]]] = {}
        self.open: set[str] = set()  # ports that are no nodes
        self.refused: set[str] = set()  # instances with faults
        self.aliases: dict[str, str] = {}  # the ports of a chain: of its first and its last copy
        self._below: dict[KeyPath, dict[Any, list[tuple[KeyPath, Positions]]]] = {}

    @cached_property
    def models(self) -> dict[str, Model]:
        """The models, by name."""
        given = mapping(self.source.data, "models")
        return {str(name): Model(str(name), mapping_of(data)) for name, data in given.items()}

    def result(self) -> Source:
        """Return the flat scene."""
        data = {key: value for key, value in self.source.data.items() if key != "models"}
        if not mapping(data, "graph"):
            message = "models are for a 'graph'; there is none"
            raise SceneError([self.source.fault(("models",), message, key=True)])
        kept = {
            path: mark
            for path, mark in self.source.marks.items()
            if not (
                path[:1] in (("models",), ("use",))
                or (path[:1] == ("graph",) and path[1:2] in (("nodes",), ("bonds",)) and len(path) > 2)
            )
        }
        self.marks |= kept
        for model in self.models.values():
            self._check_model(model)
        self._place("", mapping(data, "graph"), ("graph",), {}, ())
        self._raise()
        for port, (mark, ends) in self.ports.items():
            holder, _, name = port.rpartition(".")
            if not ends:
                message = f"port '{name}' of '{holder}' has no bond; connect it"
                self.faults.append(Fault(mark.file, *mark.key, message))
            elif len(ends) > 1:
                message = f"port '{name}' of '{holder}' has {len(ends)} bonds; put a junction between"
                self.faults += [Fault(end.place.file, *end.place.value, message) for end in ends[1:]]
        self._raise()
        bonds = self._connected()
        self._raise()
        for number, (_, _, place) in enumerate(bonds):
            self.marks["graph", "bonds", number] = place
        texts = [f"{tail} -> {head}" for tail, head, _ in bonds]
        data["graph"] = {**mapping(data, "graph"), "nodes": self.nodes, "bonds": texts}
        if self.parameters:
            data["parameters"] = {**mapping(data, "parameters"), **self.parameters}
        return replace(self.source, data=data, marks=self.marks, written=self.source)

    def _raise(self) -> None:
        if self.faults:
            raise SceneError(dict.fromkeys(self.faults))

    # Models

    def _check_model(self, model: Model) -> None:
        """Note the faults of a model that need no instance."""

        def note(path: KeyPath, message: str) -> None:
            self.faults.append(self.source.fault((*model.path, *path), message, key=True))

        for key in model.data:
            if key not in _MODEL_KEYS:
                note((key,), f"unknown key '{key}'{did_you_mean(str(key), _MODEL_KEYS)}")
        if not model.data.get("nodes"):
            note((), f"the model '{model.name}' needs the key 'nodes'")
        for name in mapping(model.data, "parameters"):
            problem = f"'{name}' is a key of nodes; use another name" if name in RESERVED else ""
            if problem := problem or name_problem(str(name)):
                note(("parameters", name), problem)
        ends = Counter(
            end for text in listing(model.data, "bonds") if isinstance(text, str) for end in chain_ends(text)
        )
        for place, port in enumerate(model.ports):
            if port in model.nodes:
                if is_instance(model.nodes[port]):
                    note(("ports", place), f"the port '{port}' is an instance; name a port of another name")
            elif ends[port] != 1:
                count = "none" if not ends[port] else str(ends[port])
                message = f"the port '{port}' is no node, so one bond of the model ends there, not {count}"
                note(("ports", place), message)

    # Instances

    def _place(
        self,
        prefix: str,
        part: Mapping[Any, Any],
        path: KeyPath,
        names: Mapping[str, str],
        above: tuple[str, ...],
    ) -> None:
        """Add the nodes and bonds of the scene's graph, or of a model under the prefix of an instance.

        `names` are the flat names of the parameters by those within; `above` the models around.
        """
        given = mapping(part, "nodes")
        marks = self._marks((*path, "nodes"))
        for name, node in given.items():
            flat, place = f"{prefix}{name}", (*path, "nodes", name)
            if prefix and not _is_name(str(name)):
                message = f"'{name}' cannot name a node; use letters, digits, _ and -"
                self.faults.append(self.source.fault(place, message, key=True))
            if is_instance(node):
                self._instantiate(flat, node, place, names, above)
                continue
            self.nodes[flat] = (
                _inner(node, names, prefix, given) if prefix and isinstance(node, dict) else node
            )
            for below, mark in marks.get(name, ()):
                self.marks["graph", "nodes", flat, *below] = mark
            if len(self.nodes) > MOST_NODES:
                self.faults.append(self.source.fault(place, f"the graph has more than {MOST_NODES:,} nodes"))
                self._raise()
        for number, text in enumerate(listing(part, "bonds")):
            self._bond(prefix, text, (*path, "bonds", number), given)

    def _marks(self, path: KeyPath) -> dict[Any, list[tuple[KeyPath, Positions]]]:
        """Return the marks below every key of a mapping, with their paths from there."""
        length = len(path)
        if path not in self._below:
            self._below[path] = {}
            for place, mark in self.source.marks.items():
                if len(place) > length and place[:length] == path:
                    self._below[path].setdefault(place[length], []).append((place[length + 1 :], mark))
        return self._below[path]

    def _bond(self, prefix: str, text: Any, path: KeyPath, nodes: Mapping[Any, Any]) -> None:
        """Add a bond, or a chain of bonds."""
        mark = self._mark(path)
        if problem := chain_fault(str(text)):
            self.faults.append(self.source.fault(path, problem))
            return
        ends = chain_ends(text)
        flat = []
        for end in ends:
            name = self.aliases.get(f"{prefix}{end}", f"{prefix}{end}")
            holder = end.partition(".")[0]
            own = nodes.get(holder, nodes.get(int(holder)) if holder.isdecimal() else None)
            if is_instance(own) and name not in self.ports and f"{prefix}{holder}" not in self.refused:
                model = self.models.get(own["model"])
                copies = [holder] if own.get("repeat") is None else [f"{holder}.1", f"{holder}.2"]
                copies = copies[: own.get("repeat") or 1]
                ports = [f"{copy}.{port}" for copy in copies for port in (model.ports if model else ())]
                ports += ["…"] if (own.get("repeat") or 1) > 2 else []
                what = f"'{end}' is no port" if "." in end else f"'{end}' is an instance of {own['model']}"
                message = f"bond '{text}': {what}; bonds attach at {', '.join(ports) or 'ports'}"
                self.faults.append(self.source.fault(path, message))
            flat.append(name)
        for tail, head in pairwise(flat):
            self._connect(tail, head, mark, str(text))

    def _mark(self, path: KeyPath) -> Positions:
        return self.source.marks.get(path, Positions((1, 1), (1, 1), self.source.file))

    def _connect(self, tail: str, head: str, mark: Positions, text: str) -> None:
        for end in (tail, head):
            if end in self.ports:
                self.ports[end][1].append(_End(mark, text))
        self.bonds.append((tail, head, mark))

    def _instantiate(
        self,
        flat: str,
        node: Mapping[Any, Any],
        path: KeyPath,
        names: Mapping[str, str],
        above: tuple[str, ...],
    ) -> None:
        """Add an instance of a model, or the copies of one."""
        model = self.models.get(str(node["model"]))
        if problem := name_problem(flat.rpartition(".")[2]):
            self.faults.append(self.source.fault(path, problem, key=True))
        if model is None:
            known = [*self.models, *library_names()]
            message = f"no model '{node['model']}'{did_you_mean(str(node['model']), known)}"
            self.faults.append(self.source.fault((*path, "model"), message))
            self.refused.add(flat)
            return
        if model.name in above:
            cycle = " -> ".join([*above[above.index(model.name) :], model.name])
            self.faults.append(self.source.fault((*path, "model"), f"the model contains itself: {cycle}"))
            self.refused.add(flat)
            return
        inner = self._arguments(flat, node, model, path, names)
        copies = self._copies(flat, node, model, path)
        if not copies:
            self.refused.add(flat)
        mark, unconnected = self._mark(path), [port for port in model.ports if port not in model.nodes]
        for copy in copies:
            self._place(f"{copy}.", model.data, model.path, inner, (*above, model.name))
            self.ports |= {f"{copy}.{port}": (mark, []) for port in model.ports}
            self.open |= {f"{copy}.{port}" for port in unconnected}
        if copies and copies != [flat]:
            right, left = (str(port) for port in listing(node, "chain") or ("", ""))
            for one, other in pairwise(copies) if right else ():
                self._connect(f"{one}.{right}", f"{other}.{left}", mark, f"chain of {flat}")
            if right:
                self.aliases |= {f"{flat}.{left}": f"{copies[0]}.{left}"}
                self.aliases |= {f"{flat}.{right}": f"{copies[-1]}.{right}"}

    def _arguments(
        self,
        flat: str,
        node: Mapping[Any, Any],
        model: Model,
        path: KeyPath,
        names: Mapping[str, str],
    ) -> dict[str, str]:
        """Add the parameters of an instance; return their flat names by those in the model."""
        usual = model.parameters
        inner = {name: f"{flat}.{name}" for name in usual}
        for key in node:
            if key not in ("model", "repeat", "chain") and str(key) not in usual:
                close = did_you_mean(str(key), usual) or f"; it has {', '.join(usual) or 'none'}"
                message = f"the model '{model.name}' has no parameter '{key}'{close}"
                self.faults.append(self.source.fault((*path, key), message, key=True))
        for name, value in usual.items():
            own, scope = (
                ((*path, name), names) if name in node else ((*model.path, "parameters", name), inner)
            )
            given = node.get(name, value)
            if given is None:
                message = f"'{flat}' needs the parameter '{name}' of its model '{model.name}'"
                self.faults.append(self.source.fault(path, message, key=True))
                given = 1
            if inner[name] in mapping(self.source.data, "parameters"):
                message = f"'{inner[name]}' is a parameter of the instance '{flat}'; use another name"
                self.faults.append(self.source.fault(("parameters", inner[name]), message, key=True))
            self.parameters[inner[name]] = _scoped(given, scope)
            for below, mark in self._marks(own[:-1]).get(own[-1], ()):
                self.marks["parameters", inner[name], *below] = mark
        return inner

    def _copies(self, flat: str, node: Mapping[Any, Any], model: Model, path: KeyPath) -> list[str]:
        """Return the flat names of the copies of an instance; of a single one its own."""
        count, chain = node.get("repeat"), node.get("chain")
        if chain is not None and (count is None or not isinstance(chain, list) or len(chain) != 2):
            message = "'chain' is [port, port] beside 'repeat': of each copy, and of the next one"
            self.faults.append(self.source.fault((*path, "chain"), message, key=True))
            return []
        unknown = [
            (place, str(port)) for place, port in enumerate(chain or ()) if str(port) not in model.ports
        ]
        for place, port in unknown:
            close = did_you_mean(port, model.ports) or f"; it has {', '.join(model.ports)}"
            message = f"the model '{model.name}' has no port '{port}'{close}"
            self.faults.append(self.source.fault((*path, "chain", place), message))
        if unknown:
            return []
        if count is None:
            return [flat]
        if type(count) is not int or not 1 <= count <= MOST_COPIES:
            message = f"'repeat' is a whole number from 1 to {MOST_COPIES:,}"
            self.faults.append(self.source.fault((*path, "repeat"), message))
            return []
        return [f"{flat}.{number}" for number in range(1, count + 1)]

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
                self.faults.append(Fault(mark.file, *mark.value, message))
                continue
            kept, dropped = sorted(numbers)
            bonds[kept] = (first[0], second[1], bonds[max(numbers)][2])
            del bonds[dropped]
            for end in (first[0], second[1]):  # of which one may be another open port
                if end in at:
                    at[end] = [kept if number == dropped else number for number in at[end]]
        return [bonds[number] for number in sorted(bonds)]


def _is_name(text: str) -> bool:
    return bool(text) and all(letter.isalnum() or letter in "_-" for letter in text)


class _Scope(dict[str, str]):
    """Flat names in an expression of a node: of parameters, and of the variables of nodes, which win.

    Parameters
    ----------
    names
        Flat names of parameters.
    prefix
        The prefix of the instance.
    nodes
        The nodes of its model.
    """

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
            own = own_variable(str(node.get("type")), str(key))
            inside = _Scope({name: other for name, other in names.items() if name != own}, prefix, nodes)
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
