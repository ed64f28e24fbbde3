"""Steady states of a structure with nonlinear joints: responses to a sine over its frequency."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from dynid.arrays import Array, ComplexArray, guarded
from dynid.errors import NumericalError, UsageError
from dynid.result import Result
from dynid.structure.labels import Label, unsigned
from dynid.structure.model import StructuralModel
from dynid.structure.nonlinear.backbone import BackboneCurve
from dynid.structure.nonlinear.continuation import MAX_STEP, solve_at, trace
from dynid.structure.nonlinear.floquet import FloquetAnalysis
from dynid.structure.nonlinear.fourier import basis, to_real
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
# States below which a curve that cannot be followed is an error.
_MIN_POINTS = 2
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
    max_step: float = MAX_STEP,
    stability: bool = True,
    backbone: bool = True,
) -> Result:
    """Return the steady states under a force ``amplitude cos(omega t)`` at a DOF, along their curve.

    `start`, `stop`: the frequencies, rad/s, from which to which the curve is followed, over its folds;
    `values`: unknown parameters by name; `output`: the DOF whose displacement is read; default: that of the
    force; `harmonics`: their largest number; as many are used as the forces of the laws need; `points`: their
    largest number; `max_step`: the largest change of the motion between two, relative to its size.

    Raises UsageError if the structure has structural damping or massless DOFs, NumericalError if the first
    steady state cannot be found, or a march does not confirm it. A curve that cannot be followed to its end
    has the states before, is not ``complete`` and says why.

    Returns
    -------
    Result
        ``response/harmonic_balance/{point, omega, amplitude, phase, harmonic, response}``: half of the peak
        to peak displacement, m; phase of its first harmonic to the force, rad; amplitudes of its harmonics
        (point x harmonic), those of ``Re sum response exp(i h omega t)``; with stability also ``{stable,
        multiplier, instability}``, the size of the largest Floquet multiplier and what it says; with
        `backbone` the mode that resonates at the peak, down to the lowest amplitude of the curve:
        ``response/backbone/{point, amplitude, first_harmonic, omega, damping}``.
    """
    structure = condensed(model, values or {}, (start + stop) / 2)
    if not len(structure.deflections):
        raise UsageError(
            "no joint has a nonlinear law: steady states under a sine are the frequency response",
            remedy="Ask for 'analysis: {frequency: …}', or state the 'laws' of a joint.",
        )
    load, row = (structure.shapes.T @ model.row(at) for at in (dof, dof if output is None else output))
    equations = ForcedResponse(structure, load, amplitude, harmonics)
    remembers = any(law.law.remembers for law in structure.laws)
    floquet = FloquetAnalysis(structure, load, amplitude) if stability and not remembers else None
    states = _Curve()
    notes = states.follow(equations, floquet, row, (start, stop), points, max_step)
    motions, omega = states.motions, np.array(states.omega)
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
        result.add(f"{GROUP}/stable", [not name for name in states.instability], ("point",))
        result.add(f"{GROUP}/multiplier", states.multiplier, ("point",))
        result.add(f"{GROUP}/instability", states.instability, ("point",))
    folds = int(np.count_nonzero(np.diff(np.sign(np.diff(omega)))))
    result.annotate(GROUP, force=amplitude, folds=folds, dof=str(dof), output=str(read), complete=not notes)
    if stability and remembers:
        notes += ["stability is not computed with laws that remember reversals (iwan)"]
    peak = int(np.abs(response[:, 1]).argmax())
    if states.left_out > structure.tail:
        notes += [
            f"harmonics beyond {harmonics} would deflect a joint by {100 * states.left_out:.2g} % of its "
            "deflection; allow more 'harmonics'"
        ]
    if backbone and 0 < peak < len(motions) - 1:
        _add_backbone(result, structure, row, states.top, harmonics, points)
    elif backbone:
        notes += ["the largest amplitude is at an end of the curve: no backbone; move 'start' or 'stop'"]
    if notes:
        result.annotate(GROUP, note="; ".join(notes))
    return result


@dataclass
class _Curve:
    """Steady states along a curve: frequencies, motions of the output, and what Floquet's multipliers say.

    `top`: amplitude of the largest first harmonic, with the unknowns and the motion of the modes there.
    """

    omega: list[float] = field(default_factory=list)
    motions: list[ComplexArray] = field(default_factory=list)
    multiplier: list[float] = field(default_factory=list)
    instability: list[str] = field(default_factory=list)
    left_out: float = 0.0
    top: tuple[float, Array, ComplexArray] = (0.0, np.zeros(0), np.zeros((0, 0), dtype=complex))

    def follow(
        self, equations: ForcedResponse, floquet: FloquetAnalysis | None, row: Array,
        ends: tuple[float, float], points: int, max_step: float,
    ) -> list[str]:  # fmt: skip
        """Follow the curve from one frequency to another; return why it ends before, if it does."""
        first, low, high = equations.first(ends[0]), min(ends), max(ends)
        longest = max(_LONGEST_STEP * (high - low) / high, 1e-6)
        try:
            for u in trace(equations, first, low, high, ends[1], points, longest, max_step):
                self.left_out = max(self.left_out, equations.left_out)
                modal = equations.modal_motion(u)
                if floquet is not None:
                    hidden = [0.0 if state is None else state[0] for state in equations.memory.hidden]
                    verdict = floquet.stability(float(u[-1]), modal, np.array(hidden))
                    self.multiplier.append(float(np.abs(verdict.multipliers).max(initial=0.0)))
                    self.instability.append(verdict.instability)
                self.omega.append(float(u[-1]))
                self.motions.append(modal @ row)
                if (size := float(np.abs(self.motions[-1][1]))) > self.top[0]:
                    self.top = size, u, modal
        except NumericalError as error:
            if len(self.omega) < _MIN_POINTS:
                raise
            return [f"the curve ends at {self.omega[-1]:.6g} rad/s: {error.problem}"]
        return []


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
    states: list[tuple[float, float, float, float]] = []
    note = ""
    try:
        start = solve_at(equations, equations.near(u[:-1].reshape(equations.joints, -1), u[-1], modal))
        if start is None:
            raise NumericalError("the peak of the curve is no resonance of a mode")
        for v in trace(equations, start, low, high, low, points, _LONGEST_AMPLITUDE_STEP):
            motion = equations.modal_motion(v) @ row
            omega, damping = float(v[-3]), float(v[-2] / (2 * v[-3]))
            states.append((half_peak_to_peak(motion), float(abs(motion[1])), omega, damping))
    except NumericalError as error:
        note = f"not followed farther: {error.problem}"
    columns = np.array(states[::-1]).reshape(-1, 4).T
    result.add_axis(f"{BACKBONE}/point", np.arange(1, len(states) + 1))
    for name, column in zip(("amplitude", "first_harmonic"), columns, strict=False):
        result.add(f"{BACKBONE}/{name}", column, ("point",), amplitude.units)
    result.add(f"{BACKBONE}/omega", columns[2], ("point",), "rad/s")
    result.add(f"{BACKBONE}/damping", columns[3], ("point",))
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
