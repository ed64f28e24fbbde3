"""Plots: round ticks without overlap, decimated curves, everything within the picture."""

import math
import re
import xml.etree.ElementTree as ET
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.report.figure import table_of
from dynid.report.notation import labelled, unit
from dynid.report.plot import (
    BandLayer,
    Bars,
    Chart,
    Curve,
    Heatmap,
    Markers,
    PlotAxis,
    ReferenceLine,
    Subplot,
    in_rows,
    parallel_coordinates,
    series_class,
)
from dynid.report.plot.chart import PageSpace, embedded, fitted_label
from dynid.report.plot.layers import by_column, decimated, runs, straightened
from dynid.report.svg import SIZE, SMALL, text_width

SVG = "{http://www.w3.org/2000/svg}"
finite = st.floats(-1e12, 1e12, allow_subnormal=False)


def geometry(text):
    """Return the boxes of all upright texts, the frames of the panels, and the box of the picture."""
    root = ET.fromstring(text)
    view = tuple(map(float, root.get("viewBox").split()))
    texts = []
    for element in root.iter(f"{SVG}text"):
        if element.get("transform"):
            continue
        cls = element.get("class") or ""
        size = 14 if "title" in cls else SMALL if "small" in cls else 12
        width = text_width(element.text or "", size, bold="strong" in cls or "title" in cls)
        x, y = float(element.get("x")), float(element.get("y"))
        left = x - width * {"middle": 0.5, "end": 1.0}.get(element.get("text-anchor"), 0.0)
        texts.append((element.text, cls, (left, y - 0.8 * size, left + width, y + 0.2 * size)))
    frames = [tuple(map(float, g.get("data-box").split())) for g in root.iter(f"{SVG}g") if g.get("data-box")]
    return texts, frames, view


def overlap(a, b):
    return a[0] < b[2] - 0.5 and b[0] < a[2] - 0.5 and a[1] < b[3] - 0.5 and b[1] < a[3] - 0.5


def well_laid_out(text):
    """List what is wrong with the places of texts: outside the picture, on each other, a legend over data."""
    texts, frames, (_, _, width, height) = geometry(text)
    found = [
        f"{t} leaves the picture"
        for t, _, b in texts
        if b[0] < -1 or b[1] < -1 or b[2] > width + 1 or b[3] > height + 1
    ]
    outside = [(t, c, b) for t, c, b in texts if "tick" in c or "label" in c or not c]
    found += [
        f"{one[0]} and {other[0]}" for one, other in combinations(outside, 2) if overlap(one[2], other[2])
    ]
    boxes = [(x, y, x + w, y + h) for x, y, w, h in frames]
    found += [f"{t} over data" for t, c, b in outside for box in boxes if overlap(b, box)]
    return found


@given(st.floats(-1e3, 1e3), st.floats(1e-3, 1e3), st.floats(60, 900), st.booleans(), st.booleans())
@settings(max_examples=60, deadline=None)
def test_an_axis_has_two_ticks_at_least(low, span, length, upright, log):
    ends = (10 ** (low / 1e3), 10 ** (low / 1e3) * (1.5 + span)) if log else (low, low + span)
    axis = PlotAxis("x (m)", log=log, low=ends[0], high=ends[1])
    ticks = axis.ticks(axis.scale([]), length, upright=upright)
    assert len(ticks.values) >= 2 or (not upright and length < 170)  # labels of five digits, side by side


def test_a_residual_that_is_round_off_has_a_power_of_ten_on_its_axis():
    axis = PlotAxis("residual (m)")
    ticks = axis.ticks(axis.scale([[-1.3e-15, 0.9e-15]]), 64, upright=True)
    assert ticks.power == -15
    assert max(map(len, ticks.labels)) <= 4
    assert len(ticks.labels) == 2


@given(finite, finite, st.floats(40, 900), st.booleans())
@settings(max_examples=25, deadline=None)
def test_ticks_are_within_the_axis_and_their_labels_apart(a, b, length, upright):
    axis = PlotAxis("x (m)")
    scale = axis.scale([[a, b]])
    assert scale.low <= min(a, b)
    assert max(a, b) <= scale.high
    ticks = axis.ticks(scale, length, upright=upright)
    span = scale.high - scale.low
    assert all(scale.low - 1e-6 * span <= value <= scale.high + 1e-6 * span for value in ticks.values)
    assert ticks.fit(scale, length, upright) or len(ticks.values) < 2
    assert len(set(ticks.labels)) == len(ticks.labels)


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6), st.floats(80, 900))
@settings(max_examples=25, deadline=None)
def test_a_label_says_the_value_at_its_tick(low, span, length):
    axis = PlotAxis("x")
    scale = axis.scale([[low, low + span]])
    ticks = axis.ticks(scale, length, upright=True)
    for value, label in zip(ticks.values, ticks.labels, strict=True):
        said = float(label.replace("−", "-").replace("\N{NARROW NO-BREAK SPACE}", "")) * 10.0**ticks.power
        assert said == pytest.approx(value, rel=1e-9, abs=1e-9 * span)


