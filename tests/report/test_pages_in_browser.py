"""Pages in a browser: no network access, complete figures, keyboard use, small screens, dark theme."""

import os
import re
import shutil

import numpy as np
import pytest

from dynid.report import figures
from dynid.report.page import page
from dynid.result import Result
from tests.report.pages import HOSTILE, result_of, study

sync_api = pytest.importorskip("playwright.sync_api", reason="the package playwright is not installed")

KINDS = ["bond-graph", "identification", "reduction", "study", "bench"]
#: Debian's name of the browser first.
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(BROWSER is None, reason="no Chromium: apt-get install chromium"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),  # what Playwright uses
]
#: Results with a page: another one must not have their ids.
KEPT = []
OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as driver:
        # The sandbox needs rights that containers lack; what is opened are our own files.
        opened = driver.chromium.launch(
            executable_path=BROWSER, args=["--no-sandbox"] if os.getuid() == 0 else []
        )
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pages")


class Tab:
    """A tab in which pages are opened one after the other, and whatever they complained of or asked for."""

    def __init__(self, browser, **options):
        self.complaints, self.requests = [], []
        self._context = browser.new_context(**options)
        self.page = self._context.new_page()
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.route("**/*", self._route)

    def _route(self, route):
        self.requests.append(route.request.url)
        route.continue_()

    def open(self, file, viewport=None, color_scheme="light"):
        """Open a page as nobody has seen it before."""
        self.page.set_viewport_size(viewport or {"width": 1280, "height": 720})
        self.page.emulate_media(media="screen", color_scheme=color_scheme)
        self.page.goto(file.as_uri())
        return self

    def close(self):
        self._context.close()


@pytest.fixture(scope="module")
def tab(browser):
    """A tab for all pages: opening another one takes longer than a page."""
    opened = Tab(browser)
    yield opened
    opened.close()


@pytest.fixture
def visit(tab, browser, folder):
    """Open the page of a result."""
    visited = []

    def go(result, java_script_enabled=True, **options):
        used = tab if java_script_enabled else Tab(browser, java_script_enabled=False)
        visited.append(used)
        return used.open(file_of(result, folder), **options)

    yield go
    assert tab.complaints == []
    assert len(tab.requests) == visited.count(tab)  # the pages themselves
    if tab in visited:
        tab.requests.clear()
        tab.page.evaluate("localStorage.clear()")
        tab.page.mouse.move(1, 1)
    for one in visited:
        if one is not tab:
            assert (one.complaints, len(one.requests)) == ([], 1)
            one.close()


def until(opened, condition):
    """Wait, frame by frame, until a condition holds: of pages whose policy forbids evaluating texts, too."""
    opened.evaluate(
        "() => new Promise((done, fail) => { let left = 600; const look = () =>"
        f" (({condition}) ? done() : left-- ? requestAnimationFrame(look) : fail(new Error('never')));"
        " look(); })"
    )


def shown(figure):
    """Scroll to a figure and wait until it is drawn: records are as they come into view."""
    figure.scroll_into_view_if_needed()
    name = figure.get_attribute("id")
    own = f"document.querySelector('[id=\"{name}\"] > .picture')"
    until(
        figure.page,
        f"!{own}.parentElement.matches('.record')"
        f" || {own}.querySelector(':scope > svg').viewBox.baseVal.width === Math.floor({own}.clientWidth)",
    )
    return figure.locator(".picture > svg").bounding_box()


def file_of(result, folder):
    """Write the page of a result, once."""
    KEPT.append(result)
    file = folder / f"{result.kind}-{id(result)}.html"
    if not file.exists():
        file.write_text(page(result), encoding="utf-8")
    return file


@pytest.mark.parametrize("kind", KINDS)
def test_a_page_is_drawn_complete_and_silent_in_light_and_dark_on_wide_and_narrow_screens(visit, kind):
    result = result_of(kind)
    opened = visit(result, viewport={"width": 1100, "height": 800}).page
    grounds = {opened.evaluate("getComputedStyle(document.body).backgroundColor")}
    assert opened.evaluate(OVERFLOW) == 0
    opened.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")
    for figure in figures(result):
        box = opened.locator(f'figure[id="figure-{figure.name}"] .picture > svg').bounding_box()
        assert box["width"] > 50
        assert box["height"] > 20
    opened.get_by_role("button", name="Dark").click()
    grounds.add(opened.evaluate("getComputedStyle(document.body).backgroundColor"))
    assert len(grounds) == 2
    assert opened.get_by_role("button", name="Light", exact=True).is_visible()
    narrow = visit(result, viewport={"width": 360, "height": 700}, color_scheme="dark").page
    assert narrow.evaluate(OVERFLOW) <= 0
    assert narrow.evaluate("getComputedStyle(document.body).backgroundColor") in grounds


