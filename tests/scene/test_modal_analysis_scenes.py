"""Scenes of kind `modal-analysis`: what they read, refuse, and write."""

from pathlib import Path

import numpy as np
import pytest

import dynid
from dynid.errors import NumericalError, SceneError, UsageError
from tests.modal.outputs import accelerations, chain
from tests.scene.example_scenes import MODAL, faults_of

M = np.diag([2.0, 1.5, 1.0])
K = np.array([[5e4, -3e4, 0], [-3e4, 5.5e4, -2.5e4], [0, -2.5e4, 2.5e4]])
C = 6e-4 * K
OMEGA = 2 * np.pi * np.linspace(2, 45, 400)


def receptance(response, force):
    """Return the receptance of the chain at the lines, by a solution at each."""
    unit = np.eye(3)[:, force]
    return np.array([np.linalg.solve(K + 1j * w * C - w**2 * M, unit)[response] for w in OMEGA])


def text(path, noise=0.02, seed=0):
    """Write responses as the scene has them: twice the velocity against 12:z."""
    random = np.random.default_rng(seed)
    exact = np.column_stack([-(OMEGA**2) * receptance(0, 2), -2j * OMEGA * receptance(2, 2)])
    complex_noise = random.standard_normal(exact.shape) + 1j * random.standard_normal(exact.shape)
    values = exact + noise * np.abs(exact) * complex_noise / np.sqrt(2)
    parts = np.column_stack([OMEGA / (2 * np.pi), values.view(float)])
    np.savetxt(path, parts, delimiter=",", header="f,a,b,c,d", comments="", fmt="%.12g")


@pytest.fixture
def scene(tmp_path):
    text(tmp_path / "f.csv")
    path = tmp_path / "modal.yaml"

    def written(*replacements, base=MODAL):
        for old, new in replacements:
            assert old in base
            base = base.replace(old, new)
        path.write_text(base)
        return path

    return written


def test_modes_of_a_chain(scene):
    result = dynid.run(scene(("dof: 3}", 'dof: "12:z"}'), ("shapes: real", "shapes: complex")))
    squares, shapes = np.linalg.eigh(np.diag(np.diag(M) ** -0.5) @ K @ np.diag(np.diag(M) ** -0.5))
    omega = np.sqrt(squares)
    shapes = (np.diag(np.diag(M) ** -0.5) @ shapes)[[0, 2]] / np.sqrt(2j * omega)  # proportional damping
    error = result["modal/frequency_standard_error"].data
    assert np.all(np.abs(result["modal/frequency"].data - omega) < 4 * error)
    assert np.all(error < 2e-3 * omega)
    assert np.allclose(result["modal/damping"].data, 3e-4 * omega, rtol=0.05)
    assert list(result["modal/channel"].data) == ["1", "12:z"]
    assert result["modal/shape"].attrs["normalisation"] == "modal a of 1"
    assert np.allclose(result["modal/shape"].data ** 2, shapes.T**2, rtol=0.05)


def test_without_a_driving_point_the_largest_entry_is_one(scene):
    shape = dynid.run(scene())["modal/shape"]
    assert shape.attrs["normalisation"] == "largest entry 1"
    assert np.allclose(np.abs(shape.data).max(axis=1), 1)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("high: 45", "high: 1", "'high' is not above 'low'"),
        ("file: {path: f.csv", "band: [1, 2], file: {path: f.csv", "band of a modal analysis is its key"),
        ("{dof: 1, quantity", "{dofs: [1, 2], quantity", "a shape has one DOF a channel; write 'dof'"),
        ("band: {", "excitation: [{kind: step, dof: 1}]\nband: {", "leave 'excitation' out"),
        ("file: {path: f.csv, frequency: f, columns: [[a, b], [c, d]]}, unit: Hz",
         "simulate: {lines: {start: 1, stop: 2}}", "there is no model to simulate"),
        ("band: {low", "# {low", "needs the key 'band'"),
        ("band: {", "segment: 2\nband: {", "a 'segment' is of records of time; leave it out"),
        ("{dof: 1, quantity: acceleration,", "{output: J.f,", "a shape is of DOFs; write 'dof'"),
        ("  frf:", "  modes: {values: [{frequency: 2}]}\n  frf:", "modes are what is sought"),
    ],
)  # fmt: skip
def test_faults_stand_at_their_keys(old, new, message):
    assert old in MODAL
    assert any(message in fault for fault in faults_of(MODAL.replace(old, new)))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("low: 2, high: 45", "low: 60, high: 80", "no line lies in the band; they go from 2 to 45 Hz"),
        ("low: 2, high: 45", "low: 2, high: 3", "10 lines"),
        ('"12:-z", quantity: velocity, reference: {dof: 3}', "12, quantity: velocity, reference: {dof: 4}",
         "responses to some references are missing: 1/4, 12/3"),
        ('"12:-z", quantity: velocity', "1, quantity: velocity", "a response is measured twice"),
    ],
)  # fmt: skip
def test_a_measurement_that_does_not_fit_is_refused(scene, old, new, message):
    with pytest.raises((UsageError, SceneError), match=message):
        dynid.run(scene((old, new)))


