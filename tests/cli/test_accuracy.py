"""`dynid run --accuracy`."""

from dynid.store import read_result


def test_a_run_shows_what_else_could_have_been_chosen(folder, dynid):
    code, out, err = dynid("run", "small.yaml", "--accuracy")
    assert (code, err) == (0, "")
    rows = [line.split() for line in out.splitlines()]
    chosen = [row[1] for row in rows if row[:1] == ["→"] and row[1] != "the"]
    assert chosen == ["exact", "exact"]
    assert any(row[:1] == ["float"] for row in rows)
    assert "chosen by default: exact zeros and poles" in " ".join(out.split())
    assert read_result(folder / "small.h5")["accuracy/engine/status"].data.tolist() == ["done"] * 3
    assert "float" in dynid("show", "small.h5")[1]


def test_without_being_asked_nothing_else_is_tried(folder, dynid):
    dynid("run", "small.yaml")
    assert not [path for path in read_result(folder / "small.h5") if path.startswith("accuracy")]
