"""Pages of the commands' `--help` texts and of the topics of `dynid help`."""

from __future__ import annotations

import re
from importlib import resources
from typing import TYPE_CHECKING

import click
from mkdocs.structure.files import File, Files

from dynid.cli import GROUPS, cli

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig

_MARK = "<!-- commands -->"
_WIDTH = 100
#: A title may say at its end what the topic is about: `# Signals: what excites`.
_TITLE = re.compile(r"^# (?P<title>.*)$", re.MULTILINE)


def _commands() -> str:
    parts = []
    whole = click.Context(cli, info_name="dynid")
    for title, names in GROUPS.items():
        parts.append(f"## {title}\n")
        for name in names:
            command = cli.get_command(whole, name)
            assert command is not None
            context = click.Context(
                command, info_name=name, parent=whole, terminal_width=_WIDTH, max_content_width=_WIDTH
            )
            parts.append(f"### dynid {name}\n\n```text\n{command.get_help(context)}\n```\n")
    return "\n".join(parts)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for every topic of `dynid help`."""
    for topic in resources.files("dynid.topics").iterdir():
        if topic.name.endswith(".md"):
            text = topic.read_text(encoding="utf-8")
            files.append(File.generated(config, f"reference/topics/{topic.name}", content=text))
    return files


def on_page_markdown(markdown: str, **_: object) -> str:
    """Insert the commands into the page."""
    return markdown.replace(_MARK, _commands()) if _MARK in markdown else markdown
