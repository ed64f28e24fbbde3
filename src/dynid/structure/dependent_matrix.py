"""Matrices that depend on unknown parameters: a constant matrix and multiples of constant patterns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.arithmetic.dependent import Dependent, Real, like_terms
from dynid.structure.matrices import Array, Matrix, combined, is_sparse


@dataclass(frozen=True, eq=False)
class DependentMatrix:
    """A matrix ``A + sum c_i P_i``: a constant one, and numbers that depend on parameters times patterns.

    Where nothing depends on parameters it is the constant matrix alone, with the arithmetic of arrays.

    Parameters
    ----------
    constant
        The part A that depends on no parameter.
    terms
        The pairs (c, P).
    """

    constant: Matrix
    terms: tuple[tuple[Dependent, Matrix], ...] = ()

    @property
    def reference(self) -> Matrix:
        """The matrix at the reference values of the parameters."""
        total = self.constant
        for coefficient, pattern in self.terms:
            total = combined(1.0, total, float(coefficient), pattern)
        return total

    def at(self, values: Any) -> Matrix:
        """Return the matrix at values of the parameters, by name; absent ones have their reference values."""
        total = self.constant
        for coefficient, pattern in self.terms:
            total = combined(1.0, total, coefficient.at(values).value, pattern)
        return total

    def __add__(self, other: DependentMatrix) -> DependentMatrix:
        return DependentMatrix(combined(1.0, self.constant, 1.0, other.constant), (*self.terms, *other.terms))

    def times(self, factor: Real) -> DependentMatrix:
        """Return the matrix times a number."""
        if not isinstance(factor, Dependent):
            scaled: Any = float(factor) * self.constant
            return DependentMatrix(scaled, tuple((c, float(factor) * pattern) for c, pattern in self.terms))
        products = tuple((factor * c, pattern) for c, pattern in self.terms)
        return DependentMatrix(0 * self.constant, ((factor, self.constant), *products))

    def congruent(self, T: DependentMatrix) -> DependentMatrix:
        """Return ``T^T A T``, of dense matrices."""
        constant: Any = T.constant.T @ self.constant @ T.constant
        if not (self.terms or T.terms):
            return DependentMatrix(constant)
        bases: list[tuple[Real, Any]] = [(1.0, T.constant), *T.terms]
        patterns: list[tuple[Real, Any]] = [(1.0, self.constant), *self.terms]
        terms = []
        for place, (a, left) in enumerate(bases):
            for b, right in bases[: place + 1]:
                for c, pattern in patterns:
                    coefficient = a * b * c
                    if isinstance(coefficient, Dependent):
                        part = left.T @ pattern @ right
                        terms.append((coefficient, part if left is right else part + part.T))
        return DependentMatrix(constant, tuple(terms))

    def merged(self) -> DependentMatrix:
        """Return the same matrix with one term for all multiples of the same expression."""
        sums: dict[int, tuple[Dependent, Any]] = {}
        found = like_terms([coefficient for coefficient, _ in self.terms])
        for (factor, core), (_, pattern) in zip(found, self.terms, strict=True):
            part = factor * pattern
            sums[id(core)] = (core, sums[id(core)][1] + part if id(core) in sums else part)
        nonzero = (term for term in sums.values() if (term[1].nnz if is_sparse(term[1]) else np.any(term[1])))
        return DependentMatrix(self.constant, tuple(nonzero))


def pattern_sum(*parts: tuple[Real, Array]) -> DependentMatrix:
    """Return the sum of numbers times constant matrices (n x n)."""
    total = DependentMatrix(parts[0][1]).times(parts[0][0])
    for factor, pattern in parts[1:]:
        total = total + DependentMatrix(pattern).times(factor)
    return total


def entries(rows: Sequence[Sequence[Real]] | Array) -> DependentMatrix:
    """Return the symmetric matrix of given entries (n x n), the upper triangle read."""
    n = len(rows)
    known = [[0.0 if isinstance(value, Dependent) else float(value) for value in row] for row in rows]
    total = DependentMatrix(np.array(known))
    for i in range(n):
        for j in range(i, n):
            value = rows[i][j]
            if isinstance(value, Dependent):
                unit = np.zeros((n, n))
                unit[i, j] = unit[j, i] = 1.0
                total = total + DependentMatrix(np.zeros((n, n)), ((value, unit),))
    return total
