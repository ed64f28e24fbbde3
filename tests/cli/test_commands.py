"""The commands beside `dynid run`, and the command line as a whole."""

import itertools
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest

from dynid.cli import COMMANDS, main
from dynid.scene.yaml.source import read_source
from tests.copies import told_by_a_copy
from tests.sample import sample
from tests.scene.test_scene_faults import TEN, TEN_PLACES

pytestmark = pytest.mark.thorough

CONFIGS = sorted((Path(__file__).parents[2] / "configs").glob("*.yaml"))


# --- as a whole ------------------------------------------------------------------------------------


def test_help_lists_every_command(dynid):
    code, out, err = dynid("--help")
    assert (code, err) == (0, "")
    assert all(f"  {name} " in out for name in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(dynid, command):
    code, out, _ = dynid(command, "--help")
    assert code == 0
    assert out.startswith(f"Usage: dynid {command}")


def test_the_version_is_one_line(dynid):
    code, out, _ = dynid("--version")
    assert code == 0
    assert out.startswith("dynid 0.")


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["rnu", "x.yaml"], "no command 'rnu'; did you mean 'run'?"),
        (["quantum"], "no command 'quantum'"),
        (["run"], "Missing argument 'SCENE'"),
        (["check"], "Missing argument 'SCENES...'"),
        (["run", "small.yaml", "--ste", "a=1"], "No such option"),
        (["compare", "a.h5"], "Missing argument 'SECOND'"),
        (["compare", "a.h5", "b.h5", "--rtol", "-1"], "Invalid value for '--rtol'"),
        (["schema", "bondgraph"], "no kind 'bondgraph'; did you mean 'bond-graph'?"),
        (["new", "isolater"], "no template 'isolater'"),
        (["new", "structure", "--stages", "3"], "has no stages"),
        (["--", "-x"], "No such option '-x'"),
    ],
)
@pytest.mark.usefixtures("folder")
def test_a_wrong_call_is_exit_2(dynid, args, message):
    code, out, err = dynid(*args)
    assert (code, out) == (2, "")
    assert message in err


