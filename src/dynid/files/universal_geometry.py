"""Nodes (data sets 15, 2411, 2412, 18, 2420, 82) and mode shapes (55, 2414) in Universal Files."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.errors import FileError
from dynid.files.coordinate_systems import BASIC, CoordinateSystem
from dynid.files.table import DataFile
from dynid.files.universal_file import UniversalFile
from dynid.structure.dof_order import NodeFile
from dynid.structure.labels import DIRECTIONS, Nodes, Outline

#: Types of coordinate systems in data sets 18 and 2420.
_KINDS: dict[int, Literal["cartesian", "cylindrical"]] = {0: "cartesian", 1: "cylindrical"}
#: Systems that need no definition: files without one mean the basic system by them.
_UNDEFINED = (0, 1)
#: How far the axes of a system may be from orthonormal: data sets 18 have six digits.
_ORTHONORMAL_TOL = 1e-4
#: Descriptors of shell elements in data sets 2412, whose faces are drawn; those of two nodes are lines.
_SHELLS = range(41, 100)


def read_nodes(path: Path) -> NodeFile:
    """Return the nodes of a test in a Universal File.

    Positions are those of data sets 15, in the node's definition system, and 2411, in the system of the part;
    axes are those of its displacement system (18, 2420). Lengths are brought to metres by the record of units
    (164).
    """
    source = UniversalFile(DataFile(path))
    if not has_nodes(source):
        source.file.refuse("holds no nodes", "Data sets 15 and 2411 are read.")
    return NodeFile(nodes_of(source), ())


def has_nodes(source: UniversalFile) -> bool:
    """Return True if a Universal File has the nodes of a test."""
    return not {15, 2411}.isdisjoint(source.kinds)


def nodes_of(source: UniversalFile) -> Nodes:
    """Return the nodes of a test; as `read_nodes`."""
    with source.errors():
        return _nodes(source)


def _nodes(source: UniversalFile) -> Nodes:
    file, systems = source.file, _systems(source)
    placed: dict[int, tuple[Array, int]] = {}
    for data_set in source.sets(15, 2411):
        columns = [
            np.asarray(data_set[key], dtype=float) for key in ("node_nums", "def_cs", "disp_cs", *"xyz")
        ]
        if len({len(column) for column in columns}) > 1:
            file.refuse(f"a data set {data_set['type']} has rows of different lengths", "It is damaged.")
        for number, defined, moving, *xyz in zip(*columns, strict=True):
            node, point = _whole(file, number, "node number"), np.array(xyz)
            if data_set["type"] == 15:
                number_of_system = _whole(file, defined, "system")
                system = _system(file, systems, number_of_system, node)
                if system.kind != "cartesian":
                    file.refuse(
                        f"node {node} is placed in system {number_of_system}, which is not Cartesian",
                        "Export Cartesian positions.",
                    )
                point = system.basic(point)
            if node in placed and not np.array_equal(placed[node][0], point):
                file.refuse(f"node {node} has two positions", "Leave one of them.")
            placed[node] = point, _whole(file, moving, "system")
    axes: dict[int | str, Array] = {}
    for node, (point, number) in placed.items():
        system = _system(file, systems, number, node)
        if system.on_axis(point):
            file.refuse(f"node {node} lies on the axis of system {number}, where no direction is radial")
        rows = system.at(point)
        if not np.array_equal(rows, np.eye(3)):
            axes[node] = rows
    xyz_m = np.array([point for point, _ in placed.values()]).reshape(-1, 3) / source.units().length
    lines = [line for line in _lines(source) if placed.keys() >= set(line) and len(set(line)) == len(line)]
    return Nodes(tuple(placed), xyz_m, axes, {}, tuple(dict.fromkeys(lines)))


def _whole(file: DataFile, number: float, what: str) -> int:
    """Return a number of a node or system, which files print as one with a fraction."""
    if not np.isfinite(number) or number != int(number) or number < 0:
        file.refuse(f"has the {what} {number:g}", "It is damaged: such numbers are whole.")
    return int(number)


def _system(
    file: DataFile, systems: Mapping[int, CoordinateSystem], number: int, node: int
) -> CoordinateSystem:
    """Return a coordinate system that a node uses."""
    if number in systems:
        return systems[number]
    if number in _UNDEFINED:
        return BASIC
    file.refuse(
        f"node {node} uses the coordinate system {number}, which the file does not define",
        "Export the systems too (data set 18 or 2420).",
    )


def _systems(source: UniversalFile) -> dict[int, CoordinateSystem]:
    """Return the coordinate systems of a file by their numbers."""
    systems: dict[int, CoordinateSystem] = {}
    for data_set in source.sets(2420):
        columns = data_set["CS_sys_labels"], data_set["CS_types"], data_set["CS_matrices"]
        for number, kind, matrix in zip(*columns, strict=True):
            systems[int(number)] = _checked(source.file, int(number), int(kind), matrix[3], matrix[:3])
    definitions = {}
    for data_set in source.sets(18):
        rows = zip(*(data_set[key] for key in ("cs_num", "cs_type", "ref_cs_num")), strict=True)
        points = zip(*(data_set[key] for key in ("ref_o", "x_point", "xz_point")), strict=True)
        for (number, kind, reference), three in zip(rows, points, strict=True):
            definitions[int(number)] = int(kind), int(reference), three
    for number in definitions:
        systems.setdefault(number, _by_points(source.file, definitions, number, ()))
    return systems


def _by_points(
    file: DataFile,
    definitions: Mapping[int, tuple[int, int, Sequence[Array]]],
    number: int,
    above: tuple[int, ...],
) -> CoordinateSystem:
    """Return a system that is given by its origin, a point on +x and one on the +xz plane, in another."""
    if number == 0:
        return BASIC
    if number in above or number not in definitions:
        file.refuse(f"system {above[-1]} refers to system {number}, which does not resolve", "It is damaged.")
    kind, reference, points = definitions[number]
    base = _by_points(file, definitions, reference, (*above, number))
    if base.kind != "cartesian":
        file.refuse(f"system {number} is placed in system {reference}, which is not Cartesian")
    origin, on_x, on_xz = (base.basic(np.asarray(point, dtype=float)) for point in points)
    x, z = on_x - origin, on_xz - origin
    y = np.cross(z, x)
    rows = [axis / (np.linalg.norm(axis) or 1.0) for axis in (x, y, np.cross(x, y))]
    return _checked(file, number, kind, origin, rows)


def _checked(file: DataFile, number: int, kind: int, origin: Array, axes: Iterable[Any]) -> CoordinateSystem:
    """Return a system whose axes are orthonormal and right-handed, their last digits corrected."""
    rows = np.array([*axes], dtype=float)
    if kind not in _KINDS:
        file.refuse(f"system {number} is spherical (type {kind})", "Export Cartesian or cylindrical systems.")
    good = rows.shape == (3, 3) and np.isfinite(rows).all() and np.isfinite(origin).all()
    if (
        not good
        or not np.allclose(rows @ rows.T, np.eye(3), atol=_ORTHONORMAL_TOL)
        or np.linalg.det(rows) < 0
    ):
        file.refuse(f"the axes of system {number} are not orthonormal and right-handed", "It is damaged.")
    if np.array_equal(rows, np.eye(3)):
        return CoordinateSystem(np.asarray(origin, dtype=float), rows, _KINDS[kind])
    left, _, right = np.linalg.svd(rows)
    return CoordinateSystem(np.asarray(origin, dtype=float), left @ right, _KINDS[kind])


def _lines(source: UniversalFile) -> Iterable[Outline]:
    """Yield the lines and faces to draw: trace lines, beams, and shells."""
    file = source.file
    for data_set in source.sets(82):
        trace = [_whole(file, number, "node number") for number in data_set["nodes"]]
        # Some programs pad the list with zeros: the count says how many of them belong to it.
        trace = trace[: int(data_set["n_nodes"])]
        yield from ((a, b) for a, b in pairwise(trace) if a and b)  # 0: the pen is up
    with suppress(FileError):  # pyuff reads no elements of more than eight nodes, and lines are for pictures
        for data_set in source.sets(2412):
            for element in (
                element
                for kind, elements in data_set.items()
                if isinstance(kind, int)
                for element in elements
            ):
                nodes = element["nodes_nums"]
                if len(nodes) == 2 or (element["fe_descriptor"] in _SHELLS and len(nodes) in (3, 4)):
                    yield tuple(nodes)


#: Analyses whose results are modes: normal ones, and complex ones of first and second order.
_NORMAL, _COMPLEX = 2, (3, 7)
#: Results that are motions: unknown, general, displacement, velocity, acceleration.
_MOTIONS = (0, 1, 8, 11, 12)
#: Where the values of a data set 2414 are: at nodes.
_AT_NODES = 1


class _MeasuredShape(NamedTuple):
    """A mode of a test: ``frequency`` (rad/s, of the undamped mode), ``damping`` ratio, and shape.

    `damping` is None where the file gives none (0). `shape` has by node and direction, such as ``(20, "z")``,
    a real or complex number; its scale is arbitrary. Directions are those of the node's own axes.
    """

    frequency: float
    damping: float | None
    shape: Mapping[tuple[int, str], complex]


def read_shapes(file: DataFile) -> list[_MeasuredShape]:
    """Return the modes in a Universal File (data sets 55 and 2414), in the order of their frequencies.

    Directions in which all nodes of all modes have exactly 0 were not measured, and are left out; the same
    holds for a direction of one node.
    """
    source = UniversalFile(file)
    length = source.units().length
    with source.errors():
        modes = [
            _MeasuredShape(*_frequency(source.file, data_set), _shape(source.file, data_set, length))
            for data_set in source.sets(55, 2414)
            if _is_mode(data_set)
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
    shape = {}
    for node, values in _values(file, data_set):
        for direction, value in zip(DIRECTIONS, values, strict=False):
            if not np.isfinite(value):
                file.refuse(f"the shape at node {node} is not finite", "It is damaged.")
            number = complex(value) / (1.0 if direction.startswith("r") else length)
            shape[node, direction] = number if number.imag else number.real
    return shape


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
