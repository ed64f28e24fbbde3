"""Files of other formats are named by their content, with what to do, whatever their name and use."""
# ruff: noqa: E501 - a sort of file is a row of the table

import gzip
import io
import json
import pickle
import sqlite3
import struct
import tarfile
import wave
import zipfile

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from dynid.errors import FileError
from dynid.files.read_matrix import MatrixFile, read_matrix
from dynid.files.read_measured import read_columns
from dynid.files.read_mesh import read_mesh
from dynid.files.signatures import SIGNATURES, signature_of

pytestmark = pytest.mark.usefixtures("untried")


def _zip(*names, first=None):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name in names:
            archive.writestr(name, "x" * 5000)
        if first:
            archive.writestr("mimetype", first)
    return stream.getvalue()


def _ods():
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        archive.writestr("content.xml", "<office/>")
    return stream.getvalue()


def _tar():
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w") as archive:
        archive.addfile(tarfile.TarInfo("run.csv"))
    return stream.getvalue()


def _sqlite():
    base = sqlite3.connect(":memory:")
    base.execute("create table run (t real, a real)")
    content = base.serialize()
    base.close()
    return content


def _feather():
    pyarrow = pytest.importorskip("pyarrow")
    feather = pytest.importorskip("pyarrow.feather")
    stream = io.BytesIO()
    feather.write_feather(pyarrow.table({"a": [1.0, 2.0]}), stream)
    return stream.getvalue()


def _hdf5():
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        file["note"] = "nothing"
    return stream.getvalue()


def _matlab(**variables):
    stream = io.BytesIO()
    savemat(stream, variables)
    return stream.getvalue()


def _wav():
    stream = io.BytesIO()
    with wave.open(stream, "wb") as file:
        file.setparams((1, 2, 1000, 0, "NONE", ""))
        file.writeframes(b"\0\1" * 50)
    return stream.getvalue()


def _npz():
    stream = io.BytesIO()
    np.savez(stream, note="nothing")
    return stream.getvalue()


def _sac():
    words = [b"\0\0\0\0"] * 158
    words[76] = struct.pack("<i", 6)
    return b"".join(words) + struct.pack("<9f", *range(9))


def _ansys(number):
    header = struct.pack("<ii", 100, -(2**31)) + struct.pack("<100i", number, *range(99))
    return header + struct.pack("<i", 100)


def _d3plot():
    words = [0, 1, 0, 0, 0, 4] + [7] * 58
    return b"a crash test".ljust(40) + struct.pack("<64i", *words)


def _ole(name=""):
    start = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(1000)
    return start + name.encode("utf-16-le") + bytes(200)