@given(st.floats(-12, 12), st.floats(0.01, 20), st.floats(80, 900), st.booleans())
@settings(max_examples=25, deadline=None)
def test_logarithmic_ticks_are_apart_and_within(low, decades, length, upright):
    axis = PlotAxis("f (Hz)", log=True)
    scale = axis.scale([[10.0**low, 10.0 ** (low + decades)]])
    ticks = axis.ticks(scale, length, upright=upright)
    assert ticks.fit(scale, length, upright) or len(ticks.values) < 2
    assert all(scale.low * (1 - 1e-9) <= v <= scale.high * (1 + 1e-9) for v in (*ticks.values, *ticks.minor))


@given(st.lists(finite, min_size=1, max_size=400), st.integers(1, 60))
@settings(max_examples=25, deadline=None)
def test_thinning_keeps_the_extremes_of_every_pixel_column(values, width):
    y = np.array(values)
    x = np.linspace(0, width, len(y))
    kept = by_column(x, y)
    assert kept[0] == 0
    assert kept[-1] == len(y) - 1
    for column in set(np.floor(x)):
        own = np.flatnonzero(np.floor(x) == column)
        left = kept[np.isin(kept, own)]
        assert y[left].min() == y[own].min()
        assert y[left].max() == y[own].max()
        assert left[0] == own[0]
        assert left[-1] == own[-1]
    if len(y) > 4 * (width + 1):
        assert len(kept) <= 4 * (width + 1)


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=120), st.floats(0.05, 2))
@settings(max_examples=25, deadline=None)
def test_what_is_left_out_is_near_the_line_that_stays(values, near):
    y = np.array(values)
    x = np.arange(len(y), dtype=float)
    kept = straightened(x, y, near)
    assert np.abs(np.interp(x, x[kept], y[kept]) - y).max() <= near * (1 + 1e-9) + 1e-9
    assert y[kept].max() == y.max()
    assert y[kept].min() == y.min()


def test_a_line_of_a_million_points_is_small_and_breaks_at_what_is_unknown():
    x = np.linspace(0, 600, 10**6)
    y = np.sin(x) * 100
    y[5] = np.nan
    pieces = [decimated(*run) for run in runs(x, y)]
    assert len(pieces) == 2
    assert sum(len(piece[0]) for piece in pieces) < 4 * 602
    assert max(piece[1].max() for piece in pieces) == np.nanmax(y)


def drawn(rows, **options):
    return Chart(rows, "about", **options).picture("some", "A figure").svg


def sample(seed=0, columns=2):
    rng = np.random.default_rng(seed)
    x = np.linspace(0, 10, 300)
    y = rng.normal(size=300).cumsum() * 10.0 ** rng.integers(-8, 8)
    layers = [
        BandLayer(x, y - 1, y + 1, "a band", "s1"),
        Curve(x, y, "a rather long name of a line, as scenes may have", series_class(0)),
        Markers(x[::30], y[::30], "points", "s3", "ring", 3, [str(k) for k in range(10)]),
        ReferenceLine(float(y.mean()), "mean", "s2 dashed"),
    ]
    bars = [Bars(np.arange(4.0), np.zeros(4), np.abs(y[:4]), "bars", "s4")]
    cells = [Heatmap(rng.normal(size=(3, 3)), -1, 1, [["1", "2", "3"]] * 3, [["tip"] * 3] * 3)]
    panels = [
        Subplot(PlotAxis("time (s)"), PlotAxis("force (N)"), layers, "first"),
        Subplot(PlotAxis("what", names=("a", "b", "c", "d")), PlotAxis("size (m)"), bars),
        Subplot(PlotAxis("column", names=tuple("xyz")), PlotAxis("row", names=tuple("abc")), cells, "cells"),
        Subplot(
            PlotAxis("f (Hz)", log=True),
            PlotAxis("|H|", log=True),
            [Curve(x + 0.1, np.abs(y) + 1e-9, "H", series_class(8))],
        ),
    ]
    return drawn(in_rows(panels, columns))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("columns", [1, 2])
def test_texts_are_within_the_picture_off_each_other_and_off_the_data(seed, columns):
    assert well_laid_out(sample(seed, columns)) == []


def test_a_plot_is_the_same_each_time_and_its_text_is_text():
    assert sample() == sample()
    root = ET.fromstring(sample())
    texts = {element.text for element in root.iter(f"{SVG}text")}
    assert {"time (s)", "first", "a band", "points", "mean", "a", "b", "c", "d"} <= texts