def test_explanation_says_what_is_read(scene):
    from dynid.scene.explanation import explain

    facts = {fact.topic: fact.text for fact in explain(dynid.load_scene(scene())).facts}
    assert facts["responses"] == "2 responses to 1 reference (3)"
    assert facts["lines"].startswith("400 lines")
    assert "largest entry 1" in facts["scale"]
    template = Path(dynid.__file__).parent / "templates/modal-analysis.yaml"
    facts = {fact.topic: fact.text for fact in explain(dynid.load_scene(template)).facts}
    assert facts["scale"] == "modal a of 1, by 1 driving point"
    assert "1 lines" in str(explain(dynid.load_scene(scene(("low: 2", "low: 44.99")))).obstacle)
    assert explain(dynid.load_scene(scene(("low: 2, high: 45", "low: 60, high: 80")))).obstacle is not None


RECORDS = """dynid: 1
kind: modal-analysis
excitation: []
measurement:
  step: 0.005
  samples: 2400
  records:
LISTED
band: {low: 4, high: 50, unit: Hz}
"""


def impact_record(path, reference, sensors, seed, second=0.0, noise=0.02):
    """Write the force of an impact and accelerations of sensors (from 0) of the chain, 12 s."""
    random = np.random.default_rng(seed)
    step, samples, long = 0.005, 2400, 8000
    force = np.zeros(long)
    force[20:23] = 40 * np.sin(np.pi * np.arange(1, 4) / 4)
    force[400:403] = second * force[20:23]
    omega = 2 * np.pi * np.fft.rfftfreq(long, step)
    unit = np.eye(3)[:, reference]
    H = np.array([-(w**2) * np.linalg.solve(K + 1j * w * C - w**2 * M, unit) for w in omega])
    values = np.fft.irfft(H * np.fft.rfft(force)[:, None], long, axis=0)
    values = values + noise * values.std(axis=0) * random.standard_normal(values.shape)
    columns = np.column_stack([np.arange(long) * step, force, values[:, sensors]])[:samples]
    heads = ",".join(["t", "F", *(f"a{sensor + 1}" for sensor in sensors)])
    np.savetxt(path, columns, delimiter=",", header=heads, comments="", fmt="%.10g")


def listed(folder, hits, noise=0.02):
    """Write records and return their scene; hits are (reference, sensors, part of a second hit)."""
    lines = []
    for seed, (reference, sensors, second) in enumerate(hits):
        impact_record(folder / f"hit{seed}.csv", reference, sensors, seed, second, noise)
        channels = ", ".join(f"{{dof: {sensor + 1}, quantity: acceleration}}" for sensor in sensors)
        names = ", ".join(f"a{sensor + 1}" for sensor in sensors)
        lines.append(
            f"    - {{file: {{path: hit{seed}.csv, columns: [{names}]}}, channels: [{channels}], excitation: "
            f"{{dof: {reference + 1}, kind: file, path: hit{seed}.csv, column: F}}}}"
        )
    path = folder / "records.yaml"
    path.write_text(RECORDS.replace("LISTED", "\n".join(lines)).replace("excitation: []\n", ""))
    return path


