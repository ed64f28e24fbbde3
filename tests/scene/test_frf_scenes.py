"""Frequency response functions as scenes give them: simulated, or out of files of every format."""

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from dynid.errors import DynidError, UsageError
from dynid.report import figures
from dynid.scene.kinds.planning import run_plan
from dynid.scene.load import load_scene
from dynid.scene.run import run_scene
from tests.scene.example_scenes import faults_of
from tests.screens import lines

pytestmark = pytest.mark.usefixtures("untried")

HEAD = """\
dynid: 1
kind: identification
structure:
  lumped: {masses: [1, 2], links: [{dofs: [1], k: 300, c: 2}]}
joints:
  link: {dofs: [1, 2], k: {start: 100, true: 200}, c: {start: 2, true: 1}}
"""
MEASUREMENT = """\
measurement:
  channels:
    - {dof: 1, quantity: acceleration, reference: {dof: 2}}
    - {dof: 2, quantity: acceleration, reference: {dof: 2}}
"""
SIMULATED = (
    HEAD
    + MEASUREMENT
    + """\
  frf: {simulate: {lines: {start: 0.5, stop: 5, points: 91, scale: linear, unit: Hz},
                   noise_ratio: 0.02, seed: 3}}
"""
)
HERTZ = np.linspace(0.5, 5, 91)


def accelerances(hertz=HERTZ):
    """Return the exact responses of the scene (L x 2), by the formulas of two masses."""
    w = 2 * np.pi * hertz
    k, c = 200 + 1j * w, 300 + 2j * w
    z11, z22 = c + k - w**2, k - 2 * w**2
    det = z11 * z22 - k**2
    return -(w**2)[:, None] * np.column_stack([k, z11]) / det[:, None]


def run(tmp_path, text):
    (tmp_path / "x.yaml").write_text(text)
    return run_scene(load_scene(tmp_path / "x.yaml"))


def estimated(tmp_path, frf):
    """Run with responses out of a file; return the estimates."""
    result = run(
        tmp_path, f"{HEAD.replace(', true: 200', '').replace(', true: 1', '')}{MEASUREMENT}  frf: {frf}\n"
    )
    return result["identification/parameters/estimate"].data


def refusal(tmp_path, frf):
    with pytest.raises(DynidError) as error:
        estimated(tmp_path, frf)
    fault = load_scene(tmp_path / "x.yaml").locate(error.value)
    return f"{fault.line}:{fault.column}: {fault.message}"


def test_simulated_responses_need_no_file(tmp_path):
    result = run(tmp_path, SIMULATED)
    error = result["identification/parameters/error_percent"].data
    assert error.max() < 3
    measured = result["identification/measurement/measured"]
    assert measured.dims == ("omega", "channel")
    assert measured.units == "m/s2/N"
    noise = measured.data - accelerances()
    size = np.sqrt(np.mean(np.abs(noise) ** 2, axis=0))
    ratio = size / np.sqrt(np.mean(np.abs(accelerances()) ** 2, axis=0))
    assert ratio == pytest.approx([0.02, 0.02], rel=0.25)  # 182 draws
    assert result["identification/measurement/omega"].data == pytest.approx(2 * np.pi * HERTZ)
    assert result.attrs["seed"] == 3


def test_the_screen_says_lines_and_responses(tmp_path):
    said = "\n".join(lines(run(tmp_path, SIMULATED)))
    assert "91 lines, 0.5 … 5 Hz, of the frequency responses 1.acceleration/2, 2.acceleration/2" in said


def test_text_of_pairs(tmp_path):
    H = accelerances()
    table = np.column_stack([HERTZ, H[:, 0].real, H[:, 0].imag, H[:, 1].real, H[:, 1].imag])
    header = "frequency [Hz],H1 re,H1 im,H2 re,H2 im"
    np.savetxt(tmp_path / "h.csv", table, delimiter=",", header=header, comments="")
    for columns in ("", ", columns: [[H1 re, H1 im], [H2 re, H2 im]]", ", columns: [[2, 3], [4, 5]]"):
        found = estimated(tmp_path, f"{{file: {{path: h.csv{columns}}}, unit: Hz}}")
        assert found == pytest.approx([200, 1], rel=1e-10)


def test_text_of_complex_numbers(tmp_path):
    rows = [
        f"{f!r};({one});{two}".replace("j", "i")
        for f, (one, two) in zip(HERTZ.tolist(), accelerances(), strict=True)
    ]
    (tmp_path / "h.txt").write_text("\n".join(rows))
    assert estimated(tmp_path, "{file: {path: h.txt}, unit: Hz}") == pytest.approx([200, 1], rel=1e-10)


