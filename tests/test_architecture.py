"""The page on architecture, and its picture, are those of the packages as they are."""

import importlib.util
import re
from pathlib import Path

import pytest

from tests.test_layers import modules, package_of
from tests.test_theory import named, place

DOCS = Path(__file__).parents[1] / "docs"
PAGE = DOCS / "architecture.md"

AGAIN = "run `python docs/architecture.py`"


@pytest.fixture(scope="module")
def architecture():
    spec = importlib.util.spec_from_file_location("architecture", DOCS / "architecture.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def packages():
    return {package_of(module) for module in modules()}


def test_the_page_names_every_package_and_no_other():
    rows = re.findall(r"^\| (?:top|lowest)? ?\| (.*?) \|", PAGE.read_text(), re.MULTILINE)
    assert set(re.findall(r"`(\w+)`", " ".join(rows))) == packages()


def test_what_the_page_names_exists():
    folders = re.findall(r"`([a-z_]+/(?:\w+/)*)`", PAGE.read_text())
    for path in [*(path for path, _ in named(PAGE)), *folders]:
        found = place(path)  # a folder emptied of its modules may still hold their bytecode
        assert found.is_file() or any(found.rglob("*.py")), path


def test_the_picture_has_the_packages_and_imports_of_now(architecture):
    drawn = architecture.PICTURE.read_text()
    assert set(re.findall(r'data-package="(\w+)"', drawn)) == packages()
    edges = {tuple(edge.split()) for edge in re.findall(r'data-edge="([\w ]+)"', drawn)}
    assert edges == set(architecture.IMPORTS), AGAIN


def test_the_picture_has_about_the_sizes_of_now(architecture):
    sizes = dict(re.findall(r'data-package="(\w+)" data-lines="(\d+)"', architecture.PICTURE.read_text()))
    for package, lines in sizes.items():
        now = architecture.LINES[package]
        assert abs(int(lines) - now) <= 100 + 0.25 * now, f"{package}: {AGAIN}"


def test_no_line_of_the_picture_ends_beside_its_box(architecture):
    boxes, lanes = architecture.boxes(), architecture.lanes(architecture.boxes())
    assert set(lanes) == set(architecture.IMPORTS)
    for (package, other), x in lanes.items():
        assert boxes[other].x < x < boxes[other].x + boxes[other].width
        assert boxes[package].y + boxes[package].height < boxes[other].y