def check_modes(result):
    squares, _ = np.linalg.eigh(np.diag(np.diag(M) ** -0.5) @ K @ np.diag(np.diag(M) ** -0.5))
    omega, error = np.sqrt(squares), result["modal/frequency_standard_error"].data
    assert np.all(np.abs(result["modal/frequency"].data - omega) < 4.5 * error)
    assert np.all(error < 2e-3 * omega)


@pytest.mark.thorough
def test_impacts_at_two_references_and_a_double_hit(tmp_path):
    hits = [(0, [0, 1, 2], 0.0), (2, [0, 1, 2], 0.0)] * 2 + [(0, [0, 1, 2], 0.3)]
    result = dynid.run(listed(tmp_path, hits))
    check_modes(result)
    (warning,) = result["modal/warnings"].data
    assert warning.startswith("record 5 is left out: a double hit, 1.9e+03 ms later with 30 % of the force")
    assert list(result["modal/reference"].data) == ["1", "3"]


def test_decays_that_end_too_early_are_named_where_residuals_show_it(tmp_path):
    path = listed(tmp_path, [(0, [0, 1, 2], 0.0)] * 2, noise=1e-4)
    path.write_text(path.read_text().replace("samples: 2400", "samples: 300"))
    warnings = [*dynid.run(path)["modal/warnings"].data]
    ends = "not decayed at the end: record 1, record 2; record longer, or state 'exponential'"
    assert warnings[0] == ends
    assert warnings[1].startswith("lack of fit")


def test_set_ups_with_a_common_reference_are_joined(tmp_path):
    hits = [(0, [0, 1], 0.0)] * 3 + [(0, [0, 2], 0.0)] * 3
    result = dynid.run(listed(tmp_path, hits))
    check_modes(result)
    assert list(result["modal/channel"].data) == ["1", "2", "3"]


def test_simulated_records_are_refused(tmp_path):
    text = listed(tmp_path, [(0, [0, 1], 0.0)]).read_text()
    simulated = text.replace("{path: hit0.csv, columns: [a1, a2]}", "{}").replace("file: {}", "simulate: {}")
    assert any("there is no model to simulate" in fault for fault in faults_of(simulated))


def test_missing_samples_are_refused(tmp_path):
    path = listed(tmp_path, [(0, [0, 1], 0.0)])
    lines = (tmp_path / "hit0.csv").read_text().splitlines()
    lines[50] = ",".join([*lines[50].split(",")[:3], "nan"])
    (tmp_path / "hit0.csv").write_text("\n".join(lines))
    with pytest.raises(UsageError, match="record 1 has missing samples"):
        dynid.run(path)


def test_noise_by_coherence_and_a_stated_window(scene, tmp_path):
    table = np.loadtxt(tmp_path / "f.csv", delimiter=",", skiprows=1)
    coherence = np.full((len(table), 2), 1 / (1 + 10 * 0.02**2))
    np.savetxt(
        tmp_path / "f.csv", np.hstack([table, coherence]), delimiter=",", header="f,a,b,c,d,e,g", comments=""
    )
    by_coherence = ("columns: [[a, b], [c, d]]", "columns: [[a, b], [c, d]], coherence: [e, g], averages: 10")
    plain = ("  noise: {kind: proportional, ratio: 0.02}\n", "")
    result = dynid.run(scene(by_coherence, plain))
    assert result.value("modal/fit/chi2") == pytest.approx(result.value("modal/fit/degrees"), rel=0.15)
    windowed = dynid.run(scene(by_coherence, plain, ("band: {", "exponential: 2\nband: {")))
    shift = windowed["modal/damping"].data - result["modal/damping"].data
    assert np.allclose(shift, -0.5 / result["modal/frequency"].data, rtol=0.2)
    assert np.all(windowed["modal/damping_standard_error"].data > result["modal/damping_standard_error"].data)


def test_preparation_reads_the_measurement(scene):
    from dynid.scene.run import preparation_errors

    assert preparation_errors(dynid.load_scene(scene())) == []
    assert len(preparation_errors(dynid.load_scene(scene(("low: 2, high: 45", "low: 60, high: 80"))))) == 1


