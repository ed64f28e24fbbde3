"""Figures and content of a modal analysis."""

import re
from html import unescape
from importlib.resources import files

import numpy as np
import pytest

import dynid
from dynid.report.content import content
from dynid.report.figure import figures
from dynid.structure.correlation import mac


@pytest.fixture(scope="module")
def result():
    return dynid.run(str(files("dynid.templates") / "modal-analysis.yaml"))


def test_every_figure_is_drawn_with_its_table(result):
    pictures = {figure.name: figure.picture for figure in figures(result)}
    names = {"synthesis", "stabilisation", "modal-shapes", "modal-shapes-animated", "modal-mac"}
    assert set(pictures) == names
    orders = [row[0] for row in pictures["stabilisation"].table.rows]
    assert sorted(orders) == sorted(result["modal/chart/order"].data)
    values = np.array([row[-1] for row in pictures["modal-mac"].table.rows]).reshape(4, 4)
    shapes = result["modal/shape"].data.T
    assert np.allclose(values, mac(shapes, shapes))
    assert "modal a of 1" in pictures["modal-shapes"].caption


def test_content_has_every_mode_and_what_they_rest_on(result):
    (section,) = [section for section in content(result).sections if section.title == "Modes"]
    table, *statements = section.blocks
    assert [row[0] for row in table.rows] == ["1", "2", "3", "4"]
    assert "the fit leaves noise of the responses" in statements[0].text
    assert statements[0].tone == "good"
    assert statements[1].text.startswith("real shapes: p < 1e-12, complex shapes are needed")
    assert "modal a of 1" in statements[-1].text


def test_an_animation_goes_through_a_period_and_stands_still_in_print(result):
    (svg,) = [figure.picture.svg for figure in figures(result) if figure.name == "modal-shapes-animated"]
    for medium in ("(prefers-reduced-motion: reduce)", "print"):
        assert re.search(rf"@media {re.escape(medium)} {{ [^}}]*swing3 {{ animation: none }}", svg)
    styles = [unescape(style) for style in re.findall('style="([^"]*)"', svg)]
    paths = [dict(re.findall(r"--(p\d+): path\('([^']*)'\)", style)) for style in styles]
    assert len(paths) == 4
    shape = result["modal/shape"].data
    for stages, row in zip(paths, shape, strict=True):
        points = [path[1:].split("L") for path in stages.values()]
        y = np.array([[float(point.split()[1]) for point in stage] for stage in points])
        motion = y - (y[:6] + y[6:]).mean(axis=0) / 2  # half a period later all move the other way
        turned = row * np.exp(-0.5j * np.angle(np.sum(row**2)))
        exact = -np.real(turned * np.exp(2j * np.pi * np.arange(12) / 12)[:, None])  # up is negative
        assert np.allclose(motion / np.abs(motion).max(), exact / np.abs(exact).max(), atol=2e-3)
