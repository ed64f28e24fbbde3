"""Content of identifiability: Cramér–Rao bounds, collinear parameters, modes, calibration errors."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.defaults import CALIBRATION
from dynid.number_format import headed, percent, quantity, time_text
from dynid.report.content.blocks import ALL, Block, ReportSection, Statement, TextTable, on_page, on_screen
from dynid.report.scenes import frequency_unit
from dynid.result import Result

GROUP = "identification/identifiability"
_CONSIDERED = "identification/considered"
#: Least relative change that is shown as a number; least effect, in standard errors, that has a sentence.
_MIN_CHANGE, _MIN_STANDARD_ERRORS = 1e-6, 0.1
#: Most rows and parameters of the table of known masses, stiffnesses and the clock.
_KNOWN, _COLUMNS = 6, 5
#: Deviations of a Gaussian that `defaults.LACK_OF_FIT`, 1e-3, stands for.
_LACKS_FIT = 3.09
#: Standard errors from which an effect is not counted in them: they are those of round-off.
_UNTOLD = 1e6
#: What stands for no change.
_NO_SHIFT = "-"


def bound_text(value: float) -> str:
    """Return a relative bound as text."""
    if not math.isfinite(value):
        return "not identifiable"
    return percent(100 * value)


def identifiability_sections(result: Result) -> Iterator[ReportSection]:
    """Yield bounds with collinear parameters, and the sensitivities of the modes to the parameters."""
    if f"{GROUP}/relative_bound" not in result:
        return
    idle = str(result.group_attrs[GROUP].get("laws", ""))
    laws = [Statement(text, "bad") for text in idle.split("\n") if text]
    blocks = (_bound_table(result), *_collinear_groups(result), *_interchangeable(result), *laws)
    yield ReportSection("Identifiability", blocks, screen="identifiability")
    yield ReportSection("Parameters and modes", (_modal_shifts(result),), screen="")


def _bound_table(result: Result) -> TextTable:
    """Return the Cramér–Rao bound of every parameter; of a time record also with known initial state."""
    attrs = result.group_attrs[GROUP]
    of_time = "identification/measurement/omega" not in result
    where = "true values" if attrs["at"] == "true" else "start values"
    record = "the record" if of_time else "the frequency responses"
    source = "" if result.kind == "plan" else f" from {record}"
    state = ", initial state unknown" if of_time else ""
    noise = "" if attrs["noise"] == "known" else "; noise assumed, 1 % of each channel"
    names = ("parameter", "unit", "value", "relative_bound", "relative_bound_known_state")
    rows = tuple(
        (headed(name, unit), quantity(value), bound_text(bound), *([bound_text(lower)] if of_time else []))
        for name, unit, value, bound, lower in zip(
            *(result[f"{GROUP}/{column}"].data for column in names), strict=True
        )
    )
    heads = ("", "value", "CR bound", *(["CR bound, initial state known"] if of_time else []))
    return TextTable(
        heads, rows, caption=f"Cramér–Rao bounds{source} at the {where}{state}{noise}", brief=ALL, most=ALL
    )


def _collinear_groups(result: Result) -> Iterator[Statement]:
    """Yield a sentence for each group of collinear parameters, and for those without any effect."""
    group = f"{GROUP}/groups"
    bounds = dict(zip(result[f"{GROUP}/parameter"].data, result[f"{GROUP}/relative_bound"].data, strict=True))
    for names, seen in zip(result[f"{group}/parameters"].data, result[f"{group}/seen"].data, strict=True):
        bounded = all(math.isfinite(bounds[name]) for name in names.split(", "))
        how = "can hardly be distinguished" if bounded else "cannot be distinguished"
        only = f": the record shows {'mostly' if bounded else 'only'} {seen}" if seen else ""
        yield Statement(f"{how}{only}", "bad", names)
    grouped = {name for names in result[f"{group}/parameters"].data for name in names.split(", ")}
    unseen = [name for name, bound in bounds.items() if not math.isfinite(bound) and name not in grouped]
    if unseen:
        text = "not identifiable: no effect on the record; excite or measure at the joint"
        yield Statement(text, "bad", ", ".join(unseen))


def _interchangeable(result: Result) -> Iterator[Statement]:
    """Yield which parameters are interchangeable, and what would decide between the optima."""
    group = f"{GROUP}/interchangeable"
    if f"{group}/set" not in result:
        return
    sets = "; ".join(str(text) for text in result[f"{group}/set"].data)
    optima, left = int(result.value(f"{group}/optima")), int(result.value(f"{group}/undecided"))
    if left == 1:
        text = f"of {optima} optima with equal likelihood priors and limits leave one"
        yield Statement(text, "bad", f"{sets};")
        return
    decide = result.group_attrs[group]["deciding"]
    text = f"{left} optima will explain the record equally well; to decide: {decide}"
    yield Statement(text, "bad", f"{sets}:")


def _letter(name: str) -> str:
    """Return k or c of a joint's parameter; empty for others, which may change frequency and damping."""
    name = re.sub(r"\.r?[xyz]$", "", str(name))  # the direction of a joint between points
    letter = name.rpartition(".")[2]
    return letter if letter in ("k", "c") and str(name) != letter else ""


