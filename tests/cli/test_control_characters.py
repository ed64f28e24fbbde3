"""Control characters of files: they reach no terminal and no spreadsheet."""

import csv
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynid.cli.arguments import guarded, terminal
from dynid.result import Result
from dynid.store.tables import tables_of, write_csv
from dynid.suggestions import printable

OBEYED = "".join(map(chr, (*range(9), *range(11, 32), *range(127, 160), 0x202E, 0x2066, 0x2028)))


@given(st.text())
def test_a_printable_text_keeps_all_else(text):
    shown = printable(text)
    assert not set(shown) & set(OBEYED)
    assert printable(shown) == shown
    if not set(text) & set(OBEYED) and all(letter.isprintable() or letter in "\t\n" for letter in text):
        assert shown == text


def test_streams_are_guarded_and_given_back(capsys):
    before = sys.stdout, sys.stderr
    with guarded():
        print(f"a{OBEYED}b\tc")
        print(f"d{OBEYED}", file=sys.stderr)
        print("\r\x1b[K", file=terminal(), end="")  # our own progress line
    assert (sys.stdout, sys.stderr) == before
    with pytest.raises(ZeroDivisionError), guarded():
        raise ZeroDivisionError
    assert (sys.stdout, sys.stderr) == before
    said = capsys.readouterr()
    assert not set(said.out) & set(OBEYED)
    assert said.out.startswith("a\\x00")
    assert said.out.endswith("b\tc\n")
    assert said.err.endswith("\n\r\x1b[K")
    assert said.err.count("\x1b") == 1


@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_no_encoding_of_the_terminal_lets_them_through(tmp_path, encoding):
    scene = tmp_path / "\x1b]0;\x07\x9b.yaml"
    done = subprocess.run(
        [sys.executable, "-m", "dynid", "run", str(scene)], capture_output=True, check=False,
        env=os.environ | {"PYTHONIOENCODING": encoding, "LC_ALL": "C"}, timeout=300,
    )  # fmt: skip
    assert done.returncode in (2, 4)
    assert b"\\x1b]0;\\x07" in done.stderr
    assert not {0x1B, 0x07, 0x9B} & {*done.stderr, *done.stdout}


def test_a_cell_that_a_spreadsheet_would_compute_is_a_text(tmp_path):
    cells = ["=1+1", "+1", "-m", "@SUM(A1)", " =2", "-3.5", "1e3", "\x1b[2J", "plain", "a=b", ""]
    result = Result("plan", "Cells")
    result.add("group/text", np.array(cells, dtype=object), ("row",))
    result.add("group/number", -np.arange(1.0, 12.0), ("row",))
    (table,) = tables_of(result)
    write_csv(table, tmp_path / "t.csv")
    with (tmp_path / "t.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    texts = [row["text"] for row in rows]
    assert texts == [
        "'=1+1", "+1", "'-m", "'@SUM(A1)", "' =2", "-3.5", "1e3", "\\x1b[2J", "plain", "a=b", ""
    ]  # fmt: skip
    assert [float(row["number"]) for row in rows] == [-float(k) for k in range(1, 12)]
