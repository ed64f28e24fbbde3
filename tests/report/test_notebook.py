"""Results in notebooks: HTML, and figures on axes of matplotlib."""

import re
from html.parser import HTMLParser
from pathlib import Path

import matplotlib
import numpy as np
import pytest

import dynid
from dynid.errors import UsageError
from dynid.report import figures, notebook
from dynid.report.notebook import axes
from dynid.report.plot import (
    Annotation,
    BandLayer,
    Bars,
    Chart,
    Curve,
    Heatmap,
    Markers,
    PlotAxis,
    ReferenceLine,
    Subplot,
)
from dynid.result import Result

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.fixture(autouse=True)
def _without_a_window():
    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    yield
    plt.close("all")


@pytest.fixture(scope="module")
def motor():
    return dynid.run(dynid.load_scene(CONFIGS / "dc_motor.yaml"))


class Tags(HTMLParser):
    """Checks that every tag is closed in order."""

    def __init__(self):
        super().__init__()
        self.open, self.text = [], ""

    def handle_starttag(self, tag, attrs):  # noqa: ARG002
        if tag != "br":
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def test_a_notebook_shows_title_method_and_sections(motor):
    page = Tags()
    page.feed(motor._repr_html_())
    assert not page.open
    assert "DC motor, speed" in page.text
    assert "bond graph · exact engine" in page.text
    assert "−2.003" in page.text
    assert "<dt>poles</dt>" in motor._repr_html_()


def test_names_of_a_scene_cannot_become_tags():
    assert "<b>" not in Result("bond-graph", "<b>bold</b>")._repr_html_()
    assert "&lt;b&gt;bold" in Result("bond-graph", "<b>bold</b>")._repr_html_()


def test_a_bode_diagram_has_the_values_of_the_result(motor):
    gain, phase = motor.plot("bode").ravel()
    response = motor["bond_graph/frequency_response/response"].data[:, 0, 0]
    line = gain.get_lines()[0]
    np.testing.assert_allclose(line.get_ydata(), 20 * np.log10(np.abs(response)), rtol=1e-12)
    assert gain.get_xscale() == "log"
    assert "dB" in gain.get_ylabel()
    assert "°" in phase.get_ylabel() or "deg" in phase.get_ylabel()
    (legend,), canvas = gain.figure.legends, gain.figure.canvas
    canvas.draw()
    assert not any(legend.get_window_extent().overlaps(ax.get_window_extent()) for ax in (gain, phase))


def test_several_subplots_are_an_array_of_rows_and_columns(motor):
    grid = motor.plot("bode")
    assert grid.shape == (2, 1)
    assert "dB" in grid[0, 0].get_ylabel()


def test_formulas_and_sentences_are_set_as_on_the_page(motor):
    """No power as in Python or with a caret, no bare backticks; a dash for a number that is unknown."""
    from dynid.report.content.blocks import NumberedList, Statement, TextTable, definitions
    from dynid.report.page.html import node

    shown = motor._repr_html_()
    assert "**" not in shown
    assert not re.search(r"s\^\d", shown)
    assert "<sup>2</sup>" in shown
    assert node(Statement("use `limits`"), "") == '<p class="note">Use <code>limits</code>.</p>'
    assert "s<sup>4</sup>⋅k" in node(NumberedList(("s**4*k",)), "")
    assert "<dd>s<sup>4</sup> + 1</dd><dd>x</dd>" in node(definitions(("a", ("s^4 + 1", "x"))), "")
    rows = node(TextTable(("", "a"), (("2*k", "-"),)), "")
    assert '<th scope="row">2*k</th><td class="n">—</td>' in rows


def test_single_numbers_beside_a_table_are_attributes_of_its_frame(motor):
    pytest.importorskip("pandas")
    table = motor.to_pandas("bond_graph/properties/J.f/voltage")
    group = "bond_graph/properties/J.f/voltage"
    omega = motor[f"{group}/natural_frequency"].data
    in_hertz = omega / (2 * np.pi)  # as the scene is written
    assert list(table["natural_frequency"]) == pytest.approx(in_hertz, rel=1e-15)
    numbers = table.attrs["numbers"]
    assert numbers["dc_gain"] == motor.value(f"{group}/dc_gain")
    assert numbers["stable"] is True
    assert "natural_frequency" not in numbers
    assert table.attrs["units"]["dc_gain"] == motor[f"{group}/dc_gain"].units
    assert motor.to_pandas("frequency_response").attrs.keys() == {"title", "units"}


