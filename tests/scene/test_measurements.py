"""Measurements as scenes give them: several records, sensors, noise, holds."""

import numpy as np
import pytest

from dynid.errors import Diverged, DynidError, FileError, UsageError
from dynid.identification.records.measurement import Measurement, Simulation
from dynid.identification.systems.record_values import data, simulated
from dynid.lti.signals import Sampled
from dynid.scene.kinds.measurements import experiments
from dynid.scene.load import load_scene
from dynid.scene.run import run_scene
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.identification.cases import LOADS, suspension
from tests.scene.example_scenes import faults_of
from tests.scene.test_identification_scenes import SCENE as ONE
from tests.screens import lines

HEAD = ONE[: ONE.index("excitation:")]
RECORDS = """\
measurement:
  step: 0.01
  channels: [{dof: 2, quantity: velocity}]
  simulate: {noise_ratio: 0.05, seed: 1}
  records:
    - {samples: 100, excitation: {dof: 2, kind: sine, frequency: 3}}
    - samples: 150
      channels: [{dofs: [2, 1], quantity: displacement}, {dof: 1, quantity: acceleration}]
      excitation: [{dof: 1, kind: sine, frequency: 12}]
"""
SCENE = HEAD + RECORDS


def run(tmp_path, text):
    (tmp_path / "x.yaml").write_text(text)
    return run_scene(load_scene(tmp_path / "x.yaml"))


def test_records_share_what_they_do_not_say(tmp_path):
    result = run(tmp_path, SCENE)
    group = "identification/measurement"
    assert list(result[f"{group}/record_1/channel"].data) == ["2.velocity"]
    assert list(result[f"{group}/record_2/channel"].data) == ["2-1.displacement", "1.acceleration"]
    assert result[f"{group}/record_2/measured"].data.shape == (150, 2)
    assert list(result[f"{group}/record_2/excitation"].data) == ["1"]
    errors = result["identification/parameters/error_percent"].data
    bound = result["identification/parameters/cramer_rao"].data
    true = result["identification/parameters/true"].data
    assert np.all(errors / 100 * true < 4 * bound)


@pytest.mark.thorough
def test_a_shared_seed_counts_up(tmp_path):
    record = "    - {samples: 100, excitation: {dof: 2, kind: sine, frequency: 3}}\nderived: []\n"
    result = run(tmp_path, SCENE[: SCENE.index("    - samples")] + record)
    noise = [result[f"identification/measurement/record_{k}/measured"].data for k in (1, 2)]
    assert not np.allclose(*noise)


@pytest.mark.parametrize(
    ("right", "wrong", "fault"),
    [
        ("  step: 0.01\n", "", "8:3: record 1 of the measurement needs the key 'step'"),
        ("samples: 150", "sampels: 150", "13:7: 'sampels' is not a key of measurement.records.1; did you"),
        ("- samples: 150\n      ", "- ", "8:3: record 2 of the measurement needs the key 'samples'"),
        ("dofs: [2, 1]", "dofs: [2, 9]", "14:28: there is no DOF 9; the structure has 2"),
        ("dofs: [2, 1]", "dofs: [2, 2]", "14:18: a sensor between DOF 2 and itself measures nothing"),
        ("dofs: [2, 1]", "dofs: [2]", "14:25: 'dofs' has 1 entr"),
        ("dofs: [2, 1], ", "", "14:18: a sensor is at a 'dof', or between two 'dofs'"),
        ("{dof: 1, kind: sine", "{dof: 7, kind: sine", "15:26: there is no DOF 7; the structure has 2"),
        ("noise_ratio: 0.05", "noise_ratio: 0.05, noise: 1", "11:13: the noise has either a 'noise_ratio'"),
        ("noise_ratio: 0.05", "noise: [1, 2]", "8:3: 'simulate.noise' has 2 entries, but 'channels' has 1"),
        ("  step: 0.01\n", "  step: 0.01\n  noise: [1, 2]\n", "9:3: 'noise' has 2 entries, but 'channels'"),
        ("  step: 0.01\n", "  step: 0.01\n  noise: 0\n", "9:10: 0 is not positive"),
        (
            "    - {samples",
            "    - {file: {columns: [1]}, samples",
            "9:3: the file of record 1 of the measure",
        ),
    ],
)
def test_one_mistake_is_one_sentence_at_its_place(right, wrong, fault):
    assert right in SCENE
    found = faults_of(SCENE.replace(right, wrong, 1))
    assert len(found) == 1, found
    assert found[0].split(": ", 1)[1].startswith(fault.split(": ", 1)[1]), found


