"""Scenes built in Python: the same keys as in YAML, checked by the same rules.

Examples
--------
>>> import dynid
>>> graph = dynid.GraphBuilder("Mass on a damper").node("F", "Se").node("body", 1)
>>> graph = graph.node("m", "I", 2).node("b", "R", 4).bond("F -> body -> m").bond("body -> b")
>>> result = dynid.run(graph.scene(outputs=["m.f"]))
>>> result["bond_graph/transfer_function/m.f/F/poles"].data
array([-2.+0.j])
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from dynid.errors import Fault
    from dynid.scene.load import Scene
    from dynid.scene.yaml.source import Source

Number = int | float | str
"""A number, the name of a parameter, or an expression."""


def scene_from(data: Mapping[str, Any], folder: str | os.PathLike[str] = ".") -> Scene:
    """Return a scene given as plain data, checked.

    Parameters
    ----------
    data
        The data of a YAML scene: mappings, lists, numbers, texts. `dynid: 1` may be omitted.
    folder
        Folder that paths in the scene are relative to.

    Raises
    ------
    dynid.errors.SceneError
        With all faults, located in the YAML text of the data (`scene.source.text` of a valid scene), each
        with the path of its value: `graph.nodes.b.value`.
    """
    from dynid.errors import SceneError
    from dynid.scene.load import check_source
    from dynid.scene.yaml.source import built_source

    source = built_source({"dynid": 1, **data}, os.path.join(os.fspath(folder), "<scene>"))  # noqa: PTH118
    try:
        return check_source(source)
    except SceneError as error:
        raise SceneError(_with_path(source, fault) for fault in error.faults) from None


def _with_path(source: Source, fault: Fault) -> Fault:
    """Return a fault with the path of its value in the message: nobody sees the lines of a built scene."""
    position = (fault.line, fault.column)
    paths = [path for path, marks in source.marks.items() if position in (marks.key, marks.value)]
    shortest = min(paths, key=len) if paths else ()
    dotted = ".".join(map(str, shortest))
    named = not dotted or dotted in fault.message
    return fault if named else replace(fault, message=f"{dotted}: {fault.message}")


class _SceneBuilder:
    """Base of builders, with the data of a scene."""

    def __init__(self, kind: str, title: str) -> None:
        self._data: dict[str, Any] = {"kind": kind, "title": title}

    def parameters(self, **values: Number) -> Self:
        """Define parameters, which quantities may name."""
        self._data.setdefault("parameters", {}).update(values)
        return self

    def expect(self, path: str, value: Any = None, **bounds: Any) -> Self:
        """Expect a result at a path (`rtol`, `atol`, `min`, `max`, `max_abs`, `part`, `at`, `unit`)."""
        expectation = {"path": path, **({} if value is None else {"value": value}), **bounds}
        self._data.setdefault("expect", []).append(expectation)
        return self

    @staticmethod
    def _refuse_twice(what: str, name: str, present: Mapping[str, Any]) -> None:
        """Refuse a second definition, as YAML refuses a key that is given twice."""
        if name in present:
            from dynid.errors import UsageError

            raise UsageError(f"the {what} '{name}' is given twice; use another name")

    def _scene(self, folder: str | os.PathLike[str], **parts: Any) -> Scene:
        data = {name: section for name, section in parts.items() if section is not None}
        return scene_from({**self._data, **data}, folder)


class GraphBuilder(_SceneBuilder):
    """A bond graph, node by node; for sub-models, designs and other blocks use `scene_from`.

    Parameters
    ----------
    title
        Title of the scene.
    """

    def __init__(self, title: str = "") -> None:
        super().__init__("bond-graph", title)
        self._nodes: dict[str, Any] = {}
        self._bonds: list[str] = []

    def node(self, name: str, type: str | int, value: Number | None = None, **more: Any) -> Self:
        """Add a node: Se, Sf, I, C, R, TF, GY, 0 or 1, with its value where it has one (SI units).

        Raises
        ------
        dynid.errors.UsageError
            If the graph has a node of this name.
        """
        self._refuse_twice("node", name, self._nodes)
        keys = {} if value is None else {"value": value}
        self._nodes[name] = {"type": type, **keys, **more} if keys or more else type
        return self

    def bond(self, chain: str) -> Self:
        """Add a bond, or a chain of bonds: `a -> b -> c`, power positive along the arrows."""
        self._bonds.append(chain)
        return self

    def loop(self, measured: str, source: str, controller: Mapping[str, Any], **more: Any) -> Self:
        """Close a loop from a variable (`m.f`) through a controller (`{"pid": {"kp": 2}}`) to a source.

        `reference` and `setpoint` name its inputs, as in `control.loops` in YAML.
        """
        loops = self._data.setdefault("control", {"loops": []})["loops"]
        loops.append({"from": measured, "to": source, "controller": dict(controller), **more})
        return self

    def scene(
        self,
        outputs: Sequence[str],
        initial: Mapping[str, Any] | None = None,
        folder: str | os.PathLike[str] = ".",
        **analysis: Any,
    ) -> Scene:
        """Return the scene with its outputs (`m.f`) and further keys of the block `analysis`.

        Raises
        ------
        dynid.errors.SceneError
            With all faults of the scene.
        """
        graph = {"nodes": self._nodes, "bonds": self._bonds}
        return self._scene(
            folder, graph=graph, analysis={"outputs": list(outputs), **analysis}, initial=initial
        )


class StructureBuilder(_SceneBuilder):
    """A structure with joints and its measurement.

    Parameters
    ----------
    structure
        One of `lumped`, `beam`, `frame`, `space_frame`, `solid`, `matrices` with its keys, as in YAML.
    title
        Title of the scene.
    """

    def __init__(self, structure: Mapping[str, Any], title: str = "") -> None:
        super().__init__("identification", title)
        self._data["structure"] = dict(structure)

    @classmethod
    def lumped(cls, masses: Sequence[Number], title: str = "") -> Self:
        """Start from point masses (kg), each with one degree of freedom."""
        return cls({"lumped": {"masses": list(masses), "links": []}}, title)

    @classmethod
    def beam(cls, title: str = "", **keys: Any) -> Self:
        """Start from a beam: elements, length (m), EI (N m2), rhoA (kg/m), supports, damping and so on."""
        return cls({"beam": keys}, title)

    def link(self, dofs: Sequence[int], k: Number | None = None, c: Number | None = None) -> Self:
        """Add a spring (N/m) and damper (N s/m) between masses, or from one to ground."""
        keys = {"dofs": list(dofs), "k": k, "c": c}
        links = self._data["structure"]["lumped"]["links"]
        links.append({name: value for name, value in keys.items() if value is not None})
        return self

    def joint(self, name: str, dofs: Sequence[int | str], **parts: Any) -> Self:
        """Add a joint; `k` and `c` are numbers where known, `{"start": …}` where to be identified.

        Raises
        ------
        dynid.errors.UsageError
            If the structure has a joint of this name.
        """
        self._refuse_twice("joint", name, self._data.setdefault("joints", {}))
        self._data["joints"][name] = {"dofs": list(dofs), **parts}
        return self

    def excite(self, dof: int | str, kind: str, **keys: Any) -> Self:
        """Add a force (N): step, impulse, sine, multisine, chirp, random, impact or file."""
        self._data.setdefault("excitation", []).append({"dof": dof, "kind": kind, **keys})
        return self

    def reduce(self, method: str, **keys: Any) -> Self:
        """Reduce the structure by a reduction method."""
        self._data["reduction"] = {"method": method, **keys}
        return self

    def measure(self, channels: Sequence[Mapping[str, Any]], **keys: Any) -> Self:
        """Define the measurement: channels, `step` (s), `samples`, and `simulate` or `file`."""
        self._data["measurement"] = {"channels": [dict(channel) for channel in channels], **keys}
        return self

    def scene(self, folder: str | os.PathLike[str] = ".", **parts: Any) -> Scene:
        """Return the scene; `estimator`, `analysis` and other blocks may be given as in YAML.

        Raises
        ------
        dynid.errors.SceneError
            With all faults of the scene.
        """
        return self._scene(folder, **parts)
