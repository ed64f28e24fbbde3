"""Fisher information of records on the parameters, the Cramér–Rao bound, and collinear parameters.

The initial state is an unknown nuisance: the sensitivities to the parameters are projected onto the
complement of those to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.errors import NotIdentifiable
from dynid.identification.least_squares import least_squares, thin_svd, without_state
from dynid.number_format import sentence

# Part of a blind direction below which a parameter has no share in it; equality of coefficients.
_MIN_BLIND_SHARE, _EQUAL_COEFFICIENTS = 1e-3, 1e-2
# Largest denominator of an exponent that is written as a fraction.
_MAX_DENOMINATOR = 4
# Least part of a parameter's sensitivity that initial state and other parameters must not account for:
# sensitivities are exact to about 1e-12, and no measured record has that many digits.
_IDENTIFIABLE = 1e-8


class Observed(NamedTuple):
    """Words of messages for what is observed."""

    noun: str  # what it is
    nuisances: str  # what is unknown besides the parameters
    # `values`, `more`: what it has more of where it has more values, and where it determines more
    values: str
    more: str
    where: str  # the remedy of no effect, up to the parameters that act there
    less_noise: str  # the remedy of an effect below the noise
    astray: str  # remedy where estimates run away


RECORD = Observed(
    "record",
    "the unknown initial state",
    "samples or channels",
    "channels, samples or excitation frequencies",
    "excite or measure where",
    "Excite or measure where they act, measure longer or with less noise",
    "Start nearer to the true values, or check model, units and excitation against the record.",
)
RESPONSE = Observed(
    "response",
    "the noise",
    "lines or channels",
    "channels or lines",
    "excite or measure where",
    "Excite or measure where they act, measure longer or with less noise",
    "Start nearer to the true values, or check model, units and driven DOFs against the responses.",
)
MODAL_SURVEY = Observed(
    "modal survey",
    "the scales of the shapes",
    "modes or sensors",
    "modes or sensors",
    "measure modes in which",
    "Measure modes in which they act, or with less scatter",
    "Start nearer to the true values, or check model, units and sensors against the survey.",
)
BACKBONE = Observed(
    "backbone",
    "one another",
    "amplitudes or modes",
    "amplitudes or modes",
    "measure amplitudes at which",
    "Measure amplitudes at which they act, or with less scatter",
    "Start nearer to the true values, or check model, units and amplitudes against the backbone.",
)


class _CollinearGroup(NamedTuple):
    """Parameters that cannot be distinguished.

    `places` of the parameters; `blind` (directions x parameters): changes of their coordinates to which the
    record is insensitive, of unit length; `identifiable`: the combination of them that is identifiable, to
    first order; where there is one blind direction, the products of powers that are (empty where it is
    neither).
    """

    places: tuple[int, ...]
    blind: Array
    identifiable: str


def collinear_groups(
    names: Sequence[str], values: Array, rates: Array, sensitivity: Array, level: float
) -> list[_CollinearGroup]:
    """Return the groups of parameters that cannot be distinguished.

    `names`, `values`, `rates`: the parameters, and the derivatives of their values by their coordinates (p);
    `sensitivity`: of the record to their coordinates, over noise and free of the initial state (rows x p),
    rows at least as many as parameters. Columns of zeros are left out: these parameters form no group.
    `level`: directions with singular values below this part of the largest, columns scaled to one length,
    are blind.
    """
    size = np.linalg.norm(sensitivity, axis=0)
    there = np.flatnonzero(size > 0)
    if len(there) < 2:
        return []
    _, s, Vt = np.linalg.svd(np.linalg.qr(sensitivity[:, there] / size[there], mode="r"))
    blind = Vt[s <= level * s[0]]
    if not len(blind):
        return []
    together = np.abs(blind.T @ blind) > _MIN_BLIND_SHARE**2  # the projector: the same whatever the vectors
    groups = []
    for members in _components(together):
        _, strength, rows = np.linalg.svd(blind[:, members])
        inside = rows[: int(np.count_nonzero(strength > 0.5))]  # each direction lies in one group
        places = there[members]
        changes = inside / size[places]
        changes /= np.linalg.norm(changes, axis=1)[:, None]
        identifiable = ""
        if len(inside) == len(members) - 1:
            normal = np.linalg.svd(inside)[2][-1]
            gradient = normal * size[places] / rates[places]
            identifiable = _combination([names[index] for index in places], values[places], gradient)
        elif len(inside) == 1:
            relative = changes[0] * rates[places] / np.where(values[places] == 0, 1.0, values[places])
            if values[places].all():
                identifiable = _invariants([names[index] for index in places], relative)
        groups.append(_CollinearGroup(tuple(int(index) for index in places), changes, identifiable))
    return groups


def _components(together: NDArray[np.bool_]) -> list[list[int]]:
    """Return the connected sets of two or more."""
    left, components = set(range(len(together))), []
    while left:
        members, edge = set(), {min(left)}
        while edge:
            members |= edge
            edge = {int(k) for index in edge for k in np.flatnonzero(together[index])} - members
        left -= members
        if len(members) > 1:
            components.append(sorted(members))
    return components


def _combination(names: Sequence[str], values: Array, gradient: Array) -> str:
    """Return the combination with this gradient by the values: a sum, a sum of inverses, a product."""
    by_inverse, by_logarithm = gradient * values**2, gradient * values
    for by, pattern in ((gradient, "{}"), (by_inverse, "1/{}"), (by_logarithm, "ln {}")):
        if not by.all():
            continue
        terms = by / by[0]
        if np.all(np.abs(np.abs(terms) - 1) < _EQUAL_COEFFICIENTS):
            written = [pattern.format(name) for name in names]
            signs = [" - " if term < 0 else " + " for term in terms[1:]]
            return written[0] + "".join(s + w for s, w in zip(signs, written[1:], strict=True))
    logarithmic = bool(by_logarithm.all())
    shares = by_logarithm if logarithmic else gradient
    shares = shares / np.abs(shares).max()
    pattern = "{:.2g} ln {}" if logarithmic else "{:.2g} {}"
    return " + ".join(pattern.format(share, name) for share, name in zip(shares, names, strict=True))


def _invariants(names: Sequence[str], relative: Array) -> str:
    """Return the products of powers that do not change where parameters change by these relative amounts."""
    # One for each parameter but the last of those that change least; empty where the exponents are no simple
    # fractions.
    changes = np.abs(relative)
    base = int(np.flatnonzero(changes <= changes.min() * (1 + _EQUAL_COEFFICIENTS))[-1])
    products = []
    for k, name in enumerate(names):
        power = Fraction(float(relative[k] / relative[base])).limit_denominator(_MAX_DENOMINATOR)
        if abs(float(power) - relative[k] / relative[base]) > _EQUAL_COEFFICIENTS:
            return ""
        if k != base:
            size = (
                "" if abs(power) == 1 else f"^{abs(power)}" if power.denominator == 1 else f"^({abs(power)})"
            )
            products.append(f"{name}{'/' if power > 0 else '*'}{names[base]}{size}")
    return ", ".join(products)


@dataclass(frozen=True, eq=False)
class Information:
    """Sensitivities of a record to the parameters' coordinates, free of the initial state."""

    names: tuple[str, ...]  # the parameters (p)
    projected: Array  # sensitivities over noise, projected off those to the initial state (values x p)
    total: Array  # norms of the sensitivities before projection (p)
    signal: float  # norm of the predicted record over noise
    freedom: int  # number of measured values beyond those that the initial state takes
    # `values`, `rates`: the parameters' values, and their derivatives by their coordinates (p), if messages
    # are to name combinations of them
    values: Array | None = None
    rates: Array | None = None
    observed: Observed = RECORD  # words for what is observed

    def with_rows(self, rows: Array) -> Information:
        """Return the information with that of independent observations (count x p) of the parameters."""
        if not len(rows):
            return self
        total = np.hypot(self.total, np.linalg.norm(rows, axis=0))
        both, freedom = np.concatenate([self.projected, rows]), self.freedom + len(rows)
        return replace(self, projected=both, total=total, freedom=freedom, values=None, rates=None)

    def without(self, held: NDArray[np.bool_]) -> Information:
        """Return the information with some parameters (p) fixed."""
        return replace(self, projected=np.where(held, 0.0, self.projected))

    def check(self) -> None:
        """Refuse parameters that are not identifiable from the record.

        Raises NotIdentifiable, naming them.
        """
        if self.freedom < len(self.names):
            raise _refusal(
                list(self.names),
                f"cannot be distinguished from {self.observed.nuisances}: the {self.observed.noun} has fewer "
                "values than unknowns",
                f"Measure more {self.observed.values}, or give unknowns limits (min and max) or priors.",
            )
        insensitive = np.linalg.norm(self.projected, axis=0) <= _IDENTIFIABLE * np.maximum(
            self.total, _IDENTIFIABLE * self.signal
        )
        if insensitive.any():
            raise _refusal(
                self._named(insensitive),
                f"cannot be identified from this {self.observed.noun}: the sensitivity is zero",
                sentence(f"{self.observed.where} it acts"),
            )
        _, s, Vt = thin_svd(self.projected / np.linalg.norm(self.projected, axis=0))
        s = np.concatenate([s, np.zeros(len(Vt) - len(s))])
        blind = Vt[s <= _IDENTIFIABLE * s[0]]
        if len(blind):
            involved = np.abs(blind).max(axis=0) > 1e-3
            named = [group.identifiable for group in self.groups() if group.identifiable]
            seen = ""
            if named and self.values is not None:
                seen = f", which shows only {' and '.join(named)}"
            raise _refusal(
                self._named(involved),
                f"cannot be distinguished in this {self.observed.noun}{seen}",
                f"Fix some of them at a value, or add {self.observed.more}.",
            )

    def bounds(self) -> Array:
        """Return bounds on the standard errors of the coordinates (p), infinite where not identifiable."""
        size = np.linalg.norm(self.projected, axis=0)
        # Sensitivities that are round-off beside the initial state or the signal are no information.
        sensitive = size > _IDENTIFIABLE * np.maximum(self.total, _IDENTIFIABLE * self.signal)
        bounds = np.full(len(size), np.inf)
        if not sensitive.any():
            return bounds
        _, s, Vt = thin_svd(self.projected[:, sensitive] / size[sensitive])
        s = np.concatenate([s, np.zeros(len(Vt) - len(s))])
        resolved = s > _IDENTIFIABLE * s[0]
        blind = np.sqrt(np.sum(Vt[~resolved] ** 2, axis=0)) > _MIN_BLIND_SHARE
        deviation = np.sqrt(np.sum((Vt[resolved] / s[resolved, None]) ** 2, axis=0)) / size[sensitive]
        bounds[sensitive] = np.where(blind, np.inf, deviation)
        return bounds

    def dependent(self) -> list[int]:
        """Return places of parameters without which the others are identifiable; as few as there can be.

        Those to which the record is least sensitive come first.
        """
        size = np.linalg.norm(self.projected, axis=0)
        sensitive = size > _IDENTIFIABLE * np.maximum(self.total, _IDENTIFIABLE * self.signal)
        kept: list[int] = []
        for k in np.argsort(-size, kind="stable").tolist():
            if sensitive[k] and len(kept) < self.freedom:
                columns = self.projected[:, [*kept, k]] / size[[*kept, k]]
                if np.linalg.svd(columns, compute_uv=False)[-1] > _IDENTIFIABLE:
                    kept.append(k)
        return sorted(set(range(len(size))) - set(kept))

    def groups(self, level: float = _IDENTIFIABLE) -> list[_CollinearGroup]:
        """Return the groups of parameters that cannot be distinguished, as `collinear_groups` does."""
        values = np.ones(len(self.names)) if self.values is None else self.values
        rates = np.ones(len(self.names)) if self.rates is None else self.rates
        return collinear_groups(self.names, values, rates, self.projected, level)

    def covariance(self) -> Array:
        """Return the Cramér–Rao bound on the covariance of the coordinates (p x p)."""
        return np.asarray(self.root @ self.root.T)

    @cached_property
    def root(self) -> Array:
        """A root of that covariance (p x p)."""
        return self.root_of(np.ones(len(self.names), dtype=bool))

    def root_of(self, free: NDArray[np.bool_]) -> Array:
        """Return a root of the covariance (p x p) with all parameters but those `free` (p) fixed."""
        size = np.linalg.norm(self.projected[:, free], axis=0)
        R = np.linalg.qr(self.projected[:, free] / size, mode="r")
        root = np.zeros((len(free), len(free)))
        root[np.ix_(free, free)] = np.linalg.solve(R, np.eye(len(size))) / size[:, None]
        return root

    def deviations(self) -> Array:
        """Return the lower bound on the standard deviations of the coordinates (p)."""
        return np.sqrt(self.covariance().diagonal())

    def correlation(self) -> Array:
        """Return the correlations of the estimates of the coordinates (p x p)."""
        covariance = self.covariance()
        deviations = np.sqrt(covariance.diagonal())
        correlation = np.clip(covariance / np.outer(deviations, deviations), -1.0, 1.0)
        np.fill_diagonal(correlation, 1.0)
        return np.asarray(correlation)

    def condition(self) -> float:
        """Return the condition number of the information scaled to unit diagonal."""
        _, s, _ = thin_svd(self.projected / np.linalg.norm(self.projected, axis=0))
        return float((s[0] / s[-1]) ** 2)

    def step(self, residual: Array) -> Array:
        """Return the Gauss–Newton step of the coordinates (p) for this residual over noise (values)."""
        size = np.linalg.norm(self.projected, axis=0)
        size = np.where(size > 0, size, 1.0)
        rank = float(len(residual) * np.finfo(float).eps)
        return np.asarray(least_squares(self.projected / size, residual, rank) / size)

    def _named(self, chosen: NDArray[np.bool_]) -> list[str]:
        return [name for name, yes in zip(self.names, chosen, strict=True) if yes]


