"""Comparison of laws of joints: each candidate is fitted to the records, and judged by likelihood and BIC.

A candidate stands in the place of the laws of the joints that have one; without any, beside stiffness and
damping of the joint that the score test names (`likelihood.nonlinearity`). Its starts follow from the linear
fit: the amplitude of the joint's deflection, and the stiffness seen there. Where this fit does not explain
the records its other estimates may be far off: what it lost the effect of is free again, and candidates start
from the scene's starts, too. A likelihood-ratio test against
the linear joint is stated where it is regular: where forces are proportional to the parameters of the law.
For slip and clearance the linear joint lies at infinity, so that BIC alone compares them. Records that the
best candidate does not explain distinguish none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, guarded
from dynid.errors import DynidError, UsageError
from dynid.identification.diagnosis.importance import LikelihoodSize, likelihood_size
from dynid.identification.diagnosis.posterior import Posterior
from dynid.identification.estimators.maximum_likelihood import refine, with_noise
from dynid.identification.likelihood.lack_of_fit import compare_models
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.likelihood.time_record import TimeLikelihood, TimeRecord
from dynid.identification.problem import Problem
from dynid.identification.statistics import chi_squared_tail
from dynid.number_format import p_text
from dynid.parameters import named
from dynid.progress import report_progress
from dynid.result import Result
from dynid.structure.joint_laws import LAWS, Power
from dynid.structure.joints import Joint, JointLaw, JointParameter
from dynid.structure.matrices import as_array
from dynid.structure.model import StructuralModel

GROUP = "identification/laws"
#: Difference of BIC below which the evidence against a law is not strong: R. E. Kass, A. E. Raftery, J. Am.
#: Stat. Assoc. 90 (1995) 773–795.
TIED_BIC = 6.0
# Starts of a candidate that are refined, the best by their misfits; most steps of each.
_REFINED_STARTS, _MAX_STEPS = 2, 30
# The first parts of the records that are fitted in turn from the best start.
_GROWING = (8, 2)
# Springs and sliders that are tried, over the stiffness seen at the joint and the force of the spring.
_STIFFNESS_RATIOS, _SLIP_RATIOS = (0.1, 0.4), (0.2, 0.6)
# Clearances that are tried, over the largest deflection.
_CLEARANCE_RATIOS = (0.4, 0.8)
# Speeds at which friction has turned over, over that of the joint.
_SPEED_RATIOS = (0.1, 0.5)
# chi and beta of distributed sliders: between those of measured lap joints and of equal ones.
_FIRST_DISTRIBUTION = (-0.5, 0.5)
# Laws that take over a part of the joint's stiffness until they slip.
_HYSTERETIC = ("jenkins", "iwan", "bouc_wen")
# First force of a smooth law, over that of the spring; it is nearly a linear parameter.
_FIRST_FORCE = 0.02


@dataclass(frozen=True, eq=False)
class LawComparison:
    """Candidates for the laws of joints, in the order of the request."""

    joints: tuple[str, ...]  # that the candidates act at
    names: tuple[str, ...]
    log_likelihood: Array  # NaN of a candidate that cannot be fitted
    bic: Array
    p: Array  # likelihood-ratio test against the linear joint, NaN where it is not regular
    estimates: tuple[str, ...]  # names and values of the parameters of the joints, SI units
    # Each law as a joint states it, its parameters started at the estimates; empty of linear ones.
    statements: tuple[str, ...]
    lack: str = ""  # how far the best candidate is from the records; empty where they do not contradict it
    explained: bool = True  # by the best candidate, all but for a small part

    @cached_property
    def tied(self) -> NDArray[np.bool_]:
        """True of candidates as good as the best one, itself included."""
        return np.asarray(self.bic <= np.nanmin(self.bic) + TIED_BIC)

    @property
    def distinguishable(self) -> NDArray[np.bool_]:
        """False of candidates that the records do not distinguish from the best one, or this from them.

        Of all where none explains the records.
        """
        return np.asarray((~self.tied | (np.count_nonzero(self.tied) == 1)) & self.explained)

    @property
    def verdict(self) -> str:
        """The verdict in one line."""
        where = f"joint{'s' if len(self.joints) > 1 else ''} {', '.join(self.joints)}"
        tied = [name for name, yes in zip(self.names, self.tied, strict=True) if yes]
        lost = [name for name, bic in zip(self.names, self.bic, strict=True) if np.isnan(bic)]
        failed = f"; not fitted: {', '.join(lost)}" if lost else ""
        if not self.explained:
            best = " and ".join(tied)
            return f"laws of {where}: none explains this record; {best}, the best: {self.lack}{failed}"
        lack = f"; all lack fit, {tied[0]} least: {self.lack}" if self.lack else ""
        if len(tied) > 1:
            return (
                f"laws of {where}: {' and '.join(tied)} are not distinguishable by this record "
                f"(BIC within {TIED_BIC:g}){lack}{failed}"
            )
        others = np.sort(self.bic[~np.isnan(self.bic)])
        apart = f" (BIC lower by {others[1] - others[0]:.4g} than the next)" if len(others) > 1 else ""
        return f"laws of {where}: this record distinguishes {tied[0]} from the others{apart}{lack}{failed}"

    @property
    def next_step(self) -> str:
        """What to do about a nonlinear joint after the comparison, as a clause."""
        best, tied = int(np.nanargmin(self.bic)), np.count_nonzero(self.tied) > 1
        where = f"joint{'s' if len(self.joints) > 1 else ''} {', '.join(self.joints)}"
        if not self.explained:
            return f"none of the compared laws explains it, in {where}: compare others, or start nearer"
        if not self.statements[best]:
            return f"none of the compared laws is better than a linear {where}: compare others"
        alike = ", which this record does not distinguish from others" if tied else ""
        return f"state the best of the compared laws{alike}, in {where}: laws: [{self.statements[best]}]"

    def add_to(self, result: Result) -> None:
        """Add ``identification/laws/``."""
        result.add_axis(f"{GROUP}/law", self.names)
        columns = {name: getattr(self, name) for name in ("log_likelihood", "bic", "p", "distinguishable")}
        result.add_all(GROUP, ("law",), name=self.names, estimates=self.estimates, **columns)
        result.annotate(GROUP, joints=", ".join(self.joints), verdict=self.verdict)


class _Seen(NamedTuple):
    """A joint in the linear fit: amplitude (as of a sine) and peak of its deflection, speed, stiffness."""

    amplitude: float
    peak: float
    speed: float
    stiffness: float

    def damper(self, kind: str, ratio: float) -> float:
        """Return the damper that dissipates as the first law does: 8 c2 v / (3 pi), 4 fs / (pi v)."""
        share = {"quadratic_damping": 8 / (3 * math.pi), "coulomb": 4 / math.pi}.get(kind, 0.0)
        return share * ratio * self.stiffness * self.amplitude / self.speed


class _Maximum(NamedTuple):
    """The greatest likelihood of a candidate, and the names of its parameters."""

    likelihood: Likelihood
    fit: Fit
    size: LikelihoodSize


def compare_laws(
    problem: Problem, model: StructuralModel, posterior: Posterior, kinds: Sequence[str]
) -> LawComparison:
    """Fit candidates for the laws of joints, and compare them.

    `model`, `posterior`: those of the estimate; `kinds`: of the laws, or ``linear``. Raises UsageError where
    there is no joint for them, or a law needs more than its kind.
    """
    comparison = _Comparison(problem, model, posterior)
    linear = comparison.linear()
    seen = comparison.seen(linear)
    maxima: list[_Maximum | None] = []
    for kind in kinds:
        report_progress(f"law {kind}")
        try:
            with guarded(f"the fit of the law {kind}"):
                maxima.append(linear if kind == "linear" else comparison.maximum(kind, linear, seen))
        except UsageError:
            raise
        except DynidError:
            maxima.append(None)
    rows = [_row(kind, maximum, linear) for kind, maximum in zip(kinds, maxima, strict=True)]
    log_likelihood, bic, p = np.array(rows).T
    joints = tuple(dict.fromkeys(model.joints[k].name for k in comparison.places))
    best = maxima[int(np.nanargmin(bic))] if np.isfinite(bic).any() else None
    estimates = tuple(_estimates(maximum, joints) for maximum in maxima)
    statements = tuple(
        "" if kind == "linear" or maximum is None else _statement(kind, maximum, linear)
        for kind, maximum in zip(kinds, maxima, strict=True)
    )
    fit = compare_models(best.likelihood, best.fit) if best is not None else None
    lack, explained = "", fit is None or fit.explained or not fit.has_signal
    if fit is not None and fit.has_signal and fit.lacks_fit:
        lack = f"{p_text(fit.lack_of_fit_p, 1)}, {100 * fit.signal_explained:.3g} % of the signal explained"
    return LawComparison(joints, tuple(kinds), log_likelihood, bic, p, estimates, statements, lack, explained)


def _statement(kind: str, maximum: _Maximum, linear: _Maximum) -> str:
    """Return a law as a joint states it, its unknown parameters at the estimates of the first such joint."""
    values = named(maximum.likelihood.unknowns, maximum.fit.eta)
    of_laws = {
        name.split(".")[1]: value
        for name, value in reversed(values.items())
        if name not in linear.likelihood.names
    }
    keys = [f"{key}: {{start: {of_laws[key]:.4g}}}" for key in LAWS[kind].names if key in of_laws]
    return f"{{{', '.join([f'kind: {kind}', *keys])}}}"


def _estimates(maximum: _Maximum | None, joints: Sequence[str]) -> str:
    """Return the parameters of joints where a candidate is most likely, as text."""
    if maximum is None:
        return ""
    values = named(maximum.likelihood.unknowns, maximum.fit.eta).items()
    return ", ".join(f"{name} {value:.5g}" for name, value in values if name.split(".")[0] in joints)


def _row(kind: str, maximum: _Maximum | None, linear: _Maximum) -> tuple[float, float, float]:
    """Return log likelihood, BIC and p-value of a candidate."""
    if maximum is None:
        return math.nan, math.nan, math.nan
    size, p = maximum.size, math.nan
    further = set(maximum.likelihood.names) - set(linear.likelihood.names)
    if set(linear.likelihood.names) <= set(maximum.likelihood.names):
        # The linear joint is a limit of the law, which cannot be less likely.
        size = replace(size, log_likelihood=max(size.log_likelihood, linear.size.log_likelihood))
        regular = kind != "linear" and issubclass(LAWS[kind], Power) and kind != "quadratic_damping"
        if regular and further and not any(".offset" in name for name in further):
            ratio = 2 * (size.log_likelihood - linear.size.log_likelihood)
            p = chi_squared_tail(len(further), ratio)
    return size.log_likelihood, size.bic, p


class _Comparison:
    """Candidates at joints of a model, about the fit of a posterior."""

    def __init__(self, problem: Problem, model: StructuralModel, posterior: Posterior) -> None:
        self.explained = posterior.rejection is None and posterior.explained
        self.problem, self.posterior = problem, posterior
        self.model = model
        self.values = [record.full_data for record in posterior.likelihood.records]
        self.places = [k for k, joint in enumerate(self.model.joints) if joint.laws]
        self.estimates = dict(zip(posterior.likelihood.names, posterior.values.tolist(), strict=True))
        if not self.explained and isinstance(
            problem.model, StructuralModel
        ):  # what has no effect in a wrong model may have one in the right one
            free = model.with_parameters(problem.model.parameters)
            self.model = free.joined(problem.model.joints)
            self.estimates = {k: v for k, v in self.estimates.items() if k not in posterior.undetermined}
        if self.places:
            return
        tested = posterior.nonlinearity
        named = {_name(joint): k for k, joint in enumerate(self.model.joints)}
        if tested is None or not (scalar := [name for name in tested.joints if name in named]):
            raise UsageError(
                "there is no joint that a law could act at: one between two DOFs, or along a component",
                remedy="Leave 'laws' out of the estimator.",
                names=("estimator.laws", "estimator"),
            )
        p = dict(zip(tested.joints, np.nan_to_num(tested.joint_p, nan=1.0), strict=True))
        self.places = [named[min(scalar, key=lambda name: p[name])]]

    def candidate(self, laws: Mapping[int, Joint]) -> Likelihood:
        """Return the likelihood with other joints at these places."""
        joints = [laws.get(k, joint) for k, joint in enumerate(self.model.joints)]
        likelihood = self.problem.likelihood_of(self.model.joined(joints), self.values)
        before = self.posterior.likelihood
        return likelihood.continuing(before).with_noise_of(before)

    def linear(self) -> _Maximum:
        """Return the fit with linear joints, which have a spring at least."""
        if not self.model.nonlinear:
            if not self.posterior.undetermined or self.explained:
                return _maximum(self.posterior.likelihood, self.posterior.fit)
            likelihood = self.candidate({})
            return _refined(likelihood, _coordinates(likelihood, self.estimates), _MAX_STEPS)
        tangents = self._tangents()
        joints, values = {}, dict(self.estimates)
        for k in self.places:
            joint, (name, spring) = replace(self.model.joints[k], laws=(), offset=None), tangents[k]
            if joint.k is None:
                joint = replace(joint, k=JointParameter(start=spring or 1.0))
            elif name in values:
                values[name] += spring
            joints[k] = joint
        likelihood = self.candidate(joints)
        return _refined(likelihood, _coordinates(likelihood, values), _MAX_STEPS)

    def _tangents(self) -> dict[int, tuple[str, float]]:
        """Return for each joint the name of its stiffness, and the stiffness of its laws at rest."""
        from dynid.structure.model_laws import tangents

        named = {_name(joint): 0.0 for joint in self.model.joints}
        values = {unknown.name: unknown.start for unknown in self.model.unknowns} | self.estimates
        for joint, blocks in tangents(self.model.joints, values):
            named[_name(joint)] += float(blocks["k"][0, 0]) if "k" in blocks else 0.0
        return {
            k: (_parameter_name(joint, "k"), max(named[_name(joint)], 0.0))
            for k, joint in enumerate(self.model.joints)
        }

    def seen(self, linear: _Maximum) -> dict[int, _Seen]:
        """Return the joints as the linear fit moves them."""
        model = linear.likelihood.records[0].system_model.model  # type: ignore[attr-defined]
        probed = model.joined(
            replace(joint, laws=(JointLaw(Power(2), (JointParameter(0.0, signed=True),)),))
            if k in self.places
            else joint
            for k, joint in enumerate(model.joints)
        )
        rows, n = probed.deflections(), model.size
        values = dict(zip(linear.likelihood.names, _values(linear), strict=True))
        K = as_array(model.with_joints(values)[2])
        motions = []
        for record, fit in zip(linear.likelihood.records, linear.fit.parts, strict=True):
            assert isinstance(record, TimeRecord)
            states = fit.predicted.states * record.model.scale
            motions.append(np.stack([states[:, :n] @ rows.T, states[:, n:] @ rows.T]))
        d, v = np.concatenate(motions, axis=1)
        out = {}
        for row, k in zip(range(len(rows)), self.places, strict=True):
            stiffness = float(rows[row] @ K @ rows[row]) / float(rows[row] @ rows[row]) ** 2
            rms = [math.sqrt(2 * float(np.mean(motion[:, row] ** 2))) for motion in (d, v)]
            out[k] = _Seen(
                rms[0] or 1.0, float(np.abs(d[:, row]).max()) or 1.0, rms[1] or 1.0, stiffness or 1.0
            )
        return out

    def maximum(self, kind: str, linear: _Maximum, seen: Mapping[int, _Seen]) -> _Maximum:
        """Return the greatest likelihood of a candidate, from the best of several starts."""
        stated = {
            k: tuple(law for law in self.model.joints[k].laws if law.law.kind == kind) for k in self.places
        }
        if all(laws == self.model.joints[k].laws for k, laws in stated.items()) and self.model.nonlinear:
            return _maximum(self.posterior.likelihood, self.posterior.fit)
        if not any(stated.values()) and kind in ("power", "expression"):
            raise UsageError(
                f"the law '{kind}' needs more than its kind",
                remedy="State it among the 'laws' of the joint.",
                names=("estimator.laws", "estimator"),
            )
        origins = [dict(zip(linear.likelihood.names, _values(linear), strict=True))]
        if not self.explained:
            origins.append({})
        ends: list[_Maximum] = []
        for values in origins:
            tried = sorted(self._ranked(kind, stated, values, seen), key=itemgetter(0))
            for number, (_, likelihood, eta) in enumerate(tried[:_REFINED_STARTS]):
                for route in ((), _GROWING) if not number else ((),):
                    with suppress(DynidError):
                        ends.append(_refined(likelihood, _guided(likelihood, eta, route), _MAX_STEPS))
        if not ends:
            raise DynidError(f"no start of the law {kind} can be followed")
        return max(ends, key=lambda end: end.size.log_likelihood)

    def _ranked(
        self,
        kind: str,
        stated: Mapping[int, tuple[JointLaw, ...]],
        estimates: Mapping[str, float],
        seen: Mapping[int, _Seen],
    ) -> Iterator[tuple[float, Likelihood, Array]]:
        """Yield starts of a candidate: their misfits, likelihoods and coordinates.

        `estimates`: of the parameters with linear joints, those of the scene's starts where they are absent.
        """
        for scale in [*_starts(kind)][: 1 if all(stated.values()) else None]:
            joints, values = {}, dict(estimates)
            for k in self.places:
                joint, laws = self.model.joints[k], stated[k] or _law(kind, seen[k], *scale)
                offset = joint.offset if any(law.law.preloaded for law in laws) else None
                joints[k] = replace(joint, laws=laws, offset=offset)
                if stated[k]:
                    continue
                spring = seen[k].stiffness * _shared_stiffness(kind, *scale)
                for letter, part in (("k", spring), ("c", seen[k].damper(kind, scale[0]))):
                    if (name := _parameter_name(joint, letter)) in values:
                        values[name] = max(values[name] - part, values[name] / 10)
            likelihood = self.candidate(joints)
            eta = _coordinates(likelihood, values)
            with suppress(DynidError), guarded("the prediction"):
                yield likelihood.misfit_at(eta), likelihood, eta


def _guided(likelihood: Likelihood, eta: Array, route: Sequence[int]) -> Array:
    """Return coordinates at the end of fits to the first parts of the records."""
    if not route:
        return eta
    from dynid.identification.estimators.multi_start import guided
    from dynid.identification.likelihood.nonlinear_record import growing  # of joints with laws alone

    assert isinstance(likelihood, TimeLikelihood)
    return guided(growing(likelihood, route), eta)[0]


def _refined(likelihood: Likelihood, eta: Array, steps: int) -> _Maximum:
    with guarded("the prediction"):
        way = refine(likelihood, eta, steps)
        if (covering := likelihood.covering(way.fit.eta, narrowed=False)) is not likelihood:
            likelihood, way = covering, refine(covering, way.fit.eta, steps)
        likelihood, way = with_noise(likelihood, way)
    return _maximum(likelihood, way.fit)


def _maximum(likelihood: Likelihood, fit: Fit) -> _Maximum:
    return _Maximum(likelihood, fit, likelihood_size(likelihood, fit))


def _values(maximum: _Maximum) -> list[float]:
    pairs = zip(maximum.likelihood.unknowns, maximum.fit.eta.tolist(), strict=True)
    return [unknown.value(coordinate) for unknown, coordinate in pairs]


def _coordinates(likelihood: Likelihood, values: Mapping[str, float]) -> Array:
    """Return coordinates of values by name, of other parameters those of their starts."""
    numbers = [unknown.coordinate(values.get(unknown.name, unknown.start)) for unknown in likelihood.unknowns]
    return np.asarray(likelihood.priors.clipped(np.array(numbers)))


def _name(joint: Joint) -> str:
    return f"{joint.name}.{joint.component}" if joint.component else joint.name


def _parameter_name(joint: Joint, letter: str) -> str:
    return f"{joint.name}.{letter}{f'.{joint.component}' if joint.component else ''}"


def _starts(kind: str) -> Iterator[tuple[float, float]]:
    """Yield pairs of ratios that the starts of a kind of law follow from."""
    if kind in _HYSTERETIC:
        yield from ((stiffness, slip) for stiffness in _STIFFNESS_RATIOS for slip in _SLIP_RATIOS)
    elif kind == "gap":
        yield from ((stiffness, ratio) for stiffness in _STIFFNESS_RATIOS for ratio in _CLEARANCE_RATIOS)
    elif kind == "coulomb":
        yield from (
            (force, speed) for force in (_FIRST_FORCE, _STIFFNESS_RATIOS[0]) for speed in _SPEED_RATIOS
        )
    else:
        yield (_FIRST_FORCE, 0.0)


def _shared_stiffness(kind: str, ratio: float, slip: float) -> float:
    """Return the part of the stiffness that a law takes over at the amplitude of the linear fit.

    Of a slider by its describing function, of which Iwan and Bouc–Wen are smooth counterparts.
    """
    if kind not in _HYSTERETIC:
        return 0.0
    angle = math.acos(1 - 2 * slip)
    return ratio * (angle - math.sin(angle) * math.cos(angle)) / math.pi


def _law(kind: str, seen: _Seen, ratio: float, part: float) -> tuple[JointLaw, ...]:
    """Return a law with its starts."""
    k, d = seen.stiffness, seen.amplitude
    starts: dict[str, Callable[[], tuple[float, ...]]] = {
        "cubic": lambda: (ratio * k / d**2,),
        "quadratic_damping": lambda: (ratio * k * d / seen.speed**2,),
        "coulomb": lambda: (ratio * k * d, part * seen.speed),
        "jenkins": lambda: (ratio * k, part * ratio * k * d),
        "iwan": lambda: (ratio * k, part * ratio * k * d, *_FIRST_DISTRIBUTION),
        "bouc_wen": lambda: (ratio * k, 1 / (part * d), 0.2 / (part * d)),
        "gap": lambda: (ratio * k, part * seen.peak),
    }
    law = LAWS[kind]()
    parameters = [
        JointParameter(start=number, signed=name in law.signed)
        for name, number in zip(law.names, starts[kind](), strict=False)
    ]
    parameters += [JointParameter(0.0)] * (len(law.names) - len(parameters))  # a contact without damper
    return (JointLaw(law, tuple(parameters)),)
