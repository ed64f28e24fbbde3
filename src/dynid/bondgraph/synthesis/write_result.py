"""Results of a synthesis: the wanted function, and every realisation with its elements, nodes and bonds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.bondgraph.exact_engine import TransferFunction
from dynid.bondgraph.graph import UNITS, VALUED, unit_quotient
from dynid.bondgraph.synthesis.forms import FORMS, Driving, Form, Realisation, kind_of
from dynid.lti.certified_roots import repeated
from dynid.model_scope import ScopePart, add_model_scope

if TYPE_CHECKING:
    from dynid.result import Result


def add_synthesis(
    result: Result,
    wanted: Driving,
    found: Sequence[Realisation],
    missing: Mapping[Form, str],
    scenes: Mapping[Form, str],
    domain: str = "",
) -> None:
    """Add the realisations of a driving-point function to a result.

    Parameters
    ----------
    result
        The result.
    wanted
        The function.
    found
        Its realisations.
    missing
        The reasons why other forms do not exist.
    scenes
        The text of the scene of each realisation.
    domain
        The physical domain; absent: no units.

    Notes
    -----
    ``synthesis/``: the coefficients of the wanted function in descending powers, its zeros and poles;
    ``form`` with the ``residual`` of each. ``synthesis/<form>/``: ``element``, ``type``, ``value`` and
    ``exact`` (the value as text), ``node`` and ``node_type``, ``bond``, ``numerator`` and ``denominator`` of
    the graph's own function, and the ``scene``.
    """
    effort, flow = (UNITS[domain][key] if domain else "" for key in "ef")
    above, below = (flow, effort) if wanted.admittance else (effort, flow)
    unit = unit_quotient(above, below) if domain else ""
    what = "admittance" if wanted.admittance else "impedance"
    kind = kind_of(*wanted.impedance)
    transfer = TransferFunction(*integer_quotient(wanted.numerator, wanted.denominator))
    degree = max(wanted.numerator.degree(), wanted.denominator.degree())
    result.annotate("synthesis", function=what, unit=unit, domain=domain, kind=kind, degree=int(degree))
    _add_coefficients(result, "synthesis", transfer)
    for axis, roots in (("zero", transfer.zeros), ("pole", transfer.poles)):
        values = repeated(roots)
        result.add_axis(f"synthesis/{axis}", np.arange(1, len(values) + 1))
        result.add(f"synthesis/{axis}s", values, (axis,), "rad/s")
    result.add("synthesis/positive_real", True)
    result.add_axis("synthesis/form", np.array([one.form for one in found], dtype=object))
    result.add("synthesis/residual", [one.residual for one in found], ("form",))
    for one in found:
        _add_realisation(result, one, scenes[one.form])
    reasons = "; ".join(f"{form}: {why}" for form, why in missing.items())
    names = [one.form for one in found]
    left_out = [*missing] or [form for form in FORMS if form not in names]
    parts = [ScopePart("forms", names, left_out, reasons or "not requested")]
    add_model_scope(result, "synthesis", parts)


def _add_realisation(result: Result, one: Realisation, scene: str) -> None:
    group, nodes = f"synthesis/{one.form}", list(one.graph.nodes.values())
    elements = [node for node in nodes if node.type in VALUED]
    result.add_axis(f"{group}/element", [node.name for node in elements])
    result.add(f"{group}/type", [node.type for node in elements], ("element",))
    result.add(f"{group}/value", [float(one.graph.value(node.name)) for node in elements], ("element",))
    result.add(f"{group}/exact", [str(node.value) for node in elements], ("element",))
    result.add_axis(f"{group}/node", [node.name for node in nodes])
    result.add(f"{group}/node_type", [node.type for node in nodes], ("node",))
    result.add_axis(f"{group}/bond", [str(bond) for bond in one.graph.bonds])
    _add_coefficients(result, group, TransferFunction(*integer_quotient(one.numerator, one.denominator)))
    result.add(f"{group}/residual", one.residual)
    result.add(f"{group}/scene", scene)


def _add_coefficients(result: Result, group: str, transfer: TransferFunction) -> None:
    for name, coefficients in zip(("numerator", "denominator"), transfer.coefficients(), strict=True):
        result.add_axis(f"{group}/{name}_power", np.arange(len(coefficients))[::-1])
        result.add(f"{group}/{name}", coefficients, (f"{name}_power",))


def integer_quotient(numerator: Any, denominator: Any) -> tuple[Any, Any]:
    """Return two rational polynomials as integer ones with the same quotient (flint `fmpz_poly`)."""
    return numerator.numer() * denominator.denom(), denominator.numer() * numerator.denom()
