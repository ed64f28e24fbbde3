"""Channels and signals in units of laboratories: the same estimate as in SI, and faults of units."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from dynid.errors import DynidError, UsageError
from dynid.scene.load import load_scene
from dynid.scene.run import run_scene

GRAVITY = 9.80665

SCENE = """\
dynid: 1
kind: identification
structure:
  lumped: {masses: [2, 1], links: [{dofs: [1], k: 800, c: 1.5}]}
joints:
  j: {dofs: [1, 2], k: {start: 300}, c: {start: 0.5}}
excitation: [{dof: 1, kind: file, path: DATA, column: F}]
measurement:
  step: 0.02
  samples: 300
  channels: [{dof: 1, quantity: acceleration}, {dof: 2, quantity: velocity}]
  noise: [0.02, 0.003]
  file: {path: DATA, columns: [a1, v2]}
"""

ROOT = Path(__file__).parents[2]

SOURCE = (
    SCENE.replace(
        "kind: file, path: DATA, column: F", "kind: multisine, amplitude: [3, 2, 2], frequency: [5, 13, 31]"
    )
    .replace("  file: {path: DATA, columns: [a1, v2]}", "  simulate: {noise: [0.02, 0.003], seed: 3}")
    .replace("k: {start: 300}, c: {start: 0.5}", "k: {start: 300, true: 400}, c: {start: 0.5, true: 0.8}")
)


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    """Times, force (N), acceleration (m/s2) and velocity (m/s) of one record."""
    path = tmp_path_factory.mktemp("record") / "source.yaml"
    path.write_text(SOURCE)
    found = run_scene(load_scene(path))
    group = "identification/measurement"
    return tuple(
        np.asarray(found[f"{group}/{name}"].data)[:, column]
        for name, column in (("input", 0), ("measured", 0), ("measured", 1))
    )


@pytest.fixture
def run(tmp_path):
    """Run a scene with a table and return its result."""

    def run(columns, scene=SCENE, name="x.csv", separator=","):
        heads = separator.join(columns)
        values = np.column_stack(list(columns.values()))
        rows = [separator.join(repr(float(one)) for one in row) for row in values]
        (tmp_path / name).write_text("\n".join([heads, *rows]), encoding="utf-8")
        path = tmp_path / "scene.yaml"
        path.write_text(scene.replace("DATA", name), encoding="utf-8")
        return run_scene(load_scene(path))

    return run


def estimates(result):
    group = "identification/parameters"
    return np.concatenate([result[f"{group}/{name}"].data for name in ("estimate", "standard_error")])


def test_units_of_channels_force_and_noise_change_nothing(run, record):
    F, a, v = record
    si = estimates(run({"F": F, "a1": a, "v2": v}))
    scene = SCENE.replace("column: F", "column: F, unit: kN")
    scene = scene.replace("quantity: acceleration}", "quantity: acceleration, unit: g}")
    scene = scene.replace("quantity: velocity}", "quantity: velocity, unit: mm/s, gain: -1}")
    scene = scene.replace("noise: [0.02, 0.003]", f"noise: [{0.02 / GRAVITY!r}, 3]")
    found = run({"F": F / 1e3, "a1": a / GRAVITY, "v2": -1e3 * v}, scene)
    np.testing.assert_allclose(estimates(found), si, rtol=1e-9)
    units = found["identification/measurement/unit"].data
    assert list(units) == ["m/s2", "m/s"]
    np.testing.assert_allclose(found["identification/measurement/given_noise"].data, [0.02, 0.003])


def test_units_in_headings_change_nothing(run, record):
    F, a, v = record
    si = estimates(run({"F": F, "a1": a, "v2": v}))
    columns = {
        "Time [ms]": 20.0 * np.arange(300),
        "F [kN]": F / 1e3,
        "a1 (g)": a / GRAVITY,
        "v2 / mm/s": 1e3 * v,
    }
    scene = SCENE.replace("noise: [0.02, 0.003]", f"noise: [{0.02 / GRAVITY!r}, 3]")
    np.testing.assert_allclose(estimates(run(columns, scene)), si, rtol=1e-9)
    whole = scene.replace("[a1, v2]", "['a1 (g)', 'v2 [mm/s]']").replace("column: F", "column: 'F [kN]'")
    np.testing.assert_allclose(estimates(run(columns, whole)), si, rtol=1e-9)


def test_a_row_of_units_is_read(run, record):
    F, a, v = record
    scene = SCENE.replace("noise: [0.02, 0.003]", f"noise: [{0.02 / GRAVITY!r}, 3]")
    si = estimates(run({"F": F, "a1": a, "v2": v}))
    rows = zip(F / 1e3, a / GRAVITY, 1e3 * v, strict=True)
    text = "F;a1;v2\nkN;g;mm/s\n" + "\n".join(";".join(map(repr, map(float, row))) for row in rows)
    found = run({text: []}, scene)
    np.testing.assert_allclose(estimates(found), si, rtol=1e-9)


def test_sensitivities_and_offsets_are_those_of_the_recorded_signal(run, record):
    F, a, v = record
    si = estimates(run({"F": F, "a1": a, "v2": v}))
    scene = SCENE.replace("column: F", "column: F, sensitivity: {value: 2, unit: mV/N}, unit: V, offset: 0.5")
    scene = scene.replace(
        "quantity: acceleration}",
        "quantity: acceleration, sensitivity: {value: -100, unit: mV/g}, offset: 25}",
    ).replace("noise: [0.02, 0.003]", f"noise: [{0.02 * 100 / GRAVITY!r}, 0.003]")
    found = run({"F": 0.5 + 2e-3 * F, "a1": 25 - 100 * a / GRAVITY, "v2": v}, scene)
    np.testing.assert_allclose(estimates(found), si, rtol=1e-9)


@pytest.mark.parametrize(
    ("unit", "value", "recorded"),
    [("V.s/m", 28.0, "V"), ("mV.s/m", 28e3, "mV"), ("V/(m/s)", 28.0, "V"), ("mV/(mm/s)", 28.0, "mV")],
)
def test_sensitivity_to_velocity_is_of_a_recorded_voltage(run, record, unit, value, recorded):
    F, a, v = record
    si = estimates(run({"F": F, "a1": a, "v2": v}))
    scale = 28e3 if recorded == "mV" else 28.0
    scene = SCENE.replace(
        "quantity: velocity}", f"quantity: velocity, sensitivity: {{value: {value}, unit: {unit}}}}}"
    ).replace("noise: [0.02, 0.003]", f"noise: [0.02, {0.003 * scale}]")
    np.testing.assert_allclose(estimates(run({"F": F, "a1": a, "v2": scale * v}, scene)), si, rtol=1e-9)


def test_an_unknown_offset_is_in_the_unit_of_its_channel(run, record):
    F, a, v = record
    scene = SCENE.replace("quantity: velocity}", "quantity: velocity, unit: mm/s, offset: b}")
    scene = scene.replace("noise: [0.02, 0.003]", "noise: [0.02, 3]") + "parameters: {b: {start: 0}}\n"
    found = run({"F": F, "a1": a, "v2": 1e3 * v + 40}, scene)
    names = list(found["identification/parameters/name"].data)
    b = found["identification/parameters/estimate"].data[names.index("b")]
    error = found["identification/parameters/standard_error"].data[names.index("b")]
    assert abs(b - 40) < 4 * error
    assert error == pytest.approx(3 / np.sqrt(300), rel=0.3)


def test_amplitudes_have_units(tmp_path):
    def measured(excitation):
        path = tmp_path / "scene.yaml"
        path.write_text(SOURCE.replace(SOURCE.partition("excitation: ")[2].partition("\n")[0], excitation))
        return run_scene(load_scene(path))["identification/measurement/measured"].data

    sines = "kind: multisine, amplitude: [{}, {}, {}], frequency: [5, 13, 31]"
    newton, kilo = sines.format(3, 2, 2), sines.format("3.0e-3", "2.0e-3", "2.0e-3")
    expected = measured(f"[{{dof: 1, {newton}}}]")
    np.testing.assert_allclose(measured(f"[{{dof: 1, {kilo}, amplitude_unit: kN}}]"), expected, rtol=1e-12)
    shaken = measured(f"[{{base: acceleration, {newton}}}]")
    in_g = sines.format(*(repr(one / GRAVITY) for one in (3, 2, 2)))
    np.testing.assert_allclose(
        measured(f"[{{base: acceleration, {in_g}, amplitude_unit: g}}]"), shaken, rtol=1e-9
    )
    area = measured("[{dof: 1, kind: impulse, amplitude: 2}]")
    np.testing.assert_allclose(
        measured("[{dof: 1, kind: impulse, amplitude: 2, amplitude_unit: kN.ms}]"), area, rtol=1e-12
    )


@pytest.mark.parametrize(
    ("old", "new", "heads", "said"),
    [
        ("", "", "F [kg],a1,v2", "the column 'F' [kg]: the unit kg does not fit: a force is in N"),
        ("", "", "F,a1 [N],v2", "the column 'a1' [N]: the unit N does not fit: an acceleration is in m/s2"),
        (
            "quantity: acceleration}",
            "quantity: acceleration, unit: g}",
            "F,a1 [m/s2],v2",
            "'unit' is g, but the file has 'a1' in m/s2. Leave 'unit' out",
        ),
        (
            "quantity: acceleration}",
            "quantity: acceleration, sensitivity: {value: 1, unit: V/g}}",
            "F,a1 [g],v2",
            "values in g over a sensitivity in V/g are no m/s2",
        ),
        ("column: F", "column: F, unit: mm", "F,a1,v2", "the unit mm does not fit: a force is in N or N.m"),
    ],
)
def test_units_that_do_not_fit_are_faults(run, record, old, new, heads, said):
    F, a, v = record
    with pytest.raises(UsageError) as caught:
        run(dict(zip(heads.split(","), (F, a, v), strict=True)), SCENE.replace(old, new))
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("quantity: acceleration}", "quantity: acceleration, unit: kg}", "11:14: the unit kg does not fit"),
        (
            "quantity: acceleration}",
            "quantity: acceleration, sensitivity: {value: 0, unit: V/g}}",
            "the sensitivity is 0",
        ),
        ("column: F", "column: F, unit: foo", "7:64: 'foo' is no unit"),
        ("column: F", "column: F, amplitude_unit: N", "'amplitude_unit' is not a key"),
    ],
)
def test_faults_of_units_are_located(tmp_path, old, new, said):
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE.replace(old, new))
    with pytest.raises(DynidError) as caught:
        load_scene(path)
    assert said in str(caught.value)


FRF = """\
dynid: 1
kind: identification
structure:
  lumped: {masses: [2, 1], links: [{dofs: [1], k: 800, c: 1.5}]}