def information(
    names: tuple[str, ...],
    by_parameter: Array,
    by_state: Array,
    signal: float,
    count: int,
    values: Array | None = None,
    rates: Array | None = None,
    observed: Observed = RECORD,
) -> Information:
    """Collect the information of a record.

    `names`: the parameters (p); `by_parameter`, `by_state`: sensitivities over noise, or a triangle of them
    (rows x p, rows x n), the states in the units of their prior. `signal`: norm of the predicted values over
    noise; `count`: how many values there are. `values`, `rates`, `observed`: as of `Information`.
    """
    projected, rank_of_state = without_state(by_parameter, by_state)
    total = np.linalg.norm(by_parameter, axis=0)
    return Information(names, projected, total, signal, count - rank_of_state, values, rates, observed)


def joint_information(parts: Sequence[Information]) -> Information:
    """Return the information of several records together, whose initial states are each their own."""
    if len(parts) == 1:
        return parts[0]
    return replace(
        parts[0],
        projected=np.concatenate([record.projected for record in parts]),
        total=np.linalg.norm([record.total for record in parts], axis=0),
        signal=float(np.linalg.norm([record.signal for record in parts])),
        freedom=sum(record.freedom for record in parts),
    )


def below_noise(names: list[str], observed: Observed = RECORD) -> NotIdentifiable:
    """Return the error that names parameters whose standard errors exceed their order of magnitude."""
    return _refusal(
        names,
        f"cannot be estimated from this {observed.noun}: the sensitivity is below the noise",
        f"{observed.less_noise}, or fix some at a value.",
    )


def vanished(names: list[str], noun: str) -> NotIdentifiable:
    """Return the error that names parameters whose estimates have run to 0."""
    several = len(names) > 1
    return _refusal(
        names,
        f"{'are' if several else 'is'} indistinguishable from 0: the smaller, the better the {noun} is "
        "explained",
        f"Leave {'them' if several else 'it'} out, or estimate {'them' if several else 'it'} with "
        "`scale: linear`, which allows 0 and negative values.",
    )


def _refusal(names: list[str], why: str, remedy: str) -> NotIdentifiable:
    return NotIdentifiable(f"{', '.join(names)} {why}", remedy=remedy, names=names)
