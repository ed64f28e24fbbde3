"""Figures as files: standalone SVG, PNG and PDF, reproducible to the byte."""

import builtins
import struct
import xml.etree.ElementTree as ET

import pytest

from dynid.errors import UsageError
from dynid.report import figures
from dynid.report.figure import as_file, standalone
from tests.report.pages import result_of


@pytest.fixture(scope="module")
def svg():
    return next(figure for figure in figures(result_of("bond-graph")) if figure.name == "bond-graph").svg


def test_an_svg_stands_alone_on_white_in_plain_colours(svg):
    alone = standalone(svg)
    root = ET.fromstring(alone.encode())
    assert alone.startswith('<?xml version="1.0" encoding="UTF-8"?>')
    assert "var(" not in alone
    x, y, width, height = root.get("viewBox").split()
    ground = root[0]
    assert (ground.tag.rpartition("}")[2], ground.get("fill")) == ("rect", "#ffffff")
    assert [ground.get(key) for key in ("x", "y", "width", "height")] == [x, y, width, height]


def test_png_and_pdf_are_what_they_say_and_the_same_each_time(svg):
    pytest.importorskip("typst")
    png, pdf = as_file(svg, "png"), as_file(svg, "pdf")
    assert png.startswith(b"\x89PNG")
    assert pdf.startswith(b"%PDF")
    assert b"CreationDate" not in pdf
    assert (as_file(svg, "png"), as_file(svg, "pdf")) == (png, pdf)
    width = float(ET.fromstring(svg).get("width"))
    assert struct.unpack(">I", png[16:20])[0] == pytest.approx(2 * width, abs=2)  # 192 pixels an inch


def test_without_typst_the_remedy_is_said(svg, monkeypatch):
    really = builtins.__import__

    def absent(name, *rest):
        if name == "typst":
            raise ImportError(name)
        return really(name, *rest)

    monkeypatch.setattr(builtins, "__import__", absent)
    assert as_file(svg, "svg")
    with pytest.raises(UsageError, match=r"PNG need the package typst.*pip install 'dynid\[figures\]'"):
        as_file(svg, "png")


def test_what_is_no_figure_is_not_made_one():
    with pytest.raises(ValueError, match="starts with <svg"):
        standalone("<p>no figure</p>")
