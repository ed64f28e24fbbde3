"""Benchmarks: every alternative computes at a small size, and its figures are correct."""

import platform
import re
import subprocess
import sys
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from dynid.bench import BENCHMARKS, benchmark, run_benchmarks
from dynid.bench.benchmark import DATA, DEFAULT_RUN, PEER_MODULE, PEERS, Alternative
from dynid.bench.suite import (
    BenchmarkChange,
    BenchmarkFigure,
    _timed,
    beaten,
    changes,
    limits,
    measured,
    pareto,
    processor,
)
from dynid.cli import cli
from dynid.cli.screen import summary
from dynid.errors import DynidError, Singular, UsageError
from dynid.report.content import content
from dynid.report.content.blocks import TextTable
from dynid.report.page import page
from dynid.result import Result
from dynid.store import read_result, write_result
from tests.report.pages import bench as sample_bench

#: A small size of each, and the largest error of dynid's own (first) alternative there.
SMALL = {
    "frequency-response": (6, 1e-13),
    "frequency-response-on-loops": (6, 1e-13),
    "frequency-response-of-trees": (12, 1e-13),
    "mesh-response": (3, 1e-12),
    "mesh-roots": (3, 1e-12),
    "ladder-peaks": (3, 1e-12),
    "chain-whole": (3, 1e-12),
    "chain-reading": (3, 0),
    "zeros-poles": (4, 1e-13),
    "polynomials": (4, 1e-15),
    "symbolic": (3, 0),
    "pencils": (20, 1e-13),
    "loops": (2, 0),
    "propagation": (200, 1e-4),
    "filters": (100, 0.05),
    "estimators": (200, 2.0),
    "wide-record": (60, 0.5),  # of noise
    "long-record": (60, 0.5),
    "basis": (7, 0.05),
    "residuals": (5, 1e-3),
    "reduction": (300, 1e-10),
    "modes": (300, 1e-10),
    "modes-of-solids": (300, 1e-10),
    "many-modes": (20, 1e-10),
    "structure-response": (3, 1e-8),
    "large-structure-response": (300, 1e-8),
    "frf-joints": (60, 0.1),
    "frf-many-joints": (60, 0.5),
    "modal-updating": (300, 1e-5),
    "plate-process": (400, 1e-10),
    "craig-bampton": (400, 0.1),
    "many-modes-process": (400, 1e-10),
    "startup": (1, 0),
    "study": (2, 1e-15),
    "study-of-reductions": (2, 1e-11),
    "study-of-reductions-process": (2, 1e-10),
    "study-of-identifications": (2, 0.05),  # standard errors
    "robot-arm": (1024, 0.25),
}
QUICK = [
    (name, each.name)
    for name in SMALL
    if name != "startup"
    for each in benchmark(name).alternatives
    if not each.missing() and "control" not in each.needs and each.name not in ("sympy", "pardiso")
]

#: What cannot do the work at every size, and says so.
REFUSED = ("serep-mass",)
#: What takes long.
SLOW = (
    "imbedding-4",
    "invariant-imbedding",
    "least-squares",
    "full",
    "below-1-bands",
    "below-5-bands",
    "below-10-bands",
    "study-processes",
    "graph-4",
)
#: One command for each sample, which tests of commands run, too; what others do at more cost.
REPEATED = (
    *((name, "process-each") for name in ("study", "study-of-reductions", "study-of-identifications")),
    ("frf-joints", "whole"),
    *(("frf-many-joints", name) for name in ("whole", "reduced-first", "least-squares-on-modes")),
    *(("study-of-reductions-process", name) for name in ("serep", "five-methods")),
    ("modal-updating", "dynid"),
    ("wide-record", "dynid"),
    ("long-record", "dynid"),
    ("residuals", "residuals-auto"),
    ("residuals", "residuals-none"),
    ("estimators", "auto-numpy"),
    ("frequency-response-on-loops", "in-order"),
    ("frequency-response-on-loops", "sparse-nodal"),
    ("plate-process", "script"),
    ("craig-bampton", "script"),
    ("many-modes-process", "script"),
    ("basis", "below-2-bands"),
)


