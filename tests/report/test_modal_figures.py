"""Figures and content of a modal analysis."""

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
    assert set(pictures) == {"synthesis", "stabilisation", "modal-shapes", "modal-mac"}
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
    assert "modal a of 1" in statements[-1].text
