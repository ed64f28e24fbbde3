"""The page of docs/accuracy.py: every figure of a result, and every default choice with its benchmark."""

import importlib.util
from pathlib import Path

import pytest

from dynid.bench import run_benchmarks
from dynid.choices import CHOICES
from dynid.store import write_result

SCRIPT = Path(__file__).parents[1] / "docs/accuracy.py"


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    spec = importlib.util.spec_from_file_location("accuracy_page", SCRIPT)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    script.HERE = folder
    result = run_benchmarks(["propagation"], {"propagation": [100, 200]}, clock="processor")
    write_result(result, folder / "bench.h5")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["accuracy.py", str(folder / "bench.h5")])
        script.main()
    return result, folder


def test_it_holds_every_figure_and_a_plot(page):
    result, folder = page
    text = (folder / "accuracy.md").read_text(encoding="utf-8")
    for path in result:
        if path.endswith("/error"):
            assert f"| {path.split('/')[2]} |" in text
            assert all(f"{value:.1e}" in text for value in result[path].data)
    assert "processor clock" in text
    assert "peers faster and more accurate than the default: none" in text
    for what in ("precision", "growth"):
        assert "<svg" in (folder / f"accuracy/bench-propagation-{what}.svg").read_text(encoding="utf-8")


def test_it_holds_every_choice(page):
    _, folder = page
    text = (folder / "accuracy.md").read_text(encoding="utf-8")
    for name, choice in CHOICES.items():
        assert f"| `{name}` |" in text
        assert choice.sentence.format(value=choice.value) in text