def test_the_excitation_of_a_single_record_stands_beside_it():
    text = ONE.replace("  step:", "  excitation: {dof: 2, kind: sine, frequency: 3}\n  step:")
    assert "stands beside 'measurement'" in faults_of(text)[0]


def test_records_out_of_files(tmp_path):
    for name, seed in (("a", 1), ("b", 2)):
        clean = data(
            suspension(), LOADS, Measurement(0.002, 300, (Channel(2, "velocity"),), Simulation(0.01, seed))
        )
        rows = np.column_stack([0.002 * np.arange(300), clean.values])
        np.savetxt(tmp_path / f"{name}.dat", rows, fmt="%.10g")
    scene = """\
dynid: 1
kind: identification
structure:
  lumped:
    masses: [2, 2, 1.5, 1, 1]
    links: [{dofs: [1], k: 2.0e4, c: 20}, {dofs: [1, 2], k: 3.0e4, c: 30}, {dofs: [4, 5], k: 2.0e4, c: 20}]
joints:
  upper: {dofs: [2, 3], k: {start: 1.0e4}, c: {start: 10}}
  lower: {dofs: [3, 4], k: 2.0e4, c: 20}
excitation: {dof: 5, kind: multisine, amplitude: [100, 100, 100], frequency: [70, 110, 250]}
measurement:
  step: 0.002
  samples: 300
  channels: [{dof: 2, quantity: velocity}]
  file: {time: 1, columns: [2]}
  records: [{file: {path: a.dat}}, {file: {path: b.dat}}]
"""
    result = run(tmp_path, scene)
    estimate = result["identification/parameters/estimate"].data
    np.testing.assert_allclose(estimate, [2e4, 20], rtol=0.02)
    (tmp_path / "b.dat").write_text("0 1\n0.002 nonsense\n")
    with pytest.raises(DynidError) as caught:
        run(tmp_path, scene)
    assert "b.dat:2: 'nonsense' is not a number" in str(caught.value)
    assert caught.value.names[0].startswith("measurement.records.1.file")


def test_noise_that_is_given_is_used(tmp_path):
    """Weights follow it, and so do the error bars: ten times the noise, ten times the standard error."""
    fixed = ONE.replace("  step", "  noise: {}\n  step").replace("noise_ratio: 0.05", "noise: 1e-4")
    small, large = (run(tmp_path, fixed.replace("{}", level, 1)) for level in ("1e-4", "1e-3"))
    errors = [result["identification/parameters/standard_error"].data for result in (small, large)]
    np.testing.assert_allclose(errors[1] / errors[0], 10, rtol=1e-6)
    np.testing.assert_allclose(
        small["identification/parameters/estimate"].data,
        large["identification/parameters/estimate"].data,
        rtol=1e-4,
    )
    assert small.value("identification/measurement/given_noise") == 1e-4
    assert small.value("identification/measurement/noise") == 1e-4


def test_every_channel_has_its_noise(tmp_path):
    text = ONE.replace("velocity}]", "velocity}, {dof: 1, quantity: velocity}]")
    result = run(tmp_path, text.replace("noise_ratio: 0.05", "noise: [0.01, 0.2]").replace("100", "2000"))
    seen = result["identification/diagnostics/residual_rms"].data
    np.testing.assert_allclose(seen, [0.01, 0.2], rtol=0.1)  # of 2000 samples: 1.6 % each