@pytest.fixture(scope="module")
def checked(browser):
    """A tab that lets the checker in."""
    opened = Tab(browser, bypass_csp=True)
    yield opened
    opened.close()


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(kind, marks=[] if kind in ("bond-graph", "study") else [pytest.mark.slow])
        for kind in KINDS
    ],
)
@pytest.mark.parametrize("scheme", ["light", pytest.param("dark", marks=pytest.mark.slow)])
def test_nothing_stands_in_the_way_of_assistive_technology(checked, folder, kind, scheme):
    checker = pytest.importorskip("axe_playwright_python.sync_playwright")
    opened = checked.open(file_of(result_of(kind), folder), color_scheme=scheme).page
    # What repeats itself takes the checker long and tells it nothing.
    opened.evaluate(
        "for (const one of document.querySelectorAll('tbody tr:nth-child(n+4), svg g')) one.remove()"
    )
    opened.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")
    rules = None if scheme == "light" else {"runOnly": ["color-contrast"]}
    found = checker.Axe().run(opened, options=rules).response["violations"]
    assert [(one["id"], [node["html"][:120] for node in one["nodes"]][:3]) for one in found] == []


def test_a_page_says_all_without_scripts(visit):
    result = result_of("identification")
    opened = visit(result, java_script_enabled=False).page
    assert opened.locator('figure:not([id$="-first"]) .picture > svg').count() == len(figures(result))
    assert not opened.locator("#theme").is_visible()
    summary = opened.locator("figure summary").first
    summary.click()
    assert opened.locator("figure details table").first.is_visible()


def test_tables_say_what_the_result_holds(visit):
    result = result_of("bond-graph")
    group = "bond_graph/frequency_response"
    opened = visit(result).page
    rows = opened.locator('figure[id="figure-bode"] tbody tr')
    cells = rows.evaluate_all("(rows) => rows.map((row) => [...row.cells].map((cell) => cell.textContent))")
    shown = np.array([[float(cell) for cell in row] for row in cells])
    heads = opened.locator('figure[id="figure-bode"] thead th').all_text_contents()
    across = next(place for place, head in enumerate(heads) if "rad/s" in head)
    up = next(place for place, head in enumerate(heads) if "dB" in head)
    omega, response = result[f"{group}/omega"].data, result[f"{group}/response"].data[:, 0, 0]
    assert len(shown) >= 100
    assert shown[[0, -1], across] == pytest.approx(omega[[0, -1]], rel=1e-6)  # seven digits are written
    places = np.abs(omega - shown[:, across, None]).argmin(axis=1)
    np.testing.assert_allclose(shown[:, across], omega[places], rtol=1e-6)
    np.testing.assert_allclose(shown[:, up], 20 * np.log10(np.abs(response[places])), rtol=1e-6, atol=1e-6)


def test_a_page_is_used_by_keys(visit):
    opened = visit(result_of("bond-graph"), viewport={"width": 1000, "height": 700}).page
    opened.keyboard.press("Tab")
    assert opened.evaluate("document.activeElement.className") == "skip"
    opened.keyboard.press("Enter")
    assert opened.evaluate("location.hash") == "#main"
    seen = []
    for _ in range(30):
        opened.keyboard.press("Tab")
        seen.append(
            opened.evaluate(
                "(() => { const e = document.activeElement; const s = getComputedStyle(e);"
                " return [e.tagName, s.outlineStyle, parseFloat(s.outlineWidth)]; })()"
            )
        )
    assert {"SUMMARY", "BUTTON", "DIV"} <= {name for name, _, _ in seen}
    assert all(style == "solid" and width >= 2 for name, style, width in seen if name != "BODY")


