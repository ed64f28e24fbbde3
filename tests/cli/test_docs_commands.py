"""Commands in the documentation on studies and CI run as written."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from dynid.study.executors import SerialExecutor

pytestmark = pytest.mark.thorough

DOCS = Path(__file__).parents[2] / "docs"
EXAMPLES = DOCS / "examples"
BLOCK = re.compile(r"(?:<!-- test: (?P<mark>\w+) -->\n)?```(?P<language>\w+)\n(?P<code>.*?)```", re.DOTALL)


@pytest.fixture
def project(tmp_path):
    """A copy of the examples' project, and a shell in it that finds our commands."""
    shutil.copytree(EXAMPLES / "project", tmp_path, dirs_exist_ok=True)
    commands = tmp_path / ".bin"
    commands.mkdir()
    for name, module in {"dynid": "dynid", "dask": "dask", "python": ""}.items():
        call = f"{sys.executable} {f'-m {module} ' if module else ''}" + '"$@"'
        (commands / name).write_text(f"#!/bin/sh\nexec {call}\n")
    (commands / "pip").write_text("#!/bin/sh\n")  # what it would install is what is tested
    for command in commands.iterdir():
        command.chmod(0o755)

    def shell(script, timeout=300):
        environment = os.environ | {
            "PATH": f"{commands}:{os.environ['PATH']}",
            "OMP_NUM_THREADS": "1",
            "DYNID": "file:///clone",
        }
        return subprocess.run(
            ["bash", "-euo", "pipefail", "-c", script],
            cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=timeout, check=False,
        )  # fmt: skip

    shell.folder = tmp_path
    return shell


def blocks(page, language, mark=None):
    """Return the code of a page in a language, block by block."""
    found = [match for match in BLOCK.finditer((DOCS / page).read_text()) if match["language"] == language]
    return [match["code"] for match in found if match["mark"] == mark]


def github():
    """Return the commands of the workflow, step by step."""
    steps = yaml.safe_load((EXAMPLES / "github-actions.yaml").read_text())["jobs"]["dynamics"]["steps"]
    return "\n".join(step["run"] for step in steps if "run" in step)


def gitlab():
    job = yaml.safe_load((EXAMPLES / "gitlab-ci.yaml").read_text())["dynamics"]
    return "\n".join([*job["before_script"], *job["script"]])


def test_the_page_shows_the_examples_as_they_are():
    shown = blocks("ci.md", "yaml")
    assert shown == [(EXAMPLES / name).read_text() for name in ("github-actions.yaml", "gitlab-ci.yaml")]


def test_both_examples_do_the_same():
    def words(script):
        return " ".join(script.replace("\\\n", " ").split())

    assert words(github()) == words(gitlab())


@pytest.fixture
def at_once(tmp_path, monkeypatch, dynid):
    """The commands of a script in this process, one sample after the other; in a copy of the project."""
    shutil.copytree(EXAMPLES / "project", tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("dynid.study.executors.make_executor", lambda *_: SerialExecutor())

    def run(script):
        said = []
        for line in script.replace("\\\n", " ").splitlines():
            if line.startswith("mkdir"):
                Path(line.split()[-1]).mkdir()
            if not line.startswith("dynid"):
                continue
            args = [sorted(Path().glob(arg)) if "*" in arg else [arg] for arg in shlex.split(line)[1:]]
            code, out, err = dynid(*(name for names in args for name in names))
            assert code == 0, f"{line}: {err}"
            said.append(out)
        return "".join(said)

    return run


def test_the_commands_of_the_pipeline_pass(at_once):
    Path("reference").mkdir()
    at_once("dynid study studies/tolerances.yaml -q -o reference/tolerances.h5")
    assert "no differences" in at_once(github())
    names = {"isolator.h5", "isolator.xml", "tolerances.h5", "tolerances.xml", "tolerances.csv"}
    assert names <= {path.name for path in Path("results").iterdir()}


@pytest.mark.slow  # `.ci/docs` runs it
def test_the_commands_and_the_code_of_the_page_on_studies_run(at_once, capsys):
    said = at_once("\n".join(blocks("studies.md", "sh")))
    assert said.count("no differences") == 1
    assert {"worst.h5", "table.csv", "table.parquet"} <= {path.name for path in Path.cwd().iterdir()}
    for code in blocks("studies.md", "python"):
        exec(compile(code, "studies.md", "exec"), {})
    assert "a linear model explains" in capsys.readouterr().out


@pytest.mark.slow
def test_the_pipeline_runs_as_it_is_written_and_sees_a_difference(project):
    reference = "mkdir reference && dynid study studies/tolerances.yaml -q -o reference/tolerances.h5"
    assert project(reference).returncode == 0
    left = project(github())
    assert (left.returncode, left.stderr.count("expectation failed")) == (0, 0), left.stderr
    written = {path.name for path in (project.folder / "results").iterdir()}
    names = {"isolator.h5", "isolator.xml", "tolerances.h5", "tolerances.xml", "tolerances.csv"}
    assert names <= written
    assert "no differences" in left.stdout
    # a damper of other tolerances is a difference from the reference
    scene = project.folder / "studies/tolerances.yaml"
    scene.write_text(scene.read_text().replace("high: 60", "high: 61"))
    left = project(
        "dynid study studies/tolerances.yaml -q --force -o results/tolerances.h5; "
        + github().splitlines()[-2]
    )
    assert left.returncode == 1
    assert "study/samples/parameters.b" in left.stdout


@pytest.mark.slow
def test_a_shell_runs_the_page_on_studies(project):
    left = project("\n".join(blocks("studies.md", "sh")))
    assert left.returncode == 0, left.stderr
    assert left.stdout.count("no differences") == 1
    assert {"worst.h5", "table.csv", "table.parquet"} <= {path.name for path in project.folder.iterdir()}
    for number, code in enumerate(blocks("studies.md", "python")):
        (project.folder / f"{number}.py").write_text(code)
        left = project(f"python {number}.py")
        assert left.returncode == 0, left.stderr
    assert "a linear model explains" in left.stdout


@pytest.mark.slow
def test_the_commands_with_a_scheduler_run(project):
    whole = "dynid study studies/tolerances.yaml -q -o whole.h5\n"
    left = project(whole + blocks("studies.md", "sh", "dask")[0], timeout=300)
    assert left.returncode == 0, left.stderr
    assert "no differences" in left.stdout


def test_links_between_the_pages_hold():
    for page in ("ci.md", "studies.md"):
        for target in re.findall(r"\]\(([^)#:]+)\)", (DOCS / page).read_text()):
            assert (DOCS / target).exists(), f"{page}: {target}"