joints:
  j: {dofs: [1, 2], k: {start: 300}, c: {start: 0.5}}
measurement:
  channels: [{dof: 2, quantity: acceleration, reference: {dof: 1}}]
  noise: 0.01
  frf: {file: {path: h.csv}}
"""


@pytest.mark.parametrize("where", ["heading", "scene"])
def test_frequency_responses_in_units_of_the_ratio_change_nothing(tmp_path, where):
    omega = np.linspace(5, 45, 81)
    M, C = np.diag([2.0, 1.0]), np.array([[2.3, -0.8], [-0.8, 0.8]])
    K = np.array([[1200.0, -400], [-400, 400]])
    H = np.array([-(w**2) * np.linalg.inv(K + 1j * w * C - w**2 * M)[1, 0] for w in omega])
    noise = np.random.default_rng(1).standard_normal((2, len(omega))) * 0.01 / np.sqrt(2)
    H = H + noise[0] + 1j * noise[1]

    def run(scene, head, x, values):
        rows = [f"{a!r};{b.real!r};{b.imag!r}" for a, b in zip(x.tolist(), values.tolist(), strict=True)]
        (tmp_path / "h.csv").write_text("\n".join([head, *rows]))
        (tmp_path / "scene.yaml").write_text(scene)
        return estimates(run_scene(load_scene(tmp_path / "scene.yaml")))

    si = run(FRF, "omega;re;im", omega, H)
    in_lab, factor = H / (GRAVITY / 1e3), 1e3 / GRAVITY
    scene = FRF.replace("noise: 0.01", f"noise: {0.01 * factor!r}")
    if where == "heading":
        found = run(scene, "frequency [Hz];re [g/kN];im [g/kN]", omega / (2 * np.pi), in_lab)
    else:
        scene = scene.replace("reference:", "unit: g/kN, reference:")
        found = run(scene, "omega;re;im", omega, in_lab)
    np.testing.assert_allclose(found, si, rtol=1e-8)
    with pytest.raises(UsageError, match=r"the frequency response 2\.acceleration/1 is in"):
        run(scene.replace("unit: g/kN, ", ""), "omega;re [g];im [g]", omega, H)


def test_the_file_of_a_data_logger_gives_the_estimate_of_the_record_in_si(tmp_path):
    scene = (ROOT / "configs/machine_logger.yaml").read_text()
    heads, *rows = (ROOT / "data/machine_logger.csv").read_text().splitlines()
    assert heads == "Time (s);Force [kN];acc 1+Z [g];acc 2-Z [g];acc 3+Z [g]"
    g = Fraction("9.80665")
    lines = ["time,F,a1,a2,a3"]
    for k, row in enumerate(rows):
        _, F, a1, a2, a3 = map(Fraction, row.split(";"))
        exact = (Fraction(k, 1024), 1000 * F, g * a1, -g * a2, g * a3)
        lines.append(",".join(repr(float(one)) for one in exact))
    (tmp_path / "si.csv").write_text("\n".join(lines))
    si = scene.replace("../data/machine_logger.csv", "si.csv").replace(", gain: -1", "")
    si = si.replace("column: Force", "column: F").replace("[acc 1+Z, acc 2-Z, acc 3+Z]", "[a1, a2, a3]")
    (tmp_path / "si.yaml").write_text(si)
    found = estimates(run_scene(load_scene(ROOT / "configs/machine_logger.yaml")))
    expected = estimates(run_scene(load_scene(tmp_path / "si.yaml")))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


GRAPH = """\
dynid: 1
kind: identification
parameters: {R: {start: 1, true: 2}, J: {start: 0.02, true: 0.01}}
graph:
  nodes:
    U: Se
    circuit: 1
    R: {type: R, value: R}
    L: {type: I, value: 0.05, domain: electrical}
    motor: {type: GY, value: 0.1}
    rotor: 1
    J: {type: I, value: J, domain: rotational}
    b: {type: R, value: 1.0e-3}
  bonds: [U -> circuit -> motor -> rotor -> J, circuit -> L, circuit -> R, rotor -> b]