def test_values_are_read_under_the_pointer_and_by_arrow_keys(visit):
    result = result_of("bond-graph")
    opened = visit(result, viewport={"width": 1000, "height": 900}).page
    figure = opened.locator('figure[id="figure-bode"]')
    box = shown(figure)
    plot = figure.locator("g.plot").first
    left, top, width, height = map(float, plot.get_attribute("data-box").split())
    kind, low, high = plot.get_attribute("data-x").split()
    assert kind == "log"
    view = [float(x) for x in figure.locator(".picture > svg").get_attribute("viewBox").split()]
    scale = box["width"] / view[2]
    opened.mouse.move(
        box["x"] + scale * (left + width / 2 - view[0]), box["y"] + scale * (top + height / 2 - view[1])
    )
    said = figure.locator("output").text_content()
    x, y = (_number(part) for part in said.split(" · ")[:2])
    omega = result["bond_graph/frequency_response/omega"].data
    unit = 2 * np.pi if "Hz" in plot.get_attribute("data-x-label") else 1.0
    assert x == pytest.approx(np.sqrt(float(low) * float(high)), rel=0.02)  # the nearest sample
    response = np.abs(result["bond_graph/frequency_response/response"].data[:, 0, 0])
    wanted = 20 * np.log10(np.interp(np.log(x * unit), np.log(omega), response))
    assert y == pytest.approx(wanted, abs=0.5)  # within a pixel of a curve on a scale of 60 dB
    figure.locator(".picture").focus()
    opened.keyboard.press("ArrowRight")
    assert figure.locator("output").text_content() != said


def _said(opened, figure, place, x, y):
    """Return what is read with the pointer at shares of the width and height of a figure's plot."""
    box = shown(figure)
    plot = figure.locator("g.plot").nth(place)
    left, top, width, height = map(float, plot.get_attribute("data-box").split())
    view = [float(part) for part in figure.locator(".picture > svg").get_attribute("viewBox").split()]
    scale = box["width"] / view[2]
    opened.mouse.move(
        box["x"] + scale * (left + x * width - view[0]), box["y"] + scale * (top + y * height - view[1])
    )
    said = figure.locator("output").text_content()
    return [(part.rpartition(": ")[0], _number(part)) for part in said.split(" · ") if part]


def _number(part):
    """Return the number of a reading such as `phase: −12.5°`."""
    return float(re.match(r"[\d.e+-]+", part.rpartition(": ")[2].replace("−", "-"))[0])


READ = """\
dynid: 1
kind: bond-graph
title: Two masses on springs
graph:
  nodes: {F: Se, m: {type: I, value: 2}, k: {type: C, value: 0.04}, b: {type: R, value: 0.7}, one: 1}
  bonds: [F -> one -> m, one -> k, one -> b]
analysis:
  inputs: [F]
  outputs: [m.f, k.e]
  frequency: {start: 0.5, stop: 50, points: 300}
  time: {stop: 6, step: 0.01, input: {kind: step}}
"""


def test_every_curve_is_read_where_it_is_and_not_where_the_pointer_is(visit):
    from tests.report.pages import run

    result = run(READ)
    opened = visit(result, viewport={"width": 1000, "height": 900}).page
    figure = opened.locator('figure[id="figure-time-response"]')
    time, response = (result[f"bond_graph/time_response/{name}"].data for name in ("time", "response"))
    for place in (0, 1):
        span = np.ptp(response[:, place])
        for x in (0.11, 0.37, 0.83):
            for y in (0.06, 0.5, 0.94):  # the height of the pointer changes nothing
                (_, at), *every = _said(opened, figure, place, x, y)
                name, value = every[place]  # the other plot over the same time is read, too
                wanted = np.interp(at, time, response[:, place])
                near = np.interp([at - 0.02, at + 0.02], time, response[:, place])  # a pixel to either side
                assert value == pytest.approx(wanted, abs=0.005 * span + np.ptp([wanted, *near])), name
    figure = opened.locator('figure[id="figure-bode"]')
    omega, values = (result[f"bond_graph/frequency_response/{name}"].data for name in ("omega", "response"))
    phase = np.rad2deg(np.unwrap(np.angle(values[:, :, 0]), axis=0))
    for x in (0.08, 0.9):  # not at the resonance, where a pixel is many degrees
        for y in (0.1, 0.9):
            (_, at), *curves = _said(opened, figure, 1, x, y)
            curves = curves[2:]  # after the magnitudes
            assert [name for name, _ in curves] == ["m.f / F", "k.e / F"]
            for column, (_, value) in enumerate(curves):
                wanted = np.interp(np.log(at), np.log(omega), phase[:, column])
                assert value == pytest.approx(wanted, abs=2)


