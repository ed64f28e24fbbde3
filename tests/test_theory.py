"""The pages on theory and limits name what exists, and where equations are computed or shown."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [*sorted((ROOT / "docs/theory").glob("*.md")), ROOT / "docs/limits.md"]

_FENCED = re.compile(r"^```.*?^```$", re.DOTALL | re.MULTILINE)
_NAMED = re.compile(r"`([\w./-]+\.(?:py|yaml))(?:::(\w+))?`")
_REMARK = re.compile(r"\*(?:In code|Shown by|Known by):\*")


def named(page):
    """Yield the modules, scenes and tests that a page names outside of its code."""
    yield from _NAMED.findall(_FENCED.sub("", page.read_text()))


@cache
def definitions(file):
    """Return the names of the functions and classes of a module."""
    return {node.name for node in ast.walk(ast.parse(file.read_text())) if hasattr(node, "name")}


def place(path):
    """Return where a name stands: beside the sources, or in the project."""
    own = ("src/", "tests/", "configs/", "docs/")
    return ROOT / path if path.startswith(own) else ROOT / "src/dynid" / path


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_a_page_names_exists(page):
    for path, test in named(page):
        file = place(path)
        assert file.exists(), f"{page.name} names {path}"
        if test:
            assert test in definitions(file), f"{page.name} names {path}::{test}"


@pytest.mark.parametrize("page", [page for page in PAGES if page.stem != "index"], ids=lambda page: page.stem)
def test_a_section_with_equations_says_where_they_are_computed_or_shown(page):
    text = _FENCED.sub("", page.read_text())
    sections = re.split(r"^## ", text, flags=re.MULTILINE)[1:]
    for section in sections:
        if "$$" in section:
            assert _REMARK.search(section), f"{page.name}: {section.splitlines()[0]}"
