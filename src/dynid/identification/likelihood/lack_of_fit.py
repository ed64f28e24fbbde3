"""Lack of fit of a model: three models of a record are compared, none, saturated and the scene's.

*None* is noise alone. In the *saturated* model amplitudes, residues, decays and poles are free, which the
scene's model ties to a few unknowns (`saturated_model`). From these follow

- `signal_p`: the probability of no response, by the F-test of the saturated against none. Where the
  regressors do not depend on the estimate, as at excited frequencies, it is exact for white noise; poles were
  chosen to suit the record: their test counts as one of N^p (Bonferroni), N values and p unknowns.
- `lack_of_fit_p`: that of the scene's model, by its F-test against the saturated one, and by the whiteness of
  its residuals, which is sensitive to what neither model has (Bonferroni). Both models are linear about the
  estimate: residuals are first projected onto the complement of initial states and unknowns.
- `redundancy`: how many numbers of the saturated model the record resolves beyond the unknowns. Only they can
  contradict the model; where there are none, any model fits.

Values whose scatter is given, such as measured modes, have no saturated model: all of them are signal, and
their residuals are tested by chi-squared, together with those of the Gaussian priors. So the test is of the
statistical model that the estimate maximises. Of M measured values beyond nuisances and Q priors the degrees
of freedom are M + Q less the number of unknowns that they determine and that are at no limit (of those at a
limit: M. J. Silvapulle, P. K. Sen, Constrained Statistical Inference, 2005, sec. 3.4). The sum is divided
into independent ones of the frequencies, of the damping ratios and of the rest, lest the many components of
shapes hide an error of one frequency; the p-value is that of the least one of k, 1 - (1 - p)^k.

Each channel is weighted by the residual noise of the saturated model with delayed residuals. G. A. F. Seber,
A. J. Lee, Linear Regression Analysis, 2nd ed. 2003, ch. 4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, finite
from dynid.defaults import EXPLAINED, LACK_OF_FIT, RESOLVED, SIGNAL
from dynid.identification.least_squares import basis, thin_svd
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.likelihood.record_likelihood import ScatterTest
from dynid.identification.likelihood.saturated_model import RegressorKind, SaturatedCoordinates
from dynid.identification.statistics import chi_squared_tail, log_f_tail

# Residuals below this part of a channel's RMS are errors of rounding and holds; a number of the saturated
# model below this one is not resolved, whatever the noise.
_RESIDUAL_ROUND_OFF, _RESOLVED_ROUND_OFF = 1e-6, 1e-4
# Singular values below this part of the largest are none.
_BASIS_RANK_TOL = 1e-9


@dataclass(frozen=True, eq=False)
class ModelComparison:
    """Three models of all records compared."""

    # The channels of each record in directions of their saturated models, in units of their RMS.
    records: Sequence[Sequence[SaturatedCoordinates]]
    # The noise that is given (channels of each record), in the same units, NaN where none is.
    given: Sequence[Array]
    prior: Array  # deviations of the priors of the unknowns (p), NaN where there are none
    free: NDArray[np.bool_]  # mask of unknowns that no bound fixes (p)
    whiteness_p: float = 1.0  # the p-value of the whiteness of the residuals
    # Residuals of records whose scatter is given; these have no channels in `records`.
    tables: Sequence[ScatterTest] = ()
    # `prior_squares`, `prior_degrees`: sum of squares of the priors' residuals over their deviations, and its
    # degrees of freedom
    prior_squares: float = 0.0
    prior_degrees: float = 0.0

    @cached_property
    def noise(self) -> list[Array]:
        """Residual noise of the saturated model (channels of each record), over RMS, not below rounding."""
        return [
            np.array([_noise(channel, level) for channel, level in zip(channels, levels, strict=True)])
            for channels, levels in zip(self.records, self.given, strict=True)
        ]

    @property
    def _each(self) -> list[tuple[SaturatedCoordinates, float]]:
        """All channels with their noise."""
        pairs = zip(self.records, self.noise, strict=True)
        return [pair for record, noise in pairs for pair in zip(record, noise.tolist(), strict=True)]

    @cached_property
    def signal_p(self) -> float:
        """The p-value of the records, were there no response."""
        if self.tables:
            return 0.0
        tests = [self._log_signal_p(RegressorKind.LINE)]
        values = sum(channel.count for channel, _ in self._each)
        chosen = len(self.prior) * math.log(max(values, 1))
        tests.append(self._log_signal_p(RegressorKind.SCENE) + chosen)
        return min(1.0, len(tests) * math.exp(min(0.0, *tests)))

    def _log_signal_p(self, last: int) -> float:
        """Return the logarithm of the p-value of directions of the kinds up to this one against noise."""
        excess, degrees, spare = 0.0, 0, math.inf
        for channel, _ in self._each:
            chosen = channel.kind <= last
            inside, m = float(np.sum(channel.measured[chosen] ** 2)), int(np.count_nonzero(chosen))
            left = channel.count - m
            if m == 0 or left < 1:
                continue
            outside = max(channel.energy - inside, _RESIDUAL_ROUND_OFF**2 * channel.energy)
            excess, degrees, spare = excess + inside * left / outside, degrees + m, min(spare, left)
        return log_f_tail(degrees, spare, excess / degrees) if degrees else 0.0

    @cached_property
    def lack_of_fit_p(self) -> float:
        """The p-value of the residuals, were the scene's model right."""
        if not self.tables:
            return self._saturated_p
        return self.scatter_p if not self._each else min(1.0, 2 * min(self.scatter_p, self._saturated_p))

    @property
    def chi_squared(self) -> tuple[float, int]:
        """Sum of squares of the values whose scatter is given, and of the priors; its degrees of freedom."""
        squares = self.prior_squares + sum(float(table.squares.sum()) for table in self.tables)
        return squares, round(self.prior_degrees + sum(float(table.degrees.sum()) for table in self.tables))

    @property
    def scatter_p(self) -> float:
        """The p-value of the residuals of the values whose scatter is given, and of the priors."""
        squares, degrees = self.chi_squared
        groups = [group for table in self.tables for group in table.groups if group[1] > 0]
        groups.append((squares - sum(s for s, _ in groups), degrees - sum(d for _, d in groups)))
        tails = [chi_squared_tail(d, max(s, 0.0)) for s, d in groups if d > 0]
        min_p = min(tails, default=1.0)
        return -math.expm1(len(tails) * math.log1p(-min_p)) if min_p < 1 else 1.0

    @cached_property
    def _saturated_p(self) -> float:
        """The p-value of the residuals beside those of the saturated model."""
        if all(
            channel.left < _RESIDUAL_ROUND_OFF**2 * channel.energy for channel, _ in self._each
        ):  # round-off
            return 1.0
        excess, rank = self._excess
        degrees = sum(channel.tested for channel, _ in self._each) - rank
        spare = min((channel.count - len(channel.kind) for channel, _ in self._each), default=0.0)
        if degrees < 1 or spare < 1:
            return self.whiteness_p
        return min(1.0, 2 * min(self.whiteness_p, math.exp(log_f_tail(degrees, spare, excess / degrees))))

    @cached_property
    def channel_lack_of_fit_p(self) -> Array:
        """The F-test channel by channel (channels of all records); unknowns take an equal part of each."""
        _, rank = self._excess
        p_values = []
        for channel, noise in self._each:
            degrees = channel.tested - rank / len(self._each)
            spare = channel.count - len(channel.kind)
            if degrees < 1 or spare < 1 or channel.left < _RESIDUAL_ROUND_OFF**2 * channel.energy:
                p_values.append(1.0)
                continue
            ratio = float(np.sum(channel.residual[: channel.tested] ** 2)) / noise**2 / degrees
            p_values.append(math.exp(log_f_tail(round(degrees), spare, ratio)))
        for table in self.tables:
            pairs = zip(table.degrees.tolist(), table.squares.tolist(), strict=True)
            p_values += [chi_squared_tail(round(d), x) if d >= 0.5 else 1.0 for d, x in pairs]
        return np.array(p_values)

    @cached_property
    def _excess(self) -> tuple[float, int]:
        """Sum of squares that the saturated model explains and the unknowns cannot; rank of the unknowns."""
        if not self._each:
            return 0.0, 0
        total, states, rows, right = 0.0, 0, [], []
        for record, noise, (U, by_parameter) in zip(self.records, self.noise, self._projected, strict=True):
            pairs = zip(record, noise, strict=True)
            residual = np.concatenate(
                [channel.residual[: channel.tested] / level for channel, level in pairs]
            )
            residual = _without(U, residual)
            total, states = total + float(residual @ residual), states + U.shape[1]
            rows.append(by_parameter)
            right.append(residual)
        U = _range(np.concatenate(rows)[:, self.free])
        explained = U.T @ np.concatenate(right)
        return max(0.0, total - float(explained @ explained)), states + U.shape[1]

    @cached_property
    def _projected(self) -> list[tuple[Array, Array]]:
        """Range of the initial states, and derivatives by the parameters off it, record by record."""
        return [_off_states(*pair) for pair in zip(self.records, self.noise, strict=True)]

    @cached_property
    def signal_explained(self) -> float:
        """Part of the signal's mean square that the scene explains, the noise subtracted from both."""
        if self.tables:
            of_waves = replace(self, tables=()).signal_explained if self._each else 1.0
            return min(of_waves, *(table.explained for table in self.tables))
        signal = missed = 0.0
        unknowns = self._excess[1] / max(1, len(self._each))
        for channel, noise in self._each:
            if channel.energy > 0:
                signal += max(0.0, channel.energy - channel.count * noise**2) / channel.energy
                missed += (
                    max(0.0, channel.left - max(0.0, channel.count - unknowns) * noise**2) / channel.energy
                )
        return float(np.clip(1 - missed / signal, 0.0, 1.0)) if signal > 0 else 0.0

    @property
    def lacks_fit(self) -> bool:
        """True if the residuals contradict the model."""
        return self.lack_of_fit_p <= LACK_OF_FIT.value

    @property
    def has_signal(self) -> bool:
        """True if the records have a response that differs from noise."""
        return self.signal_p < SIGNAL.value

    @property
    def explained(self) -> bool:
        """True if the model explains the records."""
        return self.has_signal and (not self.lacks_fit or self.signal_explained >= EXPLAINED.value)

    @cached_property
    def redundancy(self) -> int:
        """Number of independent values that the records resolve beyond the unknowns."""
        return self.redundancy_at(self.noise)

    def redundancy_at(self, noise: Sequence[Array]) -> int:
        """Return the redundancy for a noise (channels of each record), in units of the channels' RMS."""
        resolved, rows = 0, []
        for k, (record, levels) in enumerate(zip(self.records, noise, strict=True)):
            level = np.maximum(levels, _RESOLVED_ROUND_OFF)
            same = np.array_equal(level, self.noise[k])
            U, by_parameter = self._projected[k] if same else _off_states(record, level)
            rows.append(by_parameter)
            amplitudes = [
                _resolved(channel, noise_of_channel)
                for channel, noise_of_channel in zip(record, level.tolist(), strict=True)
            ]
            shown = np.concatenate(amplitudes)
            finite("the amplitudes of the record", shown)
            resolved += _count_beyond(U, shown, RESOLVED.value)
            resolved += _resolved_poles(record, level.tolist(), amplitudes)
        for table in self.tables:
            resolved += table.values
            rows.append(table.by_parameter)
        # Unknowns that the records determine: all without a prior, and those of which they know more than it.
        # Limits do not count: parameters between them are unknowns, as many as the records can tell apart.
        by_parameters, with_prior = np.concatenate(rows), ~np.isnan(self.prior)
        directions = _range(by_parameters[:, ~with_prior])
        over_prior = _without(directions, by_parameters[:, with_prior]) * self.prior[with_prior]
        unknowns = int(directions.shape[1])
        if over_prior.size:
            unknowns += int(np.count_nonzero(np.linalg.svd(over_prior, compute_uv=False) >= 1))
        return resolved - min(resolved, unknowns)


