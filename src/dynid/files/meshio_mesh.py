"""Meshes that meshio reads, in a separate process with limits of time and memory: VTK, Exodus, MED, ….

XDMF keeps its numbers in other files; these are read where the scene names them.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
import warnings
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid import trial
from dynid.errors import FileError
from dynid.files.fe_text import check_reference
from dynid.files.mesh_data import MeshData, members
from dynid.files.untrusted import MOST_NUMBERS, DiedError, archived, check_count, check_size
from dynid.hdf5 import Refused, check_all_stored, check_stored, inside, open_hdf5
from dynid.structure.solid_elements import Places

if TYPE_CHECKING:
    import meshio

FORMATS = {
    ".vtk": "vtk", ".vtu": "vtu", ".exo": "exodus", ".e": "exodus", ".ex2": "exodus", ".g": "exodus",
    ".exii": "exodus", ".med": "med",
    ".xdmf": "xdmf", ".xmf": "xdmf", ".mesh": "medit", ".meshb": "medit", ".avs": "avsucd", ".su2": "su2",
    ".f3grid": "flac3d", ".vol": "netgen", ".mdpa": "mdpa",
}  # fmt: skip
"""Formats in meshio by the ending of a file: those in which no other file is named unseen."""

# Data of cells whose values are numbers of groups.
_TAGS = ("gmsh:physical", "medit:ref")
# Sets that meshio adds itself.
_ADDED = "gmsh:bounding_entities"
#: Memory of the separate process, bytes: of itself, for each byte of the file, and at most.
_LEAST_MEMORY, _GROWTH, _MOST_MEMORY = 2**31, 60, 24 * MOST_NUMBERS
_MESH_BYTES_A_SECOND = 500_000  # of a file, read at least
#: Counts in the text of files, and the fewest bytes of what they count; compression makes 1000 of one.
_COUNTS = {
    ".vtk": (
        re.compile(rb"^(?:POINTS|CELLS|CELL_TYPES|POINT_DATA|CELL_DATA)[ \t]+(\d+)(?:[ \t]+(\d+))?", re.M),
        1,
    ),
    ".vtu": (re.compile(rb"NumberOf(?:Points|Cells)\s*=\s*[\"'](\d+)"), 1e-3),
    ".mesh": (
        re.compile(rb"^\s*(?:Vertices|Triangles|Quadrilaterals|Tetrahedra|Hexahedra|Prisms)\s+(\d+)", re.M),
        2,
    ),
    ".su2": (re.compile(rb"^\s*N(?:POIN|ELEM)\s*=\s*(\d+)", re.M), 2),
    ".avs": (re.compile(rb"\A(?:#.*\n)*\s*(\d+)[ \t]+(\d+)"), 2),
}
_MARKUP = (".vtu", ".xdmf", ".xmf")
_DATA_ITEM = re.compile(r"<DataItem\b([^>]*)>([^<]*)", re.DOTALL)
#: The first bytes that are looked at for counts.
_START = 2**24


def read_foreign(path: Path, includes: Sequence[Path]) -> MeshData:
    """Return the mesh of a file, with nodes without numbers."""
    size = path.stat().st_size
    check_size(path)
    _check_counts(path, size)
    size += sum(file.stat().st_size for file in _references(path, includes))
    if find_spec("meshio") is None:  # of an extra
        raise FileError(
            f"{path} cannot be read without meshio", remedy="Install it: pip install 'dynid[laboratory]'."
        )
    seconds = trial.SECONDS + size / _MESH_BYTES_A_SECOND
    memory = min(_LEAST_MEMORY + _GROWTH * size, _MOST_MEMORY)
    try:
        target = archived(path, archive, FORMATS[path.suffix.lower()], seconds=seconds, memory=memory)
    except DiedError:
        raise FileError(
            f"{path} cannot be read: meshio crashes, or takes over {seconds:.0f} s or {memory / 2**30:.1f} "
            "GiB",
            remedy="It may be damaged; save it again.",
        ) from None
    with np.load(target, allow_pickle=False) as stored:
        if "problem" in stored:
            raise FileError(f"{path} is no mesh that meshio reads: {stored['problem']}")
        index = json.loads(str(stored["index"]))
        kinds = index["kinds"]
        cells = tuple((kind, stored[f"cells{k}"]) for k, kind in enumerate(kinds))
        groups = {
            name: tuple(stored[f"group{g}_{k}"] for k in range(len(kinds)))
            for g, name in enumerate(index["groups"])
        }
        sets = {name: stored[f"set{k}"] for k, name in enumerate(index["sets"])}
        return MeshData(stored["points"], None, cells, groups, sets)


def _check_counts(path: Path, size: int) -> None:
    pattern, bytes_each = _COUNTS.get(path.suffix.lower(), (None, 1))
    if pattern is None:
        return
    with path.open("rb") as stream:
        start = stream.read(_START)
    for match in pattern.finditer(start):
        for count in match.groups():
            if count is not None:
                check_count(path, int(int(count) * bytes_each), "points or cells", size)


def _references(path: Path, includes: Sequence[Path]) -> list[Path]:
    """Return the files with the numbers of a mesh, which the scene names; entities of XML are refused."""
    if path.suffix.lower() not in _MARKUP:
        _check_hdf5(path)
        return []
    content = path.read_bytes()
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise FileError(f"{path} defines entities of XML, which are not read")
    if path.suffix.lower() == ".vtu":
        return []
    files: dict[Path, None] = {}
    for attributes, text in _DATA_ITEM.findall(content.decode("utf-8", errors="replace")):
        form = re.search(r"\bFormat\s*=\s*[\"'](\w+)", attributes)
        shape = re.search(r"\bDimensions\s*=\s*[\"']([\d\s]+)", attributes)
        count = int(np.prod([int(n) for n in shape[1].split()], dtype=object)) if shape else 0
        if form is None or form[1] == "XML":
            check_count(path, count, "numbers", len(text))
        elif form[1] != "HDF" or ":" not in text:
            raise FileError(
                f"{path} has its numbers in '{text.strip()[:80]}' as {form[1]}, which is not read",
                remedy="Write it with its numbers as HDF or XML.",
            )
        else:
            name, _, dataset = text.strip().partition(":")
            file = check_reference(path, name, includes)
            files[file] = None
            _check_dataset(path, file, dataset)
    return list(files)


def _check_dataset(path: Path, file: Path, dataset_path: str) -> None:
    if not file.is_file():
        raise FileError(f"{path} has its numbers in {file}, which is no file")
    try:
        with open_hdf5(file) as store:
            dataset = inside(store, dataset_path)
            if dataset is None:
                raise FileError(f"{path} has its numbers in {file}, which has no dataset '{dataset_path}'")
            check_stored(dataset)
    except (OSError, Refused) as error:
        raise FileError(f"{file} cannot be read: {error}") from None


def _check_hdf5(path: Path) -> None:
    """Refuse a file of HDF5 whose values are in other files, or claim more than it stores."""
    with path.open("rb") as stream:
        if not stream.read(8).startswith(b"\x89HDF"):
            return
    try:
        with open_hdf5(path) as store:
            check_all_stored(store)
    except (OSError, Refused) as error:
        raise FileError(f"{path} cannot be read: {error}") from None


def archive(path: str, target: str, form: str) -> None:
    """Write the mesh of a file, or why there is none, into a NumPy archive; what meshio prints is dropped."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import meshio

            mesh = meshio.read(path, form)
            _write(mesh, target)
    except MemoryError:
        np.savez(target, problem="it claims more than the memory")
    except (Exception, SystemExit) as error:  # readers of many formats fail in many ways; meshio may exit
        reason = next((line for line in reversed(said.getvalue().splitlines()) if line.strip()), "")
        reason = str(error) if not isinstance(error, SystemExit) and str(error) else reason
        np.savez(target, problem=" ".join(reason.split())[:200] or type(error).__name__)