excitation: [{source: U, kind: multisine, amplitude: [6, 6], frequency: [2, 20]}]
measurement:
  step: 0.01
  samples: 200
  channels: [{output: L.f}, {output: J.f}]
  simulate: {noise_ratio: 0.02, seed: 1}
"""


def test_variables_of_graphs_have_units_of_their_domains(tmp_path):
    def run(text):
        (tmp_path / "scene.yaml").write_text(text)
        return run_scene(load_scene(tmp_path / "scene.yaml"))

    group = "identification/measurement"
    si = run(GRAPH)
    values, driven = si[f"{group}/measured"].data, si[f"{group}/input"].data[:, 0]
    rows = np.column_stack([driven * 1e3, values[:, 0] * 1e3, values[:, 1] * 30 / np.pi])
    lines = [",".join(map(repr, row)) for row in rows.tolist()]
    (tmp_path / "x.csv").write_text("\n".join(["U [mV],i (mA),n [rpm]", *lines]))
    (tmp_path / "si.csv").write_text(
        "\n".join(
            [
                "U,i,n",
                *(f"{u!r},{i!r},{n!r}" for u, (i, n) in zip(driven.tolist(), values.tolist(), strict=True)),
            ]
        )
    )
    measured = GRAPH.replace(
        "kind: multisine, amplitude: [6, 6], frequency: [2, 20]", "kind: file, path: F, column: U"
    )
    measured = measured.replace("simulate: {noise_ratio: 0.02, seed: 1}", "file: {path: F, columns: [i, n]}")
    expected = estimates(run(measured.replace("path: F", "path: si.csv")))
    lab = measured.replace("path: F", "path: x.csv")
    np.testing.assert_allclose(estimates(run(lab)), expected, rtol=1e-8)
    given = lab.replace("{output: J.f}", "{output: J.f, unit: rpm}").replace(
        "{output: L.f}", "{output: L.f, unit: mA}"
    )
    np.testing.assert_allclose(estimates(run(given)), expected, rtol=1e-8)
    with pytest.raises(UsageError, match=r"the unit Hz does not fit: J\.f is in rad/s") as caught:
        run(measured.replace("path: F", "path: si.csv").replace("{output: J.f}", "{output: J.f, unit: Hz}"))
    assert caught.value.names[0] == "measurement.channels.1.unit"
    with pytest.raises(UsageError, match="the unit N does not fit: U is in V"):
        run(GRAPH.replace("frequency: [2, 20]", "frequency: [2, 20], amplitude_unit: N"))
    kilo = GRAPH.replace("amplitude: [6, 6]", "amplitude: [6.0e-3, 6.0e-3], amplitude_unit: kV")
    np.testing.assert_allclose(run(kilo)[f"{group}/input"].data[:, 0], driven, rtol=1e-12)


def test_inputs_of_a_bond_graph_have_units(tmp_path):
    def response(signal):
        (tmp_path / "scene.yaml").write_text(f"""\
