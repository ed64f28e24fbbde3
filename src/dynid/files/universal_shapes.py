"""Mode shapes written as a Universal File: data sets 55 of complex modes at nodes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.errors import UsageError
from dynid.structure.labels import DIRECTIONS, node_direction

# Codes of a data set 55: structural model, complex eigenvalues, translations at nodes, displacements, complex
# numbers; numbers of whole and real numbers of records 7 and 8 for this analysis.
_HEAD, _WHOLE, _REAL = (1, 3, 2, 8, 5, 3), 2, 6
#: Direction of a DOF that is a number alone.
DIRECTION = "z"


def universal_shapes(
    omega: Array, damping: Array, shapes: ComplexArray, dofs: Sequence[str], title: str
) -> bytes:
    """Return a Universal File of modes.

    Parameters
    ----------
    omega, damping
        Natural frequencies (rad/s) and damping ratios (n).
    shapes
        Mode shapes (n x dofs), of unit modal a or any other scale.
    dofs
        Names of the DOFs: node and direction (``12:z``), or a node's number alone, whose direction is z.
    title
        Text of the first line of each data set.

    Raises
    ------
    UsageError
        Where a name has no node, or is of a rotation: pyuff takes the two lines of six complex numbers of a
        node for damaged.
    """
    ends = [_end(dof) for dof in dofs]
    nodes = list(dict.fromkeys(node for node, _ in ends))
    values = np.zeros((len(omega), len(nodes), 3), dtype=complex)
    for column, (node, along) in enumerate(ends):
        values[:, nodes.index(node), DIRECTIONS.index(along)] = shapes[:, column]
    poles = omega * (-damping + 1j * np.sqrt(1 - damping**2))
    lines: list[str] = []
    for mode, (pole, shape) in enumerate(zip(poles.tolist(), values, strict=True), 1):
        about = (title, f"mode {mode}, {abs(pole) / (2 * np.pi):.6g} Hz", "NONE", "NONE", "NONE")
        lines += [f"{-1:6d}", f"{55:6d}", *(f"{line[:80]:<80}" for line in about)]
        lines += [_integers(_HEAD), _integers((_WHOLE, _REAL, 0, mode))]
        lines += _numbers([pole.real, pole.imag, 1.0, 0.0, 0.0, 0.0])
        for node, row in zip(nodes, shape, strict=True):
            lines += [_integers((node,)), *_numbers(np.column_stack([row.real, row.imag]).ravel().tolist())]
        lines.append(f"{-1:6d}")
    return ("\n".join(lines) + "\n").encode("ascii", errors="replace")


def _end(dof: str) -> tuple[int, str]:
    """Return node and direction of a DOF."""
    end = (int(dof), DIRECTION) if dof.isdecimal() else node_direction(dof)
    if end is None or not isinstance(end[0], int):
        raise UsageError(
            f"the DOF {dof} has no number of a node, which a Universal File needs",
            remedy="Name the channels of the scene NODE:DIR, such as 12:z.",
        )
    if end[1] not in DIRECTIONS[:3]:
        raise UsageError(
            f"the DOF {dof} is a rotation; only translations are written",
            remedy="Leave the channel out of the analysis.",
        )
    return end[0], end[1]


def _integers(values: Sequence[int]) -> str:
    return "".join(f"{value:10d}" for value in values)


def _numbers(values: Sequence[float]) -> Iterator[str]:
    """Yield lines of six numbers, of six digits."""
    for start in range(0, len(values), 6):
        yield "".join(f"{value:13.5E}" for value in values[start : start + 6])
