"""Zero and pole dynamics of prototypes, under the names of the paper, with what they miss."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynid.bondgraph.decomposition.dynamics import Dynamics, dynamics_of
from dynid.bondgraph.engines import modelled_storages
from dynid.bondgraph.question import Engine
from dynid.bondgraph.reduced import ReducedGraph
from dynid.bondgraph.reduction.writing import ATOM, PRODUCT, SUM, TEXT, Written
from dynid.bondgraph.results.roots import add_roots, roots_of
from dynid.bondgraph.transfer import TransferFunction
from dynid.result import Result

#: Most storages with which the dynamics of a prototype are formed unasked.
_STORAGES = 150


def add_output_dynamics(result: Result, reduced: ReducedGraph, engine: Engine) -> None:
    """Add the dynamics of the prototype at every output; of a large graph only for the exact engine."""
    size = modelled_storages(reduced)
    if size > _STORAGES and engine != "exact":
        note = f"not formed: {size:,} storages, and exact equations of A and B are formed up to {_STORAGES}"
        result.annotate("bond_graph/reduction", dynamics=f"{note}; 'engine: exact' forms them all the same")
        return
    for port, reduction in reduced.reductions.items():
        dynamics = dynamics_of(reduced, reduction.prototype)
        add_dynamics(result, f"bond_graph/reduction/dynamics/{port}", dynamics)


def add_dynamics(result: Result, group: str, dynamics: Dynamics) -> None:
    """Add the printed equations as polynomials and roots, what they miss, and the net power (eq 9)."""
    a, b = dynamics.systems
    zero, pole = f"{group}/zero_dynamics", f"{group}/pole_dynamics"
    result.add(f"{zero}/equation", dynamics.zero_equation)
    _add_condition(result, zero, "", dynamics.zero)
    if dynamics.prototype.fixed:
        _add_condition(result, zero, "a_", a.numerator)
        _add_condition(result, zero, "b_", b.numerator)
    _add_condition(result, zero, "missed_", dynamics.missed_zeros)
    _add_condition(result, zero, "foreign_", dynamics.foreign_zeros)
    result.annotate(zero, note=_zero_note(dynamics))
    result.add(f"{pole}/equation", dynamics.pole_equation)
    _add_condition(result, pole, "", dynamics.pole)
    _add_condition(result, pole, "missed_", dynamics.missed_modes)
    result.annotate(pole, note=_pole_note(dynamics))
    if dynamics.driving_point is not None:
        add_ratio(result, f"{group}/driving_point", dynamics.driving_point)
        zeros = roots_of(dynamics.driving_point.numerator) if not dynamics.driving_point.vanishes else ()
        add_roots(result, f"{group}/driving_point", "zeros", zeros)
        add_roots(result, f"{group}/driving_point", "poles", roots_of(dynamics.driving_point.denominator))
        result.annotate(f"{group}/driving_point", equation=dynamics.prototype.equation(TEXT))
    if dynamics.natural != 0:
        modes = roots_of(dynamics.natural)
        add_roots(result, group, "natural_modes", modes)
        result.add(f"{group}/net_power", dynamics.net_power(modes), ("natural_mode",))


def add_ratio(result: Result, group: str, ratio: TransferFunction, formula: str | None = None) -> None:
    """Add a rational function: coefficients in descending powers, denominator monic, and exact as a text."""
    for name, coefficients in zip(("numerator", "denominator"), ratio.coefficients(), strict=True):
        result.add_axis(f"{group}/{name}_power", np.arange(len(coefficients))[::-1])
        result.add(f"{group}/{name}", coefficients, (f"{name}_power",))
    result.add(f"{group}/exact", _ratio_text(ratio))
    if formula is not None:
        result.annotate(group, symbolic=formula)


def _ratio_text(ratio: TransferFunction) -> str:
    def written(polynomial: Any) -> Written:
        text = polynomial_text(polynomial)
        return text, ATOM if text.isalnum() else SUM if " " in text or text.startswith("-") else PRODUCT

    numerator = written(ratio.numerator)
    return numerator[0] if ratio.denominator == 1 else TEXT.quotient(numerator, written(ratio.denominator))[0]


def polynomial_text(polynomial: Any) -> str:
    """Write an integer polynomial in s as SymPy would read it, highest power first."""
    text = ""
    for power, coefficient in sorted(enumerate(polynomial.coeffs()), reverse=True):
        if coefficient == 0:
            continue
        variable = {0: "", 1: "s"}.get(power, f"s**{power}")
        size = "" if abs(coefficient) == 1 and variable else str(abs(coefficient))
        sign = (" - " if coefficient < 0 else " + ") if text else "-" * (coefficient < 0)
        text += f"{sign}{'*'.join(part for part in (size, variable) if part)}"
    return text or "0"


def _add_condition(result: Result, group: str, prefix: str, polynomial: Any) -> None:
    """Add where a polynomial vanishes; one that vanishes everywhere has no roots to list."""
    if polynomial != 0:
        polynomial = polynomial // polynomial.content() * (1 if polynomial.leading_coefficient() > 0 else -1)
    result.add(f"{group}/{prefix}polynomial", polynomial_text(polynomial))
    roots = roots_of(polynomial) if polynomial != 0 else ()
    add_roots(result, group, f"{prefix}roots", roots)


def _zero_note(dynamics: Dynamics) -> str:
    if dynamics.prototype.fixed:
        note = "sufficient, not necessary: the zeros of the driving point are all roots of A + B"
    else:
        note = "the driving point vanishes at the zeros of B and at the poles of A alike"
    if dynamics.prototype.letter == "d":
        note += "; the zeros of A, of e_A/e only, are foreign to it"
    return f"{note}; the requested channel has the zeros of its equivalent source besides"


def _pole_note(dynamics: Dynamics) -> str:
    if dynamics.prototype.fixed:
        return (
            "the natural modes with the driving port removed; of the driving point they are the zeros, its "
            "poles are those of A and B"
        )
    return "modes that cancel in the product of A and B are missed: all are roots of D_A*D_B + N_A*N_B"
