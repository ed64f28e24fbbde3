"""Identification: from a model with unknown parameters and its records to estimates with error bars.

One loop serves records of time and frequency responses: likelihood of the records, estimate, posterior; with
a reduced model whose basis follows the parameters, again until the estimate and the basis agree.

Source: K. T. Yang 1997.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.arrays import Array, guarded
from dynid.errors import Diverged, DynidError, NotIdentifiable
from dynid.identification.diagnosis.equivalent_optima import DECIDED, OptimaSearch, deciding_sensors
from dynid.identification.diagnosis.holds import better_hold
from dynid.identification.diagnosis.instrument_mistakes import instrument_mistakes
from dynid.identification.diagnosis.posterior import Posterior
from dynid.identification.diagnosis.proportional_noise import growing_residuals
from dynid.identification.diagnosis.symmetry import distinct_kinds, like_parameters
from dynid.identification.estimators.auto import Auto
from dynid.identification.estimators.estimate import Estimate, EstimationStage, Estimator, Sweep
from dynid.identification.estimators.filter import ended
from dynid.identification.estimators.maximum_likelihood import Huber
from dynid.identification.estimators.multi_start import drawn_starts
from dynid.identification.likelihood.frf_record import FrfLikelihood
from dynid.identification.likelihood.likelihood import Likelihood
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.problem import Measured, Problem, SharedRecords
from dynid.identification.results.write_result import Further, add_identification, raise_rejected
from dynid.identification.systems.parametric_model import Model, Rebuild, unknowns_of, with_fixed
from dynid.identification.systems.record_values import true_states
from dynid.native import call, compiled
from dynid.number_format import sentence
from dynid.parameters import named, starts
from dynid.result import Result
from dynid.structure.model import StructuralModel

if TYPE_CHECKING:
    from dynid.identification.diagnosis.form_error import FormError
    from dynid.identification.results.write_held_out import HeldOut

# Starts around an estimate from which other optima are looked for where a parameter is not identifiable, and
# the factor within which they lie.
_SEARCHED_STARTS, _SEARCHED_FACTOR = 8, 6.0
# Most searches from several starts that end at different optima, before what is left is refined alone.
_MAX_SEARCHES = 2
# A basis that follows the parameters is rebuilt until the estimates change by less than this many standard
# errors, or this part of themselves; and so often at the most.
_SETTLED_DEVIATIONS, _SETTLED_UNITS = 0.01, 1e-6
_MAX_REBUILDS = 10
# Of records beyond this size, bytes, freed arrays are returned to the system but for so many bytes: else the
# sizes of arrays that follow each other decide about the memory, and not those in use. To return smaller ones
# takes the system a fifth of the time.
_LARGE_RECORD, _KEPT_BYTES = 2**23, 2**26


def identify(
    model: Model,
    measurements: Measured | Sequence[Measured],
    estimator: Estimator | None = None,
    *,
    truth: Model | None = None,
    rebuild: Rebuild | None = None,
    common: SharedRecords | None = None,
    into: Result | None = None,
    further: Further | None = None,
    held_out: Sequence[HeldOut] = (),
) -> Result:
    """Identify the unknown parameters of a model from measurements that share them.

    Parameters
    ----------
    model
        The model the estimator works with, full or reduced. A large structure that is identified from modes
        alone is reduced to its lowest modes and their derivatives, and this basis follows the parameters.
    measurements
        Records of time, each with its own loads, channels, sampling, noise and unknown initial state; or
        frequency responses; a modal survey, alone or with either.
    estimator
        How to estimate; default: `Auto()`.
    truth
        The model that simulated measurements are made with; default: `model`.
    rebuild
        Returns the model for parameters by name: a reduced one whose basis follows the parameters. Estimation
        and rebuilding alternate until the estimates settle, at most ten times. Default: `model` stays.
    common
        Data that records of time share with those of other identifications, if they are computed already.
    into
        The result to add to; of a `Selection` only what is wanted is computed. Default: a new one.
    further
        What is computed beside the estimates.
    held_out
        Records of time that are predicted at the estimate, and not fitted.

    Returns
    -------
    Result
        ``identification/…``: the groups that `dynid.identification.results.write_result` describes, and with
        a modal survey ``modes/``, which `dynid.identification.results.write_modes` does.

    Raises
    ------
    NotIdentifiable
        If parameters are not identifiable, or a channel measures nothing but zeros.
    Diverged
        If estimates run away, or the prediction explains nothing of a record.
    Singular
        If a line of a frequency response lies on an undamped pole.
    NumericalError
        If a number leaves the range of double precision.
    UsageError
        If the arguments are inconsistent, or model and measurements are too large.
    """
    names = [unknown.name for unknown in unknowns_of(model)]
    with guarded(f"the identification of {', '.join(names)}", names=names):
        problem = Problem.of(model, measurements, truth=truth, rebuild=rebuild, common=common)
        if compiled() and any(
            record.data.values.nbytes > _LARGE_RECORD for record in problem.likelihood.records
        ):
            call("dynid_keep_memory", _KEPT_BYTES)
        estimator = estimator or Auto()
        suggest = into is None or into.wants("identification/diagnostics/warnings")
        suggest = suggest and problem.survey is None and not _has_laws(problem.model)
        posterior, last = posterior_of(problem, estimator, suggest=suggest)
        result, needed = Result("identification") if into is None else into, None
        additions: list[Callable[[Result, Posterior], None]] = []
        if further is not None and further.laws and result.wants_below("identification/laws"):
            from dynid.identification.diagnosis.law_comparison import compare_laws  # of candidates alone

            assert isinstance(last, StructuralModel)
            comparison = compare_laws(problem, last, posterior, further.laws)
            posterior = replace(posterior, next_laws=comparison.next_step)
            additions.append(lambda result, _: comparison.add_to(result))
        if posterior.rejection is not None:
            if problem.survey is not None:
                additions.append(partial(_add_modes, problem=problem))
            raise_rejected(posterior, *additions)
        if problem.survey is not None:
            from dynid.identification.diagnosis.form_error import needed_form_error  # of modal surveys alone

            if (needed := needed_form_error(posterior)) is not None:
                posterior = replace(posterior, mistakes=(*posterior.mistakes, needed.statement))
        add_identification(
            result,
            posterior,
            lambda: [true_states(problem.truth, last, *experiment) for experiment in problem.experiments],
            further,
        )
        for add in additions:
            add(result, posterior)
        if problem.survey is not None:
            _add_modes(result, posterior, problem=problem, needed=needed)
        if held_out and result.wants_below("identification/held_out"):
            from dynid.identification.results.write_held_out import add_held_out

            add_held_out(result, problem, last, posterior.fit.eta, held_out)
        return result


def _add_modes(
    result: Result, posterior: Posterior, *, problem: Problem, needed: FormError | None = None
) -> None:
    """Add measured and computed modes of a problem with a modal survey."""
    from dynid.identification.results.write_modes import add_modes  # of modal surveys alone

    assert problem.survey is not None
    assert isinstance(problem.full, StructuralModel)
    add_modes(result, posterior, problem.full, problem.survey, problem.rebuild, needed)


def posterior_of(problem: Problem, estimator: Any, *, suggest: bool = False) -> tuple[Posterior, Model]:
    """Return the posterior of the parameters, and the model at the end.

    Parameters that the records do not determine are fixed, one after the other, and the others estimated.
    `suggest`: mistakes of instruments are sought that explain a lack of fit.
    """
    problem = problem.weighted()
    model, likelihood, rebuild = problem.model, problem.likelihood, problem.rebuild
    values = [record.full_data for record in likelihood.records]
    origin, unknowns = problem.origin, model.unknowns
    eta = origin.eta
    fixed = {
        unknown.name: unknown.start if unknown.prior is None else unknown.prior.value
        for unknown in unknowns
        if unknown.name in origin.undetermined
    }
    astray: Posterior | None = None
    begun: Likelihood | None = None
    doubtful: dict[str, float] = {}
    searches = 0
    for _ in range(1 + len(unknowns)):
        if fixed:
            model = with_fixed(model, fixed)
            likelihood = problem.likelihood_of(model, values).continuing(likelihood)
        begun = begun or likelihood
        refit: Any = rebuild
        if rebuild is not None and fixed:
            refit = partial(lambda fixed, values: with_fixed(rebuild(values), fixed), dict(fixed))
        posterior, model = _settled(problem, model, likelihood, eta, estimator, refit, suggest=suggest)
        posterior = replace(posterior, undetermined=tuple(fixed))
        lost = _undetermined(posterior)
        if not lost:
            posterior, model = _with_optima(problem, posterior, model, refit)
            lost = _undetermined(posterior)
            if not lost:
                break
        fixed |= lost
        if posterior.estimate.disputed:  # at a wrong optimum a parameter may lose its effect
            doubtful |= lost
        searches += posterior.estimate.disputed
        # The search begins again, without what may have led it astray.
        if posterior.estimate.disputed and searches <= _MAX_SEARCHES:
            astray = astray or posterior
        else:
            eta, estimator = posterior.fit.eta, _with(estimator, multi_start=False)
            likelihood = posterior.likelihood
    if astray is not None and posterior.estimate.disputed:
        posterior = astray
    else:
        astray = None
        if doubtful and rebuild is None:
            others = {name: value for name, value in fixed.items() if name not in doubtful}
            posterior, model = _freed(problem, posterior, model, others, estimator, suggest=suggest)
    # What is fixed starts there; the scene's starts are those that are reported.
    posterior = replace(posterior, starts=tuple(unknown.start for unknown in unknowns))
    posterior = _checked(posterior, begun or likelihood, suggest)
    if astray is not None:
        return posterior, model
    full = isinstance(problem.truth, StructuralModel) and problem.truth.basis is None
    full = full and posterior.rejection is None and problem.survey is None and not _has_laws(model)
    if full and isinstance(model, StructuralModel) and model.basis is not None:
        posterior = _with_model_error(problem, posterior, model)
    return posterior, model


def _freed(
    problem: Problem,
    posterior: Posterior,
    model: Model,
    fixed: Mapping[str, float],
    estimator: Any,
    *,
    suggest: bool,
) -> tuple[Posterior, Model]:
    """Return the posterior with all but `fixed` free, and its model, if the records determine these there."""
    values = [record.full_data for record in posterior.likelihood.records]
    free = with_fixed(problem.model, fixed)
    likelihood = problem.likelihood_of(free, values).continuing(posterior.likelihood)
    nearest = _with(estimator, multi_start=False)
    freed, free = _settled(problem, free, likelihood, posterior.fit.eta, nearest, None, suggest=suggest)
    if _undetermined(freed):
        return posterior, model
    return _with_optima(problem, replace(freed, undetermined=tuple(fixed)), free, None)


def _settled(
    problem: Problem,
    model: Model,
    likelihood: Likelihood,
    eta: Array,
    estimator: Any,
    rebuild: Rebuild | None,
    *,
    suggest: bool,
) -> tuple[Posterior, Model]:
    """Return the posterior of an estimate from coordinates (p), and the model at the end."""
    # With `rebuild`, estimate and reduced basis are computed in turn until the estimate settles. A search
    # from several starts is made once. Of records of time it comes first: it finds the neighbourhood of the
    # optimum, which the later models share. Of frequency responses it comes last, if the residuals still
    # require it: those of a basis that does not follow the parameters yet need not be white, and a better
    # basis may make the search needless. The samples at which every input is known follow delays as they are
    # estimated.
    values = [record.full_data for record in likelihood.records]
    search_last = isinstance(likelihood, FrfLikelihood)
    here, most_rounds = estimator, _MAX_REBUILDS
    if search_last and rebuild is not None:
        here, most_rounds = _with(estimator, accept_small=True, multi_start=False), 2 * _MAX_REBUILDS
    before: Posterior | None = None
    for number in count(1):
        estimate = _estimated(here, likelihood, eta, suggest)
        if before is not None:
            estimate = _continued(before, likelihood, estimate)
        before = posterior = Posterior(estimate.likelihood or likelihood, estimator.name, estimate)
        covering = likelihood.covering(estimate.fit.eta, narrowed=number == 1)
        if rebuild is None:
            if covering is likelihood or number == most_rounds:
                break
            likelihood, eta = covering, estimate.fit.eta
            here = _with(here, multi_start=False, near=_noise_of(posterior))
            continue
        deviations = posterior.information.deviations()
        change, eta = np.abs(estimate.fit.eta - eta), estimate.fit.eta
        negligible = np.maximum(_SETTLED_DEVIATIONS * deviations, _SETTLED_UNITS * likelihood.priors.units)
        settled = bool(np.all(change <= negligible)) and covering is likelihood
        if search_last and (settled or number == _MAX_REBUILDS):
            searching = _with(here, multi_start=True)
            if posterior.explained or searching == here:
                break
            here = searching
        elif not search_last:
            if settled:
                break
            here = _with(here, multi_start=False, near=_noise_of(posterior))
        model = rebuild(named(model.unknowns, eta))
        if number == most_rounds:
            break
        likelihood = problem.likelihood_of(model, values)
        likelihood = likelihood.continuing(posterior.likelihood).continuing(covering)
    return posterior, model


def _has_laws(model: Model) -> bool:
    """Return True if a joint of a model has a nonlinear law."""
    return isinstance(model, StructuralModel) and model.nonlinear


def _astray(posterior: Posterior) -> bool:
    """Return True if a search was cut off, or ended where laws of joints explain nothing.

    Nothing is sought beside such an estimate: there the likelihood is flat, and every step long.
    """
    superposes = all(record.superposes for record in posterior.likelihood.records)
    return bool(posterior.estimate.cut_off) or (not superposes and bool(posterior.unexplained))


def _undetermined(posterior: Posterior) -> dict[str, float]:
    """Return the parameter that the records determine least, if that is not at all, with a value for it."""
    # None where the records have no response, where no other parameter would be left, or at no optimum.
    if _astray(posterior):
        return {}
    unknown, likelihood = posterior.unknown, posterior.likelihood
    left = ~(unknown | likelihood.priors.fixed)
    if not (unknown.any() and left.any() and posterior.comparison.has_signal):
        return {}
    k = int(np.argmax(np.where(unknown, posterior.information.deviations(), -np.inf)))
    return {likelihood.names[k]: likelihood.unknowns[k].value(posterior.admitted(k))}


def _with_optima(
    problem: Problem, posterior: Posterior, model: Model, rebuild: Rebuild | None
) -> tuple[Posterior, Model]:
    """Return a posterior at the optimum of greatest posterior, with the equivalent ones; and its model."""
    if _has_laws(model):  # whose estimators search from several starts themselves
        return posterior, model
    likelihood, estimate, lost = posterior.likelihood, posterior.estimate, posterior.undetermined
    values = [record.full_data for record in likelihood.records]

    def likelihood_at(eta: Array) -> Likelihood:
        assert rebuild is not None
        rebuilt = problem.likelihood_of(rebuild(named(model.unknowns, eta)), values)
        return rebuilt.with_noise_of(likelihood)

    ends = [
        stage.eta for stage in estimate.stages if stage.misfit < likelihood.misfit(posterior.fit) + DECIDED
    ]
    searched = _SEARCHED_STARTS if lost else 3 if posterior.optimal or estimate.disputed else 0
    if _astray(posterior):
        searched = 0
    if lost:  # what is fixed may make a valley of several optima
        ends += list(drawn_starts(likelihood.priors, posterior.fit.eta, 2 * searched, _SEARCHED_FACTOR, 0))
    at = likelihood_at if rebuild else None
    kinds = like_parameters(model)
    if lost:  # what is collinear is not exchanged
        alone = ~np.isfinite(posterior.free_information.bounds())
        kinds = distinct_kinds(kinds, likelihood.names, alone.tolist())
    search = OptimaSearch(likelihood, kinds, at, ends, searched)
    optima, better = search.run(posterior.fit, posterior.information.deviations())
    if len(optima) > 1:
        optima = replace(optima, sensors=deciding_sensors(model, likelihood, optima))
    if better is None:
        return replace(posterior, optima=optima), model
    likelihood, fit = better
    stage = EstimationStage.at("an equivalent optimum", likelihood, fit)
    estimate = replace(
        estimate, fit=fit, stages=[*estimate.stages, stage], likelihood=likelihood, comparison=None
    )
    if rebuild is not None:
        model = rebuild(named(model.unknowns, fit.eta))
    return Posterior(likelihood, posterior.method, estimate, optima=optima, undetermined=lost), model


def _with_model_error(problem: Problem, posterior: Posterior, model: StructuralModel) -> Posterior:
    """Return a posterior with the error of its reduced model."""
    from dynid.identification.diagnosis.model_error import model_error

    likelihood = posterior.likelihood
    values = [record.full_data for record in likelihood.records]
    error = model_error(
        model,
        likelihood,
        posterior.fit,
        problem.dofs,
        lambda finer: problem.likelihood_of(finer, values).with_noise_of(likelihood),
    )
    return replace(posterior, model_error=error)


def _estimated(estimator: Any, likelihood: Likelihood, eta: Array, suggest: bool) -> Estimate:
    """Return an estimate from coordinates (p); an error names mistakes of instruments that explain it."""
    try:
        astray = likelihood.records[0].observed.astray
        with guarded("the estimator", Diverged, remedy=astray, names=likelihood.names):
            estimate: Estimate = estimator.run(likelihood, eta)
    except Diverged as error:
        raise _suggesting(error, instrument_mistakes(likelihood, [eta]) if suggest else ()) from error
    if not likelihood.modelled or estimate.likelihood is not None:
        return estimate
    coloured = likelihood.renewed(estimate.fit)  # an estimator that assumes white noise
    return replace(estimate, likelihood=coloured, fit=coloured.fit(estimate.fit.eta), comparison=None)


def _checked(posterior: Posterior, begun: Likelihood, suggest: bool) -> Posterior:
    """Return a checked posterior, which may be rejected, with mistakes that explain its lack of fit.

    `begun`: the likelihood of the start, in which the parameters are free that ran away and were fixed.
    """
    if suggest and posterior.comparison.has_signal and (holds := better_hold(posterior)):
        posterior = replace(posterior, mistakes=tuple(holds))
    elif suggest and (not posterior.comparison.explained or posterior.comparison.lacks_fit):
        likelihood, start = posterior.likelihood, starts(begun.unknowns)
        etas = [posterior.fit.eta, start]
        if not np.array_equal(start, starts(likelihood.unknowns)):
            likelihood, etas = begun, [start]
        mistakes = instrument_mistakes(likelihood, etas)
        posterior = replace(posterior, mistakes=tuple(mistakes))
    if not all(record.superposes for record in posterior.likelihood.records):
        # Of joints with laws alone.
        from dynid.identification.diagnosis.idle_laws import idle_laws
        from dynid.identification.diagnosis.joint_forces import created_energy

        laws = *idle_laws(posterior.likelihood, posterior.fit), *created_energy(posterior)
        posterior = replace(posterior, mistakes=(*posterior.mistakes, *laws))
    try:
        posterior.check()
    except (Diverged, NotIdentifiable) as error:
        return replace(posterior, rejection=_suggesting(error, posterior.mistakes))
    if suggest and not posterior.mistakes and posterior.comparison.has_signal:
        names = [channel.name for channel in posterior.channels]
        growing = growing_residuals(posterior.likelihood, posterior.fit, names)
        posterior = posterior if growing is None else replace(posterior, growing=growing)
    return posterior


def _suggesting(error: DynidError, mistakes: Sequence[str]) -> DynidError:
    """Return an error with mistakes of instruments that would explain it, before its general remedy."""
    remedy = " ".join([*map(sentence, mistakes), error.remedy])
    return type(error)(error.problem, remedy=remedy, names=error.names)


def _noise_of(posterior: Posterior) -> list[Array] | None:
    """Return the noise at an accepted estimate (channels of each record); None at a disputed one."""
    return None if posterior.estimate.disputed else posterior.likelihood.likeliest(posterior.fit)


def _with(estimator: Any, **options: Any) -> Any:
    """Return an estimator with these options of an automatic one; any other stays as it is."""
    if isinstance(estimator, Huber):
        return replace(estimator, inner=_with(estimator.inner, **options))
    return replace(estimator, **options) if estimator.name == "auto" else estimator


def _continued(before: Posterior, likelihood: Likelihood, now: Estimate) -> Estimate:
    """Return an estimate with the stages and histories of the one before it, which had another model."""
    # Histories are converted to the units of the new states; they are left out where the states are others.
    old = before.estimate
    stages = [*old.stages, *now.stages]
    if isinstance(likelihood, FrfLikelihood):
        return replace(now, stages=stages)
    earlier: list[Sweep] = []
    pairs = [
        (old_record.model, new_record.model)
        for old_record, new_record in zip(before.likelihood.records, likelihood.records, strict=True)
        if isinstance(old_record, TimeRecord) and isinstance(new_record, TimeRecord)
    ]
    same = [
        (len(first.times), first.system.states) == (len(second.times), second.system.states)
        for first, second in pairs
    ]
    if all(same):
        units = [first.scale / second.scale for first, second in pairs]
        earlier = [
            [
                history
                if np.all(unit == 1)
                else history._replace(
                    states=history.states * unit, state_deviations=history.state_deviations * unit
                )
                for history, unit in zip(sweep, units, strict=True)
            ]
            for sweep in old.histories
        ]
    if now.histories:  # else the last one of them is that of the result
        earlier[1:] = map(ended, earlier[1:])
    return replace(
        now,
        histories=[*earlier, *now.histories],
        stages=stages,
        counts=old.counts if "starts" in old.counts else now.counts,  # the search was the first one
        disputed=now.disputed and old.disputed,
    )
