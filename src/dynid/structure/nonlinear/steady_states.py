"""Steady states of a structure with nonlinear joints: responses to a sine over its frequency."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dynid.arrays import Array, ComplexArray, guarded
from dynid.errors import NumericalError, UsageError
from dynid.result import Result
from dynid.structure.labels import Label, unsigned
from dynid.structure.model import StructuralModel
from dynid.structure.nonlinear.backbone import BackboneCurve
from dynid.structure.nonlinear.continuation import solve_at, trace
from dynid.structure.nonlinear.cycle import basis, to_real
from dynid.structure.nonlinear.floquet import FloquetAnalysis
from dynid.structure.nonlinear.harmonic_balance import (
    MAX_HARMONICS,
    Condensed,
    ForcedResponse,
    condensed,
)
from dynid.structure.ports import Channel

GROUP, BACKBONE = "response/harmonic_balance", "response/backbone"
#: Points of a curve beyond which it is refused.
MAX_POINTS = 1000
# Largest part of the interval between two points.
_LONGEST_STEP = 0.04
# Largest change of the amplitude between two points of a backbone, relative to it.
_LONGEST_AMPLITUDE_STEP = 0.15


@guarded("the steady state")
def harmonic_balance(
    model: StructuralModel,
    dof: Label,
    amplitude: float,
    start: float,
    stop: float,
    values: Mapping[str, float] | None = None,
    *,
    output: Label | None = None,
    harmonics: int = MAX_HARMONICS,
    points: int = MAX_POINTS,
    stability: bool = True,
    backbone: bool = True,
) -> Result:
    """Return the steady states under a force ``amplitude cos(omega t)`` at a DOF, along their curve.

    `start`, `stop`: the frequencies, rad/s, from which to which the curve is followed, over its folds;
    `values`: unknown parameters by name; `output`: the DOF whose displacement is read; default: that of the
    force; `harmonics`: their largest number; as many are used as the forces of the laws need; `points`: their
    largest number.

    Raises UsageError if the structure has structural damping or massless DOFs, NumericalError if the curve
    cannot be followed, or a march does not confirm a steady state.

    Returns
    -------
    Result
        ``response/harmonic_balance/{point, omega, amplitude, phase, harmonic, response}``: half of the peak
        to peak displacement, m; phase of its first harmonic to the force, rad; amplitudes of its harmonics
        (point x harmonic), those of ``Re sum response exp(i h omega t)``; with stability also ``{stable,
        multiplier}``, the size of the largest Floquet multiplier; with `backbone` the mode that resonates at
        the peak, down to the lowest amplitude of the curve: ``response/backbone/{point, amplitude, omega,
        damping}``.
    """
    structure = condensed(model, values or {}, (start + stop) / 2)
    if not len(structure.deflections):
        raise UsageError(
            "no joint has a nonlinear law: steady states under a sine are the frequency response",
            remedy="Ask for 'analysis: {frequency: …}', or state the 'laws' of a joint.",
        )
    load, row = (structure.shapes.T @ model.row(at) for at in (dof, dof if output is None else output))
    equations = ForcedResponse(structure, load, amplitude, harmonics)
    first = equations.first(start)
    low, high = min(start, stop), max(start, stop)
    longest = max(_LONGEST_STEP * (high - low) / high, 1e-6)
    floquet = FloquetAnalysis(structure, load, amplitude) if stability else None
    motions: list[ComplexArray] = []
    multipliers: list[float] = []
    stable: list[bool] = []
    omegas: list[float] = []
    left_out = 0.0
    top = 0.0, first.u, np.zeros((0, 0), dtype=complex)  # amplitude of the first harmonic, unknowns, modes
    for u in trace(equations, first, low, high, stop, points, longest):
        omegas.append(float(u[-1]))
        left_out = max(left_out, equations.left_out)
        modal = equations.modal_motion(u)
        motions.append(modal @ row)
        if (size := float(np.abs(motions[-1][1]))) > top[0]:
            top = size, u, modal
        if floquet is not None:
            hidden = [0.0 if state is None else state[0] for state in equations.memory.hidden]
            verdict = floquet.stability(omegas[-1], modal, np.array(hidden))
            multipliers.append(float(np.abs(verdict.multipliers).max(initial=0.0)))
            stable.append(verdict.stable)
    omega = np.array(omegas)
    response = np.zeros((len(omega), max(map(len, motions))), dtype=complex)
    for out, motion in zip(response, motions, strict=True):
        out[: len(motion)] = motion
    result = Result("identification")
    result.add_axis(f"{GROUP}/point", np.arange(1, len(omega) + 1))
    result.add(f"{GROUP}/omega", omega, ("point",), "rad/s")
    read = dof if output is None else output
    unit = Channel(read, "displacement", kind=model.kind(unsigned(read))).unit
    result.add(f"{GROUP}/amplitude", [half_peak_to_peak(motion) for motion in motions], ("point",), unit)
    result.add(f"{GROUP}/phase", np.angle(response[:, 1]), ("point",), "rad")
    result.add_axis(f"{GROUP}/harmonic", np.arange(response.shape[1]))
    result.add(f"{GROUP}/response", response, ("point", "harmonic"), unit)
    if floquet is not None:
        result.add(f"{GROUP}/stable", stable, ("point",))
        result.add(f"{GROUP}/multiplier", multipliers, ("point",))
    folds = int(np.count_nonzero(np.diff(np.sign(np.diff(omega)))))
    result.annotate(GROUP, force=amplitude, folds=folds, dof=str(dof), output=str(read))
    notes, peak = [], int(np.abs(response[:, 1]).argmax())
    if left_out > structure.tail:
        notes += [
            f"harmonics beyond {harmonics} would deflect a joint by {100 * left_out:.2g} % of its deflection"
            "; allow more 'harmonics'"
        ]
    if backbone and 0 < peak < len(motions) - 1:
        _add_backbone(result, structure, row, top, harmonics, points)
    elif backbone:
        notes += ["the largest amplitude is at an end of the curve: no backbone; move 'start' or 'stop'"]
    if notes:
        result.annotate(GROUP, note="; ".join(notes))
    return result


def _add_backbone(
    result: Result, structure: Condensed, row: Array, top: tuple[float, Array, ComplexArray], harmonics: int,
    points: int,
) -> None:  # fmt: skip
    """Add the backbone of the mode that resonates at the peak of a curve, from there to small amplitudes."""
    _, u, modal = top
    mode = int(np.abs(modal[1] * row).argmax())
    equations = BackboneCurve(structure, mode, harmonics)
    amplitude = result[f"{GROUP}/amplitude"]
    high = float(np.abs(modal[1, mode]))
    low = high * float(amplitude.data.min() / amplitude.data.max())
    states: list[tuple[float, float, float]] = []
    note = ""
    try:
        start = solve_at(equations, equations.near(u[:-1].reshape(equations.joints, -1), u[-1], modal))
        if start is None:
            raise NumericalError("the peak of the curve is no resonance of a mode")
        for v in trace(equations, start, low, high, low, points, _LONGEST_AMPLITUDE_STEP):
            motion = equations.modal_motion(v) @ row
            states.append((half_peak_to_peak(motion), float(v[-3]), float(v[-2] / (2 * v[-3]))))
    except NumericalError as error:
        note = f"not followed farther: {error.problem}"
    columns = np.array(states[::-1]).reshape(-1, 3).T
    result.add_axis(f"{BACKBONE}/point", np.arange(1, len(states) + 1))
    result.add(f"{BACKBONE}/amplitude", columns[0], ("point",), amplitude.units)
    result.add(f"{BACKBONE}/omega", columns[1], ("point",), "rad/s")
    result.add(f"{BACKBONE}/damping", columns[2], ("point",))
    result.annotate(BACKBONE, mode=mode + 1, **({"note": note} if note else {}))


def half_peak_to_peak(motion: ComplexArray) -> float:
    """Return half of the range of ``Re sum motion_h exp(i h theta)``, from samples refined by Newton."""
    q = to_real(motion)
    order = np.arange(len(motion))
    theta = 2 * np.pi * np.arange(32 * len(motion)) / (32 * len(motion))
    values = basis(theta, len(motion) - 1)[0] @ q

    def at(angle: float, derivative: int) -> float:
        return float(((1j * order) ** derivative * motion * np.exp(1j * order * angle)).sum().real)

    extremes = []
    for index in (values.argmax(), values.argmin()):
        angle = float(theta[index])
        for _ in range(4):
            bend = at(angle, 2)
            angle -= np.clip(at(angle, 1) / bend, -theta[1], theta[1]) if bend else 0.0
        extremes.append(at(angle, 0))
    return float(extremes[0] - extremes[1]) / 2
