"""`dynid help` and the topics: every scene in a topic runs, every topic and command exists."""

import re
from importlib.resources import files

import pytest
from click.shell_completion import ShellComplete

from dynid.cli import COMMANDS, GROUPS, cli

TOPICS = {
    item.name.removesuffix(".md"): item.read_text()
    for item in files("dynid.topics").iterdir()
    if item.name.endswith(".md")
}
SCENES = {
    topic: re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    for topic, text in TOPICS.items()
    if "```yaml" in text
}


@pytest.mark.parametrize("topic", sorted(SCENES))
def test_the_scenes_of_a_topic_run(folder, dynid, topic):
    """Where there are several, the first line of each is a comment with the name of its file."""
    for text in SCENES[topic]:
        named = re.match(r"# (\S+\.yaml)\n", text)
        name = named[1] if named else f"{topic}.yaml"
        (folder / name).write_text(text)
        command = ["study", "--executor", "serial", "-q"] if "\nkind: study\n" in text else ["run"]
        code, _, err = dynid(*command, name)
        assert (code, err) == (0, "")


@pytest.mark.parametrize("topic", ["python", "results"])
def test_the_python_of_a_topic_runs(folder, dynid, topic, request):
    isolator = (request.config.rootpath / "configs" / "isolator.yaml").read_text()
    (folder / "isolator.yaml").write_text(isolator)
    assert dynid("run", "isolator.yaml", "-q")[0] == 0
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", TOPICS[topic], re.DOTALL):
        exec(block, names)
    assert names["result"].value("bond_graph/properties/m_s.f/v_in/dc_gain") == 1


@pytest.mark.parametrize("topic", sorted(TOPICS))
def test_a_topic_is_printed_and_fits_a_terminal(dynid, topic):
    code, out, _ = dynid("help", topic)
    assert (code, out.rstrip()) == (0, TOPICS[topic].rstrip())
    assert all(len(line) <= 120 for line in out.splitlines())


def test_topics_are_listed_with_what_they_are_about(dynid):
    code, out, _ = dynid("help")
    assert code == 0
    assert all(re.search(rf"^  {topic} +\w", out, re.MULTILINE) for topic in TOPICS)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_is_explained_by_its_own_help(dynid, command):
    assert dynid("help", command) == dynid(command, "--help")


def test_every_command_stands_in_one_group_of_the_help(dynid):
    listed = [name for names in GROUPS.values() for name in names]
    assert sorted(listed) == sorted(COMMANDS)
    _, out, _ = dynid("--help")
    found = re.findall(r"^  ([a-z][a-z-]*)  ", out.partition("Run:")[2], re.MULTILINE)
    assert found == listed


@pytest.mark.parametrize("command", COMMANDS)
def test_the_examples_in_a_commands_help_are_its_own_words(dynid, command):
    """Options that an example names are options of the command."""
    _, out, _ = dynid(command, "--help")
    for example in re.findall(r"^    dynid (.*)$", out, re.MULTILINE):
        name, *words = example.split()
        assert name == command
        for option in (word for word in words if word.startswith("-")):
            assert re.search(rf"^  (-\w, )?{option}\b", out.partition("Options:")[2], re.MULTILINE)


@pytest.mark.parametrize(("section", "topic"), [("control", "graphs"), ("vary", "studies")])
def test_a_section_of_scenes_is_explained_by_its_topic(dynid, section, topic):
    code, out, _ = dynid("help", section)
    assert (code, out.rstrip()) == (0, TOPICS[topic].rstrip())


def test_an_unknown_topic_is_refused_with_the_nearest(dynid):
    code, _, err = dynid("help", "graph")
    assert code == 2
    assert "no topic 'graph'; did you mean 'graphs'?" in err


def test_topics_name_only_topics_and_commands_that_are_there():
    for text in TOPICS.values():
        for command, word in re.findall(r"`dynid ([a-z-]+)(?: ([a-z]+))?", text):
            assert command in COMMANDS
            assert command != "help" or word in TOPICS


def test_the_citation_is_one_entry_for_the_software_and_one_a_paper(dynid):
    code, out, _ = dynid("--cite")
    assert code == 0
    assert re.findall(r"^@(\w+)", out, re.MULTILINE) == ["software", "article", "article"]
    assert out.count("{") == out.count("}")


@pytest.mark.parametrize(
    ("typed", "begun", "completed"),
    [
        ([], "ru", ["run"]),
        (["help"], "gr", ["graphs"]),
        (["help"], "pl", ["plan", "plot"]),
        (["new"], "bo", ["bond-graph"]),
        (["new"], "c", ["chain"]),
        (["schema"], "ide", ["identification"]),
        (["bench"], "zeros", ["zeros-poles"]),
    ],
)
def test_the_shell_completes(typed, begun, completed):
    offered = ShellComplete(cli, {}, "dynid", "_DYNID_COMPLETE").get_completions(typed, begun)
    assert [item.value for item in offered] == completed


def test_a_paragraph_of_a_topic_is_found_by_its_name(dynid):
    code, out, _ = dynid("help", "modes")
    assert code == 0
    assert "analysis: {modes: {count: 10}}" in out
    assert dynid("help", "modez")[0] == 2
