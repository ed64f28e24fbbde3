"""No dependency has a lower bound with a known advisory, and the audit of continuous integration says so."""

import importlib.util
import json
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def audit():
    spec = importlib.util.spec_from_file_location("ci_audit", ROOT / ".ci" / "audit.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_no_lower_bound_has_a_known_advisory(audit):
    bounds = list(audit.bounds())
    places = {(place, package) for place, package, _ in bounds}
    expected = {("pyproject.toml", "click"), ("pyproject.toml", "pyarrow"), ("recipe/recipe.yaml", "click")}
    assert expected <= places
    assert list(audit.findings(bounds, audit.stored())) == []


@pytest.mark.parametrize(
    ("version", "concerned"),
    [
        ("8.3.2", True),
        ("8.3.3", False),
        ("8.3", True),
        ("8.10", False),
        ("10.0.0", False),
        ("8.3.3.0", False),
    ],
)
def test_versions_are_compared_by_their_numbers(audit, version, concerned):
    advisories = [{"package": "Some_Package", "fixed": "8.3.3", "id": "X-1"}]
    found = list(audit.findings([("here", "some-package", version), ("here", "other", "0")], advisories))
    said = [f"here: some-package {version} has a known advisory (X-1); use 8.3.3"]
    assert found == (said if concerned else [])


def test_bounds_of_extras_and_of_the_recipe_are_read(audit, tmp_path):
    (tmp_path / "pyproject.toml").write_text(
        '[project]\nname = "x"\ndependencies = ["a>=1.2"]\n'
        '[project.optional-dependencies]\nmore = ["B_c[d]>=2.0", "dynid[more]"]\n'
    )
    (tmp_path / "recipe").mkdir()
    (tmp_path / "recipe" / "recipe.yaml").write_text("requirements:\n  run:\n    - a >=1.3\n    - pip\n")
    assert list(audit.bounds(tmp_path)) == [
        ("pyproject.toml", "a", "1.2"),
        ("pyproject.toml", "b-c", "2.0"),
        ("recipe/recipe.yaml", "a", "1.3"),
    ]


def test_where_no_database_can_be_reached_the_stored_list_is_used(audit, monkeypatch, capsys):
    monkeypatch.setattr(audit, "from_database", lambda _: None)
    monkeypatch.setattr(
        audit, "installed", lambda _: [("installed", "click", "8.1.7"), ("installed", "x", "1")]
    )
    assert audit.main(sys.executable) == 1
    out = capsys.readouterr().out
    assert "installed: click 8.1.7 has a known advisory; use 8.3.3" in out
    assert "2 packages audited by the stored list" in out
    monkeypatch.setattr(audit, "from_database", lambda _: ["installed: x 1 has a known advisory (Y); use 2"])
    assert audit.main(sys.executable) == 1
    assert "audited by the database: 1 with" in capsys.readouterr().out
    monkeypatch.setattr(audit, "from_database", lambda _: [])
    assert audit.main(sys.executable) == 0


def test_without_the_tool_there_is_no_database(audit, monkeypatch, tmp_path):
    monkeypatch.setattr(audit, "ROOT", tmp_path)
    assert audit.from_database([("installed", "click", "8.1.7")]) is None


def test_the_stored_list_is_complete():
    for entry in json.loads((ROOT / ".ci" / "advisories.json").read_text()):
        assert entry.keys() == {"package", "fixed", "id"}