def test_every_benchmark_has_a_small_size_here():
    assert SMALL.keys() == BENCHMARKS.keys()


def _slow(each):
    return [pytest.mark.slow] * (each[1] in SLOW or each in REPEATED)


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore")  # what peers say of their own work
@pytest.mark.parametrize(
    ("name", "alternative"),
    [
        pytest.param(
            *each, id="-".join(each), marks=[pytest.mark.slow] * (each[1] in SLOW or each in REPEATED)
        )
        for each in QUICK
    ],
)
def test_an_alternative_does_the_work(name, alternative, monkeypatch):
    monkeypatch.setattr("dynid.bench.suite._MIN_SECONDS", 0.0)
    case, (size, least) = benchmark(name), SMALL[name]
    chosen = next(each for each in case.alternatives if each.name == alternative)
    try:
        error = case.error(size, chosen.prepared(size, case.problem)())
    except Singular:
        assert alternative in REFUSED
        return
    assert error >= 0
    if alternative == case.alternatives[0].name:
        assert error <= least


def test_figures_stand_where_the_contract_says(result):
    group = "bench/propagation/exponential-spline"
    assert list(result[f"{group}/size"].data) == [100, 200]
    for name, units in (("time", "s"), ("memory", "B"), ("error", "")):
        variable = result[f"{group}/{name}"]
        assert (variable.dims, variable.units) == (("size",), units)
        assert np.all(np.isfinite(variable.data) & (variable.data >= 0))
    zero, spline = (result[f"bench/propagation/exponential-{hold}/error"].data for hold in ("zero", "spline"))
    assert np.all(zero > 100 * spline)  # what a hold costs is seen


def test_a_work_that_fails_is_named_and_the_others_stand():
    answer = measured("propagation", "exponential-linear", 1)  # one sample has no line to the next
    assert "two samples" in answer["failed"]


def test_a_command_that_fails_is_named(monkeypatch):
    def run(*_, **__):
        raise subprocess.CalledProcessError(3, "python")

    monkeypatch.setattr(subprocess, "run", run)
    assert "exit status 3" in measured("startup", "help", 1)["failed"]


@pytest.mark.usefixtures("here")
def test_nothing_that_came_to_an_end_is_an_error(monkeypatch):
    case = benchmark("propagation")
    monkeypatch.setattr(
        "dynid.bench.suite.benchmark", lambda _: replace(case, alternatives=case.alternatives[:1])
    )
    with pytest.raises(DynidError, match="no alternative"):
        run_benchmarks(["propagation"], {"propagation": [0]})


def test_a_default_run_ends_within_three_minutes():
    assert (
        sum(place.seconds for place in BENCHMARKS.values()) <= 155 < DEFAULT_RUN < 180
    )  # the last work that is begun takes its time, too


@pytest.mark.usefixtures("here")
def test_a_benchmark_without_its_data_is_skipped_and_named(tmp_path, monkeypatch):
    monkeypatch.setenv(DATA, str(tmp_path))
    with pytest.raises(UsageError, match=r"no file .*robot_arm\.dat; DYNID_DATA names the folder"):
        run_benchmarks(["robot-arm"])
    found = run_benchmarks(["robot-arm", "loops"], {"loops": [2]})
    assert found.group_attrs["bench"]["skipped"].startswith("robot-arm: no file ")
    machine = found.group_attrs["bench"]["machine"]
    for said in (r" cores?, ", f", Python {platform.python_version()}, ", f" NumPy {np.__version__} \\("):
        assert re.search(said, machine)
    assert "skipped: robot-arm: no file" in summary(found, "")


