"""Netlists of BondGraphTools (`.bg`, YAML): components, wires between their ports, models within models.

There every flow points into its component, and signs belong to ports: the ports of a 1-junction are
`non_inverting` or `inverting`, a source of flow drives outwards, a transformer has e1 = r e0 and
f0 = -r f1, a gyrator e1 = R f0 and e0 = -R f1. Here signs are those of arrows. So a port can ask for an
arrow into its component or out of it; a wire whose two ends ask for the same is a 0-junction.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import Any

from dynid.errors import SceneError
from dynid.scene.netlists.expansion import End, Model, Wire, expand
from dynid.scene.yaml.dump import dump
from dynid.scene.yaml.source import read_source

_VALUED = ("R", "C", "I", "TF", "GY")
_TYPES = ("Se", "Sf", *_VALUED, "0", "1")
_OUTPUTS = {"I": "f", "C": "e", "R": "f"}


@dataclass
class _Graph:
    """Nodes and bonds as a scene writes them."""

    nodes: dict[str, Any] = field(default_factory=dict)
    bonds: list[str] = field(default_factory=list)


def read_netlist(path: str | os.PathLike[str]) -> str:
    """Read a netlist, and write the scene of its graph.

    Parameters
    ----------
    path
        A `.bg` file of BondGraphTools, version 0.1.

    Returns
    -------
    str
        A scene: sources are its inputs; its outputs are the flows of inertias and the efforts of
        compliances (of resistances, where it stores nothing).

    Raises
    ------
    FileError
        Where the file cannot be read.
    SceneError
        With the place of what cannot be understood.
    """
    source = read_source(path)
    root = expand(source, _TYPES)
    graph = _Graph()
    faults = []
    for name, component in root.components.items():
        node: dict[str, Any] = {"type": component.type}
        if component.type in _VALUED:
            if component.value is None:
                message = f"component '{name}' has no value; write it behind '{component.template}'"
                faults.append(source.fault(component.place, message))
                continue
            node["value"] = f"1/({component.value})" if component.type == "TF" else component.value
        graph.nodes[name] = node if len(node) > 1 else component.type
    if faults:
        raise SceneError(faults)
    for wire in root.wires:
        _connect(graph, root, wire)
    return _scene(str(source.data["root"]), graph, root)


def _connect(graph: _Graph, root: Model, wire: Wire) -> None:
    """Add the bond of a wire."""
    first, second = (end.component for end in wire)
    wishes = [_wish(root, end) for end in wire]
    if wishes[0] and wishes[0] == wishes[1]:
        joint = _unused(f"{first}_{second}", graph)
        graph.nodes[joint] = "0"
        out = wishes[0] == "out"
        graph.bonds += [f"{end} -> {joint}" if out else f"{joint} -> {end}" for end in (first, second)]
        return
    backwards = wishes[0] == "in" or (not wishes[0] and wishes[1] == "out")
    if wishes == ["", ""]:
        backwards = root.components[first].type in ("R", "C", "I")
    graph.bonds.append(f"{second} -> {first}" if backwards else f"{first} -> {second}")


def _wish(root: Model, end: End) -> str:
    """Say which way an arrow must go at a port: in, out, or either."""
    kind = root.components[end.component].type
    if kind == "Sf":
        return "out"
    if kind == "1":
        return "out" if end.port == "inverting" else "in"
    if kind in ("TF", "GY"):
        return "out" if end.port == "1" else "in"
    return ""


def _unused(wanted: str, graph: _Graph) -> str:
    name, count = wanted, 1
    while name in graph.nodes:
        count += 1
        name = f"{wanted}_{count}"
    return name


def _scene(title: str, graph: _Graph, root: Model) -> str:
    kinds = {name: component.type for name, component in root.components.items()}
    stored = [name for name, kind in kinds.items() if kind in ("I", "C")]
    shown = stored or [name for name, kind in kinds.items() if kind == "R"]
    data = {
        "dynid": 1,
        "kind": "bond-graph",
        "title": title,
        "graph": {"nodes": graph.nodes, "bonds": graph.bonds},
        "analysis": {
            "inputs": [name for name, kind in kinds.items() if kind in ("Se", "Sf")],
            "outputs": [f"{name}.{_OUTPUTS[kinds[name]]}" for name in shown],
        },
    }
    return dump(data)
