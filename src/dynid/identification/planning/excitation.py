"""The best lines and bands to excite, as a result."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid.identification.identifiability import Prospect, relative_bounds
from dynid.identification.measurement import Experiment
from dynid.identification.planning.lines import Lines, exact_bounds
from dynid.identification.planning.selection import Candidates, select
from dynid.lti.signals import Multisine, Sine
from dynid.result import Result
from dynid.structure.model import StructuralModel

Array = NDArray[np.float64]


def add_excitation(
    result: Result,
    model: StructuralModel,
    experiment: Experiment,
    expected: Prospect,
    found: Lines,
    count: int,
) -> None:
    """Add the ranking of excitations to a result.

    ``plan/excitation/``: `dof` and `omega` of the candidates with the `worth` of each alone (omega x dof: the
    geometric mean of what the bounds would be, relative; of steady states, whole force in that line);
    the best set: `choice_dof`, `choice_omega`, `amplitude` with its `gain` (by which factor each line, at the
    amplitude of the set, narrows the bounds) and its `best_bound` (parameter), initial state unknown;
    `settling_time`, in which the slowest mode decays to a hundredth, if it does;
    `present_bound` of the excitation as it is, `efficiency`, the geometric mean of the best bounds over
    these; and `bands/`: the force spread evenly over the surroundings of each mode, band by band.
    """
    group, names = "plan/excitation", expected.ensemble.names
    result.add_axis(f"{group}/parameter", names)
    result.add_axis(f"{group}/dof", [str(dof) for dof in found.dofs])
    result.add_axis(f"{group}/omega", found.omega, "rad/s")
    alone = found.candidates(1).gains([]).reshape(len(found.omega), len(found.dofs))
    result.add(f"{group}/worth", np.exp(-alone / (2 * len(names))), ("omega", "dof"))
    chosen = _add_choice(result, found, count)
    best = exact_bounds(model, experiment, expected, found.loads(chosen))
    present = relative_bounds(expected.information())
    result.add(f"{group}/best_bound", best, ("parameter",))
    result.add(f"{group}/present_bound", present, ("parameter",))
    both = np.isfinite(best).all() and np.isfinite(present).all()
    ratio = (
        float(np.exp(np.mean(np.log(best) - np.log(present)))) if both else float(np.isfinite(present).all())
    )
    result.add(f"{group}/efficiency", ratio)
    slowest = float(np.min(-result["identification/identifiability/modal_sensitivity/pole"].data.real))
    if slowest > 0:
        result.add(f"{group}/settling_time", np.log(100) / slowest, (), "s")
    _add_bands(result, found, names)


def _add_choice(result: Result, found: Lines, count: int) -> list[int]:
    """Add the lines that are best together; return which candidates they are."""
    group, every = "plan/excitation", found.candidates(count)
    chosen = select(every, count)
    at = [found.line(candidate) for candidate in chosen]
    result.add_axis(f"{group}/choice", [f"{dof} at {omega:.5g} rad/s" for dof, omega in at])
    result.add(f"{group}/choice_dof", [str(dof) for dof, _ in at], ("choice",))
    result.add(f"{group}/choice_omega", [omega for _, omega in at], ("choice",), "rad/s")
    result.add(f"{group}/amplitude", found.rms * np.sqrt(2 / len(chosen)), (), "N")
    result.add(f"{group}/gain", every.steps(chosen), ("choice",))
    return chosen


def present_lines(experiment: Experiment) -> int:
    """Return the number of sines of the present excitation, 3 where it is none of sines."""
    signals = [load.signal for load in experiment.loads]
    counts = [
        len(signal.frequency) if isinstance(signal, Multisine) else int(isinstance(signal, Sine))
        for signal in signals
    ]
    return sum(counts) if all(counts) and counts else 3


def _add_bands(result: Result, found: Lines, names: Sequence[str]) -> None:
    group = "plan/excitation/bands"
    columns = len(names)
    rows = []
    for number, (low, high) in enumerate(found.bands, 1):
        inside = np.flatnonzero((found.omega >= low) & (found.omega <= high))
        for k, dof in enumerate(found.dofs):
            if len(inside):
                # Lines that thin out count by the width that each stands for.
                width = np.gradient(found.omega)[inside] if len(found.omega) > 1 else np.ones(1)
                share = np.sqrt(width / width.sum())[:, None, None]
                root = np.linalg.qr((found.roots[inside, k] * share).reshape(-1, columns), mode="r")
                design = Candidates(np.asarray(root)[None], 0)
                rows.append(
                    (f"{dof} in band {number}", str(dof), low, high, design.worth([0]), design.bounds([0]))
                )
    rows.sort(key=lambda row: -row[4])
    result.add_axis(f"{group}/band", [row[0] for row in rows])
    result.add_axis(f"{group}/parameter", names)
    result.add(f"{group}/dof", [row[1] for row in rows], ("band",))
    result.add(f"{group}/low", [row[2] for row in rows], ("band",), "rad/s")
    result.add(f"{group}/high", [row[3] for row in rows], ("band",), "rad/s")
    result.add(
        f"{group}/bound", np.reshape([row[5] for row in rows], (len(rows), columns)), ("band", "parameter")
    )