def test_ten_mistakes_come_in_one_go_with_exit_2(dynid, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ten.yaml").write_text(TEN)
    code, out, err = dynid("run", "ten.yaml")
    assert (code, out) == (2, "")
    assert [line.split(": ")[0] for line in err.splitlines()] == [f"ten.yaml:{place}" for place in TEN_PLACES]
    assert [path.name for path in tmp_path.iterdir()] == ["ten.yaml"]


def test_a_terminal_with_few_letters_gets_the_rest(folder):
    left = subprocess.run(
        [sys.executable, "-m", "dynid", "run", "small.yaml"],
        cwd=folder, env={**os.environ, "PYTHONIOENCODING": "ascii"},
        capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert (left.returncode, left.stderr) == (0, "")
    assert "A mass on a damper" in left.stdout


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_an_output_that_cannot_be_printed_is_exit_4_with_the_file_written(folder):
    with Path("/dev/full").open("w") as full:
        left = subprocess.run(
            [sys.executable, "-m", "dynid", "run", "small.yaml"],
            cwd=folder, stdout=full, stderr=subprocess.PIPE, text=True, timeout=600, check=False,
        )  # fmt: skip
    assert left.returncode == 4
    assert left.stderr == "the output cannot be read or written: No space left on device\n"
    assert (folder / "small.h5").exists()


def test_an_interrupt_from_the_keyboard_is_exit_130(folder):
    driver = (
        "import os, signal, sys, time, dynid.scene.kinds.bond_graph as runner\n"
        "runner.run = lambda scene: (os.kill(os.getpid(), signal.SIGINT), time.sleep(30))\n"
        "from dynid.cli import main; main(['run', 'small.yaml'])\n"
    )
    left = subprocess.run(
        [sys.executable, "-c", driver], cwd=folder, capture_output=True, text=True, timeout=600, check=False
    )
    assert left.returncode == 130
    assert left.stderr.strip() == "interrupted; no file was left incomplete"
    assert [path.name for path in folder.iterdir()] == ["small.yaml"]


# --- killed at any moment --------------------------------------------------------------------------


def killed_at(place, number):
    """Run the scene with another mass in a copy of this process, which is killed at a call of `os.place`."""
    original, calls = getattr(os, place), itertools.count(1)

    def deadly(*args, **more):
        if next(calls) == number:
            os.kill(os.getpid(), signal.SIGKILL)
        return original(*args, **more)

    def work():
        setattr(os, place, deadly)
        main(["run", "small.yaml", "-q", "--set", "parameters.m=5"])

    return told_by_a_copy(work)[1]


@pytest.mark.parametrize(
    ("place", "old"),
    sample(
        itertools.product(["fdopen", "fsync", "replace"], [True, False]),
        0,
        ("fsync", True),
        ("replace", False),
    ),
)
def test_a_killed_run_leaves_the_old_result_or_none(dynid, folder, place, old):
    if old:
        assert dynid("run", "small.yaml", "-q")[0] == 0
    before = (folder / "small.h5").read_bytes() if old else b""
    assert killed_at(place, 1) == -signal.SIGKILL
    assert (folder / "small.h5").exists() == old
    if old:
        assert (folder / "small.h5").read_bytes() == before
        assert dynid("show", "small.h5")[0] == 0


def test_a_run_that_is_killed_after_the_file_has_its_name_leaves_the_new_result(dynid, folder):
    assert dynid("run", "small.yaml", "-q")[0] == 0
    assert killed_at("fsync", 2) == -signal.SIGKILL
    assert "m: 5" in dynid_scene(folder)


def dynid_scene(folder):
    from dynid.store import read_result

    return read_result(folder / "small.h5").attrs["scene"]


# --- check -----------------------------------------------------------------------------------------


def test_check_reads_many_scenes_and_counts_what_is_wrong(dynid, folder):
    (folder / "ten.yaml").write_text(TEN)
    code, out, err = dynid("check", "small.yaml", "ten.yaml", "small.yaml")
    assert code == 2
    assert out.splitlines() == ["small.yaml: valid (bond-graph: A mass on a damper)"] * 2
    assert len(err.splitlines()) == 11
    assert err.splitlines()[-1] == "10 faults"
    assert dynid("check", "small.yaml", "-q") == (0, "", "")
    assert dynid("check", "ten.yaml", "missing.yaml")[0] == 4
    assert sorted(path.name for path in folder.iterdir()) == ["small.yaml", "ten.yaml"]


def test_one_fault_is_not_counted_as_faults(dynid, folder):
    (folder / "s.yaml").write_text("dynid: 1\n")
    assert dynid("check", "s.yaml")[2].splitlines()[-1] == "1 fault"


@pytest.mark.parametrize("config", CONFIGS, ids=lambda path: path.stem)
def test_the_scenes_that_come_along_are_valid(dynid, config):
    assert dynid("check", config)[::2] == (0, "")


# --- show, compare ---------------------------------------------------------------------------------


@pytest.mark.usefixtures("folder")
def test_show_repeats_the_screen_of_the_run_and_lists_the_arrays(dynid):
    _, ran, _ = dynid("run", "small.yaml")
    code, shown, err = dynid("show", "small.h5")
    assert (code, err) == (0, "")
    assert shown.splitlines()[1:10] == ran.splitlines()[1:10]
    everything = dynid("show", "small.h5", "--all")[1]
    assert "bond_graph/frequency_response/omega" in everything
    assert "rad/s" in everything


@pytest.mark.parametrize("command", [["show", "f"], ["compare", "f", "f"]])
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "f: no such file"),
        (b"", "damaged"),
        (b"\x89HDF\r\n\x1a\n" + b"\0" * 99, "damaged"),
        (b"a: 1", "damaged"),
    ],
    ids=["missing", "empty", "cut short", "a text"],
)
def test_what_is_no_result_is_exit_4(dynid, folder, command, content, message):
    if content is not None:
        (folder / "f").write_bytes(content)
    code, out, err = dynid(*command)
    assert (code, out) == (4, "")
    assert message in err


