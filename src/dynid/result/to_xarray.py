"""Groups of a result as datasets of xarray."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dynid.errors import UsageError
from dynid.words import did_you_mean

if TYPE_CHECKING:
    import xarray

    from dynid.result import Result, Variable


def dataset(result: Result, group: str) -> xarray.Dataset:
    """Return the arrays directly in a group, with the coordinates they use (`Result.to_xarray`)."""
    import xarray

    group = group.strip("/")
    held = {path: variable for path, variable in result.items() if path.rpartition("/")[0] == group}
    if not held:
        groups = sorted({path.rpartition("/")[0] for path in result})
        raise UsageError(
            f"the result has no arrays in '{group}'{did_you_mean(group, groups)}",
            remedy="`dynid show --all` lists every array.",
        )
    arrays = {path.rpartition("/")[2]: _array(variable) for path, variable in held.items()}
    for variable in held.values():
        for dim, length in zip(variable.dims, variable.data.shape, strict=True):
            if dim not in arrays and (found := _coordinate(result, group, dim, length)) is not None:
                arrays[dim] = _array(found)
    attrs: dict[str, Any] = dict(result.group_attrs.get(group, {}))
    return xarray.Dataset(arrays, attrs={"title": result.title, **attrs})


def _array(variable: Variable) -> tuple[tuple[str, ...], Any, dict[str, Any]]:
    units = {"units": variable.units} if variable.units else {}
    return variable.dims, variable.data, {**variable.attrs, **units}


def _coordinate(result: Result, group: str, dim: str, length: int) -> Variable | None:
    """Find the coordinate of a dimension in the nearest group above."""
    while group:
        group = group.rpartition("/")[0]
        found = result.get(f"{group}/{dim}" if group else dim)
        if found is not None and found.dims == (dim,):
            return found if found.data.size == length else None
    return None
