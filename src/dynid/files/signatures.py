"""What a file is by its content, and what to do with one that is not read: one table for all readers."""
# ruff: noqa: E501 - a sort of file is a row of the table

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

Use: TypeAlias = Literal["record", "matrices", "mesh"]

INSTEAD: dict[Use, str] = {
    "record": "Records are read from CSV, XLSX, TDMS, MF4, WAV, Parquet, NumPy, HDF5, MATLAB and Universal Files.",
    "matrices": "Matrices are read from Matrix Market, MATLAB, NumPy, HDF5, Nastran OUTPUT4, OUTPUT2 and DMIG, "
    "Ansys .full and HBMAT, Abaqus, CalculiX and Harwell-Boeing files.",
    "mesh": "Meshes are read from gmsh, Abaqus, Nastran, Exodus, VTK, MED and other files of meshio.",
}
"""What is read for each use of a file."""

#: Bytes at the start and at the end of a file in which marks are looked for.
_HEAD, _TAIL = 4096, 65536


class Signature(NamedTuple):
    """A sort of file: what it is, its mark, the formats of dynid that read it, and conversions.

    `mark` is a regular expression (bytes) that matches from the start of the file, with the end of a longer
    file behind its first bytes; where a sort has no public mark, an ending with a dot. `ending` is one with
    which `formats` read it. `convert` is for every use that `record`, `matrices` and `mesh` have no sentence
    of their own for; {name} and {stem} are the file's.
    """

    what: str
    mark: bytes | str
    formats: tuple[str, ...] = ()
    ending: str = ""
    convert: str = ""
    record: str = ""
    matrices: str = ""
    mesh: str = ""

    def remedy(self, use: Use, path: Path) -> str:
        """Return how to convert a file for a use, or what is read in its place."""
        text = getattr(self, use) or self.convert or INSTEAD[use]
        return str(text.format(name=path.name, stem=path.stem))


_OFFICE = "Convert it: soffice --headless --convert-to xlsx {name}, or save it as .xlsx or CSV."
_NUMBERS = "It holds no numbers that can be read: export those behind it, as CSV, .xlsx or .mat."
_SURFACE = "It has a surface alone: mesh its volume (in gmsh), and save that as .msh."
_ABAQUS = "Have Abaqus write them: *MATRIX GENERATE, *MATRIX OUTPUT, FORMAT=COORDINATE."
_DYNA = "Have LS-DYNA write them: MTXDMP of *CONTROL_IMPLICIT_SOLVER, Harwell-Boeing."
_PREPROCESSOR = "Write the mesh as Nastran or Abaqus from the preprocessor."
_FREQUENCIES = (
    "For matrices, run the job again: Nastran with OUTPUT4 or EXTSEOUT(DMIGPCH) writes .op4 or .pch."
)
_TO_NPZ = 'In Python: numpy.savez("{stem}.npz", time=…, a1=…).'
_SOUND = "Convert it: ffmpeg -i {name} {stem}.wav"
_TEST = "Export it from there as a Universal File, .mat or CSV."
_HDF5 = ("HDF5", "MATLAB 7.3", "Exodus", "mesh of another program")
_MATLAB = ("MATLAB", "MATLAB 7.3")
_MESHIO = ("mesh of another program",)