@pytest.mark.usefixtures("folder")
def test_compare_finds_no_difference_between_two_runs_of_one_scene(dynid):
    dynid("run", "small.yaml", "-q")
    dynid("run", "small.yaml", "-q", "-o", "again.h5")
    assert dynid("compare", "small.h5", "again.h5") == (0, "no differences\n", "")


@pytest.mark.usefixtures("folder")
def test_compare_lists_differences_with_exit_1_within_the_tolerances_asked_for(dynid):
    dynid("run", "small.yaml", "-q")
    dynid("run", "small.yaml", "-q", "-o", "other.h5", "--set", "parameters.m=2.0000001")
    code, out, err = dynid("compare", "small.h5", "other.h5")
    assert (code, err) == (1, "")
    assert "bond_graph/transfer_function/m.f/F/denominator" in out
    assert dynid("compare", "small.h5", "other.h5", "-q") == (1, "", "")
    assert dynid("compare", "small.h5", "other.h5", "--rtol", "1e-6", "--atol", "1e-6")[0] == 0


# --- schema ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["bond-graph", "identification", None])
def test_the_printed_schema_accepts_the_scenes_that_come_along(dynid, kind):
    code, out, err = dynid("schema", *([kind] if kind else []))
    assert (code, err) == (0, "")
    schema = json.loads(out)
    validator_class = jsonschema.validators.validator_for(schema)
    validator_class.check_schema(schema)
    validator = validator_class(schema)
    for config in CONFIGS:
        data = read_source(config).data
        assert validator.is_valid(data) == (kind in (None, data["kind"])), config.name


_KEYWORDS = {
    *("$schema", "$defs", "$ref", "oneOf", "anyOf", "allOf", "const", "enum", "type", "title", "description"),
    *(
        "default",
        "properties",
        "patternProperties",
        "required",
        "additionalProperties",
        "propertyNames",
        "minProperties",
        "maxProperties",
    ),
    *("items", "minItems", "maxItems", "minLength", "maxLength", "minimum", "maximum"),
    *("exclusiveMinimum", "exclusiveMaximum", "discriminator", "pattern", "format"),
}


def _keywords(schema, names=False):
    """Yield the keywords of a schema and of all schemas in it; below some keys stand names, not keywords."""
    if isinstance(schema, list):
        for part in schema:
            yield from _keywords(part)
    elif isinstance(schema, dict):
        for key, part in schema.items():
            if not names:
                yield key
            if names or key not in ("const", "enum", "default", "discriminator", "required"):
                yield from _keywords(
                    part, names=not names and key in ("properties", "patternProperties", "$defs")
                )


def test_the_schema_keeps_to_draft_7_which_editors_know(dynid):
    assert set(_keywords(json.loads(dynid("schema")[1]))) <= _KEYWORDS


def test_a_new_scene_names_the_schema_that_is_written_with_it(dynid, folder):
    code, out, _ = dynid("new", "reduction")
    assert (code, len(out.splitlines())) == (0, 2)
    first = (folder / "reduction.yaml").read_text().splitlines()[0]
    schema = json.loads((folder / first.rpartition("$schema=")[2]).read_text())
    jsonschema.Draft7Validator(schema).validate(read_source(folder / "reduction.yaml").data)
    assert len(dynid("new", "bond-graph")[1].splitlines()) == 1  # the schema is there already


def test_a_new_scene_without_a_schema(dynid, folder):
    assert dynid("new", "reduction", "--no-schema")[0] == 0
    assert {path.name for path in folder.iterdir()} == {"small.yaml", "reduction.yaml"}
    assert "$schema" not in (folder / "reduction.yaml").read_text()


@pytest.mark.parametrize("options", [[], ["--stages", "1"], ["--stages", "12", "--distinct"]])
def test_a_chain_of_any_length_is_a_template(dynid, tmp_path, options):
    scene = tmp_path / "chain.yaml"
    assert dynid("new", "chain", *options, "-o", str(scene))[0] == 0
    code, out, _ = dynid("run", str(scene), "-o", str(tmp_path / "chain.h5"))
    stages = int(options[1]) if options else 10
    assert code == 0
    assert f"Chain of {stages} mass-spring-damper stages" in out
