"""A chain of mass-spring-damper stages as graph, as state equations, and as exact numbers."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from dynid.bondgraph.chains import FORCE, chain, distinct, last_velocity
from dynid.bondgraph.plan import ReducedGraph

# Bits of a reference: those of a double, and some.
_CERTAIN = 64


def reduced(stages: int) -> ReducedGraph:
    """Return a chain of distinct stages, planned."""
    return ReducedGraph(chain(distinct(stages)), [FORCE], [last_velocity(stages)], traced=False)


def matrices(stages: int) -> Any:
    """Return A, B, C, D with the velocities and elongations as states, written down by Newton's law."""
    import numpy as np

    m, k, b = (np.array([float(stage[place]) for stage in distinct(stages)]) for place in range(3))
    joints = np.eye(stages) - np.eye(stages, k=1)  # elongation rates by velocities
    A = np.zeros((2 * stages, 2 * stages))
    A[:stages, :stages] = -(joints.T * b) @ joints / m[:, None]
    A[:stages, stages:] = -(joints.T * k) / m[:, None]
    A[stages:, :stages] = joints
    B, C = np.zeros((2 * stages, 1)), np.zeros((1, 2 * stages))
    B[0, 0], C[0, stages - 1] = 1 / m[0], 1.0
    return A, B, C, np.zeros((1, 1))


def characteristic(stages: int) -> Any:
    """Return the characteristic polynomial (flint `fmpq_poly`) that the impedances leave, stage by stage."""
    from flint import fmpq, fmpq_poly

    s = fmpq_poly([0, 1])
    above, below = fmpq_poly([1]), fmpq_poly([0])  # what a stage ends at: the ground, at rest
    for row in reversed(distinct(stages)):
        m, k, b = (fmpq(v.numerator, v.denominator) for v in row)
        joint = s * b + k
        above, below = s * m * (joint * below + s * above) + joint * above, joint * below + s * above
    return above


def numerator(stages: int) -> Any:
    """Return what stands above it: s, and ``s b + k`` of every joint that the force passes (`fmpq_poly`)."""
    from flint import fmpq, fmpq_poly

    product = fmpq_poly([0, 1])
    for row in distinct(stages)[:-1]:
        _, k, b = (fmpq(v.numerator, v.denominator) for v in row)
        product *= fmpq_poly([k, b])
    return product


@lru_cache(maxsize=2)
def true_roots(stages: int) -> tuple[Any, Any]:
    """Return zeros and poles, correctly rounded.

    The zeros are 0 and -k/b of all joints but the last; the poles are certified roots of the polynomial that
    the continued fraction of impedances leaves, begun at the eigenvalues of A.
    """
    import numpy as np

    from dynid.lti.certified_roots import certified_roots, repeated

    starts = [complex(z) for z in np.linalg.eigvals(matrices(stages)[0])]
    poles, rows = certified_roots(characteristic(stages).numer(), starts), distinct(stages)
    return np.array([0.0, *(float(-k / b) for _, k, b in rows[:-1])], dtype=complex), repeated(poles)


def exact_response(stages: int, omega: Any) -> list[complex]:
    """Return the response by superposing impedances to the ground, in as many bits as it takes."""
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