#: The first that matches counts; those with endings alone are asked last.
SIGNATURES = (
    # documents, pictures, archives
    Signature("an Excel workbook", rb"PK\x03\x04.*xl/workbook", ("workbook",), ".xlsx"),
    Signature("an OpenDocument spreadsheet", rb"PK\x03\x04.*opendocument\.spreadsheet", (), "", _OFFICE),
    Signature("an Excel 97-2003 workbook", rb"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1.*W\0o\0r\0k\0b\0o\0o\0k\0", (), "", _OFFICE),
    Signature("an OLE document (Excel 97-2003, Word 97-2003 and others)", rb"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", (), "", _OFFICE),
    Signature("a Word document", rb"PK\x03\x04.*word/document", (), "", "Save its table as CSV or .xlsx."),
    Signature("a Simulink model", rb"PK\x03\x04.*simulink/", (), record="Simulate it, and save the signals: save('{stem}.mat', 't', 'y').",
              matrices="In MATLAB: [A, B, C, D] = linmod('{stem}'); save {stem}.mat A B C D, read by state_space."),
    Signature("a NumPy archive", rb"PK\x03\x04.*\.npy", ("NumPy",), ".npz"),
    Signature("a zip archive", rb"PK\x03\x04.*PK\x05\x06|PK\x05\x06", (), "", "Unpack it: unzip {name}"),
    Signature("a file compressed by gzip", rb"\x1f\x8b", (), "", "Unpack it: gunzip {name}"),
    Signature("a file compressed by bzip2", rb"BZh\d", (), "", "Unpack it: bunzip2 {name}"),
    Signature("a file compressed by xz", rb"\xfd7zXZ\0", (), "", "Unpack it: unxz {name}"),
    Signature("a file compressed by Zstandard", rb"\x28\xb5\x2f\xfd", (), "", "Unpack it: unzstd {name}"),
    Signature("a 7-Zip archive", rb"7z\xbc\xaf\x27\x1c", (), "", "Unpack it: 7z x {name}"),
    Signature("a tar archive", rb".{257}ustar", (), "", "Unpack it: tar xf {name}"),
    Signature("a PDF document", rb"%PDF-", (), "", _NUMBERS),
    Signature("a PNG picture", rb"\x89PNG\r\n", (), "", _NUMBERS),
    Signature("a JPEG picture", rb"\xff\xd8\xff", (), "", _NUMBERS),
    Signature("a GIF picture", rb"GIF8[79]a", (), "", _NUMBERS),
    Signature("an SVG picture", rb"\s*+(?:<\?xml[^>]*+>)?\s*+(?:<!--.*?-->\s*+)?(?:<!DOCTYPE svg[^>]*+>\s*+)?<svg", (), "", _NUMBERS),
    Signature("a web page (HTML), perhaps that of a failed download", rb"\s*(?i:<!doctype html|<html)", (),
              record='In Python: pandas.read_html("{name}")[0].to_csv("{stem}.csv", index=False).'),
    # data of programs
    Signature("an SQLite database", rb"SQLite format 3\0", (), "", 'sqlite3 -header -csv {name} "SELECT * FROM table_name" > {stem}.csv'),
    Signature("an Arrow or Feather file", rb"ARROW1|FEA1", (),
              record='In Python: pandas.read_feather("{name}").to_parquet("{stem}.parquet").'),
    Signature("an Avro file", rb"Obj\x01", (),
              record='In Python: pandas.DataFrame(fastavro.reader(open("{name}", "rb"))).to_csv("{stem}.csv", index=False).'),
    Signature("a pickle of Python", rb"\x80[\x02-\x05](?:\x95.{8}|[\]})(cKX}])", (),
              convert=f"Reading one runs code, so that none is read. {_TO_NPZ}",
              matrices='Reading one runs code, so that none is read. In Python: scipy.sparse.save_npz("{stem}.npz", K).'),
    Signature("a Parquet file", rb"PAR1", ("Parquet",), ".parquet"),
    Signature("a NumPy array", rb"\x93NUMPY", ("NumPy",), ".npy"),
    Signature("an Octave text file", rb"# Created by Octave", (), "", """Convert it: octave --eval "load('{name}'); save('-v7', '{stem}.mat')\""""),
    Signature("an Octave binary file", rb"Octave-1-[LB]", (), "", """Convert it: octave --eval "load('{name}'); save('-v7', '{stem}.mat')\""""),
    Signature("results of a Modelica simulation (MATLAB 4)", rb".{16}[\x01-\x40]\0\0\0Aclass\0", (),
              record='Simulate again with CSV: simulate({stem}, outputFormat="csv") in OpenModelica.'),
    Signature("a MATLAB figure", ".fig", _MATLAB, "", "In MATLAB: "
              "h = findobj(openfig('{name}'), 'Type', 'line'); t = h(1).XData; y = h(1).YData; save {stem}.mat t y."),
    Signature("a MATLAB file", rb"MATLAB 5\.0 MAT-file", _MATLAB, ".mat"),
    Signature("a MATLAB 7.3 file", rb"MATLAB 7\.3 MAT-file", (*_MATLAB, *_HDF5), ".mat"),
    Signature("an HDF5 file (netCDF-4 is one)", rb"\x89HDF\r\n\x1a\n", (*_HDF5, "MATLAB"), ".h5"),
    Signature("a classic netCDF file", rb"CDF[\x01\x02\x05]", ("Exodus", *_MESHIO), ".exo", "Convert it: nccopy -k nc4 {name} {stem}.h5"),
    Signature("a JSON text", rb'(?:\xef\xbb\xbf)?\s*(?:\{\s*"|\[\s*[\[{"\d-]).*[\]}]\s*\Z', (),
              record='In Python: pandas.read_json("{name}").to_csv("{stem}.csv", index=False).'),
    Signature("a scene of dynid", rb"(?:#[^\n]*\n|[ \t\r]*\n)*+dynid: *1\b", (), "", "Run it: dynid run {name}; its result, {stem}.h5, can be read."),
    Signature("a DIAdem header (TDM)", rb"\s*+(?:<\?xml[^>]*+>)?\s*+<usi:tdm", (), "", "Save it as .tdms in DIAdem."),
    Signature("a DIAdem header (DAT)", rb"DIAEXTENDED|DIAHEADER", (), "", "Save it as .tdms or CSV in DIAdem."),
    Signature("a VTK file", rb"# vtk DataFile|(?s:.{0,200}?)<VTKFile", _MESHIO, ".vtk"),
    Signature("an XML text", rb"(?:\xef\xbb\xbf)?\s*<\?xml"),
    # recorders
    Signature("a TDMS file", rb"TDSm", ("TDMS",), ".tdms"),
    Signature("an MDF file", rb"MDF     ", ("MDF",), ".mf4"),
    Signature("a WAV file", rb"RIFF.{4}WAVE", ("WAV",), ".wav"),
    Signature("an imc FAMOS file", rb"\|C[FK],", (), "", "Export it from imc FAMOS or imc STUDIO as MATLAB or CSV."),
    Signature("an HBM catman file", rb"[\x92-\x97]\x13.{2}\0\0", (), "", "Export it from catman as MATLAB or ASCII."),
    Signature("a miniSEED record", rb"(?:\d{6}[DRQM][ \0]|MS\x03)", (), record="In Python: t = obspy.read(\"{name}\")[0]; "
              'numpy.savez("{stem}.npz", time=t.times(), a1=t.data).'),
    Signature("a SAC record", rb".{304}(?:[\x06\x07]\0\0\0|\0\0\0[\x06\x07]).{324}", (),
              record='In Python: t = obspy.read("{name}")[0]; numpy.savez("{stem}.npz", time=t.times(), a1=t.data).'),
    Signature("a biosignal record (EDF or BDF)", rb"0       .{244}|\xffBIOSEMI", (),
              record='In Python: f = pyedflib.EdfReader("{name}"); numpy.savez("{stem}.npz", a1=f.readSignal(0)).'),
    Signature("a FLAC recording", rb"fLaC", (), record=_SOUND),
    Signature("an Ogg recording", rb"OggS", (), record=f"It is compressed with loss: record WAV. {_SOUND}"),
    Signature("an MP3 recording", rb"ID3[\x02-\x04]|\xff[\xfa\xfb\xf2\xf3]", (), record=f"It is compressed with loss: record WAV. {_SOUND}"),
    # finite elements
    Signature("a Universal File", rb"\s{0,4}-1[ \t\r]*\n\s*\d+b?\b", ("Universal File", *_MESHIO), ".unv"),
    Signature("a Nastran OUTPUT2 file", rb".{0,40}?NASTRAN FORT TAPE ID CODE", ("Nastran OUTPUT2",), ".op2"),
    Signature("a Nastran OUTPUT4 file", rb"\x18\0\0\0.{24}\x18\0\0\0|\s{0,8}\d{1,8} +-?\d{1,8} +\d+ +\d+[A-Z]", ("Nastran OUTPUT4",), ".op4"),
    Signature("printed output of Nastran (.f06)", rb"[\t\n\f\r -~]{0,3000}?N ?A ?S ?T ?R ?A ?N ", (), matrices=_FREQUENCIES,
              record="Punch the results (DISP(PUNCH) = ALL), and write them as a table."),
    Signature("a punch file of Nastran", rb"\$TITLE|(?:\$[^\n]*\n)*DMIG", ("Nastran bulk data",), ".pch"),
    Signature("Nastran bulk data", rb"(?:\$[^\n]*\n|[ \t\r]*\n)*+(?:SOL\b|CEND\b|BEGIN +BULK|NASTRAN\b|ASSIGN\b|ID +\w|INIT\b|GRID[*, ]|CORD\d|PARAM,|C(?:TETRA|HEXA|PENTA|QUAD4)[ ,*])",
              ("Nastran bulk data",), ".bdf", matrices=_FREQUENCIES),
    Signature("an LS-DYNA input file", rb"(?:\$[^\n]*\n|[ \t\r]*\n)*+\*KEYWORD", (), matrices=_DYNA,
              mesh=_PREPROCESSOR),
    Signature("an Abaqus or CalculiX input file", rb"(?:\*\*[^\n]*\n|[ \t\r]*\n)*+\*(?i:heading|node|part|include|parameter|assembly)", ("Abaqus or CalculiX input file",), ".inp",
              matrices=_ABAQUS),
    Signature("an Abaqus results file (.fil)", rb"\*I ?\d|\0\x10\0\0", (), matrices=_ABAQUS,
              record="Write a table in Abaqus/CAE: Report, XY."),
    Signature("an Ansys .full file", rb"\x64\0\0\0...\x80\x04\0\0\0", ("Ansys .full",), ".full"),
    Signature("a binary file of Ansys (.rst, .mode, .emat)", rb"\x64\0\0\0...\x80[\x02\x08-\x0d]\0\0\0", (), matrices="Take the .full file of the same job.",
              record="Write a table in Ansys: PRVAR with /OUTPUT.", mesh=_PREPROCESSOR),
    Signature("an Ansys archive (.cdb)", rb"\s*/(?:COM,|PREP7|BATCH).*", (), matrices="Take the .full file of the job.",
              mesh=_PREPROCESSOR),
    Signature("an LS-DYNA result (d3plot)", rb"[\x20-\x7e\0]{40}.{4}[\x01-\x05]\0\0\0.{12}[\x02-\x07]\0\0\0", (), record="Write a table in LS-PrePost: History, Save, CSV.",
              matrices=_DYNA),
    Signature("a gmsh mesh", rb"\$MeshFormat", ("gmsh",), ".msh"),
    Signature("an STL surface", rb"solid\b[^\n]*\n\s*facet|(?=.{84,})[^\n]{0,80}STL", (), mesh=_SURFACE),
    Signature("a STEP model", rb"ISO-10303-21;", (), mesh="Mesh it: gmsh -3 {name} -o {stem}.msh"),
    Signature("a Tecplot file", rb"#!TDV\d+|\s*(?i:TITLE\s*=|VARIABLES\s*=)", _MESHIO, record="Keep its rows of numbers, names above them, as CSV."),
    Signature("a Modelica model", rb"(?://[^\n]*\n|[ \t\r]*\n)*+[ \t]*+(?:within\b[^;]*+;\s*+)?(?:partial |encapsulated )?(?:model|package|class|block|connector|record|function) +\w+.*\bend +\w+ *;\s*\Z", (),
              record='Simulate it with CSV: simulate({stem}, outputFormat="csv") in OpenModelica.',
              matrices="Linearise it in OpenModelica: linearize({stem}), and save A, B, C in one .mat."),
    Signature("a Matrix Market file", rb"%%MatrixMarket", ("Matrix Market",), ".mtx"),
    Signature("a TOML or INI text", rb"(?=(?:.*\n)?\[[\w. \"-]+\][ \t\r]*\n)(?:.*\n)?(?:\[[\w. \"-]+\]|[\w.\"-]+ *= *[^\n]*)\s*\Z"),
    # sorts without a public mark
    Signature("an Abaqus output database", ".odb", (), record="Write a table in Abaqus/CAE: Report, XY.",
              matrices=_ABAQUS, mesh="Take the .inp file of the job."),
    *(Signature("a Dewesoft file", ending, (), "", "Export it from Dewesoft as MATLAB, Universal File or CSV.") for ending in (".d7d", ".dxd", ".d7z", ".dxz")),
    *(Signature("a Simcenter Testlab file", ending, (), "", _TEST) for ending in (".ldsf", ".lms", ".tdf")),
)  # fmt: skip


def signature_of(path: Path) -> Signature | None:
    """Return the sort of a file; None of one that cannot be read, or is of none that is known."""
    try:
        with path.open("rb") as stream:
            content = stream.read(_HEAD)
            size = stream.seek(0, 2)
            stream.seek(max(_HEAD, size - _TAIL))
            content += stream.read(_TAIL)
    except OSError:
        return None
    ending = path.suffix.lower()
    for signature in SIGNATURES:
        mark = signature.mark
        if mark == ending if isinstance(mark, str) else re.match(mark, content, re.DOTALL):
            return signature
    return None
