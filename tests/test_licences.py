"""The licences of what dynid stands on: a page names them, and nothing in the core is under the GPL."""

import importlib.util
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
_spec = importlib.util.spec_from_file_location("licences", DOCS / "licences.py")
licences = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(licences)


def test_the_core_is_free():
    core = licences.core()
    assert {"click", "numpy", "python-flint", "mpmath"} <= set(core)  # the last comes with sympy
    assert {name: licences.licence(name) for name in core if not licences.is_free(name)} == {}


def test_the_page_names_what_is_asked_for_directly():
    page = (DOCS / "licences.md").read_text()
    asked = [name for name, by in licences.core().items() if "dynid" in by]
    assert [name for name in asked if f"| {name} |" not in page] == []


@pytest.mark.parametrize(
    ("said", "free"),
    [
        ("BSD-3-Clause AND 0BSD AND MIT AND Zlib AND CC0-1.0", True),
        ("BSD-2-Clause AND Apache-2.0 WITH LLVM-exception", True),
        ("GPL-3.0-or-later", False),
        ("MIT AND AGPL-3.0-only", False),
        ("MIT AND LGPL-3.0-or-later", False),  # it is one package's library that may be
        ("GNU General Public License v3 (GPLv3)", False),
        ("Intel Simplified Software License", False),
        ("not said", False),
    ],
)
def test_a_licence_that_binds_is_told_from_one_that_does_not(said, free, monkeypatch):
    monkeypatch.setitem(licences.UNSAID, "click", said)
    assert licences.is_free("click") is free