def test_of_a_locus_the_height_nearest_to_the_pointer_is_read(visit):
    from tests.report.pages import run

    result = run(READ)
    opened = visit(result, viewport={"width": 1000, "height": 900}).page
    figure = opened.locator('figure[id="figure-nyquist"]')
    above, below = (_said(opened, figure, 0, 0.5, y)[1:] for y in (0.3, 0.7))
    assert max(value for _, value in above) > 0 > min(value for _, value in below)


@pytest.mark.parametrize("kind", ["bond-graph", "identification", "reduction", "study", "synthesis", "plan"])
def test_the_answer_and_its_figures_are_within_the_first_thousand_pixels(visit, kind):
    opened = visit(result_of(kind), viewport={"width": 1280, "height": 1000}).page
    ends = opened.locator("#answer .answers, #answer .answers + .figures .picture").evaluate_all(
        "(parts) => parts.map((part) => part.getBoundingClientRect().bottom + scrollY)"
    )
    assert len(ends) >= 2
    assert max(ends) <= 1000


def test_figures_are_as_narrow_as_a_phone(visit):
    opened = visit(result_of("identification"), viewport={"width": 420, "height": 800}).page
    for figure in opened.locator("figure:not(.wide)").all():  # records are drawn as they come into view
        if figure.is_visible():
            shown(figure)
    sizes = opened.locator("figure:not(.wide) svg").evaluate_all(
        "(all) => all.filter((one) => one.checkVisibility()).map((one) => [one.getBoundingClientRect().right,"
        " one.getBoundingClientRect().width / one.viewBox.baseVal.width])"
    )
    assert all(right <= 420 and scale > 0.85 for right, scale in sizes)  # of 10 px, 8.5 remain
    assert len(sizes) >= 4


def test_a_cursor_marks_its_frequency_on_every_figure(visit):
    from tests.report.pages import run

    result = run(READ)
    opened = visit(result, viewport={"width": 1300, "height": 900}).page
    group = "bond_graph/frequency_response"
    omega, response = result[f"{group}/omega"].data, result[f"{group}/response"].data[:, 0, 0]
    bode = opened.locator('figure[id="figure-bode"]')
    (_, at), *_ = _said(opened, bode, 0, 0.35, 0.5)
    assert "rad/s" in bode.locator("output").text_content()
    assert " dB" in bode.locator("output").text_content()
    assert "°" in bode.locator("output").text_content()
    locus = opened.locator('figure[id="figure-nyquist"] output').text_content()
    label, value = locus.split(" · ")[:2]
    assert _number(label) == pytest.approx(at)
    value = value.partition(": ")[2].replace("−", "-").replace(" ", "").partition("j")[0] + "j"
    place = np.interp(np.log(at), np.log(omega), response)
    assert complex(value) == pytest.approx(place, abs=0.01 * np.abs(response).max())
    axes = opened.locator('figure[id="figure-poles-m.f-F"] .pointer')
    plot = opened.locator('figure[id="figure-poles-m.f-F"] g.plot').first
    _, top, _, height = map(float, plot.get_attribute("data-box").split())
    _, low, high = plot.get_attribute("data-y").split()
    heights = sorted(float(re.search(r" (\S+)H", axes.nth(k).get_attribute("d"))[1]) for k in range(2))
    shown = [float(high) - (y - top) / height * (float(high) - float(low)) for y in heights]
    assert shown == pytest.approx([at, -at], rel=1e-3)
    opened.mouse.move(1, 1)
    assert opened.locator(".pointer").count() == 0


def test_a_link_of_the_index_opens_the_part_that_has_its_figure(visit):
    opened = visit(result_of("bond-graph"), viewport={"width": 1280, "height": 900}).page
    target = opened.locator("#derivations figure").first
    assert not target.is_visible()
    opened.locator(".index summary").click()
    opened.locator(f'.index a[href="#{target.get_attribute("id")}"]').click()
    assert target.locator(".picture > svg").is_visible()


