"""Modal analyses of random noise, counted: modes missed and spurious, coverage of 95 % intervals, CPU time.

    python -m tests.modal.monte_carlo CASE|all [SEEDS] [--peer] [--powers=0,-2]
    python -m tests.modal.monte_carlo ambient [SEEDS] [--peer] [--seconds=900]

prints a line a case. `ambient` is of six masses under white forces that are not recorded; its peer is pyOMA-2
at the order of each mode, with covariances of as many blocks. `--powers` replaces the powers of the residual
terms. `--peer` runs sdypy-EMA (which must be importable, and takes one reference) on the same responses in
turn, with the true frequencies as its picks.
"""

import sys
import time
import warnings
from typing import Any, NamedTuple

import numpy as np

from dynid.modal import modal_model
from dynid.modal.modal_analysis import analyse
from dynid.modal.subspace import BLOCKS, analyse_outputs
from dynid.modal.write_result import doubts_of
from tests.modal.outputs import accelerations, chain, standardised_outputs
from tests.modal.structures import OMEGA, measured, modes, standardised


class Case(NamedTuple):
    """Keys of `modes`, references, relative noise, and number of lines."""

    structure: dict[str, Any]
    references: tuple[int, ...] = (0, 5)
    noise: float = 0.02
    lines: int = 600


COMPLEX = {"responses": 12, "phase": 0.3, "damping": (0.001, 0.05)}
PAIR = COMPLEX | {"close": (3,)}
CASES = {
    "two-references": Case(COMPLEX),
    "noise-1-percent": Case(COMPLEX, noise=0.01),
    "noise-5-percent": Case(COMPLEX, noise=0.05),
    "one-reference": Case(COMPLEX, (6,)),
    "damping-0.1-percent": Case(COMPLEX | {"damping": (0.001, 0.001)}),
    "damping-5-percent": Case(COMPLEX | {"damping": (0.05, 0.05)}),
    "pair": Case(PAIR),
    "pair-5-percent": Case(PAIR, noise=0.05),
    "pair-one-reference": Case(PAIR, (6,)),
    "node-one-reference": Case(PAIR, (0,)),  # of the second mode of the pair
    "ten-modes": Case({"count": 10, "responses": 30}, (0, 5), lines=1000),
    "thirty-modes": Case({"count": 30, "responses": 60, "close": (5, 20)}, (0, 5, 9), lines=1000),
    "peer": Case({"responses": 20}, (6,)),
}
# Residues of modes that the references hardly move are not Gaussian, and neither is the scale of the shape.
_MOVED = 0.03


def run(name: str, seeds: int, *, peer: bool = False) -> str:
    """Return what came of a case in a line."""
    case = CASES[name]
    poles, shapes = modes(**case.structure)
    omega = np.linspace(OMEGA[0], OMEGA[-1], case.lines)
    moved = np.max(np.abs(shapes[list(case.references)]), axis=0) > _MOVED
    driving = [(response, column) for column, response in enumerate(case.references)]
    standard: list[list[Any]] = [[], [], []]
    missed = spurious = said = 0
    cpu, of_peer, errors = list[float](), list[float](), list[Any]()
    for seed in range(seeds):
        frf = measured(poles, shapes, case.references, case.noise, seed, omega)
        begin = time.process_time()
        analysis = analyse(frf, driving)
        cpu.append(time.process_time() - begin)
        reported = analysis.modes
        surplus = len(reported.omega) - len(poles)
        missed, spurious = missed + max(-surplus, 0), spurious + max(surplus, 0)
        said += surplus < 0 and bool(doubts_of(analysis))
        if surplus == 0:
            by_omega, by_damping, by_shape = standardised(analysis, poles, shapes)
            for errors_of, values in zip(standard, (by_omega, by_damping, by_shape[:, moved]), strict=True):
                errors_of.append(np.ravel(values))
        if peer:
            begin = time.process_time()
            other = peer_poles(frf, poles)
            of_peer.append(time.process_time() - begin)
            if surplus == 0:
                estimate = reported.omega * (-reported.damping + 1j * np.sqrt(1 - reported.damping**2))
                errors.append([relative(estimate, poles), relative(other, poles)])
    covered = [100 * np.mean(np.abs(np.concatenate(errors_of)) < 1.96) for errors_of in standard if errors_of]
    # By values as many as there are: shapes have by far the most.
    pooled = np.concatenate([np.zeros(0), *(error for errors_of in standard for error in errors_of)])
    share = 100 * np.mean(np.abs(pooled) < 1.96) if len(pooled) else np.nan
    line = (
        f"{name}: {seeds} seeds, missed {missed} (with a warning {said}), spurious {spurious}, covered "
        f"{', '.join(f'{share:.1f}' for share in covered)} %, "
        f"pooled {share:.1f} %, CPU {np.median(cpu):.2f} s"
    )
    if peer:
        ours, theirs = np.median(np.array(errors), axis=(0, 3))
        line += (
            f"; sdypy-EMA {np.median(of_peer):.2f} s; median errors of frequency {ours[0]:.2g} against "
            f"{theirs[0]:.2g}, of damping {ours[1]:.2g} against {theirs[1]:.2g}"
        )
    return line