def test_a_single_impact_has_its_noise_from_the_residuals(tmp_path):
    result = dynid.run(listed(tmp_path, [(0, [0, 1, 2], 0.0)]))
    check_modes(result)
    assert result.group_attrs["modal"]["noise"] == "estimated"


def test_records_with_and_without_forces_and_forces_that_are_not_measured_are_refused(tmp_path):
    path = listed(tmp_path, [(0, [0, 1], 0.0), (0, [0, 1], 0.0)])
    text = path.read_text()
    force = text[text.index("{dof: 1, kind: file") : text.index("}}\n")] + "}"
    path.write_text(text.replace(f", excitation: {force}", "", 1))
    with pytest.raises(SceneError, match="some records have an 'excitation' and others none"):
        dynid.run(path)
    path.write_text(text.replace(force, "{dof: 1, kind: impact, amplitude: 1, duration: 0.01}"))
    with pytest.raises(UsageError, match="of record 1 is no measured force, but of the kind impact"):
        dynid.run(path)
    path.write_text(text.replace(force, f"[{force}, {force.replace('dof: 1', 'dof: 2')}]"))
    with pytest.raises(UsageError, match="record 1 has impacts at 2 DOFs at once"):
        dynid.run(path)


def test_two_random_forces_at_once(tmp_path):
    random, step, samples = np.random.default_rng(4), 0.01, 20000
    forces = random.standard_normal((samples, 2))
    omega = 2 * np.pi * np.fft.rfftfreq(samples, step)
    columns = [np.linalg.solve(K + 1j * w * C - w**2 * M, np.eye(3)[:, [0, 2]]) for w in omega]
    H = np.array([-(w**2) * column for w, column in zip(omega, columns, strict=True)])
    spectra = np.einsum("lof,lf->lo", H, np.fft.rfft(forces, axis=0))
    values = np.fft.irfft(spectra, samples, axis=0)
    values += 0.01 * values.std(axis=0) * random.standard_normal(values.shape)
    np.savez(tmp_path / "run.npz", F1=forces[:, 0], F3=forces[:, 1], a1=values[:, 0], a3=values[:, 2])
    path = tmp_path / "random.yaml"
    path.write_text(
        "dynid: 1\nkind: modal-analysis\nmeasurement:\n  step: 0.01\n  samples: 20000\n"
        "  file: {path: run.npz, columns: [a1, a3]}\n"
        "  channels: [{dof: 1, quantity: acceleration}, {dof: 3, quantity: acceleration}]\n"
        "excitation:\n  - {dof: 1, kind: file, path: run.npz, column: F1}\n"
        "  - {dof: 3, kind: file, path: run.npz, column: F3}\n"
        "segment: 20\nband: {low: 4, high: 45, unit: Hz}\n"
    )
    result = dynid.run(path)
    check_modes(result)
    assert list(result["modal/reference"].data) == ["1", "3"]
    assert result.value("modal/fit/reciprocity") > 1e-3
    assert result["modal/shape"].attrs["normalisation"] == "modal a of 1"