def _modal_shifts(result: Result) -> TextTable:
    """Return the table of the changes of each mode by one per cent of each parameter.

    Where all parameters are of joints, of k that of the frequency is shown, of c that of the damping; else
    both, one row below the other. Parameters that change no mode, such as gains, have no column then.
    """
    group = f"{GROUP}/modal_sensitivity"
    omega, zeta = (result[f"{group}/{name}"].data for name in ("omega", "zeta"))
    names, unit = result[f"{group}/parameter"].data, frequency_unit(result)
    values = result[f"{GROUP}/value"].data
    by_omega = result[f"{group}/omega_by_parameter"].data * values / omega[:, None]
    by_zeta = result[f"{group}/zeta_by_parameter"].data * values
    joints = all(_letter(name) for name in names)
    moves = (np.abs(by_omega) >= _MIN_CHANGE) | (np.abs(by_zeta) >= _MIN_CHANGE)
    kept = [j for j, name in enumerate(names) if joints or moves[:, j].any()]
    rows: list[tuple[str, ...]] = []
    for k in range(len(omega)):
        frequency = [shift_text(by_omega[k, j]) for j in kept]
        damping = [shift_text(by_zeta[k, j], "ζ ") for j in kept]
        if joints:
            frequency = [
                moved if _letter(names[j]) == "k" else damped
                for j, moved, damped in zip(kept, frequency, damping, strict=True)
            ]
        rows.append((f"{k + 1}", f"{unit.factor * omega[k]:.5g}", f"{100 * zeta[k] + 0.0:.3g} %", *frequency))
        if not joints and any(text != _NO_SHIFT for text in damping):
            rows.append(("", "", "", *damping))
    heads = ("mode", unit.name, "ζ", *(str(names[j]) for j in kept))
    caption = (
        "modal sensitivities: relative change of ω_n per +1 % of k; "
        "change of ζ, in percentage points, per +1 % of c"
        if joints
        else "modal sensitivities per +1 % of each parameter: relative change of ω_n; "
        "change of ζ, in percentage points"
    )
    return TextTable(heads, tuple(rows), caption=caption, noun="mode", brief=8, most=20)


def shift_text(percent: float, symbol: str = "") -> str:
    """Return a change in per cent as text, with its symbol; a dash for none."""
    if not np.isfinite(percent):
        return "∞"
    return _NO_SHIFT if abs(percent) < _MIN_CHANGE else f"{symbol}{percent:+.2g} %"


class _CalibrationEffects(NamedTuple):
    """Changes of the estimates (p) by calibration errors (q), which `changes` say in words.

    `moves` are relative (p x q), NaN for parameters that are not identifiable; `deviations` are their
    magnitudes in standard errors, NaN where there is none. Kinds of quantities (q): the gain of a ``load`` or
    a ``sensor``, the ``delay``, a considered ``parameter``, or what else is ``known``: masses, stiffnesses,
    the clock. `seen_from` (q) are the relative changes from which a test of the residuals shows them, as
    often as not.
    """

    parameters: list[str]
    changes: list[str]
    moves: Array
    deviations: Array
    kinds: NDArray[np.str_]
    seen_from: Array


