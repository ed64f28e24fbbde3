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