def test_free_decays_after_impulses_of_stated_size(tmp_path):
    squares, vectors = np.linalg.eigh(np.diag(np.diag(M) ** -0.5) @ K @ np.diag(np.diag(M) ** -0.5))
    omega, shapes = np.sqrt(squares), np.diag(np.diag(M) ** -0.5) @ vectors
    decay, step, samples = 3e-4 * squares, 0.002, 4000
    damped, t = np.sqrt(squares - decay**2), step * np.arange(samples)[:, None]
    # Velocities after a unit impulse at DOF 3.
    unit = np.exp(-decay * t) * (np.cos(damped * t) - decay / damped * np.sin(damped * t))
    random, lines = np.random.default_rng(2), list[str]()
    for k, size in enumerate((0.5, 2.0, 1.0)):
        velocity = size * unit @ (shapes * shapes[2]).T
        velocity += 2e-3 * random.standard_normal(velocity.shape)
        np.savez(tmp_path / f"tap{k}.npz", v1=velocity[:, 0], v3=velocity[:, 2])
        tap = f"{{dof: 3, kind: impulse, amplitude: {size}}}"
        lines.append(f"    - {{file: {{path: tap{k}.npz}}, excitation: {tap}}}\n")
    path = tmp_path / "taps.yaml"
    path.write_text(
        "dynid: 1\nkind: modal-analysis\nmeasurement:\n  step: 0.002\n  samples: 4000\n"
        "  channels: [{dof: 1, quantity: velocity}, {dof: 3, quantity: velocity}]\n"
        "  file: {path: tap0.npz, columns: [v1, v3]}\n  records:\n"
        + "".join(lines)
        + "band: {low: 4, high: 60, unit: Hz}\n"
    )
    result = dynid.run(path)
    check_modes(result)
    error = result["modal/damping_standard_error"].data
    assert np.all(np.abs(result["modal/damping"].data - decay / omega) < 4.5 * error + 1e-6)
    (warning,) = result["modal/warnings"].data
    assert warning.startswith("one reference")
    exact = (shapes[[0, 2]] / np.sqrt(2j * damped)).T
    assert np.allclose(
        result["modal/shape"].data ** 2, exact**2, rtol=0.03, atol=1e-3 * np.abs(exact).max() ** 2
    )


def test_all_channels_of_a_universal_file(tmp_path):
    pytest.importorskip("pyuff")
    from tests.files.universal_files import function, written

    ends = {(11, 3): receptance(0, 2), (12, -3): -receptance(1, 2), (13, 3): receptance(2, 2)}
    lines = OMEGA / (2 * np.pi)
    functions = [
        function(
            values * (1 + 1e-4 * np.sin(7 * np.arange(len(values)))), kind=4, response=end, reference=(13, 3),
            step=lines[1] - lines[0], start=lines[0], abscissa_spec_data_type=18, ordinate_spec_data_type=8,
            orddenom_spec_data_type=13,
        )
        for end, values in ends.items()
    ]  # fmt: skip
    written(tmp_path / "test.uff", *functions)
    path = tmp_path / "all.yaml"
    path.write_text(
        "dynid: 1\nkind: modal-analysis\nmeasurement: {channels: all, frf: {file: {path: test.uff}}}\n"
        "band: {low: 2, high: 45, unit: Hz}\n"
    )
    result = dynid.run(path)
    assert list(result["modal/channel"].data) == ["11:z", "12:z", "13:z"]
    assert list(result["modal/reference"].data) == ["13:z"]
    squares, vectors = np.linalg.eigh(np.diag(np.diag(M) ** -0.5) @ K @ np.diag(np.diag(M) ** -0.5))
    shapes = np.diag(np.diag(M) ** -0.5) @ vectors / np.sqrt(2j * np.sqrt(squares))
    tolerance = 1e-3 * np.abs(shapes**2).max()
    assert np.allclose(result["modal/shape"].data ** 2, shapes.T**2, rtol=0.05, atol=tolerance)
    assert np.sign(result["modal/shape"].data[0].real).prod() == 1  # all move one way


AMBIENT = """dynid: 1
kind: modal-analysis
measurement:
  step: 0.0125
  samples: 12000
  channels: [{dof: 1, quantity: acceleration}, {dof: "12:-z", quantity: acceleration, gain: 2}]
  file: {path: a.npz, columns: [a, b]}
band: {low: 10, high: 18, unit: Hz}
"""


@pytest.fixture(scope="module")
def ambient(tmp_path_factory):
    """Accelerations of two sensors of a chain, the second with a gain of -2."""
    folder = tmp_path_factory.mktemp("ambient")
    values = accelerations(chain(), 0.0125, 12000, seed=4, sensors=(0, 3))
    gap = np.where(np.arange(12000) == 5, np.nan, values[:, 0])
    np.savez(folder / "a.npz", a=values[:, 0], b=-2 * values[:, 1], gap=gap, flat=np.ones(12000))
    return folder


