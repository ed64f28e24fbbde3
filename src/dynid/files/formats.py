"""The file formats that are read: a module of this package each, and an entry of `FORMATS`.

What a file is follows from its ending, its first bytes, and what is read from it: `.dat` is a table of
columns, or Nastran bulk data where nodes are read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

from dynid.errors import FileError
from dynid.file_access import check_readable, supplied
from dynid.files import (
    bulk_data,
    exodus,
    fe_exports,
    frequency_responses,
    gmsh,
    hdf5_data,
    input_file,
    matlab,
    matrix_market,
    meshio_mesh,
    modal_tables,
    nastran_output,
    node_tables,
    numpy_arrays,
    program_meshes,
    text_table,
    universal_file,
    universal_geometry,
)
from dynid.files.frequency_responses import MeasuredResponses, ResponseLayout
from dynid.files.matrix_data import Container, ImportedMatrix
from dynid.files.mesh_data import MeshData
from dynid.files.modal_tables import ModalTable
from dynid.files.signatures import Use, signature_of
from dynid.files.table import ColumnRequest, DataFile, DataTable
from dynid.files.untrusted import read_errors
from dynid.structure.dof_order import NodeFile

if TYPE_CHECKING:
    from dynid.files.recordings import Recording

Content: TypeAlias = Literal["matrix", "matrices", "nodes", "mesh", "columns", "responses", "modes"]


@dataclass(frozen=True)
class FileFormat:
    """A file format and its readers, None of what its files do not hold."""

    name: str
    extensions: tuple[str, ...]
    #: Readers of the only matrix of a file, and of one of several.
    matrix: Callable[[Path], ImportedMatrix] | None = None
    matrices: Container | None = None
    #: Readers of the nodes of a structure, and of a mesh of solids, which may refer to other files.
    nodes: Callable[[Path], NodeFile] | None = None
    mesh: Callable[[Path, Sequence[Path]], MeshData] | None = None
    #: Reader of channels with clocks of their own.
    recording: Callable[[DataFile], Recording] | None = None
    #: Readers of measured data: columns of numbers, frequency responses, modes.
    columns: Callable[[DataFile, ColumnRequest], DataTable] | None = None
    responses: Callable[[DataFile, ResponseLayout], MeasuredResponses] | None = None
    modes: Callable[[DataFile, Mapping[str, str]], ModalTable] | None = None
    #: Function that recognises the first bytes of a file; default: the ending suffices.
    recognised: Callable[[bytes], bool] | None = None

    def naming_contents(self) -> FileFormat:
        """Return the format with readers whose errors say what a file of another format is."""
        readers = {content: getattr(self, content) for content in get_args(Content)}
        naming: dict[str, Any] = {
            content: Container(*(self._naming(content, part) for part in reader))
            if isinstance(reader, Container)
            else self._naming(content, reader)
            for content, reader in readers.items()
            if reader is not None
        }
        return replace(self, **naming)

    def _naming(self, content: Content, reader: Callable[..., Any]) -> Callable[..., Any]:
        alike: list[Content] = ["matrix", "matrices"] if content in ("matrix", "matrices") else [content]

        def read(file: Any, *arguments: Any) -> Any:
            try:
                return reader(file, *arguments)
            except FileError as error:
                path = getattr(file, "path", file)
                raise named_by_content(path, alike, error, [self.name]) from None

        return read


def _later(reference: str, *first: Any) -> Callable[..., Any]:
    """Return a function of this package, ``module:name``, with its first arguments; imported when called."""
    module, _, name = reference.partition(":")

    def call(*arguments: Any) -> Any:
        return getattr(import_module(f"dynid.files.{module}"), name)(*first, *arguments)

    return call


def _recorder(
    what: str, extensions: tuple[str, ...], recording: Callable[[DataFile], Recording], **readers: Any
) -> FileFormat:
    columns = _later("recordings:read", recording)
    return FileFormat(what, extensions, recording=recording, columns=columns, **readers)


TEXT_TABLE = FileFormat(
    "text table",
    (".csv", ".txt", ".dat"),
    columns=text_table.read_columns,
    responses=frequency_responses.from_text,
    modes=modal_tables.from_text,
)
"""The format of tables with any other ending."""

#: Of formats with the same ending and content the first that recognises a file reads it.
FORMATS: tuple[FileFormat, ...] = (
    FileFormat(
        "Matrix Market",
        (".mtx", ".out", ".txt", ".mmf"),
        matrix=matrix_market.read_matrix_market,
        recognised=matrix_market.has_banner,
    ),
    FileFormat("triplets", (".mtx",), matrix=matrix_market.read_triplets),
    FileFormat("rows of a matrix", (".out", ".txt", ".mmf"), matrix=matrix_market.read_rows),
    FileFormat("MATLAB script", (".m",), matrix=fe_exports.read_script),
    FileFormat("CalculiX matrix", (".sti", ".mas"), matrix=fe_exports.read_calculix),
    FileFormat(
        "Harwell-Boeing",
        (".hb", ".rb", ".rsa", ".rua", ".matrix", ".hbmat"),
        matrix=fe_exports.read_harwell_boeing,
    ),
    FileFormat(
        "MATLAB 7.3",
        (".mat",),
        matrices=hdf5_data.MATRICES,
        nodes=node_tables.read_from(hdf5_data.MATRICES),
        recording=hdf5_data.recording,
        columns=hdf5_data.read_columns,
        recognised=matlab.is_hdf5,
    ),
    FileFormat(
        "MATLAB",
        (".mat",),
        matrices=matlab.MATRICES,
        nodes=node_tables.read_from(matlab.MATRICES),
        recording=matlab.recording,
        columns=matlab.read_columns,
        responses=frequency_responses.from_matlab,
        modes=modal_tables.from_matlab,
    ),
    _recorder("NumPy", (".npz", ".npy"), numpy_arrays.recording, matrices=numpy_arrays.MATRICES),
    _recorder("TDMS", (".tdms",), _later("recorder_files:recording", "tdms")),
    _recorder("MDF", (".mf4", ".mdf"), _later("recorder_files:recording", "mf4")),
    _recorder("WAV", (".wav",), _later("recorder_files:recording", "wav")),
    _recorder("Parquet", (".parquet", ".pq"), _later("recorder_files:recording", "parquet")),
    FileFormat("workbook", (".xlsx", ".xlsm"), columns=_later("spreadsheet:read_columns")),
    FileFormat(
        "HDF5",
        (".h5", ".hdf5"),
        matrices=hdf5_data.MATRICES,
        nodes=node_tables.read_from(hdf5_data.MATRICES),
        recording=hdf5_data.recording,
        columns=hdf5_data.read_columns,
        responses=frequency_responses.from_hdf5,
        modes=modal_tables.from_hdf5,
    ),
    FileFormat(
        "Ansys .full",
        (".full",),
        matrices=Container(_later("ansys_full:members"), _later("ansys_full:load")),
    ),
    FileFormat("Nastran OUTPUT4", (".op4",), matrices=nastran_output.OUTPUT4),
    FileFormat(
        "Nastran OUTPUT2", (".op2",), matrices=nastran_output.OUTPUT2, nodes=nastran_output.read_nodes
    ),
    FileFormat(
        "Nastran bulk data",
        (".bdf", ".dat", ".nas", ".pch", ".asm", ".fem"),
        matrices=bulk_data.MATRICES,
        nodes=bulk_data.read_nodes,
        mesh=program_meshes.read_nastran,
    ),
    FileFormat(
        "Abaqus or CalculiX input file",
        (".inp",),
        nodes=input_file.read_nodes,
        mesh=program_meshes.read_abaqus,
    ),
    FileFormat(
        "Exodus",
        (".exo", ".e", ".g", ".ex2", ".exii"),
        nodes=exodus.read_nodes,
        mesh=meshio_mesh.read_foreign,
    ),
    FileFormat("table of nodes", (".csv",), nodes=node_tables.read_table),
    FileFormat("gmsh", (".msh",), mesh=gmsh.read_gmsh),
    FileFormat("mesh of another program", (*meshio_mesh.FORMATS,), mesh=meshio_mesh.read_foreign),
    FileFormat(
        "Universal File",
        universal_file.EXTENSIONS,
        nodes=universal_geometry.read_nodes,
        columns=universal_file.read_columns,
        responses=frequency_responses.from_universal,
        modes=modal_tables.from_universal,
    ),
    TEXT_TABLE,
)

#: Arrays that Python code supplies in place of a file of any name.
_ARRAYS = _recorder(
    "arrays",
    (),
    _later("supplied_arrays:recording"),
    matrices=Container(_later("supplied_arrays:members"), _later("supplied_arrays:load")),
    responses=frequency_responses.from_arrays,
)

_USES: dict[Content, Use] = {"matrix": "matrices", "matrices": "matrices", "nodes": "mesh", "mesh": "mesh"}
_PLURAL = {"matrix": "matrices", "mesh": "meshes", "record": "records"}


def format_of(path: Path, *contents: Content, names: Sequence[str] = ()) -> FileFormat:
    """Return the format of a file from which one of some contents is read.

    `names` are the keys of the scene that name the file, for errors. Its readers say what a file is that they
    refuse, where its content shows that it is of another format.
    """
    if supplied(path) is not None and any(getattr(_ARRAYS, content) for content in contents):
        return _ARRAYS
    holding = _holding(contents)
    formats = [form for form in holding if path.suffix.lower() in form.extensions]
    if not formats and TEXT_TABLE in holding:
        formats = [TEXT_TABLE]
    if not formats:
        error = FileError(
            f"{path} is no file of {_PLURAL.get(contents[0], contents[0])} that is read",
            remedy=f"Those end in {', '.join(endings_of(*contents))}.",
            names=names,
        )
        raise named_by_content(path, contents, error)
    check_readable(path, names)
    with read_errors(path, formats[-1].name), path.open("rb") as stream:
        start = stream.read(1024)
    form = next(form for form in formats if form.recognised is None or form.recognised(start))
    return form.naming_contents()


def named_by_content(
    path: Path, contents: Sequence[Content], error: FileError, formats: Sequence[str] = ()
) -> FileError:
    """Return the error of a refused file, which says what the file is if it is of none of some formats."""
    signature = signature_of(path)
    if signature is None or {*formats} & {*signature.formats}:
        return error
    readable = [form for form in _holding(contents) if form.name in signature.formats]
    use = _USES.get(contents[0], "record")
    problem, remedy = f"{path} is {signature.what}", f"Name it {path.stem}{signature.ending}."
    if path.suffix == signature.ending or not any(signature.ending in form.extensions for form in readable):
        problem += f", from which no {_PLURAL.get(use, use)} are read"
        remedy = signature.remedy(use, path)
    return FileError(problem, remedy=remedy, names=error.names)


def reader_of(path: Path, content: Content, names: Sequence[str] = ()) -> Any:
    """Return the reader of one content of a file, as of `FileFormat`; `names` as of `format_of`."""
    return getattr(format_of(path, content, names=names), content)


def endings_of(*contents: Content) -> list[str]:
    """Return the endings of the files from which one of some contents is read."""
    return list(dict.fromkeys(ending for form in _holding(contents) for ending in form.extensions))


def _holding(contents: Sequence[Content]) -> list[FileFormat]:
    return [form for form in FORMATS if any(getattr(form, content) for content in contents)]