def test_hdf5(tmp_path):
    with h5py.File(tmp_path / "h.h5", "w") as store:
        store["omega"] = 2 * np.pi * HERTZ
        store["measured"] = accelerances()
        store["other/H1"], store["other/H2"] = accelerances().T
        store["other/f"] = HERTZ
    assert estimated(tmp_path, "{file: {path: h.h5}}") == pytest.approx([200, 1], rel=1e-10)
    named = "{file: {path: h.h5, columns: [other/H1, other/H2], frequency: other/f}, unit: Hz}"
    assert estimated(tmp_path, named) == pytest.approx([200, 1], rel=1e-10)


@pytest.mark.parametrize("packed", [False, True])
def test_matlab(tmp_path, packed):
    variables = {
        "H": accelerances(),
        "f": HERTZ,
        "re": accelerances().real[:, [0]],
        "im": accelerances().imag[:, 0],
    }
    savemat(tmp_path / "h.mat", variables, do_compression=packed)
    assert estimated(tmp_path, "{file: {path: h.mat, columns: [H]}, unit: Hz}") == pytest.approx(
        [200, 1], rel=1e-10
    )
    assert "has 1 frequency responses" in refusal(
        tmp_path, "{file: {path: h.mat, columns: [[re, im]]}, unit: Hz}"
    )


def test_rounding_is_no_ground_for_a_warning(tmp_path):
    rows = np.column_stack([HERTZ, *(part for H in accelerances().T for part in (H.real, H.imag))])
    np.savetxt(tmp_path / "h.csv", rows, delimiter=",", header="f [Hz],a,ai,b,bi", comments="")
    result = run(tmp_path, f"{HEAD}{MEASUREMENT}  frf: {{file: {{path: h.csv}}, unit: Hz}}\n")
    assert result["identification/parameters/estimate"].data == pytest.approx([200, 1], rel=1e-9)
    assert not any("Cramér–Rao bound" in said for said in result["identification/diagnostics/warnings"].data)


# pyuff leaves the files open that it writes in binary form.
leaks = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


@leaks
@pytest.mark.parametrize("binary", [0, 1])
def test_a_universal_file(tmp_path, binary):
    written(tmp_path / "h.uff", binary)
    assert estimated(tmp_path, "{file: {path: h.uff}}") == pytest.approx([200, 1], rel=1e-9)
    # Numbers count the frequency responses, coherences their own.
    told = estimated(tmp_path, "{file: {path: h.uff, columns: [1, 2], coherence: [1, 2], averages: 10}}")
    assert told == pytest.approx([200, 1], rel=1e-4)  # steps below a thousandth of a standard error are left


@leaks
def test_the_coherence_of_a_file_is_drawn_below_its_responses(tmp_path):
    written(tmp_path / "h.uff", 0)
    estimated(tmp_path, "{file: {path: h.uff, coherence: [1, 2], averages: 10}}")
    result = run_scene(load_scene(tmp_path / "x.yaml"))
    np.testing.assert_array_equal(result["identification/measurement/coherence"].data, np.full((91, 2), 0.99))
    (figure,) = (figure.draw() for figure in figures(result) if figure.name == "fit")
    assert [row[0].y.label for row in figure.rows if row[0].y.label == "coherence"] == ["coherence"] * 2
    assert sum(column.startswith("coherence ") for column in figure.table.columns) == 2


@leaks
def test_functions_of_a_universal_file_may_be_text_and_binary(tmp_path):
    for binary in (1, 0):
        written(tmp_path / "h.uff", binary, hertz=np.linspace(0.5, 5.0123456789, 91), spacing=0)
    # Uneven lines have six digits in text; those of the first function are taken.
    assert estimated(tmp_path, "{file: {path: h.uff, columns: [1, 4]}}") == pytest.approx([200, 1], rel=1e-9)


