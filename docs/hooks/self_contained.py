"""Check that pages load nothing from the network, since the site must work offline."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from mkdocs.exceptions import PluginError

if TYPE_CHECKING:
    from mkdocs.structure.pages import Page

_LOADED = re.compile(
    r"""<(?:script|img|iframe|source|link)\b[^>]*?\b(?:src|href)=["']?(?P<url>(?:https?:)?//[^"'\s>]+)"""
)


def on_post_page(output: str, page: Page, **_: object) -> str:
    """Raise an error if a page loads an external resource; external links are allowed."""
    for found in _LOADED.finditer(output):
        raise PluginError(f"{page.file.src_uri} loads {found['url']}; put a copy into docs/assets")
    return output
