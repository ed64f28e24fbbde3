"""The page of docs/accuracy.py: every figure of a result, and every default choice with its benchmark."""

import importlib.util
from pathlib import Path

import pytest

from dynid.defaults import CHOICES
from dynid.store import write_result

pytestmark = pytest.mark.thorough

SCRIPT = Path(__file__).parents[2] / "docs/accuracy.py"


def _script(folder):
    spec = importlib.util.spec_from_file_location("accuracy_page", SCRIPT)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    script.HERE = folder
    return script


@pytest.fixture(scope="module")
def page(result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    script = _script(folder)
    write_result(result, folder / "bench.h5")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["accuracy.py", str(folder / "bench.h5")])
        script.main()
    return result, folder


@pytest.mark.thorough
def test_it_holds_every_figure_and_a_plot(page):
    result, folder = page
    text = (folder / "accuracy.md").read_text(encoding="utf-8")
    for path in result:
        if path.endswith("/error"):
            assert f"| {path.split('/')[2]} |" in text
            assert all(f"{value:.1e}" in text for value in result[path].data)
    assert "processor clock" in " ".join(text.split())
    assert "peers faster and more accurate than the default: none of dop853, lsim, newmark, rk4" in text
    for what in ("precision", "growth"):
        assert "<svg" in (folder / f"accuracy/bench-propagation-{what}.svg").read_text(encoding="utf-8")


def test_a_benchmark_that_fails_does_not_lose_the_others(page, tmp_path, monkeypatch, capsys):
    result, _ = page
    script, asked = _script(tmp_path), []

    def run(names, **_):
        asked.extend(names)
        if names != ["propagation"]:
            raise ArithmeticError("it fails")
        return result

    monkeypatch.setattr(script, "run_benchmarks", run)
    monkeypatch.setattr("sys.argv", ["accuracy.py", str(tmp_path / "figures")])
    assert script.main() == 1
    assert asked == list(script.BENCHMARKS)
    assert "| exponential-spline |" in (tmp_path / "accuracy.md").read_text(encoding="utf-8")
    assert "not on the page: frequency-response, " in capsys.readouterr().err
    asked.clear()
    assert script.main() == 1
    assert asked == [name for name in script.BENCHMARKS if name != "propagation"]  # its file is there


def test_it_holds_every_choice(page):
    _, folder = page
    text = (folder / "accuracy.md").read_text(encoding="utf-8")
    for name, choice in CHOICES.items():
        assert f"| `{name}` |" in text
        assert choice.sentence.format(value=choice.value) in text
