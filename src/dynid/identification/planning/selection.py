"""D-optimal subset of candidates: greedy, then by exchange.

V. V. Fedorov, Theory of Optimal Experiments (1972), ch. 3. Where no nuisance is projected off, the logarithm
of the determinant of the information is monotone and submodular in the candidates: the greedy choice then
gains at least 1 - 1/e of what the best one gains (G. L. Nemhauser et al., Math. Program. 14 (1978) 265–294).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array

# Root of the prior information on a logarithm: a factor of e^1000 either way. It makes first choices
# comparable from which not all parameters are identifiable, and is negligible beside that of any record.
_PRIOR_ROOT = 1e-3
# Root of the prior information on the initial state, as a part of that of its wide prior.
_STATE_PRIOR_ROOT = 1e-6
# All candidates together bound a parameter of value 0, the others known, to this part of its unit.
_BOUND_OF_ZERO = 1e-2
# An exchange must gain this much: less is round-off.
_GAIN = 1e-9
_MAX_EXCHANGE_ROUNDS = 20
# So many numbers are factorised at a time (80 MB).
_AT_ONCE = 10_000_000


def relative_slopes(slopes: Array, rates: Array) -> Array:
    """Return sensitivities to relative changes of parameters, from those to their coordinates (… x p).

    `rates`: relative rates of the parameters by their coordinates (p), infinite where a value is 0.
    """
    size = np.linalg.norm(slopes.reshape(-1, len(rates)), axis=0)
    return slopes / np.where(np.isfinite(rates), rates, np.where(size > 0, size, 1.0) * _BOUND_OF_ZERO)


@dataclass(frozen=True, eq=False)
class Candidates:
    """The information of candidates, each as a triangle of its sensitivities over noise.

    Those to parameters are relative (`relative_slopes`), as the prior information is.
    """

    # Of each candidate any R with ``R^T R`` its information on nuisance and parameters (candidates x rows x
    # nuisance + parameters).
    roots: Array
    nuisance: int  # how many columns, the first ones, are of nuisance parameters
    # A number for each candidate: of those with the same one at most one is chosen. Absent: all differ.
    alike: NDArray[np.int64] | None = None

    @property
    def parameters(self) -> int:
        """Number of parameters that matter."""
        return int(self.roots.shape[2]) - self.nuisance

    def before(self) -> Array:
        """Return the root of the prior information."""
        roots = [_STATE_PRIOR_ROOT] * self.nuisance + [_PRIOR_ROOT] * self.parameters
        return np.diag(roots)

    def root(self, chosen: Sequence[int]) -> Array:
        """Return the triangular root of the information of these candidates and the prior."""
        rows = self.roots[list(chosen)].reshape(-1, self.roots.shape[2])
        return np.asarray(np.linalg.qr(np.concatenate([self.before(), rows]), mode="r"))

    def gains(self, chosen: Sequence[int]) -> Array:
        """Return the logarithmic determinants on the parameters with each candidate beside those chosen."""
        root = self.root(chosen)
        height = max(1, _AT_ONCE // (len(root) * (len(root) + self.roots.shape[1])))
        worths = []
        for first in range(0, len(self.roots), height):
            these = self.roots[first : first + height]
            repeated = np.broadcast_to(root, (len(these), *root.shape))
            R = np.linalg.qr(np.concatenate([repeated, these], axis=1), mode="r")
            pivots = np.abs(np.diagonal(R, axis1=1, axis2=2))[:, self.nuisance :]
            worths.append(2 * np.log(pivots).sum(axis=1))
        return np.concatenate(worths)

    def closed(self, chosen: Sequence[int]) -> NDArray[np.bool_]:
        """Return the mask of candidates that these exclude, themselves among them."""
        alike = np.arange(len(self.roots)) if self.alike is None else self.alike
        return np.asarray(np.isin(alike, alike[list(chosen)]))

    def most(self) -> int:
        """Return how many can be chosen."""
        return len(self.roots) if self.alike is None else len(np.unique(self.alike))

    def steps(self, chosen: Sequence[int]) -> Array:
        """Return by which factor each narrows the bounds that those before it give (geometric mean).

        Infinite for the one with which all parameters become identifiable.
        """
        worths = [self.worth(chosen[:k]) for k in range(len(chosen) + 1)]
        factors = np.exp(np.diff(worths) / (2 * self.parameters))
        identifiable = [bool(np.isfinite(self.bounds(chosen[:k])).all()) for k in range(len(chosen))]
        return np.where(identifiable, factors, np.inf)

    def worth(self, chosen: Sequence[int]) -> float:
        """Return the logarithmic determinant of the information on the parameters."""
        pivots = np.abs(np.diagonal(self.root(chosen)))[self.nuisance :]
        return float(2 * np.log(pivots).sum())

    def bounds(self, chosen: Sequence[int]) -> Array:
        """Return the relative bounds on the parameters, infinite where they are not identifiable."""
        R = self.root(chosen)[self.nuisance :, self.nuisance :]
        inverse = np.linalg.solve(R, np.eye(len(R)))
        bounds = np.linalg.norm(inverse, axis=1)
        return np.asarray(np.where(bounds < 0.1 / _PRIOR_ROOT, bounds, np.inf))


def select(candidates: Candidates, count: int) -> list[int]:
    """Return the D-optimal set of candidates, in the order of their gains.

    `count`: how many to choose; no more than there are.
    """
    chosen = _in_order(candidates, None, min(count, candidates.most()))
    best = candidates.worth(chosen)
    for _ in range(_MAX_EXCHANGE_ROUNDS):
        before = best
        for index in range(len(chosen)):
            others = chosen[:index] + chosen[index + 1 :]
            gains = np.where(candidates.closed(others), -np.inf, candidates.gains(others))
            new = int(np.argmax(gains))
            if gains[new] > best + _GAIN:
                chosen, best = [*others[:index], new, *others[index:]], float(gains[new])
        if best <= before + _GAIN:
            break
    return _in_order(candidates, chosen)


def _in_order(candidates: Candidates, of: Sequence[int] | None, count: int | None = None) -> list[int]:
    """Choose greedily, of these candidates or of all."""
    count = len(of or ()) if count is None else count
    allowed = np.zeros(len(candidates.roots), dtype=bool)
    allowed[slice(None) if of is None else list(of)] = True
    chosen: list[int] = []
    for _ in range(count):
        open_to = allowed & ~candidates.closed(chosen)
        chosen.append(int(np.argmax(np.where(open_to, candidates.gains(chosen), -np.inf))))
    return chosen