def compare_models(likelihood: Likelihood, fit: Fit, whiteness_p: float | None = None) -> ModelComparison:
    """Compare three models of records.

    `likelihood`: model and records; `fit`: the scene's model at some values of its unknowns. `whiteness_p`:
    the p-value of the whiteness of its residuals, if it is known already.
    """
    records = list(likelihood.records)
    # Records that a filter has coloured are not tested for whiteness.
    plain = all(record.data.passed == 1 for record in records)
    white = likelihood.whiteness(fit) if plain and whiteness_p is None else whiteness_p

    priors = likelihood.priors
    free = ~priors.at_bound(fit.eta)

    def root() -> Array:
        return likelihood.information(fit, likelihood.likeliest(fit)).root_of(free)

    tables_or_none = [
        record.tested(record_fit, root) for record, record_fit in zip(records, fit.parts, strict=True)
    ]
    saturated = [k for k, table in enumerate(tables_or_none) if table is None]
    squares = degrees = 0.0
    if len(saturated) < len(tables_or_none):
        squares = float(np.sum(priors.gaussian_residual(fit.eta) ** 2))
        gaussian = priors.has_prior & ~priors.fixed
        part_of_prior = (np.linalg.norm(root(), axis=1) / priors.deviations)[gaussian] ** 2
        degrees = float(np.sum(1 - part_of_prior))
    return ModelComparison(
        [records[k].coordinates(fit.parts[k]) for k in saturated],
        [records[k].stated_noise / records[k].data.rms for k in saturated],
        priors.deviations,
        free,
        white if plain and white is not None else 1.0,
        [table for table in tables_or_none if table is not None],
        squares,
        degrees,
    )


