"""Viscous or structural damping of joints: the kind that explains a lack of fit, and kinds that look alike.

Around one frequency a damper c and a loss factor eta of a joint dissipate alike, ``omega c = eta k``; over a
band they do not. Where responses contradict the one of a model, joints with the other are estimated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from dynid.arrays import Array
from dynid.errors import DynidError
from dynid.identification.diagnosis.corrections import STEPS, Explanation
from dynid.identification.estimators.maximum_likelihood import refine
from dynid.identification.likelihood.frf_record import FrfLikelihood, FrfRecord
from dynid.identification.likelihood.likelihood import Likelihood
from dynid.identification.systems.frf_system import FrfSystem
from dynid.number_format import frequency_text, quantity
from dynid.parameters import named, starts
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.model import StructuralModel

# Joints beyond which the kind of damping is exchanged of all of them only, and not of each alone.
_MAX_SINGLE_JOINTS = 6
# Correlation of estimates, or standard error over the estimate, from which c and eta of a joint look alike.
_ALIKE_CORRELATION, _ALIKE_ERROR = 0.95, 0.3


def other_damping(likelihood: Likelihood, eta: Array) -> Iterator[Explanation]:
    """Yield models with c and eta of joints exchanged: of all, and of one at a time.

    `likelihood`: responses that the model does not explain; `eta`: coordinates of its estimate (p).
    """
    model = _structure(likelihood)
    joints = [] if model is None else [joint for joint in model.joints if _kind(joint)]
    if model is None or not joints:
        return
    values = named(likelihood.unknowns, eta)
    omega = np.concatenate([_frequencies(record) for record in likelihood.records])
    middle = float(np.exp(np.mean(np.log(omega[omega > 0]))))
    before = likelihood.record_misfit(likelihood.fit(eta))
    for exchanged in (joints, *([joint] for joint in joints if 1 < len(joints) <= _MAX_SINGLE_JOINTS)):
        others = [
            _exchanged(joint, values, middle) if joint in exchanged else joint for joint in model.joints
        ]
        with suppress(DynidError, ArithmeticError, np.linalg.LinAlgError):  # then it explains nothing
            other = _with_model(likelihood, model.joined(others))
            begin = {**values, **named(other.unknowns, starts(other.unknowns))}
            begin |= {name: values[name] for name in other.names if name in values}
            origin = np.array([unknown.coordinate(begin[unknown.name]) for unknown in other.unknowns])
            fit = refine(other, origin, STEPS).fit
            said = partial(_sentences, exchanged, named(other.unknowns, fit.eta))
            yield Explanation(before - other.record_misfit(fit), other, fit, said, len(exchanged))


def _structure(likelihood: Likelihood) -> StructuralModel | None:
    """Return the structure whose frequency responses are all that is measured; None where they are not."""
    if not isinstance(likelihood, FrfLikelihood):
        return None
    model = likelihood.records[0].system.model
    return model if isinstance(model, StructuralModel) else None


def _with_model(likelihood: Likelihood, model: StructuralModel) -> FrfLikelihood:
    """Return the likelihood of the same responses with another structure."""
    return FrfLikelihood(
        tuple(
            replace(record, system=FrfSystem.of(model, record.system.functions))
            for record in likelihood.records
            if isinstance(record, FrfRecord)
        )
    )


def _kind(joint: Joint) -> str:
    """Return the unknown damping of a joint with a stiffness, c or eta; empty where it has not just one."""
    unknown = [
        letter
        for letter in ("c", "eta")
        if isinstance(parameter := getattr(joint, letter), JointParameter) and parameter.start is not None
    ]
    return unknown[0] if joint.k is not None and (joint.c is None) != (joint.eta is None) and unknown else ""


def _exchanged(joint: Joint, values: dict[str, float], omega: float) -> Joint:
    """Return a joint with the other kind of damping, which at this frequency, rad/s, is the same."""
    terms = {term.letter: term for term in joint.terms}
    stiffness, damping = terms["k"], terms["c" if joint.eta is None else "h"]
    k = values.get(stiffness.name, float(stiffness.parameter.value or 1.0)) * np.trace(stiffness.block)
    size = values[damping.name]
    if joint.eta is None:
        eta = size * omega * np.trace(damping.block) / k
        return replace(joint, c=None, eta=JointParameter(start=float(np.clip(eta, 1e-4, 1.0))))
    matrix = None if stiffness.parameter.matrix is None else stiffness.block
    c = size * k / omega / np.trace(stiffness.block)
    return replace(joint, eta=None, c=JointParameter(start=float(c), matrix=matrix))


def _sentences(exchanged: Sequence[Joint], values: dict[str, float]) -> Iterator[str]:
    names = list(dict.fromkeys(joint.name for joint in exchanged))
    structural = exchanged[0].eta is None
    kind, key = ("structural damping", "eta") if structural else ("dampers", "c")
    stand = {name: values[name] for name in values if name.rpartition(f".{key}")[0] in names}
    found = ", ".join(f"{name} = {quantity(value)}" for name, value in stand.items())
    dissipate = "dissipates" if len(names) == 1 else "dissipate"
    yield (
        f"the lack of fit is explained where {', '.join(names)} {dissipate} as {kind}: write {key} instead "
        f"of {'c' if structural else 'eta'} ({found})"
    )


def alike_damping(likelihood: Likelihood, correlation: Array, errors: Array) -> Iterator[str]:
    """Yield which joints' c and eta the band of the data cannot distinguish.

    `correlation` of the unknowns (p x p); `errors`: standard errors over the values (p), infinite where they
    are not identifiable.
    """
    names = likelihood.names
    for k, name in enumerate(names):
        pair = name.replace(".eta", ".c", 1)
        if pair == name or pair not in names:
            continue
        other = names.index(pair)
        worst = float(max(errors[k], errors[other]))
        alike = abs(correlation[k, other]) > _ALIKE_CORRELATION or not np.isfinite(worst)
        if alike and worst > _ALIKE_ERROR:
            omega = np.concatenate([_frequencies(record) for record in likelihood.records])
            low, high = (frequency_text(float(w), 4) for w in (omega.min(), omega.max()))
            yield (
                f"{name} and {pair} can hardly be distinguished between {low} and {high}: at one frequency "
                "both dissipate alike (ω c = η k); measure a wider band, or leave one of them out"
            )


def _frequencies(record: Any) -> Array:
    """Return the frequencies of responses or modes, rad/s."""
    return np.asarray(record.measurement.omega)
