"""Structures whose modes are known in closed form, as sparse or dense matrices."""

import numpy as np
import scipy.sparse as sp


def string(n):
    """A string of n unit masses and springs, fixed at both ends: its stiffness and eigenvalues."""
    K = sp.diags_array([np.full(n - 1, -1.0), np.full(n, 2.0), np.full(n - 1, -1.0)], offsets=[-1, 0, 1])
    return sp.csc_array(K), 4 * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1))) ** 2


def free_string(n):
    """The same with free ends: one rigid-body mode."""
    ends = np.ones(n)
    ends[1:-1] = 2
    K = sp.diags_array([np.full(n - 1, -1.0), ends, np.full(n - 1, -1.0)], offsets=[-1, 0, 1])
    return sp.csc_array(K), 4 * np.sin(np.arange(n) * np.pi / (2 * n)) ** 2


def grid(n, line=string, power=1):
    """A square membrane (power 1) or plate (power 2: the Laplacian squared) of n x n masses.

    Its eigenvalues are sums of those of two strings, most of them double.
    """
    K, one = line(n)
    L = sp.csc_array(sp.kron(K, sp.eye_array(n)) + sp.kron(sp.eye_array(n), K))
    both = np.add.outer(one, one).ravel()
    for _ in range(power - 1):
        L, both = sp.csc_array(L @ L), both * both
    return L, np.sort(both)