@pytest.mark.parametrize(
    ("hold", "bias"), [("zero", (0.1, 3)), ("linear", (0.005, 0.2)), ("spline", (0, 2e-3))]
)
def test_holds_bias_as_coarsely_as_they_follow_the_force(tmp_path, hold, bias):
    """A random force in the band of the modes, its samples all that the estimator sees; clean data."""
    text = f"""\
dynid: 1
kind: identification
structure:
  lumped:
    masses: [2, 2, 1.5, 1, 1]
    links:
      - {{dofs: [1], k: 2.0e4, c: 20}}
      - {{dofs: [1, 2], k: 3.0e4, c: 30}}
      - {{dofs: [4, 5], k: 2.0e4, c: 20}}
joints:
  upper: {{dofs: [2, 3], k: {{start: 1.9e4, true: 2.0e4}}, c: {{start: 18, true: 20}}}}
  lower: {{dofs: [3, 4], k: {{start: 1.9e4, true: 2.0e4}}, c: {{start: 18, true: 20}}}}
excitation: {{dof: 5, kind: random, amplitude: 100, seed: 3, band: [20, 260], hold: {hold}}}
measurement:
  step: 0.002
  samples: 600
  channels: [{{dof: 2, quantity: velocity}}, {{dof: 3, quantity: velocity}}]
  simulate: {{settle: 1}}
estimator: {{method: output-error}}
derived: []
"""
    error = run(tmp_path, text)["identification/parameters/error_percent"].data.max() / 100
    assert bias[0] <= error <= bias[1]


@pytest.mark.parametrize(
    "excitation",
    [
        "{base: acceleration, kind: multisine, amplitude: [9, 5], frequency: [4, 11]}",
        "{dof: 1, motion: displacement, kind: sine, amplitude: 0.01, frequency: 9}",
    ],
)
def test_motions_excite(tmp_path, excitation):
    text = ONE.replace("{dof: 2, kind: sine, frequency: 3}", excitation)
    frame = ", frame: absolute" if "base" in excitation else ""
    text = text.replace("quantity: velocity", f"quantity: acceleration{frame}").replace("0.05", "0.01")
    text += "analysis: {time: {stop: 1, step: 0.01}}\n"
    result = run(tmp_path, text.replace("samples: 100", "samples: 400"))
    errors = result["identification/parameters/error_percent"].data / 100
    true = result["identification/parameters/true"].data
    assert np.all(errors * true < 4 * result["identification/parameters/cramer_rao"].data)
    unit = result["identification/measurement/input"].units
    assert unit == ("m/s2" if "base" in excitation else "m")
    assert result["structure/time_response/input"].units == unit


@pytest.mark.parametrize(
    ("excitation", "fault"),
    [
        ("{base: acceleration, dof: 1, kind: sine, frequency: 3}", "the base moves, or a 'dof' does"),
        ("{base: jerk, kind: sine, frequency: 3}", "'base' cannot be 'jerk'; it is one of"),
        ("{motion: velocity, kind: sine, frequency: 3}", "this signal needs the 'dof' that it drives"),
    ],
)
def test_a_motion_has_one_place(excitation, fault):
    found = faults_of(ONE.replace("{dof: 2, kind: sine, frequency: 3}", excitation))
    assert len(found) == 1, found
    assert fault in found[0]


def test_bounds_and_priors_in_a_scene(tmp_path):
    known = "k: {start: 10, true: 20, min: 5, max: 19, prior: {value: 18, relative_deviation: 0.1}}"
    text = ONE.replace("k: {start: 10, true: 20}", known).replace("samples: 100", "samples: 400")
    text += "estimator: {method: output-error}\n"
    result = run(tmp_path, text)
    assert result["identification/parameters/estimate"].data[0] == pytest.approx(19)
    assert result["identification/parameters/at_bound"].data.tolist() == [True, False]
    for right, wrong, fault in (
        ("min: 5", "min: 11", "'start' does not lie between 'min' and 'max'"),
        ("start: 10, true: 20", "value: 10", "'min', 'max' and 'prior' belong beside 'start'"),
        ("min: 5", "min: 0", "0 is not positive"),
        ("relative_deviation: 0.1", "relative: 0.1", "is not a key of joints.j.k.prior"),
    ):
        found = faults_of(text.replace(right, wrong))
        assert any(fault in line for line in found), found


