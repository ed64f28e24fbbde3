"""The linear rest of a structure for the march: exact tables of its steps in each regime, and the loads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, cached_property
from math import factorial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray
from dynid.errors import NumericalError
from dynid.lti.exponential import exponential
from dynid.lti.time_response import Timeline
from dynid.structure.law import BoundLaw

#: Lobatto nodes of a step.
NODES = 5
#: Degree of the polynomials of the loads within a step.
LOAD_DEGREE = 8
#: Points of a step at which guards are checked.
SCAN = np.unique(np.concatenate([np.linspace(0, 1, 17)[1:], [1e-3, 1e-2]]))
# Norm of a generator up to which its exponential is summed: its terms are below e^4, cancellation one digit;
# after so many terms the next is below 4^40 / 40! = 1e-24.
_MAX_SERIES_NORM, _MAX_SERIES_TERMS = 4.0, 40
# Phase of the fastest mode in a regular step up to which eigenvalues are accurate: their error is that of the
# fastest one, which would show in the phase of slow modes of a stiff structure.
_MAX_MODAL_PHASE = 2.0
# Condition of the eigenvectors beyond which a part of a step is propagated by matrix exponentials.
_MAX_CONDITION = 1e5


@cache
def lobatto() -> tuple[Array, Array, Array]:
    """Return the nodes (s) in [0, 1], coefficients (s x s) of their polynomials, and weights of integrals.

    Row j holds the monomial coefficients of the polynomial that is 1 at node j; the weights (s x s) are its
    integrals up to each node.
    """
    inner = np.polynomial.legendre.Legendre.basis(NODES - 1).deriv().roots()
    c = np.concatenate([[0.0], (1 + np.sort(np.real(inner))) / 2, [1.0]])
    L = np.linalg.inv(np.vander(c, increasing=True)).T
    k = np.arange(1, NODES + 1)
    weights = np.asarray((c[:, None] ** k / k) @ L.T, dtype=np.float64)
    return c, L, weights


@cache
def legendre_coefficients() -> tuple[Array, Array]:
    """Return the rows to Legendre coefficients of forces: in a step (4 x s), beyond it (4 x 2 s - 1).

    In a step those of degrees 1 … 4 from values at its nodes; beyond those of 5 … 8 from values at the nodes
    of the last two steps, for a step.
    """
    c, legvander = lobatto()[0], np.polynomial.legendre.legvander
    two = np.linalg.inv(legvander(np.concatenate([c, 1 + c[1:]]) - 1, 2 * NODES - 2))[NODES:]
    two /= 2.0 ** np.arange(NODES, 2 * NODES - 1)[:, None]
    within = np.linalg.inv(legvander(2 * c - 1, NODES - 1))[1:]
    return np.asarray(within, dtype=np.float64), np.asarray(two, dtype=np.float64)


def left_out(forces: Array, before: Array | None) -> Array:
    """Return the Legendre coefficients of degrees 5 … 8 of forces, which a step leaves out (4 x nf).

    `forces` (s x nf) at its nodes, `before`: at those of the step before. As the coefficients of degree 1, 2
    fall to 3, 4, of which one alone may vanish by chance, or as measured over both steps: the lesser.
    """
    within, beyond = legendre_coefficients()
    head, tail = np.linalg.norm((within @ forces).reshape(2, 2, -1), axis=1)
    decay = np.where(tail < head, tail / np.where(head > 0, head, 1.0), 1.0)
    falling = tail * np.array([decay, decay**1.5, decay**2, decay**2.5])
    if before is None:
        return np.asarray(falling)
    return np.asarray(np.minimum(falling, np.abs(beyond @ np.concatenate([before, forces[1:]]))))


@cache
def load_points() -> tuple[Array, Array]:
    """Return the points in [0, 1] at which loads are evaluated, and the matrix to their polynomials."""
    x = (1 - np.cos(np.pi * np.arange(LOAD_DEGREE + 1) / LOAD_DEGREE)) / 2
    vandermonde = np.polynomial.chebyshev.chebvander(2 * x - 1, LOAD_DEGREE)
    return x, np.asarray(np.linalg.inv(vandermonde), dtype=np.float64)


@cache
def powers_of(kind: str) -> Array:
    """Return the coefficients of the powers of time in each polynomial of a kind over a step."""
    series: Any = getattr(np.polynomial, kind)
    rows = [
        series.basis(k, [0, 1]).convert(kind=np.polynomial.Polynomial).coef for k in range(LOAD_DEGREE + 1)
    ]
    return np.array([np.pad(row, (0, LOAD_DEGREE - k)) for k, row in enumerate(rows)])


class Energy(NamedTuple):
    """The energy x' H x / 2 of a structure without its laws, and its change.

    `H` (n x n); `rows` (nu + dampers x n): the variables whose product with a load is its power, and those
    whose squares are the power that the dampers dissipate.
    """

    H: Array
    rows: Array


class LinearRest(NamedTuple):
    """The structure without its laws, ``x' = A x + D [f, u, g]``, and what is read within a step.

    `A` (n x n); `D` (n x nf + nu + r): directions of joint forces f, loads u and further ones g; `rows` (2 nf
    + w x n): deflections, their rates, and further rows. A joint force is positive where it resists the
    deflection: its directions have the sign that this needs. `energy`: where the balance of energy is wanted.
    """

    A: Array
    D: Array
    rows: Array
    forces: int
    loads: int
    energy: Energy | None = None

    @property
    def all_rows(self) -> Array:
        """The rows, and those of the energy."""
        return self.rows if self.energy is None else np.concatenate([self.rows, self.energy.rows])

    def work_of(self, jump: Array) -> Array:
        """Return the row whose product with the state halfway through a jump of it is the energy supplied."""
        return np.zeros(len(jump)) if self.energy is None else self.energy.H @ jump


class Columns(NamedTuple):
    """What the parameters (p) act on: force of the further directions, and parameters of the laws.

    `by_rows` (p x r x w), `by_loads` (p x r x nu), `by_forces` (p x r x nf): the force of column p in the
    further directions is ``by_rows w + by_loads u + by_forces f``; `laws`: of each law the derivatives
    (parameters and offset x p).
    """

    by_rows: Array
    by_loads: Array
    by_forces: Array
    laws: tuple[Array, ...]


class Motion(NamedTuple):
    """A motion at the times asked for.

    `states` (times x n), `hidden` (times x laws), `forces` (times x nf), `regimes` (times x laws), `work`
    (times x nf + 2): done on the laws, by the loads, and on the dampers, J (the last two are 0 without
    `LinearRest.energy`); `slopes` (times x n x q), `force_slopes` (times x nf x q),
    `hidden_slopes` (times x laws x q): by parameters (p), first state (n) and first hidden states (laws);
    `events`: their number; `local_error`: of laws without regimes the largest sum over steps of the change
    of the state by what polynomials leave out, where earlier changes have faded as the slowest mode does.
    """

    states: Array
    hidden: Array
    forces: Array
    regimes: Array
    work: Array
    slopes: Array
    force_slopes: Array
    hidden_slopes: Array
    events: int
    steps: int
    local_error: float


class Refine(NumericalError):
    """A step is too long for its iteration or its events."""


def first_regimes(rest: LinearRest, laws: Sequence[BoundLaw], x0: Array, z0: Array) -> list[int]:
    """Return the regimes in which a motion starts."""
    w, nf = rest.rows @ x0, rest.forces
    return [
        law.regime(float(w[law.row]), float(w[nf + law.row]), float(z))
        for law, z in zip(laws, z0, strict=True)
    ]


class Tables(NamedTuple):
    """A step of length h: exact responses at its nodes (1 … s - 1) and at its end.

    Forces act by their values at the nodes, the joints' nf before the further r; loads by their coefficients.
    """

    h: float
    P: Array  # of the state at the end to that at the beginning (n x n)
    Q: Array  # … to forces at the nodes (n x s x nf + r)
    U: Array  # … to the loads (n x degree + 1 x nu)
    rows: Array  # of the rows at the nodes to the state (s - 1 x rows x n)
    influence: Array  # … to forces at the nodes (s - 1 x rows x s x nf + r)
    by_loads: Array  # … to the loads (s - 1 x rows x degree + 1 x nu)
    beyond: Array  # size of the response to what the step leaves out of polynomials of degrees 5 … 8 (4 x nf)


class Regime:
    """The rest with the tangents of the laws in some regimes."""

    def __init__(self, rest: LinearRest, k: Array, c: Array) -> None:
        nf = rest.forces
        self.k, self.c, self.rest, self.R = k, c, rest, rest.all_rows
        fold = k[:, None] * rest.rows[:nf] + c[:, None] * rest.rows[nf : 2 * nf]
        self.A = rest.A + rest.D[:, :nf] @ fold
        self._regular: dict[float, Tables] = {}

    def tables(self, h: float, *, regular: bool) -> Tables:
        """Return the tables of a step; those of a regular one are kept."""
        if not regular:
            return self._by_modes(h) if self.modes is not None else self._by_exponentials(h)
        if h not in self._regular:
            slow = self.modes is not None and np.abs(self.modes[0]).max(initial=0.0) * h <= _MAX_MODAL_PHASE
            self._regular[h] = self._by_modes(h) if slow else self._by_exponentials(h)
        return self._regular[h]

    def forget_steps(self) -> None:
        """Drop the tables of regular steps."""
        self._regular.clear()

    def _assembled(self, h: float, P: Array, responses: Array) -> Tables:
        """Return tables of the states at the nodes, from their responses to powers of time in a step.

        `P` (s - 1 x n x n), `responses` (degree + 1 x s - 1 x n x nd).
        """
        nf, nu = self.rest.forces, self.rest.loads
        forces = np.delete(responses[:NODES], np.s_[nf : nf + nu], axis=3)
        Q = np.einsum("jk,keid->eijd", lobatto()[1], forces)
        U = np.einsum("jk,keid->eijd", powers_of("Chebyshev"), responses[..., nf : nf + nu])

        def read(X: Array) -> Array:
            return (self.R @ X.reshape(*X.shape[:2], -1)).reshape(len(X), len(self.R), *X.shape[2:])

        # Of Legendre's polynomials what the step leaves out is the difference from their values at its nodes.
        polynomials = powers_of("Legendre")[NODES:]
        at_nodes = np.vander(lobatto()[0], LOAD_DEGREE + 1, increasing=True) @ polynomials.T
        missed = np.einsum("jk,knf->jnf", polynomials, responses[:, -1, :, :nf])
        missed -= np.einsum("ej,nef->jnf", at_nodes, Q[-1][..., :nf])
        beyond = np.linalg.norm(missed, axis=1)
        return Tables(h, P[-1], Q[-1], U[-1], self.R @ P, read(Q), read(U), beyond)

    def _by_exponentials(self, h: float) -> Tables:
        """Return tables by matrix exponentials joined with the powers of time."""
        c, nf, (n, nd) = lobatto()[0], self.rest.forces, self.rest.D.shape
        # Directions of each power, of which the higher ones are those of joint forces and loads alone.
        powers = [np.arange(nd)] * NODES + [np.arange(nf + self.rest.loads)] * (LOAD_DEGREE + 1 - NODES)
        place = n + np.cumsum([0, *map(len, powers)])
        joint = np.zeros((place[-1],) * 2)
        joint[:n, :n], joint[:n, n : place[1]] = self.A, self.rest.D
        for k, here in enumerate(powers[1:]):
            joint[place[k] + here, place[k + 1] + here] = 1 / h
        # Nodes are symmetric: the first, the middle, the last but one and the end are sums of two lengths.
        first, second = exponential(joint, c[1] * h), exponential(joint, (c[2] - c[1]) * h)
        middle = second @ first
        after = second @ middle
        E = np.stack([first, middle, after, first @ after])[:, :n]
        responses = np.zeros((len(powers), NODES - 1, n, nd))
        for k, here in enumerate(powers):
            responses[k][..., here] = factorial(k) * E[..., place[k] : place[k + 1]]
        return self._assembled(h, np.ascontiguousarray(E[..., :n]), responses)

    @cached_property
    def modes(self) -> tuple[ComplexArray, ComplexArray, ComplexArray] | None:
        """Eigenvalues (n), eigenvectors and their inverse (n x n); None where these are ill conditioned."""
        lam, V = np.linalg.eig(self.A)
        condition = np.linalg.cond(V)
        if not (np.isfinite(condition) and condition < _MAX_CONDITION):
            return None
        return lam.astype(complex), V.astype(complex), np.linalg.inv(V).astype(complex)

    def _by_modes(self, h: float) -> Tables:
        """Return tables by the eigenvalues."""
        assert self.modes is not None
        lam, V, inverse = self.modes
        c = lobatto()[0]
        phi = phi_functions(np.outer(c[1:], lam * h), LOAD_DEGREE + 1)
        k = np.arange(LOAD_DEGREE + 1)
        weights = h * np.array([factorial(i) for i in k]) * c[1:, None] ** (k + 1)  # s - 1 x degree + 1
        P = ((V * phi[0][:, None, :]) @ inverse).real
        responses = V @ ((weights.T[..., None] * phi[1:])[..., None] * (inverse @ self.rest.D))
        return self._assembled(h, P, responses.real)


class Regimes:
    """The regimes of some laws beside a linear rest, with their tables, as far as motions entered them."""

    def __init__(self, rest: LinearRest, laws: Sequence[BoundLaw]) -> None:
        self.rest, self.laws = rest, laws
        self._kept: dict[bytes, Regime] = {}

    def at(self, regimes: Sequence[int]) -> Regime:
        """Return the rest with the tangents of the laws in these regimes."""
        k, c = np.zeros((2, self.rest.forces))
        for law, regime in zip(self.laws, regimes, strict=True):
            stiffness, damping = law.tangent(int(regime))
            k[law.row] += stiffness
            c[law.row] += damping
        return self.folding(k, c)

    def forget_steps(self) -> None:
        """Drop the tables of regular steps, not the modes."""
        for regime in self._kept.values():
            regime.forget_steps()

    def fading(self, regimes: Sequence[int]) -> float:
        """Return the decay rate of the slowest mode in these regimes, 1/s; 0 if one does not decay."""
        modes = self.at(regimes).modes
        return 0.0 if modes is None else max(0.0, float(np.min(-modes[0].real, initial=np.inf)))

    def folding(self, k: Array, c: Array) -> Regime:
        """Return the rest with this stiffness and damping of the laws (nf)."""
        key = k.tobytes() + c.tobytes()
        if key not in self._kept:
            self._kept[key] = Regime(self.rest, k, c)
        return self._kept[key]


def phi_functions(z: ComplexArray, order: int) -> ComplexArray:
    """Return phi_0 … phi_order of numbers z (order + 1 x …): phi_0 = exp, z phi_(k+1) = phi_k - 1 / k!."""
    out = np.empty((order + 1, *z.shape), dtype=complex)
    out[0] = np.exp(z)
    large = np.abs(z) > 4.0
    far = np.where(large, z, 1.0)
    for k in range(order):
        out[k + 1] = (out[k] - 1 / factorial(k)) / far
    near = np.where(large, 0.0, z)
    term = np.full(z.shape, 1 / factorial(order), dtype=complex)
    last = term.copy()
    for k in range(1, 30):
        term = term * near / (order + k)
        last += term
    out[order] = np.where(large, out[order], last)
    for k in range(order - 1, 0, -1):
        out[k] = np.where(large, out[k], near * out[k + 1] + 1 / factorial(k))
    return out


class Steps(NamedTuple):
    """Regular steps, and the loads there.

    `lengths` (steps), s; `coefficients` (steps x degree + 1 x nu): loads as Chebyshev polynomials over each
    step; `samples`: the ends of steps (0: the beginning) at which the motion is returned, ascending.
    """

    lengths: Array
    coefficients: Array
    samples: NDArray[np.int64]

    @classmethod
    def of(cls, line: Timeline, parts: int, added: Callable[[Array], Array] | None = None) -> Steps:
        """Return the steps of a timeline, `parts` in each of its intervals.

        `added` returns what is added to its inputs at times (times x nu).
        """
        at, inverse = load_points()
        points = (np.arange(parts)[:, None] + at) / parts
        values = np.empty((len(line.which), *points.shape, len(line.H)))
        for k, h in enumerate(line.lengths):
            here = line.which == k
            readout = _readouts(line.H, line.G * h, points.ravel())
            values[here] = np.einsum("iq,tuq->itu", line.W[:-1][here], readout).reshape(values[here].shape)
        if added is not None:
            times = line.nodes[:-1, None, None] + line.lengths[line.which][:, None, None] * points
            values += added(times.ravel()).reshape(values.shape)
        values = values.reshape(len(line.which) * parts, len(at), len(line.H))
        lengths = np.repeat(line.lengths[line.which] / parts, parts)
        return cls(lengths, np.einsum("kp,spu->sku", inverse, values), line.wanted * parts)

    def at(self, step: int, theta: Array) -> Array:
        """Return the loads at parts theta of a step (theta x nu)."""
        return np.asarray(load_polynomials(theta) @ self.coefficients[step])

    def over(self, step: int, begin: float, part: float) -> Array:
        """Return the coefficients of the loads over a part of a step (degree + 1 x nu)."""
        if part == 1.0:
            return np.asarray(self.coefficients[step])
        points, inverse = load_points()
        return np.asarray(inverse @ self.at(step, begin + part * points))


def _readouts(H: Array, G: Array, parts: Array) -> Array:
    """Return ``H exp(G theta)`` for parts theta in [0, 1] (parts x nu x states)."""
    if np.abs(G).sum(axis=1).max(initial=0.0) > _MAX_SERIES_NORM:
        return np.array([H @ exponential(G, theta) for theta in parts]).reshape(len(parts), *H.shape)
    terms = [H]
    while np.abs(terms[-1]).max(initial=0.0) > 0 and len(terms) < _MAX_SERIES_TERMS:
        terms.append(terms[-1] @ G / len(terms))
    powers = np.vander(parts, len(terms), increasing=True)
    return np.asarray(np.einsum("tk,kus->tus", powers, np.array(terms)))


def load_polynomials(theta: Array) -> Array:
    """Return the polynomials of the loads at parts theta of a step (theta x degree + 1)."""
    return np.asarray(np.polynomial.chebyshev.chebvander(2 * theta - 1, LOAD_DEGREE))
