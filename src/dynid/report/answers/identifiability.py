"""What a record can tell, before it is worked on: bounds, parameters that go together, shifts of modes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dynid.numerals import quantity
from dynid.report.answers.blocks import Block, Grid, Note, Part
from dynid.report.answers.common import more
from dynid.result import Result

GROUP = "identification/identifiability"
#: The most modes that are listed, and the least relative shift that is worth a number.
_MOST_MODES, _SHIFT = 20, 1e-6


def bound_text(value: float) -> str:
    """Write a relative bound."""
    if not math.isfinite(value):
        return "not told"
    return f"{100 * value:.2g} %" if value < 1 else f"{100 * value:.3g} %"


def identifiability_parts(result: Result) -> Iterator[Part]:
    """Yield bounds, collinear parameters, and what the parameters do to the modes."""
    if f"{GROUP}/relative_bound" in result:
        yield Part(
            "What the record can tell", (*_bounds(result), *(Note(text, "bad") for text in groups(result)))
        )
        yield Part("Parameters and modes", tuple(_shifts(result)))


class Bounds(NamedTuple):
    """The bounds of a record.

    Parameters
    ----------
    where
        At which values of the parameters, and of what noise.
    of_time
        Whether the record is one of time, with an initial state; else of frequency responses.
    rows
        Parameter with unit, value, bound, and of a record of time the bound with the state known.
    """

    where: tuple[str, str]
    of_time: bool
    rows: tuple[tuple[str, ...], ...]


def bounds(result: Result) -> Bounds:
    """Return how well the record can tell each parameter."""
    get = {name: result[f"{GROUP}/{name}"].data for name in ("parameter", "unit", "value", "relative_bound")}
    known = result[f"{GROUP}/relative_bound_known_state"].data
    attrs = result.group_attrs[GROUP]
    place = "true values" if attrs["at"] == "true" else "start values"
    noise = "" if attrs["noise"] == "known" else "; noise assumed, 1 % of each channel"
    of_time = "identification/measurement/omega" not in result
    rows = tuple(
        (
            f"{name} [{unit}]".removesuffix(" []"),
            quantity(value),
            bound_text(bound),
            *([bound_text(least)] if of_time else []),
        )
        for name, unit, value, bound, least in zip(*get.values(), known, strict=True)
    )
    return Bounds((place, noise), of_time, rows)


def _bounds(result: Result) -> Iterator[Block]:
    found = bounds(result)
    heads = ("", "value", "bound", *(["bound, initial state known"] if found.of_time else []))
    yield Grid(heads, found.rows, caption=f"Cramér–Rao bound at the {''.join(found.where)}")


def groups(result: Result) -> Iterator[str]:
    """Yield which parameters cannot be told apart, or not be seen."""
    group = f"{GROUP}/groups"
    bounds = dict(zip(result[f"{GROUP}/parameter"].data, result[f"{GROUP}/relative_bound"].data, strict=True))
    for names, seen in zip(result[f"{group}/parameters"].data, result[f"{group}/seen"].data, strict=True):
        told = all(math.isfinite(bounds[name]) for name in names.split(", "))
        how = "are hardly told apart" if told else "cannot be told apart"
        only = f": the record shows {'mostly' if told else 'only'} {seen}" if seen else ""
        yield f"{names} {how}{only}"
    grouped = {name for names in result[f"{group}/parameters"].data for name in names.split(", ")}
    unseen = [name for name, bound in bounds.items() if not math.isfinite(bound) and name not in grouped]
    if unseen:
        yield f"{', '.join(unseen)} cannot be seen: excite or measure where the joint works"


def _shifts(result: Result) -> Iterator[Block]:
    columns, rows = shifts(result)
    said = "What 1 % of a stiffness does to a mode's frequency, and 1 % of a damping to its damping ratio"
    yield Grid(columns, tuple(rows[:_MOST_MODES]), caption=said)
    yield from more(len(rows), _MOST_MODES, "mode")


def shifts(result: Result) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return what one per cent of each parameter does to frequency and damping of each mode."""
    group = f"{GROUP}/modal_sensitivity"
    get = {name: result[f"{group}/{name}"].data for name in ("omega", "zeta")}
    names = result[f"{group}/parameter"].data
    values = result[f"{GROUP}/value"].data
    by_omega = result[f"{group}/omega_by_parameter"].data * values / get["omega"][:, None]
    by_zeta = result[f"{group}/zeta_by_parameter"].data * values
    rows = []
    for k in range(len(get["omega"])):
        moved = [
            _shift(by_omega[k, j]) if str(name).endswith(".k") else _shift(by_zeta[k, j], "ζ ")
            for j, name in enumerate(names)
        ]
        rows.append((f"{k + 1}", f"{get['omega'][k]:.5g}", f"{100 * get['zeta'][k] + 0.0:.3g} %", *moved))
    return ("mode", "rad/s", "damping", *map(str, names)), rows


def _shift(part: float, what: str = "") -> str:
    if not np.isfinite(part):
        return "∞"
    return "-" if abs(part) < _SHIFT else f"{what}{part:+.2g} %"