def test_a_printed_page_is_light_and_unfolded_without_controls(visit):
    opened = visit(result_of("bond-graph"), color_scheme="dark").page
    folded = opened.locator("details.fold:not([open])").count()
    assert folded > 3
    opened.evaluate("dispatchEvent(new Event('beforeprint'))")
    opened.emulate_media(media="print")
    assert opened.locator("details.fold:not([open])").count() == 0
    assert opened.evaluate("getComputedStyle(document.documentElement).colorScheme") == "light"
    assert opened.locator("#derivations figure svg").first.is_visible()
    assert opened.locator("button:visible, nav:visible").count() == 0
    assert opened.evaluate("getComputedStyle(document.querySelector('h1')).color") == "rgb(28, 32, 36)"
    opened.evaluate("dispatchEvent(new Event('afterprint'))")
    assert opened.locator("details.fold:not([open])").count() == folded


PAPER = {"width": 700, "height": 1000}  # A4 less its margins, px
PRINTED = """() => {
  const tables = [...document.querySelectorAll("table")].filter((one) => one.offsetWidth);
  const numbers = tables.flatMap((one) => [...one.querySelectorAll("td.n")]);
  const broken = (cell) => {
    const range = document.createRange();
    range.selectNodeContents(cell);
    const tops = [...range.getClientRects()].map((box) => box.top);
    return Math.max(...tops) - Math.min(...tops) > 8; // more than a superscript is raised
  };
  return {
    widest: Math.max(...tables.map((one) => one.getBoundingClientRect().right)),
    broken: numbers.filter(broken).map((cell) => cell.textContent),
  };
}"""


def printed(opened):
    """Bring a page into the state in which it is printed."""
    opened.set_viewport_size(PAPER)
    opened.evaluate("dispatchEvent(new Event('beforeprint'))")
    opened.emulate_media(media="print")
    return opened.evaluate(PRINTED)


def wide_table():
    """Return a study with twenty more numbers, whose names differ in their groups."""
    result = study(count=60)
    for k in range(20):
        name = f"study/results/modes_{k}/natural_frequency"
        result.add(name, result["study/results/mode/omega"].data * (k + np.pi), ("sample",), "rad/s")
    return result


@pytest.mark.parametrize("kind", ["identification", "reduction", "bench", "study"])
def test_printed_tables_fit_the_paper_and_break_no_number(visit, kind):
    opened = visit(wide_table() if kind == "study" else result_of(kind)).page
    found = printed(opened)
    assert found["widest"] <= PAPER["width"]
    assert found["broken"] == []


def test_printed_samples_have_headings_and_say_how_many_they_are(visit):
    opened = visit(wide_table()).page
    printed(opened)
    parts = opened.locator("#sample-table table.part:visible")
    assert parts.count() > 1
    columns = opened.locator("#sample-table table.split thead th")
    heads = [part.locator("thead th").all_text_contents() for part in parts.all()]
    assert [name for names in heads for name in names[1:]] == columns.all_text_contents()[1:]
    assert {names[0] for names in heads} == {"sample"}
    assert parts.first.locator("thead th button").first.is_visible()
    assert opened.get_by_text("rows 1 … 25 of 60, page 1 of 3").is_visible()
    opened.evaluate("dispatchEvent(new Event('afterprint'))")
    assert opened.locator("table.part, table.split").count() == 0


def test_a_folded_table_is_printed_once(visit):
    opened = visit(wide_table()).page
    folded = opened.locator("#answer details.rows")
    assert folded.count() == 1
    printed(opened)
    shown = opened.locator("#answer table:visible tbody th", has_text="modes_3/natural_frequency")
    assert shown.count() == 1


def test_headings_of_samples_are_the_ends_that_distinguish_them(visit):
    opened = visit(wide_table()).page
    heads = opened.locator("#sample-table thead th button")
    texts, titles = heads.all_text_contents(), [one.get_attribute("title") for one in heads.all()]
    assert {"c", "k", "omega [rad/s]", "modes_3/natural_frequency [rad/s]"} <= set(texts)
    assert {"parameters.k", "mode/omega [rad/s]"} <= set(titles)


def test_a_wide_table_scrolls_below_its_first_column(visit):
    opened = visit(result_of("reduction"), viewport={"width": 420, "height": 800}).page
    scroll = opened.locator("#answer .scroll").first
    head = scroll.locator("tbody th").first
    before = head.bounding_box()["x"]
    assert scroll.evaluate("one => one.scrollWidth - one.clientWidth") > 50
    scroll.evaluate("one => { one.scrollLeft = 50; }")
    assert head.bounding_box()["x"] == before


