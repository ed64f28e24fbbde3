"""Netlists of BondGraphTools (`.bg`, YAML): components, wires between their ports, models within models.

There every flow points into its component, and signs belong to ports: the ports of a 1-junction are
`non_inverting` or `inverting`, a source of flow drives outwards, a transformer has e1 = r e0 and
f0 = -r f1, a gyrator e1 = R f0 and e0 = -R f1. Here signs are those of arrows. So a port can ask for an
arrow into its component or out of it; a wire whose two ends ask for the same is a 0-junction.
Models within models are expanded first into one list of components and wires.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import Any

from dynid.errors import SceneError
from dynid.scene.yaml.source import Source, read_source
from dynid.scene.yaml.writer import dump
from dynid.suggestions import did_you_mean

_VALUED = ("R", "C", "I", "TF", "GY")
_TYPES = ("Se", "Sf", *_VALUED, "0", "1")
_OUTPUTS = {"I": "f", "C": "e", "R": "f"}


def read_netlist(path: str | os.PathLike[str]) -> str:
    """Return the scene of a netlist.

    Sources are its inputs; its outputs are the flows of inertias and the efforts of compliances (of
    resistances, where it stores nothing). Raises `FileError` where the file cannot be read. Raises
    `SceneError` with the places of faults.
    """
    source = read_source(path)
    root = _expanded(source)
    nodes: dict[str, Any] = {}
    bonds: list[str] = []
    faults = []
    for name, component in root.components.items():
        node: dict[str, Any] = {"type": component.type}
        if component.type in _VALUED:
            if component.value is None:
                message = f"component '{name}' has no value; write it behind '{component.template}'"
                faults.append(source.fault(component.place, message))
                continue
            node["value"] = f"1/({component.value})" if component.type == "TF" else component.value
        nodes[name] = node if len(node) > 1 else component.type
    if faults:
        raise SceneError(faults)
    for wire in root.wires:
        _connect(nodes, bonds, root, wire)
    kinds = {name: component.type for name, component in root.components.items()}
    stored = [name for name, kind in kinds.items() if kind in ("I", "C")]
    shown = stored or [name for name, kind in kinds.items() if kind == "R"]
    return dump(
        {
            "dynid": 1,
            "kind": "bond-graph",
            "title": str(source.data["root"]),
            "graph": {"nodes": nodes, "bonds": bonds},
            "analysis": {
                "inputs": [name for name, kind in kinds.items() if kind in ("Se", "Sf")],
                "outputs": [f"{name}.{_OUTPUTS[kinds[name]]}" for name in shown],
            },
        }
    )


def _connect(nodes: dict[str, Any], bonds: list[str], root: _NetlistModel, wire: _Wire) -> None:
    first, second = (end.component for end in wire)
    wishes = []  # the direction of an arrow at each end: in, out, or empty for either
    for end in wire:
        kind = root.components[end.component].type
        if kind == "Sf":
            wishes.append("out")
        elif kind == "1":
            wishes.append("out" if end.port == "inverting" else "in")
        elif kind in ("TF", "GY"):
            wishes.append("out" if end.port == "1" else "in")
        else:
            wishes.append("")
    if wishes[0] and wishes[0] == wishes[1]:
        names = (f"{first}_{second}{f'_{k}' if k > 1 else ''}" for k in count(1))
        joint = next(name for name in names if name not in nodes)
        nodes[joint] = "0"
        out = wishes[0] == "out"
        bonds += [f"{name} -> {joint}" if out else f"{joint} -> {name}" for name in (first, second)]
        return
    backwards = wishes[0] == "in" or (not wishes[0] and wishes[1] == "out")
    if wishes == ["", ""]:
        backwards = root.components[first].type in ("R", "C", "I")
    bonds.append(f"{second} -> {first}" if backwards else f"{first} -> {second}")


_NAME = re.compile(r"[^\W\d][\w-]*|\d+")
_MOST_COMPONENTS = 100_000
_MOST_LEVELS = 50

_Place = tuple[Any, ...]


@dataclass(frozen=True)
class _Component:
    """One component: its type, its value as written, and its place in the file."""

    type: str
    template: str
    value: int | float | str | None
    place: _Place


@dataclass(frozen=True)
class _WireEnd:
    """One end of a wire: a component, and the port where one is named."""

    component: str
    port: str = ""


_Wire = tuple[_WireEnd, _WireEnd]


@dataclass
class _NetlistModel:
    """Components by name, wires between them, and the outer ports by label."""

    components: dict[str, _Component] = field(default_factory=dict)
    wires: list[_Wire] = field(default_factory=list)
    ports: dict[str, str] = field(default_factory=dict)


def _refusal(source: Source, path: _Place, message: str) -> SceneError:
    return SceneError([source.fault(path, message)])


def _expanded(source: Source) -> _NetlistModel:
    """Return the root model of a netlist with every model in it expanded, or raise its first fault."""
    data = source.data
    if not isinstance(data, dict) or not isinstance(data.get("models"), dict) or "root" not in data:
        message = "this is no netlist of BondGraphTools: it has the keys 'root' and 'models'"
        raise _refusal(source, (), message)
    if str(data.get("version", "0.1")) != "0.1":
        message = f"version {data['version']} of netlists is not known; 0.1 is"
        raise _refusal(source, ("version",), message)
    models = data["models"]
    root = "/" if "/" in models else str(data["root"])
    if root not in models:
        raise _refusal(source, ("root",), f"no model '{root}'{did_you_mean(root, list(models))}")
    expansion = _Expansion(source)
    model = expansion.model(root, (), ())
    if model.ports:
        raise _refusal(source, ("models", root, "ports"), "the root model has no outer ports")
    return expansion.joined(model)


class _Expansion:
    """Expansion of the models of one file."""

    def __init__(self, source: Source) -> None:
        self._source, self._models = source, source.data["models"]
        self._count = 0

    def _refusal(self, path: _Place, message: str) -> SceneError:
        return _refusal(self._source, path, message)

    def model(self, name: str, path: tuple[str, ...], above: tuple[str, ...]) -> _NetlistModel:
        """Expand a model; `path` is what its components' names start with."""
        key_path: _Place = ("models", name)
        if name in above or len(above) >= _MOST_LEVELS:
            raise self._refusal(key_path, f"model '{name}' contains itself")
        written = self._models[name]
        if not isinstance(written, dict):
            raise self._refusal(key_path, f"model '{name}' has the keys 'components' and 'netlist'")
        netlist = _NetlistModel()
        inner: dict[str, _NetlistModel] = {}
        for k, text in enumerate(self._texts(written, "components", key_path)):
            self._add(netlist, inner, text, (*key_path, "components", k), path, (*above, name))
        for k, text in enumerate(self._texts(written, "netlist", key_path)):
            ends = text.split()
            if len(ends) != 2:
                message = f"'{text}' is no wire; write 'a b', or 'a.port b'"
                raise self._refusal((*key_path, "netlist", k), message)
            first, second = (self._end(end, (*key_path, "netlist", k), netlist, inner, path) for end in ends)
            netlist.wires.append((first, second))
        for k, text in enumerate(self._texts(written, "ports", key_path)):
            label, *names = text.split()
            full = "_".join((*path, label))
            if len(names) != 1 or full not in netlist.components or netlist.components[full].type != "SS":
                message = f"'{text}' is no port; write 'a B', where a is a component base/SS"
                raise self._refusal((*key_path, "ports", k), message)
            netlist.ports[names[0]] = full
        return netlist

    def _add(
        self,
        netlist: _NetlistModel,
        inner: dict[str, _NetlistModel],
        text: str,
        key_path: _Place,
        path: tuple[str, ...],
        above: tuple[str, ...],
    ) -> None:
        label, template, *values = text.split() if len(text.split()) > 1 else ("", "")
        if not _NAME.fullmatch(label):
            raise self._refusal(key_path, f"'{text}' is no component; write 'name base/R 10'")
        full = "_".join((*path, label))
        if full in netlist.components or label in inner:
            raise self._refusal(key_path, f"two components are called '{label}'")
        self._count += 1
        if self._count > _MOST_COMPONENTS:
            raise self._refusal(key_path, f"more than {_MOST_COMPONENTS:,} components")
        if template in self._models:
            inner[label] = self.model(template, (*path, label), above)
            netlist.components |= inner[label].components
            netlist.wires += inner[label].wires
        else:
            netlist.components[full] = self._component(template, values, key_path)

    def _component(self, template: str, values: Sequence[str], path: _Place) -> _Component:
        library, _, kind = template.rpartition("/")
        if library != "base" or kind not in (*_TYPES, "SS"):
            types = [*(f"base/{name}" for name in _TYPES), *self._models]
            close = did_you_mean(template, types)
            message = f"no component '{template}'{close}; linear ones of 'base' are read"
            raise self._refusal(path, message)
        if len(values) > 1:
            raise self._refusal(path, f"a component of type {kind} takes one value, not {len(values)}")
        value: int | float | None = None
        if values:
            written = values[0].rpartition("=")[2]  # 10 or r=10
            try:
                value = int(written) if written.lstrip("+-").isdecimal() else float(written)
            except ValueError:
                raise self._refusal(path, f"'{written}' is no number; components need numbers") from None
        return _Component(kind, template, value, path)

    def _texts(self, model: dict[str, Any], key: str, path: _Place) -> list[str]:
        listed = model.get(key) or []
        if not isinstance(listed, list):
            raise self._refusal((*path, key), f"'{key}' is a list")
        for k, item in enumerate(listed):
            if not isinstance(item, str):
                raise self._refusal((*path, key, k), f"an entry of '{key}' is a text")
        return listed

    def _end(
        self,
        text: str,
        key_path: _Place,
        netlist: _NetlistModel,
        inner: dict[str, _NetlistModel],
        path: tuple[str, ...],
    ) -> _WireEnd:
        label, _, port = text.partition(".")
        full = "_".join((*path, label))
        if label in inner:
            ports = inner[label].ports
            if not port and len(ports) == 1:
                (port,) = ports
            if port not in ports:
                close = did_you_mean(port, list(ports))
                raise self._refusal(key_path, f"model '{label}' has no port '{port}'{close}")
            return _WireEnd(ports[port])
        if full not in netlist.components:
            raise self._refusal(key_path, f"no component '{label}'")
        return _WireEnd(full, port)

    def joined(self, model: _NetlistModel) -> _NetlistModel:
        """Return a model with wires joined at `base/SS`, the ports between models, and named ports."""
        wires = list(model.wires)
        for name, component in model.components.items():
            if component.type != "SS":
                continue
            at = [wire for wire in wires if name in (wire[0].component, wire[1].component)]
            if len(at) != 2:
                raise self._refusal(component.place, f"'{name}' (base/SS) is no port between two models")
            ends = [end for wire in at for end in wire if end.component != name]
            wires = [wire for wire in wires if wire not in at] + [(ends[0], ends[1])]
        kept = {name: component for name, component in model.components.items() if component.type != "SS"}
        used: Counter[str] = Counter()  # the file may leave the ports of two-ports to their order
        for k, wire in enumerate(wires):
            ends = []
            for end in wire:
                ordered = kept[end.component].type in ("TF", "GY") and not end.port
                ends.append(_WireEnd(end.component, str(used[end.component])) if ordered else end)
                used[end.component] += ordered
            wires[k] = (ends[0], ends[1])
        return _NetlistModel(kept, wires)