def _write(mesh: meshio.Mesh, target: str) -> None:
    groups = _groups(mesh)
    arrays: dict[str, Any] = {"points": np.asarray(mesh.points, dtype=float)}
    for k, block in enumerate(mesh.cells):
        cells = np.asarray(block.data)
        if cells.dtype.kind not in "iu":
            raise ValueError(f"it has elements of the kind {block.type} with different numbers of nodes")
        arrays[f"cells{k}"] = cells.astype(np.intp).reshape(len(cells), -1 if len(cells) else 1)
    for g, parts in enumerate(groups.values()):
        arrays |= {f"group{g}_{k}": rows for k, rows in enumerate(parts)}
    arrays |= {f"set{k}": members(nodes) for k, nodes in enumerate(mesh.point_sets.values())}
    kinds = [block.type for block in mesh.cells]
    index = {"kinds": kinds, "groups": [*groups], "sets": [str(name) for name in mesh.point_sets]}
    np.savez(target, index=json.dumps(index), **arrays)


def _groups(mesh: meshio.Mesh) -> dict[str, list[Places]]:
    """Return the groups of cells of all dimensions by name: for each block of cells the places in it."""
    groups: dict[str, list[Places]] = {}
    tagged = ((name, value) for name, value in mesh.field_data.items() if np.shape(value) == (2,))
    names = {(int(tag), int(dimension)): name for name, (tag, dimension) in tagged}

    def add(name: str, at: int, rows: Any) -> None:
        parts = groups.setdefault(name, [members(()) for _ in mesh.cells])
        parts[at] = members([*parts[at], *rows])

    for name, parts in mesh.cell_sets.items():
        for at, rows in enumerate(parts if name != _ADDED else ()):
            if rows is not None and len(rows):
                add(name, at, rows)
    for data in _TAGS:
        for at, tags in enumerate(mesh.cell_data.get(data, ())):
            for tag in np.unique(tags):
                name = names.get((int(tag), mesh.cells[at].dim), str(tag))
                if tag:  # 0: of no group
                    add(name, at, np.flatnonzero(tags == tag))
    return groups
