"""Run the notebooks of the tutorials and keep their outputs: `python docs/notebooks.py`; not with `--check`.

Needs nbclient and ipykernel, which are in the extra `docs`.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

#: What an output holds of a run, not of the notebook.
_TRANSIENT = ("execution", "language_info")


def main(words: list[str]) -> None:
    """Run every notebook in an empty folder; an error in a cell ends the program."""
    for path in sorted((Path(__file__).parent / "tutorials").glob("*.ipynb")):
        notebook = nbformat.read(path, as_version=4)
        with tempfile.TemporaryDirectory() as folder:
            place = {"metadata": {"path": folder}}
            NotebookClient(notebook, timeout=300, kernel_name="python3", resources=place).execute()
        for holder in (notebook, *notebook.cells):
            for name in _TRANSIENT:
                holder.metadata.pop(name, None)
        print(f"{path.name}: {len(notebook.cells)} cells ran")
        if "--check" not in words:
            nbformat.write(notebook, path)


if __name__ == "__main__":
    main(sys.argv[1:])
