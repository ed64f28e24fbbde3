"""Factorisations of tall matrices: thin SVD, triangular factors, least squares of given rank."""

from __future__ import annotations

import numpy as np

from dynid.arrays import Array, finite
from dynid.native import call, compiled

# Rank of the initial states: singular values, in the scales of their prior, below this part of the largest
# are zero.
STATE_RANK = 1e-10
# Height over width of the blocks that a tall matrix is factorised by.
_BLOCK_ASPECT = 8
# Error of products of columns that one step has made nearly orthonormal, below which a second one is enough.
_MAX_PRODUCT_ERROR = 1e-2
# Most columns of matrices that the library factorises; LAPACK takes larger ones, whose calls cost it little.
_MAX_LIBRARY_COLUMNS = 32


def without_state(columns: Array, by_state: Array) -> tuple[Array, int]:
    """Return columns (rows x any) projected off those by the state (rows x n), and how many these count."""
    moved = by_state.any(axis=1)  # of triangles the first rows
    U, inside = basis(by_state[moved], STATE_RANK), columns[moved]
    inside = inside - U @ (U.T @ inside)
    projected = columns.copy()
    projected[moved] = inside - U @ (U.T @ inside)  # once more: what rounding left
    return projected, U.shape[1]


def basis(matrix: Array, rank: float) -> Array:
    """Return an orthonormal basis of the range, singular values below `rank` of the largest left out."""
    U, s, _ = thin_svd(matrix)
    return U[:, : len(s)][:, s > rank * s.max(initial=0.0)]


def thin_svd(matrix: Array) -> tuple[Array, Array, Array]:
    """Return U, s, Vt with all right singular vectors, but no more left ones than there are columns."""
    finite("the sensitivity of the record", matrix)
    if not matrix.shape[1]:
        return np.zeros((len(matrix), 0)), np.zeros(0), np.zeros((0, 0))
    if len(matrix) > _BLOCK_ASPECT * matrix.shape[1]:
        Q, R = tall_qr(matrix)
        U, s, Vt = np.linalg.svd(R)
        return Q @ U, s, Vt
    U, s, Vt = np.linalg.svd(matrix, full_matrices=matrix.shape[0] < matrix.shape[1])
    return U, s, Vt


def tall_qr(matrix: Array) -> tuple[Array, Array]:
    """Return Q and R of a matrix with more rows than columns."""
    if matrix.shape[1] <= _MAX_LIBRARY_COLUMNS:
        return _blockwise_qr(matrix)
    # By Cholesky factors of the products of columns, twice, if the columns are well conditioned: with fast
    # products alone (Y. Yamamoto et al., Electron. Trans. Numer. Anal. 44 (2015) 306–326). The inverse of a
    # factor is less accurate than a solution, which a step of refinement restores.
    with np.errstate(all="ignore"):
        products = matrix.T @ matrix
        scale = np.sqrt(products.diagonal())
    if scale.all() and np.isfinite(products).all():
        try:
            R = np.linalg.cholesky(products / np.outer(scale, scale)).T
            inverse = np.linalg.inv(R) / scale[:, None]
            R *= scale
            Q = matrix @ inverse
            rest = Q @ R
            np.subtract(matrix, rest, out=rest)
            Q += rest @ inverse
            products = Q.T @ Q
            if np.abs(products - np.eye(len(R))).max() < _MAX_PRODUCT_ERROR:
                again = np.linalg.cholesky(products).T
                return Q @ np.linalg.inv(again), np.asarray(again @ R)
        except np.linalg.LinAlgError:  # the columns are dependent
            pass
    return _blockwise_qr(matrix)


def _blockwise_qr(matrix: Array) -> tuple[Array, Array]:
    """Factorise a tall matrix block by block, then the blocks' triangles (as stable as in one go)."""
    # The blocks are small enough for one thread: on a busy machine, waiting for the others costs far more
    # than they save. J. Demmel et al., SIAM J. Sci. Comput. 34 (2012) A206–A239.
    rows, columns = matrix.shape
    height = _BLOCK_ASPECT * columns
    if rows <= height:
        Q, R = np.linalg.qr(matrix)
        return Q, R
    filled = np.concatenate([matrix, np.zeros((-rows % height, columns))])
    blocks, triangular_factors = np.linalg.qr(filled.reshape(-1, height, columns))
    Q, R = _blockwise_qr(triangular_factors.reshape(-1, columns))
    return (blocks @ Q.reshape(-1, columns, columns)).reshape(-1, columns)[:rows], R


def triangular_factors(rows: Array) -> Array:
    """Return triangles (channels x w x w) whose products with their transposes are those of the rows.

    `rows`: rows of each channel (times x channels x w).
    """
    return np.stack([_triangle(rows[:, channel]) for channel in range(rows.shape[1])])


def _triangle(matrix: Array) -> Array:
    rows, columns = matrix.shape
    height = _BLOCK_ASPECT * columns
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
    rows, columns = matrix.shape
    if columns <= _MAX_LIBRARY_COLUMNS and compiled():
        x = np.empty(columns)
        call("dynid_least_squares", rows, columns, np.column_stack([matrix, right]), float(rank), x)
        return x
    if rows > _BLOCK_ASPECT * columns:
        both = _triangle(np.column_stack([matrix, right]))
        matrix, right = both[:, :-1], both[:, -1]
    return np.asarray(np.linalg.lstsq(matrix, right, rank)[0])