@pytest.mark.usefixtures("here")
def test_what_does_not_fit_into_the_time_is_left_out_and_named():
    from tests.screens import lines

    told = []
    found = run_benchmarks(["loops"], {"loops": [2, 3]}, told.append, seconds=0.0)
    assert [list(found[f"bench/loops/{name}/size"].data) for name in ("exact", "float")] == [[2], [2]]
    assert found.group_attrs["bench/loops"]["late"] == "side 3: exact, float"
    assert "left out for time (--full measures it): side 3: exact, float" in "\n".join(lines(found))
    assert any(line.startswith("  measured in ") for line in lines(found)[-2:])  # of a long name two lines
    assert told[0] == "1 of 1: loops, side 2, exact"


@pytest.mark.parametrize(
    ("duration", "runs"), [(0.001, 25), (0.02, 15), (0.2, 3), (0.6, 2), (2.0, 1)], ids=str
)
def test_long_works_are_repeated_less(duration, runs):
    now = [0.0]

    def work():
        now[0] += duration

    assert _timed(work, lambda: now[0]) == pytest.approx(duration)
    assert round(now[0] / duration) == runs


def test_the_front_is_what_no_other_beats():
    fast, good, both, worse = (BenchmarkFigure(1, t, 0, e) for t, e in ((1, 9), (9, 1), (3, 3), (4, 3)))
    assert pareto([fast, good, both, worse]) == [fast, good, both]
    assert pareto([fast, BenchmarkFigure(2, 9, 0, 9)]) == [
        fast,
        BenchmarkFigure(2, 9, 0, 9),
    ]  # another size is other work


def test_the_page_holds_every_figure_that_was_measured(result):
    text = page(result)
    assert text == page(result)  # the same bytes
    assert text.count('class="plot"') == 2  # time against error, and over size
    for alternative in benchmark("propagation").alternatives:
        assert f">{alternative.name}<" in text
    assert not re.search(r"<(link|img|iframe)\b|@import|url\((?!#)", text)
    names = [each.name for each in benchmark("propagation").alternatives if not each.missing()]
    assert '<details class="rows">' not in text  # every row is shown
    rows = re.findall(r'<tr(?: class="marked")?><th scope="row">([^<]*)</th>', text)
    # All of them in the details, those that are optimal or the default in the answer besides.
    assert not Counter(2 * names) - Counter(rows)
    assert set(Counter(rows) - Counter(2 * names)) < set(names)


def test_a_peer_may_live_in_another_interpreter(tmp_path, monkeypatch):
    peer = Alternative("peer", lambda _: None, needs=("surely_not_installed",))
    assert (peer.missing(), peer.interpreter) == ("surely_not_installed not installed", sys.executable)
    other = tmp_path / "python"
    other.write_text("#!/bin/sh\n")  # it prints no name: nothing is missing there
    other.chmod(0o755)
    monkeypatch.setenv(PEERS, str(other))
    peer = replace(peer)
    assert (peer.missing(), peer.interpreter) == ("", str(other))
    monkeypatch.setenv(PEERS, str(tmp_path / "none"))
    assert "surely_not_installed not installed" in replace(peer).missing()


@pytest.mark.thorough
def test_the_command_measures_writes_and_shows(tmp_path):
    runner, file, html = CliRunner(), tmp_path / "b.h5", tmp_path / "b.html"
    arguments = ["bench", "loops", "--size", "loops=2", "-o", str(file), "--report", str(html)]
    ran = runner.invoke(cli, arguments)
    assert ran.exit_code == 0, ran.output
    assert re.search(r"exact .*›", ran.output)
    assert "●" in ran.output
    assert html.read_text(encoding="utf-8").startswith("<!doctype html>")
    stored = read_result(file)
    assert stored.kind == "bench"
    assert re.search(r"exact .*›", runner.invoke(cli, ["show", str(file)]).output)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nonsense"], "no benchmark 'nonsense'"),
        (["mode"], "did you mean 'modes'"),
        (["modes", "--size", "modes=ten"], "whole numbers"),
        (["modes", "--size", "mods=10"], "no benchmark 'mods'"),
    ],
)
def test_a_wrong_call_is_refused(arguments, said):
    with pytest.raises(DynidError, match=re.escape(said)):
        CliRunner().invoke(cli, ["bench", *arguments], catch_exceptions=False, standalone_mode=False)


