"""Data of figures that no other test checks: figures and tables hold the values of the result."""

import re
import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import dynid
from dynid.report import figures
from dynid.report.diagrams.responses import rounded_locus
from dynid.report.notation import short
from dynid.result import Result
from dynid.scene.kinds.planning import run_plan
from tests.report.pages import bench, study

pytestmark = pytest.mark.thorough

CONFIGS = Path(__file__).parents[2] / "configs"


@cache
def result(name):
    return dynid.run(dynid.load_scene(CONFIGS / f"{name}.yaml"))


@cache
def drawn(name):
    made = {"bench": bench, "study": study, "plan": planned}
    found = made[name]() if name in made else result(name)
    return {figure.name: figure for figure in figures(found)}


@cache
def planned():
    return run_plan(dynid.load_scene(CONFIGS / "table2.yaml"))


def column(table, name):
    return np.array([row[table.columns.index(name)] for row in table.rows])


def test_a_nyquist_grid_has_a_panel_for_every_input_of_every_output():
    figure = drawn("dc_motor")["nyquist"]
    found = result("dc_motor")["bond_graph/frequency_response/response"].data
    assert figure.svg.count('class="plot"') == 4
    assert "imaginary part (rad/(s·N·m))" in figure.svg
    real, imaginary = (column(figure.table, f"{part} L.f / torque") for part in ("Re", "Im"))
    at = column(figure.table, "angular frequency (rad/s)")
    omega = result("dc_motor")["bond_graph/frequency_response/omega"].data
    np.testing.assert_array_equal(real + 1j * imaginary, found[np.searchsorted(omega, at), 1, 1])


def test_the_impedances_of_a_port_are_those_of_both_sides():
    table = drawn("isolator_port")["port-impedances"].table
    omega = column(table, "angular frequency (rad/s)")
    # The load is the mass on its damper: Z = s m + b, in dB re 1 N s/m.
    np.testing.assert_allclose(
        column(table, "|Z_eq of the load| (dB re N·s/m)"), 20 * np.log10(np.abs(10j * omega + 50)), rtol=1e-12
    )
    np.testing.assert_allclose(
        column(table, "∠ Z_eq of the load (°)"), np.degrees(np.arctan2(10 * omega, 50)), rtol=1e-12
    )


def test_the_characteristic_of_a_port_passes_through_its_operating_point():
    figure = drawn("isolator_port")["performance"]
    flow, effort = (column(figure.table, name) for name in ("flow (m/s)", "effort (N)"))
    what = column(figure.table, "what")
    point = np.array([flow[what == "operating point"], effort[what == "operating point"]])[:, 0]
    assert point.tolist() == [1.0, 50.0]  # at rest all of it moves with the base, held by the damper
    for side in ("source", "load"):
        (a, b) = np.column_stack([flow, effort])[what == side]
        across = (b - a)[0] * (point - a)[1] - (b - a)[1] * (point - a)[0]
        assert across == pytest.approx(0, abs=1e-9)
    assert "effort (N)" in figure.svg


def test_a_time_response_shows_output_and_input_in_their_units():
    figure = drawn("hoist")["time-response"]
    group = "bond_graph/time_response"
    found = result("hoist")
    time = column(figure.table, "time (s)")
    places = np.searchsorted(found[f"{group}/time"].data, time)
    np.testing.assert_array_equal(
        column(figure.table, "m.f (m/s)"), found[f"{group}/response"].data[places, 0]
    )
    assert {"voltage (V)", "k.e (N)"} <= set(figure.table.columns)
    assert figure.caption.startswith("m.f (m/s): ")


