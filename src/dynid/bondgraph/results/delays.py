"""Results of loops with delays: what is approximate is marked, what has a true value gets it."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from dynid.bondgraph.control import close_loops
from dynid.bondgraph.exact_engine import TransferFunction
from dynid.bondgraph.plan import ReducedGraph
from dynid.bondgraph.request import Analysis
from dynid.bondgraph.results.margins import MARGINS, approximation
from dynid.result import Result, Variable

#: Groups in which delays are as they are; all others are of the graph with Padé approximants.
_TRUE = tuple(
    f"bond_graph/{name}/"
    for name in (
        *("frequency_response", "frequency_peaks", "margins", "sensitivity_functions", "root_locus"),
        *("operating_point", "need"),
    )
)
#: Arrays and verdicts of channels that approximants do not change, or that are replaced by the true ones.
_EXACT = ("/stable", "/stability", "/dc_gain", "/output", "/input", "/warnings", "/approximations")


def with_delays(result: Result, analysis: Analysis) -> Result:
    """Return a result in which what is approximate is marked, and limits and verdicts are true.

    Parameters
    ----------
    result
        Of the graph with Padé approximants.
    analysis
        The request.
    """
    text = approximation()
    true = _high_frequencies(result, analysis)
    if not result.group_attrs.get(MARGINS, {}).get("approximants_agree", True):
        stable = bool(result[f"{MARGINS}/stable"].data.all())
        verdicts = sorted(result[f"{MARGINS}/stability"].data, key=lambda text: text.startswith("stable"))
        for path in result:
            if path.startswith("bond_graph/properties/"):
                true |= {path: stable} if path.endswith("/stable") else {}
                true |= {path: verdicts[0]} if path.endswith("/stability") else {}
    found = Result(result.kind, result.title, result.attrs)
    for path, variable in result.items():
        if path in true:
            found.put(path, replace(variable, data=np.asarray(true[path], variable.data.dtype)))
        elif _approximate(path) and not path.endswith(_EXACT):
            found.put(path, _marked(variable, text))
        else:
            found.put(path, variable)
    for group, attributes in result.group_attrs.items():
        marked = {"approximate": text} if _approximate(f"{group}/") else {}
        found.annotate(group, **attributes, **marked)
    found.annotate("bond_graph", delays=f"{text} in what is a rational function; {_NOTE}")
    return found


_NOTE = "frequency responses, margins and verdicts on stability have the delays as they are"


def _approximate(path: str) -> bool:
    return path.startswith("bond_graph/") and path != "bond_graph/" and not path.startswith(_TRUE)


def _marked(variable: Variable, text: str) -> Variable:
    return replace(variable, attrs={**variable.attrs, "approximate": text})


def _high_frequencies(result: Result, analysis: Analysis) -> dict[str, Any]:
    """Return relative degrees and high-frequency gains, to which nothing with a delay contributes."""
    if not any(path.startswith("bond_graph/properties/") for path in result):
        return {}
    assert analysis.opened is not None
    base = [
        replace(loop, numerator=[Fraction(0)], delay=Fraction(0)) if loop.delayed else loop
        for loop in analysis.loops
    ]
    closed = close_loops(analysis.opened, base)
    reduced = ReducedGraph(closed.graph, analysis.inputs, analysis.outputs, traced=False)
    channels = reduced.channels()
    ratios = reduced.rational(channels.values())
    found: dict[str, Any] = {}
    for (port, source), register in channels.items():
        transfer = TransferFunction.of(ratios[register])
        for name in ("relative_degree", "high_frequency_gain"):
            path = f"bond_graph/properties/{port}/{source}/{name}"
            if path in result:
                found[path] = getattr(transfer, name)
    return found
