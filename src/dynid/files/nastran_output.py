"""Nastran OUTPUT2 and OUTPUT4 (`.op2`, `.op4`), read by pyyeti: matrices, nodes, orders of DOFs."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

import numpy as np

from dynid.arrays import Array
from dynid.errors import FileError
from dynid.files.bulk_data import component_labels
from dynid.files.matrix_data import Container, numeric_matrix
from dynid.files.untrusted import check_claim, read_errors
from dynid.structure.dof_order import DofOrder, NodeFile
from dynid.structure.labels import DIRECTIONS, Label, Node, Nodes
from dynid.structure.matrices import Matrix

_WHAT = "Nastran OUTPUT2"
#: The sets whose DOFs a matrix may have, in the order in which they are tried.
_SETS = ("a", "l", "f", "n", "g")


def _op2_shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the matrices of a file, by name; of several with one name ``NAME@1`` and so on."""
    with read_errors(path, _WHAT, claims=True), _opened(path) as stored:
        return {name: size for name, (size, _) in _listed(stored).items()}


def _load_op2(path: Path, name: str) -> Matrix:
    """Return one matrix of a file."""
    with read_errors(path, _WHAT, claims=True), _opened(path) as stored:
        size, number = _listed(stored)[name]
        check_claim(path, size)
        bare = name.partition("@")[0]
        return numeric_matrix(path, name, stored.rdop2mats([bare], which=number)[bare])


def _listed(stored: Any) -> dict[str, tuple[tuple[int, ...], int]]:
    """Return size and number (from 0) of the matrices by name."""
    matrices: dict[str, tuple[tuple[int, ...], int]] = {}
    for name, blocks in stored.dbnames.items():
        sizes = [tuple(int(number) for number in block[2]) for block in blocks]
        for number, size in enumerate(sizes):
            if min(size) > 0:
                matrices[name if len(sizes) == 1 else f"{name}@{number + 1}"] = size, number
    return matrices


def read_nodes(path: Path) -> NodeFile:
    """Return the nodes of a file, and the orders of DOFs that it states.

    These are the sets of USET (a, l, f, n, g), the EXTRN of GEOM1, and the g-set of BGPDT with EQEXIN. From
    GRID in GEOM1 alone follows none: scalar points may be missing.
    """
    with read_errors(path, _WHAT, claims=True), _opened(path) as stored:
        blocks = stored.dbnames
        several = max(len(blocks.get(name, ())) for name in ("BGPDT", "BGPDTS", "GEOM1", "GEOM1S"))
        if several > 1:
            raise FileError(
                f"{path} has the nodes of {several} superelements",
                remedy="Give the bulk data of one of them (.pch, .asm), or a table of nodes (.csv).",
            )
        geometry: Mapping[str, Any] = {}
        table: Any = None
        sets: tuple[str, ...] = _SETS
        if next(iter(blocks), None) in ("SLIST", "SUPERID"):  # as pyyeti's NAS2CAM writes
            table = next(iter(stored.rdn2cop2()["uset"].values()))
        elif blocks.keys() & {"GEOM1", "GEOM1S"}:
            tables = stored.rdparampost(get_mats=False, get_dr_tables=False)
            table, geometry = tables.get("uset"), tables["geom1"].get(0, {})
            sets = _SETS if "USET" in blocks else ("g",)
        if table is None and "grid" in geometry:
            table, sets = _table_of_grids(geometry), ()
        if table is None or not len(table):
            raise FileError(
                f"{path} has no nodes",
                remedy="Write GEOM1, BGPDT, EQEXIN and USET into it, or give bulk data (.bdf, .pch), or "
                "a table of nodes (.csv).",
            )
        outside = [
            label
            for node, components in geometry.get("extrn", ())
            for label in component_labels(int(node), str(components))
        ]
        orders = [DofOrder("EXTRN", tuple(outside), stated=True)] if outside else []
        return _of_table(table, sets, orders)


def _table_of_grids(geometry: Mapping[str, Any]) -> Any:
    """Return pyyeti's table of the GRID entries of GEOM1: id, cp, position, cd, …, by ascending ids."""
    from pyyeti.nastran import n2p  # heavy import, of an optional package

    grid = geometry["grid"][np.argsort(geometry["grid"][:, 0])]
    numbers, systems, axes = grid[:, [0, 1, 5]].astype(int).T.tolist()
    return n2p.addgrid(None, numbers, "b", systems, grid[:, 2:5], axes, geometry["cords"])