def test_a_prediction_stands_beside_what_was_measured_with_the_spectrum_of_what_is_left():
    figure = drawn("table2")["prediction"]
    group = "identification/measurement"
    found = result("table2")
    places = np.searchsorted(found[f"{group}/time"].data, column(figure.table, "time (s)"))
    for name in ("measured", "predicted"):
        np.testing.assert_array_equal(
            column(figure.table, f"{name} 3.velocity (m/s)"), found[f"{group}/{name}"].data[places, 1]
        )
    assert "residual" in figure.svg
    spectra, omega = drawn("table2")["spectra"], found["identification/residual_spectrum/omega"].data
    amplitude = found["identification/residual_spectrum/amplitude"].data[:, 1]
    lines = np.searchsorted(omega, column(spectra.table, "angular frequency (rad/s)") * (1 - 1e-12))
    named = [name for name in spectra.table.columns if "3.velocity" in name]
    assert [name.partition(" 3")[0] for name in named] == ["measured", "predicted", "measured − predicted"]
    np.testing.assert_array_equal(column(spectra.table, named[2]), amplitude[lines])
    assert "(m/s·(s/rad)^½)" in named[0]


@pytest.mark.parametrize(("lacks_fit", "order"), [(False, ["a", "b", "c"]), (True, ["c", "a", "b"])])
@pytest.mark.parametrize(("axis", "name"), [("time", "prediction"), ("omega", "fit")])
def test_the_channel_that_fits_worst_is_drawn_first_where_the_model_lacks_fit(lacks_fit, order, axis, name):
    made, group = Result("identification"), "identification/measurement"
    made.add_axis(f"{group}/{axis}", np.linspace(1, 2, 30))
    made.add_axis(f"{group}/channel", ["a", "b", "c"])
    signal = np.sin(np.arange(30.0))[:, None] * [1.0, 100.0, 0.1] * (1 if axis == "time" else 1 + 0j)
    made.add(f"{group}/measured", signal, (axis, "channel"))
    made.add(f"{group}/predicted", signal * [0.95, 0.99, 0.8], (axis, "channel"))
    made.add("identification/diagnostics/lacks_fit", lacks_fit)
    figure = next(one for one in figures(made) if one.name == name)
    labels = [text.text for text in ET.fromstring(figure.svg).iter() if text.text in order]
    assert [one for at, one in enumerate(labels) if one not in labels[:at]] == order
    assert [one[-1] for one in figure.table.columns if one.startswith(("measured", "Re measured"))] == [
        "a",
        "b",
        "c",
    ]


def test_autocorrelation_is_drawn_with_the_band_of_white_noise():
    figure = drawn("table2")["whiteness"]
    found = result("table2")["identification/diagnostics/autocorrelation"].data
    np.testing.assert_array_equal(column(figure.table, "2.velocity"), found[:, 0])
    assert column(figure.table, "lag (samples)").tolist() == list(range(1, 41))
    assert figure.svg.count(" band") >= 2


def test_a_fit_of_frequency_responses_lists_measured_and_fitted():
    figure = drawn("beam_frf")["fit"]
    found = result("beam_frf")
    group = "identification/measurement"
    places = np.searchsorted(
        found[f"{group}/omega"].data, column(figure.table, "angular frequency (rad/s)") * (1 - 1e-12)
    )
    for title, name in (("measured", "measured"), ("fitted", "predicted")):
        real, imaginary = (
            column(figure.table, f"{part} {title} 6.acceleration/6 (m/s²/N)") for part in ("Re", "Im")
        )
        np.testing.assert_array_equal(real + 1j * imaginary, found[f"{group}/{name}"].data[places, 0])
    assert "frequency (Hz)" in figure.svg


def test_a_plan_ranks_sensors_and_shows_where_to_excite():
    sensors, excitation = (drawn("plan")[name] for name in ("sensors", "excitation"))
    names = column(sensors.table, "sensor").tolist()
    place = list(planned()["plan/sensors/candidate"].data).index("3.acceleration")
    bound = planned()["plan/sensors/bound_alone"].data[place, 0]
    assert column(sensors.table, "relative bound of upper.k")[names.index("3.acceleration")] == bound
    chosen = {name for name, row in zip(names, sensors.table.rows, strict=True) if row[1]}
    assert chosen == set(planned()["plan/sensors/choice"].data)
    np.testing.assert_array_equal(
        column(excitation.table, "force at 1"), planned()["plan/excitation/worth"].data[:, 0]
    )


