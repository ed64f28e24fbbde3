"""`dynid show` of a study."""

import numpy as np
import pytest

from tests.study.studies import write
from tests.study.test_influence import ishigami, saltelli

pytestmark = pytest.mark.thorough

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
    assert "4 singular at 0.5 rad/s 0, 200, 400, …" in lines
    assert "1 no such file 14" in lines
    assert "the same in every sample, p/properties: order 2" in lines
    assert any(line.startswith("p/properties/stable: ") and line.endswith("% true") for line in lines)
    assert any(line.startswith("p/roots/|poles[1]| [rad/s] 0.") for line in lines)
    assert "p/response/response: 40 values per sample" in lines
    assert any(line.startswith("p/properties/prototype: d 7") for line in lines)
    assert any(line.startswith("p/properties/gain <= 2 ") and line.endswith(" %") for line in lines)
    gain = next(line for line in lines if line.startswith("p/properties/gain: b ↑"))
    # 3 x - y: nine parts of ten and one; 395 samples tell them to some per cent
    assert 85 <= float(gain.split()[3]) <= 95
    assert 5 <= float(gain.partition("m ")[2].split()[-4]) <= 15


def test_the_screen_names_the_samples_of_both_extremes_by_their_numbers(dynid, file):
    from dynid.store import read_result

    values = read_result(file)["study/results/p/properties/gain"].data
    _, out, _ = dynid("show", file)
    row = next(line.split() for line in out.splitlines() if line.split()[:1] == ["p/properties/gain"])
    least, most = (2 * int(find(values)) for find in (np.nanargmin, np.nanargmax))
    assert row[3] == f"({least})"
    assert row[5] == f"({most})"
    assert float(row[2]) == pytest.approx(np.nanmin(values), abs=1e-3)
    assert float(row[4]) == pytest.approx(np.nanmax(values), abs=1e-3)


def test_statistics_of_few_samples_have_their_number(dynid, tmp_path):
    """Of 10 samples one failed, and 3 have a second pole; the page has the same numbers as the screen."""
    from dynid.report.content import content
    from dynid.store import read_result

    x = np.arange(10.0)
    poles = np.where(x[:, None] < [20, 3], 1 + x[:, None] + 0j, np.nan)
    values = {"p/poles": ("rad/s", ("pole",), {}, poles), "p/gain": x}
    write(tmp_path / "s.h5", {"parameters.b": x}, values, {9: "singular"})
    _, out, _ = dynid("show", tmp_path / "s.h5")
    table = out.partition("mean")[2].partition("samples count")[0]
    name = "p/|poles[2]| [rad/s] (n = 3)"
    assert [" ".join(line.split()[:5]) for line in table.splitlines() if "(n =" in line] == [name]
    sections = {section.title: section for section in content(read_result(tmp_path / "s.h5")).sections}
    names = [row[0] for row in sections["Statistics"].blocks[0].rows]
    assert [name for name in names if "n =" in name] == [name]


@pytest.fixture
def wide(tmp_path):
    """A study of more numbers than a screen lists, most of which do not vary."""
    x = np.arange(60.0)
    values = {f"p/properties/constant_{k}": np.full(60, float(k)) for k in range(50)}
    values |= {
        "p/properties/alpha": ("deg", (), {}, x),
        "p/properties/settling_time": ("s", (), {}, x + 1),
        "p/properties/modes": ("rad/s", ("mode",), {}, x[:, None]),
        "p/margins/zeta": ("dB", (), {}, -x),
        "p/prototype": np.full(60, "d"),
    }
    text = "dynid: 1\nkind: study\ncollect: [p/margins, p/properties/sett*, p/properties]\n"
    write(tmp_path / "s.h5", {"parameters.b": x}, values, text=text)
    return tmp_path / "s.h5"


@pytest.mark.thorough
def test_what_varies_is_listed_in_the_order_of_collect_with_units(dynid, wide):
    _, out, _ = dynid("show", wide)
    lines = [" ".join(line.split()) for line in out.splitlines()]
    first = lines.index("mean min (sample) max (sample) std p05 median p95")
    table = lines[first + 1 : lines.index("samples count from 0")]
    assert [" ".join(line.split()[:2]) for line in table] == [
        "p/margins/zeta [dB]",
        "p/properties/settling_time [s]",
        "p/properties/alpha [deg]",
        "p/properties/modes [rad/s]",
    ]
    assert "the same in every sample, p: prototype d" in lines
    constants = out[out.index("the same in every sample, p/properties: ") :].split("\n\n")[0]
    assert all(f"constant_{k} {k}" in " ".join(constants.split()) for k in range(50))
    assert "values per sample" not in out


def test_statistics_fit_a_terminal_of_80_columns_with_the_extremes_first(dynid, wide, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    monkeypatch.setenv("NO_COLOR", "1")
    _, out, _ = dynid("show", wide)
    lines = out.splitlines()
    assert max(map(len, lines)) <= 80
    (head,) = [line.split() for line in lines if "(sample)" in line]
    assert head[:5] == ["mean", "min", "(sample)", "max", "(sample)"]
    assert sum(line.startswith("    p/margins/zeta [dB]  ") for line in lines) == 2  # blocks of columns


@pytest.mark.thorough
def test_a_table_has_the_columns_of_collect_in_their_order(dynid, wide):
    assert dynid("export", wide, "--csv", "-o", wide.with_suffix(".csv"))[0] == 0
    head = wide.with_suffix(".csv").read_text().splitlines()[0].split(",")
    outputs = [name for name in head if name.startswith("p/")]
    assert outputs[:3] == [
        "p/margins/zeta [dB]",
        "p/properties/settling_time [s]",
        "p/properties/alpha [deg]",
    ]
    assert outputs[3:5] == ["p/properties/constant_0", "p/properties/constant_1"]


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
