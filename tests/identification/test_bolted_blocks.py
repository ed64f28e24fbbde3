"""Two meshed blocks joined by one bolt: which of its twelve parameters tests determine, and how well."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from dynid.structure.labels import DIRECTIONS

pytestmark = pytest.mark.thorough

SCRIPT = Path(__file__).parents[2] / "docs/bolted_blocks.py"


@pytest.fixture(scope="module")
def blocks():
    spec = importlib.util.spec_from_file_location("bolted_blocks", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules["bolted_blocks"] = module  # its dataclass looks itself up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def small(blocks):
    model = blocks.assembly(((16, 4, 1), (12, 2, 1)))
    return blocks.by_parts(model)


@pytest.mark.slow  # test_undetermined.py has the sentence of small models
@pytest.mark.usefixtures("poor_starts")
def test_the_components_that_nothing_excites_are_named(blocks, small):
    out_of_plane = [f"bolt.{letter}.{along}" for along in ("y", "rx", "rz") for letter in "kc"]
    said = blocks.undetermined(small)
    assert said.startswith(f"{', '.join(out_of_plane)} are not identifiable from this record")


def test_the_reduced_parts_have_the_modes_of_the_meshes(small):
    from dynid.structure.modes.modes import modes

    full = small.basis.parent
    known = full.true_values()
    exact = modes(*full.with_joints(known), count=8).omega
    found = modes(*small.with_joints(known), count=8).omega
    np.testing.assert_allclose(found, exact, rtol=2e-4)
    assert {f"{point}:{along}" for point in "pq" for along in DIRECTIONS} <= {*small.dofs}


@pytest.mark.slow
def test_intervals_of_records_and_modes_cover_the_truth(blocks, small):
    laboratory = blocks.Laboratory.of(small, in_plane=False)
    errors = np.array([[z for z, _ in laboratory.errors(seed).values()] for seed in range(1, 26)])
    assert errors.shape == (25, 12)
    # 300 intervals: three standard errors about 95 % of them.
    assert 0.91 < np.mean(np.abs(errors) <= blocks.WIDE) < 0.99
    assert 0.85 < np.sqrt(np.mean(errors**2)) < 1.15