dynid: 1
kind: bond-graph
graph:
  nodes: {{F: Se, body: 1, m: {{type: I, value: 2, domain: mechanical}}, d: {{type: R, value: 3}}}}
  bonds: [F -> body -> m, body -> d]
analysis:
  outputs: [m.f]
  results: [time_response]
  time: {{stop: 1, step: 0.1, input: {signal}}}
""")
        return run_scene(load_scene(tmp_path / "scene.yaml"))["bond_graph/time_response/response"].data

    expected = response("{kind: step, amplitude: 5}")
    found = response("{kind: step, amplitude: 5.0e-3, amplitude_unit: kN}")
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    (tmp_path / "f.csv").write_text("Time [ms];F [kN]\n" + "\n".join(f"{100 * k};0,005" for k in range(11)))
    np.testing.assert_allclose(response("{kind: file, path: f.csv, hold: zero}"), expected, rtol=1e-12)
    with pytest.raises(UsageError, match="the unit V does not fit: the input is in N"):
        response("{kind: step, amplitude: 5, amplitude_unit: V}")


def test_the_clock_of_a_record_is_reported_and_dropped_samples_count_as_missing(run, record):
    _, a, v = record
    kept = np.delete(np.arange(300), [40, 41, 200])
    columns = {"Time (s)": (0.02 * kept).round(6), "a1": a[kept], "v2": v[kept]}
    scene = SCENE.replace(
        "kind: file, path: DATA, column: F", "kind: multisine, amplitude: [3, 2, 2], frequency: [5, 13, 31]"
    )
    found = run(columns, scene)
    assert "by its times the record has dropped 3 samples: they count as missing" in list(
        found["identification/diagnostics/warnings"].data
    )
    attributes = found.group_attrs["identification/measurement"]
    assert (attributes["clock_dropped"], attributes["clock_duplicated"]) == (3, 0)
    assert attributes["clock_step"] == pytest.approx(0.02, rel=1e-6)
    missing = np.flatnonzero(np.isnan(found["identification/measurement/measured"].data[:, 0]))
    assert missing.tolist() == [40, 41, 200]
    whole = estimates(run({"a1": a, "v2": v}, scene))
    p = len(whole) // 2
    assert np.all(np.abs(estimates(found) - whole)[:p] < whole[p:])


MATRICES = """\
dynid: 1
kind: identification
structure:
  matrices: {mass: M.npy, stiffness: K.npy, damping: C.npyLABELS}
