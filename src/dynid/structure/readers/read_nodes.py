"""Nodes from a file, the format chosen by its extension."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from dynid.errors import FileError, UsageError
from dynid.file_access import obstacle
from dynid.structure.readers import bulk_data, exodus, input_file, matlab_nodes, node_table, op2
from dynid.structure.readers.node_file import NodeFile

_READERS: dict[str, Callable[[Path], NodeFile]] = {
    **dict.fromkeys((".bdf", ".dat", ".nas", ".pch", ".asm"), bulk_data.read_nodes),
    ".op2": op2.read_nodes,
    **dict.fromkeys((".exo", ".e", ".g", ".ex2", ".exii"), exodus.read_nodes),
    **dict.fromkeys((".mat", ".h5", ".hdf5"), matlab_nodes.read_nodes),
    ".inp": input_file.read_nodes,
    ".csv": node_table.read_nodes,
}


def read_nodes(path: Path) -> NodeFile:
    """Return the nodes of a file.

    Parameters
    ----------
    path
        The file: Nastran bulk data (`.bdf`, `.dat`, `.nas`, `.pch`, `.asm`) or OUTPUT2 (`.op2`), Exodus
        (`.exo`, `.e`, `.g`), Abaqus or CalculiX (`.inp`), MATLAB or HDF5, or a table (`.csv`).

    Raises
    ------
    FileError
        If it cannot be read, or has no nodes.
    """
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise FileError(
            f"{path} is no file of nodes that is read", remedy=f"Those end in {', '.join(_READERS)}."
        )
    found = obstacle(path)
    if found is not None:
        raise FileError(f"{path} {found[0]}", remedy=found[1])
    try:
        return reader(path)
    except UsageError as error:  # of the nodes themselves: two have one number
        raise FileError(f"{path}: {error.problem}", remedy=error.remedy) from None
