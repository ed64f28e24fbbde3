"""Names of exported files are valid on all systems, and temporary files of killed exports are removed."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynid.file_access import file_names, remove_parts, replacing


@given(st.lists(st.text(max_size=300), max_size=20))
def test_names_of_files_are_valid_and_different_on_all_systems(names):
    found = file_names(names)
    assert len(found) == len(names)
    assert len({name.casefold() for name in found}) == len(found)
    for name in found:
        assert re.fullmatch(r"[\w+-][\w.+-]*", name)
        assert not name.endswith(".")
        assert len(name.encode()) <= 220


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("bond_graph.properties.m_s.f.v_in", "bond_graph.properties.m_s.f.v_in"),
        ("..\\..\\up", "_.._.._up"),
        ('a/b:c*d?e|f<g>h"i', "a_b_c_d_e_f_g_h_i"),
        ("C:x", "C_x"),
        ("nul.txt", "_nul.txt"),
        ("LPT1", "_LPT1"),
        (".hidden", "_.hidden"),
        ("", "_"),
        ("tab\tnewline\n", "tab_newline_"),
        ("Feder_ä", "Feder_ä"),
    ],
)
def test_anything_but_letters_digits_and_some_signs_is_replaced(name, expected):
    assert file_names([name]) == [expected]


def test_equal_names_are_numbered_also_where_they_differ_in_case():
    assert file_names(["a/b", "a:b", "A_B", "a_b_2"]) == ["a_b", "a_b_2", "A_B_3", "a_b_2_2"]


KILLED = """
import os, signal, sys
from dynid.file_access import replacing
with replacing(sys.argv[1]) as part:
    os.kill(os.getpid(), signal.SIGKILL)
"""


def parts(folder):
    return sorted(path.name for path in folder.glob(".dynid-*"))


@pytest.mark.skipif(sys.platform == "win32", reason="Windows cannot ask whether a process runs")
def test_what_a_killed_process_left_is_removed_and_nothing_else(tmp_path):
    ended = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / "x.csv")], check=False)
    assert ended.returncode == -signal.SIGKILL
    (left,) = parts(tmp_path)
    old, new = tmp_path / f".dynid-{'0' * 16}.part", tmp_path / f".dynid-{'1' * 16}.part"
    others = [tmp_path / ".dynid-mine.part", tmp_path / "x.part", new]
    for path in (old, *others):
        path.touch()
    os.utime(old, (time.time() - 3600,) * 2)
    with replacing(tmp_path / "y.csv") as part:  # of a process that still runs
        remove_parts(tmp_path)
        assert Path(part).exists()
    assert not (tmp_path / left).exists()
    assert not old.exists()
    assert all(path.exists() for path in others)
    remove_parts(tmp_path / "missing")
