"""The exact engine: channels in lowest terms over the rationals, certified roots, hidden modes explained.

Whether a mode is uncontrollable or unobservable is a question of rank (Popov, Belevitch, Hautus) at a number
that is rational only by chance. It is answered exactly all the same: modulo a prime at which the mode's
irreducible polynomial has a root, the state equations are integers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.bondgraph.descriptor import (
    Descriptor,
    FormSymbol,
    LinearForm,
    NumberField,
    solve,
    without_input_rates,
)
from dynid.bondgraph.graph import Port
from dynid.bondgraph.plan import Channel, ReducedGraph, characteristic_polynomials
from dynid.bondgraph.program.modular import primes
from dynid.bondgraph.state_space import rounded
from dynid.defaults import STARTED_ROOTS
from dynid.errors import NumericalError
from dynid.lti.certified_roots import CertifiedRoot, certified_roots
from dynid.lti.stability import TransferProperties

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from dynid.bondgraph.program.factored import RationalFunction


# --- transfer function ----------------------------------------------------------------------------


@dataclass(frozen=True)
class TransferFunction(TransferProperties):
    """T(s) = numerator / denominator in lowest terms over the rationals.

    Parameters
    ----------
    numerator, denominator
        Integer polynomials without a common factor (flint `fmpz_poly`).
    starts
        Gives approximate zeros (asked for `zeros`) or poles (`poles`), where there is a quick way to them.
    """

    numerator: Any
    denominator: Any
    starts: Callable[[str], Sequence[complex] | None] = field(default=lambda _: None, compare=False)

    @classmethod
    def of(cls, ratio: RationalFunction) -> TransferFunction:
        """Bring a rational function into lowest terms."""
        return cls(*ratio.lowest_terms())

    @classmethod
    def of_roots(
        cls,
        numerator: Any,
        denominator: Any,
        zeros: tuple[CertifiedRoot, ...],
        poles: tuple[CertifiedRoot, ...],
    ) -> TransferFunction:
        """Return it with zeros and poles that are certified already."""
        known = cls(numerator, denominator)
        vars(known).update(zeros=zeros, poles=poles)
        return known

    def times(self, factor: Fraction) -> TransferFunction:
        """Return it times a number."""
        numerator, denominator = self.numerator * factor.numerator, self.denominator * factor.denominator
        common = numerator.gcd(denominator)
        return TransferFunction(numerator // common, denominator // common)

    @property
    def vanishes(self) -> bool:
        """True where the input does not reach the output at all."""
        return bool(self.numerator == 0)

    def coefficients(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return numerator and denominator in descending powers, denominator monic, correctly rounded."""
        lead = int(self.denominator.leading_coefficient())

        def rounded(polynomial: Any) -> NDArray[np.float64]:
            descending = reversed([int(c) for c in polynomial.coeffs()] or [0])
            return np.array([_as_float(Fraction(c, lead)) for c in descending])

        return rounded(self.numerator), rounded(self.denominator)

    @cached_property
    def zeros(self) -> tuple[CertifiedRoot, ...]:
        """The finite zeros; none where the channel vanishes."""
        return () if self.vanishes else certified_roots(self.numerator, self.starts("zeros"))

    @cached_property
    def poles(self) -> tuple[CertifiedRoot, ...]:
        """The poles."""
        return certified_roots(self.denominator, self.starts("poles"))

    @property
    def order(self) -> int:
        """The number of poles."""
        return int(self.denominator.degree())

    @property
    def relative_degree(self) -> int | float:
        """Poles minus zeros: negative where the channel differentiates, infinite where it vanishes."""
        return math.inf if self.vanishes else int(self.denominator.degree()) - int(self.numerator.degree())

    @property
    def dc_gain(self) -> float:
        """The limit of T(s) as s falls to 0 through positive values; may be infinite."""
        return _limit(self.numerator.coeffs(), self.denominator.coeffs())

    @property
    def high_frequency_gain(self) -> float:
        """The limit of T(s) as s grows through positive values; may be infinite."""
        size = max(self.numerator.length(), self.denominator.length())
        pad = [
            [0] * (size - p.length()) + [int(c) for c in p.coeffs()][::-1]
            for p in (self.numerator, self.denominator)
        ]
        return _limit(*pad)


def _limit(numerator: list[Any], denominator: list[Any]) -> float:
    """Return the quotient of two polynomials as the variable falls to 0+, coefficients ascending."""
    n = next((k for k, c in enumerate(numerator) if c), None)
    if n is None:
        return 0.0
    d = next(k for k, c in enumerate(denominator) if c)
    quotient = Fraction(int(numerator[n]), int(denominator[d]))
    if n == d:
        return _as_float(quotient)
    return 0.0 if n > d else math.inf if quotient > 0 else -math.inf