def test_the_list_names_all():
    listed = CliRunner().invoke(cli, ["bench", "--list"]).output
    assert all(name in listed for name in BENCHMARKS)


def test_the_screen_says_how_time_grows(result):
    from tests.screens import lines

    said = " ".join("\n".join(lines(result)).split())
    times = result["bench/propagation/exponential-spline/time"].data
    assert f"exponential-spline {np.log2(times[1] / times[0]):.2f}" in said


def test_a_peer_that_beats_the_default_is_named():
    case = benchmark("propagation")
    figures = {
        "exponential-spline": [BenchmarkFigure(5, 2.0, 0, 1e-6)],
        "lsim": [BenchmarkFigure(5, 1.0, 0, 1e-7)],
    }
    assert beaten(case, case.default, figures) == ["at samples 5 by lsim (2.0 times faster)"]
    slower = {**figures, "lsim": [BenchmarkFigure(5, 3.0, 0, 1e-7)]}
    assert beaten(case, case.default, slower) == []
    assert "no figures" in beaten(case, case.default, {"lsim": figures["lsim"]})[0]


def test_peers_that_do_not_beat_the_default_are_named(result):
    from dynid.report.content.bench import better_peers

    assert better_peers(result, "bench/propagation") == "none of dop853, lsim, newmark, rk4"
    alone = run_benchmarks([], {})
    alone.annotate("bench/x", beaten="")
    assert better_peers(alone, "bench/x") == "none; no peer took part"


def test_what_takes_longer_than_it_may_is_seen():
    figures = {"help": [BenchmarkFigure(1, 2.8)], "import-click": [BenchmarkFigure(1, 2.0)]}
    assert limits(benchmark("startup"), figures) == ["help takes 1.40 times import-click (at most 1.3)"]


def test_the_default_is_marked(result):
    assert result["bench/propagation/exponential-spline/default"].data.all()
    assert not result["bench/propagation/lsim/default"].data.any()
    assert result.group_attrs["bench/propagation/lsim"]["peer"]


@pytest.mark.parametrize("name", [name for name in BENCHMARKS if benchmark(name).default])
def test_the_default_is_among_the_alternatives(name):
    case = benchmark(name)
    assert case.default is not None
    assert {case.default(size) for size in SMALL[name][:1]} <= {each.name for each in case.alternatives}


def test_the_roots_of_the_chain_are_those_of_its_equations():
    """The zeros lie where the pencil loses rank, the poles where the characteristic polynomial vanishes."""
    from dynid.bench.cases.chain import matrices, true_roots

    (A, _, _, _), (zeros, poles) = matrices(6), true_roots(6)
    assert len(zeros) == 6
    assert len(poles) == 12
    found = np.linalg.eigvals(A)
    assert all(np.min(abs(found - z)) < 1e-11 * abs(z) for z in poles)
    assert abs(poles.sum() - np.trace(A)) < 1e-12 * abs(np.trace(A))


def test_processor_time_is_that_of_the_work():
    from time import sleep

    assert measured("propagation", "exponential-zero", 100, "processor")["time"] > 0
    before = processor()
    sleep(0.05)
    assert processor() - before < 0.04


def test_peers_of_the_sources_take_part_where_an_interpreter_has_them(monkeypatch):
    """Alternatives with packages that no part of dynid uses are not in the package."""
    own = {name: [each.name for each in benchmark(name).alternatives] for name in BENCHMARKS}
    monkeypatch.setenv(PEERS, sys.executable)
    monkeypatch.setenv(PEER_MODULE, "benchmarks.peers")
    added = {
        name: [each.name for each in benchmark(name).alternatives[len(own[name]) :]] for name in BENCHMARKS
    }
    assert {name: names for name, names in added.items() if names} == {
        "zeros-poles": ["control-slycot", "lcapy"],
        "filters": ["filterpy", "dynamax"],
        "estimators": ["filterpy", "dynamax"],
    }


