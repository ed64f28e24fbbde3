"""Pages: complete without scripts, without network access, reproducible, and true to the result."""

import json
import math
import re
from base64 import b64decode, b64encode
from hashlib import sha256
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynid.report import figure as figure_module
from dynid.report import figures
from dynid.report.content.blocks import ReportSection, TextTable
from dynid.report.content.identifiability import shift_text
from dynid.report.content.reduction import seconds_text
from dynid.report.content.transfer_functions import sensitivity_text
from dynid.report.figure import Figure, FigureTable, Picture
from dynid.report.page import document, page, samples
from dynid.report.page.html import (
    CELLS,
    ROWS,
    Markup,
    figure_table,
    formula,
    shown_rows,
    tag,
    text,
    with_code,
)
from dynid.report.plot import Curve
from dynid.report.plot.record import layer_data, thinning
from tests.report.pages import HOSTILE, result_of, run, study, template

KINDS = ["bond-graph", "identification", "reduction", "study", "bench"]
VOID = {"meta", "br", "input", "link"}


class Reader(HTMLParser):
    """Reads a page: elements with their attributes, texts, and whether what opens is closed."""

    def __init__(self, html):
        super().__init__()
        self.elements, self.open, self.texts, self.scripts = [], [], [], []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        (self.scripts if self.open and self.open[-1] == "script" else self.texts).append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.texts).split())


@pytest.fixture(scope="module", params=KINDS)
def made(request):
    result = result_of(request.param)
    html = page(result)
    return result, html, Reader(html)


def test_a_page_is_well_formed_and_the_same_each_time(made):
    result, html, reader = made
    assert reader.open == []
    assert page(result) == html


def test_nothing_on_a_page_leads_away_from_it(made):
    _, html, reader = made
    for name, attrs in reader.elements:
        assert name not in ("img", "iframe", "object", "embed", "form", "base", "link", "audio", "video")
        assert all(not key.startswith("on") for key in attrs), (name, attrs)
        for key in ("src", "href", "xlink:href", "action", "data", "srcset"):
            assert str(attrs.get(key, "#")).startswith("#"), (name, attrs)
    assert not re.search(r"@import|url\((?!#)", html)


def test_the_policy_allows_the_pages_own_scripts_and_nothing_else(made):
    _, _, reader = made
    policy = next(
        a["content"] for _, a in reader.elements if a.get("http-equiv") == "Content-Security-Policy"
    )
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == "'none'"
    types = [attrs.get("type") for name, attrs in reader.elements if name == "script"]
    code = [script for script, kind in zip(reader.scripts, types, strict=True) if kind is None]
    hashes = {f"'sha256-{b64encode(sha256(script.encode()).digest()).decode()}'" for script in code}
    assert set(rules["script-src"].split()) == hashes
    assert "connect-src" not in rules


def test_every_id_is_one_elements_own_and_every_link_has_its_target(made):
    _, _, reader = made
    ids = [attrs["id"] for _, attrs in reader.elements if "id" in attrs]
    assert len(ids) == len(set(ids))
    assert {attrs["href"][1:] for name, attrs in reader.elements if name == "a"} <= set(ids)


def test_every_figure_stands_on_the_page_with_caption_and_table(made):
    result, html, reader = made
    every = figures(result)
    drawn = [attrs for name, attrs in reader.elements if (name, attrs.get("role")) == ("svg", "img")]
    first = re.findall(
        r'<figure id="figure-[^"]*-first"', html
    )  # the first plots of a figure that is whole below
    assert len(drawn) == len(every) + len(first)
    tables = sum(1 for name, attrs in reader.elements if (name, attrs.get("class")) == ("details", "table"))
    assert tables == sum(figure.table is not None for figure in every) + 1  # and the list of arrays
    for figure in every:
        assert str(text(figure.caption)) in html


