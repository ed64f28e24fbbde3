"""Site pages of notebooks: their text, code and outputs as Markdown; links to a notebook lead to its page."""

from __future__ import annotations

import json
import re
from html import escape
from typing import TYPE_CHECKING, Any

from mkdocs.structure.files import File, Files

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for every notebook."""
    for file in list(files):
        if file.src_uri.endswith(".ipynb"):
            cells = json.loads(file.content_string)["cells"]
            page = "\n\n".join(_markdown(cell) for cell in cells)
            files.append(File.generated(config, file.src_uri.removesuffix("ipynb") + "md", content=page))
    return files


def on_page_markdown(markdown: str, **_: object) -> str:
    """Redirect links to notebooks to their pages."""
    return re.sub(r"(?<=\.)ipynb(?=[)#])", "md", markdown)


def _markdown(cell: dict[str, Any]) -> str:
    source = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        return source
    shown = [f"```python\n{source}\n```", *map(_output, cell["outputs"])]
    return "\n\n".join(shown)


def _output(output: dict[str, Any]) -> str:
    data = {kind: "".join(text) for kind, text in output.get("data", {}).items()}
    if "text/html" in data:
        plain = re.sub(r"<style.*?</style>", "", data["text/html"], flags=re.DOTALL)
        flat = re.sub(r"<table[^>]*>", "<table>", re.sub(r"\n\s*", "\n", plain))
        return f'<div class="output">\n{flat}\n</div>'
    if "image/png" in data:
        source = data["image/png"].replace("\n", "")
        return f'<img src="data:image/png;base64,{source}" alt="{escape(data["text/plain"])}">'
    text = "".join(output.get("text", data.get("text/plain", "")))
    return f"```text\n{text.rstrip()}\n```"
