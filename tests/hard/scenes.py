"""Scenes of hard cases, run as users run them: YAML text in a file, through the public interface."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import dynid
from dynid.result import Result

Files = Mapping[str, str]
NO_FILES: Files = MappingProxyType({})


def run(scene: Mapping[str, Any] | str, files: Files = NO_FILES) -> Result:
    """Run a scene, beside it the files that it names."""
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        path = Path(folder) / "scene.yaml"
        path.write_text(scene if isinstance(scene, str) else json.dumps(scene), encoding="utf-8")
        return dynid.run(dynid.load_scene(path))


def reading(scene: Mapping[str, Any], *paths: str, files: Files = NO_FILES) -> dict[str, Any]:
    """Run a scene, and read these paths of its result."""
    result = run(scene, files)
    return {path: result.value(path) for path in paths}


def graph(nodes: str, bonds: str, outputs: str | list[str], **analysis: Any) -> dict[str, Any]:
    """Write the scene of a graph.

    Parameters
    ----------
    nodes
        As ``Se u, 1 j, R r 2``: type, name, and value where the type has one.
    bonds
        As ``u -> j -> r, j -> c``.
    outputs
        One, or several.
    analysis
        The other keys of the analysis; `initial` stands beside it.
    """
    entries = (entry.split(maxsplit=2) for entry in nodes.split(","))
    described = {name: {"type": kind, "value": value[0]} if value else kind for kind, name, *value in entries}
    initial = analysis.pop("initial", {})
    listed = [outputs] if isinstance(outputs, str) else outputs
    return {
        "dynid": 1,
        "kind": "bond-graph",
        "graph": {"nodes": described, "bonds": [bond.strip() for bond in bonds.split(",")]},
        "analysis": {"outputs": listed, **analysis},
        "initial": initial,
    }