def _of_table(table: Any, sets: Sequence[str], orders: Sequence[DofOrder]) -> NodeFile:
    """Return the nodes of pyyeti's table: a row a DOF, by node and component; positions in the first."""
    from pyyeti.nastran import n2p  # heavy import, of an optional package

    index, rows = table.index.to_frame().to_numpy(), table[["x", "y", "z"]].to_numpy(dtype=float)
    motions = n2p.rbgeom_uset(table)
    first = np.flatnonzero(index[:, 1] == 1)
    numbers = [int(node) for node in index[first, 0]]
    axes: dict[Node, Array] = {}
    for node, row in zip(numbers, first, strict=True):
        axes_of_node = motions[row : row + 3, :3]
        if not np.array_equal(axes_of_node, np.eye(3)):
            axes[node] = axes_of_node
    labels: list[Label] = [
        f"{int(node)}:{DIRECTIONS[int(component) - 1]}" if component else int(node)
        for node, component in index
    ]
    listed = [*orders]
    for name in sets:
        kept = np.flatnonzero(n2p.mksetpv(table, "p", name)) if name != "g" else np.arange(len(labels))
        if len(kept):
            listed.append(DofOrder(f"{name}-set", tuple(labels[kept_row] for kept_row in kept), stated=True))
    return NodeFile(Nodes(tuple(numbers), rows[first], axes), tuple(listed))


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a file by pyyeti, whose warnings about tables that are not wanted are left out."""
    op2 = _nastran_module("op2", path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with op2.OP2(str(path)) as stored:
            yield stored


def _op4_shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the matrices of a file, by name."""
    with _reading_op4(path):
        names, sizes, *_ = _nastran_module("op4", path).OP4().dir(str(path), verbose=False)
        if twice := [name for name, count in Counter(names).items() if count > 1]:
            raise FileError(
                f"{path} has several matrices named {twice[0]}", remedy="Give a file with one of them."
            )
        return {name: tuple(size) for name, size in zip(names, sizes, strict=True)}


@contextmanager
def _reading_op4(path: Path) -> Iterator[None]:
    """Check the records of a file, and turn pyyeti's warnings of a truncated one, too, into errors."""
    with read_errors(path, "Nastran OUTPUT4", claims=True), warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        _check_records(path)
        yield


def _check_records(path: Path) -> None:
    """Refuse a binary file whose records lack the counts around them, or that ends within a matrix."""
    with path.open("rb") as stream:
        start = stream.read(4)
        orders: tuple[Literal["little", "big"], ...] = ("little", "big")
        order = next((order for order in orders if int.from_bytes(start, order) in _HEADERS), None)
        if order is None:
            return  # of text
        total, waiting = path.stat().st_size, 0
        offset = 0
        while offset < total:
            stream.seek(offset)
            size = int.from_bytes(stream.read(4), order)
            word = 8 if int.from_bytes(start, order) == _HEADERS[1] else 4
            first = int.from_bytes(stream.read(word), order)
            stream.seek(offset + 4 + size)
            if offset + 8 + size > total or int.from_bytes(stream.read(4), order) != size:
                raise ValueError(
                    f"the record at byte {offset} is not complete: the file is truncated, or damaged"
                )
            waiting = first + 1 if not waiting else 0 if first == waiting else waiting
            offset += 8 + size
        if waiting:
            raise ValueError("it ends within a matrix: the file is truncated")


#: Bytes of the first record of a matrix: of 32-bit words, of 64-bit words.
_HEADERS = (24, 48)


def _load_op4(path: Path, name: str) -> Matrix:
    """Return one matrix of a file, sparse where it is stored so."""
    with _reading_op4(path):
        check_claim(path, _op4_shapes(path)[name], path.stat().st_size)
        stored = (
            _nastran_module("op4", path)
            .OP4()
            .load(str(path), [name], into="dct", justmatrix=True, sparse=True)[name]
        )
        return numeric_matrix(path, name, stored)


OUTPUT2 = Container(_op2_shapes, _load_op2)
OUTPUT4 = Container(_op4_shapes, _load_op4)
"""The readers of the matrices of a file."""


def _nastran_module(name: str, path: Path) -> Any:
    """Return a module of pyyeti, an optional package, to read a Nastran file."""
    try:
        with np.printoptions():  # which pyyeti changes for all
            return import_module(f"pyyeti.nastran.{name}")
    except ImportError:
        raise FileError(
            f"{path} is a Nastran file, which needs the package pyyeti",
            remedy="Install it: pip install 'dynid[formats]'.",
        ) from None
