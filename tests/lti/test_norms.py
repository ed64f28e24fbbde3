"""Norms of one channel with derivatives, against closed forms, polynomial roots and mpmath."""

import mpmath
import numpy as np
import pytest

from dynid.lti.norms import followed, h2_norm, maxima, modes, response, without_hidden
from dynid.lti.state_space import Matrices, ParametricSystem, single


def oscillator(zeta, *, d=0.0):
    """Return x'' + 2 zeta x' + x = u, y = x + d u, with derivatives by zeta and by the gain of the input."""
    A, b, c = np.array([[0.0, 1.0], [-1.0, -2 * zeta]]), np.array([0.0, 1.0]), np.array([1.0, 0.0])
    slopes = np.zeros((2, 2, 2))
    slopes[0, 1, 1] = -2.0
    return ParametricSystem(
        A, b, c, d, slopes, np.array([[0.0, 0.0], [0.0, 1.0]]), np.zeros((2, 2)), np.zeros(2)
    )


def random_system(seed, n=6):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.3) * np.eye(n)
    parts = [A, rng.normal(size=n), rng.normal(size=n), 0.4]
    slopes = [
        rng.normal(size=(2, n, n)),
        rng.normal(size=(2, n)),
        rng.normal(size=(2, n)),
        rng.normal(size=2),
    ]
    return ParametricSystem(*parts, *slopes)


def moved(system, p, h):
    return system._replace(
        A=system.A + h * system.A_slopes[p],
        b=system.b + h * system.b_slopes[p],
        c=system.c + h * system.c_slopes[p],
        d=system.d + h * float(system.d_slopes[p]),
    )


@pytest.mark.parametrize("zeta", [0.01, 0.3, 2.0])
def test_the_norms_of_an_oscillator(zeta):
    system = oscillator(zeta)
    norm, slopes = h2_norm(system)
    assert norm == pytest.approx(1 / np.sqrt(4 * zeta), rel=1e-13)
    assert slopes == pytest.approx([-1 / (4 * zeta**1.5), norm], rel=1e-12)
    top = maxima(system, np.linalg.eigvals(system.A).astype(complex))
    peak = 1 / (2 * zeta * np.sqrt(1 - zeta**2)) if zeta < np.sqrt(0.5) else 1.0
    assert top.magnitude.max() == pytest.approx(peak, rel=1e-12)
    if zeta < np.sqrt(0.5):
        k = top.magnitude.argmax()
        assert top.omega[k] == pytest.approx(np.sqrt(1 - 2 * zeta**2), rel=1e-10)
        rate = -(1 - 2 * zeta**2) / (2 * zeta**2 * (1 - zeta**2) ** 1.5)
        assert top.slopes[k] == pytest.approx([rate, peak], rel=1e-9)


