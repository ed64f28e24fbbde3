"""Maximum likelihood of lumped structures by plain SciPy: an oracle that shares no code with dynid.

Matrices are assembled link by link, the motion is propagated by matrix exponentials (powers of the step by
doubling), the initial state is projected out, and `scipy.optimize.least_squares` does the rest, from any
number of starts. −2 log L is, up to a constant, the sum over channels of N log(RSS / N): the noise of each
channel is estimated (profile likelihood).
"""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import block_diag, expm
from scipy.optimize import least_squares
from scipy.signal import fftconvolve

# Initial states whose effect is below this part of the best seen one stay at zero.
_RANK = 1e-10
# Residuals below this part of a channel's RMS are rounding: no likelihood tells them apart.
_FLOOR = 1e-6


class Element(NamedTuple):
    """A spring and a damper between two DOFs (from 0), or one and the ground."""

    dofs: tuple[int, ...]
    k: float
    c: float


class Force(NamedTuple):
    """A force: ``sines`` (amplitudes, frequencies), ``impact`` (amplitude, duration) or ``samples``."""

    dof: int
    kind: str
    first: np.ndarray
    second: np.ndarray


class Problem(NamedTuple):
    """A structure and what is measured of it.

    `unknowns` are pairs of an element's number and ``k`` or ``c``; `channels` pairs of a DOF and the order of
    the derivative of its displacement.
    """

    masses: np.ndarray
    elements: tuple[Element, ...]
    unknowns: tuple[tuple[int, str], ...]
    force: Force
    step: float
    samples: int
    channels: tuple[tuple[int, int], ...]

    @property
    def truth(self):
        """Logarithms of the true values."""
        return np.log([getattr(self.elements[k], letter) for k, letter in self.unknowns])

    def matrices(self, eta):
        """Return M, C and K at logarithms of the unknowns."""
        elements = list(self.elements)
        for (k, letter), value in zip(self.unknowns, np.exp(eta), strict=True):
            elements[k] = elements[k]._replace(**{letter: value})
        n = len(self.masses)
        C, K = np.zeros((n, n)), np.zeros((n, n))
        for element in elements:
            row = np.zeros(n)
            row[list(element.dofs)] = [1.0, -1.0][: len(element.dofs)]
            C += element.c * np.outer(row, row)
            K += element.k * np.outer(row, row)
        return np.diag(self.masses), C, K

    def system(self, eta):
        """Return A, B, C and D of the state (displacements, velocities)."""
        M, damping, K = self.matrices(eta)
        n = len(M)
        lower = np.linalg.solve(M, np.hstack([-K, -damping]))
        A = np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), lower])
        B = np.zeros(2 * n)
        B[n + self.force.dof] = 1 / self.masses[self.force.dof]
        every = np.vstack([np.eye(2 * n), lower])  # displacements, velocities, accelerations
        C = every[[order * n + dof for dof, order in self.channels]]
        D = np.array([B[n + dof] if order == 2 else 0.0 for dof, order in self.channels])
        return A, B, C, D

    def response(self, eta):
        """Return the response from rest (samples x channels), and that to initial states (… x 2n)."""
        A, B, C, D = self.system(eta)
        free = _observed(C, expm(A * self.step), self.samples)
        return getattr(self, f"_{self.force.kind}")(A, B, C, D), free

    def _sines(self, A, B, C, D):
        """Return the response to sines that start at t = 0."""
        generator = block_diag(*([[0, w], [-w, 0]] for w in self.force.second))
        entry = np.kron(self.force.first, [1.0, 0.0])
        start = np.kron(np.ones(len(self.force.first)), [0.0, 1.0])
        both = _joined(A, B, generator, entry)
        seen = _observed(np.hstack([C, np.outer(D, entry)]), expm(both * self.step), self.samples)
        return seen[:, :, len(A) :] @ start

    def _impact(self, A, B, C, D):
        """Return the response to half a sine, which ends between samples."""
        amplitude, duration = float(self.force.first), float(self.force.second)
        w = np.pi / duration
        generator, entry, start = (
            np.array([[0, w], [-w, 0]]),
            np.array([amplitude, 0.0]),
            np.array([0.0, 1.0]),
        )
        both = _joined(A, B, generator, entry)
        during = int(np.ceil(duration / self.step))
        seen = _observed(np.hstack([C, np.outer(D, entry)]), expm(both * self.step), during)
        left = expm(both * duration)[: len(A), len(A) :] @ start
        left = expm(A * (during * self.step - duration)) @ left
        after = _observed(C, expm(A * self.step), self.samples - during) @ left
        return np.concatenate([seen[:, :, len(A) :] @ start, after])

    def _samples(self, A, B, C, D):
        """Return the response to the cubic spline through samples."""
        spline = CubicSpline(np.arange(self.samples) * self.step, self.force.first)
        pieces = spline.c[::-1].T * [1.0, 1.0, 2.0, 6.0]  # derivatives at the beginning of each interval
        both = expm(_joined(A, B, np.eye(4, k=1), np.eye(4)[0]) * self.step)
        kernel = _observed(C, both[: len(A), : len(A)], self.samples - 1) @ both[: len(A), len(A) :]
        moved = fftconvolve(kernel, pieces[:, None, :], axes=0).sum(axis=2)[: self.samples - 1]
        moved = np.concatenate([np.zeros((1, len(C))), moved])
        return moved + np.outer(self.force.first, D)


