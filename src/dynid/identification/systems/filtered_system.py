"""A system whose channels pass stated filters of their instruments: its states are extended by theirs.

A filter ``z' = a z + b y``, output ``c z + d y``, adds its states to those of the model; in frequency its
response multiplies the channel's. Its corner, of which a and b are functions, may depend on parameters: all
derivatives are exact. Initial states of filters are unknown, as those of the model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.dependent import evaluated
from dynid.arrays import Array, ComplexArray
from dynid.errors import UsageError
from dynid.identification.systems.linear_system import LinearSystem, Pairs, Responses, StateVariable
from dynid.lti.filters import Filter
from dynid.lti.state_space import Matrices, StateSpace
from dynid.parameters import Parameter

Filters = Sequence[Sequence[Filter]]
"""The filters of each channel, in their order."""


def filters_of(channels: Sequence[Any]) -> Filters:
    """Return the filters of channels."""
    return [getattr(channel, "filters", ()) for channel in channels]


def not_nonlinear() -> UsageError:
    """Return the error about filters of a structure with nonlinear joints."""
    return UsageError(
        "the channels have filters, which are not described behind nonlinear laws of joints",
        remedy="Leave the filters out where they do not act in the band, or the laws.",
        names=("measurement.channels",),
    )


class FilteredSystem(LinearSystem):
    """A system behind filters.

    Parameters
    ----------
    system
        The system without them.
    channels
        Its channels, for their names and units.
    filters
        The filters of each channel.
    further
        Unknown parameters of filters beside those of the system.
    """

    def __init__(
        self,
        system: LinearSystem,
        channels: Sequence[Any],
        filters: Filters,
        further: Sequence[Parameter] = (),
    ) -> None:
        self.system, self.filters = system, filters
        self.unknowns = (*system.unknowns, *further)
        self.considered, self.signals = system.considered, system.signals
        self.further = frozenset(unknown.name for unknown in further)
        names = [unknown.name for unknown in self.unknowns]
        self._places = {name: place for place, name in enumerate(names)}
        states = [
            StateVariable(f"{channel.name} {item.kind.replace('_', '-')} {k}", channel.unit)
            for channel, of_channel in zip(channels, filters, strict=True)
            for item in of_channel
            for k in range(1, item.order + 1)
        ]
        self.states = (*system.states, *states)

    @property
    def unfiltered(self) -> LinearSystem:
        """The system without the filters."""
        return self.system

    def check(self) -> None:
        """Check the system."""
        self.system.check()

    def at(self, values: Mapping[str, float]) -> Matrices:
        """Return the matrices of the system with its filters."""
        affine = self.system.affine  # their sums are cheaper than matrices assembled anew
        if affine is None:
            matrices = self.system.at(self._of_system(values))
        else:
            matrices = affine.at(np.array([values[unknown.name] for unknown in self.system.unknowns]))
        if self.further:
            slopes = (
                np.concatenate([slope, np.zeros((len(self.further), *slope.shape[1:]))])
                for slope in matrices[4:]
            )
            matrices = Matrices(*matrices[:4], *slopes)
        for channel, of_channel in enumerate(self.filters):
            for item in of_channel:
                matrices = self._behind(matrices, channel, item, values)
        return matrices

    def _behind(
        self, matrices: Matrices, channel: int, item: Filter, values: Mapping[str, float]
    ) -> Matrices:
        """Return the matrices with one more filter behind a channel."""
        A, B, C, D, dA, dB, dC, dD = matrices
        if D[1:, channel].any():
            raise UsageError(
                "a channel with a filter follows a derivative of the excitation, which enters no state",
                remedy="Measure another quantity there, or leave the filter out.",
                names=("measurement.channels",),
            )
        corner, slopes = self._corner(item, values)
        a, b, c, d, by_a, by_b = item.matrices(corner)
        n, m, p = len(A), len(a), len(dA)

        def extended(A: Array, B: Array, C: Array, D: Array, moved: Array | None = None) -> Any:
            """Return the blocks of values, or with `moved` of slopes (p), whose corner moves by it."""
            lead = A.shape[:-2]
            wide = np.zeros((*lead, n + m, n + m))
            wide[..., :n, :n] = A
            row, direct = C[..., channel, :], D[..., 0, channel, :]
            into = np.einsum("m,...n->...mn", b, row)
            inputs = np.einsum("m,...l->...ml", b, direct)
            inner = a
            if moved is not None:
                into = into + moved[:, None, None] * np.outer(by_b, matrices.C[channel])
                inputs = inputs + moved[:, None, None] * np.outer(by_b, matrices.D[0, channel])
                inner = moved[:, None, None] * by_a
            wide[..., n:, :n], wide[..., n:, n:] = into, inner
            output = np.concatenate([C, np.zeros((*C.shape[:-1], m))], axis=-1)
            output[..., channel, :n] = d * row
            if moved is None:
                output[channel, n:] = c
            through = D.copy()
            through[..., 0, channel, :] = d * direct
            return wide, np.concatenate([B, inputs], axis=-2), output, through

        by_corner = np.zeros(p)
        for name, slope in slopes.items():
            if name in self._places:
                by_corner[self._places[name]] = slope
        A, B, C, D = extended(A, B, C, D)
        dA, dB, dC, dD = extended(dA, dB, dC, dD, by_corner)
        return Matrices(A, B, C, D, dA, dB, dC, dD)

    def _of_system(self, values: Mapping[str, float]) -> Mapping[str, float]:
        """Return the values of the parameters that the system without filters knows."""
        if not self.further:
            return values
        return {name: value for name, value in values.items() if name not in self.further}

    @staticmethod
    def _corner(item: Filter, values: Mapping[str, float]) -> tuple[float, Mapping[str, float]]:
        evaluation = evaluated(item.frequency, values)
        return evaluation.value, evaluation.slopes

    def prior(self, values: Mapping[str, float], length: float) -> Array:
        """Return a root of the prior covariance: states of filters have the size of what passes them."""
        root = self.system.prior(self._of_system(values), length)
        reach = self.system.reach(self._of_system(values), length)
        sizes = [
            reach[channel] * self._amplification(item, values, length) ** k
            for channel, of_channel in enumerate(self.filters)
            for item in of_channel
            for k in range(1, item.order + 1)
        ]
        n, m = len(root), len(sizes)
        wide = np.zeros((n + m, root.shape[1] + m))
        wide[:n, : root.shape[1]], wide[n:, root.shape[1] :] = root, np.diag(sizes)
        return wide

    def reach(self, values: Mapping[str, float], length: float) -> Array:
        """Return the standard deviation of each channel; integrators alone amplify."""
        reach = self.system.reach(self._of_system(values), length)
        factors = [
            math.prod(self._amplification(item, values, length) ** item.order for item in of_channel)
            for of_channel in self.filters
        ]
        return reach * factors

    def _amplification(self, item: Filter, values: Mapping[str, float], length: float) -> float:
        """Return the time over which a filter integrates, s; 1 of another one."""
        return 1 / (self._corner(item, values)[0] + 1 / length) if item.kind == "integrator" else 1.0

    def prescribed(self, time: float) -> tuple[Array, NDArray[np.bool_]]:
        """Return what loads prescribe of the system's states; of filters nothing."""
        states, known = self.system.prescribed(time)
        more = len(self.states) - states.shape[1]
        return np.pad(states, ((0, 0), (0, more))), np.pad(known, (0, more))

    def poles(self, values: Mapping[str, float]) -> ComplexArray:
        """Return the poles of the system and of the filters."""
        own = [
            self._corner(item, values)[0] * item.poles for of_channel in self.filters for item in of_channel
        ]
        return np.concatenate([self.system.poles(self._of_system(values)), *own])

    def solved_size(self, omega: Array, pairs: Pairs) -> int:
        """Return the number of equations that an evaluation of responses solves at each line."""
        return self.system.solved_size(omega, pairs)

    def paired_response(
        self, values: Mapping[str, float], omega: Array, pairs: Pairs, *, slopes: bool = True
    ) -> Responses:
        """Return the responses of pairs of a channel and a load behind their filters, and derivatives."""
        H, moved = self.system.paired_response(self._of_system(values), omega, pairs, slopes=slopes)
        H, moved = H.copy(), np.pad(moved, ((0, 0), (0, 0), (0, len(self.further) * slopes)))
        for column, (channel, _) in enumerate(pairs):
            for item in self.filters[channel]:
                corner, by_parameter = self._corner(item, values)
                if item.kind == "integrator" and corner == 0 and not omega.all():
                    raise UsageError(
                        "the response at 0 of a channel with an integrator is undetermined",
                        remedy="Leave the line at 0 out, or state the frequency of the integrator.",
                        names=("measurement.channels",),
                    )
                response, slope = item.response(omega, corner)
                moved[:, column] *= response[:, None]
                for name, rate in by_parameter.items():
                    if slopes and name in self._places:
                        moved[:, column, self._places[name]] += H[:, column] * slope * rate
                H[:, column] *= response
        return H, moved


def filtered_space(space: StateSpace, filters: Filters, values: Mapping[str, float]) -> StateSpace:
    """Return a state space whose outputs pass filters, at values of the parameters."""
    if space.higher and any(filters):
        raise UsageError("a channel with a filter follows a derivative of the excitation")
    A, B, C, D = space.A, space.B, space.C, space.D
    for channel, of_channel in enumerate(filters):
        for item in of_channel:
            a, b, c, d, *_ = item.matrices(evaluated(item.frequency, values).value)
            row, direct, m = C[channel], D[channel], len(a)
            A = np.block([[A, np.zeros((len(A), m))], [np.outer(b, row), a]])
            B = np.concatenate([B, np.outer(b, direct)])
            C, D = np.pad(C, ((0, 0), (0, m))), D.copy()
            C[channel] = np.concatenate([d * row, c])
            D[channel] = d * direct
    return StateSpace(A, B, C, D)
