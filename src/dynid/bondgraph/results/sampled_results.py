"""Verdict, margins, sensitivity functions and discrete poles of graphs with sampled loops."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.results.channels import SYSTEM, add_system
from dynid.bondgraph.results.margin_results import (
    LOCUS,
    add_gains,
    add_loci,
    add_loop_margins,
    frequencies_near,
    roots_of,
)
from dynid.bondgraph.sampled_loops import MultirateLoops, SampledLoops
from dynid.lti.axis_boxes import Work
from dynid.lti.quasi_polynomials import QuasiPolynomial
from dynid.number_format import roots_text
from dynid.progress import tracked
from dynid.result import Result

_SAMPLED = "bond_graph/sampled"
_NOTE = (
    "{} of the closed loops in the plane of z; frequency responses are fundamental: of a sine at ω the "
    "part at ω, beside aliases at |ω + 2πk/T|"
)
#: Cost of the roots around which frequencies are chosen.
_WORK = 1_000_000


def add_sampled(result: Result, loops: SampledLoops, omega: NDArray[np.float64] | None) -> None:
    """Add the verdict, margins and sensitivity functions of sampled loops, and their discrete poles.

    `omega`: frequencies of the sensitivity functions, rad/s; default: around the crossings.
    """
    names = [f"{loop.measured} -> {loop.source}" for loop in loops.loops]
    numbers = range(len(names))
    if loops.refusal:
        add_system(result, loops.verdict)
        if isinstance(loops, MultirateLoops):
            result.add_numbered(f"{_SAMPLED}/pole", loops.listed_poles)
            common, periods = float(loops.common_period), ", ".join(f"{float(p):g}" for p in loops.periods)
            note = f"poles of the closed loops over {common:g} s, after which all sample together again"
            result.annotate(_SAMPLED, sample=common, periods=periods, computation=_times(loops), note=note)
        return
    loop_margins = [loops.margins(number) for number in tracked(numbers, "margins of loop")]
    add_loop_margins(result, names, loop_margins)
    add_system(result, loops.verdict)
    if not math.isnan(loops.largest_sample_time):
        result.add(f"{SYSTEM}/largest_sample_time", loops.largest_sample_time, units="s")
    result.add_numbered(f"{_SAMPLED}/pole", loops.listed_poles)
    note = _NOTE.format("largest poles" if loops.delays else "poles")
    result.annotate(_SAMPLED, sample=float(loops.period), computation=_times(loops), note=note)
    functions = [] if loops.delays else [*map(_quasi, map(loops.loop, numbers))]
    if omega is None:
        half = float(loops.period) / 2  # the functions' variable is w = tanh(s T / 2) / (T / 2)
        roots = half * roots_of(functions, Work(_WORK))
        near = frequencies_near(np.arctanh(roots[np.abs(roots) != 1]) / half, loop_margins)
        omega = near[near < math.pi / float(loops.period)]
    add_gains(result, names, omega, np.stack([loops.gain(number, omega) for number in numbers], axis=1))
    if loops.delays:
        result.annotate(LOCUS, left_out="delays in the graph give infinitely many discrete poles")
        return
    add_loci(result, names, map(_quasi, map(loops.loop_in_z, numbers)), Work(_WORK), plane="z")


def _times(loops: SampledLoops) -> str:
    return ", ".join(f"{float(computation):g}" for computation in loops.computations)


def _quasi(loop: tuple[Any, Any]) -> tuple[QuasiPolynomial, QuasiPolynomial]:
    above, below = (QuasiPolynomial({Fraction(0): polynomial}) for polynomial in loop)
    return above, below


def sampling_warnings(loops: SampledLoops) -> list[str]:
    """Return a warning for each pair of natural modes that the samples nearly confuse."""
    return [
        f"samples every {float(loops.period):g} s hardly distinguish the natural modes "
        f"{roots_text(np.array(pair))}: oscillations between samples may stay unseen; "
        "change the sample time, and look at the time response"
        for pair in loops.confused_modes()
    ]
