"""The transfer function of a chain as a formula, every symbol distinct."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.bench.cases.chain import reduced


def _expanded(stages: int) -> Callable[[], Any]:
    from dynid.bondgraph.formulas.transfer import expanded

    def work() -> Any:
        ((numerator, denominator),) = expanded(reduced(stages), 10**7).values()
        return len(numerator), len(denominator)

    return work


def _nested(stages: int) -> Callable[[], Any]:
    from dynid.bondgraph.formulas.transfer import nested

    def work() -> Any:
        graph = reduced(stages)
        return nested(graph, graph.channels().values())

    return work


def _by_hand(stages: int) -> Callable[[], Any]:
    """Eliminate stage by stage in flint polynomials, written for this chain alone."""
    from flint import fmpz_mpoly_ctx

    names = [f"{letter}{k}" for k in range(stages) for letter in "mkb"]
    s, *symbols = fmpz_mpoly_ctx.get(["s", *names], "lex").gens()

    def work() -> Any:
        m, k, b = symbols[-3:]
        above, below = s * s * m + s * b + k, s  # impedance of the rest: above / below
        numerator = s
        for stage in reversed(range(stages - 1)):
            m, k, b = symbols[3 * stage : 3 * stage + 3]
            joint = s * b + k
            numerator = numerator * joint
            above, below = (s * m) * (below * joint + above * s) + above * joint, below * joint + above * s
        return len(numerator), len(above)

    return work


def _sympy(stages: int) -> Callable[[], Any]:
    import sympy

    s, *symbols = sympy.symbols(["s", *(f"{x}{k}" for k in range(stages) for x in "mkb")])

    def work() -> Any:
        m, k, b = symbols[-3:]
        seen, force = s * m + k / s + b, sympy.Integer(1)
        for stage in reversed(range(stages - 1)):
            m, k, b = symbols[3 * stage : 3 * stage + 3]
            joint = k / s + b
            force = force * joint / (joint + seen)
            seen = s * m + joint * seen / (joint + seen)
        top, bottom = sympy.fraction(sympy.cancel(force / seen))
        return len(sympy.Poly(top, s, *symbols).terms()), len(sympy.Poly(bottom, s, *symbols).terms())

    return work


def _error(stages: int, found: Any) -> float:
    """Return 0 where the denominator has the (2 4^N + 1)/3 terms that it must have, else 1."""
    return float(isinstance(found, tuple) and found[1] != (2 * 4**stages + 1) // 3)


BENCHMARK = Benchmark(
    title="Transfer function of a chain as a formula, every symbol distinct",
    size="stages",
    sizes=(2, 3, 8, 200),
    alternatives=(
        Alternative("nested", _nested),
        Alternative("expanded", _expanded, most=9),
        Alternative("by-hand", _by_hand, most=9, peer=True),
        Alternative("sympy", _sympy, most=2, peer=True),
    ),
    error=_error,
    measure="1 where terms are missing or too many, else 0",
    default=lambda _: "nested",
    full=(9, 500),
)