def bench_result(time, memory=1e6, error=1e-15, peer=False):
    result = Result("bench", "Speed against error")
    result.add_axis("bench/work/ours/size", [1, 10])
    for name, value in (("time", time), ("memory", memory), ("error", error)):
        result.add(f"bench/work/ours/{name}", np.array([1.0, 1.0]) * value, ("size",))
    result.annotate("bench/work/ours", peer=peer)
    result.annotate("bench", clock="wall")
    return result


@pytest.mark.parametrize(
    ("now", "earlier", "worse"),
    [
        ({"time": 1.2}, [{"time": 1.0}], None),
        ({"time": 1.3}, [{"time": 1.0}], True),
        ({"time": 0.7}, [{"time": 1.0}], False),
        ({"time": 1.3}, [{"time": 1.0}, {"time": 1.1}], None),  # what chance changes as much is no change
        ({"time": 0.7}, [{"time": 1.0}, {"time": 0.8}], None),
        ({"time": 2.0, "peer": True}, [{"time": 1.0}], None),
        ({"time": 1.0, "memory": 15e6}, [{"time": 1.0}], None),  # small
        ({"time": 1.0, "memory": 90e6}, [{"time": 1.0}], True),
        ({"time": 1.0, "error": 1e-9}, [{"time": 1.0}], True),
        ({"time": 1.0}, [{"time": 1.0, "error": 1e-9}], False),
        ({"time": 1.0}, [], None),
    ],
)
def test_changes_are_those_of_more_than_a_quarter_from_all_earlier_ones(now, earlier, worse):
    found = changes(bench_result(**now), [bench_result(**one) for one in earlier])
    assert {one.worse for one in found} == (set() if worse is None else {worse})
    assert {one.size for one in found} == (set() if worse is None else {1, 10})


def test_the_command_compares_with_a_file(tmp_path, monkeypatch):
    write_result(bench_result(1.0), tmp_path / "last.h5")
    now = {"time": 2.0, "error": 1e-15}
    monkeypatch.setattr("dynid.bench.run_benchmarks", lambda *_, **__: bench_result(**now))
    monkeypatch.setattr("dynid.cli.screen.summary", lambda *_: "")
    command = ["bench", "propagation", "--against", str(tmp_path / "last.h5")]
    done = CliRunner().invoke(cli, command, standalone_mode=False)
    assert done.return_value == 1
    assert "2 changes of more than 25 %\n    worse   work/ours at 1: time 1 s -> 2 s" in done.output
    now["time"] = 0.5
    done = CliRunner().invoke(cli, command, standalone_mode=False)
    assert done.return_value == 0
    assert "better  work/ours at 10: time 1 s -> 500 ms" in done.output
    assert changes(bench_result(2.0), [bench_result(1.0)])[0] == BenchmarkChange(
        "bench/work/ours/time", 1, 2.0, 1.0
    )


def test_times_of_another_clock_are_not_compared(tmp_path):
    write_result(bench_result(1.0), tmp_path / "last.h5")
    write_result(Result("reduction", "no benchmark"), tmp_path / "other.h5")
    for name, clock, said in (
        ("last", "processor", "Add --clock wall."),
        ("other", "wall", "not of dynid bench"),
    ):
        command = ["bench", "propagation", "--clock", clock, "--against", str(tmp_path / f"{name}.h5")]
        with pytest.raises(UsageError) as error:
            CliRunner().invoke(cli, command, catch_exceptions=False)
        assert said in str(error.value)


def test_errors_on_a_page_are_numbers_or_infinite():
    shown = sample_bench()
    shown["bench/roots/float/error"].data[:] = [np.inf, np.nan]
    table, *_ = [block for block in content(shown).sections[0].blocks if isinstance(block, TextTable)]
    assert [row[4] for row in table.rows] == ["0", "∞", "3.0e-14", "-"]
