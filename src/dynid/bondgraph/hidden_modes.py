"""Natural modes hidden in a channel: the cause, and the elements that hold their energy.

Whether a mode is uncontrollable or unobservable is a question of rank (Popov, Belevitch, Hautus) at a number
that is rational only by accident. It is answered exactly all the same: modulo a prime at which the mode's
irreducible polynomial has a root, the state equations are integers.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

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
from dynid.bondgraph.graph_state_space import rounded
from dynid.bondgraph.program.factored import primes
from dynid.bondgraph.reduced_graph import Channel, ReducedGraph
from dynid.lti.certified_roots import CertifiedRoot, certified_roots

#: The smallest share of a mode's energy that an element is named for.
_MIN_ENERGY_SHARE = 0.005


@dataclass(frozen=True)
class _HiddenMode:
    """A natural mode that is hidden in a channel."""

    root: CertifiedRoot
    #: uncontrollable, unobservable: Whether the input does not reach it, and whether the output does not show
    #: it.
    uncontrollable: bool
    unobservable: bool
    energy: dict[str, float]  # the storage elements that hold its energy in free motion, each with its share

    @property
    def cause(self) -> str:
        """The cause: uncontrollable, unobservable, or both."""
        said = {"uncontrollable": self.uncontrollable, "unobservable": self.unobservable}
        return " and ".join(word for word, holds in said.items() if holds)

    @property
    def elements(self) -> str:
        """The storage elements that hold its energy, with their shares."""
        return ", ".join(f"{name} {100 * share:.3g} %" for name, share in self.energy.items())


def hidden_modes(reduced: ReducedGraph, channel: Channel, polynomial: Any) -> Iterator[_HiddenMode]:
    """Explain the hidden modes of a channel.

    `reduced` and `channel`: the graph, and the channel (output, input). `polynomial`: the polynomial whose
    roots they are (flint `fmpz_poly`).
    """
    storages = [name for name in reduced.storages if name in reduced.reductions[channel[0]].modelled]
    rational = reduced.field is None
    for factor, multiplicity in polynomial.factor()[1] if rational else polynomial.factors():
        exact = None
        if rational:
            matrices = _modular(reduced, channel, factor)
            driven = [[*row, entry] for row, entry in zip(matrices.a, matrices.b, strict=True)]
            exact = _Deficits(*map(matrices.deficit, (matrices.a, driven, [*matrices.a, matrices.c])))
        for root in certified_roots(factor):
            deficits = exact or _deficits_in_balls(reduced, channel, factor, root.value)
            yield _HiddenMode(
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


#: Working precision of the state equations of irrational values; relative size, 2^-n, of an entry that is
#: zero but for the rounding of the root's polynomial (`ROUNDED_BITS`); steps that refine a double to it.
_BALL_BITS, _ZERO_BITS, _NEWTON_STEPS = 768, 128, 6


def _deficits_in_balls(reduced: ReducedGraph, channel: Channel, factor: Any, value: complex) -> _Deficits:
    """Return the rank deficits at a simple root of a polynomial, from many digits of the root.

    Over irrational numbers no prime stands for one root; what is below 2^-128 of the terms of its row
    is zero.
    """
    from flint import acb, ctx, fmpq

    field = NumberField.rational(reduced.graph)
    _, rates, (output,) = _equations(reduced, channel, field, [_rated(reduced, channel)])
    states: list[FormSymbol] = [("w", name) for name in rates]
    with ctx.workprec(_BALL_BITS):
        root, slope = acb(value), factor.derivative()
        for _ in range(_NEWTON_STEPS):
            root = (root - factor(root) / slope(root)).mid()

        def number(coefficient: Any) -> Any:
            return acb(fmpq(coefficient.p, coefficient.q)) if coefficient else acb(0)

        rows = [[number(form.get(s, 0)) for s in [*states, ("u", channel[1], 0)]] for form in rates.values()]
        for k, row in enumerate(rows):  # each relative to its terms, before the root cancels them
            scale = _largest([*row, root])
            row[k] -= root
            rows[k] = [entry / scale for entry in row]
        a, c = [row[:-1] for row in rows], [number(output.get(s, 0)) for s in states]
        size, largest = len(states), _largest(c)
        shown = [*a, [entry / largest for entry in c]]
        return _Deficits(*(size - _rank(matrix) for matrix in (a, rows, shown)))


def _largest(entries: list[Any]) -> Any:
    """Return the largest size of balls; 1 where all are zero."""
    from flint import arb

    largest = max((abs(entry).mid() for entry in entries), default=arb(0))
    return largest if largest > 0 else arb(1)


def _rank(rows: list[list[Any]]) -> int:
    """Return the rank of a matrix of balls with entries up to 1, by elimination with complete pivoting."""
    left, rank = rows, 0
    while left and left[0]:
        places = [(i, j) for i, row in enumerate(left) for j in range(len(row))]
        i, j = max(places, key=lambda index: abs(left[index[0]][index[1]]).mid())
        pivot = left.pop(i)
        if abs(pivot[j]).mid() < 2.0**-_ZERO_BITS:
            break
        rank += 1
        left = [
            [(entry - row[j] / pivot[j] * pivot[k]).mid() for k, entry in enumerate(row) if k != j]
            for row in left
        ]
    return rank


def conserved(reduced: ReducedGraph, channel: Channel, names: Collection[str]) -> list[str]:
    """Return which of the named states enter a sum of states that is constant, whatever the input.

    Such a sum is a left null vector of [A, b]: an uncontrollable mode at 0.
    """
    from flint import fmpz_poly

    matrices = _modular(reduced, channel, fmpz_poly([0, 1]))
    driven = [[*row, entry] for row, entry in zip(matrices.a, matrices.b, strict=True)]
    rank = len(driven) - matrices.deficit(driven)
    dependent = []
    for name in names:
        others = [row for state, row in zip(matrices.states, driven, strict=True) if state != name]
        if len(others) < len(driven) and others and len(driven) - matrices.deficit(others) == rank:
            dependent.append(name)  # its row depends on those of the others
    return dependent


@dataclass(frozen=True)
class _Modular:
    """A - s with b and c modulo a prime, by rows of the states; s is a root of a polynomial."""

    prime: int
    states: list[str]
    a: list[list[Any]]
    b: list[Any]
    c: list[Any]

    def deficit(self, rows: list[list[Any]]) -> int:
        """Return by how much the rank of rows is less than the number of states."""
        from flint import fmpz_mod_ctx, fmpz_mod_mat, nmod_mat

        shape, entries = (len(rows), len(rows[0])), [int(entry) % self.prime for row in rows for entry in row]
        if self.prime.bit_length() > 64:
            rank = fmpz_mod_mat(*shape, entries, fmpz_mod_ctx(self.prime)).rank()
        else:
            rank = nmod_mat(*shape, entries, self.prime).rank()
        return len(self.states) - int(rank)


def _modular(reduced: ReducedGraph, channel: Channel, factor: Any) -> _Modular:
    """Return the state equations at a root of an irreducible polynomial, modulo a prime."""
    from flint import nmod

    unity: Any
    if (field := reduced.field) is not None:  # only 0 is known to be a root modulo its prime
        prime, root, unity = field.prime, 0, field.residues(1)
    else:
        prime, root = _root_modulo(factor, reduced)
        unity = nmod(1, prime)

    def value(name: str) -> Any:
        exact = reduced.graph.value(name)
        return unity * exact.numerator / (unity * exact.denominator)

    _, rates, (output,) = _equations(reduced, channel, NumberField(value, unity), [_rated(reduced, channel)])
    states: list[FormSymbol] = [("w", name) for name in rates]
    a = [
        [form.get(s, 0) - root * (s == state) for s in states]
        for state, form in zip(states, rates.values(), strict=True)
    ]
    b = [form.get(("u", channel[1], 0), 0) for form in rates.values()]
    return _Modular(prime, list(rates), a, b, [output.get(s, 0) for s in states])


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
    shown = system.C[:1] / scale
    unseen = shown * (np.abs(rows).max(initial=1.0) / (np.abs(shown).max() or 1.0))
    motion = np.linalg.svd(np.vstack([rows, unseen]) if deficits.output else rows)[2].conj().T
    motion = motion[:, len(scale) - (deficits.output or deficits.modes) :] / scale[:, None]
    energies = sizes * (np.abs(system.C[1:] @ motion) ** 2).sum(axis=1)
    total = energies.sum()
    shares = {name: round(float(e / total), 4) for name, e in zip(storages, energies, strict=True) if total}
    ranked = sorted(shares.items(), key=lambda item: -item[1])
    return {name: share for name, share in ranked if share >= _MIN_ENERGY_SHARE}
