"""Minimal realisations of linear systems in exact arithmetic (Kalman 1963)."""

from __future__ import annotations

from typing import Any, NamedTuple

#: Modulus of the test whether a system is controllable: what has full rank there has it.
_PRIME = (1 << 61) - 1

Rows = list[list[Any]]


class ExactSystem(NamedTuple):
    """x' = A x + B u, y = C x + D u, of exact numbers (flint `fmpq`)."""

    A: Rows
    B: Rows
    C: Rows
    D: Rows


def minimal(plant: ExactSystem) -> ExactSystem:
    """Return the part of a system that its inputs reach and its outputs show, exactly."""
    return _transposed(_reached(_transposed(_reached(plant))))


def _transposed(plant: ExactSystem) -> ExactSystem:
    A, B, C = plant.A, plant.B, plant.C
    return ExactSystem(
        [*map(list, zip(*A, strict=True))],
        [*map(list, zip(*C, strict=True))] if A else [],
        [*map(list, zip(*B, strict=True))] if A else [[] for _ in plant.D[0]],
        [*map(list, zip(*plant.D, strict=True))],
    )


def _reached(plant: ExactSystem) -> ExactSystem:
    """Return the part of a system that its inputs reach: on a basis of B, A B, A^2 B and so on."""
    from flint import fmpq_mat, nmod_mat

    n = len(plant.A)
    if not n:
        return plant

    def krylov(A: Any, block: Any) -> list[Any]:
        blocks = [block]
        for _ in range(n - 1):
            blocks.append(A * blocks[-1])
        return [[entry for block in blocks for entry in block.tolist()[i]] for i in range(n)]

    def residues(rows: Rows) -> Any:
        return nmod_mat(
            [[int(x.p) * pow(int(x.q), -1, _PRIME) % _PRIME for x in row] for row in rows], _PRIME
        )

    if nmod_mat(krylov(residues(plant.A), residues(plant.B)), _PRIME).rank() == n:
        return plant
    A, columns = fmpq_mat(plant.A), fmpq_mat(krylov(fmpq_mat(plant.A), fmpq_mat(plant.B)))
    if not (columns_kept := _pivots(columns)):
        return ExactSystem([], [], [[] for _ in plant.C], plant.D)
    basis = fmpq_mat([[row[k] for k in columns_kept] for row in columns.tolist()])
    rows_kept = _pivots(basis.transpose())
    square = fmpq_mat([basis.tolist()[k] for k in rows_kept])

    def coordinates(matrix: Any) -> Any:
        return square.solve(fmpq_mat([matrix.tolist()[k] for k in rows_kept])).tolist()

    C = (fmpq_mat(plant.C) * basis).tolist()
    return ExactSystem(coordinates(A * basis), coordinates(fmpq_mat(plant.B)), C, plant.D)


def _pivots(matrix: Any) -> list[int]:
    """Return independent columns of a matrix that span all of them."""
    echelon, rank = matrix.rref()
    return [next(k for k, entry in enumerate(row) if entry != 0) for row in echelon.tolist()[:rank]]