@leaks
def test_a_universal_file_says_what_its_functions_are(tmp_path):
    written(tmp_path / "h.uff", 0, ordinate=8)
    said = refusal(tmp_path, "{file: {path: h.uff}}")
    assert "function 1 is displacement over force" in said
    assert "Write quantity: displacement" in said


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ("{path: h.uff, deviation: [1, 2]}", "h.uff holds functions, no deviations. Give their coherence"),
        ("{path: h.uff, columns: [[1, 2]]}", "holds complex functions, no pairs of columns"),
        (
            "{path: h.uff, columns: [a function, 2]}",
            "has 2 frequency response 'a function'; there are 2: a function. Give",
        ),
        (
            "{path: h.uff, columns: [1, 3]}",
            "has no frequency response '3'; there are 2: a function. Give its number",
        ),
        ("{path: time.uff}", "holds no frequency response. Data sets 58 of function type 4 are read"),
        ("{path: mixed.uff}", "the function a function has other lines than the first"),
    ],
)
def test_functions_that_a_universal_file_has_not_are_named(tmp_path, file, said):
    written(tmp_path / "h.uff", 0)
    written(tmp_path / "mixed.uff", 0)
    written(tmp_path / "mixed.uff", 0, hertz=HERTZ + 1)
    text = (tmp_path / "h.uff").read_text()
    sets = text.split("    -1\n    -1\n")
    (tmp_path / "time.uff").write_text(f"{sets[0]}    -1\n")
    assert said in refusal(tmp_path, f"{{file: {file}}}")


def test_functions_are_chosen_by_their_numbers(tmp_path):
    """In another order than the sensors they are those of the other sensors."""
    written(tmp_path / "h.uff", 0)
    head = HEAD.replace(", true: 200", "").replace(", true: 1", "")
    swapped = (
        MEASUREMENT.replace("{dof: 1", "{dof: x").replace("{dof: 2, q", "{dof: 1, q").replace("x, q", "2, q")
    )
    found = run(tmp_path, f"{head}{swapped}  frf: {{file: {{path: h.uff, columns: [2, 1]}}}}\n")
    assert found["identification/parameters/estimate"].data == pytest.approx([200, 1], rel=1e-4)


def written(path, binary, ordinate=12, hertz=HERTZ, spacing=1):
    """Write both responses and their coherences as a Universal File, between data of other types."""
    pyuff = pytest.importorskip("pyuff", reason="pyuff is an extra")
    for kind, values in (
        (1, hertz),
        *((4, H) for H in accelerances(hertz).T),
        *((6, np.full(91, 0.99)),) * 2,
    ):
        data_set = pyuff.prepare_58(
            binary=binary,
            func_type=kind,
            rsp_node=1,
            rsp_dir=3,
            ref_node=2,
            ref_dir=3,
            data=values,
            x=hertz,
            id1="a function",
            rsp_ent_name="NONE",
            ref_ent_name="NONE",
            abscissa_spacing=spacing,
            abscissa_spec_data_type=18,
            ordinate_spec_data_type=ordinate,
            orddenom_spec_data_type=13,
            abscissa_inc=hertz[1] - hertz[0],
            abscissa_min=hertz[0],
        )
        pyuff.UFF(str(path)).write_sets(data_set, "add")


def hdf5(tmp_path, **datasets):
    """Write the responses with further datasets."""
    with h5py.File(tmp_path / "h.h5", "w") as store:
        for name, values in {"omega": 2 * np.pi * HERTZ, "measured": accelerances(), **datasets}.items():
            store[name] = values


def test_only_the_lines_of_a_band_count(tmp_path):
    spoilt = accelerances()
    spoilt[HERTZ < 1] = 99
    hdf5(tmp_path, measured=spoilt)
    assert estimated(tmp_path, "{file: {path: h.h5}, band: [6.29, 40]}") == pytest.approx([200, 1], rel=1e-10)
    assert "no line lies in the band" in refusal(tmp_path, "{file: {path: h.h5}, band: [50, 60]}")


def test_deviations_and_coherence_by_line(tmp_path):
    hdf5(tmp_path, sigma=np.full((91, 2), 0.01), gamma=np.full((91, 2), 0.9))
    for noise in ("deviation: [sigma]", "coherence: [gamma], averages: 20", "coherence: [gamma]"):
        found = estimated(
            tmp_path, f"{{file: {{path: h.h5, columns: [measured], frequency: omega, {noise}}}}}"
        )
        # Steps below a thousandth of a standard error are left.
        assert found == pytest.approx([200, 1], rel=1e-4)


def test_the_deviation_of_a_coherence_is_that_of_the_estimate(tmp_path):
    hdf5(tmp_path, gamma=np.full((91, 2), 0.9))
    text = HEAD + MEASUREMENT + "  frf: {file: {path: h.h5, coherence: [gamma], averages: 20}}\n"
    deviation = run(tmp_path, text)["identification/measurement/deviation"].data
    assert deviation == pytest.approx(np.abs(accelerances()) * np.sqrt(0.1 / 0.9 / 20))


