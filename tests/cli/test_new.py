"""Every template is a scene that runs as it is written, in an empty folder."""

import re
from importlib.resources import files

import pytest

from dynid.files.formats import endings_of
from dynid.scene.netlists import read_netlist
from tests.scene.test_netlists import MODULAR

TEMPLATES = sorted(
    item.name.removesuffix(".yaml")
    for item in files("dynid.templates").iterdir()
    if item.name.endswith(".yaml")
)
READ = {"record": "record.csv", "frf": "frf.csv", "study": "bond-graph.yaml"}


def test_every_template_is_listed_in_the_help(dynid):
    _, out, _ = dynid("new", "--help")
    assert all(f"  {name} " in out for name in [*TEMPLATES, "chain"])


@pytest.mark.parametrize("name", sorted(READ))
def test_what_a_template_reads_is_written_with_it_and_never_replaced(dynid, folder, name):
    assert dynid("new", name, "--no-schema")[0] == 0
    code, out, err = dynid("check", f"{name}.yaml")
    assert (code, err) == (0, "")
    (folder / READ[name]).write_text("mine")
    code, out, _ = dynid("new", name, "--no-schema", "--force")
    assert code == 0
    assert f"kept {READ[name]}" in out
    assert (folder / READ[name]).read_text() == "mine"


@pytest.mark.parametrize("name", [name for name in TEMPLATES if name != "study"])
def test_a_template_says_what_else_may_stand_there(name):
    text = files("dynid.templates").joinpath(f"{name}.yaml").read_text()
    assert sum("#" in line for line in text.splitlines()) > 10
    assert "dynid run THIS.yaml" in text


def test_a_study_is_planned_as_it_is_written(dynid, folder):
    assert dynid("new", "study", "--no-schema")[0] == 0
    code, out, err = dynid("study", "study.yaml", "--dry-run")
    assert (code, err) == (0, "")
    assert "50 samples of bond-graph.yaml" in out
    assert (folder / "bond-graph.yaml").exists()


@pytest.mark.usefixtures("folder")
def test_a_template_goes_into_a_folder_that_is_there(dynid):
    code, _, err = dynid("new", "chain", "-o", "nowhere/chain.yaml")
    assert code == 4
    assert err == "nowhere/chain.yaml cannot be written: there is no folder nowhere. Make it first.\n"


def test_a_scene_that_is_there_is_kept_unless_force_is_used(dynid, folder):
    (folder / "mine.yaml").write_text("mine")
    code, out, err = dynid("new", "chain", "-o", "mine.yaml")
    assert (code, out) == (4, "")
    assert "mine.yaml exists already. Name another file with -o, or replace it with --force." in err
    assert (folder / "mine.yaml").read_text() == "mine"
    assert dynid("new", "chain", "-o", "mine.yaml", "--force", "--stages", "3", "--distinct")[0] == 0
    assert dynid("check", "mine.yaml")[0] == 0


def test_a_graph_out_of_a_netlist_is_the_bond_graphs_alone(dynid, folder):
    code, _, err = dynid("new", "structure", "--from", "graph.bg")
    assert code == 2
    assert "a template 'structure' has no graph. Use `dynid new bond-graph --from FILE`." in err
    assert list(folder.glob("structure*")) == []
    code, _, err = dynid("new", "bond-graph", "--from", "graph.bg")
    assert code == 4
    assert "graph.bg" in err
    assert list(folder.glob("bond-graph*")) == []
    (folder / "graph.bg").write_text(MODULAR)
    assert dynid("new", "bond-graph", "--from", "graph.bg", "--no-schema")[0] == 0
    assert (folder / "bond-graph.yaml").read_text() == read_netlist("graph.bg")


@pytest.mark.parametrize("name", TEMPLATES)
def test_files_and_keys_in_comments_of_a_template_are_read(name, dynid, folder):
    """Endings beside a key are read there; a line that is commented out holds keys of its place."""
    assert dynid("new", name, "--no-schema")[0] == 0
    lines = (folder / f"{name}.yaml").read_text().splitlines()
    for number, line in enumerate(lines):
        content = ("matrices", "matrix") if "matrices" in line else ("columns", "responses", "modes")
        for ending in re.findall(r"(?<=[ (])\.\w+(?=[ ,)]|$)", line.partition("#")[2]):
            if not re.search("file|matrices", line, re.IGNORECASE):
                continue
            assert ending in endings_of(*content), line
        hidden = re.match(r"( *)# (?=\w+: )(.*)", line)
        if hidden is None or line.startswith("# ") or hidden[2].startswith(("or ", "also: ")):
            continue
        text = [*lines[:number], hidden[1] + hidden[2], *lines[number + 1 :]]
        for below in range(number + 1, len(lines)):
            item = re.match(r"( *)# ( +- .*)", lines[below])
            if item is None:
                break
            text[below] = item[1] + item[2]
        (folder / "a.yaml").write_text("\n".join(text))
        err = dynid("check", "a.yaml")[2]
        assert "is not a key" not in err, f"{line}\n{err}"