def _noise(channel: SaturatedCoordinates, given_noise: float) -> float:
    """Return the residual noise of a channel with the saturated model, else the given one."""
    floor = _RESIDUAL_ROUND_OFF * math.sqrt(channel.energy / max(channel.count, 1.0))
    spare = channel.count - len(channel.kind)
    if spare < 1:
        return float(np.fmax(given_noise, max(floor, math.sqrt(channel.left / max(channel.count, 1.0)))))
    left = max(0.0, channel.left - float(np.sum(channel.residual**2)))
    return max(floor, math.sqrt(left / spare))


def _off_states(record: Sequence[SaturatedCoordinates], noise: Array) -> tuple[Array, Array]:
    """Return the range of the derivatives by the initial state over noise, and those by parameters off it."""
    pairs = list(zip(record, noise.tolist(), strict=True))
    U = _range(np.concatenate([channel.by_state[: channel.tested] / level for channel, level in pairs]))
    return U, _without(
        U, np.concatenate([channel.by_parameter[: channel.tested] / level for channel, level in pairs])
    )


def _range(matrix: Array) -> Array:
    """Return an orthonormal basis of the range of the columns, scaled to one length."""
    largest = np.max(np.abs(matrix), axis=0, initial=0.0)
    scaled = matrix[:, largest > 0] / largest[largest > 0]  # whose squares do not overflow
    return basis(scaled / np.linalg.norm(scaled, axis=0), _BASIS_RANK_TOL)