def test_the_h2_norm_is_the_integral_over_frequency():
    system = random_system(3, 3)._replace(d=0.0)

    def density(w):
        s = mpmath.matrix(1j * w * np.eye(3) - system.A)
        return abs(sum(c * x for c, x in zip(system.c, mpmath.lu_solve(s, system.b), strict=True))) ** 2

    with mpmath.workdps(15):
        integral = mpmath.quad(density, [0, 1, 4, mpmath.inf]) / mpmath.pi
    assert h2_norm(system)[0] == pytest.approx(float(mpmath.sqrt(integral)), rel=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_maxima_are_the_roots_of_the_derivative(seed):
    system = random_system(seed)
    found = maxima(system, np.linalg.eigvals(system.A).astype(complex))
    denominator = np.poly(system.A)
    numerator = np.poly(system.A - np.outer(system.b, system.c)) - denominator + system.d * denominator
    top, bottom = (squared(part) for part in (numerator, denominator))
    slope = np.polysub(np.polymul(np.polyder(top), bottom), np.polymul(top, np.polyder(bottom)))
    stationary = np.roots(slope)
    real = np.sqrt(stationary[(abs(stationary.imag) < 1e-7 * abs(stationary)) & (stationary.real > 0)].real)
    sizes = [np.abs(response(system, np.array([w * (1 + k)]))[0]) for w in real for k in (-1e-4, 0, 1e-4)]
    true = [w for w, (a, b, c) in zip(real, np.reshape(sizes, (-1, 3)), strict=True) if b > max(a, c)]
    inside = np.sort(found.omega[np.isfinite(found.omega) & (found.omega > 0)])
    assert inside == pytest.approx(np.sort(true), rel=1e-5)


def squared(polynomial):
    """Return |P(j w)|^2 as a polynomial in w^2."""
    signs = polynomial * (-1.0) ** np.arange(len(polynomial))[::-1]
    return (np.polymul(polynomial, signs)[::-1][::2] * (-1.0) ** np.arange(len(polynomial)))[::-1]


def test_derivatives_are_those_of_differences():
    system, h = random_system(1), 1e-6
    poles = np.linalg.eigvals(system.A).astype(complex)
    top = maxima(system, poles)
    for p in range(2):
        ends = [moved(system, p, side * h) for side in (1, -1)]
        up, down = (followed(one, top).magnitude for one in ends)
        assert (up - down) / (2 * h) == pytest.approx(top.slopes[:, p], rel=1e-7, abs=1e-8)
        up, down = (h2_norm(one._replace(d=0.0))[0] for one in ends)
        assert (up - down) / (2 * h) == pytest.approx(h2_norm(system)[1][p], rel=1e-7)


def test_a_band_has_its_ends():
    system = oscillator(0.05)
    poles = np.linalg.eigvals(system.A).astype(complex)
    below, above = maxima(system, poles, 0.2, 0.8), maxima(system, poles, 1.2, 3.0)
    assert below.omega.tolist() == [0.8]
    assert above.omega.tolist() == [1.2]
    assert followed(system, below, 0.2, 0.8).magnitude == pytest.approx(below.magnitude)
    assert maxima(system, poles, 0.5, 2.0).magnitude.max() == pytest.approx(10.01252, rel=1e-6)


def test_a_direct_term_is_the_limit_at_high_frequencies():
    system = oscillator(1.0, d=-3.0)
    top = maxima(system, np.linalg.eigvals(system.A).astype(complex))
    at = np.isinf(top.omega)
    assert top.magnitude[at].tolist() == [3.0]
    assert followed(system, top).magnitude == pytest.approx(top.magnitude)


def test_hidden_modes_are_left_out_and_moved():
    system = oscillator(0.1)
    A = np.zeros((4, 4))
    A[:2, :2], A[2, 2], A[3, 3] = system.A, 0.0, 0.5  # an integrator and an unstable mode beside
    A[2, 0] = A[3, 1] = 1.0  # which are driven, and not observed
    slopes = (np.zeros((1, 4, 4)), np.zeros((1, 4)), np.zeros((1, 4)), np.zeros(1))
    wide = ParametricSystem(A, np.append(system.b, [0, 0]), np.append(system.c, [0, 0]), 0.0, *slopes)
    assert np.count_nonzero(modes(wide).hidden) == 2
    stable, poles = without_hidden(wide)
    assert np.sort(poles.imag) == pytest.approx([-np.sqrt(0.99), np.sqrt(0.99)])
    assert h2_norm(stable)[0] == pytest.approx(h2_norm(system)[0], rel=1e-12)
    omega = np.array([0.1, 1.0, 7.0])
    assert response(stable, omega) == pytest.approx(response(system, omega), rel=1e-12)


def test_a_differentiating_channel_keeps_its_response():
    n = 2
    A, one = np.array([[0.0, 1.0], [-1.0, -0.2]]), np.zeros((1, n, 1))
    D = np.array([[[0.5]], [[2.0]]])
    found = Matrices(A, np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]), D, np.zeros((1, n, n)), one,
                     one.transpose(0, 2, 1), np.zeros((1, 2, 1, 1)))  # fmt: skip
    system, s = single(found, 0, 0), 1j * np.array([0.3, 2.0])
    # its input is the derivative of that of the channel
    assert response(system, s.imag) * s == pytest.approx(1 / (s**2 + 0.2 * s + 1) + 0.5 + 2 * s, rel=1e-12)
