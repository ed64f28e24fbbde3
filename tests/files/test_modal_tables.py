"""Tables of measured modes: units of their columns, and values that are none of modes."""

import math

import numpy as np
import pytest

from dynid.errors import FileError
from dynid.files.read_measured import read_modes

pytestmark = pytest.mark.usefixtures("untried")

PLACE = "measurement.modes.file"


@pytest.fixture
def read(tmp_path):
    """Write a text file and return the modes in it."""

    def modes(text, **names):
        (tmp_path / "modes.csv").write_text(text, encoding="utf-8")
        return read_modes(tmp_path / "modes.csv", names, PLACE)

    return modes


@pytest.mark.parametrize(
    ("names", "units", "frequency", "unit"),
    [
        ("frequency [Hz]", "", 10.2, "Hz"),
        ("frequency (Hz)", "", 10.2, "Hz"),
        ("frequency [kHz]", "", 10_200.0, "Hz"),
        ("frequency [rad/s]", "", 10.2, "rad/s"),
        ("frequency / rpm", "", 10.2 * math.pi / 30, "rad/s"),
        ("frequency", "", 10.2, ""),
        ("frequency [-]", "", 10.2, ""),
        ("frequency", "Hz,-,-\n", 10.2, "Hz"),
        ("frequency", "kHz,%,mm\n", 10_200.0, "Hz"),
    ],
)
def test_frequencies_are_in_the_unit_that_the_file_states(read, names, units, frequency, unit):
    found = read(f"{names},damping,1\n{units}10.2,0.015,1\n")
    assert found.unit == unit
    np.testing.assert_allclose(found.frequency, [frequency], rtol=1e-15)
    np.testing.assert_allclose(found.damping, [0.00015 if "%" in units else 0.015], rtol=1e-15)
    assert found.dofs == [1]


def test_scatter_is_in_its_own_unit_or_in_that_of_its_quantity(read):
    found = read("frequency [Hz],frequency_std [mHz],damping [%],damping_std\n10.2,20,1.5,0.3\n")
    np.testing.assert_allclose(found.frequency_std, [0.02], rtol=1e-15)
    np.testing.assert_allclose([found.damping, found.damping_std], [[0.015], [0.003]], rtol=1e-15)
    found = read("frequency [rad/s],frequency_std [Hz]\n60,0.1\n")
    np.testing.assert_allclose(found.frequency_std, [0.2 * math.pi], rtol=1e-15)
    found = read("f [kHz],s\n0.01,0.001\n", frequency="f", frequency_std="s")
    np.testing.assert_allclose([found.frequency, found.frequency_std], [[10.0], [1.0]], rtol=1e-15)
    found = read("eigenvalue [rad2/s2],eigenvalue_std\n3600,60\n")
    np.testing.assert_allclose([found.frequency, found.frequency_std], [[60.0], [0.5]], rtol=1e-15)


def test_components_of_shapes_in_different_units_are_converted(read):
    found = read("frequency [Hz],1 [mm],std 1,2 [m],3:rz [rad],std 3:rz [mrad]\n9,5,2,1,0.5,3\n")
    np.testing.assert_allclose(found.shape[:, 0], [5e-3, 1.0, 0.5], rtol=1e-15)
    np.testing.assert_allclose(found.shape_std[:, 0], [2e-3, np.nan, 3e-3], rtol=1e-15)
    assert found.dofs == [1, 2, "3:rz"]
    found = read("frequency [Hz],1 [g],2 [m/s2]\n9,1,1\n")
    np.testing.assert_allclose(found.shape[:, 0], [9.80665, 1.0], rtol=1e-15)
    found = read("frequency [Hz],1 [1/sqrt(kg)],2 [1/sqrt(kg)]\n9,0.5,1\n")  # the scale of a shape is any
    np.testing.assert_array_equal(found.shape[:, 0], [0.5, 1.0])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("frequency [kg],1\n1,1\n", "'frequency': the unit kg does not fit: the frequency is in Hz or rad/s"),
        ("frequency [foo],1\n1,1\n", "'frequency': 'foo' is no unit; units that fit: Hz, rad/s"),
        ("frequency [Hz],frequency_std [%]\n1,1\n", "'frequency_std': the unit % does not fit"),
        ("frequency,frequency_std [Hz]\n1,1\n", "has 'frequency_std' in Hz, but 'frequency' without a unit"),
        (
            "frequency [Hz],damping [Hz]\n1,1\n",
            "'damping': the unit Hz does not fit: a damping ratio is in 1",
        ),
        ("eigenvalue [Hz],1\n1,1\n", "'eigenvalue': the unit Hz does not fit: an eigenvalue is in rad2/s2"),
        ("frequency [Hz],1 [g],2 [mm]\n1,1,1\n", "has shapes in g, mm, which are not one motion"),
        ("frequency [Hz],1 [mm],2\n1,1,1\n", "has shapes in mm, no unit, which are not one motion"),
        (
            "frequency [Hz],damping\n1,0.5\n2,1.5\n",
            "mode 2 has the damping ratio 1.5. A ratio is from 0 to 1",
        ),
        ("frequency [Hz],damping\n1,-0.01\n", "mode 1 has the damping ratio -0.01"),
    ],
)
def test_other_units_and_ratios_are_refused(read, text, said):
    with pytest.raises(FileError) as caught:
        read(text)
    assert said in str(caught.value)
    assert caught.value.names == (f"{PLACE}.path",)