def long_record(samples=20_000, channels=2):
    """Return an identification with a record of noise, and one sample far off it."""
    random, result = np.random.default_rng(1), Result("identification", "A long record")
    group = "identification/measurement"
    result.add_axis(f"{group}/time", np.arange(samples) / 1000, "s")
    result.add_axis(f"{group}/channel", [f"{k}.velocity" for k in range(channels)])
    predicted = np.sin(np.arange(samples)[:, None] / 50 * np.arange(1, channels + 1))
    measured = predicted + 0.05 * random.normal(size=predicted.shape)
    measured[samples // 3, 0] = 9.0
    result.add(f"{group}/measured", measured, ("time", "channel"), "m/s")
    result.add(f"{group}/predicted", predicted, ("time", "channel"), "m/s")
    return result


RECORDED = """(figure) => [...figure.querySelectorAll("g.plot")].map((plot) => ({
  x: plot.dataset.x.split(" ").slice(1).map(Number), y: plot.dataset.y.split(" ").slice(1).map(Number),
  box: plot.dataset.box.split(" ").map(Number),
  points: [...plot.querySelectorAll("path[data-name]")].map((path) => path.getAttribute("d").slice(1)
    .split(/[ML]/).map((point) => point.split(" ").map(Number))),
  dots: plot.querySelectorAll("path.dot").length,
}))"""


@pytest.fixture(scope="module")
def recorded():
    return long_record()


def test_of_a_long_record_the_extremes_are_drawn_and_single_samples_in_a_window(visit, recorded):
    opened = visit(recorded, viewport={"width": 1280, "height": 900}).page
    figure = opened.locator('figure[id="figure-prediction"]')
    box = shown(figure)
    measured = recorded["identification/measurement/measured"].data[:, 0]
    plots = figure.evaluate(RECORDED)
    assert len(plots) == 4  # two channels, each above its residual, on one axis of time
    assert len({(*plot["x"], plot["box"][0], plot["box"][2]) for plot in plots}) == 1
    whole = plots[0]
    left, top, width, height = whole["box"]
    drawn = np.array(whole["points"][0])
    assert width > 1000
    assert len(drawn) <= 2 * width + 2
    low, high = whole["y"]
    seen = low + (high - low) * (top + height - drawn[:, 1]) / height
    assert [seen.min(), seen.max()] == pytest.approx([measured.min(), 9.0], abs=0.1 * (high - low) / height)
    assert whole["dots"] == 0

    spike = left + width * (20_000 / 3 / 1000 - whole["x"][0]) / (whole["x"][1] - whole["x"][0])
    opened.mouse.move(box["x"] + spike - 3, box["y"] + top + 20)
    opened.mouse.down()
    opened.mouse.move(box["x"] + spike + 3, box["y"] + top + 20, steps=3)
    assert figure.locator("rect.window").count() == 1
    opened.mouse.up()
    part = figure.evaluate(RECORDED)[0]
    inside = np.flatnonzero(
        (np.arange(20_000) / 1000 >= part["x"][0]) & (np.arange(20_000) / 1000 <= part["x"][1])
    )
    assert 6666 in inside
    assert part["x"][1] - part["x"][0] == pytest.approx(6 / width * (whole["x"][1] - whole["x"][0]), rel=0.05)
    assert len(inside) <= len(part["points"][0]) <= len(inside) + 2  # and a neighbour on either side
    assert part["dots"] == 2
    figure.locator("button[data-do=all]").click()
    assert figure.evaluate(RECORDED)[0] == whole


def test_a_record_is_zoomed_by_wheel_and_keys_and_read_at_its_samples(visit, recorded):
    opened = visit(recorded, viewport={"width": 1280, "height": 900}).page
    figure = opened.locator('figure[id="figure-prediction"]')
    shown(figure)

    def span():
        low, high = figure.evaluate(RECORDED)[0]["x"]
        return high - low

    whole, scrolled = span(), opened.evaluate("scrollY")
    figure.locator(".picture > svg").hover(position={"x": 600, "y": 100})
    opened.mouse.wheel(0, 40)
    until(opened, f"scrollY > {scrolled}")  # a page that is scrolled past goes on scrolling
    assert span() == whole
    figure.locator(".picture").focus()
    opened.mouse.wheel(0, -100)
    until(opened, "document.querySelector('.picture.part')")
    assert span() == pytest.approx(0.8 * whole)
    opened.keyboard.press("+")
    assert span() == pytest.approx(0.64 * whole)
    before = figure.evaluate(RECORDED)[0]["x"][0]
    opened.keyboard.press("Shift+ArrowLeft")
    assert figure.evaluate(RECORDED)[0]["x"][0] < before
    opened.keyboard.press("0")
    assert span() == pytest.approx(whole, rel=1e-12)
    opened.keyboard.press("ArrowRight")
    said = [part.rpartition(": ") for part in figure.locator("output").text_content().split(" · ")]
    assert [name for name, _, _ in said] == ["time", *["measured", "predicted", "measured − predicted"] * 2]
    numbers = [_number(f": {text}") for _, _, text in said]
    row = round(1000 * numbers[0])
    for k, name in ((1, "measured"), (2, "predicted")):
        value = recorded[f"identification/measurement/{name}"].data[row, 0]
        assert numbers[k] == pytest.approx(value, abs=1e-4)  # of a range of 10, in 16 bits


def test_a_record_is_as_wide_as_a_phone_and_as_paper(visit, recorded):
    opened = visit(recorded, viewport={"width": 420, "height": 800}).page
    picture = opened.locator('figure[id="figure-prediction"] .picture')
    assert opened.evaluate(OVERFLOW) <= 0
    assert shown(opened.locator('figure[id="figure-prediction"]'))["width"] <= 420
    ticks = "(all) => all.map((one) => one.getBoundingClientRect().height)"
    assert min(picture.locator("> svg text.tick").evaluate_all(ticks)) > 9
    printed(opened)
    assert 600 < float(picture.locator("> svg").get_attribute("viewBox").split()[2]) <= PAPER["width"]


def test_a_figure_is_zoomed_and_shown_whole_again(visit):
    opened = visit(result_of("bond-graph")).page
    figure = opened.locator("figure.wide").first
    whole = figure.locator(".picture > svg").get_attribute("viewBox")
    figure.get_by_role("button", name="Zoom in").click()
    part = figure.locator(".picture > svg").get_attribute("viewBox")
    assert float(part.split()[2]) == pytest.approx(0.6 * float(whole.split()[2]), rel=1e-3)
    figure.locator(".picture").focus()
    opened.keyboard.press("ArrowRight")
    assert figure.locator(".picture > svg").get_attribute("viewBox") != part
    figure.get_by_role("button", name="Show the whole").click()
    assert [*map(float, figure.locator(".picture > svg").get_attribute("viewBox").split())] == [
        *map(float, whole.split())
    ]


def test_samples_are_paged_sorted_filtered_and_counted(visit):
    result = study(1000, failed=(7,))
    opened = visit(result).page
    host = opened.locator("#sample-table")
    table = host.locator("table").last
    stiffness, omega = result["study/samples/parameters.k"].data, result["study/results/mode/omega"].data

    def column(name):
        heads = table.locator("thead th").all_text_contents()
        place = next(place for place, head in enumerate(heads) if head.startswith(name))
        return table.locator(f"tbody tr td:nth-child({place + 1})").all_text_contents()

    assert column("sample") == [str(number) for number in range(25)]
    host.get_by_role("button", name="Next page").click()
    assert column("sample")[0] == "25"
    table.get_by_title("parameters.k").click()
    np.testing.assert_allclose([float(x) for x in column("k")], np.sort(stiffness)[:25], rtol=6e-7)
    table.get_by_title("parameters.k").click()
    np.testing.assert_allclose(float(column("k")[0]), stiffness.max(), rtol=6e-7)
    assert table.locator("th[aria-sort=descending]").count() == 1

    host.get_by_label("Column", exact=True).select_option(label="mode/omega [rad/s]")
    host.get_by_label("at least").fill("130")
    kept = omega[omega >= 130]
    assert f"{len(kept)} of 1,000 samples" in host.text_content()
    shown = [
        float(x)
        for x in host.locator("[aria-label='Statistics of the chosen column'] td").all_text_contents()
    ]
    wanted = [len(kept), kept.mean(), kept.std(ddof=1), *np.quantile(kept, [0, 0.05, 0.5, 0.95, 1])]
    np.testing.assert_allclose(shown, wanted, rtol=1e-6)
    assert host.locator("svg rect").count() > 5

    host.get_by_label("Column", exact=True).select_option(label="mode/verdict")
    host.get_by_label("contains").fill("ring")
    both = int(((omega >= 130) & (result["study/results/mode/verdict"].data == "ringing")).sum())
    assert f"{both} of 1,000 samples" in host.text_content()
    host.get_by_role("button", name="All samples").click()
    assert "1,000 of 1,000 samples" in host.text_content()


def test_equal_samples_have_no_spread_and_the_first_column_that_varies_is_chosen(visit):
    result = study(40, failed=())
    result.add("study/results/a/converged", np.ones(40), ("sample",))
    result.add("study/results/b/constant", np.full(40, 0.1), ("sample",))
    host = visit(result).page.locator("#sample-table")
    choice = host.get_by_label("Column", exact=True)
    assert choice.evaluate("(one) => one.selectedOptions[0].textContent") not in ("a/converged", "b/constant")
    choice.select_option(label="b/constant")
    numbers = host.locator("[aria-label='Statistics of the chosen column'] td").all_text_contents()
    assert numbers == ["40", "0.1"]
    assert "rows 1 … 25 of 40, page 1 of 2" in host.text_content()


def test_a_drawing_wider_than_a_phone_scrolls_and_is_shown_whole(visit):
    from tests.report.pages import run

    opened = visit(run(WIDE), viewport={"width": 420, "height": 900}).page
    figure = opened.locator('figure[id="figure-bond-graph"]')
    figure.scroll_into_view_if_needed()
    picture, svg = figure.locator(".picture"), figure.locator(".picture > svg")
    widths = "(one) => [one.scrollWidth, one.clientWidth]"
    scrolled, seen = picture.evaluate(widths)
    assert scrolled > seen + 100
    until(opened, "document.querySelector('.picture.more')")
    assert opened.evaluate(
        "getComputedStyle(document.querySelector('#figure-bond-graph output'), '::before').content"
    ).startswith('"Scroll sideways')
    figure.locator("button[data-do=all]").click()
    assert svg.bounding_box()["width"] <= seen + 1
    figure.locator("button[data-do=in]").click()
    assert svg.bounding_box()["width"] > seen + 100
    figure.locator("button[data-do=out]").click()
    scrolled, seen = picture.evaluate(widths)
    assert scrolled <= seen + 1
    assert figure.locator(".tools").bounding_box()["height"] < 60  # no empty line below the buttons
    steps = opened.locator("details.fold svg").evaluate_all(
        "(all) => all.map((one) => { one.closest('details').open = true;"
        " return one.getBoundingClientRect().width / one.viewBox.baseVal.width; })"
    )
    assert steps
    assert min(steps) > 0.9


WIDE = """\
dynid: 1
kind: bond-graph
title: A long chain
graph:
  nodes: {F: Se, m: {type: I, value: 2}, k: {type: C, value: 0.04}, b: {type: R, value: 0.7}, one: 1,
          zero: 0, two: 1, M: {type: I, value: 3}, B: {type: R, value: 1},
          other: 0, K: {type: C, value: 0.02}, three: 1, L: {type: I, value: 1}}
  bonds: [F -> one -> m, one -> b, one -> zero -> k, zero -> two -> M, two -> B, two -> other -> K,
          other -> three -> L]
analysis: {inputs: [F], outputs: [M.f], frequency: {start: 0.5, stop: 50, points: 30}}
"""


def test_long_names_do_not_make_a_narrow_page_wide(visit):
    result = study(30, failed=())
    long = "group/" + "_".join(["a_very_long_name"] * 8)
    result.add(f"study/results/{long}", result["study/samples/parameters.k"].data / 3, ("sample",))
    assert visit(result, viewport={"width": 360, "height": 700}).page.evaluate(OVERFLOW) == 0


def test_hostile_names_are_shown_and_do_nothing(visit):
    result = study(9, failed=())
    result.title = HOSTILE
    result.add(f"study/samples/{HOSTILE.replace('/', '')}", np.full(9, HOSTILE, dtype=object), ("sample",))
    opened = visit(result).page
    assert opened.locator("img").count() == 0
    assert "<img src=x onerror=alert(2)>" in opened.locator("h1").text_content()
    assert "<img src=x" in opened.locator("#sample-table tbody").last.text_content()