def test_the_scene_stands_at_the_end_line_by_line(made):
    result, _, reader = made
    if "scene" not in result.attrs:
        return
    lines = [attrs for name, attrs in reader.elements if (name, attrs.get("class")) == ("span", "line")]
    assert len(lines) == len(result.attrs["scene"].splitlines())
    assert result.attrs["scene"].strip() in "".join(reader.texts)


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("bond-graph", ["zeros", "poles", "relative degree", "stable"]),
        ("identification", ["estimate", "95 % interval", "bound", "Converged"]),
        ("reduction", ["worst error", "least MAC", "serep"]),
        ("study", ["59 done · 1 failed", "mode/omega [rad/s]", "min (sample)", "no <b>root</b> at 3"]),
        (
            "bench",
            ["exact", "10 ms", "●", "exact up to 60 states", "slow: too slow"],
        ),
    ],
)
def test_the_answer_comes_first(kind, said):
    html = page(result_of(kind))
    answer = Reader(html[html.index('<section id="answer"') : html.index("<figure")]).texts
    assert all(any(words in text for text in answer) for words in said), answer


@pytest.mark.parametrize(
    ("kind", "first", "folded"),
    [
        ("bond-graph", ["bode", "poles", "time-response"], ["Reduction", "Model scope"]),
        (
            "identification",
            ["estimates", "prediction", "correlation"],
            ["Record and residuals", "Model scope"],
        ),
        ("reduction", ["reduction-frf", "reduction-frequencies", "mac"], ["Model scope"]),
        ("study", ["distributions", "tornado", "scatter"], ["Sources of the variance"]),
    ],
)
def test_key_figures_stand_beside_the_answer_and_derivations_are_folded(kind, first, folded):
    html = page(result_of(kind))
    parts = [part for part in html.split('<section id="')[1:] if part.partition('"')[0] in PARTS]
    assert [part.partition('"')[0] for part in parts] == [
        name for name in PARTS if any(part.startswith(f'{name}"') for part in parts)
    ]
    drawn = re.findall(r'<figure id="figure-([^"]*)"', parts[0])
    assert len(drawn) <= 3
    assert all(name.startswith(wanted) for name, wanted in zip(drawn, first, strict=False)), drawn
    for title in folded:
        assert re.search(rf'<details id="[^"]*" class="fold"><summary><h3>{title}</h3>', html), title
    index = html[html.index('class="index"') : html.index("</nav>")]
    assert set(re.findall(r'href="#figure-([^"]*)"', index)) == {f.name for f in figures(result_of(kind))}


def test_a_page_of_a_long_record_of_many_channels_has_all_samples_and_is_small():
    from tests.report.test_pages_in_browser import long_record

    result = long_record(channels=12)
    html = page(result)
    assert len(html.encode()) <= 3_000_000
    _, data = (json.loads(text) for text in Reader(html).scripts if text.startswith('{"samples"'))
    assert data["samples"] == 1
    assert "The page has the extremes of" not in html
    group = "identification/measurement"
    measured, predicted = (result[f"{group}/{name}"].data for name in ("measured", "predicted"))
    (record, model), (residual,) = (plot["layers"] for plot in data["plots"][6:8])
    assert model["difference"] == [[6, 0], [7, 0]]  # stored once
    for layer, signal in ((record, measured[:, 3]), (residual, measured[:, 3] - predicted[:, 3])):
        codes = np.frombuffer(b64decode(layer["y"]["codes"]), "<u2")
        low, high = layer["y"]["low"], layer["y"]["high"]
        assert np.abs(low + codes / 65534 * (high - low) - signal).max() <= 0.51 * (high - low) / 65534


