"""The block triangular form of a pencil: its determinant is the product of those of the diagonal blocks."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.intp]


def diagonal_blocks(pattern: Any) -> list[tuple[Indices, Indices]] | None:
    """Return rows and columns of the irreducible diagonal blocks; None for a structurally singular pattern.

    Parameters
    ----------
    pattern
        Sparse square matrix, nonzero where the pencil is.

    References
    ----------
    A. Pothen, C.-J. Fan, "Computing the block triangular form of a sparse matrix", ACM Transactions on
    Mathematical Software 16 (1990) 303-324.
    """
    from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching

    rows = pattern.tocsr()
    partner = maximum_bipartite_matching(rows, perm_type="column")
    if (partner < 0).any():
        return None
    count, label = connected_components(rows[:, partner], connection="strong")
    order = np.argsort(label, kind="stable")
    starts = np.searchsorted(label[order], np.arange(count + 1))
    return [(order[a:b], np.sort(partner[order[a:b]])) for a, b in pairwise(starts)]
