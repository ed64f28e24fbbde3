"""Verdict, margins, sensitivity functions and discrete poles of graphs with sampled loops."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.results.margin_results import LOCUS, add_functions, add_loop_margins, frequencies_near
from dynid.bondgraph.results.system import SYSTEM, add_system
from dynid.bondgraph.sampled_loops import SampledLoops
from dynid.lti.axis_boxes import Work
from dynid.lti.certified_roots import repeated
from dynid.lti.quasi_polynomials import QuasiPolynomial
from dynid.number_format import roots_text
from dynid.progress import tracked
from dynid.result import Result

_SAMPLED = "bond_graph/sampled"
_NOTE = (
    "poles of the closed loops in the plane of z; frequency responses are fundamental: of a sine at ω the "
    "part at ω, beside aliases at |ω + 2πk/T|"
)
#: Cost of the roots around which frequencies are chosen.
_WORK = 1_000_000


def add_sampled(result: Result, loops: SampledLoops, omega: NDArray[np.float64] | None) -> None:
    """Add the verdict, margins and sensitivity functions of sampled loops, and their discrete poles.

    `omega`: frequencies of the sensitivity functions, rad/s; default: around the crossings.
    """
    if loops.lines:
        add_system(result, loops.verdict)
        return
    names = [f"{loop.measured} -> {loop.source}" for loop in loops.loops]
    numbers = range(len(names))
    loop_margins = [loops.margins(number) for number in tracked(numbers, "margins of loop")]
    add_loop_margins(result, names, loop_margins)
    add_system(result, loops.verdict)
    result.add(f"{SYSTEM}/largest_sample_time", loops.largest_sample_time, units="s")
    result.add_numbered(f"{_SAMPLED}/pole", repeated(loops.poles))
    timing = zip(loops.loops, loops.computations, strict=True)
    computations = ", ".join(f"{float(computation):g}" for _, computation in timing)
    result.annotate(_SAMPLED, sample=float(loops.period), computation=computations, note=_NOTE)
    functions = [
        (QuasiPolynomial({Fraction(0): above}), QuasiPolynomial({Fraction(0): below}))
        for above, below in map(loops.loop, numbers)
    ]
    half = float(loops.period) / 2
    if omega is None:
        near = frequencies_near(functions, loop_margins, Work(_WORK))
        omega = near[near < math.pi / (2 * half)]
    with np.errstate(over="ignore"):
        add_functions(result, names, functions, omega, np.tan(omega * half) / half)
    result.annotate(LOCUS, left_out="the loops are sampled")


def sampling_warnings(loops: SampledLoops) -> list[str]:
    """Return a warning for each pair of natural modes that the samples nearly confuse."""
    return [
        f"samples every {float(loops.period):g} s hardly distinguish the natural modes "
        f"{roots_text(np.array(pair))}: oscillations between samples may stay unseen; "
        "change the sample time, and look at the time response"
        for pair in loops.confused_modes()
    ]
