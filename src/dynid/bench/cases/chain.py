"""A chain of mass-spring-damper stages: exact numbers, and benchmarks of coefficients and formulas.

v_N / F has a zero at 0 and one at -k/b for every joint but the last.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.templates.chain import FORCE, chain, distinct, last_velocity

# Bits of a reference: more than those of a double.
_CERTAIN = 64


def reduced(stages: int) -> ReducedGraph:
    """Return a chain of distinct stages, planned."""
    return ReducedGraph(chain(distinct(stages)), [FORCE], [last_velocity(stages)], traced=False)


def matrices(stages: int) -> Any:
    """Return A, B, C, D with the velocities and elongations as states, written down by Newton's law."""
    m, k, b = (np.array([float(stage[column]) for stage in distinct(stages)]) for column in range(3))
    joints = np.eye(stages) - np.eye(stages, k=1)  # elongation rates by velocities
    A = np.zeros((2 * stages, 2 * stages))
    A[:stages, :stages] = -(joints.T * b) @ joints / m[:, None]
    A[:stages, stages:] = -(joints.T * k) / m[:, None]
    A[stages:, :stages] = joints
    B, C = np.zeros((2 * stages, 1)), np.zeros((1, 2 * stages))
    B[0, 0], C[0, stages - 1] = 1 / m[0], 1.0
    return A, B, C, np.zeros((1, 1))


def characteristic(stages: int) -> Any:
    """Return the characteristic polynomial (flint `fmpq_poly`) by the impedances, stage by stage."""
    from flint import fmpq, fmpq_poly

    s = fmpq_poly([0, 1])
    above, below = fmpq_poly([1]), fmpq_poly([0])  # the last stage ends at the ground, at rest
    for row in reversed(distinct(stages)):
        m, k, b = (fmpq(v.numerator, v.denominator) for v in row)
        joint = s * b + k
        above, below = s * m * (joint * below + s * above) + joint * above, joint * below + s * above
    return above


def numerator(stages: int) -> Any:
    """Return the numerator: s times ``s b + k`` of every joint on the path of the force (`fmpq_poly`)."""
    from flint import fmpq, fmpq_poly

    product = fmpq_poly([0, 1])
    for row in distinct(stages)[:-1]:
        _, k, b = (fmpq(v.numerator, v.denominator) for v in row)
        product *= fmpq_poly([k, b])
    return product


@lru_cache(maxsize=2)
def true_roots(stages: int) -> tuple[Any, Any]:
    """Return zeros and poles, correctly rounded.

    The zeros are 0 and -k/b of all joints but the last; the poles are certified roots of the denominator of
    the continued fraction of impedances, started from the eigenvalues of A.
    """
    from dynid.lti.certified_roots import certified_roots, repeated

    starts = [complex(z) for z in np.linalg.eigvals(matrices(stages)[0])]
    poles, rows = certified_roots(characteristic(stages).numer(), starts), distinct(stages)
    return np.array([0.0, *(float(-k / b) for _, k, b in rows[:-1])], dtype=complex), repeated(poles)


def exact_response(stages: int, omega: Any) -> list[complex]:
    """Return the response by combining impedances from the force to the ground, in as many bits as needed."""
    from flint import acb, arb, ctx, fmpq

    def response(w: float, bits: int) -> complex:
        with ctx.workprec(bits):
            s, force, seen = acb(0, w), acb(1), acb(0)
            for m, k, b in ([acb(arb(value)) for value in stage] for stage in rows[:-1]):
                seen, joint = seen + s * m, k / s + b
                share = joint / (seen + joint)
                force, seen = force * share, seen * share
            m, k, b = (acb(arb(value)) for value in rows[-1])
            value = force / (seen + s * m + k / s + b)
            if value.rel_accuracy_bits() < _CERTAIN:
                return response(w, 2 * bits)
            return complex(float(value.real.mid()), float(value.imag.mid()))

    rows = [[fmpq(v.numerator, v.denominator) for v in stage] for stage in distinct(stages)]
    return [response(float(w), 400) for w in omega]


def _coefficients(stages: int) -> Any:
    from dynid.bondgraph.exact_engine import ExactEngine

    graph = reduced(stages)
    return ExactEngine(graph).channel(next(iter(graph.channels()))).coefficients()


def _ss2tf(stages: int) -> Any:
    from scipy.signal import ss2tf

    above, below = ss2tf(*matrices(stages))
    return above[0], below