def _calibration_effects(result: Result) -> _CalibrationEffects | None:
    if f"{_CONSIDERED}/slope" not in result:
        return None
    names = ("parameter", "quantity", "change", "slope")
    parameters, quantities, sizes, slopes = (result[f"{_CONSIDERED}/{name}"].data for name in names)
    group = "identification/parameters"
    if f"{group}/estimate" in result:
        relative = result[f"{group}/standard_error"].data / result[f"{group}/estimate"].data
    else:  # the bounds, before an estimation
        relative = result[f"{GROUP}/relative_bound"].data
    moves, deviations = slopes * sizes, np.asarray(relative)[:, None]
    kinds, changes = [], []
    for name, size in zip(map(str, quantities), sizes, strict=True):
        kind = _kind(name)
        kinds.append(kind)
        if kind == "known":
            clock = name == "clock"
            changes.append(f"a clock error of {size:.0e}" if clock else f"{100 * size:.2g} % of the {name}")
            continue
        if kind == "parameter":
            changes.append(f"an error of {100 * size:.2g} % in {name} (one standard deviation)")
            continue
        if kind != "delay":
            what, _, dof = name.partition(" gain of ")
            where = f"the {what} at {'the base' if dof == 'base' else f'DOF {dof}'}"
            signal = name.removeprefix("gain of ") if kind == "sensor" else where
            changes.append(f"a gain error of {100 * size:.2g} % in {signal}")
            continue
        time = time_text(float(size))
        of_time = "identification/measurement/omega" not in result
        changes.append(f"a trigger delay of {f'one sample ({time})' if of_time else time}")
    in_errors = np.abs(moves) / np.where(deviations > 0, deviations, np.nan)
    labels = [str(name) for name in parameters]
    return _CalibrationEffects(labels, changes, moves, in_errors, np.array(kinds), _seen_from(result, sizes))


def _seen_from(result: Result, sizes: Array) -> Array:
    """Return the changes from which residuals show them, of quantities whose changes are these (q).

    There a test of as many squares as the redundancy has even odds: chi-squared, by E. B. Wilson and M. M.
    Hilferty, Proc. Natl. Acad. Sci. 17 (1931) 684–688.
    """
    visibility, path = result.get(f"{_CONSIDERED}/visibility"), "identification/diagnostics/redundancy"
    if visibility is None:
        return np.full(len(sizes), math.nan)
    n = max(1, int(result.value(path))) if path in result else 1
    limit = n * (1 - 2 / (9 * n) + _LACKS_FIT * math.sqrt(2 / (9 * n))) ** 3
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(sizes * math.sqrt(limit - n) / visibility.data)


def _kind(name: str) -> str:
    """Return the kind of a quantity by its name; names of parameters have no blanks."""
    if name == "trigger delay":
        return "delay"
    if name == "clock" or name.startswith(("mass ", "stiffness ", "inertia ", "compliance ")):
        return "known"
    return "sensor" if name.startswith("gain of") else "load" if " gain of " in name else "parameter"


def known_parts_table(result: Result) -> tuple[tuple[str, ...], list[tuple[str, ...]], list[str]]:
    """Return heads and rows of the bias of each estimate by what is known, and remarks; empty without such.

    The standard errors stand above, the errors with all stated deviations below. Rows are those of the
    largest effects in standard errors.
    """
    effects, converged = _calibration_effects(result), "identification/diagnostics/converged"
    if effects is None or len(effects.parameters) > _COLUMNS:
        return (), [], []
    if converged in result and not result.value(converged):
        return (), [], []
    group = "identification/parameters"
    estimated = f"{group}/estimate" in result
    size = np.abs(result[f"{group}/estimate"].data) if estimated else np.ones(len(effects.parameters))
    path = f"{group}/standard_error" if estimated else f"{GROUP}/relative_bound"
    bars = result[path].data / np.where(size > 0, size, 1.0)
    effect = np.nan_to_num(np.abs(effects.moves) / np.where(bars > 0, bars, np.inf)[:, None]).max(axis=0)
    indices = np.flatnonzero(
        (effects.kinds == "known") & (effect > _MIN_STANDARD_ERRORS) & (effect < _UNTOLD)
    )
    total = f"{group}/standard_error_total"
    if not (indices.size or total in result):
        return (), [], []
    rows = [("standard error", *(percent(100 * bar) for bar in bars), "")]
    shown = indices[np.argsort(-effect[indices], kind="stable")][:_KNOWN]
    rows += [
        (
            effects.changes[j],
            *("-" if abs(move) < _MIN_CHANGE else _percent(move) for move in effects.moves[:, j]),
            percent(100 * effects.seen_from[j]) if effects.seen_from[j] < 1 else "-",
        )
        for j in shown.tolist()
    ]
    if total in result:
        errors = result[total].data / np.where(size > 0, size, 1.0)
        rows.append(("with the stated deviations", *(percent(100 * error) for error in errors), ""))
    left = len(indices) - len(shown)
    remarks = [f"{left} more: identification/considered, or the report"] if left else []
    return ("bias of the estimates by", *effects.parameters, "residuals show it from"), rows, remarks


