"""Models in one file, or in files of one name: mass, stiffness, damping and nodes."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from dynid.errors import FileError
from dynid.file_access import obstacle
from dynid.structure.readers.read import CONTAINERS, MatrixFile, named_as, shapes_in

#: Files of nodes that may stand beside OUTPUT4.
_BESIDE = (".pch", ".asm", ".bdf", ".dat", ".nas", ".op2", ".csv")
#: Endings of stiffness and mass beside an input file: of CalculiX, of Abaqus.
_PAIRS = ((".sti", ".mas"), ("_STIF1.mtx", "_MASS1.mtx"), ("STIF1.mtx", "MASS1.mtx"))


class ModelFiles(NamedTuple):
    """The files of a model."""

    mass: MatrixFile
    stiffness: MatrixFile
    damping: MatrixFile | None
    nodes: Path | None


def model_files(path: Path) -> ModelFiles:
    """Return the files of a model.

    Parameters
    ----------
    path
        A file of several matrices, which also holds the nodes (OUTPUT2, bulk data with DMIG, MATLAB, HDF5) or
        has them beside it in a file of the same name (OUTPUT4); or an input file of CalculiX or Abaqus
        (`.inp`), which has the matrices beside it.

    Raises
    ------
    FileError
        If it is neither, or a file is missing.
    """
    found = obstacle(path)
    if found is not None:
        raise FileError(f"{path} {found[0]}", remedy=found[1])
    if path.suffix.lower() == ".inp":
        for stiffness, mass in _PAIRS:
            pair = [path.with_name(path.stem + ending) for ending in (mass, stiffness)]
            if all(file.is_file() for file in pair):
                return ModelFiles(MatrixFile(pair[0]), MatrixFile(pair[1]), None, path)
        raise FileError(
            f"{path} has no matrices beside it",
            remedy=f"Looked for {', '.join(path.stem + ending for ending, _ in _PAIRS)}.",
        )
    if path.suffix.lower() not in CONTAINERS:
        raise FileError(
            f"{path} is no file of a whole model",
            remedy=f"Those end in .inp, {', '.join(CONTAINERS)}; else name mass, stiffness and nodes.",
        )
    shapes = shapes_in(path)
    own = named_as(shapes, "stiffness")
    damping = next(
        (name for name in named_as(shapes, "damping") if own and shapes[name] == shapes[own[0]]), ""
    )
    matrices = MatrixFile(path)
    return ModelFiles(
        matrices, matrices, MatrixFile(path, damping) if damping else None, _nodes_beside(path, [*shapes])
    )


def _nodes_beside(path: Path, names: list[str]) -> Path | None:
    kind = path.suffix.lower()
    if kind == ".op4":
        return next((file for end in _BESIDE if (file := path.with_suffix(end)).is_file()), None)
    if kind in (".mat", ".h5", ".hdf5"):
        from dynid.structure.readers.matlab_nodes import POSITIONS

        there = any(name.rpartition("/")[2].lower() in POSITIONS for name in names)
        beside = path.with_suffix(".csv")
        return path if there else beside if beside.is_file() else None
    return path
