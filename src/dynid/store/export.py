"""Results in file formats of other programs: transfer functions in JSON, MATLAB files, Matrix Market, modes.

Equal results give equal bytes: no date is written.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import UsageError
from dynid.result import Result

_TRANSFER = "bond_graph/transfer_function"
_STATE_SPACE = "bond_graph/state_space"
# Most entries of an array in the answer of a result.
_MAX_ANSWER_ENTRIES = 100
_MATRICES = ("mass", "stiffness", "damping", "T")
# The header of a MATLAB file, 116 bytes.
_MATLAB_TEXT = b"MATLAB 5.0 MAT-file, written by dynid".ljust(116)


def transfer_functions_json(result: Result) -> bytes:
    """Return the transfer functions of a bond graph as JSON, by output and input.

    Polynomials in s have descending powers. Zeros and poles are pairs of real and imaginary part.

    Raises
    ------
    UsageError
        Where the result holds none.
    """
    channels: dict[str, dict[str, Any]] = {}
    for path in result:
        channel, _, name = path.removeprefix(f"{_TRANSFER}/").rpartition("/")
        if path.startswith(_TRANSFER) and name in ("numerator", "denominator", "zeros", "poles"):
            output, _, source = channel.partition("/")
            values = result[path].data.tolist()
            if result[path].data.dtype.kind == "c":
                values = [[value.real, value.imag] for value in values]
            channels.setdefault(output, {}).setdefault(source, {})[name] = values
    if not channels:
        raise UsageError(
            "the result holds no transfer functions",
            remedy="Add transfer_function to analysis.results of a bond graph.",
        )
    document = {"title": result.title, "variable": "s", "transfer_functions": channels}
    return (json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()


def answer_json(result: Result, warnings: Sequence[str]) -> str:
    """Return the answer of a result, with the warnings of its run, as one JSON object.

    Its keys are kind, title, status, answer and warnings. `answer` has every array of at most 100 entries by
    its path: numbers, Booleans, texts and nested lists of them; complex numbers are pairs of real and
    imaginary part, infinite ones the texts "inf" and "-inf", and NaN is null.
    """
    document = {
        "kind": result.kind,
        "title": result.title,
        "status": str(result.attrs.get("status", "complete")),
        "answer": {
            path: _plain(variable.data.tolist())
            for path, variable in result.items()
            if variable.data.dtype.names is None and variable.data.size <= _MAX_ANSWER_ENTRIES
        },
        "warnings": list(warnings),
    }
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain(item) for item in value]
    if isinstance(value, complex):
        return [_plain(value.real), _plain(value.imag)]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value


def matlab_file(result: Result) -> bytes:
    """Return the systems of a result as a MATLAB file (version 5).

    State equations are as of `state_space_file`; every reduction is a structure with `mass`, `stiffness`,
    `damping` and `T`, under its method's name.

    Raises
    ------
    UsageError
        Where the result holds neither.
    """
    variables: dict[str, Any] = dict(_state_space(result))
    for method, matrices in _reductions(result).items():
        variables[method.replace("-", "_")] = matrices
    if not variables:
        raise UsageError(
            "the result holds no state equations and no reduced model",
            remedy="Add state_space to analysis.results of a bond graph, or run a reduction.",
        )
    return _matlab_bytes(variables)


def state_space_file(result: Result, suffix: str) -> bytes:
    """Return the state equations of a bond graph as a MATLAB (``.mat``) or NumPy (``.npz``) file.

    Matrices `A`, `B`, `C`, `D`, and `feedthrough` (orders x outputs x inputs) where outputs follow
    derivatives of inputs; names in `states`, `inputs`, `outputs`. With delays a linear fractional form, named
    as MATLAB's `setDelayModel` has it: x' = A x + B1 u + B2 w, y = C1 x + D11 u + D12 w,
    z = C2 x + D21 u + D22 w, w_i(t) = z_i(t - tau_i).

    Raises
    ------
    UsageError
        Where the result holds none.
    """
    variables = _state_space(result)
    if not variables:
        raise UsageError(
            "the result holds no state equations",
            remedy="Add state_space to analysis.results of a bond graph, or export its scene.",
        )
    if suffix == ".mat":
        return _matlab_bytes(variables)
    stream = BytesIO()
    texts = {name: value.astype(str) for name, value in variables.items() if value.dtype.kind == "O"}
    np.savez(stream, **variables | texts)  # type: ignore[arg-type]
    return stream.getvalue()


def _state_space(result: Result) -> dict[str, NDArray[Any]]:
    """Return the matrices and names of state equations; empty without any."""
    if f"{_STATE_SPACE}/A" not in result:
        return {}
    A, B, C, D, feedthrough = (result[f"{_STATE_SPACE}/{name}"].data for name in (*"ABCD", "feedthrough"))
    variables = {"A": A, "B": B, "C": C, "D": D}
    if f"{_STATE_SPACE}/delay" in result:
        delays = result[f"{_STATE_SPACE}/delay"].data
        u, w = slice(B.shape[1] - len(delays)), slice(B.shape[1] - len(delays), None)
        y, z = slice(len(C) - len(delays)), slice(len(C) - len(delays), None)
        variables = {"A": A, "B1": B[:, u], "B2": B[:, w], "C1": C[y], "C2": C[z], "tau": delays}
        variables |= {"D11": D[y, u], "D12": D[y, w], "D21": D[z, u], "D22": D[z, w]}
    if len(feedthrough) > 1:
        variables["feedthrough"] = feedthrough
    for axis in ("state", "input", "output"):
        variables[f"{axis}s"] = np.asarray(list(result[f"{_STATE_SPACE}/{axis}"].data), dtype=object)
    return variables


def _matlab_bytes(variables: dict[str, Any]) -> bytes:
    from scipy.io import savemat

    stream = BytesIO()
    savemat(stream, variables, oned_as="column", long_field_names=True)  # type: ignore[arg-type]
    return _MATLAB_TEXT + stream.getvalue()[len(_MATLAB_TEXT) :]


def _reductions(result: Result) -> dict[str, dict[str, NDArray[Any]]]:
    matrices_of_methods: dict[str, dict[str, NDArray[Any]]] = {}
    for path in result:
        top, _, rest = path.partition("/")
        method, _, name = rest.partition("/")
        if top == "reduction" and name in _MATRICES:
            matrices_of_methods.setdefault(method, {})[name] = result[path].data
    return matrices_of_methods


def universal_modes(result: Result) -> bytes:
    """Return the modes of a modal analysis as a Universal File (data sets 55).

    Raises `UsageError` where the result holds none, or a channel names no node.
    """
    from dynid.files.universal_shapes import universal_shapes

    if "modal/shape" not in result:
        raise UsageError(
            "the result holds no modes of a modal analysis", remedy="Export the result of a modal-analysis."
        )
    frequency, damping, shape = (result[f"modal/{name}"].data for name in ("frequency", "damping", "shape"))
    names = [str(channel) for channel in result["modal/channel"].data]
    return universal_shapes(frequency, damping, shape, names, result.title)


def matrix_market_files(result: Result) -> dict[str, bytes]:
    """Return the matrices of every reduction as Matrix Market files, by file name: `serep.mass.mtx`.

    Raises `UsageError` where the result holds no reduced model.
    """
    from scipy.io import mmwrite

    reductions = _reductions(result)
    if not reductions:
        raise UsageError("the result holds no reduced model", remedy="Export the result of a reduction.")
    written = {}
    for method, matrices in reductions.items():
        for name, matrix in matrices.items():
            stream = BytesIO()
            symmetric = name != "T" and np.array_equal(matrix, matrix.T)
            mmwrite(
                stream,
                matrix,
                comment=f"{name} of {method}",
                precision=17,
                symmetry="symmetric" if symmetric else "general",
            )
            written[f"{method}.{name}.mtx"] = stream.getvalue()
    return written
