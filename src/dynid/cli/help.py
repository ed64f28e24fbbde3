"""`dynid help`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from dynid.cli.completion import among
from dynid.errors import UsageError

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable


def _names() -> list[str]:
    from dynid.cli import COMMANDS

    return [*_topics(), *COMMANDS]


@click.command("help")
@click.argument("topic", required=False, shell_complete=among(_names))
def help_(topic: str | None) -> int:
    """Explain a TOPIC at length, or a command; without one, list the topics."""
    from dynid.cli import COMMANDS, cli

    topics = _topics()
    if topic is None:
        width = max(map(len, topics))
        listed = "\n".join(f"  {name:{width}}  {_heading(text)}" for name, text in topics.items())
        click.echo(f"dynid help TOPIC, where TOPIC is a command, or\n\n{listed}")
    elif topic in topics:
        click.echo_via_pager(topics[topic].read_text(encoding="utf-8"))
    elif topic in COMMANDS:
        cli.main([topic, "--help"], prog_name="dynid", standalone_mode=False)
    else:
        from dynid.suggestions import did_you_mean

        names = _names()
        raise UsageError(
            f"no topic '{topic}'{did_you_mean(topic, names)}", remedy=f"There are {', '.join(names)}."
        )
    return 0


def _topics() -> dict[str, Traversable]:
    """Return the texts by their topics, in alphabetical order."""
    from importlib.resources import files

    texts = [item for item in files("dynid.topics").iterdir() if item.name.endswith(".md")]
    return {text.name.removesuffix(".md"): text for text in sorted(texts, key=lambda text: text.name)}


def _heading(text: Traversable) -> str:
    with text.open(encoding="utf-8") as lines:
        return next(lines).lstrip("# ").strip()
