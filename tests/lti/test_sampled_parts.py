"""Counts of roots in the unit circle, minimal realisations, and discrete forms of controllers."""

from fractions import Fraction

import numpy as np
import pytest
from flint import arb, fmpq, fmpq_mat
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.signal import cont2discrete

from dynid.errors import UsageError
from dynid.lti.discrete_controller import discrete_controller
from dynid.lti.minimal_realisation import ExactSystem, minimal
from dynid.lti.schur_cohn import roots_inside

_ROOTS = st.lists(st.integers(-30, 30).map(lambda k: Fraction(k, 10)), min_size=1, max_size=6)


@given(_ROOTS)
def test_roots_inside_the_circle_are_counted(roots):
    assume(all(abs(root) != 1 for root in roots))
    polynomial = [Fraction(1)]
    for root in roots:
        polynomial = [
            a - root * b for a, b in zip([Fraction(0), *polynomial], [*polynomial, Fraction(0)], strict=True)
        ]
    count = roots_inside([arb(fmpq(c.numerator, c.denominator)) for c in polynomial])
    inside = sum(abs(root) < 1 for root in roots)
    # reciprocal roots end the recursion without an answer, never with another one
    assert count in (inside, None)
    if len(roots) == 1:
        assert count == inside


def test_a_root_on_the_circle_is_not_decided():
    assert roots_inside([arb(-1), arb(1)]) is None
    assert roots_inside([arb(2), arb(0), arb(1)]) == 0


def rows(values):
    return [[fmpq(value) for value in row] for row in values]


def test_what_inputs_reach_and_outputs_show_is_kept():
    # three modes: seen and moved, moved alone, seen alone
    system = ExactSystem(
        rows([[-1, 0, 0], [0, -2, 0], [0, 0, -3]]), rows([[1], [1], [0]]), rows([[1, 0, 1]]), rows([[0]])
    )
    kept = minimal(system)
    assert fmpq_mat(kept.A).charpoly().coeffs() == [1, 1]
    assert kept.C[0][0] * kept.B[0][0] == 1
    nothing = minimal(system._replace(B=rows([[0], [0], [0]])))
    assert nothing.A == []


@pytest.mark.parametrize(
    ("method", "scipy_method"), [("tustin", "bilinear"), ("backward", "backward_diff"), ("zoh", "zoh")]
)
def test_discrete_forms_are_those_of_scipy(method, scipy_method):
    top, bottom, T = [3, 2, 1], [1, 4, 5], Fraction(1, 5)
    F, g, h, d, _ = discrete_controller([*map(Fraction, top)], [*map(Fraction, bottom)], method, T)
    above, below, _ = cont2discrete((top, bottom), 0.2, scipy_method)
    z = np.exp(0.7j)
    matrix, column, row = (np.array([[float(x) for x in line] for line in part]) for part in (F, [g], [h]))
    answer = row[0] @ np.linalg.solve(z * np.eye(len(g)) - matrix, column[0]) + float(d)
    assert answer == pytest.approx(np.polyval(above.ravel(), z) / np.polyval(below, z), rel=1e-12)


def test_a_controller_without_a_discrete_form_is_refused():
    one = Fraction(1)
    with pytest.raises(UsageError, match="a pole at 10 rad/s, which 'method: tustin' maps to infinity"):
        discrete_controller([one], [one, -10 * one], "tustin", Fraction(1, 5))
    with pytest.raises(UsageError, match="more zeros than poles, which 'method: zoh'"):
        discrete_controller([one, one], [one], "zoh", Fraction(1, 5))
