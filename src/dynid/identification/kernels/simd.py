"""Products of small matrices in whole vector registers, for kernels. Importing this loads numba.

A compiler cannot know that small arrays of unknown sizes do not overlap, and leaves most of the registers
unused. These loops keep a panel of the product in registers while they go along the sum. All columns are
padded to a multiple of `LANES` numbers; every element is one sum in ascending order, whatever the padding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple, TypeVar

import numba
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

F = TypeVar("F", bound=Callable[..., Any])
#: Numbers in a register of the widest machines; narrower ones take several.
LANES = 8
#: Rows and registers of a row that a panel holds.
_ROWS, _ACROSS = 5, 2
#: Registers that a panel of a single row holds.
_LONG = 7
_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_INDEX = ir.IntType(64)
_ZERO = ir.Constant(_VECTOR, [0.0] * LANES)


_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz"}}


def kernel(function: F) -> F:
    """Compile on first call; kept on disk for the next process where a folder for it can be written."""
    try:
        compiled: F = numba.njit(cache=True, **_OPTIONS)(function)
    except RuntimeError:  # numba finds no folder to write to
        compiled = numba.njit(**_OPTIONS)(function)
    return compiled


def inlined(function: F) -> F:
    """Compile into its callers: handing over a table of arrays takes longer than some of the work on them."""
    compiled: F = numba.njit(inline="always", **_OPTIONS)(function)
    return compiled


_alloca: Any = cgutils.alloca_once


class _Matrix(NamedTuple):
    """Numbers from a place of an array on, and how many lie between two rows."""

    data: Any
    stride: Any

    def at(self, builder: Any, row: Any, column: Any) -> Any:
        """Return the pointer to an entry."""
        return builder.gep(self.data, [builder.add(builder.mul(row, self.stride), column)])


def _matrices(context: Any, builder: Any, signature: Any, arguments: Any) -> Iterator[_Matrix]:
    """Return what triples of array, first place and stride are."""
    for k in range(0, len(arguments), 3):
        array = context.make_array(signature.args[-len(arguments) :][k])(context, builder, arguments[k])
        yield _Matrix(builder.gep(array.data, [arguments[k + 1]]), arguments[k + 2])


def _load(builder: Any, pointer: Any) -> Any:
    loaded = builder.load(builder.bitcast(pointer, _VECTOR.as_pointer()))
    loaded.align = 8
    return loaded


def _everywhere(builder: Any, number: Any) -> Any:
    """Return a register full of a number."""
    none = ir.Constant(_VECTOR, ir.Undefined)
    one = builder.insert_element(none, number, ir.IntType(32)(0))
    return builder.shuffle_vector(one, none, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))


def _fused(builder: Any, a: Any, x: Any, total: Any) -> Any:
    product = builder.fmul(a, x, flags=("contract",))
    return builder.fadd(product, total, flags=("contract",))


@contextmanager
def _groups(builder: Any, count: Any, size: int) -> Iterator[Any]:
    """Loop over whole groups; yields the first index of each."""
    with cgutils.for_range(builder, builder.udiv(count, _INDEX(size))) as loop:
        yield builder.mul(loop.index, _INDEX(size))


@contextmanager
def _rest(builder: Any, count: Any, size: int) -> Iterator[Any]:
    """Loop over what is left of groups."""
    first = builder.mul(builder.udiv(count, _INDEX(size)), _INDEX(size))
    with cgutils.for_range(builder, builder.sub(count, first)) as loop:
        yield builder.add(first, loop.index)


def _panel(
    builder: Any,
    matrices: Sequence[_Matrix],
    count: Any,
    corner: tuple[Any, Any],
    size: tuple[int, int],
    *,
    add: bool,
) -> None:
    """Set some rows and registers of a product, from a corner on."""
    A, X, out = matrices
    row, column = corner[0], builder.mul(corner[1], _INDEX(LANES))
    columns = [builder.add(column, _INDEX(LANES * c)) for c in range(size[1])]
    rows = [builder.add(row, _INDEX(r)) for r in range(size[0])]
    places = [(r, c) for r in rows for c in columns]
    sums = [_alloca(builder, _VECTOR) for _ in places]
    for total, (r, c) in zip(sums, places, strict=True):
        builder.store(_load(builder, out.at(builder, r, c)) if add else _ZERO, total)
    with cgutils.for_range(builder, count) as loop:
        across = [_load(builder, X.at(builder, loop.index, c)) for c in columns]
        each = iter(sums)
        for r in rows:
            a = _everywhere(builder, builder.load(A.at(builder, r, loop.index)))
            for x in across:
                total = next(each)
                builder.store(_fused(builder, a, x, builder.load(total)), total)
    for total, (r, c) in zip(sums, places, strict=True):
        place = builder.bitcast(out.at(builder, r, c), _VECTOR.as_pointer())
        builder.store(builder.load(total), place).align = 8


def _tiled(high: int, wide: int, *, add: bool) -> Any:
    """Return the product by panels of this size."""

    def multiply(
        _: Any,
        _rows: Any,
        _count: Any,
        _width: Any,
        A: Any,
        _a: Any,
        _lda: Any,
        X: Any,
        _x: Any,
        _ldx: Any,
        out: Any,
        _o: Any,
        _ldo: Any,
    ) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            matrices = list(_matrices(context, builder, signature, arguments[3:]))
            rows, count, width = arguments[:3]
            registers = builder.udiv(width, _INDEX(LANES))
            for over, across in ((_groups, wide), (_rest, 1))[: 1 + (wide > 1)]:
                with over(builder, registers, wide) as register:
                    for along, down in ((_groups, high), (_rest, 1))[: 1 + (high > 1)]:
                        with along(builder, rows, high) as row:
                            _panel(builder, matrices, count, (row, register), (down, across), add=add)
            return context.get_dummy_value()

        integer = types.int64
        return types.void(
            integer, integer, integer, A, integer, integer, X, integer, integer, out, integer, integer
        ), generate

    return intrinsic(multiply)


#: ``product(rows, count, width, A, a, lda, X, x, ldx, out, o, ldo)`` sets `out` (rows x width) to A (rows x
#: count) X. Each matrix is an array, the place of its first number, and the distance of its rows; no view of
#: an array is made, which would take longer than the product.
product = _tiled(_ROWS, _ACROSS, add=False)


#: ``accumulate(...)`` adds A X to it.
accumulate = _tiled(_ROWS, _ACROSS, add=True)


#: ``row_product(...)`` is `product` for few rows and many columns.
row_product = _tiled(1, _LONG, add=False)


def _dots(
    _: Any,
    _rows: Any,
    _width: Any,
    A: Any,
    _a: Any,
    _lda: Any,
    X: Any,
    _x: Any,
    _ldx: Any,
    out: Any,
    _o: Any,
    _ldo: Any,
) -> Any:
    """Set ``out[i]`` to the product of the i-th row of A with that of X (ldx 0: with its only one)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        left, right, result = _matrices(context, builder, signature, arguments[2:])
        total = _alloca(builder, _VECTOR)
        with cgutils.for_range(builder, arguments[0]) as along:
            row = along.index
            builder.store(_ZERO, total)
            with _groups(builder, arguments[1], LANES) as column:
                first, second = (_load(builder, m.at(builder, row, column)) for m in (left, right))
                builder.store(_fused(builder, first, second, builder.load(total)), total)
            summed = _summed(builder, builder.load(total))
            builder.store(summed, result.at(builder, row, _INDEX(0)))
        return context.get_dummy_value()

    integer = types.int64
    return types.void(
        integer, integer, A, integer, integer, X, integer, integer, out, integer, integer
    ), generate


#: ``dots(rows, width, A, a, lda, X, x, ldx, out, o, ldo)`` sets each number of `out` to the product of a row
#: of A with that of X; with ldx = 0, with its only one.
dots: Any = intrinsic(_dots)


def _summed(builder: Any, vector: Any) -> Any:
    """Return the sum over a register, by halves."""
    width = LANES
    while width > 1:
        width //= 2
        halves = []
        for first in (0, width):
            kind = ir.VectorType(ir.IntType(32), width)
            places = ir.Constant(kind, list(range(first, first + width)))
            halves.append(builder.shuffle_vector(vector, ir.Constant(vector.type, ir.Undefined), places))
        vector = builder.fadd(*halves)
    return builder.extract_element(vector, ir.IntType(32)(0))