PREPARED = (
    HEAD.replace(", true: 20", "").replace(", true: 2", "")
    + """\
excitation: {dof: 2, kind: file, path: a.csv, column: force}
measurement:
  step: 0.02
  samples: 2000
  channels: [{dof: 2, quantity: displacement}]
  file: {path: a.csv, columns: [motion]}
  prepare:
    - {detrend: linear}
    - {band_pass: [0.5, 6], unit: Hz}
    - {decimate: 3}
estimator: {method: output-error}
"""
)


@pytest.fixture
def drifting(tmp_path):
    """A folder with a record, whose sensor drifts."""
    joints = [Joint("j", (1, 2), JointParameter(value=20.0), JointParameter(value=2.0))]
    model = lumped((2, 1), (Link((1,), 100.0, 1.0),), joints)
    force = np.random.default_rng(2).standard_normal(2000)
    measurement = Measurement(0.02, 2000, (Channel(2, "displacement"),), Simulation())
    clean = simulated(model, (Load(2, Sampled(force, 0.02)),), measurement).outputs[:, 0]
    times = 0.02 * np.arange(2000)
    rows = np.column_stack([times, force, clean + 0.3 + 0.02 * times])
    np.savetxt(tmp_path / "a.csv", rows, fmt="%.12g", delimiter=",", header="time,force,motion", comments="")
    return tmp_path


def test_a_scene_prepares_its_record_and_says_so(drifting):
    with pytest.raises(Diverged, match="explains nothing"):
        run(drifting, PREPARED.replace("prepare:", "prepare: []  #").replace("    - {", "    # - {"))
    result = run(drifting, PREPARED)
    estimate = result["identification/parameters/estimate"].data
    np.testing.assert_allclose(estimate, [20, 2], rtol=1e-3)
    said = "detrend linear; band-pass 3.1416 … 37.699 rad/s; decimate 3"
    assert result.group_attrs["identification/measurement"]["prepared"] == said
    assert f"  prepared: {said}" in lines(result)
    times = result["identification/measurement/time"].data
    np.testing.assert_allclose(np.diff(times), 0.06)


def test_records_share_their_preparation_and_may_do_without(drifting):
    records = "    - {decimate: 3}\n  records: [{}, {prepare: [], samples: 400}]\n"
    (drifting / "x.yaml").write_text(PREPARED.replace("    - {decimate: 3}\n", records))
    scene = load_scene(drifting / "x.yaml")
    first, second = experiments(scene, scene.model.excitation, scene.model.measurement)
    assert first.measurement.step == pytest.approx(0.06)
    assert len(first.measurement.prepared) == 3
    assert (second.measurement.samples, second.measurement.prepared) == (400, ())
    assert second.loads[0].signal.step == 0.02


@pytest.mark.parametrize(
    ("right", "wrong", "fault"),
    [
        ("[0.5, 6]", "[6, 0.5]", "15:19: a band is [low, high], and low is not below high"),
        ("[0.5, 6]", "[0.5]", "15:19: 'band_pass' has 1 entr"),
        ("decimate: 3", "decimate: 1", "16:18: 'decimate' must be at least 2, not 1"),
        ("decimate: 3", "decimat: 3", "16:8: 'decimat' is not a key of measurement.prepare.2; did you mean"),
        ("{decimate: 3}", "{decimate: 3, detrend: linear}", "16:7: a step of 'prepare' is one of"),
        ("{decimate: 3}", "{decimate: 3, unit: Hz}", "16:7: 'unit' and 'order' are those of a 'band_pass'"),
        (
            "detrend: linear",
            "detrend: quadratic",
            "14:17: 'detrend' cannot be 'quadratic'; it is one of constant, linear",
        ),
        (
            "  prepare:",
            "  noise: {kind: coloured}\n  prepare:",
            "9:3: the coloured noise of a measurement is that of unfiltered samples; leave 'band_pass'",
        ),
        (
            "file: {path: a.csv, columns: [motion]}",
            "simulate: {}",
            "simulated; only what is read from a 'file'",
        ),
    ],
)
def test_a_preparation_that_makes_no_sense_is_placed(right, wrong, fault):
    assert right in PREPARED
    found = faults_of(PREPARED.replace(right, wrong, 1))
    assert found, found
    assert any(fault in one for one in found), found


