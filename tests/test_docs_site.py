"""What the hooks of the documentation site make of its pages."""

import importlib.util
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("mkdocs", reason="mkdocs is in the extra docs")

ROOT = Path(__file__).parents[1]
PAGE = SimpleNamespace(file=SimpleNamespace(src_uri="theory/page.md"))


def hook(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / f"docs/hooks/{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def scenes():
    module = hook("scene_reference")
    pages = {
        page.relative_to(ROOT / "docs").as_posix(): page.read_text() for page in ROOT.glob("docs/**/*.md")
    }
    marks = {name: module._MARK.search(text) for name, text in pages.items()}
    return module.Reference({name: mark["names"].split() for name, mark in marks.items() if mark})


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


def test_a_part_that_does_not_exist_or_is_not_shown_fails_the_build():
    module = hook("scene_reference")
    with pytest.raises(module.PluginError, match="no part of a scene is called Nothing"):
        module.Reference({"page.md": ["Nothing"]})
    with pytest.raises(module.PluginError, match="no page shows the parts"):
        module.Reference({"page.md": ["Expectation"]})


def test_formulas_become_mathml():
    pytest.importorskip("latex2mathml", reason="latex2mathml is in the extra docs")
    formulas = hook("formulas")
    made = formulas.on_page_content(r'<p><span class="arithmatex">\(a &lt; b\)</span></p>', PAGE)
    assert made.startswith("<p><math")
    assert "<mo>&#x0003C;</mo>" in made
    made = formulas.on_page_content('<div class="arithmatex">\\[\nx^2\n\\]</div>', PAGE)
    assert 'display="block"' in made
    assert "arithmatex" not in made


def test_links_to_files_that_are_no_pages_are_found():
    links = hook("linked_files")
    text = "[a](../../configs/isolator.yaml) [b](index.md#x) ![c](../overview.png)\n"
    text += "```text\n[d](../../README.md)\n```\n"
    assert list(links._outside(text, "theory/page.md", ROOT)) == [
        ("../../configs/isolator.yaml", "configs/isolator.yaml")
    ]
    assert "kind: bond-graph" in links._page("configs/isolator.yaml", ROOT)


@pytest.mark.parametrize(
    "loaded",
    ['<script src="https://unpkg.com/x"></script>', '<link rel="stylesheet" href="//fonts.example/css">'],
)
def test_a_page_that_needs_the_network_fails_the_build(loaded):
    alone = hook("self_contained")
    page = '<a href="https://example.org">read</a><img src="a.svg">'
    assert alone.on_post_page(page, PAGE) == page
    with pytest.raises(alone.PluginError, match=r"theory/page\.md loads"):
        alone.on_post_page(page + loaded, PAGE)


def test_commands_are_shown_with_their_options():
    text = hook("command_reference").on_page_markdown("<!-- commands -->")
    assert "### dynid run" in text
    assert "--junit" in text
