"""Requests to a bond graph: results, engines, formulas and parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, Literal, get_args

from dynid.bondgraph.graph import Bond, Port

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid.lti.generator import Signal


ResultName = Literal[
    "transfer_function",
    "zeros",
    "poles",
    "properties",
    "hidden_modes",
    "sensitivities",
    "reduction",
    "prototype",
    "causality",
    "state_space",
    "frequency_response",
    "time_response",
]

#: The results that can be asked for, in the order of the report.
RESULTS: tuple[ResultName, ...] = get_args(ResultName)

#: What is computed when nothing in particular is asked for, beside the responses.
USUAL: frozenset[ResultName] = frozenset({"transfer_function", "zeros", "poles", "properties", "reduction"})


Engine = Literal["auto", "exact", "float", "symbolic"]
Reading = Literal["decimal", "binary"]
FormulaForm = Literal["nested", "expanded"]

#: The engines themselves; `auto` is a choice among them.
ENGINES = tuple(name for name in get_args(Engine) if name != "auto")

#: Results that the symbolic engine has no numbers for.
NUMERIC: frozenset[ResultName] = frozenset({"zeros", "poles", "properties", "hidden_modes"})


@dataclass(frozen=True)
class FormulaRequest:
    """The formulas to write.

    Parameters
    ----------
    form
        nested: the reduction's program as named assignments, never expanded; expanded: numerator and
        denominator as polynomials, too.
    terms
        Most terms of a polynomial before the expansion is given up.
    """

    form: FormulaForm = "nested"
    terms: int = 100_000


@dataclass(frozen=True)
class SensitivityParameter:
    """A parameter that sensitivities are taken by: the value of a node, or one behind several values.

    Parameters
    ----------
    name
        Its name.
    value
        Its value.
    rates
        The derivative of each node's value by it, for the nodes that depend on it.
    """

    name: str
    value: Fraction
    rates: Mapping[str, Fraction]


@dataclass(frozen=True, eq=False)
class Analysis:
    """The results to compute, and their settings.

    Parameters
    ----------
    inputs
        Sources kept as inputs; all others are zero.
    outputs
        Variables asked for.
    results
        Names out of `RESULTS`.
    omega
        Angular frequencies of the frequency response, rad/s.
    times
        Times of the time response, s, starting at 0.
    signals
        What drives the time response: pairs of an input and a signal; those of one input add up.
    initial
        Stored energy at t = 0: the flow of an I, the effort of a C.
    parameters
        What sensitivities are taken by; absent: the value of every node.
    engine
        exact (roots with certified bounds, everything decided), float (eigenvalues with error estimates, for
        large graphs), symbolic (formulas alone), or auto: chosen by size.
    reading
        What a value means: the decimal as it is written, or the double nearest to it.
    formulas
        FormulaRequest to write beside the transfer function; None: its formula where it is short.
    port
        A bond at which the graph is decomposed, written from the source to the load; absent: nowhere.
    """

    inputs: tuple[str, ...]
    outputs: tuple[Port, ...]
    results: frozenset[str] = USUAL
    omega: NDArray[np.float64] | None = None
    times: NDArray[np.float64] | None = None
    signals: tuple[tuple[str, Signal], ...] = ()
    initial: Mapping[str, float | Fraction] = field(default_factory=dict)
    parameters: tuple[SensitivityParameter, ...] | None = None
    engine: Engine = "auto"
    reading: Reading = "decimal"
    formulas: FormulaRequest | None = None
    port: Bond | None = None