def relative(estimate: Any, poles: Any) -> Any:
    """Return relative errors of frequency and damping of the poles nearest to the true ones."""
    nearest = np.array([estimate[np.argmin(np.abs(estimate - pole))] for pole in poles])
    damping, exact = (-values.real / np.abs(values) for values in (nearest, poles))
    return [np.abs(np.abs(nearest) / np.abs(poles) - 1), np.abs(damping / exact - 1)]


def peer_poles(frf: Any, poles: Any) -> Any:
    """Return the poles of sdypy-EMA, picked nearest to the true frequencies, with its residues computed."""
    from sdypy import EMA

    lines = frf.omega / (2 * np.pi)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = EMA.Model(
            frf.values[:, :, 0].T.copy(), lines, lower=lines[0], upper=lines[-1], pol_order_high=40,
            frf_form="receptance",
        )  # fmt: skip
        model.get_poles(show_progress=False)
        model.select_closest_poles(list(np.abs(poles) / (2 * np.pi)), f_window=4)
        model.get_constants()
    return np.array([model.all_poles[row][column] for row, column in model.pole_ind])


def run_ambient(seeds: int, seconds: float, *, peer: bool = False) -> str:
    """Return what came of responses alone in a line."""
    step, (omega, ratio, shapes) = 1 / 40, chain()
    standard: list[list[Any]] = [[], [], []]
    missed = spurious = 0
    cpu, of_peer, differences = list[float](), list[float](), list[Any]()
    for seed in range(seeds):
        record = accelerations((omega, ratio, shapes), step, int(seconds / step), seed)
        scale = record.std(axis=0)
        record = (record - record.mean(axis=0)) / scale
        begin = time.process_time()
        analysis = analyse_outputs([record], step, (6.0, 120.0), lambda s: s**2 / scale)  # noqa: B023
        cpu.append(time.process_time() - begin)
        if peer:
            begin = time.process_time()
            theirs = pyoma_poles(record, step, analysis.block_rows, int(analysis.order.max()))
            of_peer.append(time.process_time() - begin)
            for k, order in enumerate(analysis.order.tolist()):
                frequency, damping, *errors = (table[:, order // 2] for table in theirs)
                at = np.nanargmin(
                    np.abs(2 * np.pi * frequency / analysis.modes.omega[k] - 1)
                    + np.abs(damping - analysis.modes.damping[k])
                )
                of_omega, of_damping, _ = analysis.modes.standard_errors
                differences.append([
                    abs(2 * np.pi * frequency[at] - analysis.modes.omega[k]) / of_omega[k],
                    abs(damping[at] - analysis.modes.damping[k]) / of_damping[k],
                    2 * np.pi * errors[0][at] / of_omega[k],
                    errors[1][at] / of_damping[k],
                ])  # fmt: skip
        surplus = len(analysis.modes.omega) - len(omega)
        missed, spurious = missed + max(-surplus, 0), spurious + max(surplus, 0)
        if surplus == 0:
            for errors_of, values in zip(
                standard, standardised_outputs(analysis.modes, omega, ratio, shapes), strict=True
            ):
                errors_of.append(values)
    covered = [100 * np.mean(np.abs(np.concatenate(errors_of)) < 1.96) for errors_of in standard]
    line = (
        f"ambient, {seconds:g} s: {seeds} seeds, missed {missed}, spurious {spurious}, covered "
        f"{', '.join(f'{share:.1f}' for share in covered)} %, CPU {np.median(cpu):.2f} s"
    )
    if peer:
        median = np.median(differences, axis=0)
        ratios = np.array(of_peer) / np.array(cpu)
        line += (
            f"; pyOMA-2 {np.median(of_peer):.2f} s, {np.median(ratios):.1f} times (median of pairs); median "
            f"differences {median[0]:.2g}, {median[1]:.2g} standard errors; "
            f"its over ours {median[2]:.2f}, {median[3]:.2f}"
        )
    return line


def pyoma_poles(record: Any, step: float, rows: int, order: int) -> Any:
    """Return frequencies (Hz), damping ratios and standard errors of both, by pyOMA-2 (poles x orders)."""
    import logging

    from pyoma2.functions import ssi

    logging.disable(logging.WARNING)
    H, T = ssi.build_hank(record.T, record.T, rows, method="cov", calc_unc=True, nb=BLOCKS)
    observability, A, C, _ = ssi.SSI_fast(H, rows, order, step=2)
    frequency, damping, _, _, by_frequency, by_damping, *_ = ssi.SSI_poles(
        observability, A, C, order, step, step=2, calc_unc=True, H=H, T=T
    )
    return frequency, damping, by_frequency, by_damping


if __name__ == "__main__":
    arguments = [argument for argument in sys.argv[1:] if not argument.startswith("--")]
    for option in sys.argv[1:]:
        if option.startswith("--powers="):
            modal_model.RESIDUAL_POWERS = tuple(map(int, option.partition("=")[2].split(",")))
    count = int(arguments[1]) if len(arguments) > 1 else 200
    if arguments[0] == "ambient":
        lasting = [float(text.partition("=")[2]) for text in sys.argv if text.startswith("--seconds=")]
        print(run_ambient(count, *(lasting or [900.0]), peer="--peer" in sys.argv), flush=True)
        sys.exit()
    for key in CASES if arguments[0] == "all" else [arguments[0]]:
        print(run(key, count, peer="--peer" in sys.argv), flush=True)
