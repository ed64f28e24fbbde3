"""The numbers of a study that figures show: what varied, and what was gathered."""

from __future__ import annotations

from functools import cached_property
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.report.numbers import labelled
from dynid.study.analysis.table import StudyTable
from dynid.words import short_paths

if TYPE_CHECKING:
    from dynid.result import Result

Floats = NDArray[np.float64]
#: Most entries of an array that are shown one by one, those of the longest array that has any shown, and
#: most numbers of all.
ENTRIES, LONGEST, COLUMNS = 8, 64, 24
#: Relative differences that are rounding.
_ROUNDING = 1e-12


class Number(NamedTuple):
    """One number of each sample: its short name, its full name, its units and values."""

    name: str
    path: str
    units: str
    values: Floats

    @property
    def label(self) -> str:
        """Its name with units."""
        return labelled(self.name, self.units)


class StudyNumbers:
    """The numbers of a study.

    Parameters
    ----------
    result
        Of a study.
    """

    def __init__(self, result: Result) -> None:
        self.table = StudyTable(result)

    @cached_property
    def inputs(self) -> list[Number]:
        """What varied and is a number, in the order of the names."""
        varied = {
            name: column.astype(float)
            for name, column in self.table.inputs.items()
            if column.dtype.kind in "bif" and len(column) and (column != column[0]).any()
        }
        names = dict(zip(varied, short_paths(list(varied)), strict=True))
        return [Number(names[path], path, "", values) for path, values in varied.items()]

    @cached_property
    def outputs(self) -> list[Number]:
        """What was gathered, is a number and varies."""
        found: list[Number] = []
        magnitudes = set()
        for path in sorted(filter(self.table.is_number, self.table.paths)):
            if self.table.size(path) > LONGEST or len(found) >= COLUMNS:
                continue
            for column in islice(self.table.columns(path), ENTRIES):
                known = column.values[np.isfinite(column.values)]
                if known.size > 1 and np.ptp(known) > _ROUNDING * np.abs(known).max():
                    found.append(Number(column.name, column.name, column.units, column.values))
                    if self.table.variable(path).dtype.kind == "c":
                        magnitudes.add(column.name)
        found = found[:COLUMNS]
        names = _ends([number.name for number in found])
        return [
            number._replace(name=f"|{name}|" if number.path in magnitudes else name)
            for number, name in zip(found, names, strict=True)
        ]


def _ends(paths: list[str]) -> list[str]:
    """Return the shortest ends of HDF5 paths that tell them apart."""
    for count in range(1, max((path.count("/") for path in paths), default=0) + 2):
        ends = ["/".join(path.split("/")[-count:]) for path in paths]
        if len(set(ends)) == len(ends):
            return ends
    return paths
