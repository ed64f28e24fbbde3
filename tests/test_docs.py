"""The documentation and the README: blocks run, or are scenes or no code; outputs are those printed."""

import importlib.util
import re
import shlex
from pathlib import Path

import click
import numpy as np
import pytest

import dynid
from dynid.cli import COMMANDS, cli
from dynid.scene.load import load_scene
from dynid.store import write_result

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
README = (ROOT / "README.md").read_text()
TOPICS = DOCS / "reference" / "topics"  # copies of src/dynid/topics
PAGES = {
    page.relative_to(DOCS).as_posix(): page.read_text()
    for page in sorted(DOCS.rglob("*.md"))
    if page.parent != TOPICS
}
_spec = importlib.util.spec_from_file_location("replay", DOCS / "replay.py")
replay = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(replay)

#: Pages of which tests/cli/test_docs_commands.py runs the code, in a copy of the examples' project.
PROJECT = {"ci.md", "studies.md"}
#: Pages that are replayed by default, of half a second each; `.ci/docs` replays all.
QUICK = {"recipes/units.md"}
QUICK |= {f"theory/{name}.md" for name in ("numerics", "reductions", "synthesis")}
#: What is no code: outputs, drawings, formulas.
SHOWN = {"text", "mermaid", "math"}
_FENCE = re.compile(r"^ *(?:```+|~~~+).*$", re.MULTILINE)


def blocks(text):
    """Return the language, title and code of every fenced block."""
    return [(block["kind"], block["title"], block["code"]) for block in replay.BLOCK.finditer(text)]


def is_replayed(name):
    return name not in PROJECT and any(kind in ("console", "python") for kind, _, _ in blocks(PAGES[name]))


REPLAYED = [
    pytest.param(name, marks=[] if name in QUICK else [pytest.mark.slow], id=name.removesuffix(".md"))
    for name in PAGES
    if is_replayed(name)
]


@pytest.mark.thorough
@pytest.mark.parametrize("name", REPLAYED)
def test_a_page_says_what_is_printed(name, tmp_path, warm):
    for extra in ("pyuff", "nptdms"):
        if extra in PAGES[name]:
            pytest.importorskip(extra, reason=f"{extra} comes with an extra")
    played = replay.Replay(PAGES[name], tmp_path, warm.clients)
    played.run()
    for command, printed, said in played.outputs:
        assert replay.matches(printed, said), f"$ {command}\n{said}"


@pytest.mark.parametrize("name", [*PAGES, "README.md"])
def test_every_block_runs_or_is_no_code(name, tmp_path):
    text = PAGES.get(name, README)
    found = blocks(text)
    assert len(_FENCE.findall(text)) == 2 * len(found), "a fenced block without a language, or indented"
    for kind, title, code in found:
        if title:
            assert is_replayed(name), f"{title} is a file, but the page runs nothing"
            named = text.replace(f'title="{title}"', "")
            assert title in named, f"nothing on the page uses {title}"
        elif kind == "yaml":
            assert name == "ci.md" or is_scene(code, tmp_path)
        elif kind == "sh":
            check_commands(code)
        else:
            assert kind in SHOWN or name in PROJECT or name == "README.md" or is_replayed(name), kind


def is_scene(code, folder):
    """Check a scene that stands alone."""
    (folder / "scene.yaml").write_text(code)
    return load_scene(folder / "scene.yaml").kind


def check_commands(code):
    """Check that commands, and the options that they are given, exist."""
    for line in code.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if words[:1] == ["dynid"]:
            assert words[1] in COMMANDS, line
            command = cli.get_command(None, words[1])
            context = click.Context(command, info_name=words[1])
            command.make_parser(context).parse_args(words[2:])  # raises what click says of an unknown option


@pytest.mark.parametrize(
    "line", ["dynid rum x.yaml", "dynid run x.yaml --sett a=1", "dynid study x --shards 1/2"]
)
def test_a_slip_in_a_command_is_seen(line):
    with pytest.raises((AssertionError, click.UsageError)):
        check_commands(line)


