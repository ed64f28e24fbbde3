"""What a user asks of many samples of a graph, computed together as far as that goes.

Zeros, poles and what follows from them are computed for all samples at once; responses sample by sample, on
the plan that they share. Every number is that of `dynid.bondgraph.analysis` for the sample alone.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction

import numpy as np

from dynid.bondgraph.engines import choose
from dynid.bondgraph.garbage import no_collection
from dynid.bondgraph.graph import BondGraph
from dynid.bondgraph.question import Analysis
from dynid.bondgraph.reduced import Channel
from dynid.bondgraph.results.channels import add_channels
from dynid.bondgraph.results.responses import add_frequency_response, add_time_response
from dynid.bondgraph.sampling.columns import Column, columns
from dynid.bondgraph.sampling.engine import SampledEngine
from dynid.bondgraph.sampling.family import Family, Polynomials, Values
from dynid.errors import DynidError
from dynid.result import Result, Selection, Variable

#: Groups of results that samples are computed for together.
_CHANNELS = ("bond_graph/transfer_function/", "bond_graph/properties/")
_FREQUENCY, _TIME = "bond_graph/frequency_response/", "bond_graph/time_response/"
#: Of channels the names that the exact engine alone has the numbers for, one sample at a time.
_ALONE = frozenset(
    {"zero_error_bound", "pole_error_bound", "hidden_mode_cause", "hidden_mode_elements", "exact"}
)


def shared(wanted: Collection[str], analysis: Analysis) -> bool:
    """Tell whether samples of an analysis share enough of the work on these paths to be run together."""
    groups = (*_CHANNELS, _FREQUENCY, _TIME)
    return analysis.port is None and all(path.startswith(groups) for path in wanted)


class SampledAnalysis:
    """An analysis of many samples.

    Parameters
    ----------
    graph
        One of the graphs.
    analysis
        What is asked.
    varying
        The elements whose values vary.
    wanted
        The arrays to compute, by path; all of them `shared`.

    Raises
    ------
    Singular
        Where the equations have no unique solution whatever the values.
    """

    def __init__(
        self, graph: BondGraph, analysis: Analysis, varying: Collection[str], wanted: Collection[str]
    ) -> None:
        self.analysis, self.wanted = analysis, frozenset(wanted)
        self._family = Family(graph, analysis.inputs, analysis.outputs, tuple(varying), traced=False)
        self._responds = self._asks(_FREQUENCY, _TIME)
        self._polynomials = self._together() if self._asks(*_CHANNELS) else None

    def _together(self) -> dict[Channel, Polynomials] | None:
        """Return the channels as polynomials; None where each sample is to be solved by itself."""
        ends = {path.rpartition("/")[2] for path in self.wanted}
        if ends & _ALONE or choose(self._family.reduced, self.analysis).engine != "exact":
            return None
        found = self._family.polynomials
        explained = "hidden_modes" in self.analysis.results and "hidden_modes" in ends
        if found is None or (explained and any(one.hidden for one in found.values())):
            return None  # hidden modes stand in the order of their causes
        return found

    def run(
        self, values: Values, count: int, initial: Sequence[Mapping[str, float | Fraction]] | None = None
    ) -> list[Mapping[str, Variable] | None]:
        """Return what is wanted of every sample; None for one that is to be run alone.

        Parameters
        ----------
        values
            The values of the samples.
        count
            How many samples there are.
        initial
            Stored energy of every sample at t = 0; absent: as the analysis says.
        """
        with no_collection():
            return self._run(values, count, initial)

    def _run(
        self, values: Values, count: int, initial: Sequence[Mapping[str, float | Fraction]] | None
    ) -> list[Mapping[str, Variable] | None]:
        kept = np.flatnonzero(self._family.holds(values, count)).tolist()
        engine = self._engine({name: [column[k] for k in kept] for name, column in values.items()}, len(kept))
        known: dict[str, Column] = {}
        if engine is not None:
            known = columns(
                engine, self.analysis, {path for path in self.wanted if path.startswith(_CHANNELS)}
            )
        found: list[Mapping[str, Variable] | None] = [None] * count
        for place, sample in enumerate(kept):
            certain = engine is not None and bool(engine.certain[place])
            told = {path: column[place] for path, column in known.items()} if certain else {}
            if self._responds or not certain:
                one = {name: column[sample] for name, column in values.items()}
                stored = self.analysis.initial if initial is None else initial[sample]
                alone = self._alone(one, stored, channels=not certain)
                if alone is None:
                    continue
                told |= alone
            found[sample] = told
        return found

    def _engine(self, values: Values, count: int) -> SampledEngine | None:
        if self._polynomials is None or not count:
            return None
        return SampledEngine(self._family, self._polynomials, values, count)

    def _alone(
        self, values: Mapping[str, Fraction], initial: Mapping[str, float | Fraction], *, channels: bool
    ) -> Result | None:
        """Return what is computed of a sample by itself; None where it has no answer: alone it says why."""
        analysis, result = self.analysis, Selection("bond-graph", self.wanted)
        reduced = self._family.at(values)
        try:
            if channels and self._asks(*_CHANNELS):
                add_channels(result, reduced, analysis)
            if self._asks(_FREQUENCY) and analysis.omega is not None:
                add_frequency_response(result, reduced, analysis.omega)
            if self._asks(_TIME) and analysis.times is not None:
                add_time_response(result, reduced, analysis.times, analysis.signals, initial)
        except DynidError:
            return None
        return result

    def _asks(self, *groups: str) -> bool:
        return any(path.startswith(groups) for path in self.wanted)