def _as_float(value: Fraction) -> float:
    """Round to the nearest double; beyond its range to infinity."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


# --- engine ---------------------------------------------------------------------------------------

#: Degree from which eigenvalues are worth their time as first values of roots.
_LARGE = STARTED_ROOTS.value


class ExactEngine:
    """The channels of a graph, exactly.

    Roots of large polynomials are certified from the eigenvalues of the graph's own equations: these save
    time, and what is certified does not depend on them.

    Parameters
    ----------
    reduced
        The graph.
    """

    def __init__(self, reduced: ReducedGraph) -> None:
        self.reduced = reduced
        channels = reduced.channels()
        ratios = reduced.rational(channels.values())
        self._transfers = {
            channel: replace(TransferFunction.of(ratios[register]), starts=partial(self._starts, channel))
            for channel, register in channels.items()
        }
        self._modes: dict[frozenset[str], list[complex] | None] = {}

    def channel(self, channel: Channel) -> TransferFunction:
        """Return one channel."""
        return self._transfers[channel]

    def hidden_modes(self, channel: Channel) -> tuple[CertifiedRoot, ...]:
        """Return the natural modes that cancel in a channel: uncontrollable, unobservable, or both."""
        polynomial = self.hidden_polynomial(channel)
        return certified_roots(
            polynomial, self._natural_starts(channel[0]) if polynomial.degree() > _LARGE else None
        )

    def hidden_polynomial(self, channel: Channel) -> Any:
        """Return the polynomial whose roots are the natural modes that cancel in a channel."""
        from flint import fmpz_poly

        port, shown = channel[0], self._transfers[channel].denominator
        if self.reduced.graph.integrates(port) and shown[0] == 0:  # the output's own integrator is no mode
            shown = shown // fmpz_poly([0, 1])
        natural = self._natural[port]
        return natural // natural.gcd(shown)

    @cached_property
    def _natural(self) -> dict[Port, Any]:
        return characteristic_polynomials(self.reduced)

    def _starts(self, channel: Channel, what: str) -> Sequence[complex] | None:
        """Return first values of the zeros or poles of a channel, where they are many."""
        transfer = self._transfers[channel]
        if what == "poles":
            return self._natural_starts(channel[0]) if transfer.denominator.degree() > _LARGE else None
        if transfer.numerator.degree() <= _LARGE:
            return None
        from dynid.bondgraph.floating.spectrum import zero_equations

        return _first_values(zero_equations(self.reduced, channel))

    def _natural_starts(self, port: Port) -> Sequence[complex] | None:
        junctions = frozenset(self.reduced.reductions[port].junctions)
        if junctions not in self._modes:
            from dynid.bondgraph.floating.spectrum import natural_equations

            self._modes[junctions] = _first_values(natural_equations(self.reduced, port))
        return self._modes[junctions]


def _first_values(equations: Any) -> list[complex] | None:
    from dynid.bondgraph.floating.spectrum import first_values

    try:
        return first_values(equations)
    except NumericalError:  # they would only have saved time
        return None


# --- hidden modes ----------------------------------------------------------------------------------

#: The smallest share of a mode's energy that an element is named for.
_SHARE = 0.005


@dataclass(frozen=True)
class HiddenMode:
    """A natural mode that is hidden in a channel.

    Parameters
    ----------
    root
        The root of the mode.
    uncontrollable, unobservable
        Whether the input does not reach it, and whether the output does not show it.
    energy
        The storages that hold its energy in free motion, each with its share.
    """

    root: CertifiedRoot
    uncontrollable: bool
    unobservable: bool
    energy: dict[str, float]

    @property
    def cause(self) -> str:
        """The cause: uncontrollable, unobservable, or both."""
        said = {"uncontrollable": self.uncontrollable, "unobservable": self.unobservable}
        return " and ".join(word for word, holds in said.items() if holds)

    @property
    def elements(self) -> str:
        """The storages that hold its energy, with their shares."""
        return ", ".join(f"{name} {100 * share:.3g} %" for name, share in self.energy.items())


def hidden_modes(reduced: ReducedGraph, channel: Channel, polynomial: Any) -> Iterator[HiddenMode]:
    """Explain the hidden modes of a channel.

    Parameters
    ----------
    reduced, channel
        The graph, and the channel (output, input).
    polynomial
        The polynomial whose roots they are (flint `fmpz_poly`).
    """
    storages = [name for name in reduced.storages if name in reduced.reductions[channel[0]].modelled]
    _, factors = polynomial.factor()
    for factor, multiplicity in factors:
        deficits = _rank_deficits(reduced, channel, factor)
        for root in certified_roots(factor):
            yield HiddenMode(
                root=replace(root, multiplicity=int(multiplicity)),
                uncontrollable=deficits.input > 0,
                unobservable=deficits.output > 0,
                energy=_energy(reduced, channel, storages, root.value, deficits),
            )


@dataclass(frozen=True)
class _Deficits:
    """Dimensions of the null spaces of A - s, of the left one of [A - s, b], and of that of [A - s; c]."""

    modes: int
    input: int
    output: int


def _rank_deficits(reduced: ReducedGraph, channel: Channel, factor: Any) -> _Deficits:
    """Return the exact rank deficits at the roots of an irreducible polynomial."""
    from flint import nmod, nmod_mat

    prime, root = _root_modulo(factor, reduced)

    def value(name: str) -> Any:
        exact = reduced.graph.value(name)
        return nmod(exact.numerator, prime) / nmod(exact.denominator, prime)

    _, rates, (output,) = _equations(
        reduced, channel, NumberField(value, nmod(1, prime)), [_rated(reduced, channel)]
    )
    states: list[FormSymbol] = [("w", name) for name in rates]
    a = [
        [form.get(s, 0) - root * (s == own) for s in states]
        for own, form in zip(states, rates.values(), strict=True)
    ]
    b = [form.get(("u", channel[1], 0), 0) for form in rates.values()]
    c = [output.get(s, 0) for s in states]

    def deficit(rows: list[list[Any]]) -> int:
        entries = [int(entry) % prime for row in rows for entry in row]
        return len(states) - int(nmod_mat(len(rows), len(rows[0]), entries, prime).rank())

    return _Deficits(
        deficit(a), deficit([[*row, entry] for row, entry in zip(a, b, strict=True)]), deficit([*a, c])
    )


def _root_modulo(factor: Any, reduced: ReducedGraph) -> tuple[int, int]:
    """Return a prime at which the polynomial has a root and the graph's values exist, and the root."""
    from flint import nmod_poly

    values = [reduced.graph.value(name) for name in reduced.valued]
    for prime in primes():
        images = [int(c) % prime for c in factor.coeffs()]
        if images[-1] and all(
            value.numerator % prime and value.denominator % prime for value in values if value
        ):
            roots = nmod_poly(images, prime).roots()
            if roots:
                return prime, int(roots[0][0])
    raise AssertionError("primes do not end")


