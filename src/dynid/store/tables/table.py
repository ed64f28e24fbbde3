"""A table: named columns with units, whose rows come in batches."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

Kind = Literal["number", "integer", "truth", "text"]

_KINDS: dict[str, Kind] = {"b": "truth", "i": "integer", "f": "number", "O": "text"}


@dataclass(frozen=True)
class Field:
    """One column.

    Parameters
    ----------
    name
        Its name.
    kind
        What it holds. Integers and truth values may come as floats, whose NaN is a missing value.
    units
        Its SI units.
    """

    name: str
    kind: Kind = "number"
    units: str = ""


class Batches(Protocol):
    """Gives the rows of a table, some at a time: for every field an array of the same length."""

    def __call__(self) -> Iterator[list[NDArray[Any]]]:
        """Start at the first row."""


@dataclass(frozen=True)
class Table:
    """A table.

    Parameters
    ----------
    name
        Its name, without slashes.
    fields
        Its columns.
    batches
        Gives its rows. NaN and the empty text are what is missing.
    attrs
        What is known of the whole.
    """

    name: str
    fields: tuple[Field, ...]
    batches: Batches
    attrs: Mapping[str, str] = field(default_factory=dict)


def kind_of(dtype: np.dtype[Any]) -> Kind:
    """Return what values of a type are in a table; complex numbers are two columns of numbers."""
    return _KINDS.get(dtype.kind, "number")


def parts_of(name: str, dtype: np.dtype[Any], units: str) -> list[Field]:
    """Return the columns that values of a type take: one, two of complex numbers, or those of a table."""
    if dtype.names:
        return [part for column in dtype.names for part in parts_of(f"{name}.{column}", dtype[column], units)]
    if dtype.kind == "c":
        return [Field(f"{name}.re", "number", units), Field(f"{name}.im", "number", units)]
    return [Field(name, kind_of(dtype), units)]


def split(values: NDArray[Any]) -> list[NDArray[Any]]:
    """Return the columns of values, as `parts_of` names them; all axes in one."""
    flat = values.reshape(-1)
    if flat.dtype.names:
        return [part for column in flat.dtype.names for part in split(flat[column])]
    return [flat.real, flat.imag] if flat.dtype.kind == "c" else [flat]
