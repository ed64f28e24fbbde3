"""The interface between a model and the estimators: matrices of a linear system as functions of parameters.

A structure, a bond graph, or any other linear model with unknown parameters is identified through two
classes: a `SystemModel`, which knows its parameters, and the `LinearSystem` that it makes for the loads and
channels of one record. Filter, output error, invariant imbedding, frequency responses, plans, identifiability
and bounds need nothing else.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.dependent import evaluated
from dynid.arrays import Array, ComplexArray
from dynid.errors import NumericalError
from dynid.identification.records.measurement import Simulation
from dynid.lti.frequency_response import on_a_pole
from dynid.lti.signals import Signal
from dynid.lti.state_space import Matrices, StateSpace
from dynid.lti.time_response import TimeResponse
from dynid.parameters import Parameter

Pairs: TypeAlias = Sequence[tuple[int, int]]
"""Pairs of a channel and a load, by their places."""
Responses: TypeAlias = tuple[ComplexArray, ComplexArray]
"""Responses at lines (L x …), and their derivatives by the values of the parameters (L x … x p)."""


class StateVariable(NamedTuple):
    """A state: its name in results, and its unit."""

    name: str
    unit: str


class Affine(NamedTuple):
    """Matrices that are affine in the values of the parameters: A and C alone depend on them."""

    # `A`, `B`, `C`, `D`: as of `Matrices`, with every parameter at zero
    A: Array
    B: Array
    C: Array
    D: Array
    # `A_slopes`, `C_slopes`: constant derivatives by the values
    A_slopes: Array
    C_slopes: Array

    def at(self, values: Array) -> Matrices:
        """Return the matrices at values of the parameters (p)."""
        p = len(values)
        return Matrices(
            self.A + np.einsum("p,pij->ij", values, self.A_slopes),
            self.B,
            self.C + np.einsum("p,pij->ij", values, self.C_slopes),
            self.D,
            self.A_slopes,
            np.zeros((p, *self.B.shape)),
            self.C_slopes,
            np.zeros((p, *self.D.shape)),
        )


class LinearSystem(ABC):
    """A model with the loads and channels of one record."""

    unknowns: tuple[Parameter, ...]  # the unknown parameters (p)
    considered: tuple[Parameter, ...] = ()  # the parameters that are known with uncertainty
    states: tuple[StateVariable, ...]  # the states (n)
    signals: list[Signal]  # the acting inputs, one a load
    evaluations: int = 0  # how often frequency responses were computed
    #: Answers of loops that act a delay later: with any the state alone does not determine what follows.
    delayed: Sequence[Any] = ()

    @abstractmethod
    def at(self, values: Mapping[str, float]) -> Matrices:
        """Return the matrices at values of the parameters, by name.

        Raises
        ------
        DynidError
            If there are none.
        """

    @abstractmethod
    def prior(self, values: Mapping[str, float], length: float) -> Array:
        """Return a root (n x n) of the wide prior covariance of the state, up to a factor.

        Every mode has the same energy; motions that store none are bounded by the length of the record, s.
        """

    def reach(self, values: Mapping[str, float], length: float) -> Array:
        """Return the standard deviation of each channel under the prior of the state (channels)."""
        return np.asarray(np.linalg.norm(self.at(values).C @ self.prior(values, length), axis=1))

    def check(self) -> None:  # noqa: B027 - most models need none
        """Refuse a model of which records of time cannot be predicted from an initial state.

        Raises
        ------
        UsageError
            With the remedies.
        """

    def prescribed(self, time: float) -> tuple[Array, NDArray[np.bool_]]:  # noqa: ARG002
        """Return the state at a time that each load prescribes (loads x n), and where one does (n)."""
        n = len(self.states)
        return np.zeros((len(self.signals), n)), np.zeros(n, dtype=bool)

    @property
    def unfiltered(self) -> LinearSystem:
        """The system without filters of its instruments."""
        return self

    @property
    def affine(self) -> Affine | None:
        """The matrices as affine functions of the parameters; None where they are not."""
        return None

    def lft(self, values: Mapping[str, float]) -> Matrices:
        """Return the matrices with the delayed answers as last inputs, and the answers as last outputs."""
        return self.at(values)

    def loop_delays(self, values: Mapping[str, float]) -> tuple[Array, Array]:
        """Return the delays of its loops (m), s, and their derivatives by the values (p x m)."""
        numbers = [evaluated(answer.delay, values) for answer in self.delayed]
        slopes = [[number.slopes.get(unknown.name, 0.0) for number in numbers] for unknown in self.unknowns]
        delays = np.array([number.value for number in numbers])
        if not np.all(delays > 0):
            raise NumericalError("a delay of a loop is not positive", remedy="Give it a limit (`min`).")
        return delays, np.array(slopes, dtype=float).reshape(len(self.unknowns), len(delays))

    def poles(self, values: Mapping[str, float]) -> ComplexArray:
        """Return the poles at values of the parameters, 1/s."""
        from dynid.lti.exponential import balance, rescaled

        A = self.at(values).A
        return np.asarray(np.linalg.eigvals(rescaled(A, balance(A))), dtype=complex)

    def paired_response(
        self, values: Mapping[str, float], omega: Array, pairs: Pairs, *, slopes: bool = True
    ) -> Responses:
        """Return the responses of pairs of a channel and a load (L x pairs), and their derivatives (… x p).

        The derivatives are by the values of the parameters; without `slopes` there are none (p = 0).

        Raises
        ------
        Singular
            If a line lies on an undamped pole, to rounding.
        """
        H, moved = self.response(values, omega)
        channels, loads = zip(*pairs, strict=True)
        if not np.isfinite(H).all():
            raise on_a_pole(float(omega[np.argmax(~np.isfinite(H).all(axis=(1, 2)))]))
        return H[:, channels, loads], moved[:, channels, loads, :] if slopes else moved[
            :, channels, loads, :0
        ]

    def solved_size(self, omega: Array, pairs: Pairs) -> int:  # noqa: ARG002
        """Return the number of equations that an evaluation of responses solves at each line."""
        return len(self.states)

    def response(self, values: Mapping[str, float], omega: Array) -> Responses:
        """Return frequency responses (L x channels x loads), and their derivatives by the values (… x p).

        With H = C (i omega - A)^-1 B + sum_k (i omega)^k D_k, and R = (i omega - A)^-1:
        dH = (dC + C R dA) R B + C R dB + sum_k (i omega)^k dD_k.
        """
        matrices, s = self.at(values), 1j * omega[:, None, None]
        n = len(matrices.A)
        by_load = np.linalg.solve(s * np.eye(n) - matrices.A, matrices.B.astype(complex)[None])
        by_channel = np.linalg.solve(
            (s * np.eye(n) - matrices.A).swapaxes(1, 2), matrices.C.T.astype(complex)[None]
        )
        by_channel = by_channel.swapaxes(1, 2)  # C R
        H = matrices.C @ by_load
        moved = by_channel[:, None] @ (matrices.A_slopes @ by_load[:, None] + matrices.B_slopes)
        moved = moved + matrices.C_slopes @ by_load[:, None]
        for order in range(len(matrices.D)):
            power = (1j * omega) ** order
            H = H + power[:, None, None] * matrices.D[order]
            moved = moved + power[:, None, None, None] * matrices.D_slopes[:, order]
        return H, np.moveaxis(moved, 1, -1)

    def state_space(self, values: Mapping[str, float]) -> StateSpace:
        """Return the state space at values of the parameters."""
        matrices = self.at(values)
        return StateSpace(matrices.A, matrices.B, matrices.C, matrices.D[0], tuple(matrices.D[1:]))


@runtime_checkable
class SystemModel(Protocol):
    """A model with unknown parameters, before loads and channels are chosen."""

    @property
    def unknowns(self) -> tuple[Parameter, ...]:
        """The unknown parameters (p)."""

    def system(self, loads: Sequence[Any], channels: Sequence[Any]) -> LinearSystem:
        """Return the system from the loads to the channels.

        Raises
        ------
        UsageError
            If a load or channel makes no sense here.
        """

    @property
    def parameters(self) -> Sequence[Parameter]:
        """The unknown and considered parameters that scenes name: all, but for those of joints."""

    def with_parameters(self, parameters: Sequence[Parameter]) -> SystemModel:
        """Return the model with other parameters, unknown or considered."""

    def simulated(
        self, loads: Sequence[Any], channels: Sequence[Any], times: Array, source: Simulation
    ) -> TimeResponse:
        """Return the exact, noise-free response at the true values of the parameters.

        Parameters
        ----------
        loads, channels
            As of `system`.
        times
            Sampling times, s.
        source
            Settings; the state at t = 0.

        Raises
        ------
        UsageError
            If a true value is not known.
        """