joints:
  j: {dofs: [1], k: {start: 80, true: 90}}
excitation: [{dof: 2, kind: multisine, amplitude: [3, 2], frequency: [5, 13]}]
measurement:
  step: 0.02
  samples: 100
  channels: [{dof: 1, quantity: velocity}, {dof: 2, quantity: acceleration}]
  simulate: {noise_ratio: 0.02, seed: 3}
"""


def test_a_stated_unit_says_that_a_lumped_inertia_turns(tmp_path):
    (tmp_path / "scene.yaml").write_text(SOURCE.replace("velocity}", "velocity, unit: deg/s}"))
    found = run_scene(load_scene(tmp_path / "scene.yaml"))
    assert list(found.value("identification/measurement/unit")) == ["m/s2", "rad/s"]


@pytest.mark.parametrize(
    ("labels", "stated", "channels", "load", "responses"),
    [
        ("", "", ["", ""], "", ["", ""]),
        ("", ", unit: mm/s", ["m/s", ""], "", ["", ""]),
        ("", ", sensitivity: {value: 2, unit: mV/(deg/s)}", ["rad/s", ""], "", ["", ""]),
        (", labels: ['1:x', '1:rz']", "", ["m/s", "rad/s2"], "N.m", ["m/s/(N.m)", "rad/s2/(N.m)"]),
    ],
)
@pytest.mark.usefixtures("complete")
def test_units_of_dofs_follow_labels_and_stated_units_and_are_never_invented(
    tmp_path, labels, stated, channels, load, responses
):
    for name, diagonal in {"M": [2.0, 1.0], "C": [0.4, 0.2], "K": [300.0, 200.0]}.items():
        np.save(
            tmp_path / f"{name}.npy", np.diag(diagonal) + (name == "K") * np.array([[50.0, -40], [-40, 50]])
        )
    text = MATRICES.replace("LABELS", labels).replace("velocity}", f"velocity{stated}}}")
    (tmp_path / "scene.yaml").write_text(text)
    found = run_scene(load_scene(tmp_path / "scene.yaml"))
    group, derived = "identification/measurement", "identification/derived/gains"
    assert list(found.value(f"{group}/unit")) == channels
    assert list(found.value(f"{group}/input_unit")) == [load]
    gains = [
        one.units for path, one in found.items() if path.startswith(derived) and path.endswith("/dc/value")
    ]
    assert gains == responses
