"""Frequency responses of structures with known modes, in closed form."""

import numpy as np

from dynid.modal.frf_matrix import FrfMatrix


def modes(count=8, responses=20, damping=(0.002, 0.02), close=(), phase=0.0, seed=1):
    """Return poles (m) and shapes of unit modal mass (responses x m), between 20 and 200 Hz.

    `close`: modes whose successor is 0.1 % above; `phase`: scatter of the shapes' phases, rad.
    """
    random = np.random.default_rng(seed)
    omega = (
        2 * np.pi * np.linspace(20, 200, count + 2)[1:-1] * (1 + 0.2 / count * random.standard_normal(count))
    )
    omega.sort()
    for k in close:
        omega[k + 1] = 1.001 * omega[k]
    zeta = random.uniform(*damping, count)
    shapes = random.standard_normal((responses, count)) / np.sqrt(responses)
    return omega * (-zeta + 1j * np.sqrt(1 - zeta**2)), shapes * np.exp(
        1j * phase * random.standard_normal(shapes.shape)
    )


def receptances(poles, shapes, references, omega):
    """Return receptances (lines x responses x references) of modes of unit modal mass."""
    s = 1j * omega[:, None]
    scale = 1 / (2j * poles.imag)
    residues = np.einsum("r,or,ir->roi", scale, shapes, shapes[list(references)])
    return np.tensordot(1 / (s - poles), residues, 1) + np.tensordot(
        1 / (s - poles.conj()), residues.conj(), 1
    )


#: Lines of the tests, rad/s, and two modes outside of them.
OMEGA = 2 * np.pi * np.linspace(15, 215, 600)
OUTSIDE = 2 * np.pi * np.array([3, 420]) * (-0.01 + 1j)


def measured(poles, shapes, references=(0, 5), noise=0.02, seed=0, omega=OMEGA):
    """Return noisy responses, with two further modes outside the band; noise in proportion."""
    outer = np.random.default_rng(9).standard_normal((len(shapes), 2)) / np.sqrt(len(shapes)) * [0.3, 1]
    exact = receptances(poles, shapes, references, omega) + receptances(OUTSIDE, outer, references, omega)
    random = np.random.default_rng(1000 + seed)
    deviation = noise * np.abs(exact)
    complex_noise = (
        random.standard_normal(exact.shape) + 1j * random.standard_normal(exact.shape)
    ) / np.sqrt(2)
    return FrfMatrix(omega, exact + deviation * complex_noise, deviation, np.ones(exact.shape[1:]))


def standardised(analysis, poles, shapes):
    """Return errors of frequencies, damping ratios and shapes over their standard errors."""
    reported = analysis.modes
    by_omega, by_damping, _ = reported.standard_errors
    n, channels = reported.shape.shape
    variance = reported._variance()[2 * n :].reshape(-1, channels, n).transpose(0, 2, 1)
    exact = (shapes / (1 if "mass" in reported.normalisation else np.sqrt(2j * poles.imag))).T
    sign = np.where(
        np.sum(np.abs(exact - reported.shape), 1) < np.sum(np.abs(exact + reported.shape), 1), 1, -1
    )
    difference = reported.shape - sign[:, None] * exact
    parts = [difference.real / np.sqrt(variance[0])]
    parts += [difference.imag / np.sqrt(variance[1])] if len(variance) > 1 else []
    return (
        (reported.omega - np.abs(poles)) / by_omega,
        (reported.damping + poles.real / np.abs(poles)) / by_damping,
        np.array(parts),
    )