@pytest.mark.parametrize("late", [True, False])
def test_frames_keep_what_is_approximate(late):
    pytest.importorskip("pandas")
    result = Result("bond-graph")
    mark = {"approximate": "delays are Padé approximants of order 6"} if late else {}
    result.add("g/a/damping_ratio", [0.1, 0.2], ("mode",), **mark)
    result.add("g/a/overshoot", 3.0, (), **mark)
    result.add("g/a/dc_gain", 1.0)
    result.add("g/b/peak", 2.0, (), **mark)
    said = mark.get("approximate")
    wanted = {"damping_ratio": said, "overshoot": said} if late else None
    assert result.to_pandas("g/a").attrs.get("approximate") == wanted
    assert result.to_pandas("g/b").attrs.get("approximate") == ({"peak": said} if late else None)


def test_one_subplot_is_one_axes(motor):
    ax = motor.plot("poles-J.f-voltage")
    poles = motor["bond_graph/transfer_function/J.f/voltage/poles"].data
    drawn = np.concatenate([line.get_xdata() for line in ax.get_lines() if line.get_marker() == "x"])
    assert sorted(drawn) == pytest.approx(sorted(poles.real))


def test_every_figure_is_drawn_or_refused(motor):
    for figure in figures(motor):
        if figure.name.startswith(("bond-graph", "reduction", "prototype")):
            with pytest.raises(UsageError, match="is a drawing without axes"):
                motor.plot(figure.name)
        else:
            assert motor.plot(figure.name) is not None


def test_a_figure_is_suggested_and_svg_is_drawn_as_before(motor):
    with pytest.raises(UsageError, match="no figure 'bod'; did you mean 'bode'"):
        motor.plot("bod")
    for wrong, meant in {
        "bond_graph/frequency_response": "bode",
        "poles": r"poles-J\.f-",
        "time_response": "time-response",
    }.items():
        with pytest.raises(UsageError, match=f"no figure '{wrong}'; did you mean '{meant}"):
            motor.plot(wrong)
    assert next(one for one in figures(motor) if one.name == "bode").svg.startswith("<svg")


def test_every_layer_is_drawn(monkeypatch):
    from dynid.report.figure import Figure

    x = np.array([1.0, 2.0, 3.0])
    layers = [
        Curve(x, x, "curve", "s2 dash"),
        BandLayer(x, x - 1, x + 1, "band", "s3"),
        Markers(x, x, "markers", symbol="ring"),
        *(
            Markers(x, x + 1, symbol=symbol)
            for symbol in ("o", "square", "x", "+", "diamond", "up", "down", "kite")
        ),
        Bars([1, 2], 0, [2, 3], "bars"),
        Bars([1, 2], 0, [2, 3], thick=np.array([0.5, 0.7]), flat=True),
        ReferenceLine(2.0, "level"),
        ReferenceLine(1.5, upright=True),
        Annotation(1, 1, "here", anchor="end"),
    ]
    plots = [
        Subplot(PlotAxis("x", low=0, high=4), PlotAxis("y"), layers, title="all", square=True),
        Subplot(
            PlotAxis("", names=("a", "b")),
            PlotAxis("", names=("c", "d")),
            [Heatmap(np.eye(2), -1, 1, [["1", "0"], ["0", "1"]])],
        ),
    ]
    figure = Figure("all", "All layers", lambda: Chart([plots, plots[:1]]))
    monkeypatch.setattr(notebook, "figures", lambda _: [figure])
    grid = axes(Result("bond-graph"), "all")
    assert grid.shape == (2, 2)
    assert list(grid[0, 0].figure.get_size_inches()) == pytest.approx([1.1 * 6.4, 1.1 * 4.8])
    labels = {text.get_text() for text in grid[0, 0].figure.legends[0].get_texts()}  # once for all subplots
    assert labels == {"curve", "band", "markers", "bars", "level"}
    assert grid[0, 0].get_lines()[0].get_linestyle() == "--"
    assert [tick.get_text() for tick in grid[0, 1].get_xticklabels()] == ["a", "b"]
    cells = {text.get_text(): text.get_color() for text in grid[0, 1].texts}
    assert cells == {"1": "white", "0": "black"}
    assert not grid[1, 1].axison
