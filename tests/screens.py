"""The screen of a result, line by line, without its headline."""

from dataclasses import replace

from dynid.cli.screen import section_lines
from dynid.report.content import content
from dynid.report.content.blocks import TextTable


def lines(result, rows=None):
    """Return the lines without the derivations; `rows`: most rows of tables."""
    sections = [section for section in content(result).sections if section.detail != "trace"]
    if rows is not None:
        sections = [replace(one, blocks=tuple(_cut(block, rows) for block in one.blocks)) for one in sections]
    return section_lines(sections)


def _cut(block, rows):
    return replace(block, brief=rows) if isinstance(block, TextTable) else block
