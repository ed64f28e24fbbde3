"""What explains the suite is true: every scene in a topic runs, every topic and command is found."""

import re
from importlib.resources import files

import pytest

from dynid.cli import COMMANDS

TOPICS = {
    item.name.removesuffix(".md"): item.read_text()
    for item in files("dynid.topics").iterdir()
    if item.name.endswith(".md")
}
SCENES = [
    (name, text)
    for name, topic in sorted(TOPICS.items())
    for text in re.findall(r"```yaml\n(.*?)```", topic, re.DOTALL)
]


@pytest.mark.parametrize(("topic", "text"), SCENES, ids=[name for name, _ in SCENES])
def test_a_scene_in_a_topic_runs(folder, dynid, topic, text):
    (folder / f"{topic}.yaml").write_text(text)
    code, _, err = dynid("run", f"{topic}.yaml")
    assert (code, err) == (0, "")


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