def _biases(result: Result) -> tuple[list[tuple[float, str]], bool]:
    """Return the largest biases in sentences, each with its standard errors, and if error bars exclude them.

    They are those by a load's gain, a sensor's, the delay, and a considered parameter; small ones beside the
    standard error, and those of rejected estimates, are left out.
    """
    effects, converged = _calibration_effects(result), "identification/diagnostics/converged"
    if effects is None or (converged in result and not result.value(converged)):
        return [], False
    biases, excluded = list[tuple[float, str]](), False
    for kind in ("load", "sensor", "delay", "parameter"):
        size = np.where(effects.kinds == kind, np.nan_to_num(np.abs(effects.moves)), 0.0)
        size[size < _MIN_CHANGE] = 0.0
        weight = np.where(size > 0, np.nan_to_num(effects.deviations), 0.0)
        ranked = np.where(weight > _MIN_STANDARD_ERRORS, weight, 0.0) if weight.any() else size
        if not ranked.any():
            continue
        k, j = map(int, np.unravel_index(int(np.argmax(ranked)), ranked.shape))
        many, considered = float(effects.deviations[k, j]), kind == "parameter"
        moves = " and ".join(_bias(effects, row, j) for row in _named(effects, k, j))
        included = "; included in standard_error_total" if considered else ""
        biases.append((many, f"{effects.changes[j]} would bias {moves}{included}"))
        excluded |= not considered and CALIBRATION.value < many < _UNTOLD
    return biases, excluded


def calibration_sentences(result: Result) -> Iterator[str]:
    """Yield the largest effects of a load's gain, a sensor's, the delay, and a considered parameter.

    Effects that are small beside the standard error have none, nor have effects on rejected estimates.
    """
    biases, excluded = _biases(result)
    yield from (text for _, text in biases)
    if excluded:
        yield "the error bars do not include these errors"


def calibration_caveats(result: Result) -> Iterator[Statement]:
    """Yield the largest bias of the estimates by a calibration error, for pages: it stands beside these."""
    biases, excluded = _biases(result)
    counted = [(many, text) for many, text in biases if many < _UNTOLD]
    if counted:
        text = max(counted)[1]
        if excluded:
            text += "; the intervals include neither errors of gains nor of delays"
        yield on_page(Statement(text, "bad" if excluded else ""))


def _named(effects: _CalibrationEffects, worst: int, quantity: int) -> list[int]:
    """Return the parameter that moves most in standard errors, and that which moves most, if another.

    What moves by less than its error bar is no other.
    """
    moves = np.where(effects.deviations[:, quantity] > 1, np.abs(effects.moves[:, quantity]), 0.0)
    largest = int(np.argmax(moves))
    return [worst] if moves[largest] <= abs(effects.moves[worst, quantity]) else [worst, largest]


def _bias(effects: _CalibrationEffects, parameter: int, quantity: int) -> str:
    """Return the change of an estimate, also in standard errors where these are not of round-off."""
    many = float(np.nan_to_num(effects.deviations[parameter, quantity]))
    said = f"{effects.parameters[parameter]} by {_percent(effects.moves[parameter, quantity])}"
    if not 0 < many < _UNTOLD:
        return said
    return f"{said} ({f'{many:.0f}' if 100 <= many < 1e5 else f'{many:.2g}'} standard errors)"


def _percent(ratio: float) -> str:
    return f"{100 * ratio:+.2g} %" if abs(ratio) < 1 else f"{100 * ratio:+.0f} %"


def calibration_sections(result: Result) -> Iterator[ReportSection]:
    """Yield the effects of every gain error and of the delay on every estimate."""
    effects = _calibration_effects(result)
    if effects is None or not effects.changes:
        return

    def cell(move: float) -> str:
        if not np.isfinite(move):
            return "not identifiable"
        return "-" if abs(move) < _MIN_CHANGE else _percent(move)

    rows = tuple(
        (change, *map(cell, moves)) for change, moves in zip(effects.changes, effects.moves.T, strict=True)
    )
    caption = "first-order changes of the estimates that each error would cause"
    table = on_page(TextTable(("", *effects.parameters), rows, caption=caption, noun="quantity"))
    heads, bias_rows, remarks = known_parts_table(result)
    biases: tuple[Block, ...] = ()
    if bias_rows and "identification/parameters/estimate" in result:  # beside the standard errors
        biases = (TextTable(heads, tuple(bias_rows)), *map(Statement, remarks))
    sentences = map(Statement, calibration_sentences(result))
    blocks = (*map(on_screen, biases), *sentences, table)
    yield ReportSection("Calibration errors", blocks, screen="")
