"""Results in the files of other programs: transfer functions in JSON, systems in MATLAB files, matrices.

Equal results give equal bytes: no date is written.
"""

from __future__ import annotations

import json
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import UsageError
from dynid.result import Result

_TRANSFER = "bond_graph/transfer_function"
_STATE_SPACE = "bond_graph/state_space"
_MATRICES = ("mass", "stiffness", "damping", "T")
# What a MATLAB file starts with: a text of 116 bytes.
_MATLAB_TEXT = b"MATLAB 5.0 MAT-file, written by dynid".ljust(116)


def transfer_functions_json(result: Result) -> bytes:
    """Write the transfer functions of a bond graph: output, input, polynomials in s with descending powers.

    Zeros and poles are pairs of real and imaginary part.

    Raises
    ------
    UsageError
        Where the result holds none.
    """
    found: dict[str, dict[str, Any]] = {}
    for path in result:
        channel, _, part = path.removeprefix(f"{_TRANSFER}/").rpartition("/")
        if path.startswith(_TRANSFER) and part in ("numerator", "denominator", "zeros", "poles"):
            output, _, source = channel.partition("/")
            found.setdefault(output, {}).setdefault(source, {})[part] = _plain(result[path].data)
    if not found:
        raise UsageError(
            "the result holds no transfer functions",
            remedy="Add transfer_function to analysis.results of a bond graph.",
        )
    document = {"title": result.title, "variable": "s", "transfer_functions": found}
    return (json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()


def _plain(values: NDArray[Any]) -> list[Any]:
    if values.dtype.kind == "c":
        return [[value.real, value.imag] for value in values.tolist()]
    plain: list[Any] = values.tolist()
    return plain


def matlab_file(result: Result) -> bytes:
    """Write the systems of a result as variables of a MATLAB file (version 5).

    State equations are `A`, `B`, `C`, `D` with the cells `states`, `inputs`, `outputs`; every reduction is a
    structure with `mass`, `stiffness`, `damping` and `T`, under its method's name.

    Raises
    ------
    UsageError
        Where the result holds neither.
    """
    from scipy.io import savemat

    variables = _state_equations(result)
    for method, matrices in _reductions(result).items():
        variables[method.replace("-", "_")] = matrices
    if not variables:
        raise UsageError(
            "the result holds no state equations and no reduced model",
            remedy="Add state_space to analysis.results of a bond graph, or run a reduction.",
        )
    stream = BytesIO()
    savemat(stream, variables, oned_as="column", long_field_names=True)  # type: ignore[arg-type]
    return _MATLAB_TEXT + stream.getvalue()[len(_MATLAB_TEXT) :]


def _state_equations(result: Result) -> dict[str, Any]:
    if f"{_STATE_SPACE}/A" not in result:
        return {}
    found = {name: result[f"{_STATE_SPACE}/{name}"].data for name in "ABCD"}
    for axis in ("state", "input", "output"):
        found[f"{axis}s"] = np.asarray(list(result[f"{_STATE_SPACE}/{axis}"].data), dtype=object)
    return found


def _reductions(result: Result) -> dict[str, dict[str, NDArray[Any]]]:
    """Return the matrices of every reduction, by the name it has in the result."""
    found: dict[str, dict[str, NDArray[Any]]] = {}
    for path in result:
        top, _, rest = path.partition("/")
        method, _, part = rest.partition("/")
        if top == "reduction" and part in _MATRICES:
            found.setdefault(method, {})[part] = result[path].data
    return found


def matrix_market_files(result: Result) -> dict[str, bytes]:
    """Write the matrices of every reduction in Matrix Market form, by file name: `serep.mass.mtx`.

    Raises
    ------
    UsageError
        Where the result holds no reduced model.
    """
    from scipy.io import mmwrite

    reductions = _reductions(result)
    if not reductions:
        raise UsageError("the result holds no reduced model", remedy="Export the result of a reduction.")
    written = {}
    for method, matrices in reductions.items():
        for part, matrix in matrices.items():
            stream = BytesIO()
            symmetric = part != "T" and np.array_equal(matrix, matrix.T)
            mmwrite(
                stream,
                matrix,
                comment=f"{part} of {method}",
                precision=17,
                symmetry="symmetric" if symmetric else "general",
            )
            written[f"{method}.{part}.mtx"] = stream.getvalue()
    return written