def _joined(A, B, generator, entry):
    """Return the matrix of a system driven by the output of another."""
    lower = np.zeros((len(generator), len(A)))
    return np.block([[A, np.outer(B, entry)], [lower, generator]])


def _observed(C, Phi, count):
    """Return C, C Phi, C Phi², … (count x channels x states)."""
    seen = C[None]
    while len(seen) < count:
        seen = np.concatenate([seen, seen @ Phi])
        Phi = Phi @ Phi
    return seen[:count]


class Record:
    """A record of a problem, and its likelihood."""

    def __init__(self, problem, values):
        self.problem, self.values = problem, values
        self.rms = np.sqrt(np.mean(values**2, axis=0))
        M, _, K = problem.matrices(problem.truth)
        length = problem.samples * problem.step
        # Units of equal energy, so that the rank of what the record sees of the initial state has a meaning.
        stiff = K + M / length**2
        self.unit = block_diag(np.linalg.inv(np.linalg.cholesky(stiff)).T, np.diag(1 / np.sqrt(np.diag(M))))

    def residual(self, eta, noise):
        """Return the residuals over noise (samples x channels), the initial state fitted."""
        forced, free = self.problem.response(eta)
        right = ((self.values - forced) / noise).ravel()
        return self._rest(free, noise, right).reshape(self.values.shape)

    def _rest(self, free, noise, right):
        """Return what initial states leave of values over noise."""
        Q, R = np.linalg.qr(self._seen(free, noise))
        U, s, _ = np.linalg.svd(R)
        Q = Q @ U[:, s > _RANK * s[0]]
        return right - Q @ (Q.T @ right)

    def _seen(self, free, noise):
        return ((free @ self.unit) / noise[:, None]).reshape(free.shape[0] * free.shape[1], -1)

    def deviance(self, eta, noise=None):
        """Return −2 log L, and the noise of each channel that makes it least."""
        noise, before = self.rms if noise is None else noise, np.inf
        for _ in range(50):
            size = np.sqrt(np.mean((self.residual(eta, noise) * noise) ** 2, axis=0))
            noise = np.hypot(size, _FLOOR * self.rms)
            found = 2 * len(self.values) * float(np.sum(np.log(noise)))
            if abs(before - found) < 1e-7 or len(noise) == 1:
                break
            before = found
        return found, noise

    def fit(self, eta, noise=None, reach=12.0, rounds=8):
        """Return the logarithms of the nearest optimum and −2 log L there."""
        found, noise = self.deviance(eta, noise)
        low, high = eta - reach, eta + reach
        for _ in range(rounds):
            end = least_squares(
                lambda x, noise=noise: self.residual(x, noise).ravel(), eta, bounds=(low, high),
                x_scale="jac", xtol=1e-9, ftol=1e-11, gtol=1e-12, max_nfev=40,
            )  # fmt: skip
            reached, level = self.deviance(end.x, noise)
            if not reached < found:
                break
            gain, found, eta, noise = found - reached, reached, end.x, level
            if gain < 1e-3:
                break
        return eta, found

    def deviations(self, eta, noise):
        """Return the Cramér–Rao bound of the logarithms at noise, infinite where there is no information."""
        forced, free = self.problem.response(eta)
        right = ((self.values - forced) / noise).ravel()
        start = self.unit @ np.linalg.lstsq(self._seen(free, noise), right, _RANK)[0]

        def moved(step):
            forced, other = self.problem.response(eta + step)
            return self._rest(free, noise, ((forced + other @ start) / noise).ravel())

        J = np.column_stack([(moved(step) - moved(-step)) / 2e-5 for step in 1e-5 * np.eye(len(eta))])
        size = np.linalg.norm(J, axis=0)
        if not size.all():
            return np.full(len(eta), np.inf)
        _, s, Vt = np.linalg.svd(J / size, full_matrices=False)
        return np.linalg.norm(Vt.T / s, axis=1) / size if s[-1] > 1e-7 * s[0] else np.full(len(eta), np.inf)