@pytest.mark.parametrize("unit", ["", ", unit: Hz"])
def test_an_impossible_coherence_counts_only_in_the_band(tmp_path, unit):
    gamma = np.full((91, 2), 0.9)
    gamma[[2, 7], 1], gamma[88, 0], gamma[89, 0] = (1.04, 1.2), 0.0, -0.1
    hdf5(tmp_path, gamma=gamma)
    omega = HERTZ if unit else 2 * np.pi * HERTZ
    if unit:
        with h5py.File(tmp_path / "h.h5", "a") as store:
            store["omega"][...] = HERTZ
    low, high = omega[10], omega[80]
    frf = f"{{file: {{path: h.h5, coherence: [gamma], averages: 20}}, band: [{low}, {high}]{unit}}}"
    text = HEAD + MEASUREMENT + f"  frf: {frf}\n"
    result = run(tmp_path, text)
    warnings = result["identification/diagnostics/warnings"].data
    said = [str(warning) for warning in warnings if "coherence" in str(warning)]
    name = unit.rpartition(" ")[2] or "rad/s"
    assert said == [
        "outside the band h.h5 has a coherence that is not above 0 and at most 1: "
        f"1.04 at {omega[2]:.6g} {name}, 1.2 at {omega[7]:.6g} {name}, 0 at {omega[88]:.6g} {name}, "
        f"-0.1 at {omega[89]:.6g} {name}; these lines are not used"
    ]
    said = refusal(tmp_path, frf.replace(f"band: [{low}", f"band: [{omega[6]}"))
    assert f"at most 1: 1.2 at {omega[7]:.6g} {name}. Leave these lines out" in said


@pytest.mark.parametrize(
    ("frf", "said"),
    [
        ("{file: {path: none.h5}}", "is no file"),
        ("{file: {path: h.h5, columns: [measurd]}}", "did you mean 'measured'"),
        ("{file: {path: h.h5, columns: [first]}}", "has 1 frequency responses, 'channels' has 2"),
        ("{file: {path: h.h5, frequency: falling}}", "do not increase"),
        ("{file: {path: h.h5, coherence: [falling, falling]}}", "not above 0 and at most 1"),
        ("{file: {path: h.h5, deviation: [first, first]}}", "deviation must be real"),
        (
            "{file: {path: h.h5, columns: [endless]}}",
            "line 3: the response is infinite. Leave a line out, or",
        ),
        ("{file: {path: h.h5, columns: [measured], frequency: few}}", "has columns of different lengths"),
        ("{file: {path: h.h5, columns: [first, few]}}", "has columns of different lengths"),
        ("{file: {path: text.h5}}", "text.h5 cannot be read as HDF5"),
        (
            "{file: {path: h.mat}}",
            "has variables; none of them is known to be a response. Name them: columns",
        ),
        ("{file: {path: h.mat, columns: [g]}}", "has no variable 'g'; it has H, omega"),
        ("{file: {path: under.csv}}", "under.csv:2: '1_0i' is not a number"),
        ("{file: {path: h.csv}, unit: Hz}", "Real and imaginary parts stand by turns"),
        ("{file: {path: named.csv}, unit: Hz}", "no column of frequencies; it has a, b, c"),
        ("{file: {path: bad.csv}, unit: Hz}", "bad.csv:2: '1+' is not a number"),
    ],
)
def test_faults_of_files(tmp_path, frf, said):
    endless = accelerances()
    endless[2, 1] = np.inf
    falling = 1.0 + HERTZ[::-1]
    hdf5(tmp_path, first=accelerances()[:, 0], falling=falling, endless=endless, few=HERTZ[:9])
    savemat(tmp_path / "h.mat", {"H": accelerances(), "omega": HERTZ})
    (tmp_path / "under.csv").write_text("f,a,b\n1,1_0i,1\n")
    (tmp_path / "text.h5").write_text("f,a\n1,1\n")
    (tmp_path / "h.csv").write_text("f,a,b,c\n1,1,1,1\n2,2,2,2\n")
    (tmp_path / "named.csv").write_text("a,b,c\n1,1,1\n2,2,2\n")
    (tmp_path / "bad.csv").write_text("f,a,b\n1,1+,1\n")
    assert said in refusal(tmp_path, frf)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (", reference: {dof: 2}", "", "needs its reference: {dof: …}"),
        ("reference: {dof: 2}", "reference: {dof: 3}", "there is no DOF 3"),
        ("measurement:\n", "measurement:\n  step: 0.1\n", "'step' is that of a record of time"),
        (
            "measurement:\n",
            "estimator: {method: filter}\nmeasurement:\n",
            "is for records of time, not for 'frf'",
        ),
        ("measurement:\n", "excitation: {dof: 1, kind: step}\nmeasurement:\n", "says nothing beside 'frf'"),
        ("noise_ratio: 0.02", "noise_ratio: [1, 1, 1]", "'simulate.noise_ratio' has 3 entries"),
        (", true: 1}", "}", "needs the 'true' value"),
        ("  frf: {", "  frf: {band: [1, 2], ", "'band' and 'unit' are those of a 'file'"),
        ("  frf: {", "  records: [{samples: 4}]\n  frf: {", "stand alone"),
        ("start: 0.5, stop: 5", "start: 5, stop: 5", "the lines are all one frequency"),
        ("acceleration, ref", "acceleration, frame: absolute, ref", "a frequency response has no 'frame'"),
        ("scale: linear", "scale: wide", "scale"),
        ("{dof: 2}}", "{}}", "9:51: a reference is the 'dof' of a force, or the 'source' of a graph"),
        ("{dof: 2}}", "{dof: 2}, offset: 1}", "9:7: a frequency response has no 'offset'"),
        (
            "{dof: 2}}",
            "{dof: 2}, unit: m/s2}",
            "9:7: the unit m/s2 does not fit: this response is in (m/s2)/N or (m/s2)/(N.m)",
        ),
        (
            "  frf: {",
            "  noise: {kind: proportional, order: 3}\n  frf: {",
            "11:10: 'order' and 'correlated' are those of coloured noise",
        ),
        (
            "  frf: {",
            "  noise: {kind: coloured}\n  frf: {",
            "8:3: coloured noise is that of records of time; frequency responses have 'proportional'",
        ),
    ],
)
def test_faults_of_scenes(old, new, said):
    assert old in SIMULATED
    assert said in " ".join(faults_of(SIMULATED.replace(old, new)))


