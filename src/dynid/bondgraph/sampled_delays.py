"""Sampled loops around a graph with delays, of lines or of continuous loops: verdict and margins.

There is no polynomial in z, but a function (`lti/sampled_delays.py`): its zeros are counted on the unit
circle, and crossings and peaks of a loop are bracketed by a grid that is refined where L turns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.bondgraph.controller_circuits import Loop
from dynid.bondgraph.graph import BondGraph
from dynid.bondgraph.sampled_loops import SampledLoops, outside_verdict
from dynid.errors import UsageError
from dynid.lti.grid_margins import grid_margins, lags
from dynid.lti.margins import Margins
from dynid.lti.sampled_delays import SampledDelays
from dynid.lti.stability import Verdict
from dynid.lti.state_space import StateSpace

#: Distance from the unit circle within which doubles do not decide.
_CIRCLE = 1e-9
#: Frequencies of the grid before it is refined, and its begin over the Nyquist frequency; the step of log L
#: above which it is refined, how often, and the points at which it ends.
_POINTS, _FIRST_FREQUENCY, _LARGEST_STEP, _MAX_REFINEMENTS, _MAX_POINTS = 300, 1e-5, 0.3, 12, 6000


class SampledLoopsWithDelays(SampledLoops):
    """The sampled loops of a graph with delays.

    Where delays and sample time have no common part of some size, the verdict is undecided, with the reason.
    """

    def __init__(self, opened: BondGraph, loops: Sequence[Loop]) -> None:
        super().__init__(opened, loops)
        self._grids = dict[int, tuple[Array, ComplexArray]]()
        self._undecided = Verdict("", "", 0)
        try:
            self._function = self._at(self.computations)
        except UsageError as error:
            self._undecided = Verdict("undecided", error.problem, math.nan)
            return
        gathering = self._function.gathering
        if abs(gathering - 1) < _CIRCLE:
            reason = "infinitely many discrete poles gather on the unit circle"
            self._undecided = Verdict("at the limit", reason, math.nan)
        elif gathering > 1:
            reason = f"infinitely many discrete poles gather at |z| = {gathering:.6g}"
            self._undecided = Verdict("unstable", reason, math.inf)

    @property
    def refusal(self) -> str:  # type: ignore[override]
        """Why margins are not computed; '' where they are."""
        return self._undecided.reason

    def _at(self, computations: Sequence[Fraction]) -> SampledDelays:
        A, B, C, D = (
            np.array([[float(entry.p) / float(entry.q) for entry in row] for row in rows])
            for rows in self.plant
        )
        n, ports = len(A), len(D)
        plant = StateSpace(A.reshape(n, n), B.reshape(n, ports), C.reshape(ports, n), D)
        controllers = [
            replace(controller, computation=computation)
            for controller, computation in zip(self.float_controllers(), computations, strict=True)
        ]
        return SampledDelays(plant, self.delays, controllers, self.period)

    @property
    def _shown(self) -> Verdict:
        if self.refusal:
            return self._undecided
        if (outside := self._function.outside) is None:
            nearest = min((abs(abs(pole) - 1) for pole in self.listed_poles.tolist()), default=math.inf)
            if nearest < _CIRCLE:
                reason = f"a discrete pole lies on the unit circle within {_CIRCLE:g}"
                return Verdict("at the limit", reason, math.nan)
            gathering = self._function.gathering
            reason = f"discrete poles gather at |z| = {gathering:.6g}, and their function is not resolved"
            return Verdict("undecided", reason, math.nan)
        if not outside:
            return Verdict("stable", "", 0)
        return outside_verdict(outside, float(np.abs(self.listed_poles).max(initial=1.0)))

    @property
    def listed_poles(self) -> ComplexArray:
        """The largest discrete poles."""
        return np.empty(0, complex) if self.refusal else self._function.poles

    @property
    def largest_sample_time(self) -> float:
        """It is not computed: at other sample times the delays have no common part with it."""
        return math.nan

    def confused_modes(self) -> list[tuple[complex, complex]]:
        """Modes of a graph with delays are infinitely many: none is compared."""
        return []

    def answers(self) -> Callable[[ComplexArray], ComplexArray]:
        """Return what the closed loops hold in answer to what is added to measurements, by z."""
        if self.refusal:
            raise UsageError(
                f"the frequency response of sampled loops is not computed: {self.refusal}",
                remedy="Leave it out, or choose a sample time of which the delays are small multiples.",
                names=("analysis.frequency",),
            )
        return self._function.answers

    def gain(self, number: int, omega: Array) -> ComplexArray:
        """Return L of a loop, the others closed, at frequencies, rad/s."""
        return self._function.loop(number, np.exp(1j * float(self.period) * omega))

    def _grid(self, number: int) -> tuple[Array, ComplexArray]:
        """Return frequencies up to the Nyquist frequency between which L turns by little, and L there."""
        if number in self._grids:
            return self._grids[number]
        nyquist = math.pi / float(self.period)
        parts = np.geomspace(_FIRST_FREQUENCY, 1, _POINTS), np.linspace(0, 1, _POINTS)[1:]
        omega = nyquist * np.unique(np.concatenate(parts))
        L = self.gain(number, omega)
        for _ in range(_MAX_REFINEMENTS):
            with np.errstate(divide="ignore", invalid="ignore"):
                wide = np.flatnonzero(~(np.abs(np.log(L[1:] / L[:-1])) < _LARGEST_STEP) & (L[1:] != L[:-1]))
            if not len(wide) or len(omega) > _MAX_POINTS:
                break
            middle = (omega[wide] + omega[wide + 1]) / 2
            omega = np.insert(omega, wide + 1, middle)
            L = np.insert(L, wide + 1, self.gain(number, middle))
        self._grids[number] = omega, L
        return omega, L

    def margins(self, number: int) -> Margins:
        """Return the margins of a loop, the others closed."""
        return self._judged(number, grid_margins(lambda omega: self.gain(number, omega), *self._grid(number)))

    def late_gain(
        self, number: int, computations: Sequence[Fraction]
    ) -> Callable[[ComplexArray], ComplexArray]:
        """Return L of a loop, the others closed, by z, with these computation times."""
        function = self._at(computations)
        return lambda z: function.loop(number, z)

    def crossings(self, number: int, computations: Sequence[Fraction]) -> list[tuple[float, float]]:
        """Return the phase lags, degrees, that turn L to -1 where |L| = 1, with ω, rad/s."""
        gain = self.late_gain(number, computations)
        return lags(lambda omega: gain(np.exp(1j * float(self.period) * omega)), self._grid(number)[0])