@pytest.mark.parametrize(
    ("printed", "said", "matching"),
    [
        ("a\nb\n", "a\nb\n", True),
        ("a\nb\n", "a\nc\n", False),
        ("a\n…\nd\n", "a\nb\nc\nd\n", True),
        ("a\n…\nd\n", "a\nd\n", True),
        ("a\n…\nd\n", "a\nb\n", False),
        ("…\nd\n  …\n", "a\nb\nd\ne\n\nf\n", True),
        ("a\n  …\n", "b\nc\n", False),
        ("x = … m\n", "x = 3.2 m\n", True),
        ("Car   exact engine · 0.4 s\n", "Car  exact engine · 13 ms\n", True),
        ("Car   exact engine · 0.4 s\n", "Car  exact engine · 1.2e+02 s\n", True),
        ("", "unexpected\n", False),
    ],
)
def test_outputs_match_but_for_times_and_dots(printed, said, matching):
    assert replay.matches(printed, said) is matching


def test_a_block_with_a_title_is_a_file(tmp_path):
    page = '```sh title="greet.sh"\necho hello\n```\n\n```console\n$ sh greet.sh\nhello\n```\n'
    played = replay.Replay(page, tmp_path)
    assert played.run() == page
    assert played.outputs == [("sh greet.sh", "hello\n", "hello\n")]


# --- the README ------------------------------------------------------------------------------------


def test_the_python_of_the_readme_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    write_result(dynid.run("configs/isolator.yaml"), "isolator.h5")
    names = {}
    for block in re.findall(r"```python\n(.*?)```", README, re.DOTALL):
        exec(block, names)
    assert np.allclose(names["zeros"], [-70.71067811865476j, 70.71067811865476j], rtol=1e-12)


@pytest.mark.thorough
def test_the_readme_says_what_is_printed(tmp_path, warm):
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    session, shown = (
        replay.Session(tmp_path, warm.clients),
        re.findall(r"```text\n(\$ .*?)```", README, re.DOTALL),
    )
    assert sum(code.count("$ dynid run") for code in shown) == 2
    for code in shown:
        for command, printed in replay.commands(code):
            said = session.shell(command)
            assert replay.matches(printed, said), f"$ {command}\n{said}"


@pytest.mark.thorough
def test_the_commands_of_the_readme_run_as_printed_in_a_new_folder(tmp_path, warm):
    block = re.search(r"^## Your own system\n\n```sh\n(.*?)```", README, re.DOTALL | re.MULTILINE)
    session = replay.Session(tmp_path, warm.clients)
    for line in block[1].splitlines():
        if line.startswith(("dynid demo", "dynid new study")):
            continue  # tests/cli/test_first_minutes.py runs the tour, tests/study/test_run.py the study
        code = session.shell(f"{line}\necho left $?").split()[-1]
        assert code == ("1" if line.startswith("dynid compare") else "0"), line


def test_files_of_the_readme_exist():
    for target in re.findall(r"\]\(([^)#:]+)\)", README):
        assert (ROOT / target).exists(), target
    for scene in re.findall(r"^\| (`.*?`) \|", (ROOT / "docs/scenes.md").read_text(), re.MULTILINE):
        for name in re.findall(r"`([^` …]+)`", scene):
            assert (ROOT / "configs" / name).exists(), name


def test_the_page_of_findings_has_a_line_for_each_script():
    listed = re.findall(r"^\| `(\w+\.sh)` \| (.*) \|$", PAGES["findings.md"], re.MULTILINE)
    scripts = {path.name: path.read_text() for path in (ROOT / "findings").glob("*.sh")}
    assert sorted(name for name, _ in listed) == sorted(scripts)
    for name, words in listed:
        versions = re.findall(r"\d+\.\d+\.\d+", words)
        assert versions
        assert all(version in scripts[name] for version in versions), name
