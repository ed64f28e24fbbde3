"""Identifiability before a run: bounds, collinear parameters, modal sensitivities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray, guarded
from dynid.errors import NotIdentifiable
from dynid.identification.diagnosis.calibration import add_calibration_slopes, calibration_slopes
from dynid.identification.diagnosis.equivalent_optima import expected_optima
from dynid.identification.diagnosis.residuals import channels_of_records
from dynid.identification.diagnosis.symmetry import interchangeable
from dynid.identification.diagnosis.verdict import deciding_text, interchange_text
from dynid.identification.information import Information
from dynid.identification.least_squares import thin_svd
from dynid.identification.likelihood.lack_of_fit import compare_models
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.problem import Measured, Problem, identifiable_origin
from dynid.identification.systems.delayed_loops import delayed_pole_slopes
from dynid.identification.systems.linear_system import LinearSystem
from dynid.identification.systems.parametric_model import Model, Rebuild
from dynid.lti.exponential import balance, rescaled
from dynid.parameters import coordinates, named, rates, starts, truths, values
from dynid.result import Result, common_unit
from dynid.structure.model import StructuralModel
from dynid.structure.poles import PoleSensitivities, pole_sensitivities

#: Noise over RMS that is assumed where nothing is known of it.
NOMINAL_NOISE = 0.01
# Singular values of the scaled sensitivities, over the largest, below which parameters are ill conditioned,
# and below which they are not identifiable.
_ILL_CONDITIONED, _NOT_IDENTIFIABLE = 1e-3**0.5, 1e-8
# Poles below this part of the largest are at zero; left and right vectors this near to orthogonal are those
# of a multiple pole.
_AT_REST_REL_TOL, _DEFECTIVE_COSINE = 1e-9, 1e-7


@dataclass(frozen=True, eq=False)
class ExpectedRecords:
    """Expected records, at expected values of the parameters."""

    likelihood: Likelihood  # the likelihood of the records
    fit: Fit  # the prediction
    noise: list[Array]  # standard deviation of the noise of each record (channels)
    place: str  # which values of the parameters are taken: ``true`` or ``start``
    assumed: bool  # True if the noise is nominal, because it is neither known nor given

    @property
    def values(self) -> dict[str, float]:
        """The parameters by name."""
        return named(self.likelihood.unknowns, self.fit.eta)

    @property
    def relative_rates(self) -> Array:
        """Derivatives of the parameters by their coordinates, over their sizes (p): 1 of logarithms."""
        size = np.abs(values(self.likelihood.unknowns, self.fit.eta))
        rate = np.abs(rates(self.likelihood.unknowns, self.fit.eta))
        return np.where(size > 0, rate, np.inf) / np.where(size > 0, size, 1.0)

    @property
    def redundancy(self) -> int:
        """Number of independent values that the records resolve beyond the unknowns."""
        compared = compare_models(self.likelihood, self.fit)
        pairs = zip(self.likelihood.records, self.noise, strict=True)
        # Modes have no saturated model.
        levels = [level / record.data.rms for record, level in pairs if not record.modal]
        return compared.redundancy_at(
            [np.maximum(*both) for both in zip(levels, compared.noise, strict=True)]
        )

    def information(self) -> Information:
        """Return the information of the records on the parameters, initial states unknown."""
        return self.likelihood.information(self.fit, self.noise)


def with_true_noise(expected: ExpectedRecords) -> ExpectedRecords:
    """Return expected records with the noise that they are simulated with, also where it is not white."""
    records = expected.likelihood.records
    if all(record.data.colour is None and record.data.by_line is None for record in records):
        return expected
    likelihood = Likelihood(tuple(record.ideal() for record in records))
    pairs = zip(records, expected.noise, strict=True)
    levels = [record.level(nominal, ideal=True) for record, nominal in pairs]
    return replace(expected, likelihood=likelihood, fit=likelihood.fit(expected.fit.eta), noise=levels)


def expected_records(likelihood: Likelihood) -> ExpectedRecords:
    """Return the expected records at the true values where all are known, else at the starts."""
    unknowns = likelihood.unknowns
    true = truths(unknowns)
    at_truth = not np.isnan(true).any()
    if at_truth:
        eta = coordinates(unknowns, true)
    else:  # where an estimation begins
        try:
            eta = identifiable_origin(likelihood).eta
        except NotIdentifiable:
            eta = starts(unknowns)
    fit = likelihood.fit(eta, clean=True)
    noise, assumed = [], False
    for record in likelihood.records:
        level = record.data.noise if record.data.noise is not None else record.stated_noise_or(np.zeros(1))
        assumed = assumed or not level.all()
        noise.append(np.where(level > 0, level, NOMINAL_NOISE * record.data.rms))
    return ExpectedRecords(likelihood, fit, noise, "true" if at_truth else "start", assumed)


def identifiability(
    model: Model,
    measurements: Measured | Sequence[Measured],
    truth: Model | None = None,
    rebuild: Rebuild | None = None,
) -> Result:
    """Return the identifiability of the unknown parameters from measurements, by their Fisher information.

    Initial states count as unknown, and so does the noise level (at no cost: the information on it is
    independent of that on the parameters); forces, known joints and the rest of the structure count as known.

    Parameters
    ----------
    model, measurements, truth, rebuild
        As of `identify`.

    Returns
    -------
    Result
        ``identification/identifiability/``: `value` (where the information is taken: attribute `at`, true or
        start), `bound` (Cramér–Rao, on the standard error), `relative_bound` (over the value; infinite where
        a parameter is not identifiable), `relative_bound_known_state` (were the initial states known),
        `condition` and `singular_value` of the scaled information; `groups/{group, parameters, seen, blind}`:
        parameters that are ill conditioned (above 1000) or collinear, their identifiable combination, and
        the relative changes that are not identifiable; `noise/{channel, deviation, bound}`, of frequency
        responses of real and imaginary part each, over the deviation by line where that is given;
        `modal_sensitivity/{mode, omega, zeta, omega_by_parameter, zeta_by_parameter}`: exact derivatives of
        size and damping ratio of each pole; where unknowns are interchangeable,
        `interchangeable/{set, optima, undecided}`: which, the number of optima with equal likelihood, and how
        many of these priors and limits leave (attribute `deciding`: what would decide). The attribute `laws`
        names nonlinear laws of joints that do not act in the records, with the excitation that would.

    Raises
    ------
    NotIdentifiable, NumericalError, UsageError
        As of `identify`, except for parameters that are not identifiable: those have no bound here.
    """
    names = [unknown.name for unknown in model.unknowns]
    with guarded(f"the identifiability of {', '.join(names)}", names=names):
        problem = Problem.of(model, measurements, truth=truth, rebuild=rebuild)
        expected = with_true_noise(expected_records(problem.likelihood))
        return identifiability_result(problem.model, expected)


def add_expected_slopes(result: Result, expected: ExpectedRecords) -> None:
    """Add ``considered/``: expected slopes by the calibration; NaN of parameters not identifiable."""
    unbounded = ~np.isfinite(expected.information().bounds())
    likelihood, free = expected.likelihood, np.zeros(len(unbounded), dtype=bool)
    calibration = calibration_slopes(likelihood, expected.fit, expected.noise, free)
    slopes = np.where(unbounded[:, None], np.nan, calibration.slopes)
    unknowns, eta = likelihood.unknowns, expected.fit.eta
    size = np.abs(values(unknowns, eta))
    relative = rates(unknowns, eta) / np.where(size > 0, size, 1.0)
    add_calibration_slopes(result, calibration._replace(slopes=slopes), relative)


def identifiability_result(model: Model, expected: ExpectedRecords) -> Result:
    """Return the identifiability of the parameters from expected records, as `identifiability` does."""
    result = Result("identification")
    group, dims = "identification/identifiability", ("parameter",)
    unknowns, records = expected.likelihood.unknowns, expected.likelihood.records
    information = expected.information()
    unit = common_unit(unknown.unit for unknown in unknowns)
    eta = expected.fit.eta
    bounds = information.bounds()
    bounds = np.where(expected.likelihood.priors.open(bounds), np.inf, bounds)
    value, bounds = values(unknowns, eta), rates(unknowns, eta) * bounds
    result.annotate(group, at=expected.place, noise="assumed" if expected.assumed else "known")
    result.add_axis(f"{group}/parameter", [unknown.name for unknown in unknowns])
    result.add(f"{group}/unit", [unknown.unit for unknown in unknowns], dims)
    result.add_all(group, dims, unit, value=value, bound=bounds)
    relative = np.where(value == 0, np.inf, np.abs(value))
    result.add_all(group, dims, relative_bound=bounds / relative, identifiable=np.isfinite(bounds))
    # The bounds were the initial states known: nothing is projected out.
    fits = zip(records, expected.fit.parts, expected.noise, strict=True)
    full = np.concatenate([record.slopes(record_fit, level) for record, record_fit, level in fits])
    count = sum(int(record.data.counts.sum()) for record in records)
    total = np.linalg.norm(full, axis=0)
    known_state = replace(information, projected=full, total=total, freedom=count)
    known_state_bounds = rates(unknowns, eta) * known_state.bounds()
    result.add(f"{group}/relative_bound_known_state", known_state_bounds / relative, dims)
    size = np.linalg.norm(information.projected, axis=0)
    _, s, _ = thin_svd(information.projected / np.where(size > 0, size, 1.0))
    s = np.concatenate([s, np.zeros(len(size) - len(s))])
    result.add(f"{group}/singular_value", s, ("direction",))
    result.add_axis(f"{group}/direction", np.arange(1, len(s) + 1))
    result.add(f"{group}/condition", (s[0] / s[-1]) ** 2 if s[-1] > _NOT_IDENTIFIABLE * s[0] else np.inf)
    _add_groups(result, information)
    _add_interchangeable(result, model, expected)
    if not all(record.superposes for record in records):
        from dynid.identification.diagnosis.idle_laws import idle_laws  # of joints with laws alone

        result.annotate(group, laws="\n".join(idle_laws(expected.likelihood, expected.fit)))
    # The bound on the deviation of the noise is sigma over the root of twice the number of values.
    channels = channels_of_records(records)
    unit = common_unit(channel.unit for channel in channels)
    counts = [np.count_nonzero(~np.isnan(record_fit.residual), axis=0) for record_fit in expected.fit.parts]
    deviation = np.concatenate(expected.noise)
    bound = deviation / np.sqrt(2 * np.concatenate(counts))
    result.add_axis(f"{group}/noise/channel", [channel.name for channel in channels])
    result.add_all(f"{group}/noise", ("channel",), unit, deviation=deviation, bound=bound)
    if isinstance(model, StructuralModel):
        sensitivities = pole_sensitivities(model, expected.values)
    else:
        sensitivities = _system_pole_sensitivities(records[0].system_model, expected.values)
    _add_modal_sensitivity(result, sensitivities, [unknown.name for unknown in unknowns])
    return result


def _add_groups(result: Result, information: Information) -> None:
    """Add ``groups/``: groups of collinear parameters."""
    group = "identification/identifiability/groups"
    groups = information.groups(_ILL_CONDITIONED)
    result.add_axes(group, parameter=information.names, group=np.arange(1, len(groups) + 1))
    named = [", ".join(information.names[index] for index in item.places) for item in groups]
    seen = np.array([item.identifiable for item in groups], dtype=object)
    result.add_all(group, ("group",), parameters=np.array(named, dtype=object), seen=seen)
    changes = [(number, item, blind) for number, item in enumerate(groups, 1) for blind in item.blind]
    rows = np.zeros((len(changes), len(information.names)))
    for row, (_, item, blind) in zip(rows, changes, strict=True):
        row[list(item.places)] = blind
    result.add_axis(f"{group}/blind_direction", np.arange(1, len(rows) + 1))
    result.add(f"{group}/blind", rows, ("blind_direction", "parameter"))
    result.add(f"{group}/of_group", np.array([n for n, _, _ in changes], dtype=int), ("blind_direction",))


def _add_interchangeable(result: Result, model: Model, expected: ExpectedRecords) -> None:
    """Add ``interchangeable/``, where there are such parameters: their number of optima, and what decides."""
    likelihood = expected.likelihood
    identifiable = np.isfinite(expected.information().bounds())
    optima = expected_optima(model, likelihood, expected.fit.eta, identifiable)
    if optima is None:
        return
    group = "identification/identifiability/interchangeable"
    sets = interchangeable(likelihood.names, optima.permutations)
    result.add_axis(f"{group}/set", np.array([interchange_text(groups) for groups in sets], dtype=object))
    result.add(f"{group}/optima", len(optima))
    result.add(f"{group}/undecided", int(np.count_nonzero(optima.undecided)))
    guessed = expected.place != "true"
    remedy = deciding_text(likelihood.unknowns, optima.eta, optima.sensors, guessed=guessed)
    result.annotate(group, deciding=remedy)


def _system_pole_sensitivities(system: LinearSystem, values: Mapping[str, float]) -> PoleSensitivities:
    """Return the poles of a system other than zero with their derivatives: y' dA x / y' x of a simple one."""
    if system.delayed:
        poles, moved = delayed_pole_slopes(system.lft(values), system.loop_delays(values))
        kept = poles.imag >= 0
        return _sensitivities(poles[kept], moved[kept], ~np.isfinite(moved[kept]))
    from scipy.linalg import eig  # heavy import, needed here only

    matrices = system.at(values)
    d = balance(matrices.A)
    A, slopes = rescaled(matrices.A, d), rescaled(matrices.A_slopes, d)
    eigen: Any = eig(A, left=True)
    poles, left, right = eigen
    order = np.argsort(np.abs(poles), kind="stable")
    kept = order[
        (poles.imag[order] >= 0) & (np.abs(poles[order]) > _AT_REST_REL_TOL * np.abs(poles).max(initial=0.0))
    ]
    poles, y, x = poles[kept], left[:, kept].conj(), right[:, kept]
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = np.einsum("im,pij,jm->mp", y, slopes, x) / np.einsum("im,im->m", y, x)[:, None]
    defective = ~np.isfinite(moved) | (np.abs(np.einsum("im,im->m", y, x)) < _DEFECTIVE_COSINE)[:, None]
    return _sensitivities(poles, moved, defective)


def _sensitivities(
    poles: ComplexArray, slopes: ComplexArray, defective: NDArray[np.bool_]
) -> PoleSensitivities:
    """Return frequencies and damping of poles with their slopes, infinite where those of poles are."""
    moved = np.where(defective, 0.0, slopes)
    omega = np.abs(poles)
    zeta = -poles.real / omega
    by_omega = np.real(poles.conj()[:, None] * moved) / omega[:, None]
    by_zeta = (-moved.real - zeta[:, None] * by_omega) / omega[:, None]
    lost = np.where(defective, np.inf, 0.0)
    return PoleSensitivities(poles, omega, zeta, by_omega + lost, by_zeta + lost)


def _add_modal_sensitivity(result: Result, sensitivities: PoleSensitivities, names: Sequence[str]) -> None:
    """Add the derivatives of the poles by the unknown parameters."""
    group = "identification/identifiability/modal_sensitivity"
    result.add_axes(group, mode=np.arange(1, len(sensitivities.omega) + 1), parameter=names)
    result.add(f"{group}/omega", sensitivities.omega, ("mode",), "rad/s")
    result.add(f"{group}/zeta", sensitivities.zeta, ("mode",))
    result.add(f"{group}/pole", sensitivities.poles, ("mode",), "rad/s")
    dims = ("mode", "parameter")
    result.add(f"{group}/omega_by_parameter", sensitivities.omega_slopes, dims, per="unit of the parameter")
    result.add(f"{group}/zeta_by_parameter", sensitivities.zeta_slopes, dims, per="unit of the parameter")
