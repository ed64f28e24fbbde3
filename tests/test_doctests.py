"""The examples in docstrings say what Python says."""

import doctest
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import dynid

ROOT = Path(dynid.__file__).parent
EXAMPLES = sorted(
    path for path in ROOT.rglob("*.py") if "    >>> " in path.read_text() or "\n>>> " in path.read_text()
)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_examples_of_a_module(path, monkeypatch):
    monkeypatch.chdir(Path(__file__).parents[1])  # examples name the scenes in configs/
    name = ".".join(["dynid", *path.relative_to(ROOT).with_suffix("").parts]).removesuffix(".__init__")
    with np.printoptions(legacy=False, sign="-"):  # whatever a library has set
        failed, tried = doctest.testmod(import_module(name))
    assert tried > 0
    assert failed == 0
