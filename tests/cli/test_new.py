"""Every template is a scene that runs as it is written, in an empty folder."""

from importlib.resources import files

import pytest

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
