"""The reference pages: generated from the code, and current (else run `python docs/reference.py`)."""

import importlib.util
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"


@pytest.fixture(scope="module")
def reference():
    sys.path.insert(0, str(DOCS))
    spec = importlib.util.spec_from_file_location("reference_pages", DOCS / "reference.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    sys.path.remove(str(DOCS))


@pytest.fixture(scope="module")
def scenes(reference):
    from reference_scenes import Reference

    return Reference(reference.marked_parts())


@pytest.mark.thorough
def test_pages_of_scenes_python_and_topics_are_current(reference):
    assert reference.outdated(reference.pages(("python", "scene parts"))) == []


@pytest.mark.thorough
@pytest.mark.skipif(version("click").startswith("8.1"), reason="older click prints other help")
def test_the_page_of_commands_is_current(reference):
    assert reference.outdated(reference.pages(("commands",))) == []


@pytest.mark.slow
def test_the_layout_of_results_is_current(reference):
    assert reference.outdated(reference.pages(("layout of",))) == []


def test_a_page_that_differs_or_is_too_many_is_named(reference):
    found = {path: path.read_text() for path in DOCS.glob("reference/**/*.md")}
    first, second = list(found)[:2]
    found[first] += "more"
    del found[second]
    names = {path.relative_to(DOCS).as_posix() for path in (first, second)}
    assert set(reference.outdated(found)) == names


@pytest.mark.thorough
def test_every_part_of_a_scene_is_shown_once(scenes):
    shown = [name for names in scenes.order.values() for name in names]
    assert sorted(shown) == sorted(scenes.parts)


def test_a_key_says_what_it_takes_its_range_and_its_default(scenes):
    text = scenes.text("reference/scenes/index.md")
    assert "| `points` | integer, 1 … 10,000,000 | `200` | Number of frequencies. |" in text
    assert "| `stop` | quantity, > 0 | **needed** | Highest frequency. |" in text
    assert "| `unit` | `rad/s`, `Hz` | `rad/s` | Unit of `start` and `stop`. |" in text


def test_a_part_of_another_page_is_linked_there(scenes):
    text = scenes.text("reference/scenes/bond-graph.md")
    assert "| `frequency` | [mapping](index.md#FrequencyGrid) |" in text


@pytest.mark.thorough
def test_a_part_that_does_not_exist_or_is_not_shown_is_an_error(scenes):
    with pytest.raises(ValueError, match="no part of a scene is called Nothing"):
        type(scenes)({"page.md": ["Nothing"]})
    with pytest.raises(ValueError, match="no page shows the parts"):
        type(scenes)({"page.md": ["Expectation"]})


def test_a_docstring_becomes_lists(reference):
    text = reference.python("dynid.load_scene dynid.errors(UsageError) dynid.builders.GraphBuilder(node)")
    assert "- `dynid.errors.FileError`: Where the file cannot be read." in text
    assert "### `dynid.errors.UsageError`" in text
    assert "`.node(name, type, value=None, **more)`" in text


def test_commands_are_shown_with_their_options(reference):
    text = reference.commands()
    assert "### dynid run" in text
    assert "--junit" in text
