"""Exodus files (`.exo`, `.e`, `.g`): nodes, node sets, outlines of elements, modes.

Exodus is netCDF: of version 3, read by SciPy, or HDF5. Source: L. A. Schoof, V. R. Yarberry, "EXODUS II: A
Finite Element Data Model", SAND92-2137, 1994.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from dynid.arrays import Array
from dynid.errors import FileError
from dynid.files.mesh_data import outlines
from dynid.files.untrusted import check_claim, read_errors
from dynid.hdf5 import check_stored, open_hdf5
from dynid.structure.dof_order import ModeShapes, NodeFile
from dynid.structure.labels import Nodes

_WHAT = "Exodus"
_SHAPES = {
    "BAR": "line", "BEAM": "line", "TRUSS": "line", "EDGE": "line", "ROD": "line",
    "TRI": "triangle", "TRIANGLE": "triangle", "SHELL": "quadrilateral", "QUAD": "quadrilateral",
    "TET": "tetrahedron", "TETRA": "tetrahedron", "PYRAMID": "pyramid", "WEDGE": "wedge", "PENTA": "wedge",
    "HEX": "hexahedron", "HEXAHEDRON": "hexahedron",
}  # fmt: skip
# The most lines and faces that are kept to be drawn.
_MOST_OUTLINES = 1_000_000


def read_nodes(path: Path) -> NodeFile:
    """Return nodes, sets and modes of a file."""
    with read_errors(path, _WHAT), _opened(path) as stored:
        xyz = _positions(stored)
        if not len(xyz):
            raise FileError(f"{path} has no nodes")
        numbers = _values(stored, "node_num_map", np.arange(1, len(xyz) + 1)).astype(int).tolist()
        drawn = outlines(_elements(stored, numbers), _MOST_OUTLINES)
        nodes = Nodes(tuple(numbers), xyz, {}, dict(_sets(stored, numbers)), drawn)
        return NodeFile(nodes, (), modes=_modes(stored, len(xyz)))


class _Stored:
    """The variables of a netCDF file: arrays by name, and the text attribute of one."""

    def __init__(self, path: Path, variables: Mapping[str, Any], hdf5: bool) -> None:
        self.path, self.variables, self.hdf5 = path, variables, hdf5

    def array(self, name: str) -> np.ndarray[Any, np.dtype[Any]]:
        item = self.variables[name]
        check_claim(self.path, item.shape or (1,))
        if self.hdf5:
            check_stored(item)
        values = np.array(item[()] if self.hdf5 or not item.shape else item[:])
        return values.astype(values.dtype.newbyteorder("="))

    def attribute(self, name: str, key: str) -> str:
        item = self.variables[name]
        text = item.attrs.get(key, b"") if self.hdf5 else getattr(item, key, b"")
        return text.decode(errors="replace") if isinstance(text, bytes) else str(text)

    def texts(self, name: str) -> list[str]:
        if name not in self.variables:
            return []
        rows = self.array(name)
        return [bytes(row.tobytes()).partition(b"\0")[0].decode(errors="replace").strip() for row in rows]


@contextmanager
def _opened(path: Path) -> Iterator[_Stored]:
    with path.open("rb") as stream:
        start = stream.read(4)
    if start == b"\x89HDF":
        with open_hdf5(path) as store:
            yield _Stored(path, store, hdf5=True)
    elif start[:3] == b"CDF" and start[3:] in (b"\1", b"\2"):
        from scipy.io import netcdf_file

        # Mapped, not read: sizes that the header claims take no memory.
        file = netcdf_file(path, mmap=True)
        try:
            yield _Stored(path, file.variables, hdf5=False)
        finally:
            file.variables.clear()
            file.close()
    else:
        raise ValueError("it is no netCDF file of version 3 (classic, 64-bit offset) or 4")


def _values(stored: _Stored, name: str, default: Any) -> np.ndarray[Any, np.dtype[Any]]:
    return stored.array(name) if name in stored.variables else default


def _positions(stored: _Stored) -> Array:
    """Return the positions (N x 3); a missing coordinate is 0."""
    if "coord" in stored.variables:  # of older files: one variable
        columns = list(stored.array("coord"))
    else:
        columns = [stored.array(f"coord{axis}") for axis in "xyz" if f"coord{axis}" in stored.variables]
    xyz = np.zeros((len(columns[0]) if columns else 0, 3))
    for column_number, column in enumerate(columns):
        xyz[:, column_number] = column
    return xyz


def _sets(stored: _Stored, numbers: list[int]) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Yield names and nodes of the node sets; those without a name are called by their number."""
    names = stored.texts("ns_names")
    for index, number in enumerate(_values(stored, "ns_prop1", np.empty(0)).tolist()):
        if f"node_ns{index + 1}" in stored.variables:
            members = stored.array(f"node_ns{index + 1}").tolist()
            name = names[index] if index < len(names) else ""
            yield name or str(number), tuple(numbers[member - 1] for member in members)


def _elements(stored: _Stored, numbers: list[int]) -> Iterator[tuple[str, list[int]]]:
    for block in range(1, 1 + len(_values(stored, "eb_prop1", np.empty(0)))):
        name = f"connect{block}"
        if name not in stored.variables:
            continue
        shape = _SHAPES.get(stored.attribute(name, "elem_type").strip("\0 ").upper().rstrip("0123456789"))
        if shape is None:
            continue
        for element in stored.array(name).tolist():
            yield shape, [numbers[node - 1] for node in element]


def _modes(stored: _Stored, n: int) -> ModeShapes | None:
    """Return the modes, where the file has displacements, and frequencies as a global variable, Hz."""
    spatial = [name.lower() for name in stored.texts("name_nod_var")]
    places = [[word + axis for word in ("disp", "displ_", "displacement_", "disp_")] for axis in "xyz"]
    columns = [next((k for k, name in enumerate(spatial, 1) if name in words), 0) for words in places]
    overall = [name.lower() for name in stored.texts("name_glo_var")]
    if not all(columns) or "eigenfrequency" not in overall or "vals_glo_var" not in stored.variables:
        return None
    frequencies = 2 * np.pi * stored.array("vals_glo_var")[:, overall.index("eigenfrequency")]
    shapes = np.stack([stored.array(f"vals_nod_var{k}") for k in columns], axis=-1)  # m x N x 3
    if shapes.shape != (len(frequencies), n, 3) or not np.isfinite(shapes).all():
        return None
    return ModeShapes(np.moveaxis(shapes, 0, -1), frequencies)
