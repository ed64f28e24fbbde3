"""`dynid run --accuracy`."""

import pytest

from dynid.store import read_result

pytestmark = pytest.mark.thorough


def test_a_run_shows_what_else_could_have_been_chosen(folder, dynid):
    code, out, err = dynid("run", "small.yaml", "--accuracy")
    assert (code, err) == (0, "")
    rows = [line.split() for line in out.splitlines()]
    assert [row[0] for row in rows if "→" in row] == ["exact", "exact"]
    assert all("→ chosen, " in line or line.endswith("→ chosen") for line in out.splitlines() if "→" in line)
    assert any(row[:1] == ["float"] for row in rows)
    assert "chosen by default: exact zeros and poles" in " ".join(out.split())
    assert read_result(folder / "small.h5")["accuracy/engine/status"].data.tolist() == ["done"] * 3
    assert "float" in dynid("show", "small.h5")[1]


def test_without_being_asked_nothing_else_is_tried(folder, dynid):
    dynid("run", "small.yaml")
    assert not [path for path in read_result(folder / "small.h5") if path.startswith("accuracy")]
