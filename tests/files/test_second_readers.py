"""Public files of five formats, read as a second reader reads them."""

import struct
import wave
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from dynid.errors import FileError
from dynid.files.read_matrix import MatrixFile, read_matrix
from dynid.files.read_measured import read_columns
from dynid.files.read_structure import read_nodes
from dynid.structure.matrices import as_array

SHARED = Path(__file__).parents[3] / "shared" / "data"
SOUNDS = Path(scipy.io.__file__).parent / "tests/data"


def needed(path):
    if not path.is_file():
        pytest.skip(f"{path.name} is not here")
    return path


@pytest.mark.parametrize(
    "name",
    ["8000Hz-le-2ch-1byteu", "8000Hz-le-3ch-5S-24bit", "8000Hz-le-4ch-9S-12bit"],
)
def test_sounds(name):
    path = needed(SOUNDS / f"test-{name}.wav")
    with wave.open(str(path)) as sound:
        width, channels = sound.getsampwidth(), sound.getnchannels()
        frames = sound.readframes(sound.getnframes())
    pieces = [frames[k : k + width] for k in range(0, len(frames), width)]
    if width == 1:
        integers = [piece[0] - 128 for piece in pieces]
    else:
        integers = [int.from_bytes(piece, "little", signed=True) for piece in pieces]
    expected = np.array(integers).reshape(-1, channels) / 2 ** (8 * width - 1)
    columns = read_columns(path, None)
    np.testing.assert_allclose(columns.values, expected, rtol=0, atol=1e-12)
    assert columns.start == 0


@pytest.mark.parametrize("name", ["8000Hz-le-1ch-1byte-ulaw", "44100Hz-le-1ch-4bytes-early-eof"])
def test_sounds_that_are_refused(name):
    with pytest.raises(FileError, match=r"cannot be read as a WAV file: \S+"):
        read_columns(needed(SOUNDS / f"test-{name}.wav"), None)


def test_universal_files_of_text_and_of_bytes():
    text = needed(SHARED / "measured/Sample_UFF58_ascii.uff")
    lines = text.read_text(encoding="latin-1").splitlines()
    start = next(k for k, line in enumerate(lines) if line.strip() == "58") + 12
    end = next(k for k in range(start, len(lines)) if lines[k].strip() == "-1")
    expected = np.array(" ".join(lines[start:end]).split(), dtype=float)
    np.testing.assert_allclose(read_columns(text, None).values[:, 0], expected, rtol=1e-12)
    content = needed(SHARED / "measured/Sample_UFF58b_bin.uff").read_bytes()
    count = len(expected)
    stop = content.rindex(b"    -1") - content[: content.rindex(b"    -1")].endswith(b"\n")
    binary = np.array(struct.unpack(f"<{count}f", content[stop - 4 * count : stop]))
    columns = read_columns(SHARED / "measured/Sample_UFF58b_bin.uff", None)
    np.testing.assert_allclose(columns.values[:, 0], binary, rtol=1e-12)
    np.testing.assert_allclose(binary, expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())


def test_a_table_of_a_flexible_robot_arm():
    path = needed(SHARED / "measured/robot_arm.dat")
    np.testing.assert_array_equal(read_columns(path, None).values, np.loadtxt(path))


@pytest.mark.parametrize("name", ["bcsstk01", "bcsstk03", "bcsstm08"])
def test_matrices(name):
    path = needed(SHARED / f"fe/{name}.mtx")
    expected = scipy.io.mmread(path).toarray()
    np.testing.assert_array_equal(as_array(read_matrix(MatrixFile(path), "stiffness").matrix), expected)


def test_nodes_and_modes_of_exodus():
    path = needed(SHARED / "fe/block_a-eig.exo")
    file = read_nodes(path)
    with scipy.io.netcdf_file(path, mmap=False) as stored:
        xyz = np.column_stack([stored.variables[f"coord{axis}"][:] for axis in "xyz"])
        frequencies = stored.variables["time_whole"][:].copy()
    np.testing.assert_array_equal(file.nodes.xyz, xyz)
    assert file.modes is not None
    np.testing.assert_allclose(file.modes.frequencies, 2 * np.pi * frequencies, rtol=1e-12)
