"""Margins, sensitivity functions and root loci of feedback loops, and their delays."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields, replace
from fractions import Fraction
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import ComplexArray
from dynid.bondgraph.analysis_request import Analysis
from dynid.bondgraph.controller_circuits import PADE_ORDER, close_loops
from dynid.bondgraph.cut_loops import CutLoops, rational, rounded
from dynid.bondgraph.exact_engine import exact_channels
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.bondgraph.results.channels import add_system
from dynid.bondgraph.results.delayed_channels import listed_roots, true_channels
from dynid.errors import Undecided
from dynid.lti.axis_boxes import Work
from dynid.lti.certified_roots import certified_roots, repeated, root_balls
from dynid.lti.enclosures import EVALUATIONS
from dynid.lti.margins import CHANGES, Margins
from dynid.lti.quasi_polynomials import (
    PRECISION,
    Polished,
    QuasiPolynomial,
    continuous_phase,
    on_axis,
)
from dynid.lti.stability import Verdict
from dynid.number_format import counted, roots_text
from dynid.progress import tracked
from dynid.result import Result, Variable, as_kept

MARGINS, FUNCTIONS, LOCUS = "bond_graph/margins", "bond_graph/sensitivity_functions", "bond_graph/root_locus"
#: Roots of polynomials up to which margins of loops without delays are computed, some seconds, and about how
#: many there are by the degree of a loop: |L| = 1, Im L = 0, the extremes of |S| and |T|, and the poles.
ROOTS, _ROOTS_BY_DEGREE = 2000, 14
#: Poles of all root loci together, and the cost of the roots of loops (`enclosures.EVALUATIONS`):
#: some seconds.
_LOCI, _ROOT_WORK = 15_000, 8_000_000
_LEFT_OUT = "left out"
#: Why margins are NaN.
UNDEFINED = "the closed loop is not stable"
_UNITS = {"phase": "deg", "delay": "s"}
#: Frequencies of the functions where the scene has none, beside those of resonances; gains of a root locus.
_FREQUENCY_POINTS, _GAINS = 400, 121
#: Frequencies about a resonance, ω = Im p + Re p tan(θ), turn L by 2 Δθ each on its circle; resonances up to
#: this damping ratio, of which the wide grid has too few, the most lightly damped ones up to this number.
_ALONG_RESONANCE = np.tan(np.radians(np.arange(-80, 81, 10)))
_LIGHT_DAMPING, _RESONANCES = 0.1, 40
#: Relative distances from a gain at which branches meet, where they are fast, of further gains.
_MEETING_OFFSETS = (1e-3, 1e-2)
#: Which roots a locus of a loop with delays has.
_LOCUS_NOTE = (
    "roots with the delays as they are, of infinitely many those that approximants of order "
    f"{PADE_ORDER} lead to"
)
#: Gains after which roots of approximants start further branches.
_GAINS_A_START = 8
#: Coefficients below this part of the largest are zero: their quotients leave the range of numbers.
_SMALLEST_COEFFICIENT = 1e-290
#: Largest degree of a root locus.
_MAX_LOCUS_DEGREE = 60


def add_margins(result: Result, cut: CutLoops, omega: NDArray[np.float64] | None) -> None:
    """Add margins, sensitivity functions and root locus of every loop, and the poles of loops with delays.

    `omega`: frequencies of the sensitivity functions, rad/s; default: around the crossings.
    """
    feedback = [number for number, loop in enumerate(cut.loops) if not loop.line]
    names = [f"{cut.loops[number].measured} -> {cut.loops[number].source}" for number in feedback]
    functions = [cut.loop(number) for number in feedback]
    system = cut.verdict()
    loop_margins = _within_limit(functions, cut, system)
    functions = [(above, below) for above, below in map(rounded, functions)]
    if names:
        add_loop_margins(result, names, loop_margins)
    add_system(result, system)
    (closed,) = rounded([cut.closed])
    work = Work(_ROOT_WORK, EVALUATIONS)
    if not closed.is_rational:
        _add_roots(result, closed, cut.hidden(), system.unstable_poles, work)
    if not names:
        return
    if omega is None:
        omega = frequencies_near(roots_of(functions, work), loop_margins)
    _add_functions(result, names, functions, omega)
    add_loci(result, names, functions, work)


def add_loci(
    result: Result,
    names: list[str],
    loops: Iterable[tuple[QuasiPolynomial, QuasiPolynomial]],
    work: Work,
    *,
    plane: str = "s",
) -> None:
    """Add the root loci of loops, numerators and denominators of L, until they cost too much."""
    poles = 0
    for number, functions in enumerate(loops, 1):
        polynomials = rational(functions, PADE_ORDER)
        poles += _GAINS * max(polynomial.degree() for polynomial in polynomials)
        if poles > _LOCI:
            result.annotate(LOCUS, left_out=f"from loop {number} on: more than {_LOCI} poles")
            break
        late = None if all(function.is_rational for function in functions) else functions
        try:
            _add_locus(result, f"{LOCUS}/loop_{number}", names[number - 1], polynomials, work, late, plane)
        except Undecided as error:
            result.annotate(LOCUS, left_out=f"from loop {number} on: {error.problem}")
            break


def add_loop_margins(result: Result, names: list[str], loop_margins: list[Margins]) -> None:
    """Add the margins of every loop."""
    result.add_axis(f"{MARGINS}/loop", names)
    for name in (field.name for field in fields(Margins)):
        unit = _UNITS.get(name, "rad/s" if name.endswith(("crossover", "_at")) else "")
        values = [getattr(margin.where_stable(), name) for margin in loop_margins]
        kept = np.array(values, dtype=object if name in ("stability", "undecided") else None)
        note = (
            {"undefined": UNDEFINED}
            if name in CHANGES and not all(margin.stable for margin in loop_margins)
            else {}
        )
        result.add(f"{MARGINS}/{name}", kept, ("loop",), unit, **note)
    for name, values in (
        ("crossing_gain_below", [margin.gain_reduction for margin in loop_margins]),
        ("crossing_gain_above", [margin.gain for margin in loop_margins]),
    ):
        result.add(f"{MARGINS}/{name}", np.array(values), ("loop",))


def _within_limit(
    functions: list[tuple[QuasiPolynomial, QuasiPolynomial]], cut: CutLoops, system: Verdict
) -> list[Margins]:
    """Return the margins of the loops, in order, as long as their polynomials have at most `ROOTS` roots."""
    roots, hidden, loop_margins = 0, cut.hidden(), list[Margins]()
    counts = [
        _ROOTS_BY_DEGREE * max(above.degree, below.degree) if above.is_rational and below.is_rational else 0
        for above, below in functions
    ]
    for loop, count in zip(tracked(functions, "margins of loop"), counts, strict=True):
        roots += count
        if roots > ROOTS and loop_margins:
            first = counted(len(loop_margins), "loop")
            reason = (
                f"{_LEFT_OUT}: the margins of {len(functions)} loops take {sum(counts)} roots of "
                f"polynomials, more than {ROOTS}; those of the first {first} are computed"
            )
            return loop_margins + [_left_out(reason, system)] * (len(functions) - len(loop_margins))
        loop_margins.append(_with_hidden(cut.margins(*loop), hidden))
    return loop_margins


def _left_out(reason: str, system: Verdict) -> Margins:
    """Return no margins, and the verdict that follows from that on the whole system."""
    numbers = dict.fromkeys((field.name for field in fields(Margins) if field.type == "float"), math.nan)
    numbers["unstable_poles"] = 0.0 if system.stable else math.inf
    verdict = "stable: the whole system is" if system.stable else f"undecided: {reason}"
    return Margins(system.stable, verdict, **numbers, undecided=reason)


def _with_hidden(loop_margins: Margins, hidden: Any) -> Margins:
    """Return margins whose verdict includes the modes that cancel in the loops."""
    roots = [root for root in certified_roots(hidden) if root.side >= 0]
    if not roots:
        return loop_margins
    named = roots_text(repeated(roots), hertz=False)
    right = sum(root.multiplicity for root in roots if root.side > 0)
    if not right:
        verdict = f"{loop_margins.stability}; cancelled in the loop: a mode at {named}"
        return replace(loop_margins, stability=verdict)
    verdict = (
        f"unstable: a mode in the right half-plane is cancelled in the loop, which does not move it: {named}"
    )
    unstable = loop_margins.unstable_poles + right
    return replace(loop_margins, stable=False, stability=verdict, unstable_poles=unstable)


def _add_roots(result: Result, closed: QuasiPolynomial, hidden: Any, unstable: float, work: Work) -> None:
    """Add the rightmost roots of the characteristic function with its delays; none of infinitely many.

    `hidden`: the polynomial of the modes that cancel in the loops, which are poles as well.
    """
    if math.isinf(unstable):
        return
    roots, line, others = listed_roots(closed, unstable, work)
    note = (
        f"all poles of the closed loops with a real part above {line:.6g} rad/s, with their delays"
        if np.isfinite(line)
        else f"poles of the closed loops with their delays; {others}"
    )
    if (chain := _chain(closed)) is not None:
        near = f"; those of high frequency approach the line Re s = {chain:.6g} rad/s"
        note = note + near if closed.degree else f"all poles lie on the line Re s = {chain:.6g} rad/s"
    cancelled = [root for root in certified_roots(hidden) if not root.value.real <= line]
    if cancelled:
        note += f"; cancelled in the loops, which do not move them: {roots_text(repeated(cancelled))}"
    listed = [(root.value, root.radius) for root in roots]
    listed += [(root.value, root.radius) for root in cancelled for _ in range(root.multiplicity)]
    values, radii = zip(*sorted(listed, key=lambda root: -root[0].real), strict=True) if listed else ((), ())
    result.add_numbered(f"{MARGINS}/pole", np.array(values, complex), "rad/s", note=note)
    result.add(f"{MARGINS}/poles_error_bound", np.array(radii, float), ("pole",), "rad/s")


def _chain(closed: QuasiPolynomial) -> float | None:
    """Return the real part of a neutral chain: of a + b exp(-s τ), the terms of highest degree, ln|b/a|/τ."""
    terms = closed.leading(closed.degree).items()
    leading = {sum(delay.seconds for delay in key): value for key, value in terms if value}
    if len(leading) != 2 or 0 not in leading:
        return None
    return math.log(abs(leading[max(leading)] / leading[0])) / float(max(leading))


def _values(balls: Iterable[Any]) -> list[complex]:
    return [complex(ball) for ball in balls]


def roots_of(functions: Iterable[tuple[QuasiPolynomial, QuasiPolynomial]], work: Work) -> ComplexArray:
    """Return the roots of the polynomials of loops, as far as they cost no more than the work."""
    roots: list[complex] = []
    with contextlib.suppress(Undecided):
        for function in chain.from_iterable(functions):
            for polynomial in function.terms.values():
                roots += _values(root_balls(polynomial, work=work))
    return np.array(roots, complex)


def frequencies_near(roots: ComplexArray, loop_margins: Iterable[Margins]) -> NDArray[np.float64]:
    """Return frequencies around the roots of loops and with their crossings, peaks and resonances."""
    notable = [
        value
        for margin in loop_margins
        for value in (margin.gain_crossover, margin.phase_crossover, margin.modulus_at, margin.Mt_at)
        if 0 < value < np.inf
    ]
    near = [*notable, *np.abs(roots[roots != 0])]
    low, high = (min(near), max(near)) if near else (1.0, 1.0)
    grid = np.geomspace(max(low, 1e-6 * high) / 30, high * 30, _FREQUENCY_POINTS)
    decay = np.abs(roots.real)
    light = np.unique(roots[(decay > 0) & (decay < _LIGHT_DAMPING * roots.imag)])
    light = light[np.argsort(np.abs(light.real) / light.imag, kind="stable")][:_RESONANCES]
    resonances = light.imag[:, None] + np.abs(light.real)[:, None] * _ALONG_RESONANCE
    return np.unique(np.concatenate([grid, notable, resonances.ravel()]))


def _add_functions(
    result: Result,
    names: list[str],
    functions: list[tuple[QuasiPolynomial, QuasiPolynomial]],
    omega: NDArray[np.float64],
) -> None:
    """Add L, S = 1/(1 + L) and T = L/(1 + L) of every loop at frequencies."""
    responses: dict[str, Any] = {"L": [], "S": [], "T": []}
    for above, below in functions:
        total = above + below
        for name, top, bottom in (("L", above, below), ("S", below, total), ("T", above, total)):
            responses[name].append(on_axis(top, bottom, omega.tolist()))
    add_gains(result, names, omega, *(np.array(columns, complex).T for columns in responses.values()))
    if all(function.is_rational for function in chain.from_iterable(functions)):
        return

    def open_loops(frequencies: NDArray[np.float64]) -> NDArray[np.complex128]:
        loops = [on_axis(above, below, frequencies.tolist()) for above, below in functions]
        return np.array(loops, complex).T

    delays = max(max(function.terms, default=Fraction(0)) for pair in functions for function in pair)
    add_phase(result, FUNCTIONS, "L", open_loops, float(delays))


def add_gains(
    result: Result,
    names: list[str],
    omega: NDArray[np.float64],
    L: ComplexArray,
    S: ComplexArray | None = None,
    T: ComplexArray | None = None,
) -> None:
    """Add L of every loop (omega x loop), with S = 1/(1 + L) and T = L/(1 + L)."""
    S = 1 / (1 + L) if S is None else S
    result.add_axis(f"{FUNCTIONS}/omega", omega, "rad/s")
    result.add_axis(f"{FUNCTIONS}/loop", names)
    for name, values in (("L", L), ("S", S), ("T", 1 - S if T is None else T)):
        result.add(f"{FUNCTIONS}/{name}", values, ("omega", "loop"))


def add_phase(
    result: Result,
    group: str,
    name: str,
    evaluate: Callable[[NDArray[np.float64]], NDArray[np.complex128]],
    delays: float,
) -> None:
    """Add the phases of responses with delays, which turn between the frequencies; none beyond a limit."""
    phase = continuous_phase(evaluate, result[f"{group}/omega"].data, delays)
    if phase is None:
        result.annotate(group, phase_left_out="delays turn it too often between the frequencies")
    else:
        result.add(f"{group}/phase", np.rad2deg(phase), result[f"{group}/{name}"].dims, "deg")


def _add_locus(
    result: Result,
    group: str,
    name: str,
    polynomials: Sequence[Any],
    work: Work,
    late: Sequence[QuasiPolynomial] | None,
    plane: str,
) -> None:
    """Add the poles over a factor on the gain of a loop.

    `late`: L with its delays, of which `polynomials` are approximants: their roots start the search for those
    of L, which alone are kept.
    """
    top, bottom = polynomials
    degree = max(top.degree(), bottom.degree())
    if not 0 < degree <= _MAX_LOCUS_DEGREE or top == 0:
        return
    gains, zeros = _gains(top, bottom, work), _values(root_balls(top, work=work))
    if late is None:
        poles = np.full((len(gains), degree), np.inf, dtype=complex)
        values: list[complex] = []
        for row, gain in enumerate(gains.tolist()):
            share, of = gain.as_integer_ratio()
            values = _values(root_balls(bottom * of + top * share, values, work))
            poles[row] = _following(poles[row - 1] if row else None, values, degree)
    else:
        poles = _late_branches(Polished(late), polynomials, gains, degree)
        reached = Polished(late[:1]).reached(np.array(zeros), [1.0])
        zeros = reached[np.isfinite(reached)].tolist()
    about = {"plane": plane} if plane != "s" else {}
    about |= {} if late is None else {"note": _LOCUS_NOTE}
    unit = {"s": "rad/s", "z": ""}[plane]
    result.annotate(group, loop=name, **about)
    result.add_axis(f"{group}/gain", gains)
    result.add_axis(f"{group}/branch", np.arange(1, degree + 1))
    result.add(f"{group}/poles", poles, ("gain", "branch"), unit)
    result.add_numbered(f"{group}/zero", np.array(zeros, dtype=complex), unit)


def _late_branches(
    functions: Polished, polynomials: Sequence[Any], gains: NDArray[np.float64], degree: int
) -> NDArray[np.complex128]:
    """Return the roots of k N + D with delays (gain x branch): each from that at the gain before.

    Roots of approximants start further branches at some gains, and those that end where two branches meet.
    """
    top, bottom = (np.array([int(c) for c in reversed(p.coeffs())], dtype=object) for p in polynomials)
    scale = max(map(abs, [*top, *bottom]))
    top, bottom = np.asarray(top / scale, float), np.asarray(bottom / scale, float)
    branches, poles, most = np.full(degree, np.inf, complex), [], 0
    for row, gain in enumerate(gains.tolist()):
        roots = functions.reached(branches, [gain, 1.0])
        if row % _GAINS_A_START == 0 or np.isfinite(roots).sum() < most:
            closed = np.polyadd(gain * top, bottom)
            closed[np.abs(closed) < _SMALLEST_COEFFICIENT * np.abs(closed).max()] = 0.0
            roots = functions.reached(np.concatenate([branches, np.roots(closed)]), [gain, 1.0])
        branches, further = roots[:degree], roots[degree:][np.isfinite(roots[degree:])]
        free = np.flatnonzero(np.isinf(branches))[: len(further)]
        branches[free] = further[: len(free)]
        poles.append(branches.copy())
        most = max(most, int(np.isfinite(branches).sum()))
    return np.array(poles)


def _gains(top: Any, bottom: Any, work: Work) -> NDArray[np.float64]:
    """Return the gains of a root locus: a grid, with those at which branches meet, and near them.

    D + k N has a double root s where N'(s) D(s) = N(s) D'(s), with k = -D(s)/N(s).
    """
    from flint import acb_poly, ctx

    largest = 1e3
    gains = [0.0, *np.geomspace(1 / largest, largest, _GAINS)]
    meeting = top.derivative() * bottom - top * bottom.derivative()
    with ctx.workprec(PRECISION):
        for root in root_balls(meeting, work=work) if meeting != 0 else ():
            gain = -acb_poly(bottom)(root) / acb_poly(top)(root)
            if gain.imag.contains(0) and gain.real > 0 and gain.real < largest:
                middle = float(gain.real.mid())
                gains += [
                    middle,
                    *(middle * (1 + sign * step) for sign in (-1, 1) for step in _MEETING_OFFSETS),
                ]
    return np.unique(gains)


def _following(
    before: NDArray[np.complex128] | None, values: list[complex], degree: int
) -> NDArray[np.complex128]:
    """Return roots in the order of those before, matched by least squares; infinite ones come last."""
    from scipy.optimize import linear_sum_assignment

    roots = np.full(degree, np.inf, dtype=complex)
    roots[: len(values)] = sorted(values, key=lambda root: (root.real, root.imag))
    if before is None:
        return roots
    with np.errstate(invalid="ignore", over="ignore"):
        distance = np.abs(before[:, None] - roots) ** 2
    far = 2 * np.max(distance[np.isfinite(distance)], initial=1.0)
    distance = np.where(np.isfinite(distance), distance, np.where(np.isfinite(before)[:, None], far, 0.0))
    return np.asarray(roots[linear_sum_assignment(distance)[1]])


def approximation() -> str:
    """Return what is said of results in which delays are approximated."""
    return f"delays are Padé approximants of order {PADE_ORDER}"


#: Groups in which delays are as they are; all others are of the graph with Padé approximants.
_TRUE = tuple(
    f"bond_graph/{name}/"
    for name in (
        *("frequency_response", "frequency_peaks", "margins", "sensitivity_functions", "root_locus"),
        *("time_response", "state_space", "system", "operating_point", "need", "port/performance"),
        *("causality", "reduction"),
    )
)
#: Arrays and verdicts of channels that approximants do not change, or that are replaced by the true ones.
_EXACT = (
    *("/stable", "/stability", "/prototype", "/dc_gain", "/output", "/input", "/warnings", "/approximations"),
    *("/step_status", "/initial_value", "/rise_time", "/settling_time", "/transient_time"),
    *("/overshoot", "/undershoot", "/peak", "/peak_time"),
    *("/bandwidth_status", "/bandwidth", "/peak_gain", "/peak_frequency", "/half_power_low"),
    "/half_power_high",
    *("/final_value", "/parameter", "/value", "/dc_gain_sensitivity", "/dc_gain_sensitivity_relative"),
)


def with_delays(result: Result, analysis: Analysis) -> Result:
    """Return a result in which what is approximate is marked, and limits and verdicts are true."""
    text = approximation()
    assert analysis.opened is not None
    opened = analysis.opened.rounded() if analysis.reading == "binary" else analysis.opened
    true = true_channels(result, analysis, opened) | _high_frequencies(result, analysis)
    marked_result = Result(result.kind, result.title, result.attrs)
    approximated = False
    for path, replacement in true.items():
        if replacement is not None:
            marked_result.put(path, replacement)
    for path, variable in result.items():
        if path in true:
            continue
        if _approximate(path) and not path.endswith(_EXACT):
            approximated, attributes = True, {**variable.attrs, "approximate": text}
            marked_result.put(path, replace(variable, attrs=attributes))
        else:
            marked_result.put(path, variable)
    for group, attributes in result.group_attrs.items():
        marked = {"approximate": text} if _approximate(f"{group}/") else {}
        marked_result.annotate(group, **attributes, **marked)
    note = f"{text} in what is a rational function; {_NOTE}" if approximated else _NOTE
    marked_result.annotate("bond_graph", delays=note)
    return marked_result


_NOTE = "responses, margins and verdicts on stability have the delays as they are"


def _approximate(path: str) -> bool:
    exact = path.startswith(_TRUE) and not path.startswith("bond_graph/reduction/dynamics")
    return path.startswith("bond_graph/") and path != "bond_graph/" and not exact


def _high_frequencies(result: Result, analysis: Analysis) -> dict[str, Variable | None]:
    """Return relative degrees and high-frequency gains, to which nothing with a delay contributes."""
    if not any(path.startswith("bond_graph/properties/") for path in result):
        return {}
    assert analysis.opened is not None
    base = [
        replace(loop, numerator=[Fraction(0)], delay=Fraction(0)) if loop.delayed else loop
        for loop in analysis.loops
    ]
    closed = close_loops(analysis.opened, base)
    reduced = ReducedGraph(closed.graph, analysis.inputs, analysis.outputs, traced=False)
    true_values: dict[str, Variable | None] = {}
    for (port, source), transfer in exact_channels(reduced).items():
        for name in ("relative_degree", "high_frequency_gain"):
            path = f"bond_graph/properties/{port}/{source}/{name}"
            if path in result:
                true_values[path] = replace(result[path], data=as_kept(getattr(transfer, name)))
    return true_values