def _control_polynomials(stages: int) -> Any:
    import control

    transfer = control.tf(control.ss(*matrices(stages)))
    return transfer.num[0][0], transfer.den[0][0]


def _coefficient_error(stages: int, result: Any) -> float:
    """Return the largest relative error of the coefficients within the range of a double, descending.

    The error of a coefficient that is 0 is relative to the largest one.
    """
    errors, denominator = [], characteristic(stages)
    lead = denominator[denominator.degree()]
    for coefficients, polynomial in zip(result, (numerator(stages), denominator), strict=True):
        ascending = np.asarray(coefficients, dtype=float)[::-1].tolist()
        if len(ascending) <= polynomial.degree() or not np.isfinite(ascending).all():
            return float("inf")
        exact = [polynomial[power] / lead for power in range(len(ascending))]
        reference = [
            (number, int(c.p) / int(c.q))
            for number, c in zip(ascending, exact, strict=True)
            if c == 0 or abs(int(c.p).bit_length() - int(c.q).bit_length()) < 1000
        ]
        largest = max(abs(true) for _, true in reference)
        errors.append(max(abs(number - true) / (abs(true) or largest) for number, true in reference))
    return float(max(errors))


POLYNOMIALS = Benchmark(
    title="Numerator and denominator of a chain, monic, from the model on",
    size="stages",
    sizes=(10, 50, 100),
    full=(200, 500),
    alternatives=(
        Alternative("exact", _coefficients),
        Alternative("ss2tf", _ss2tf, peer=True),
        Alternative("control-tf", _control_polynomials, needs=("control",), max_size=100, peer=True),
    ),
    error=_coefficient_error,
    measure="largest relative error of a coefficient of numerator or denominator",
    default=lambda _: "exact",
)


def _expanded(stages: int) -> Any:
    from dynid.bondgraph.formulas.transfer import expanded

    ((above, below),) = expanded(reduced(stages), 10**7).values()
    return len(above), len(below)


def _nested(stages: int) -> Any:
    from dynid.bondgraph.formulas.transfer import nested

    graph = reduced(stages)
    return nested(graph, graph.channels().values())


def _stages(symbols: Sequence[Any]) -> list[Sequence[Any]]:
    """Return m, k, b of every stage."""
    return [symbols[index : index + 3] for index in range(0, len(symbols), 3)]


def _flint_symbols(stages: int) -> Any:
    from flint import fmpz_mpoly_ctx

    return fmpz_mpoly_ctx.get(["s", *(f"{x}{k}" for k in range(stages) for x in "mkb")], "lex").gens()


def _by_hand(symbols: Any) -> Any:
    """Eliminate stage by stage in flint polynomials, written for this chain alone."""
    s, *rest = symbols
    *rows, (m, k, b) = _stages(rest)
    above, below = s * s * m + s * b + k, s  # impedance of the rest: above / below
    top = s
    for m, k, b in reversed(rows):
        joint = s * b + k
        top = top * joint
        above, below = (s * m) * (below * joint + above * s) + above * joint, below * joint + above * s
    return len(top), len(above)


def _sympy_symbols(stages: int) -> Any:
    import sympy

    return sympy.symbols(["s", *(f"{x}{k}" for k in range(stages) for x in "mkb")])


def _sympy(symbols: Any) -> Any:
    import sympy

    s, *rest = symbols
    *rows, (m, k, b) = _stages(rest)
    seen, force = s * m + k / s + b, sympy.Integer(1)
    for m, k, b in reversed(rows):
        joint = k / s + b
        force = force * joint / (joint + seen)
        seen = s * m + joint * seen / (joint + seen)
    top, bottom = sympy.fraction(sympy.cancel(force / seen))
    return len(sympy.Poly(top, *symbols).terms()), len(sympy.Poly(bottom, *symbols).terms())


FORMULA = Benchmark(
    title="Transfer function of a chain as a formula, every symbol distinct",
    size="stages",
    sizes=(2, 3, 8, 200),
    alternatives=(
        Alternative("nested", _nested),
        Alternative("expanded", _expanded, max_size=9),
        Alternative("by-hand", _by_hand, _flint_symbols, max_size=9, peer=True),
        Alternative("sympy", _sympy, _sympy_symbols, max_size=2, peer=True),
    ),
    # The denominator has (2 4^N + 1)/3 terms.
    error=lambda stages, result: float(isinstance(result, tuple) and result[1] != (2 * 4**stages + 1) // 3),
    measure="1 where terms are missing or too many, else 0",
    default=lambda _: "nested",
    full=(9, 500),
)
