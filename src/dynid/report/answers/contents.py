"""What arrays a result holds."""

from __future__ import annotations

from dynid.result import Result


def array_rows(result: Result) -> list[tuple[str, str, str, str]]:
    """Return path, type, axes and units of every array, in the order of the paths."""
    rows = []
    for path, variable in sorted(result.items()):
        axes = " x ".join(f"{dim} {size}" for dim, size in zip(variable.dims, variable.shape, strict=True))
        dtype = variable.dtype
        kind = "table" if dtype.names else "text" if dtype.kind == "O" else dtype.name
        rows.append((path, kind, axes, variable.units))
    return rows