RECORD, MATRICES, MESH = USES = ("record", "matrices", "mesh")
#: Ending, content, a part of what it is, and for each use a part of the remedy (default: what is read instead).
SORTS = [
    (".matlab", _matlab(K=np.eye(2)), "a MATLAB file", {RECORD: "Name it x.mat", MATRICES: "Name it x.mat"}),
    (".xls", _ole("Workbook"), "an Excel 97-2003 workbook", {RECORD: "--convert-to xlsx x.xls"}),
    (".doc", _ole(), "an OLE document", {}),
    (".ods", _ods(), "an OpenDocument spreadsheet", {RECORD: "--convert-to xlsx x.ods"}),
    (".docx", _zip("[Content_Types].xml", "word/document.xml"), "a Word document", {}),
    (".xlsx", _zip("[Content_Types].xml", "xl/workbook.xml"), "an Excel workbook", {RECORD: None}),
    (".slx", _zip("simulink/blockdiagram.xml"), "a Simulink model", {MATRICES: "linmod('x')"}),
    (".npz", _npz(), "a NumPy archive", {RECORD: None, MATRICES: None}),
    (".zip", _zip("run.csv"), "a zip archive", {RECORD: "unzip x.zip"}),
    (".gz", gzip.compress(b"1 2\n"), "a file compressed by gzip", {RECORD: "gunzip x.gz"}),
    (".bz2", b"BZh91AY&SY", "a file compressed by bzip2", {}),
    (".xz", b"\xfd7zXZ\0\0\4", "a file compressed by xz", {}),
    (".zst", b"\x28\xb5\x2f\xfd\x04", "a file compressed by Zstandard", {}),
    (".7z", b"7z\xbc\xaf\x27\x1c\0\4", "a 7-Zip archive", {}),
    (".tar", _tar(), "a tar archive", {RECORD: "tar xf x.tar"}),
    (".pdf", b"%PDF-1.7\n1 0 obj\n", "a PDF document", {RECORD: "export those behind it"}),
    (".png", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "a PNG picture", {}),
    (".jpg", b"\xff\xd8\xff\xe0\0\x10JFIF", "a JPEG picture", {}),
    (".gif", b"GIF89a\1\0\1\0", "a GIF picture", {}),
    (".svg", b'<?xml version="1.0"?>\n<svg width="3"/>', "an SVG picture", {}),
    (".html", b"<!DOCTYPE html>\n<html><table><tr><td>1</td></tr></table></html>", "a web page", {RECORD: "read_html"}),
    (".sqlite", _sqlite(), "an SQLite database", {RECORD: "sqlite3 -header -csv x.sqlite"}),
    (".feather", _feather, "an Arrow or Feather file", {RECORD: "to_parquet"}),
    (".feather1", b"FEA1" + bytes(40) + b"FEA1", "an Arrow or Feather file", {}),
    (".avro", b"Obj\x01\x04\x14avro.codec\x08null", "an Avro file", {RECORD: "fastavro.reader"}),
    (".pkl", pickle.dumps({"a": [1.0]}), "a pickle of Python", {RECORD: "runs code", MATRICES: "save_npz"}),
    (".pickle2", pickle.dumps([1.0], protocol=2), "a pickle of Python", {}),
    (".parquet", b"PAR1" + bytes(30) + b"PAR1", "a Parquet file", {RECORD: None}),
    (".fig", _matlab(hgS_070000=np.eye(2)), "a MATLAB figure", {RECORD: "findobj(openfig('x.fig')"}),
    (".octave", b"# Created by Octave 8.4.0\n# name: K\n# type: matrix\n", "an Octave text file", {MATRICES: "octave --eval"}),
    (".bin", b"Octave-1-L\0\1\0\0\0K", "an Octave binary file", {}),
    (".f06", b"1\n0      N A S T R A N    S Y S T E M\n", "printed output of Nastran", {MATRICES: "OUTPUT4"}),
    (".f06b", b"1       MSC.NASTRAN JOB\n N A S T R A N   E X E C\n", "printed output of Nastran", {}),
    (".pch", b"$TITLE   = RUN 1\n$SUBTITLE=\n$DISPLACEMENTS\n", "a punch file of Nastran", {MATRICES: None, MESH: None}),
    (".bdf", b"$ a model\nSOL 103\nCEND\nBEGIN BULK\nENDDATA\n", "Nastran bulk data", {MATRICES: None, MESH: None}),
    (".op4", b"       3       3       6       2KGG     1P,3E23.16\n", "a Nastran OUTPUT4 file", {MATRICES: None}),
    (".op2", struct.pack("<iiiiiii", 4, 3, 4, 28, 7, 28, 28) + b"NASTRAN FORT TAPE ID CODE - ", "a Nastran OUTPUT2 file", {MATRICES: None}),
    (".inp", b"** a model\n*HEADING\n a part\n*END\n", "an Abaqus or CalculiX input file", {MATRICES: "*MATRIX GENERATE", MESH: None}),
    (".fil", b"*I 18I 41921D 1.00\n", "an Abaqus results file", {MATRICES: "*MATRIX GENERATE"}),
    (".fil2", struct.pack("<iq", 4096, 9) + bytes(500), "an Abaqus results file", {}),
    (".odb", b"\x01\x02\xff\0binary", "an Abaqus output database", {MATRICES: "*MATRIX GENERATE"}),
    (".rst", _ansys(12), "a binary file of Ansys", {MATRICES: "the .full file"}),
    (".full", _ansys(4), "an Ansys .full file", {MATRICES: None}),
    (".cdb", b"/COM,ANSYS RELEASE 2023R1\n/PREP7\nNBLOCK,6,SOLID\n", "an Ansys archive", {MATRICES: "the .full file"}),
    (".d3plot", _d3plot(), "an LS-DYNA result", {MATRICES: "MTXDMP"}),
    (".k", b"$ a model\n*KEYWORD\n*NODE\n1, 0, 0, 0\n", "an LS-DYNA input file", {}),
    (".mo", b"within Lib;\nmodel Motor\n  Real x;\nequation\n der(x) = 1;\nend Motor;\n", "a Modelica model", {RECORD: 'outputFormat="csv"'}),
    (".unv", b"    -1\n    58\nFRF\n    -1\n", "a Universal File", {RECORD: None}),
    (".tdm", b'<?xml version="1.0"?>\n<usi:tdm xmlns:usi="x"/>', "a DIAdem header (TDM)", {RECORD: ".tdms"}),
    (".r64", b"DIAEXTENDED  {@:ENGLISH\n#BEGINGLOBALHEADER\n", "a DIAdem header (DAT)", {}),
    (".catman", struct.pack("<hi", 5012, 4711) + bytes(40), "an HBM catman file", {RECORD: "from catman"}),
    (".d7d", b"\x01\x02\xff\0binary", "a Dewesoft file", {RECORD: "from Dewesoft"}),
    (".dxd", b"\x01\x02\xff\0binary", "a Dewesoft file", {}),
    (".raw", b"|CF,2,1,1;|CK,1,3,1,1;\n|NO,1,86,0,78,imc STUDIO;", "an imc FAMOS file", {RECORD: "imc FAMOS"}),
    (".tdf", b"\x01\x02\xff\0binary", "a Simcenter Testlab file", {RECORD: "Universal File"}),
    (".ldsf", b"\x01\x02\xff\0binary", "a Simcenter Testlab file", {}),
    (".mseed", b"000001D ANMO 00BHZIU" + bytes(492), "a miniSEED record", {RECORD: "obspy.read"}),
    (".mseed3", b"MS\3\4" + bytes(60), "a miniSEED record", {}),
    (".sac", _sac(), "a SAC record", {RECORD: "obspy.read"}),
    (".edf", b"0       X X X X".ljust(256) + bytes(60), "a biosignal record", {RECORD: "pyedflib"}),
    (".flac", b"fLaC\0\0\0\x22", "a FLAC recording", {RECORD: "ffmpeg -i x.flac x.wav"}),
    (".mp3", b"ID3\4\0\0", "an MP3 recording", {RECORD: "with loss"}),
    (".ogg", b"OggS\0\2", "an Ogg recording", {}),
    (".json", json.dumps({"time": [0, 1], "a": [1, 2]}).encode(), "a JSON text", {RECORD: "read_json"}),
    (".toml", b'[run]\nstep = 0.01\n\n[run.sensor]\nname = "a"\n', "a TOML or INI text", {RECORD: "Records are read from CSV"}),
    (".yaml", b"# an example\ndynid: 1\nkind: bond-graph\n", "a scene of dynid", {RECORD: "dynid run x.yaml"}),
    (".xml", b'<?xml version="1.0"?>\n<data/>\n', "an XML text", {}),
    (".nc3", b"CDF\x01" + bytes(60), "a classic netCDF file", {RECORD: "nccopy -k nc4 x.nc3 x.h5"}),
    (".nc", _hdf5(), "an HDF5 file (netCDF-4 is one)", {RECORD: "Name it x.h5", MATRICES: "Name it x.h5"}),
    (".plt", b"#!TDV112\1\0\0\0", "a Tecplot file", {}),
    (".tec", b'TITLE = "run"\nVARIABLES = "t", "a"\n', "a Tecplot file", {RECORD: "as CSV"}),
    (".vtk", b"# vtk DataFile Version 3.0\nx\nASCII\n", "a VTK file", {MESH: None}),
    (".stl", b"solid part\n facet normal 0 0 1\n", "an STL surface", {MESH: "mesh its volume"}),
    (".step", b"ISO-10303-21;\nHEADER;\n", "a STEP model", {MESH: "gmsh -3 x.step -o x.msh"}),
    (".msh", b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n", "a gmsh mesh", {MESH: None}),
    (".wav", _wav()[:30], "a WAV file", {RECORD: None}),
    (".tdms", b"TDSm\x0e\0\0\0", "a TDMS file", {RECORD: None}),
    (".mf4", b"MDF     4.10    ", "an MDF file", {RECORD: None}),
    (".mtx", b"%%MatrixMarket matrix array real general\n1 1\n0\n", "a Matrix Market file", {MATRICES: None}),
]  # fmt: skip
READERS = {
    RECORD: lambda path: read_columns(path, None),
    MATRICES: lambda path: read_matrix(MatrixFile(path), "stiffness"),
    MESH: read_mesh,
}
INSTEAD = {RECORD: "Records are read from", MATRICES: "Matrices are read from", MESH: "Meshes are read from"}
#: Endings with which a reader of each use takes a file for one of its own.
DISGUISES = {RECORD: (".csv", ".mat"), MATRICES: (".mtx", ".mat"), MESH: (".msh", ".inp")}


def _refusal(reader, path):
    with pytest.raises(FileError) as raised:
        reader(path)
    return raised.value


#: asammdf leaves an exception in a destructor where a file of it is damaged.
@pytest.mark.parametrize(
    ("ending", "content", "what", "remedies"),
    [pytest.param(*sort, id=sort[0]) for sort in SORTS if sort[0] != ".mf4"],
)
def test_a_refused_file_is_named_with_what_to_do(ending, content, what, remedies, tmp_path):
    content = content() if callable(content) else content
    for use in USES:
        path = tmp_path / f"x{ending}"
        path.write_bytes(content)
        error = _refusal(READERS[use], path)
        if remedies.get(use, "") is None:  # a format that is read: its own reader says what is wrong
            assert f"is {what}, from which" not in error.problem
            continue
        assert f"is {what}" in error.problem, use
        assert remedies.get(use) or error.remedy
        assert remedies.get(use, "") in error.remedy
        assert str(tmp_path) not in error.remedy


@pytest.mark.parametrize(("ending", "content", "what", "remedies"), SORTS, ids=[sort[0] for sort in SORTS])
def test_the_content_counts_not_the_name(ending, content, what, remedies, tmp_path):
    content = content() if callable(content) else content
    (tmp_path / f"own{ending}").write_bytes(content)
    if isinstance(signature_of(tmp_path / f"own{ending}").mark, str):
        pytest.skip("a sort without a public mark")
    for use, endings in DISGUISES.items():
        for disguise in endings:
            path = tmp_path / f"x{disguise}"
            path.write_bytes(content)
            if disguise == ending or (disguise == ".mat" and "MATLAB" in signature_of(path).formats):
                continue
            error = _refusal(READERS[use], path)
            assert f"is {what}" in error.problem, (use, disguise)
            if remedies.get(use, "") is None:
                assert error.remedy.startswith("Name it x."), (use, disguise)


def test_every_row_of_the_table_is_met(tmp_path):
    met = set()
    for ending, content, _, _ in SORTS:
        path = tmp_path / f"x{ending}"
        path.write_bytes(content() if callable(content) else content)
        met.add(signature_of(path).what)
    rare = {
        "results of a Modelica simulation (MATLAB 4)",
        "a MATLAB 7.3 file",
        "a NumPy array",
        "a MATLAB file",
    }
    assert {signature.what for signature in SIGNATURES} - met <= rare


def test_results_of_modelica_are_refused_as_a_record(tmp_path):
    aclass = struct.pack("<5i", 51, 4, 11, 0, 7) + b"Aclass\0" + b"A" * 44
    (tmp_path / "x.mat").write_bytes(aclass)
    assert "results of a Modelica" in signature_of(tmp_path / "x.mat").what


@pytest.mark.parametrize(
    "text",
    [
        "time,a\n0,1\n1,x\n",  # a row that is no number
        "[Header]\nDate=2024\n\ntime;a\n0;1\n1;x\n",  # a logger's header above a table
        "{a} 1\n2 x\n",
        "TIME 1\n2 x\n",
        "1 2\n3\n",
        "",
    ],
)
def test_a_fault_of_a_table_stays_one_of_a_table(text, tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(text)
    assert signature_of(path) is None
    assert " is a" not in _refusal(READERS[RECORD], path).problem


@pytest.mark.parametrize(
    "content",
    [b"\n" * 70_000, b"[" * 70_000, b"$\n" * 35_000, b"a=b" + b"\n" * 70_000, b"<?xml" + b"<!--" * 9_000],
)
def test_no_content_makes_the_search_backtrack_for_long(content, tmp_path):
    path = tmp_path / "x.csv"  # a pattern that backtracks would take hours
    path.write_bytes(content + b"x")
    assert signature_of(path) is None or content.startswith(b"<?xml")
