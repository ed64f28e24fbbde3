"""What a record tells about the parameters: Fisher information and the Cramér–Rao bound.

The initial state is unknown and a nuisance: the sensitivities to the parameters are projected off those to
it before they count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid.errors import NotIdentifiable
from dynid.identification.collinear import Group, collinear_groups
from dynid.lti.floating import finite

Array = NDArray[np.float64]

# Part of a parameter's effect that must be left once initial state and other parameters have taken theirs:
# sensitivities are exact to about 1e-12, and no measured record has that many digits.
_VISIBLE = 1e-8
# Initial states are told apart in the scales of their prior down to this part of the best seen one.
STATE_RANK = 1e-10
# Height over width of the blocks that a tall matrix is factorised by.
_BLOCK = 8


@dataclass(frozen=True, eq=False)
class Information:
    """Sensitivities of a record to the parameters' logarithms, free of the initial state.

    Attributes
    ----------
    names
        The parameters (p).
    projected
        Sensitivities over noise, projected off those to the initial state (values x p).
    total
        Norms of the sensitivities before projection (p).
    signal
        Norm of the predicted record over noise.
    freedom
        Number of measured values beyond those that the initial state takes.
    values
        The parameters' values (p), if they are to be told of.
    """

    names: tuple[str, ...]
    projected: Array
    total: Array
    signal: float
    freedom: int
    values: Array | None = None

    def beside(self, rows: Array) -> Information:
        """Return the information with that of independent observations (count x p) of the parameters."""
        if not len(rows):
            return self
        return Information(
            self.names,
            np.concatenate([self.projected, rows]),
            np.hypot(self.total, np.linalg.norm(rows, axis=0)),
            self.signal,
            self.freedom + len(rows),
        )

    def without(self, held: NDArray[np.bool_]) -> Information:
        """Return the information where some parameters (p) are held where they are."""
        return replace(self, projected=np.where(held, 0.0, self.projected))

    def check(self) -> None:
        """Refuse parameters that the record cannot see or tell apart.

        Raises
        ------
        NotIdentifiable
            Naming them.
        """
        if self.freedom < len(self.names):
            raise _refusal(
                list(self.names),
                "cannot be told from the unknown initial state: the record holds fewer values than unknowns",
                "Measure more samples or channels.",
            )
        unseen = np.linalg.norm(self.projected, axis=0) <= _VISIBLE * np.maximum(
            self.total, _VISIBLE * self.signal
        )
        if unseen.any():
            raise _refusal(
                self._named(unseen),
                "cannot be seen in this record",
                "Excite or measure where the joint works.",
            )
        _, s, Vt = thin_svd(self.projected / np.linalg.norm(self.projected, axis=0))
        s = np.concatenate([s, np.zeros(len(Vt) - len(s))])
        blind = Vt[s <= _VISIBLE * s[0]]
        if len(blind):
            involved = np.abs(blind).max(axis=0) > 1e-3
            raise _refusal(
                self._named(involved),
                f"cannot be told apart in this record{self._shown()}",
                "Fix some of them at a value, or add channels, samples or excitation frequencies.",
            )

    def groups(self, level: float = _VISIBLE) -> list[Group]:
        """Return the groups of parameters that are not told apart, as `collinear_groups` does."""
        values = np.ones(len(self.names)) if self.values is None else self.values
        return collinear_groups(self.names, values, self.projected, level)

    def _shown(self) -> str:
        """Say what the record shows of parameters that it does not tell apart."""
        shown = [group.seen for group in self.groups() if group.seen]
        return f", which shows only {' and '.join(shown)}" if shown and self.values is not None else ""

    def covariance(self) -> Array:
        """Return the Cramér–Rao bound on the covariance of the logarithms (p x p)."""
        root = self.root()
        return np.asarray(root @ root.T)

    def root(self) -> Array:
        """Return a root of that covariance (p x p)."""
        return self._root

    @cached_property
    def _root(self) -> Array:
        size = np.linalg.norm(self.projected, axis=0)
        R = np.linalg.qr(self.projected / size, mode="r")
        return np.asarray(np.linalg.solve(R, np.eye(len(size))) / size[:, None])

    def deviations(self) -> Array:
        """Return the lower bound on the standard deviations of the logarithms (p)."""
        return np.sqrt(self.covariance().diagonal())

    def correlation(self) -> Array:
        """Return the correlations of the estimates of the logarithms (p x p)."""
        covariance = self.covariance()
        deviations = np.sqrt(covariance.diagonal())
        correlation = np.clip(covariance / np.outer(deviations, deviations), -1.0, 1.0)
        np.fill_diagonal(correlation, 1.0)
        return np.asarray(correlation)

    def condition(self) -> float:
        """Return the condition number of the information scaled to unit diagonal."""
        _, s, _ = thin_svd(self.projected / np.linalg.norm(self.projected, axis=0))
        return float((s[0] / s[-1]) ** 2)

    def step(self, residual: Array) -> Array:
        """Return the Gauss–Newton step of the logarithms that this residual over noise (values) asks for."""
        size = np.linalg.norm(self.projected, axis=0)
        size = np.where(size > 0, size, 1.0)
        rank = float(len(residual) * np.finfo(float).eps)
        return np.asarray(least_squares(self.projected / size, residual, rank) / size)

    def _named(self, chosen: NDArray[np.bool_]) -> list[str]:
        return [name for name, yes in zip(self.names, chosen, strict=True) if yes]


def information(
    names: tuple[str, ...], by_parameter: Array, by_state: Array, signal: float, values: int
) -> Information:
    """Collect the information of a record.

    Parameters
    ----------
    names
        The parameters (p).
    by_parameter, by_state
        Sensitivities over noise, or a triangle of them (rows x p, rows x n), the states in the units of their
        prior.
    signal
        Norm of the predicted values over noise.
    values
        How many values there are.
    """
    U, s, _ = thin_svd(by_state)
    U = U[:, : len(s)][:, s > STATE_RANK * s.max(initial=0.0)]
    projected = by_parameter - U @ (U.T @ by_parameter)
    projected -= U @ (U.T @ projected)  # once more: what rounding left
    total = np.linalg.norm(by_parameter, axis=0)
    return Information(names, projected, total, signal, values - U.shape[1])


def joined(parts: Sequence[Information]) -> Information:
    """Return the information of several records together, whose initial states are each their own."""
    return Information(
        parts[0].names,
        np.concatenate([part.projected for part in parts]),
        np.linalg.norm([part.total for part in parts], axis=0),
        float(np.linalg.norm([part.signal for part in parts])),
        sum(part.freedom for part in parts),
        parts[0].values,
    )


def thin_svd(matrix: Array) -> tuple[Array, Array, Array]:
    """Return U, s, Vt with all right singular vectors, but no more left ones than there are columns."""
    finite("the sensitivity of the record", matrix)
    if not matrix.shape[1]:
        return np.zeros((len(matrix), 0)), np.zeros(0), np.zeros((0, 0))
    if len(matrix) > _BLOCK * matrix.shape[1]:
        Q, R = _tall_qr(matrix)
        U, s, Vt = np.linalg.svd(R)
        return Q @ U, s, Vt
    U, s, Vt = np.linalg.svd(matrix, full_matrices=matrix.shape[0] < matrix.shape[1])
    return U, s, Vt


def _tall_qr(matrix: Array) -> tuple[Array, Array]:
    """Factorise a tall matrix block by block, then the blocks' triangles (as stable as in one go).

    The blocks are small enough for one thread: on a busy machine, waiting for the others costs far more
    than they save. J. Demmel et al., SIAM J. Sci. Comput. 34 (2012) A206–A239.
    """
    rows, columns = matrix.shape
    height = _BLOCK * columns
    if rows <= height:
        Q, R = np.linalg.qr(matrix)
        return Q, R
    filled = np.concatenate([matrix, np.zeros((-rows % height, columns))])
    blocks, triangles = np.linalg.qr(filled.reshape(-1, height, columns))
    Q, R = _tall_qr(triangles.reshape(-1, columns))
    return (blocks @ Q.reshape(-1, columns, columns)).reshape(-1, columns)[:rows], R


def triangles(rows: Array) -> Array:
    """Return triangles (channels x w x w) whose products with their transposes are those of the rows.

    Parameters
    ----------
    rows
        Rows of each channel (times x channels x w).
    """
    return np.stack([_triangle(rows[:, channel]) for channel in range(rows.shape[1])])


def _triangle(matrix: Array) -> Array:
    rows, columns = matrix.shape
    height = _BLOCK * columns
    if rows > height:
        filled = np.concatenate([matrix, np.zeros((-rows % height, columns))])
        blocks = np.linalg.qr(filled.reshape(-1, height, columns), mode="r")
        return _triangle(np.asarray(blocks).reshape(-1, columns))
    R = np.linalg.qr(matrix, mode="r")
    return np.concatenate([R, np.zeros((columns - len(R), columns))])


def least_squares(matrix: Array, right: Array, rank: float) -> Array:
    """Return the shortest least-squares solution, singular values below `rank` of the largest left out."""
    finite("the sensitivity of the record", matrix)
    finite("the record", right)
    if len(matrix) > _BLOCK * matrix.shape[1]:
        both = _triangle(np.column_stack([matrix, right]))
        matrix, right = both[:, :-1], both[:, -1]
    return np.asarray(np.linalg.lstsq(matrix, right, rank)[0])


def untold(names: list[str]) -> NotIdentifiable:
    """Return the error that names parameters whose effect drowns in the noise."""
    return _refusal(
        names,
        "cannot be told by this record: the effect drowns in the noise",
        "Excite or measure where the joint works, measure longer or with less noise, or fix some at a value.",
    )


def _refusal(names: list[str], why: str, remedy: str) -> NotIdentifiable:
    return NotIdentifiable(f"{', '.join(names)} {why}", remedy=remedy, names=names)