MEASURED = f"{HEAD}{MEASUREMENT}  frf: {{file: {{path: a.h5}}}}\n"


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        (
            "a.h5",
            "a.h5, deviation: [a], coherence: [b]",
            "11:15: the noise by line has either its 'deviation'",
        ),
        ("a.h5", "a.h5, averages: 3", "11:15: 'averages' are those of a 'coherence'"),
        ("file: {path: a.h5}", "band: [1, 2]", "11:8: frequency responses are either 'simulate'd or read"),
        ("a.h5}", "a.h5}, band: [2, 1]", "11:35: a band is [low, high], and low is not below high"),
        ("a.h5", "a.h5, columns: [1, 2, 3]", "8:3: 'columns' names 3, but 'channels' has 2"),
        ("a.h5}}", "a.h5, deviation: [a, b]}}\n  noise: 3", "8:3: the noise is given by line already"),
        (
            "a.h5}}",
            "a.h5, coherence: [a, b]}}\n  noise: {kind: proportional, ratio: 0.1}",
            "8:3: the noise follows from the 'coherence'; leave its 'kind' out",
        ),
        (MEASUREMENT, "measurement:\n", "8:3: a measurement needs the key 'channels'"),
    ],
)
def test_faults_of_responses_in_files_have_their_place(old, new, fault):
    assert old in MEASURED
    (found,) = faults_of(MEASURED.replace(old, new))
    assert found.startswith(fault)


def test_a_reference_belongs_to_a_frequency_response():
    record = "  step: 0.1\n  samples: 50\n  simulate: {seed: 1}\n"
    assert "there is no 'frf'" in " ".join(faults_of(HEAD + MEASUREMENT + record))


def test_a_plan_refuses_frequency_responses(tmp_path):
    (tmp_path / "x.yaml").write_text(SIMULATED)
    with pytest.raises(UsageError, match="a plan is for a record of time"):
        run_plan(load_scene(tmp_path / "x.yaml"))


def test_responses_and_what_can_be_told_beside_them(tmp_path):
    further = "identifiability: true\nanalysis: {frequency: {start: 1, stop: 20}}\n"
    result = run(tmp_path, SIMULATED + further)
    assert result["structure/frequency_response/input"].data.tolist() == ["2"]
    assert result["identification/identifiability/identifiable"].data.all()
    said = "\n".join(lines(result))
    assert "identifiability: Cramér–Rao bounds from the frequency responses at the true values" in said
    assert "state known" not in said
