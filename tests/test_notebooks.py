"""The notebooks of the documentation: their code runs, and their pages show text, code and outputs."""

import ast
import importlib.util
import json
from pathlib import Path

import matplotlib
import pytest

DOCS = Path(__file__).parents[1] / "docs"
NOTEBOOKS = sorted(DOCS.glob("tutorials/*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_code_of_a_notebook_runs(path, tmp_path, monkeypatch, capsys):
    """Its printed outputs are those that it keeps; `.ci/docs` runs it with a kernel."""
    pytest.importorskip("pandas", reason="pandas is an extra")
    matplotlib.use("agg")
    monkeypatch.chdir(tmp_path)
    names = {}
    for cell in json.loads(path.read_text())["cells"]:
        if cell["cell_type"] == "code":
            exec(compile(ast.parse("".join(cell["source"])), cell["id"], "exec"), names)
            kept = ["".join(output.get("text", "")) for output in cell["outputs"]]
            assert capsys.readouterr().out == "".join(kept)
    matplotlib.pyplot.close("all")


def test_a_page_of_a_notebook_has_its_text_code_and_outputs():
    pytest.importorskip("mkdocs", reason="mkdocs is in the extra docs")
    spec = importlib.util.spec_from_file_location("notebooks", DOCS / "hooks/notebooks.py")
    hook = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hook)
    table = "<div>\n<style scoped>\n  td {}\n</style>\n<table border='1'>\n  <tr></tr>\n</table>\n</div>"
    outputs = [
        {"output_type": "stream", "text": ["6\n"]},
        {"data": {"text/html": [table], "text/plain": ["a table"]}},
        {"data": {"image/png": "aGk=\n", "text/plain": ["<Figure>"]}},
    ]
    assert hook._markdown({"cell_type": "markdown", "source": ["# Title"]}) == "# Title"
    page = hook._markdown({"cell_type": "code", "source": ["print(6)"], "outputs": outputs})
    assert page.startswith("```python\nprint(6)\n```\n\n```text\n6\n```")
    assert "<table>\n<tr>" in page
    assert "<style" not in page
    assert '<img src="data:image/png;base64,aGk=" alt="&lt;Figure&gt;">' in page
    assert hook.on_page_markdown("[here](a.ipynb#b), a.ipynb") == "[here](a.md#b), a.ipynb"
