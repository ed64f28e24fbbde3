"""Accelerations of chains of masses under white forces, by the exact recursion of each mode."""

import numpy as np
from scipy.linalg import eigh


def chain(masses=6, stiffness=3000.0, ratio=0.01):
    """Return frequencies (rad/s), damping ratios, and shapes of unit modal mass (DOF x mode) of a chain."""
    K = stiffness * (2 * np.eye(masses) - np.eye(masses, k=1) - np.eye(masses, k=-1))
    K[-1, -1] = stiffness
    squares, shapes = eigh(K)
    return np.sqrt(squares), np.full(masses, ratio), shapes


def accelerations(modes, step, samples, seed, noise=0.05, settle=3000, sensors=None):
    """Return noisy accelerations (samples x sensors) under independent white forces, held in each step."""
    from scipy.signal import lfilter

    omega, ratio, shapes = modes
    random = np.random.default_rng(seed)
    forces = random.standard_normal((samples + settle, len(shapes))) @ shapes
    at = slice(None) if sensors is None else list(sensors)
    values = np.zeros((samples + settle, len(shapes[at])))
    for k, (w, zeta) in enumerate(zip(omega, ratio, strict=True)):
        pole = w * (-zeta + 1j * np.sqrt(1 - zeta**2))
        # q = Re(2 c z), z' = pole z + f: exact for a force held in each step.
        z = lfilter(
            [0, (np.exp(pole * step) - 1) / pole], [1, -np.exp(pole * step)], forces[:, k].astype(complex)
        )
        # Acceleration: f - 2 zeta w q' - w^2 q of unit modal mass.
        c = 1 / (2j * pole.imag)
        q, velocity = 2 * (c * z).real, 2 * (c * pole * z).real
        values += np.outer(forces[:, k] - 2 * zeta * w * velocity - w**2 * q, shapes[at, k])
    values = values[settle:]
    return values + noise * values.std(axis=0) * random.standard_normal(values.shape)


def standardised_outputs(modes, omega, ratio, shapes):
    """Return errors of frequencies, damping ratios and shapes over their standard errors."""
    by_omega, by_damping, _ = modes.standard_errors
    n, channels = modes.shape.shape
    deviation = np.sqrt(modes._variance()[2 * n :].reshape(2, channels, n))
    exact = shapes / shapes[modes.driving, np.arange(n)]
    difference = np.stack([modes.shape.T.real - exact, modes.shape.T.imag])
    used = deviation > 0  # the largest entry is 1
    return (
        (modes.omega - omega) / by_omega,
        (modes.damping - ratio) / by_damping,
        difference[used] / deviation[used],
    )
