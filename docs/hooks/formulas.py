"""Conversion of formulas to MathML, which browsers render without scripts or network."""

from __future__ import annotations

import html
import re
from typing import TYPE_CHECKING

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError

if TYPE_CHECKING:
    from mkdocs.structure.pages import Page

#: What the extension `arithmatex` leaves of `$…$` and `$$…$$`.
_FORMULA = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">\\[(\[](?P<tex>.*?)\\[)\]]</(?P=tag)>', re.DOTALL
)


def on_page_content(content: str, page: Page, **_: object) -> str:
    """Turn the formulas of a page into MathML."""

    def mathml(formula: re.Match[str]) -> str:
        tex, block = html.unescape(formula["tex"]), formula["tag"] == "div"
        try:
            shown = convert(tex, display="block" if block else "inline")
        except Exception as error:  # of a library that has no class of its own for what it cannot read
            raise PluginError(f"{page.file.src_uri}: no MathML of {tex!r}: {error!r}") from error
        return f'<div class="formula">{shown}</div>' if block else shown

    return _FORMULA.sub(mathml, content)
