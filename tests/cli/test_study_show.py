"""`dynid show` of a study."""

import numpy as np
import pytest

from tests.study.studies import write
from tests.study.test_influence import ishigami, saltelli

BASE = "dynid: 1\nexpect:\n  - {path: p/properties/gain, max: 2}\n"


@pytest.fixture
def file(tmp_path):
    """A study of a linear model with failures."""
    rng = np.random.default_rng(3)
    x, y = rng.random((2, 400))
    values = {
        "p/properties/gain": 3 * x - y,
        "p/properties/stable": x < 0.25,
        "p/properties/order": np.full(400, 2),
        "p/properties/prototype": np.where(y < 0.75, "d", "c"),
        "p/roots/poles": ("rad/s", ("pole",), {}, (x[:, None] + y[:, None] * [[1j, -1j]])),
        "p/response/response": ("", ("omega",), {"omega": np.arange(40.0)}, rng.random((400, 40))),
    }
    failed = {row: f"singular at {row}.5 rad/s" for row in range(0, 400, 100)} | {7: "no such file"}
    columns = {"parameters.b": x, "parameters.m": y, "estimator.method": ["filter"] * 400}
    write(tmp_path / "s.h5", columns, values, failed, [3 * x - y <= 2], base=BASE, numbers=np.arange(400) * 2)
    return tmp_path / "s.h5"


def test_the_screen_of_a_study(dynid, file):
    code, out, _ = dynid("show", file)
    assert code == 0
    lines = [" ".join(line.split()) for line in out.splitlines()]
    assert lines[0].startswith("Made up study · 400 samples")
    assert "395 done · 5 failed" in lines
    assert "estimator.method filter" in lines
    assert "4 singular at 0.5 rad/s (samples 0, 200, 400, …)" in lines
    assert "1 no such file (sample 14)" in lines
    assert "order 2 in every sample" in lines
    assert any(line.startswith("stable ") and line.endswith("% true") for line in lines)
    assert any(line.startswith("|poles[1]| 0.") for line in lines)
    assert "p/response/response: 40 values per sample" in lines
    assert any(line.startswith("p/properties/prototype: d 7") for line in lines)
    assert any(line.endswith("% p/properties/gain <= 2") for line in lines)
    gain = next(line for line in lines if line.startswith("gain b ↑"))
    # 3 x - y: nine parts of ten and one; 395 samples tell them to some per cent
    assert 85 <= float(gain.split()[3]) <= 95
    assert 5 <= float(gain.partition("m ")[2].split()[-4]) <= 15


def test_the_screen_names_the_worst_sample_by_its_number(dynid, file):
    from dynid.store import read_result

    values = read_result(file)["study/results/p/properties/gain"].data
    _, out, _ = dynid("show", file)
    row = next(line.split() for line in out.splitlines() if line.split()[:1] == ["gain"])
    assert row[-1] == str(2 * int(np.nanargmax(values)))


def test_all_lists_the_arrays_without_reading_them(dynid, file):
    code, out, _ = dynid("show", file, "--all")
    assert code == 0
    lines = [" ".join(line.split()) for line in out.splitlines()]
    assert "study/results/p/response/response float64 sample 400 x omega 40" in lines


def test_a_saltelli_design_gives_total_orders(dynid, tmp_path):
    samples = np.pi * (2 * saltelli(3, 256) - 1)
    columns = {f"parameters.x{k + 1}": column for k, column in enumerate(samples.T)}
    write(tmp_path / "s.h5", columns, {"p/y": ishigami(*samples.T)})
    _, out, _ = dynid("show", tmp_path / "s.h5")
    parts = next(line for line in out.splitlines() if "in all" in line)
    assert parts.index("x1") < parts.index("x2") < parts.index("x3")
    assert "Saltelli's design, 256 rows" in out


def test_inputs_that_go_together_are_said(dynid, tmp_path):
    x = np.random.default_rng(0).random(200)
    write(tmp_path / "s.h5", {"a.x": x, "a.y": x + 0.01}, {"p/y": x})
    _, out, _ = dynid("show", tmp_path / "s.h5")
    assert "a.x and a.y are correlated (1): their parts overlap" in out


def test_an_interrupted_study_can_be_shown(dynid, tmp_path):
    write(
        tmp_path / "s.h5",
        {"a.x": np.arange(4.0)},
        {"p/y": np.arange(4.0)},
        {2: None, 3: None},
        complete=False,
    )
    code, out, _ = dynid("show", tmp_path / "s.h5")
    assert code == 0
    assert "2 done · 2 pending" in out
    assert "run the study again to resume it" in out


def test_a_study_of_which_all_failed_has_a_screen(dynid, tmp_path):
    write(
        tmp_path / "s.h5",
        {"a.x": np.arange(3.0)},
        {"p/y": np.arange(3.0)},
        dict.fromkeys(range(3), "singular"),
    )
    code, out, _ = dynid("show", tmp_path / "s.h5")
    assert code == 0
    assert "0 done · 3 failed" in out