def test_damping_ratios_of_matlab_files_are_ratios(tmp_path):
    from scipy.io import savemat

    savemat(tmp_path / "x.mat", {"frequency": np.array([9.0, 12.0]), "damping": np.array([np.nan, 2.0])})
    with pytest.raises(FileError, match="mode 2 has the damping ratio 2"):
        read_modes(tmp_path / "x.mat", {}, PLACE)


@pytest.fixture
def stored(tmp_path):
    """Write a MATLAB file of two modes and return the modes in it."""
    from scipy.io import savemat

    def modes(names=(), **variables):
        given = {"frequency": np.array([9.0, 12.0]), **variables}
        savemat(tmp_path / "x.mat", {name: value for name, value in given.items() if value is not None})
        return read_modes(tmp_path / "x.mat", dict(names), PLACE)

    return modes


def test_the_mean_of_tests_scatters_less_than_one(stored):
    """By the root of their number, which is that of each mode, or of each value of a shape."""
    shape, tests = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[4.0, 9.0], [16.0, 1.0]])
    found = stored(
        shape=shape,
        shape_std=0.6 * shape,
        tests=tests,
        frequency_std=np.array([0.3, 0.4]),
        frequency_tests=np.array([9.0, 4.0]),
        dofs=np.array([3, 7]),
    )
    np.testing.assert_allclose(found.frequency_std, [0.1, 0.2], rtol=1e-15)
    np.testing.assert_allclose(found.shape_std, [[0.3, 0.4], [0.45, 2.4]], rtol=1e-15)
    assert list(found.dofs) == [3, 7]
    np.testing.assert_array_equal(stored(shape=shape, shape_std=shape, tests=4.0).shape_std, shape / 2)


def test_eigenvalues_of_a_matlab_file_are_squares_of_frequencies(stored):
    found = stored(
        {"eigenvalue": "lambda"},
        frequency=None,
        eigenvalue_std=np.array([3.0, 8.0]),
        **{"lambda": np.array([9.0, 16.0])},
    )
    np.testing.assert_array_equal(found.frequency, [3.0, 4.0])
    np.testing.assert_array_equal(found.frequency_std, [0.5, 1.0])
    assert found.unit == "rad/s"


SQUARE = np.ones((2, 2))


@pytest.mark.parametrize(
    ("variables", "said"),
    [
        ({"frequency": np.array([9.0, np.nan])}, "mode 2 has no frequency. Leave it out, or give it one."),
        ({"frequency_std": np.array([0.1, -0.1])}, "'frequency_std' is negative somewhere"),
        ({"frequency": None}, "has no variable 'frequency'; it has"),
        (
            {"frequency_tests": np.array([3.0, 0.0])},
            "an eigenvalue or a number of tests that is not positive",
        ),
        ({"shape": np.ones((2, 3))}, "'shape' has 3 columns, but there are 2 modes"),
        ({"shape": SQUARE, "shape_std": np.ones((3, 2))}, "'shape_std' is not as large as the shapes"),
        ({"shape": SQUARE, "shape_std": SQUARE, "tests": 0 * SQUARE}, "has a number of tests below 1"),
        (
            {"shape": SQUARE, "shape_std": SQUARE, "tests": np.ones((3, 2))},
            "'tests' has the shape (3, 2), the scatter (2, 2)",
        ),
    ],
)
def test_variables_of_a_matlab_file_that_make_no_sense_are_refused(stored, variables, said):
    with pytest.raises(FileError) as caught:
        stored(**variables)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1;2\n3;4\n", "has no header. The first line names the columns: frequency, damping, and DOFs."),
        ("damping,12\n0.1,1\n", "has no column 'frequency'; it has damping, 12. Name it: frequency: NAME."),
        ("frequency,12,std 13\n1,1,1\n", "has the scatter of '13', but no column '13'"),
    ],
)
def test_columns_that_are_missing_are_named(read, text, said):
    with pytest.raises(FileError) as caught:
        read(text)
    assert said in str(caught.value)
