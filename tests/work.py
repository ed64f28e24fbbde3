"""The work of a call, counted in calls of functions: what a clock would measure on an idle machine only."""

import sys
from contextlib import contextmanager

import numpy as np
import pytest

from dynid import native


def calls_of(function, *arguments):
    """Return the number of calls of functions that a call makes."""
    with at_most(calls=float("inf")) as count:
        function(*arguments)
    return count[0]


#: Operations of a dense eigenvalue problem over the cube of its size: a call takes as long as a hundred.
_EIGENVALUES = 1 / 100
#: Calls that take as long as the library does for a value of an array that it reads or writes.
_VALUES = 1 / 30


def operations_of(function, *arguments):
    """Return the number of calls that a call makes, with what dense eigenvalues and the library take."""
    cubes, values, address = [0], [0], native._address

    def counted(eigenvalues):
        def count(matrix, *more, **options):
            shape = np.shape(matrix)
            cubes[0] += np.prod(shape) * min(shape[-2:])
            return eigenvalues(matrix, *more, **options)

        return count

    def addressed(array):
        values[0] += 0 if array is None else array.size
        return address(array)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(native, "_address", addressed)
        for name in ("eigvals", "eig", "eigvalsh", "eigh", "svd"):
            patch.setattr(np.linalg, name, counted(getattr(np.linalg, name)))
        calls = calls_of(function, *arguments)
    return calls + _EIGENVALUES * cubes[0] + _VALUES * values[0]


@contextmanager
def at_most(calls):
    """Raise if the block makes more calls of functions than `calls`, at once and not at its end."""
    count = [0]

    def counter(_frame, event, _argument):
        count[0] += event in ("call", "c_call")
        assert count[0] <= calls, f"more than {calls:,} calls"

    before = sys.getprofile()
    sys.setprofile(counter)
    try:
        yield count
    finally:
        sys.setprofile(before)
