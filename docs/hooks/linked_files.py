"""Site pages for linked project files: scenes, examples, sources.

A page links to them as they lie in the project (`../configs/isolator.yaml`), so that its links hold where
the project is read as it is. The site has no such files: each becomes a page that shows it, a folder one that
shows all files in it.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import TYPE_CHECKING

from mkdocs.structure.files import File, Files

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.pages import Page

_CODE = re.compile(r"^```.*?^```$", re.DOTALL | re.MULTILINE)
_LINK = re.compile(r"(?<=\]\()(?P<target>[^)#:\s]+)(?=[)#])")
#: What the site has itself.
_OWN = {".md", ".svg", ".png", ".ipynb"}
_LANGUAGES = {
    ".yaml": "yaml",
    ".yml": "yaml",
    ".py": "python",
    ".md": "markdown",
    ".toml": "toml",
    ".cff": "yaml",
}


def _outside(markdown: str, source: str, root: Path) -> Iterator[tuple[str, str]]:
    """Yield the links of a page to files that are no pages: as written, and from the project's root."""
    for link in _LINK.finditer(_CODE.sub("", markdown)):
        name = posixpath.normpath(posixpath.join("docs", posixpath.dirname(source), link["target"]))
        shown = name.startswith("docs/") and posixpath.splitext(name)[1] in _OWN
        if not shown and not name.startswith("..") and (root / name).exists():
            yield link["target"], name


def _page(name: str, root: Path) -> str:
    path = root / name
    files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
    blocks = []
    for file in files:
        language = _LANGUAGES.get(file.suffix, "text")
        title = file.relative_to(root).as_posix()
        blocks.append(f'````{language} title="{title}"\n{file.read_text()}````\n')
    return f"---\nsearch: {{exclude: true}}\n---\n\n# {posixpath.basename(name)}\n\n" + "\n".join(blocks)


def _uri(name: str) -> str:
    return f"files/{name}.md"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for every file that is linked to."""
    root = Path(config.config_file_path).parent
    for page in list(files.documentation_pages()):
        for _, name in _outside(page.content_string, page.src_uri, root):
            if files.get_file_from_path(_uri(name)) is None:
                files.append(File.generated(config, _uri(name), content=_page(name, root)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, **_: object) -> str:
    """Redirect the links of a page to these files."""
    root, source = Path(config.config_file_path).parent, page.file.src_uri
    for target, name in set(_outside(markdown, source, root)):
        there = posixpath.relpath(_uri(name), posixpath.dirname(source) or ".")
        markdown = re.sub(rf"(?<=\]\(){re.escape(target)}(?=[)#])", there, markdown)
    return markdown
