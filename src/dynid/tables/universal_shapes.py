"""Mode shapes in Universal Files: data at nodes (55, 2414) of normal and complex modes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dynid.structure.labels import DIRECTIONS
from dynid.tables.read import existing
from dynid.tables.universal_file import UniversalFile

if TYPE_CHECKING:
    from dynid.tables.table import DataFile

#: Analyses whose results are modes: normal ones, and complex ones of first and second order.
_NORMAL, _COMPLEX = 2, (3, 7)
#: Results that are motions: unknown, general, displacement, velocity, acceleration.
_MOTIONS = (0, 1, 8, 11, 12)
#: Where the values of a data set 2414 are: at nodes.
_AT_NODES = 1


class MeasuredShape(NamedTuple):
    """A mode of a test: ``frequency`` (rad/s, of the undamped mode), ``damping`` ratio, and shape.

    `damping` is None where the file gives none (0). `shape` has by node and direction, such as ``(20, "z")``,
    a real or complex number; its scale is arbitrary. Directions are those of the node's own axes.
    """

    frequency: float
    damping: float | None
    shape: Mapping[tuple[int, str], complex]


def read_shapes(path: Path, place: str = "") -> list[MeasuredShape]:
    """Return the modes in a Universal File (data sets 55 and 2414), in the order of their frequencies.

    Directions in which all nodes of all modes have exactly 0 were not measured, and are left out; the same
    holds for a direction of one node.

    Parameters
    ----------
    path
        The file.
    place
        The dotted place of the file in the scene, for errors.

    Raises
    ------
    FileError
        If the file cannot be read, is damaged, or holds no mode.
    """
    source = UniversalFile(existing(path, place))
    length = source.units().length
    with source.errors():
        modes = [
            MeasuredShape(*_frequency(source.file, one), _shape(source.file, one, length))
            for one in source.sets(55, 2414)
            if _is_mode(one)
        ]
    if not modes:
        source.file.refuse("holds no mode shapes", "Data sets 55 and 2414 of modes at nodes are read.")
    seen = {dof for mode in modes for dof, value in mode.shape.items() if value}
    if not seen:
        source.file.refuse("has mode shapes that are zero")
    kept = [
        mode._replace(shape={dof: value for dof, value in mode.shape.items() if dof in seen})
        for mode in modes
    ]
    return sorted(kept, key=lambda mode: mode.frequency)


def _is_mode(data_set: Mapping[str, Any]) -> bool:
    if data_set["type"] == 2414:
        result, at_nodes = data_set["result_type"], data_set["dataset_location"] == _AT_NODES
    else:
        result, at_nodes = data_set["spec_data_type"], True
    return at_nodes and result in _MOTIONS and data_set["analysis_type"] in (_NORMAL, *_COMPLEX)


def _frequency(file: DataFile, data_set: Mapping[str, Any]) -> tuple[float, float | None]:
    """Return the undamped frequency of a mode (rad/s) and its damping ratio."""
    record = data_set["type"] == 2414
    eigenvalue = 0j
    if data_set["analysis_type"] in _COMPLEX:
        parts = (data_set.get(f"record13_field{k}", 0.0) for k in (1, 2)) if record else None
        eigenvalue = complex(*parts) if parts else complex(data_set["eig"])
    if eigenvalue:
        frequency, damping = abs(eigenvalue), -eigenvalue.real / abs(eigenvalue)
    else:
        names = (
            (f"record12_field{k}" for k in (2, 5, 6))
            if record
            else ("freq", "modal_damp_vis", "modal_damp_his")
        )
        hertz, viscous, hysteretic = (float(data_set.get(name) or 0.0) for name in names)
        # A loss factor is twice the ratio of a viscous damper with the same loss at resonance.
        frequency, damping = 2 * math.pi * hertz, viscous or hysteretic / 2
    if not (math.isfinite(frequency) and frequency > 0):
        file.refuse(f"a mode shape has the frequency {frequency / 2 / math.pi:g} Hz", "It is damaged.")
    if not (math.isfinite(damping) and 0 <= damping < 1):
        file.refuse(
            f"the mode at {frequency / 2 / math.pi:g} Hz has the damping ratio {damping:g}",
            "A ratio is from 0 to 1, not in per cent.",
        )
    return frequency, damping or None


def _shape(file: DataFile, data_set: Mapping[str, Any], length: float) -> dict[tuple[int, str], complex]:
    """Return the values of a shape by node and direction; translations in m for rotations in rad."""
    found = {}
    for node, values in _values(file, data_set):
        for direction, value in zip(DIRECTIONS, values, strict=False):
            if not np.isfinite(value):
                file.refuse(f"the shape at node {node} is not finite", "It is damaged.")
            number = complex(value) / (1.0 if direction.startswith("r") else length)
            found[node, direction] = number if number.imag else number.real
    return found


def _values(file: DataFile, data_set: Mapping[str, Any]) -> Iterator[tuple[int, Any]]:
    """Yield the nodes of a mode with their three or six values."""
    nodes = [int(node) for node in data_set["node_nums"]]
    if len(set(nodes)) < len(nodes):
        twice = next(node for at, node in enumerate(nodes) if node in nodes[:at])
        file.refuse(f"a mode shape has node {twice} twice", "It is damaged.")
    if data_set["type"] == 55:
        columns = [data_set[f"r{k}"] for k in range(1, 7) if f"r{k}" in data_set]
        if any(len(column) != len(nodes) for column in columns):
            file.refuse("a mode shape has fewer values than nodes", "It is damaged.")
        yield from zip(nodes, zip(*columns, strict=True), strict=True)
        return
    count = data_set["number_of_data_values_for_the_data_component"]
    is_complex = data_set["data_type"] in (5, 6)
    if count not in (3, 6):
        file.refuse(f"a mode shape has {count} values a node; 3 or 6 are read")
    rows = data_set["data_at_node"]
    if len(rows) != len(nodes):
        file.refuse("a mode shape has fewer values than nodes", "It is damaged.")
    for node, row in zip(nodes, rows, strict=True):
        if len(row) != count * (2 if is_complex else 1):
            file.refuse(f"the shape at node {node} has {len(row)} values", "It is damaged.")
        yield node, row[::2] + 1j * row[1::2] if is_complex else row