def test_ambient_vibration_has_modes_without_a_scale(ambient):
    from dynid.report.content import content
    from dynid.report.figure import figures
    from dynid.scene.explanation import explain

    path = ambient / "ambient.yaml"
    path.write_text(AMBIENT)
    result = dynid.run(path)
    omega, _, shapes = chain()
    high = omega > 2 * np.pi * 10
    assert result["modal/frequency"].data == pytest.approx(omega[high], rel=4e-3)
    assert result["modal/damping"].data == pytest.approx(0.01, rel=0.5)
    ratio = result["modal/shape"].data
    assert (ratio[:, 1] / ratio[:, 0]).real == pytest.approx((shapes[3] / shapes[0])[high], rel=0.1)
    assert result["modal/shape"].attrs["normalisation"] == "largest entry 1"
    assert list(result["modal/channel"].data) == ["1", "12:z"]
    assert "modal/harmonics" not in result
    assert result.value("modal/periods") > 1000
    drawn = [figure.name for figure in figures(result) if figure.picture]
    assert drawn == ["stabilisation", "modal-shapes", "modal-shapes-animated", "modal-mac"]
    (section,) = [section for section in content(result).sections if section.title == "Modes"]
    assert "responses to ambient excitation over" in section.blocks[-1].text
    facts = {fact.topic: fact.text for fact in explain(dynid.load_scene(path)).facts}
    assert facts["samples"] == "12000, 0.0125 s apart"


def test_oversampled_ambient_vibration_is_decimated_and_short_records_warn(ambient):
    from dynid.report.figure import figures
    from dynid.scene.explanation import explain

    times = 0.00625 * np.arange(24000)
    upsampled = np.column_stack([np.sin(2 * np.pi * 11.5 * times), np.zeros(24000)])
    modes = chain()
    values = accelerations(modes, 0.00625, 24000, seed=4, sensors=(0, 3)) + 3 * upsampled
    np.savez(ambient / "fast.npz", a=values[:, 0], b=values[:, 1])
    path = ambient / "fast.yaml"
    text = AMBIENT.replace("0.0125", "0.00625").replace("12000", "24000").replace("a.npz", "fast.npz")
    path.write_text(text.replace("low: 10, high: 18", "low: 1.8, high: 12"))
    facts = {fact.topic: fact.text for fact in explain(dynid.load_scene(path)).facts}
    assert facts["samples"].endswith("0.03125 s apart, every 5. sample of the records")
    result = dynid.run(path)
    assert result["modal/frequency"].data == pytest.approx(modes[0][:3], rel=1e-2)
    assert result["modal/harmonics"].data == pytest.approx([2 * np.pi * 11.5], rel=1e-4)
    warnings = " ".join(result["modal/warnings"].data)
    assert "1 sine in the responses, no modes, at 11.5 Hz" in warnings
    assert "periods of the lowest mode" in warnings
    (chart,) = [figure.picture for figure in figures(result) if figure.name == "stabilisation"]
    assert "harmonic" in chart.svg


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("columns: [a, b]", "columns: [gap, b]", "record 1 has missing samples"),
        ("columns: [a, b]", "columns: [a, flat]", "channel 2 is constant"),
        ("high: 18", "high: 41", "the band ends above half the sampling rate, 40 Hz"),
        ('"12:-z", quantity: acceleration', "1, quantity: velocity", "a response is measured twice"),
        ("  file:", "  records: [{}, {step: 0.01}]\n  file:", "record 2 has another step or other channels"),
    ],
)
def test_ambient_vibration_that_cannot_be_analysed_is_refused(ambient, old, new, message):
    path = ambient / "refused.yaml"
    assert old in AMBIENT
    path.write_text(AMBIENT.replace(old, new))
    with pytest.raises((UsageError, NumericalError), match=message):
        dynid.run(path)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("exponential: 1", "'exponential' windows impacts, and these have no 'excitation'"),
        ("segment: 2", "'segment' is of records with forces"),
        ("modes: {shapes: real}", "modes of responses alone are complex and of no scale"),
    ],
)
def test_keys_of_forces_are_refused_without_one(line, message):
    assert any(message in fault for fault in faults_of(AMBIENT + line + "\n"))
