"""SVG writer: valid XML, reproducible, readable in the light and dark theme and as a file of its own."""

import re
import xml.etree.ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynid.report.notation import short
from dynid.report.svg import COLOURS, SERIES, Svg, css, number, resolved, text_width

NAMESPACE = "{http://www.w3.org/2000/svg}"


def drawn(text="x"):
    svg = Svg("a figure", text, text)
    svg.open("bonds", tip=text)
    svg.line((0, 0), (10, 1 / 3), cls="s1")
    svg.text(5, 5, text, data_name=text)
    svg.close()
    return svg.render(20, 10)


@given(st.text())
def test_any_text_gives_xml_that_says_it(text):
    root = ET.fromstring(drawn(text))
    shown = root.find(f".//{NAMESPACE}text").text or ""
    kept = re.sub("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "�", text)
    kept = re.sub("[\x7f-\x9f\u202a-\u202e\u2066-\u2069]", "�", kept)  # what terminals and readers obey
    assert shown == kept.replace("\r\n", "\n").replace("\r", "\n")


def test_a_figure_names_itself_for_those_who_cannot_see_it():
    root = ET.fromstring(drawn("Bonds & <strokes>"))
    names = root.get("aria-labelledby").split()
    texts = {element.get("id"): element.text for element in root.iter()}
    assert [texts[name] for name in names] == ["Bonds & <strokes>"] * 2
    assert root.get("role") == "img"


@pytest.mark.parametrize(
    ("value", "text"), [(1 / 3, "0.33"), (-0.001, "0"), (2.0, "2"), (1e3, "1000"), (-1.5, "-1.5")]
)
def test_a_number_has_one_form(value, text):
    assert number(value) == text


def test_ids_are_the_figures_own():
    svg = Svg("bode m.f/v", "")
    assert svg.id() != svg.id()
    assert svg.id().startswith("bode-m-f-v-")


def test_every_colour_of_the_sheet_is_known_in_both_themes():
    assert set(re.findall(r"var\(--(\w+)", css())) <= set(COLOURS)
    for dark in (False, True):
        plain = resolved(drawn(), dark=dark)
        ET.fromstring(plain)
        assert "var(" not in plain
        assert "--" not in plain
        assert COLOURS["s1"][dark] in plain


def luminance(colour):
    channels = [int(colour[place : place + 2], 16) / 255 for place in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return sum(weight * c for weight, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


@pytest.mark.parametrize("dark", [False, True])
def test_everything_stands_out_from_the_paper(dark):
    paper = luminance(COLOURS["paper"][dark])

    def contrast(name):
        bright, dim = sorted((luminance(COLOURS[name][dark]), paper), reverse=True)
        return (bright + 0.05) / (dim + 0.05)

    assert all(contrast(name) >= 4.5 for name in ("ink", "muted", "accent"))  # WCAG 2.2, text
    assert all(contrast(name) >= 3 for name in SERIES)  # graphical objects


def test_wide_and_combining_characters_count_as_such():
    assert text_width("가나", 10) == 20
    assert text_width("e\u0301", 10) == text_width("e", 10)
    assert text_width("m", 10, bold=True) > text_width("m", 10) > text_width("i", 10)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (2e4, "20\N{NARROW NO-BREAK SPACE}000"),
        (0.0137, "0.0137"),
        (1e-8, "10⁻⁸"),
        (-5.263e-6, "−5.263·10⁻⁶"),
        (-1234, "−1234"),
        (0.0, "0"),
        (2 / 3, "0.6667"),
        (999999.9, "10⁶"),
        (float("inf"), "∞"),
        (float("nan"), "—"),
    ],
)
def test_a_number_is_written_as_people_read_it(value, text):
    assert short(value) == text
