"""Compiled modules as the plain Python that they are written in: interpreted, every index is checked.

Machine code checks none: an index past the end reads or spoils what lies there, which a comparison of results
may never show.
"""

import importlib.util
import sys
from fractions import Fraction
from importlib import import_module

import numba
import numpy as np

from dynid.identification.kernels import simd

PROGRAMS = "dynid.bondgraph.program"
KERNELS = "dynid.identification.kernels"


def fresh(patch, package, *names):
    """Load modules of a package anew, in this order; until the patches are undone they are those imported."""
    for name in names:
        spec = importlib.util.find_spec(f"{package}.{name}")
        module = importlib.util.module_from_spec(spec)
        patch.setitem(sys.modules, f"{package}.{name}", module)
        patch.setattr(import_module(package), name, module, raising=False)
        spec.loader.exec_module(module)
    return [sys.modules[f"{package}.{name}"] for name in names]


# --- doubled precision -----------------------------------------------------------------------------


class Serial:
    """Stands for a pool of threads."""

    def __init__(self, _workers):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    map = staticmethod(map)


def fused(a, b, c):
    """Return a b + c with one rounding."""
    try:
        return np.float64(float(Fraction(float(a)) * Fraction(float(b)) + Fraction(float(c))))
    except (ValueError, OverflowError):  # infinite or not a number, or to be
        return np.float64(a) * b + c


def interpreted_sweep(patch, lanes_of_a_block=4):
    """Return `sweep_frequencies`, interpreted."""
    patch.setattr(numba, "njit", lambda function, **_: function)
    patch.setattr("numba.extending.intrinsic", lambda _: fused)
    doubled, compiler = fresh(patch, PROGRAMS, "doubled", "compiler")
    patch.setattr(doubled, "LANES", lanes_of_a_block)
    patch.setattr(compiler, "LANES", lanes_of_a_block)
    patch.setattr(compiler, "ThreadPoolExecutor", Serial)
    return compiler.sweep_frequencies


# --- identification --------------------------------------------------------------------------------


def matrix(array, first, stride, rows, columns):
    """Return a matrix inside an array; outside is an error."""
    assert array.flags.c_contiguous
    flat = array.reshape(-1)
    assert first >= 0
    assert rows == 0 or first + (rows - 1) * stride + columns <= flat.size
    step = flat.itemsize
    return np.lib.stride_tricks.as_strided(flat[first:], (rows, columns), (stride * step, step))


def product(rows, count, width, A, a, lda, X, x, ldx, out, o, ldo):
    assert width % simd.LANES == 0
    matrix(out, o, ldo, rows, width)[:] = matrix(A, a, lda, rows, count) @ matrix(X, x, ldx, count, width)


def accumulate(rows, count, width, A, a, lda, X, x, ldx, out, o, ldo):
    assert width % simd.LANES == 0
    matrix(out, o, ldo, rows, width)[:] += matrix(A, a, lda, rows, count) @ matrix(X, x, ldx, count, width)


def dots(rows, width, A, a, lda, X, x, ldx, out, o, ldo):
    assert width % simd.LANES == 0
    both = matrix(A, a, lda, rows, width) * matrix(X, x, ldx, rows, width)
    matrix(out, o, ldo, rows, 1)[:, 0] = both.sum(axis=1)


def interpreted_kernels(patch):
    """Return the kernels' modules, interpreted: steps, filter and prediction."""
    for name in ("kernel", "inlined"):
        patch.setattr(simd, name, lambda function: function)
    for name, stand_in in {
        "product": product, "row_product": product, "accumulate": accumulate, "dots": dots,
    }.items():  # fmt: skip
        patch.setattr(simd, name, stand_in)
    return fresh(patch, KERNELS, "steps", "filter_kernel", "prediction_kernel")
