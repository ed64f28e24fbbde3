"""What is not needed is not loaded: help and checks answer at once."""

import subprocess
import sys
from pathlib import Path

import pytest

CONFIGS = Path(__file__).parents[1] / "configs"
SPY = """
import sys
from dynid.cli import main
try:
    main(sys.argv[1:])
except SystemExit as left:
    code = left.code
print("LOADED", code, *{name.partition(".")[0] for name in sys.modules}, file=sys.stderr)
"""


def loaded_by(folder, *args):
    """Return the top-level modules that a command loads."""
    left = subprocess.run(
        [sys.executable, "-c", SPY, *args],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=600,
        check=True,
    )
    _, code, *names = left.stderr.split()
    assert code == "0"
    return set(names)


@pytest.mark.parametrize("args", [["--help"], ["--version"], ["run", "--help"], ["check", "--help"]])
def test_help_loads_no_library_but_click(tmp_path, args):
    heavy = {
        "numpy",
        "scipy",
        "pydantic",
        "yaml",
        "h5py",
        "sympy",
        "flint",
        "rich",
        "matplotlib",
        "numba",
        "control",
    }
    assert loaded_by(tmp_path, *args) & heavy == set()


@pytest.mark.thorough
@pytest.mark.parametrize("scene", ["isolator", "suspension"])
def test_checking_a_scene_loads_no_solver(tmp_path, scene):
    """Arrays and exact numbers at most: structures are built, and the rank of a graph is tested."""
    heavy = {"scipy", "h5py", "sympy", "rich", "matplotlib", "numba", "control"}
    assert loaded_by(tmp_path, "check", str(CONFIGS / f"{scene}.yaml")) & heavy == set()


@pytest.mark.thorough
def test_running_the_isolator_loads_no_symbols_and_no_figures(tmp_path):
    loaded = loaded_by(tmp_path, "run", str(CONFIGS / "isolator.yaml"))
    assert {"numpy", "h5py", "pydantic"} <= loaded
    assert loaded & {"sympy", "matplotlib", "numba", "control", "rich", "xarray"} == set()


@pytest.mark.thorough
def test_a_short_record_loads_no_compiler(tmp_path):
    loaded = loaded_by(tmp_path, "run", str(CONFIGS / "suspension_noisy.yaml"))
    assert "numpy" in loaded
    assert loaded & {"numba", "llvmlite", "sympy", "matplotlib", "control"} == set()


def test_importing_the_package_loads_nothing(tmp_path):
    left = subprocess.run(
        [sys.executable, "-c", "import sys, dynid; print(*sys.modules)"],
        cwd=tmp_path, capture_output=True, text=True, timeout=600, check=True,
    )  # fmt: skip
    assert {"numpy", "yaml", "pydantic", "click"} & set(left.stdout.split()) == set()


def test_public_packages_are_attributes_of_the_package_and_loaded_when_used(tmp_path):
    code = (
        "import sys, dynid; assert 'dynid.lti' not in sys.modules\n"
        "try: dynid.lti.roots(['1', '-5/2'], ['1', '0', '0', '0', 'x'])\n"
        "except dynid.errors.DynidError: print(dynid.lti.roots(['1', '-5/2'], ['1', '0'])[0])\n"
        "print(hasattr(dynid, 'nothing'))\n"
        "print(callable(dynid.report.figures), callable(dynid.store.write_result))"
    )
    left = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=600, check=True
    )
    assert left.stdout.split() == ["[2.5+0.j]", "False", "True", "True"]