def _equations(
    reduced: ReducedGraph, channel: Channel, field: NumberField, ports: Sequence[Port]
) -> tuple[Descriptor, dict[str, LinearForm], list[LinearForm]]:
    """Return the state equations of the part behind a channel's output, and variables of it."""
    junctions = reduced.reductions[channel[0]].junctions
    system = Descriptor(reduced.structure, junctions, field, inputs=[channel[1]])
    rates, outputs = solve(system.equations, [system.output(port) for port in ports])
    without_input_rates(rates, outputs)
    return system, rates, outputs


def _rated(reduced: ReducedGraph, channel: Channel) -> Port:
    """Return a channel's output, without the integrator behind it: that is no mode of the graph."""
    graph, port = reduced.graph, channel[0]
    return graph.behind(port) if graph.integrates(port) else port


def _energy(
    reduced: ReducedGraph, channel: Channel, storages: Sequence[str], root: complex, deficits: _Deficits
) -> dict[str, float]:
    """Return the shares of the energy in the mode's free motion, the largest first.

    The motion is the null space of [A - s; c] of an unobservable mode, of A - s of any other; its dimension
    is known exactly, so that no rounding error has to be distinguished from zero.
    """
    graph = reduced.graph
    held = (Port(name, "e" if graph.nodes[name].type == "C" else "f") for name in storages)
    ports = [_rated(reduced, channel), *held]
    solved = _equations(reduced, channel, NumberField.rational(graph), ports)
    system = rounded(*solved, [channel[1]], [str(port) for port in ports])
    sizes = np.array([abs(float(graph.value(name))) for name in storages])
    with np.errstate(all="ignore"):
        scale = np.sqrt((sizes[:, None] * system.C[1:] ** 2).sum(axis=0))  # a state's unit of energy
        scale = np.where(np.isfinite(scale) & (scale > 0), scale, 1.0)
    rows = (system.A / scale) * scale[:, None] - root * np.eye(len(scale))
    unseen = (
        system.C[:1] / scale * (np.abs(rows).max(initial=1.0) / (np.abs(system.C[0] / scale).max() or 1.0))
    )
    motion = np.linalg.svd(np.vstack([rows, unseen]) if deficits.output else rows)[2].conj().T
    motion = motion[:, len(scale) - (deficits.output or deficits.modes) :] / scale[:, None]
    energies = sizes * (np.abs(system.C[1:] @ motion) ** 2).sum(axis=1)
    total = energies.sum()
    shares = {name: round(float(e / total), 4) for name, e in zip(storages, energies, strict=True) if total}
    return {name: share for name, share in sorted(shares.items(), key=lambda it: -it[1]) if share >= _SHARE}