def test_a_page_of_a_longer_record_keeps_its_extremes():
    layer = Curve(np.arange(1001.0), np.sin(np.arange(1001.0) ** 2), "a")
    (every, values), space = thinning([layer] * 100, 0), 20_000
    assert (every, values) == (6, 16_683)
    assert values <= space
    data = layer_data(layer, False, False, every)
    codes = np.frombuffer(b64decode(data["y"]["codes"]), "<u2")
    for k in range(0, 1001, 12):
        low, high = (
            codes[k // 6 : k // 6 + 2] / 65534 * (data["y"]["high"] - data["y"]["low"]) + data["y"]["low"]
        )
        part = np.asarray(layer.y)[k : k + 12]
        assert [low, high] == pytest.approx([part.min(), part.max()], abs=2e-5)
    gaps = layer_data(Curve([1.0, 2.0, 4.0], [np.nan, 1.0, 2.0]), False, False, 1)
    assert np.frombuffer(b64decode(gaps["y"]["codes"]), "<u2").tolist() == [65535, 0, 65534]
    assert np.frombuffer(b64decode(gaps["x"]["numbers"]), "<f4").tolist() == [1.0, 2.0, 4.0]
    even = layer_data(Curve([1.0, 10.0, 100.0], [1.0, 10.0, 100.0]), True, True, 1)
    assert even["x"] == {"from": 1.0, "to": 100.0, "count": 3}
    assert np.frombuffer(b64decode(even["y"]["codes"]), "<u2").tolist() == [0, 32767, 65534]


PARTS = ["answer", "figures", "details", "derivations", "samples", "scene", "provenance"]


def test_of_a_long_table_of_the_answer_the_first_rows_are_shown_and_all_folded():
    rows = tuple((f"row {k}", str(k)) for k in range(40))
    section = ReportSection("Long", (TextTable(("", "n"), rows),), "answer")
    part = str(document._answer([section], [], "a note", 6).inside)
    assert part.index("a note") < part.index("row 5") < part.index("All 40 rows") < part.index("row 39")
    assert part.count(">row 39<") == 1


def test_of_a_tall_figure_the_answer_has_the_first_plots_legibly_and_a_link_to_all():
    result = study()
    for k in range(9):
        result.add(f"study/results/mode/a_{k}", np.random.default_rng(k).normal(size=60), ("sample",), "m")
    html = page(result)
    parts = dict(part.split('"', 1) for part in html.split('<section id="')[1:])
    shown = parts["answer"].partition('<figure id="figure-distributions-first"')[2].partition("</figure>")[0]
    whole = parts["figures"].partition('<figure id="figure-distributions"')[2].partition("</figure>")[0]
    few, every = (part.count('<g class="plot"') for part in (shown, whole))
    assert 2 <= few <= 6 < every
    assert f"All plots: {every - few} more" in shown
    assert 'href="#figure-distributions"' in shown
    assert "<table" in whole
    width, height = map(float, re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', shown).groups())
    column, tallest, smallest = 383, 384, 10  # px, of the style sheet at a width of 1280 px, and of the fonts
    assert min(column / width, tallest / height) * smallest > 9


def test_transfer_functions_stand_in_raised_powers():
    assert formula("-2.5 ± 3e-06j, x - 1, a-1") == "−2.5~±~3·10<sup>−6</sup>j, x - 1, a-1".replace(
        "~", "\N{NO-BREAK SPACE}"
    )
    assert (
        formula("see `dynid bench a-b`")
        == with_code("see `dynid bench a-b`")
        == "see <code>dynid bench a-b</code>"
    )
    assert with_code("`<b>`") == "<code>&lt;b&gt;</code>"
    assert formula("s**2*m + s^10 < 1") == "s<sup>2</sup>⋅m + s<sup>10</sup> &lt; 1"


def test_the_parameters_of_an_identification_are_the_files():
    result = result_of("identification")
    html = page(result)
    for name, start in zip(
        result["identification/parameters/name"].data,
        result["identification/parameters/start"].data,
        strict=True,
    ):
        row = re.search(
            rf"<tr><th scope=\"row\">{re.escape(name)} [^<]*</th><td class=\"n\">([^<]*)</td>", html
        )
        shown = float(row[1].replace("\N{NO-BREAK SPACE}", ""))
        assert shown == pytest.approx(start, rel=1e-3)  # four digits are shown


def test_unmet_expectations_are_said():
    scene = template("bond-graph").split("\nexpect:")[0]
    result = run(f"{scene}\nexpect:\n  - {{path: bond_graph/nodes, value: -1}}\n")
    assert "0 of 1 expectation met" in Reader(page(result)).text


@pytest.mark.parametrize("kind", ["bond-graph", "study", "bench", "unknown"])
def test_titles_labels_and_scenes_cannot_break_out(kind):
    from dynid.result import Result

    result = Result(kind, HOSTILE, {"scene": HOSTILE, HOSTILE[:9]: HOSTILE})
    result.merge({"study": study(9, failed=()), "bench": result_of("bench")}.get(kind, Result(kind)))
    if kind == "study":
        result.add(
            f"study/samples/{HOSTILE.replace('/', '')}", np.full(9, HOSTILE, dtype=object), ("sample",)
        )
    html = page(result)
    reader = Reader(html)
    assert reader.open == []
    assert "alert(1)" not in "".join(script for script in reader.scripts if "querySelector" in script)
    assert not any(name == "img" for name, _ in reader.elements)
    shown = "".join(reader.texts)
    assert "<img src=x onerror=alert(2)>&amp;⟨U+202E⟩⟨U+0007⟩" in shown
    assert not set(html) & {"\u202e", "\u0007"}


@given(st.text(max_size=20))
def test_any_text_is_read_back_as_it_was_but_for_control_characters(value):
    reader = Reader(str(tag("p", value, title=value)))
    assert reader.open == []
    kept = re.sub("\r", "\n", value)
    if not re.search(
        "[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff\u202a-\u202e\u2066-\u2069]", kept
    ):
        assert "".join(reader.texts) == kept
        assert reader.elements[0][1]["title"] == kept
    str(text(value)).encode()


def test_markup_is_not_escaped_twice():
    assert tag("p", Markup("<b>x</b>"), "<") == "<p><b>x</b>&lt;</p>"


def test_long_tables_are_thinned_out_and_say_so():
    table = FigureTable(("n", "value"), tuple((n, n / 7) for n in range(10_001)))
    html = str(figure_table(table, "x"))
    assert f"{ROWS} of 10,001 rows" in html
    assert html.count("<tr>") == ROWS + 1
    assert ">10000<" in html
    assert ">0<" in html
    assert "1,428.57" not in html
    assert ">1428.571<" in html


@given(st.integers(0, 10**6), st.integers(1, 4000))
def test_what_is_shown_of_a_table_is_bounded_and_has_its_ends(count, columns):
    rows = shown_rows(count, columns)
    assert rows == sorted(set(rows))
    assert len(rows) <= max(2, min(ROWS, max(CELLS, ROWS * (columns == 1)) // columns))
    assert not count or (rows[0], rows[-1]) == (0, count - 1)


def test_a_figure_that_cannot_be_drawn_leaves_the_others(monkeypatch):
    from dynid.errors import UsageError

    def draw():
        raise UsageError("it has no scene")

    good = Figure("good", "A good one", lambda: Picture('<svg class="fig" viewBox="0 0 1 1"></svg>'))
    monkeypatch.setattr(
        "dynid.report.page.document.figures", lambda _: [Figure("bad", "A bad one", draw), good]
    )
    reader = Reader(page(result_of("bench")))
    assert "This figure cannot be drawn: it has no scene" in reader.text
    assert any(name == "svg" for name, _ in reader.elements)


@pytest.mark.parametrize(("others", "shown"), [(2, 8), (3, 3)])
def test_the_answer_of_a_benchmark_has_few_rows_and_the_details_all(others, shown):
    """Two alternatives with three marked rows, and others, each at two sizes, that are slower and worse."""
    from dynid.report.content import content
    from tests.report.pages import bench

    result = bench()
    for k in range(others):
        group = f"bench/roots/other_{k}"
        result.annotate(group, peer=True)
        result.add_axis(f"{group}/size", [20, 100])
        for column, values in (("time", [5.0, 9.0]), ("memory", [1e6, 2e7]), ("error", [0.1, 0.2])):
            result.add(f"{group}/{column}", values, ("size",))
        for column in ("pareto", "default"):
            result.add(f"{group}/{column}", [False, False], ("size",))
    sections = {section.title: section for section in content(result).sections}
    table, _, note = sections["roots"].blocks[:3]
    assert len(table.rows) == shown
    assert ("roots: all alternatives" in sections) == (shown == 3)
    if shown == 3:
        assert [row[:2] for row in table.rows] == [("exact", "20"), ("float", "20"), ("exact", "100")]
        assert table.marked == {0, 1, 2}
        assert note.text == "7 other rows in the details: neither Pareto-optimal nor the default"
        (every,) = sections["roots: all alternatives"].blocks
        assert len(every.rows) == 10


def packed(html):
    """Return the samples of a page: columns by name, as the script reads them."""
    data = json.loads(re.search(r'id="samples-data">(.*?)</script>', html, re.DOTALL)[1])
    columns = {}
    for column in data["columns"]:
        values = np.frombuffer(b64decode(column["data"]), dtype=column["type"])
        columns[column["name"]] = (
            np.array(column["levels"], dtype=object)[values] if "levels" in column else values
        )
    return data["rows"], columns


def test_samples_are_those_of_the_file():
    result = study(60, failed=(7,), pending=(11, 12))
    rows, columns = packed(page(result))
    assert rows == 60
    assert columns["sample"].tolist() == list(range(60))
    # float32: seven digits
    np.testing.assert_allclose(columns["parameters.k"], result["study/samples/parameters.k"].data, rtol=6e-8)
    np.testing.assert_allclose(columns["mode/omega"], result["study/results/mode/omega"].data, rtol=6e-8)
    np.testing.assert_allclose(columns["mode/all[3]"], result["study/results/mode/all"].data[:, 2], rtol=6e-8)
    assert columns["status"].tolist() == result["study/status"].data.tolist()
    assert columns["error"].tolist() == result["study/error"].data.tolist()
    assert columns["mode/verdict"].tolist() == result["study/results/mode/verdict"].data.tolist()


@pytest.mark.parametrize("values", [[1e300, 2.0], [1e-300, 1.0], [2**24 + 1, 5], [np.inf, 1e200]])
def test_numbers_that_a_float32_does_not_hold_are_kept_as_they_are(values):
    result = study(2, failed=())
    result.add("study/samples/odd", np.array(values, dtype=float), ("sample",))
    assert packed(page(result))[1]["odd"].tolist() == values


def test_a_page_of_ten_thousand_samples_is_small():
    result = study(10_000, failed=range(0, 10_000, 50))
    for place in range(40):
        result.add(f"study/results/more/n{place}", np.random.default_rng(place).random(10_000), ("sample",))
    html = page(result)
    assert len(html.encode()) < 2_000_000
    assert "of the results: " in html
    rows, columns = packed(html)
    assert rows == 10_000
    assert len(columns["parameters.k"]) == 10_000


@pytest.mark.thorough
def test_more_samples_than_a_page_holds_are_thinned_out():
    html = page(study(120_000, failed=()))
    assert "50,000 of 120,000 samples" in html
    assert packed(html)[1]["sample"][[0, -1]].tolist() == [0, 119_999]
    assert len(html.encode()) < 3_000_000


def test_a_study_without_any_result_has_its_page():
    reader = Reader(page(study(3, failed=(0, 1), pending=(2,))))
    assert "0 done · 2 failed · 1 pending" in reader.text
    assert "Interrupted" in reader.text


def test_elements_without_content_are_not_closed():
    assert tag("br") == "<br>"
    assert tag("meta", charset="utf-8", hidden=None) == '<meta charset="utf-8">'
    assert tag("p", "a < b", hidden=True) == "<p hidden>a &lt; b</p>"


def test_complex_numbers_and_truths_stand_in_tables():
    said = str(
        figure_table(
            FigureTable(("pole", "stable", "order"), ((-0.5 + 2j, True, 3), (1j, False, 4))), "Poles"
        )
    )
    assert "-0.5+2j" in said
    assert "0+1j" in said
    assert "yes" in said
    assert "no</td>" in said


def test_texts_of_very_many_kinds_are_packed_with_the_rest_as_one():
    packed = samples._packed(np.array([f"t{k:05}" for k in range(samples._LEVELS + 9)], object))
    places = np.frombuffer(b64decode(packed["data"]), "<u2")
    assert packed["levels"][-1] == "…"
    assert [packed["levels"][place] for place in places[[0, 5, -1]]] == ["t00000", "t00005", "…"]


def test_a_name_that_two_figures_have_is_a_fault(monkeypatch):
    result = result_of("bond-graph")
    monkeypatch.setattr(figure_module, "FAMILIES", [*figure_module.FAMILIES, *figure_module.FAMILIES])
    with pytest.raises(ValueError, match="two figures are called"):
        figures(result)


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        (seconds_text(None), ""),
        (seconds_text(0.0123), "12 ms"),
        (seconds_text(3.14), "3.1 s"),
        (sensitivity_text(complex(np.inf)), "∞"),
        (sensitivity_text(0.0), "0"),
        (sensitivity_text(-1 + 2j), "-1 + 2j"),
        (shift_text(np.nan), "∞"),
        (shift_text(0.0), "-"),
        (shift_text(0.5, "ζ "), "ζ +0.5 %"),
    ],
)
def test_numbers_that_are_none_are_said(said, expected):
    assert said == expected


@pytest.mark.parametrize(
    ("value", "there", "on_screen"),
    [(math.nan, "—", "-"), (math.inf, "∞", "∞"), (-math.inf, "-∞", "-∞"), (2 / 3, "0.6666667", "0.6667")],
)
def test_an_unknown_number_is_a_dash_in_every_table(value, there, on_screen):
    """In the tables of figures and of content, in tips and labels, and on screens."""
    from dynid.number_format import general, time_text
    from dynid.report.content.blocks import TextTable
    from dynid.report.notation import short
    from dynid.report.page.html import cell_text, node

    assert cell_text(value) == there
    assert general(value) == on_screen
    row = node(TextTable(("", "a"), (("x", general(value, 7)),)), "table")
    assert f'<td class="n">{there.replace("-", "−")}</td>' in row
    if math.isnan(value):
        assert (short(value), time_text(value), cell_text(complex(1, value))) == ("—", "-", "—")


def test_no_page_of_a_study_with_failed_samples_says_nan():
    html = re.sub(r"<(script|style).*?</\1>", "", page(result_of("study")), flags=re.S)
    assert '<td class="n">—</td>' in html
    assert not re.search(r"\bnan\b", html)


def test_a_benchmark_states_its_machine_and_answers_before_its_remarks():
    """On the screen, too; a file of an earlier version states none."""
    from dynid.cli.screen import summary
    from dynid.report.content import content

    result = result_of("bench")
    found = content(result)
    assert found.method.startswith("median times on Abacus 3, 2 cores; ")
    assert summary(result, "").splitlines()[-1] == "  measured in 2 s on Abacus 3, 2 cores"
    places = ("answer", "details")
    answer, details = ([one for one in found.sections if one.place == place] for place in places)
    terms = [[block.text.partition(":")[0] for block in part[0].blocks[-3:]] for part in (answer, details)]
    assert terms == [["error", "failed", "chosen by default"], ["time grows with N to the power of"]]
    earlier = result.without("nothing")
    del earlier.group_attrs["bench"]["machine"]
    assert content(earlier).method.startswith("median times; ")
    assert result.equals(earlier)