def test_a_benchmark_is_drawn_as_time_against_error_and_over_size():
    precision, growth = (drawn("bench")[f"bench-roots-{name}"] for name in ("precision", "growth"))
    rows = {(row[0], row[1]): row[2:] for row in precision.table.rows}
    assert rows["exact", 100] == (0.1, 2e7, 3e-14, True)
    assert rows["float", 100][-1] is False
    assert {row[0] for row in growth.table.rows} == {"exact", "float"}
    for figure in (precision, growth):
        assert ">exact" in figure.svg
        assert ">float" in figure.svg
        assert "time (s)" in figure.svg


def test_a_tornado_and_the_parts_of_the_variance_name_the_input_that_matters():
    tornado, parts = (drawn("study")[name].table for name in ("tornado", "sobol"))
    # omega is the root of k; c does nothing.
    swing = {row[1]: abs(row[5] - row[4]) for row in tornado.rows if row[0].startswith("omega")}
    assert swing["parameters.k"] > 50 * swing["parameters.c"]
    first = {row[1]: row[2] for row in parts.rows if row[0].startswith("omega")}
    assert first["k"] > 0.9
    assert first["c"] < 0.2


@pytest.mark.parametrize("entries", [3, 9, 70])
def test_of_a_long_array_a_study_draws_the_first_entries(entries):
    from dynid.result import Result

    found = Result("study", "modes", {"scene": "kind: study\n"})
    count = 5
    found.add_axis("study/sample", np.arange(count))
    found.add("study/exit_code", np.zeros(count, dtype=int), ("sample",))
    found.add("study/samples/parameters.n", np.arange(count), ("sample",))
    found.add_axis("study/results/mode", np.arange(1, entries + 1))
    found.add("study/results/f", np.outer(np.arange(count), np.arange(1, entries + 1.0)), ("sample", "mode"))
    made = {figure.name: figure for figure in figures(found)}
    if entries == 70:
        assert "course" not in made
    else:
        shown = [name for name in made["course"].table.columns if name.startswith("f[")]
        assert shown == [f"f[{k}]" for k in range(1, min(entries, 8) + 1)]
        assert column(made["course"].table, "f[2]").tolist() == [0, 2, 4, 6, 8]


SVG = "{http://www.w3.org/2000/svg}"


@pytest.mark.thorough
def test_only_loops_have_a_critical_point():
    figure = drawn("isolator")["nyquist"]
    assert "critical" not in figure.caption
    assert "−1</title>" not in figure.svg
    assert ">−1</title>" in drawn("isolator_transmissibility")["loop-nyquist"].svg


def test_a_circle_of_resonance_is_drawn_round_from_its_samples():
    # A circle, sampled unevenly with up to 36° between samples.
    angle = np.cumsum(np.tile([0.2, 0.5, 0.63], 4))
    circle = 3 + 2j + 5 * np.exp(1j * angle)
    locus, along = rounded_locus(circle, angle)
    np.testing.assert_array_equal(locus[np.isin(along, angle)], circle)
    inner = (along > angle[1]) & (along < angle[-2])
    assert abs(np.abs(locus[inner] - (3 + 2j)) - 5).max() < 1e-3
    turns = np.abs(np.diff(np.angle(np.diff(locus[inner])[1:] / np.diff(locus[inner])[:-1])))
    assert turns.max() < np.radians(8)
    assert (np.diff(along) > 0).all()
    # Corners, gaps and straight lines stay as they are.
    zigzag = np.array([0, 1, 1 + 1j, 2 + 1j, 2 + 2j, np.nan, 4, 5, 6, 7], dtype=complex)
    np.testing.assert_array_equal(rounded_locus(zigzag, np.arange(10.0))[0], zigzag)