def test_a_script_can_tell_the_values_under_the_pointer():
    root = ET.fromstring(drawn([[Subplot(PlotAxis("t (s)"), PlotAxis("y"), [Curve([0, 4], [1, 3], "own")])]]))
    plot = next(g for g in root.iter(f"{SVG}g") if g.get("class") == "plot")
    left, top, width, height = map(float, plot.get("data-box").split())
    (kind, *ends), (_, *up) = plot.get("data-x").split(), plot.get("data-y").split()
    assert kind == "lin"
    line = next(p for p in plot.iter(f"{SVG}path") if p.get("data-name") == "own")
    points = [tuple(map(float, pair)) for pair in re.findall(r"[ML]\s*(-?[\d.]+) (-?[\d.]+)", line.get("d"))]
    low, high = map(float, ends)
    bottom, ceiling = map(float, up)
    seen = [
        (low + (x - left) / width * (high - low), bottom + (top + height - y) / height * (ceiling - bottom))
        for x, y in points
    ]
    assert seen == [pytest.approx((0, 1), abs=0.02), pytest.approx((4, 3), abs=0.02)]


def test_a_label_longer_than_its_axis_is_above_and_its_units_are_never_cut():
    plot = Subplot(PlotAxis("time (s)"), PlotAxis("10.acceleration/6 (m/s²/N)"), [Curve([0, 1], [0, 1])])
    for height in (64.0, 300.0):
        texts = [t.text for t in ET.fromstring(drawn([[plot]], height=height)).iter(f"{SVG}text")]
        beside = ["10.acceleration/6", "m/s²/N"] if height < 100 else ["10.acceleration/6 (m/s²/N)"]
        assert set(beside) <= set(texts)
    below, _ = fitted_label("largest relative distance from the exact roots (rad/s)", 150.0)
    assert "…" in below
    assert below.endswith(" (rad/s)")
    assert text_width(below, SMALL) <= 150
    whole = "imaginary part (rad/s)"
    assert fitted_label(whole, text_width(whole, SMALL)) == (whole, "label small")
    for space in (text_width(whole, SMALL) - 1, text_width("Im (rad/s)", SIZE)):
        assert fitted_label(whole, space) == ("Im (rad/s)", "label")
    assert fitted_label("real part (10³ rad/s)", 100.0) == ("Re (10³ rad/s)", "label")
    assert fitted_label("imaginary part", 60.0) == ("Im", "label")
    small = Subplot(PlotAxis("t (s)"), PlotAxis("a long name of a spool (m)"), [Curve([0, 1], [0, 3e-6])])
    assert ">10⁻⁶ m<" in drawn([[small]], height=64.0)
    density = Subplot(PlotAxis("t (s)"), PlotAxis("ASD (m/s·(s/rad)^½)"), [Curve([0, 1], [0, 3e-3])])
    assert ">10⁻³ m/s·(s/rad)^½<" in drawn([[density]], height=64.0)


def test_nothing_to_show_is_drawn_as_such():
    nothing = [np.nan, np.nan]
    text = drawn([[Subplot(PlotAxis("x"), PlotAxis("y", log=True), [Curve(nothing, nothing, "none")])]])
    assert "nan" not in re.sub(r"<style>.*?</style>", "", text, flags=re.S)
    assert well_laid_out(text) == []


def test_samples_as_lines_have_a_line_each_and_no_text_on_another():
    values = np.random.default_rng(1).normal(size=(50, 4))
    text = parallel_coordinates(
        "p", "Samples", [PlotAxis(label) for label in ("a (m)", "b", "c", "d")], values
    )
    assert (
        sum(
            path.get("d").count("M")
            for path in ET.fromstring(text).iter(f"{SVG}path")
            if "fine" in path.get("class")
        )
        == 50
    )
    texts, _, _ = geometry(text)
    assert "Samples" in [one[0] for one in texts]
    token = embedded.set(PageSpace(400.0))
    try:  # a page has the title above the figure
        alone = parallel_coordinates("p", "Samples", [PlotAxis("a (m)"), PlotAxis("b")], values[:, :2])
    finally:
        embedded.reset(token)
    assert "Samples" not in [one[0] for one in geometry(alone)[0]]
    assert not [1 for one, other in combinations(texts, 2) if overlap(one[2], other[2])]


def test_a_long_table_keeps_first_and_last_and_says_what_it_leaves_out():
    values = np.arange(1000) / 7
    table = table_of({"x": values})
    assert len(table.rows) == 200
    assert (table.rows[0][0], table.rows[-1][0]) == (0, 999 / 7)
    assert all(row[0] in values for row in table.rows)
    assert "1,000" in table.note
    assert table_of({"x": values[:200]}).note == ""
    assert all(a[0] < b[0] for a, b in pairwise(table.rows))


def test_units_are_written_as_people_do():
    assert unit("m/s.(s/rad)^0.5") == "m/s·(s/rad)^½"
    assert unit("m/s2/N") == "m/s²/N"
    assert labelled("joint.k", "N.m/rad") == "joint.k (N·m/rad)"
    assert math.isclose(text_width(labelled("x")), text_width("x"))