def _without(U: Array, columns: Array) -> Array:
    """Return columns projected onto the complement of the range of U."""
    return np.asarray(columns - U @ (U.T @ columns))


def _count_beyond(U: Array, shown: Array, level: float) -> int:
    """Return how many singular values of diag(shown) (m x m), off the range of U (m x k), exceed a level.

    Each of `shown` is beyond the level or 0.
    """
    # They are those roots of D (I - U U^T) D: as many as are positive of D^2 - level^2 I - (D U) (D U)^T, by
    # Sylvester's law m less the negative ones of I - W^T W, W = (D^2 - level^2 I)^(-1/2) D U (m x k).
    beyond = shown > 0
    ratio = level / shown[beyond]
    W = U[beyond] / np.sqrt((1 - ratio) * (1 + ratio))[:, None]
    return len(W) - int(np.count_nonzero(thin_svd(W)[1] >= 1))


def _resolved(channel: SaturatedCoordinates, noise: float) -> Array:
    """Return the amplitudes over noise of the directions that are resolved, 0 of the others (m)."""
    free = channel.free
    # Groups of lines are even, of modes odd.
    groups = np.where(free, 2 * channel.group + channel.kind, 0)[: channel.tested]
    weight = free[: channel.tested].astype(float)
    squares = np.bincount(groups, weight * channel.measured[: channel.tested] ** 2)
    amplitude = np.sqrt(squares / np.maximum(np.bincount(groups, weight), 1.0)) / noise
    return np.asarray(weight * np.where(amplitude > RESOLVED.value, amplitude, 0.0)[groups])


def _resolved_poles(
    record: Sequence[SaturatedCoordinates], noise: Sequence[float], amplitudes: Sequence[Array]
) -> int:
    """Return the number of poles that a record resolves, a pair counting twice."""
    # A pole is resolved where moving it by itself moves the record by more than the noise. `amplitudes` are
    # those of the channels, as of `_resolved`.
    strength: dict[complex, float] = {}
    for channel, level, shown in zip(record, noise, amplitudes, strict=True):
        moves = np.flatnonzero(channel.kind == RegressorKind.POLE)
        if not len(moves):
            continue
        modes = np.flatnonzero((channel.kind[: channel.tested] == RegressorKind.MODE) & (shown > 0))
        groups, count = channel.group[moves], int(channel.group.max()) + 1
        amplitude = np.bincount(
            channel.group[modes], (channel.measured[modes] / channel.size[modes]) ** 2, count
        )
        sums = np.bincount(groups, (channel.size[moves] * channel.rate[moves] / level) ** 2, count)
        squares = amplitude * (sums / np.maximum(np.bincount(groups, minlength=count), 1))
        for group, pole in dict(zip(groups.tolist(), channel.pole[moves].tolist(), strict=True)).items():
            strength[pole] = strength.get(pole, 0.0) + float(squares[group])
    poles = [pole for pole, squares in strength.items() if squares > RESOLVED.value**2]
    return sum(2 if pole.imag else 1 for pole in poles)
