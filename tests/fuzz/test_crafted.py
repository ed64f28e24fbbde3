"""Result files that somebody has changed with HDF5 itself: a sentence, whatever reads them.

Objects are moved, removed, linked in circles, or replaced by others of another type or rank; texts carry
what terminals obey.
"""

import random
import shutil

import h5py
import numpy as np
import pytest

from dynid.cli import main
from dynid.store import write_result
from dynid.study.executors import SerialExecutor
from dynid.study.run import run_study
from tests.report.pages import result_of
from tests.study.small import STUDY, planned

pytestmark = pytest.mark.thorough

ESCAPE = "\x1b[2J\x1b]0;title\x07\x9b31m\u202e"
KINDS = ["bond-graph", "identification", "reduction", "bench", "study"]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A good file of every kind."""
    folder = tmp_path_factory.mktemp("good")
    for kind in KINDS[:-1]:
        write_result(result_of(kind), folder / f"{kind}.h5")
    study = STUDY.replace("stop: 4, points: 4", "stop: 2, points: 2")
    run_study(planned(folder, study), folder / "study.h5", SerialExecutor())
    return folder


def commands(file):
    """Yield every command that reads a result."""
    yield "show", file
    yield "show", file, "--all"
    yield "report", file, "-o", "page.html", "-q"
    yield "plot", file, "-o", "figures", "-q"
    yield "export", file, "--csv", "-o", "tables"
    yield "export", file, "--json", "-o", "out.json"
    yield "compare", file, file
    yield "study-merge", file, "-o", "merged.h5", "--partial"
    yield "study-worst", file, "bond_graph/properties/m.f/F/dc_gain", "-o", "worst.yaml"


def run(capsys, *command):
    capsys.readouterr()
    with pytest.raises(SystemExit) as left:
        main([str(word) for word in command])
    said = capsys.readouterr()
    return left.value.code, said.out, said.err


OTHERS = [
    np.float64(3.0), np.arange(7.0), np.zeros((2, 3, 4)), np.zeros((0,)), np.int8(1), np.array([True, False]),
    np.array([1 + 2j]), np.array([np.nan, np.inf]), "text", np.array(["a", ESCAPE], dtype=object),
    np.array([(1, 2.0)], dtype=[("a", "i4"), ("b", "f8")]), np.full((5, 5), -1), np.array([b"\xff\xfe"]),
]  # fmt: skip


WAYS = ["group", "other", "delete", "move", "circle", "outside", "attrs", "rank", "dims"]
VALUES = [ESCAPE, 7, np.arange(3.0), "x" * 60_000, np.bool_(1), np.nan]


def within(file, name):
    try:
        return name in file
    except RuntimeError:  # behind a circle of links that an earlier change made
        return False


def craft(path, seed):
    """Change some objects of a file; say what was done."""
    chance, done = random.Random(seed), []
    with h5py.File(path, "a") as file:
        names = []
        file.visit(names.append)
        for _ in range(chance.randint(1, 3)):
            name = chance.choice(names)
            if not within(file, name):
                continue
            way = chance.choice(
                ["group", "other", "delete", "move", "circle", "outside", "attrs", "rank", "dims"]
            )
            done.append((way, name))
            _change(file, name, way, chance)
    return done


def _change(file, name, way, chance):
    item = file[name]
    if way == "attrs":
        for key in [*item.attrs][:4]:
            if key not in ("DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME"):
                item.attrs[key] = chance.choice(
                    [ESCAPE, 7, np.arange(3.0), "x" * 60_000, np.bool_(1), np.nan]
                )
        item.attrs[f"{ESCAPE}extra"] = ESCAPE
        return
    if way == "dims":
        item.attrs["dynid_dims"] = chance.choice([ESCAPE, "a\nb\nc", "", "sample"])
        return
    data = item[()] if way == "rank" and isinstance(item, h5py.Dataset) else None
    if way == "move":
        file.move(name, f"moved/{chance.random()}")
        return
    del file[name]
    if way == "group":
        file.create_group(name)[ESCAPE] = 1.0
    elif way == "other":
        file[name] = chance.choice(OTHERS)
    elif way == "circle":
        file[name] = h5py.SoftLink(f"/{name}")
    elif way == "outside":
        file[name] = h5py.ExternalLink("/dev/zero", "/x")
    elif data is not None and getattr(data, "dtype", np.dtype("O")).kind in "biufc":
        file[name] = chance.choice(
            [np.ravel(data), np.asarray(data)[None], np.ravel(data)[:1], np.ravel(data)[:0]]
        )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seeds", [range(1), pytest.param(range(1, 200), marks=pytest.mark.slow)])
@pytest.mark.filterwarnings("ignore")  # numbers may be anything now
def test_a_crafted_result_ends_in_a_sentence(files, tmp_path, monkeypatch, capsys, kind, seeds):
    monkeypatch.chdir(tmp_path)
    for seed in seeds:
        shutil.copy(files / f"{kind}.h5", "x.h5")
        done = craft("x.h5", seed)
        for command in commands("x.h5"):
            code, out, err = run(capsys, *command)
            about = (seed, done, command, err[-300:])
            assert code in (0, 1, 2, 3, 4), about
            assert "fault of dynid" not in err, about
            assert len(err) < 2000, about
            assert not CONTROL & {*out, *err}, about
        (tmp_path / "x.h5").unlink()


CONTROL = {chr(code) for code in (*range(32), *range(127, 160), 0x202E)} - {"\n", "\t"}


@pytest.mark.parametrize("gone", ["exit_code", "sample", "key", "results"])
def test_a_moved_group_is_reported_with_the_file(files, tmp_path, monkeypatch, capsys, gone):
    monkeypatch.chdir(tmp_path)
    shutil.copy(files / "study.h5", "x.h5")
    with h5py.File("x.h5", "a") as file:
        file.move(f"study/{gone}", "study/elsewhere")
    code, _, err = run(capsys, "study-merge", "x.h5", "-o", "merged.h5")
    assert "fault of dynid" not in err
    if gone != "results":  # without them it is a study that gathered nothing
        assert code == 4, err
        assert "x.h5" in err
        assert len(err.splitlines()) == 1


@pytest.mark.parametrize("where", ["title", "node", "file"])
def test_control_characters_reach_no_terminal_table_or_page(tmp_path, monkeypatch, capsys, where):
    monkeypatch.chdir(tmp_path)
    scene, name, title = "scene.yaml", "m", "A mass"
    if where == "title":
        title = ESCAPE
    elif where == "node":
        name = ESCAPE + "m"
    else:
        scene = f"{ESCAPE.replace('/', '')}.yaml"
    quoted = "".join(f"\\u{ord(letter):04x}" if ord(letter) < 0x10000 else letter for letter in name)
    said = "".join(f"\\u{ord(letter):04x}" for letter in title)
    (tmp_path / scene).write_text(
        f'dynid: 1\nkind: bond-graph\ntitle: "{said}"\n'
        f'graph:\n  nodes: {{F: Se, "{quoted}": {{type: I, value: 2}}, b: {{type: R, value: 1}}, j: 1}}\n'
        f'  bonds: [F -> j, [j, "{quoted}"], j -> b]\n'
        "analysis:\n  inputs: [F]\n  outputs: [b.f]\n  frequency: {start: 1, stop: 3, points: 3}\n"
    )
    outputs = [run(capsys, "check", scene), run(capsys, "run", scene, "-o", "x.h5", "--report", "x.html")]
    if (tmp_path / "x.h5").exists():
        outputs += [run(capsys, "show", "x.h5", "--all"), run(capsys, "export", "x.h5", "--csv", "-o", "t")]
        outputs += [run(capsys, "plot", "x.h5", "-o", "figures")]
    for _, out, err in outputs:
        assert not CONTROL & {*out, *err}
    for path in [*tmp_path.glob("*.html"), *tmp_path.glob("t/*.csv"), *tmp_path.glob("figures/*.svg")]:
        assert not CONTROL & {*path.read_text(encoding="utf-8")} - {"\r"}, path
