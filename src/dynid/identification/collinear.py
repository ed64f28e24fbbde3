"""Parameters that a record shows together only, and what of them it shows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Part of a blind direction below which a parameter has no share in it; equality of coefficients.
_SHARE, _EQUAL = 1e-3, 1e-2


class Group(NamedTuple):
    """Parameters that are not told apart.

    `places` of the parameters; `blind` (directions x parameters): changes of their logarithms that the record
    does not show, of unit length; `seen`: in words, to first order, what of them it does show (empty where
    that is more than one combination).
    """

    places: tuple[int, ...]
    blind: Array
    seen: str


def collinear_groups(names: Sequence[str], values: Array, sensitivity: Array, level: float) -> list[Group]:
    """Return the groups of parameters that are not told apart.

    Parameters
    ----------
    names, values
        The parameters (p).
    sensitivity
        Of the record to their logarithms, over noise and free of the initial state (rows x p), rows at least
        as many as parameters. Columns of zeros are left out: they are no group, but unseen.
    level
        Singular values below this part of the largest, columns scaled to one length, are blind.
    """
    size = np.linalg.norm(sensitivity, axis=0)
    there = np.flatnonzero(size > 0)
    if len(there) < 2:
        return []
    _, s, Vt = np.linalg.svd(np.linalg.qr(sensitivity[:, there] / size[there], mode="r"))
    blind = Vt[s <= level * s[0]]
    if not len(blind):
        return []
    together = np.abs(blind.T @ blind) > _SHARE**2  # the projector: the same whatever the vectors
    groups = []
    for members in _components(together):
        _, strength, rows = np.linalg.svd(blind[:, members])
        inside = rows[: int(np.count_nonzero(strength > 0.5))]  # each direction lies in one group
        places = there[members]
        changes = inside / size[places]
        changes /= np.linalg.norm(changes, axis=1)[:, None]
        seen = ""
        if len(inside) == len(members) - 1:
            normal = np.linalg.svd(inside)[2][-1]
            seen = _in_words([names[place] for place in places], values[places], normal * size[places])
        groups.append(Group(tuple(int(place) for place in places), changes, seen))
    return groups


def _components(together: NDArray[np.bool_]) -> list[list[int]]:
    """Return the connected sets of two or more."""
    left, found = set(range(len(together))), []
    while left:
        members, edge = set(), {min(left)}
        while edge:
            members |= edge
            edge = {int(k) for place in edge for k in np.flatnonzero(together[place])} - members
        left -= members
        if len(members) > 1:
            found.append(sorted(members))
    return found


def _in_words(names: Sequence[str], values: Array, gradient: Array) -> str:
    """Name the combination with this gradient by the logarithms: a sum, a sum of inverses, a product."""
    for by_value, pattern in ((gradient / values, "{}"), (gradient * values, "1/{}"), (gradient, "ln {}")):
        terms = by_value / by_value[0]
        if np.all(np.abs(np.abs(terms) - 1) < _EQUAL):
            written = [pattern.format(name) for name in names]
            signs = [" - " if term < 0 else " + " for term in terms[1:]]
            return written[0] + "".join(s + w for s, w in zip(signs, written[1:], strict=True))
    shares = gradient / np.abs(gradient).max()
    return " + ".join(f"{share:.2g} ln {name}" for share, name in zip(shares, names, strict=True))
