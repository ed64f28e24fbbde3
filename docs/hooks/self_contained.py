"""A page that would load anything from the network fails the build: the site is read where there is none."""

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
    """Refuse what a page loads from elsewhere; links are for the reader to follow."""
    for found in _LOADED.finditer(output):
        raise PluginError(f"{page.file.src_uri} loads {found['url']}; put a copy into docs/assets")
    return output
