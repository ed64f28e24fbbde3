"""Arrays in place of the files of a scene: the same results as with the files."""

from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csc_array

import dynid
from dynid.errors import FileError, NumericalError, UsageError
from dynid.file_access import supplying
from dynid.files.frequency_responses import ResponseLayout
from dynid.files.read_measured import read_responses

STEP, N = 0.002, 300
T = STEP * np.arange(N)

STRUCTURE = """
dynid: 1
kind: identification
structure: {lumped: {masses: [1.2, 0.8], links: [{dofs: [1], k: 1.5e4, c: 4}]}}
joints: {bolt: {dofs: [1, 2], k: {start: 0.9e4}, c: {start: 2}}}
"""
RECORD = (
    STRUCTURE
    + """
excitation: [{dof: 1, kind: file, path: logger.csv, column: force}]
measurement:
  step: 0.002
  samples: 300
  channels: [{dof: 2, quantity: acceleration}]
  file: {path: logger.csv, columns: [A3]}
"""
)
MATRICES = """
dynid: 1
kind: identification
structure: {matrices: {mass: {path: model.npz, name: M}, stiffness: K.mtx}}
analysis: {modes: {count: 2}}
"""
FRF = (
    STRUCTURE
    + """
measurement:
  frf: {file: {path: frf.csv, columns: [H]}, unit: Hz}
  noise: 1.0e-3
  channels: [{dof: 2, quantity: acceleration, reference: {dof: 1}}]
"""
)
M, K = np.diag([2.0, 1.0]), np.array([[3e4, -1e4], [-1e4, 1e4]])


@pytest.fixture
def written(tmp_path):
    def write(text):
        (tmp_path / "scene.yaml").write_text(text)
        return tmp_path / "scene.yaml"

    return write


@pytest.fixture(scope="module")
def columns():
    rng = np.random.default_rng(2)
    return {"time [s]": T, "A3 [g]": rng.standard_normal(N), "force": 5 * rng.standard_normal(N)}


def outcome(*arguments):
    """Return what a run estimates and measures; noise is no joint, and may be rejected."""
    try:
        result = dynid.run(*arguments)
    except NumericalError as error:
        result = error.result
    arrays = {path: np.asarray(result[path].data) for path in result}
    return {path: repr(a.tolist()) if a.dtype.kind == "O" else a.tobytes() for path, a in arrays.items()}


@pytest.mark.thorough
def test_columns_are_those_of_the_file(written, columns, tmp_path):
    scene = written(RECORD)
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
    supplied = outcome(scene, {"logger.csv": columns})
    (tmp_path / "logger.csv").write_text("\n".join(lines))
    assert supplied == outcome(dynid.load_scene(scene))
    # They count before a file of that name, and only in that run.
    halved = {**columns, "A3 [g]": columns["A3 [g]"] / 2}
    assert outcome(scene, {"logger.csv": halved}) != supplied
    assert outcome(scene) == supplied


def test_matrices_are_supplied_by_name_or_alone_full_or_sparse(written):
    scene = written(MATRICES)
    modes = dynid.run(scene, data={"model.npz": {"M": M, "other": K}, "K.mtx": csc_array(K)})
    expected = np.sqrt(np.linalg.eigvalsh(np.linalg.solve(np.sqrt(M), np.linalg.solve(np.sqrt(M), K).T)))
    path = next(path for path in modes if path.endswith("modes/omega") or path.endswith("modes/frequency"))
    np.testing.assert_allclose(modes[path].data, expected, rtol=1e-12)
    with pytest.raises(FileError, match="has no matrix 'M'; did you mean"):
        dynid.run(scene, data={"model.npz": {"m2": M}, "K.mtx": K})


def test_frequency_responses(written, tmp_path):
    f = np.linspace(5, 40, 60)
    stiffness = np.array([[2.5e4, -1e4], [-1e4, 1e4]])
    damping = np.array([[7.0, -3], [-3, 3]])
    inverse = [
        np.linalg.inv(stiffness + 1j * w * damping - w**2 * np.diag([1.2, 0.8])) for w in 2 * np.pi * f
    ]
    H = -((2 * np.pi * f) ** 2) * np.array(inverse)[:, 1, 0]
    H += 1e-3 * np.random.default_rng(4).standard_normal((60, 2)).view(complex)[:, 0]
    supplied = outcome(written(FRF), {"frf.csv": {"frequency": f, "H": H}})
    lines = [
        "frequency,H",
        *(f"{a!r},{b.real!r}{b.imag:+.17g}j" for a, b in zip(f.tolist(), H.tolist(), strict=True)),
    ]
    (tmp_path / "frf.csv").write_text("\n".join(lines))
    assert supplied == outcome(written(FRF))
    with supplying({tmp_path / "x.csv": {"frequency": f, "H": H, "G": 2 * H}}):  # by default all of them
        values = read_responses(tmp_path / "x.csv", ResponseLayout(), "").values
    np.testing.assert_array_equal(values, np.column_stack([H, 2 * H]))
    with pytest.raises(FileError, match="has no array 'H'; did you mean 'H1'"):
        dynid.run(written(FRF), {"frf.csv": {"frequency": f, "H1": H}})


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"loger.csv": {}}, "the scene names no file 'loger.csv'; did you mean 'logger.csv'?"),
        ({"x": {}}, "the scene names no file 'x'; it names logger.csv"),
        ({"logger.csv": {"A3": ["a", "b"]}}, "the data of 'logger.csv' have text in 'A3'"),
        ({"logger.csv": {"A3": np.zeros((2, 2, 2))}}, "have an array of 3 axes in 'A3'"),
        ({"logger.csv": {"A3": []}}, "the data of 'logger.csv' are empty in 'A3'"),
    ],
)
def test_what_is_no_data_of_the_scene_is_refused(written, data, message):
    with pytest.raises(UsageError) as caught:
        dynid.run(written(RECORD), data=data)
    assert message in str(caught.value)


def test_missing_columns_and_times_are_refused_as_those_of_files(written, columns):
    with pytest.raises(FileError, match="has no channel 'A3'"):
        dynid.run(written(RECORD), data={"logger.csv": {"force": columns["force"]}})
    late = {**columns, "time [s]": 2 * T}
    with pytest.raises(FileError, match=r"the times are 0\.004 s apart, but 'step' is 0\.002 s"):
        dynid.run(written(RECORD), data={"logger.csv": late})


def test_a_study_takes_no_arrays():
    study = Path(__file__).parents[1] / "configs/studies/beam_modes.yaml"
    with pytest.raises(UsageError, match="arrays are supplied to single scenes"):
        dynid.run(study, data={})
