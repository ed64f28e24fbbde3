"""What a release says of itself agrees everywhere that it is said."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import yaml

import dynid
from dynid.cli import citation

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_the_version_is_the_same_everywhere():
    version = dynid.__version__
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    changes = re.findall(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    said = subprocess.run(
        [sys.executable, "-m", "dynid", "--version"], check=True, capture_output=True, text=True
    )
    assert cited["version"] == version
    assert changes[0] == version
    assert said.stdout == f"dynid {version}\n"
    assert f"version = {{{version}}}" in citation()


def test_no_page_installs_a_release_that_is_not_out():
    """A tag is there once its section of CHANGELOG has a date; until then pages install a commit."""
    released = set(
        re.findall(r"^## (\S+) \(\d{4}-\d{2}-\d{2}\)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    )
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "docs").rglob("*.yaml")]
    installed = {tag for page in pages for tag in re.findall(r"\.git@v(\d[\w.]*)", page.read_text("utf-8"))}
    assert installed <= released


def test_the_citation_names_licence_and_papers():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert cited["license"] == PROJECT["license"]
    assert cited["title"] == f"dynid: {PROJECT['description'][0].lower()}{PROJECT['description'][1:]}"
    for paper in cited["references"]:
        assert f"{{{paper['title']}}}" in re.sub(r"\s+", " ", citation())


def test_the_pythons_that_are_promised_are_those_of_ci():
    promised = {text.split(" :: ")[-1] for text in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", text)}
    scripts = "".join((ROOT / ".ci" / name).read_text() for name in ("run", "nightly"))
    run = re.findall(r"\.ci/environment (3\.\d+)", scripts)
    assert promised == set(run)
    assert PROJECT["requires-python"] == f">={min(run)}"  # the oldest, with the oldest dependencies
    assert f".ci/environment {min(run)} lowest-direct" in (ROOT / ".ci/run").read_text()


def test_the_conda_recipe_has_the_version_and_the_dependencies_of_the_project():
    text = (ROOT / "recipe/recipe.yaml").read_text(encoding="utf-8")
    recipe = yaml.safe_load(text)
    assert recipe["context"]["version"] == dynid.__version__
    needed = {re.sub(r"\s", "", one) for one in recipe["requirements"]["run"]}
    assert needed == {*PROJECT["dependencies"], f"python{PROJECT['requires-python']}"}
    name, function = recipe["build"]["python"]["entry_points"][0].split(" = ")
    assert PROJECT["scripts"][name] == function


def test_the_doctor_and_the_readme_list_every_extra_for_users():
    from dynid.cli.start import _EXTRAS

    users = PROJECT["optional-dependencies"].keys() - {"fuzz", "docs", "test", "dev"}
    readme = (ROOT / "README.md").read_text("utf-8")
    listed = readme.partition("Extras, as in")[2].partition("; `dynid doctor`")[0]
    assert _EXTRAS.keys() == users
    assert set(re.findall(r"`(\w+)`", listed)) == users


def test_the_container_has_extras_that_exist_and_no_build_of_this_machine():
    container = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    for extras in re.findall(r"\[([a-z,]+)\]'", container):
        assert set(extras.split(",")) <= PROJECT["optional-dependencies"].keys()
    assert "src/dynid/native/library*" in (ROOT / ".dockerignore").read_text(encoding="utf-8")
