"""Finite-element matrices of the benchmarks: those of a plate and of a block."""

import numpy as np
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh

from dynid.bench.meshes import deflections, plate, solid


def test_a_plate_has_the_frequencies_of_kirchhoff():
    """Simply supported: omega = pi^2 (m^2 / a^2 + n^2 / b^2) for unit stiffness and mass."""
    exact = np.sort(
        [np.pi**2 * (m**2 + n**2 / 1.3**2) for m in range(1, 4) for n in range(1, 4)]
    )[:4]  # fmt: skip
    errors = []
    for side in (6, 12):
        K, M = plate(side)
        square = eigsh(K, 4, M, sigma=0, return_eigenvectors=False)
        errors.append(np.abs(np.sqrt(np.sort(square)) / exact - 1).max())
    assert errors[1] < 0.01
    assert errors[0] / errors[1] > 3
    w = deflections(12)
    assert len(w) == 11**2  # inner nodes
    _, shape = eigsh(K, 1, M, sigma=0)
    half = np.sin(np.pi * np.arange(1, 12) / 12)
    mode = np.outer(half, half).ravel()
    found = shape[w - 1, 0]
    np.testing.assert_allclose(abs(found @ mode), np.linalg.norm(found) * np.linalg.norm(mode), rtol=1e-4)


def test_a_block_strains_evenly_under_an_even_load():
    """Stretched along its length it takes displacements that are linear, and the energy of that strain."""
    sizes = (1.3, 1.0, 1.1)
    K, M = solid(3, sizes)
    assert K.shape == (3 * 4**3 - 3 * 4**2,) * 2
    place = np.indices((4, 4, 4)).reshape(3, -1).T[16:] * np.array(sizes) / 3
    e = 1e-3
    # All lateral motion held: u = e x needs the modulus E (1 - nu) / ((1 + nu) (1 - 2 nu)).
    u = np.zeros((len(place), 3))
    u[:, 0] = e * place[:, 0]
    modulus = (1 - 0.3) / (1.3 * 0.4)
    np.testing.assert_allclose(u.ravel() @ K @ u.ravel(), modulus * e**2 * np.prod(sizes), rtol=1e-12)
    # Mass: what moves as a whole is all but the share of the clamped face's nodes.
    rigid = np.zeros((len(place), 3))
    rigid[:, 1] = 1
    layer = sizes[0] / 3
    np.testing.assert_allclose(
        rigid.ravel() @ M @ rigid.ravel(), (sizes[0] - layer + layer / 3) * sizes[1] * sizes[2], rtol=1e-12
    )
    assert eigh(K.toarray(), M.toarray(), eigvals_only=True)[0] > 0  # the clamp holds it
