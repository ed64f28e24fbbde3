"""Kernels compiled by numba, and the choice of when they are used.

Compilation takes ten seconds, once; loading the compiled kernels takes three quarters of a second in every
process, and a pass over a thousand samples a twentieth. So the kernels are used for long records, and on
request: the environment variable DYNID_COMPILED is 1 (always), 0 (never) or auto (default). The choice
depends on the sizes of the problem alone, never on earlier runs or on kernels that are compiled already: the
same problem gives the same bytes. Of a study, all samples count.

Whole runs of configs/table2.yaml in fresh processes, kernels compiled before, s of the processor:

| samples | 800 | 2,000 | 8,000 | 20,000 | 80,000 |
|---|---|---|---|---|---|
| without | 0.89 | 0.77 | 1.40 | 2.08 | 6.6 |
| with | 1.66 | 1.52 | 1.75 | 1.84 | 2.4 |

They cross at 14,000 samples; the threshold is 18,000, to allow for the compilation.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from dynid.defaults import COMPILED
from dynid.errors import UsageError

VARIABLE = "DYNID_COMPILED"
# Seconds of a pass without kernels, linearised at every sample, from which on compiling repays.
_REPAYS = COMPILED.value
# Seconds a node without kernels: calls, and multiplications of the exponential with its derivatives.
_CALLS, _FLOP = 1.2e-4, 2e-9
# Seconds that loading kernels takes, and how many times faster they are on long records.
_LOADED, _FASTER = 1.0, 8.0


_REPEATS: ContextVar[int] = ContextVar("repeats", default=1)


@contextmanager
def repeated(times: int) -> Iterator[None]:
    """Count every pass so many times in this context, in which so many identifications are alike."""
    token = _REPEATS.set(times)
    try:
        yield
    finally:
        _REPEATS.reset(token)


def compiled(nodes: int, size: int, parameters: int) -> bool:
    """Return True if a pass is to be compiled.

    Parameters
    ----------
    nodes
        Steps of the pass.
    size
        States of the model and of the signals' generators.
    parameters
        Number of parameters.

    Raises
    ------
    UsageError
        If the environment variable has another value.
    """
    wish = os.environ.get(VARIABLE, "auto")
    if wish not in ("0", "1", "auto"):
        raise UsageError(f"{VARIABLE} is {wish!r}", remedy="Set it to 0, 1 or auto.", names=(VARIABLE,))
    if wish != "auto":
        return wish == "1"
    return _REPEATS.get() * nodes * (_CALLS + _FLOP * _products(size, parameters)) > _REPAYS


def pass_seconds(nodes: int, size: int, parameters: int) -> float:
    """Return about how long a pass takes: without kernels where it is not compiled, else with them.

    Steps are linearised anew at a small part of the samples, which `compiled` does not count on.

    Parameters
    ----------
    nodes, size, parameters
        As of `compiled`.
    """
    alone = nodes * (_CALLS / 2 + _FLOP / 20 * _products(size, parameters))
    return _LOADED + alone / _FASTER if compiled(nodes, size, parameters) else alone


def _products(size: int, parameters: int) -> int:
    """Return the multiplications of the exponential with its derivatives."""
    return 6 * (1 + 2 * parameters) * size**3
