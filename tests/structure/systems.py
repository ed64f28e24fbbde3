"""Structures for tests: random ones with massless DOFs, Yang's beam, matrices from elsewhere."""

from pathlib import Path

import numpy as np
import pytest

from dynid.structure.joints import Joint
from dynid.structure.model import StructuralModel

FE = Path(__file__).parents[3] / "shared/data/fe"


def random_structure(seed, n=9, massless=0, joints=()):
    """A grounded network of random springs between masses; the last DOFs carry no mass."""
    rng = np.random.default_rng(seed)
    K = np.diag(rng.uniform(0.5, 2, n))
    loose = [tuple(rng.choice(n, 2, replace=False)) for _ in range(2 * n)]
    for a, b in [*((k, k + 1) for k in range(n - 1)), *loose]:  # the chain leaves nothing apart
        direction = np.zeros(n)
        direction[a], direction[b] = 1, -1
        K += rng.uniform(0.2, 3) * np.outer(direction, direction)
    M = np.diag(rng.uniform(0.5, 2, n))
    if massless:
        M[-massless:] = 0
    return StructuralModel(M, 0.01 * K + 0.1 * M, K, joints)


def yang_beam(joints=True):
    """Yang's pinned beam by hand-written element matrices: theta_1 is DOF 1, w_4 is 6, w_6 is 10."""
    EI, rho_A, elements = 1723.3, 0.1, 7
    k = EI * np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
    m = rho_A / 420 * np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])
    K, M = np.zeros((16, 16)), np.zeros((16, 16))
    for element in range(elements):
        here = slice(2 * element, 2 * element + 4)
        K[here, here] += k
        M[here, here] += m
    K, M = K[1:, 1:], M[1:, 1:]
    ends = (Joint("root", (1,), 5e3), Joint("support", (10,), 1e4, 20)) if joints else ()
    return StructuralModel(M, 0.1 * M, K, ends)


def harwell_boeing(number):
    """A pair of the Harwell–Boeing collection."""
    if not FE.is_dir():
        pytest.skip(f"the matrices of {FE} are not here")
    from scipy.io import mmread

    K, M = (mmread(FE / f"bcsst{letter}{number}.mtx").toarray() for letter in "km")
    return StructuralModel(M, np.zeros_like(M), K)
