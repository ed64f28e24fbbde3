"""Chains of poles over increasing orders: a stabilisation chart without the picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import ComplexArray

# Distance up to which poles of different orders are one: parts of the half width, and of the frequency.
_OF_HALF_WIDTH, _OF_FREQUENCY = 0.3, 3e-4
# Orders that a chain may skip.
_SKIPPED_ORDERS = 4
# Least orders of a chain, and their least part of all orders.
_MIN_LENGTH, _MIN_PART = 5, 0.15
# Highest damping ratio of a pole of the chart.
MAX_DAMPING = 0.3


class Chart(NamedTuple):
    """Poles of all orders (n), rad/s, with the chain of each: from 0, or −1 for none that lasts."""

    order: NDArray[np.int_]
    pole: ComplexArray
    chain: NDArray[np.int_]

    @property
    def starts(self) -> ComplexArray:
        """The pole of each chain: the median of its upper half, by frequency."""
        poles = []
        for number in range(self.chain.max(initial=-1) + 1):
            members = self.pole[self.chain == number]
            upper = members[len(members) // 2 :]
            poles.append(complex(np.median(upper.real), np.median(upper.imag)))
        return np.array(sorted(poles, key=lambda pole: pole.imag), dtype=complex)


def chart_of(orders: Sequence[int], poles: Sequence[ComplexArray], band: tuple[float, float]) -> Chart:
    """Return the chart of the stable poles in a band (rad/s), in chains over 15 % of the orders."""
    number, pole, link = list[int](), list[complex](), list[int]()
    ends: list[tuple[int, complex]] = []  # of each chain the position of its order, and its last pole
    lengths: list[int] = []
    for position, (order, roots) in enumerate(zip(orders, poles, strict=True)):
        inside = roots[(roots.real < 0) & (roots.imag > band[0]) & (roots.imag < band[1])]
        current = inside[-inside.real < MAX_DAMPING * np.abs(inside)]
        recent = [c for c, (last, _) in enumerate(ends) if position - last <= _SKIPPED_ORDERS]
        chains = _links(current, np.array([ends[c][1] for c in recent], dtype=complex))
        for k, root in enumerate(current.tolist()):
            if k in chains:
                chain = recent[chains[k]]
                ends[chain], lengths[chain] = (position, root), lengths[chain] + 1
            else:
                chain = len(ends)
                ends.append((position, root))
                lengths.append(1)
            number.append(order)
            pole.append(root)
            link.append(chain)
    least = max(_MIN_LENGTH, _MIN_PART * len(orders))
    lasting = [chain for chain, length in enumerate(lengths) if length >= least]
    renumbered = np.full(len(ends) + 1, -1)
    renumbered[lasting] = np.arange(len(lasting))
    return Chart(
        np.array(number, dtype=int), np.array(pole, dtype=complex), renumbered[np.array(link, dtype=int)]
    )


def _links(current: ComplexArray, ends: ComplexArray) -> dict[int, int]:
    """Return the end that each pole continues, nearest pairs first."""
    if not len(current) or not len(ends):
        return {}
    reach = _OF_HALF_WIDTH * np.abs(current.real) + _OF_FREQUENCY * np.abs(current)
    distance = np.abs(current[:, None] - ends) / reach[:, None]
    links: dict[int, int] = {}
    for k, c in np.argwhere(distance <= 1)[np.argsort(distance[distance <= 1], kind="stable")].tolist():
        if k not in links and c not in links.values():
            links[k] = c
    return links