@pytest.mark.thorough
def test_a_time_response_beside_its_nonlinear_one_has_the_ranges_of_both():
    found, caption = result("servo_orifices"), drawn("servo_orifices")["time-response"].caption
    for name in ("response", "nonlinear"):
        peak = found[f"bond_graph/time_response/{name}"].data[:, 1].max()
        law = {"response": "linear", "nonlinear": "nonlinear"}[name]
        assert re.search(rf"\b{law} [^,;]* … {re.escape(short(float(peak)))}", caption), caption


def test_a_map_of_poles_far_from_the_real_axis_shows_their_damping():
    figure = drawn("servo_orifices")["poles-load_spring.q-load"]
    group = next(g for g in ET.fromstring(figure.svg).iter(f"{SVG}g") if g.get("class") == "plot")
    low, high = map(float, group.get("data-x").split()[1:])
    poles = result("servo_orifices")["bond_graph/transfer_function/load_spring.q/load/poles"].data
    assert np.ptp(poles.real) / (high - low) > 0.4
    assert "different scales" in figure.caption
    labels = [t for t in group.iter(f"{SVG}text") if (t.text or "").startswith("ζ")]
    places = sorted(float(t.get("y")) for t in labels)
    assert len(labels) >= 2
    assert np.diff(places).min() >= 10


def test_marks_of_a_benchmark_look_like_no_alternative_and_only_what_is_drawn_has_a_name():
    made = bench()
    for k in range(5):
        group = f"bench/roots/other_{k}"
        made.annotate(group, peer=True, exponent=1.0)
        made.add_axis(f"{group}/size", [20, 100])
        errors = [np.inf, np.inf] if k == 4 else [1e-9, 1e-9 + k]
        for name, values in (("time", [0.1, 0.2]), ("memory", [1e6, 1e6]), ("error", errors)):
            made.add(f"{group}/{name}", values, ("size",))
        for name in ("pareto", "default"):
            made.add(f"{group}/{name}", [False, False], ("size",))
    made.annotate("bench/roots", measure="relative distance; inf: a wrong count")
    figure = {one.name: one for one in figures(made)}["bench-roots-precision"]
    assert "relative distance; ∞: a wrong count" in figure.caption
    legend = next(g for g in ET.fromstring(figure.svg).iter(f"{SVG}g") if g.get("class") == "legend")
    names = [text.text for text in legend.iter(f"{SVG}text")]
    shapes = [re.sub(r"^M\S+ \S+", "", path.get("d").partition("M")[2]) for path in legend.iter(f"{SVG}path")]
    shapes = [re.sub(r"^[\d.]+ [\d.]+", "", shape) for shape in shapes]
    assert "other_4" not in names
    assert {"other_3", "Pareto-optimal in time and error", "default of the suite"} <= set(names)
    assert "infinite ones of other_4" in figure.caption
    classes = [path.get("class") for path in legend.iter(f"{SVG}path")]
    filled = [shape + cls.partition(" ")[2] for shape, cls in zip(shapes, classes, strict=True)]
    assert len(set(filled)) == len(names)


def test_estimates_stand_in_the_order_of_the_table():
    figure = drawn("table2")["estimates"]
    ticks = [t for t in ET.fromstring(figure.svg).iter(f"{SVG}text") if t.get("text-anchor") == "end"]
    names = [t.text for t in sorted(ticks, key=lambda t: float(t.get("y")))]
    assert names == [row[0] for row in figure.table.rows]
    estimate, true = column(figure.table, "estimate"), column(figure.table, "true")
    circles = [
        p for p in ET.fromstring(figure.svg).iter(f"{SVG}path") if p.get("class") == "s2 dot" and len(p)
    ]
    down = sorted(circles, key=lambda p: float(p.get("d").split()[1].partition("a")[0]))
    across = [float(p.get("d")[1:].split()[0]) for p in down]
    assert np.corrcoef(across, estimate / true - 1)[0, 1] == pytest.approx(1, abs=1e-3)
