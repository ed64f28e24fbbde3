"""A DC motor with gear and flexible shaft, identified over many seeds of the noise and from many starts.

    python -m tests.identification.motor_seeds SEEDS STARTS

Voltage in, current and load speed out, 2 % noise; six of nine values are unknown, the gear ratio is known.
Of SEEDS records, from starts that are wrong by a factor of 2, it prints the RMS error of each parameter over
its Cramér–Rao bound, and how many 95 % intervals hold the true value. Of one record and STARTS random starts,
each value wrong by an independent factor of 0.1 to 10, it prints how many end at the optimum: all estimates
within 5 bounds of the truth, and converged.
"""

import sys
from typing import NamedTuple

import numpy as np

from dynid.errors import DynidError
from tests.identification.test_graph_identification import identified, motor, numbers

UNKNOWN = ("Ra", "L", "Km", "J", "flex", "JL")
OUTPUTS = ("L.f", "JL.f")
#: Half width of a 95 % interval in standard errors.
HALF_WIDTH = 1.959963984540054


class Coverage(NamedTuple):
    """RMS error over the bound by parameter, and the share of intervals that hold the truth, in all."""

    ratio: np.ndarray
    inside: float
    failed: int


def over_seeds(seeds):
    """Identify one record per seed, from starts wrong by a factor of 2."""
    factors = [2.0, 0.5, 0.5, 2.0, 2.0, 0.5]
    errors, inside, failed = [], [], 0
    for seed in seeds:
        try:
            result = identified(motor(UNKNOWN, factors), OUTPUTS, seed)
        except DynidError:
            failed += 1
            continue
        true, found, error, bound = (
            numbers(result, f"parameters/{name}")
            for name in ("true", "estimate", "standard_error", "cramer_rao")
        )
        errors.append((found - true) / bound)
        # Logarithms are estimated: the interval is that of the logarithm.
        inside.append(np.abs(np.log(found / true)) <= HALF_WIDTH * error / found)
    return Coverage(np.sqrt(np.mean(np.square(errors), axis=0)), float(np.mean(inside)), failed)


def from_starts(starts, seed=1):
    """Return how many of random starts reach the optimum of one record."""
    reached = 0
    for place in starts:
        factors = 10 ** np.random.default_rng([3, place]).uniform(-1, 1, len(UNKNOWN))
        try:
            result = identified(motor(UNKNOWN, factors), OUTPUTS, seed)
        except DynidError:
            continue
        true, found, bound = (
            numbers(result, f"parameters/{name}") for name in ("true", "estimate", "cramer_rao")
        )
        near = np.abs(found - true) < 5 * bound
        reached += bool(near.all() and numbers(result, "diagnostics/converged"))
    return reached


if __name__ == "__main__":
    seeds, starts = (int(word) for word in sys.argv[1:])
    if starts:
        reached = from_starts(range(starts))
        print(f"{starts} starts: {reached} at the optimum ({100 * reached / starts:.1f} %)", flush=True)
    if seeds:
        ratio, inside, failed = over_seeds(range(seeds))
        named = ", ".join(f"{name} {value:.3f}" for name, value in zip(UNKNOWN, ratio, strict=True))
        print(f"{seeds} seeds: RMS error / bound: {named}; all {np.sqrt(np.mean(ratio**2)):.3f}")
        print(f"{100 * inside:.2f} % of the 95 % intervals hold the truth; {failed} failed")
