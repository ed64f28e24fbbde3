"""`dynid report`, `dynid plot`, `--report`: what is written where, and what is refused."""

import pytest

from dynid.store import write_blocks, write_result
from tests.report.pages import study


@pytest.fixture
def made(dynid, folder):
    assert dynid("run", "small.yaml", "-q")[0] == 0
    return folder


def test_a_page_is_named_after_its_file(dynid, made):
    code, out, err = dynid("report", "small.h5")
    assert (code, out.strip(), err) == (0, "wrote small.html", "")
    assert (made / "small.html").read_text().startswith("<!doctype html>")


def test_a_run_writes_the_page_that_its_file_gives(dynid, made):
    code, out, _ = dynid("run", "small.yaml", "--report", "run.html")
    assert code == 0
    assert "wrote small.h5, run.html" in out
    assert dynid("report", "small.h5", "-o", "again.html", "-q") == (0, "", "")
    assert (made / "again.html").read_bytes() == (made / "run.html").read_bytes()


@pytest.mark.parametrize(
    ("args", "code", "message"),
    [
        (["report", "small.h5", "-o", "small.h5"], 2, "would overwrite the result"),
        (["report", "none.h5"], 4, "none.h5: no such file"),
        (["report", "small.yaml"], 4, "small.yaml is not a result. If it is a scene, name the file"),
        (["report", "small.h5", "-o", "no/such.html"], 4, "there is no folder no"),
        (["run", "small.yaml", "--report", "small.yaml"], 2, "the page would overwrite small.yaml"),
        (["run", "small.yaml", "--report", "small.h5"], 2, "the page would overwrite small.h5"),
        (["run", "small.yaml", "--junit", "a", "--report", "a"], 2, "the page would overwrite a"),
        (["run", "small.yaml", "--report", "no/such.html"], 4, "there is no folder no"),
        (["plot", "small.h5", "-o", ".", "--figure", "bond-grap"], 2, "did you mean 'bond-graph'?"),
        (["plot", "small.h5", "-o", "small.yaml"], 4, "small.yaml cannot be made"),
        (["plot", "small.h5", "-o", ".", "--format", "gif"], 2, "'gif' is not one of"),
    ],
)
def test_what_makes_no_sense_is_refused_with_a_sentence(dynid, made, args, code, message):
    scene = (made / "small.yaml").read_bytes()
    found, _, err = dynid(*args)
    assert found == code
    assert message in err
    assert (made / "small.yaml").read_bytes() == scene


def test_figures_are_listed_and_written(dynid, made):
    code, out, _ = dynid("plot", "small.h5", "--list")
    names = [line.split()[0] for line in out.splitlines()]
    assert code == 0
    assert "bond-graph" in names
    assert dynid("plot", "small.h5", "-o", "figs")[0] == 0
    assert dynid("plot", "small.h5")[0] == 0
    assert len(list((made / "small-figures").iterdir())) == len(names)
    assert sorted(file.name for file in (made / "figs").iterdir()) == sorted(f"{name}.svg" for name in names)


def test_one_figure_may_be_chosen_and_its_format(dynid, made):
    pytest.importorskip("typst")
    code, out, _ = dynid("plot", "small.h5", "-o", "figs", "--figure", "bond-graph", "--format", "pdf")
    assert (code, out.strip()) == (0, "wrote figs/bond-graph.pdf")
    assert (made / "figs/bond-graph.pdf").read_bytes().startswith(b"%PDF")


def test_the_page_of_an_interrupted_study_shows_what_is_there(dynid, made):
    result = study(5, failed=(), pending=(3, 4))
    write_blocks(result, made / "part.h5", iter(()), complete=False)
    code, _, err = dynid("report", "part.h5")
    assert (code, err) == (0, "")
    assert "3 done · 2 pending" in (made / "part.html").read_text()


def test_the_page_of_a_study_is_read_from_its_file(dynid, made):
    write_result(study(30), made / "whole.h5")
    assert dynid("report", "whole.h5", "-q") == (0, "", "")
    assert "29 done · 1 failed" in (made / "whole.html").read_text()


@pytest.mark.thorough
def test_a_study_writes_its_page(dynid, made):
    text = "dynid: 1\nkind: study\nscene: small.yaml\nvary: {parameters.m: {values: [1, 2]}}\n"
    (made / "vary.yaml").write_text(text)
    code, _, err = dynid("study", "vary.yaml", "--executor", "serial", "-q", "--report", "vary.html")
    assert (code, err) == (0, "")
    assert "2 done" in (made / "vary.html").read_text()
    code, _, err = dynid("study", "vary.yaml", "--executor", "serial", "-q", "--report", "small.yaml")
    assert code == 2
    assert "would overwrite small.yaml" in err
