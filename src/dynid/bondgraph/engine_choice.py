"""The choice of the engine: exact while its roots are affordable, float above, or as requested."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dynid import defaults
from dynid.bondgraph.plan import ReducedGraph
from dynid.bondgraph.request import NUMERIC, Analysis
from dynid.number_format import counted

#: Up to how many storages the exact engine is chosen: on many loops, and where roots are asked for.
_LIMIT = {
    (False, False): defaults.EXACT_POLYNOMIALS,
    (False, True): defaults.EXACT_ROOTS,
    (True, False): defaults.EXACT_POLYNOMIALS_ON_LOOPS,
    (True, True): defaults.EXACT_ROOTS_ON_LOOPS,
}
_LIMITS = {
    "exact": "none: zeros and poles carry certified bounds, every verdict is decided",
    "float": (
        "zeros and poles carry error estimates, a verdict within them is left undecided; numerator and "
        "denominator are not formed, because coefficients of such degrees do not determine their roots "
        "in double precision: zeros, poles and gain do; why a mode is hidden is not said"
    ),
    "symbolic": "formulas alone: zeros, poles and verdicts need numbers",
}


@dataclass(frozen=True)
class EngineChoice:
    """An engine, and why it.

    Parameters
    ----------
    engine
        exact, float or symbolic.
    reason
        The reason, in a sentence.
    forced
        Whether the user requested it.
    """

    engine: str
    reason: str
    forced: bool = False

    @property
    def limits(self) -> str:
        """Limits of the engine."""
        return _LIMITS[self.engine]

    def attributes(self, reading: str) -> dict[str, Any]:
        """Return the attributes of a result that describe its engine."""
        return {"engine": self.engine, "engine_reason": self.reason, "engine_limits": self.limits} | {
            "reading": reading
        }

    def fallback(self, problem: str) -> EngineChoice:
        """Return the exact engine, after the float engine could not decide."""
        return EngineChoice("exact", f"{problem}; the exact engine decides")


def modelled_storages(reduced: ReducedGraph) -> int:
    """Return the number of storages behind the outputs."""
    modelled = {name for reduction in reduced.reductions.values() for name in reduction.modelled}
    return sum(name in modelled for name in reduced.storages)


def choose_engine(reduced: ReducedGraph, analysis: Analysis) -> EngineChoice:
    """Choose the engine for what is asked.

    Parameters
    ----------
    reduced
        The graph; its size is the number of storages behind the outputs.
    analysis
        What is asked, and the engine if the user named one.
    """
    if analysis.engine != "auto":
        return EngineChoice(analysis.engine, "as asked for", forced=True)
    size = modelled_storages(reduced)
    roots = bool(analysis.results & NUMERIC)
    structure = reduced.structure
    loops = len(structure.couplings) - len(structure.junctions) + 1
    looped = loops > defaults.MANY_LOOPS.value
    limit = _LIMIT[looped, roots]
    where = f" on {loops} loops" if looped else ""
    reason = f"{counted(size, 'storage')}{where}; chosen by default: {limit}"
    return EngineChoice("exact" if size <= limit.value else "float", reason)
