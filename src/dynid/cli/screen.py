"""The screen of a result: its content as text, the answer first, then where the rest is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from dynid.cli.text import aligned, columns, folded, wrapped
from dynid.number_format import counted, unbroken
from dynid.report.content import array_rows, content
from dynid.report.content.blocks import (
    Block,
    DefinitionList,
    Formula,
    Listing,
    NumberedList,
    ReportSection,
    Statement,
    TextTable,
)

if TYPE_CHECKING:
    from dynid.result import Result

#: Longest formula in a list of definitions, characters.
_MAX_SCREEN_FORMULA = 160
#: Width of short terms, and their longest length, characters.
_TERM, _SHORT = 8, 6
#: Width of texts, characters.
_TEXT_WIDTH = 110


def summary(result: Result, note: str, *, trace: bool = False) -> str:
    """Return a result as a screen of text; with `trace` also the derivations.

    The note ends the headline: the duration of the run, or the time of creation.
    """
    answer = content(result)
    lines = [*_headline(result.title, answer.method, note), ""]
    if not answer.sections:  # of a kind that this version does not know
        return "\n".join([*lines, contents(result)])
    left_out = "brief" if trace else "trace"
    lines += section_lines(section for section in answer.sections if section.detail != left_out)
    if not trace and any(
        section.title != "Omitted" and section.detail == "trace" for section in answer.sections
    ):
        lines += ["", "  derivation: -v, or dynid show --trace"]
    return "\n".join(piece for line in lines for piece in folded(line))


def _headline(title: str, method: str, note: str) -> list[str]:
    """Return title, method and note in one line, or in two on a narrow terminal."""
    right = " · ".join(text for text in (method, note) if text)
    if len(title) + 2 + len(right) > columns():
        return [title, *wrapped(right, _TEXT_WIDTH, initial_indent="  ", subsequent_indent="    ")]
    return [f"{title}{' ' * max(2, min(100, columns()) - len(title) - len(right))}{right}"]


def contents(result: Result) -> str:
    """Return the arrays of a result with their axes, types and units, one per line."""
    width = max((len(path) for path in result), default=0)
    lines = (
        f"  {path:<{width}}  {kind}  {axes}  {units}".rstrip()
        for path, kind, axes, units in array_rows(result)
    )
    return "\n".join(piece for line in lines for piece in folded(line))


def section_lines(sections: Iterable[ReportSection]) -> list[str]:
    """Return the sections that screens show as lines, an empty line between them."""
    lines: list[str] = []
    for section in sections:
        blocks = [block for block in section.blocks if block.reader != "page"]
        if section.screen is not None and blocks:
            lines += ["", *_section_lines(section.screen, blocks)]
    return lines[1:]


def _section_lines(heading: str, blocks: Sequence[Block]) -> Iterator[str]:
    """Yield a heading, with the caption of a table that follows it, and the nodes below."""
    indent = "    " if heading else "  "
    caption = blocks[0].caption if isinstance(blocks[0], TextTable) else ""
    if heading or caption:
        text = f"{heading}: {caption}" if heading and caption else heading or caption
        yield from wrapped(text, _TEXT_WIDTH, initial_indent="  ", subsequent_indent="    ")
    for k, block in enumerate(blocks):
        if isinstance(block, TextTable) and k and block.caption:
            yield from _paragraph(block.caption, indent)
        yield from _block_lines(block, indent)


def _block_lines(block: Block, indent: str) -> Iterator[str]:
    match block:
        case Statement():
            yield from _paragraph(block.whole, indent)
        case TextTable():
            table = block.filled()
            rows = [row[: block.brief_columns] for row in (table.columns, *table.rows[: block.brief])]
            left = [k for k, numeric in enumerate(table.numeric()) if not numeric]
            yield from aligned(rows if any(rows[0]) else rows[1:], left=left)
        case DefinitionList():
            for term, lines in block.items[: block.brief]:
                yield from _definition_lines(term, lines, indent)
        case NumberedList():
            for number, item in enumerate(block.items[: block.brief], 1):
                yield from _hanging(f"{indent}{number:>2}. ", item, len(indent) + 6)
    if isinstance(block, Listing) and (more := block.count - block.brief) > 0:
        start = "    " if isinstance(block, TextTable) else indent
        yield f"{start}… {counted(more, f'more {block.noun}' if block.brief else block.noun)} in the file"


def _paragraph(text: str, indent: str) -> list[str]:
    return wrapped(text, _TEXT_WIDTH, initial_indent=indent, subsequent_indent=f"{indent}  ")


def _definition_lines(term: str, lines: Sequence[str], indent: str) -> Iterator[str]:
    """Yield a term with its lines, which are aligned behind short terms."""
    hanging = len(indent) + _TERM
    head = f"{indent}{term:<{_TERM}}" if len(term) <= _SHORT else f"{indent}{term}: "
    short = [line for line in lines if not (isinstance(line, Formula) and len(line) > _MAX_SCREEN_FORMULA)]
    for line in short or lines[:1]:
        text = line.shortened(_MAX_SCREEN_FORMULA) if isinstance(line, Formula) else line
        yield from _hanging(head, text, hanging)
        head = " " * hanging


def _hanging(head: str, text: str, indent: int) -> Iterator[str]:
    """Yield a text behind its heading, wrapped between roots and equations with a hanging indent."""
    options: dict[str, Any] = {"break_long_words": False, "break_on_hyphens": False}
    lines = wrapped(head + unbroken(text), _TEXT_WIDTH, subsequent_indent=" " * indent, **options)
    yield from (line.replace("\N{NO-BREAK SPACE}", " ") for line in lines)