@pytest.mark.parametrize(
    ("right", "wrong", "place"),
    [
        ("[0.5, 6]", "[0.5, 30]", "15:8"),
        ("decimate: 3", "decimate: 4000", "16:8"),
        ("[0.5, 6]", "[0.001, 6]", "15:8"),
    ],
)
def test_a_preparation_that_the_record_does_not_allow_is_placed(drifting, right, wrong, place):
    (drifting / "x.yaml").write_text(PREPARED.replace(right, wrong, 1))
    scene = load_scene(drifting / "x.yaml")
    with pytest.raises(DynidError) as caught:
        run_scene(scene)
    fault = scene.locate(caught.value)
    assert f"{fault.line}:{fault.column}" == place, str(fault)


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("columns: [motion]}", "columns: [force, motion]}", "'columns' names 2, but 'channels' has 1"),
        (", columns: [motion]}", "}", "a.csv has 2 columns of numbers, 'channels' has 1. Name the columns"),
    ],
)
def test_columns_and_channels_go_together(drifting, right, wrong, said):
    assert right in PREPARED
    (drifting / "x.yaml").write_text(PREPARED.replace(right, wrong))
    with pytest.raises(DynidError) as caught:
        run_scene(load_scene(drifting / "x.yaml"))
    assert said in str(caught.value)


DRIVEN = (
    HEAD
    + """\
excitation: [{dof: 1, kind: step}, {dof: 2, kind: random, band: [50, 50.01]}]
measurement:
  step: 0.01
  samples: 100
  channels: [{dof: 2, quantity: velocity}]
  simulate: {seed: 1}
"""
)


def test_a_signal_that_its_record_does_not_allow_is_placed(tmp_path):
    (tmp_path / "x.yaml").write_text(DRIVEN)
    scene = load_scene(tmp_path / "x.yaml")
    with pytest.raises(UsageError, match="band holds no Fourier line of the record") as caught:
        run_scene(scene)
    fault = scene.locate(caught.value)
    assert (fault.line, fault.column) == (7, 36)


def test_a_force_out_of_a_file_lasts_as_long_as_its_record(tmp_path):
    (tmp_path / "force.csv").write_text("force\n" + "1\n" * 99)
    (tmp_path / "x.yaml").write_text(ONE.replace("kind: sine, frequency: 3", "kind: file, path: force.csv"))
    scene = load_scene(tmp_path / "x.yaml")
    with pytest.raises(FileError, match="has 99 samples, but the signal lasts 100") as caught:
        run_scene(scene)
    fault = scene.locate(caught.value)
    assert (fault.line, fault.column) == (7, 34)


def test_the_samples_of_a_random_force_are_held_for_an_estimator_only(tmp_path):
    drive = "input: {dof: 2, kind: random, hold: linear}"
    asked = f"analysis: {{time: {{stop: 1, step: 0.01, {drive}}}, outputs: [{{dof: 1}}]}}\n"
    (tmp_path / "x.yaml").write_text(HEAD + asked)
    scene = load_scene(tmp_path / "x.yaml")
    with pytest.raises(UsageError, match="a response is computed for the continuous") as caught:
        run_scene(scene)
    fault = scene.locate(caught.value)
    text = asked.splitlines()[0]
    assert (fault.line, fault.column) == (7, text.index("hold") + 1)
