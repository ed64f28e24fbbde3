"""Verdicts on the stability of cut loops, closed again, and of the graph around them."""

from __future__ import annotations

import math
from fractions import Fraction

from dynid.bondgraph.controller_circuits import PADE_ORDER
from dynid.bondgraph.cut_loops import CutLoops, polynomial_over, rational, rounded
from dynid.bondgraph.reduced_graph import parts_without_output, separate_parts
from dynid.errors import Undecided
from dynid.lti.axis_boxes import Work
from dynid.lti.certified_roots import certified_roots
from dynid.lti.delay_stability import stability as delayed_stability
from dynid.lti.stability import Verdict, combined, no_solution, verdict


def shown_verdict(cut: CutLoops) -> Verdict:
    """Return the verdict on the roots that loops show."""
    closed = cut.closed
    if closed.is_rational:
        return verdict(certified_roots(closed.terms[Fraction(0)]))
    return delayed_stability(rounded([closed])[0], cut.work)


def loops_verdict(cut: CutLoops, shown: Verdict) -> Verdict:
    """Return the verdict on loops, controllers and every separate part of the graph."""
    others = parts_without_output(cut.reduced)
    parts = [*separate_parts(cut.reduced, cut.natural), *(others or ())]
    modes = math.prod(parts, start=polynomial_over(cut.reduced.field, [1]))
    hidden = certified_roots(cut.unmoved(modes))
    verdicts = [shown, *([verdict(hidden)] if hidden else [])]
    return combined([*verdicts, *([] if others is not None else [no_solution(cut.reduced.free)])])


def approximants_agree(cut: CutLoops, shown: Verdict, work: Work) -> bool:
    """Return whether the Padé approximants of delays have as many poles to the right as the loops.

    They count as different where their roots cost too much.
    """
    (polynomial,) = rational(rounded([cut.closed]), PADE_ORDER)
    try:
        right = sum(root.multiplicity for root in certified_roots(polynomial, work=work) if root.side > 0)
    except Undecided:
        return False
    return shown.unstable_poles == right
