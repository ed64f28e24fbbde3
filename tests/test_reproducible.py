"""The same scene and seed give the same bytes of data: in another process, place, order, on more threads.

A study has them also of another executor.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import h5py
import pytest

import dynid
from dynid.cli.results import write_page
from dynid.errors import UsageError
from dynid.result import Result
from dynid.scene.run import run_scene
from dynid.store import read_result, write_result

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).parents[1]
CONFIGS, TEMPLATES = ROOT / "configs", ROOT / "src/dynid/templates"
#: Both engines and a port; identification by Kalman filter and by responses, noise, drawn starts, a model
#: error; reductions and modes; a study.
SCENES = [
    CONFIGS / "isolator_port.yaml",
    CONFIGS / "hydraulic_servo.yaml",
    CONFIGS / "suspension_noisy.yaml",
    CONFIGS / "beam_joints.yaml",
    CONFIGS / "beam_frf.yaml",
    CONFIGS / "table6.yaml",
    TEMPLATES / "reduction.yaml",
    TEMPLATES / "structure.yaml",
]
#: Less of these shows the same.
SHORTER = {"beam_frf": "measurement.frf.simulate.lines.points=60", "table6": "measurement.samples=120"}
STUDY = CONFIGS / "studies" / "isolator_tuning.yaml"
RUN = """
import json, os, sys
from dynid.cli import main
os.umask(int(sys.argv[1], 8))
for call in json.loads(sys.argv[2]):
    try:
        main(call)
    except SystemExit as end:
        assert end.code == 0, call
"""


def results(folder, scenes, place, umask, executor, **environment):
    """Run scenes in one new process, and return the files."""
    files = {path.stem: folder / f"{path.stem}.h5" for path in [*scenes, STUDY]}
    calls = [["run", scene, "--set", SHORTER.get(scene.stem, "title=Again")] for scene in scenes]
    calls.insert(len(calls) // 2, ["study", STUDY, "--executor", executor])
    calls = [[str(word) for word in [*call, "-q", "-o", files[call[1].stem]]] for call in calls]
    subprocess.run(
        [sys.executable, "-c", RUN, umask, json.dumps(calls)],
        cwd=place,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src"), **environment},
        check=True,
        timeout=300,
    )
    return files


def datasets(path):
    """Return the type, shape and bytes of every dataset of a file; texts, which lie elsewhere, as texts."""
    found = {}

    def visit(name, item):
        if isinstance(item, h5py.Dataset):
            data = item[()]
            fixed = not item.dtype.hasobject
            found[name] = (item.dtype.str, item.shape, data.tobytes() if fixed else repr(data))

    with h5py.File(path) as file:
        file.visititems(visit)
    return found


@pytest.fixture(scope="module")
def twice(tmp_path_factory):
    one, other = tmp_path_factory.mktemp("one"), tmp_path_factory.mktemp("other")
    return (
        results(one, SCENES, one, "022", "serial", PYTHONHASHSEED="1", OMP_NUM_THREADS="1"),
        results(
            other,
            SCENES[::-1],
            "/",
            "077",
            "processes",
            PYTHONHASHSEED="77",
            OMP_NUM_THREADS="2",
            TZ="Asia/Tokyo",
            LC_ALL="C",
        ),
    )


@pytest.mark.parametrize("name", [path.stem for path in [*SCENES, STUDY]])
def test_the_same_scene_and_seed_give_the_same_bytes(name, twice):
    one, other = (datasets(files[name]) for files in twice)
    assert list(one) == list(other)
    assert [path for path in one if one[path] != other[path]] == []


def test_with_a_given_date_files_and_pages_are_the_same_byte_by_byte(tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    scene = dynid.load_scene(TEMPLATES / "reduction.yaml")
    for name in "ab":
        write_result(run_scene(scene), tmp_path / name)
        write_page(read_result(tmp_path / name), str(tmp_path / f"{name}.html"))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "2023-11-14" in page
    assert page == (tmp_path / "b.html").read_text(encoding="utf-8")


def test_a_date_that_is_no_number_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "today")
    with pytest.raises(UsageError, match=r"SOURCE_DATE_EPOCH is 'today'\. Set it to a number of seconds"):
        write_result(Result("k"), tmp_path / "a")
