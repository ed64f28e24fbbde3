"""The forms of a driving-point impedance: which exist, and each analysed back by the exact engine.

In the result: the wanted function, and every realisation with its elements, nodes and bonds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from dynid.bondgraph.exact_engine import ExactEngine, TransferFunction
from dynid.bondgraph.graph import UNITS, VALUED, BondGraph, Port, unit_quotient
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.bondgraph.results.channels import add_coefficients
from dynid.bondgraph.synthesis.one_port import SOURCE, bond_graph, with_values
from dynid.bondgraph.synthesis.realisations import (
    NoSuchForm,
    brune,
    cauer,
    foster,
    second_cauer,
    second_foster,
)
from dynid.errors import NumericalError
from dynid.lti.certified_roots import repeated
from dynid.lti.positive_real import fraction, lowest_terms
from dynid.model_scope import ScopePart, add_model_scope
from dynid.progress import tracked

if TYPE_CHECKING:
    from dynid.result import Result

Form = Literal["cauer", "cauer-2", "foster", "foster-2", "brune"]

#: The forms, in the order of the result.
FORMS: tuple[Form, ...] = get_args(Form)


#: Precision of irrational values, bits, and the significant decimals to which they are rounded; the first
#: pair that meets the tolerance is taken. 0: the shortest decimal of the nearest double.
_SYNTHESIS_PRECISIONS = ((512, 0), (1024, 24), (4096, 60))
#: Cauer's forms are exact; values of more bits than a scene can hold are rounded to this many decimals.
_EXACT_PRECISIONS = ((28_000, 300),)
#: Range of doubles.
_SMALLEST, _LARGEST = Fraction(1, 10**300), Fraction(10**300)
#: Largest relative error of the coefficients of the graph's own impedance.
TOLERANCE = 1e-13
_CAUER = {"cauer": cauer, "cauer-2": second_cauer}
_BY_ROOTS = {"foster": foster, "foster-2": second_foster, "brune": brune}


@dataclass(frozen=True)
class Realisation:
    """A bond graph with the wanted driving-point impedance, or admittance."""

    form: Form
    graph: BondGraph  # the graph; its source is `SOURCE`
    #: numerator, denominator: Its own driving-point function as the exact engine finds it, in lowest terms,
    #: the denominator monic (flint `fmpq_poly`).
    numerator: Any
    denominator: Any
    residual: float  # largest relative error of a coefficient; 0 where the function is the wanted one exactly


@dataclass(frozen=True)
class Driving:
    """A wanted driving-point function N/D in lowest terms, the denominator monic."""

    #: numerator, denominator: Polynomials (flint `fmpq_poly`).
    numerator: Any
    denominator: Any
    #: True: flow over effort, driven by an effort source; else effort over flow, driven by a flow source.
    admittance: bool = False

    @classmethod
    def of(
        cls, numerator: list[Fraction], denominator: list[Fraction], *, admittance: bool = False
    ) -> Driving:
        """Return the function of coefficients in descending powers."""
        from flint import fmpq, fmpq_poly

        above, below = (
            fmpq_poly([fmpq(c.numerator, c.denominator) for c in reversed(coefficients)])
            for coefficients in (numerator, denominator)
        )
        return cls(*lowest_terms(above, below), admittance)

    @property
    def impedance(self) -> tuple[Any, Any]:
        """Numerator and denominator of the impedance."""
        both = (self.numerator, self.denominator)
        return both[::-1] if self.admittance else both

    @property
    def port(self) -> Port:
        """The variable at the source whose transfer function this is."""
        return Port(SOURCE, "f" if self.admittance else "e")

    def of_graph(self, graph: BondGraph) -> tuple[Any, Any]:
        """Return numerator and denominator of a graph's own driving-point function, by the exact engine."""
        from flint import fmpq_poly

        transfer = ExactEngine(ReducedGraph(graph, (SOURCE,), (self.port,))).channel((self.port, SOURCE))
        return lowest_terms(fmpq_poly(transfer.numerator), fmpq_poly(transfer.denominator))


def kind_of(numerator: Any, denominator: Any) -> str:
    """Return the kinds of elements that a positive real impedance needs: R, LC, RC, RL or RLC."""
    from flint import fmpq_poly

    from dynid.lti.positive_real import find_violation, in_square, real_part

    if numerator.degree() == denominator.degree() == 0:
        return "R"
    if real_part(numerator, denominator) == 0:
        return "LC"
    s, above, below = fmpq_poly([0, 1]), in_square(numerator), in_square(denominator)
    # Z(s) is that of an RC one-port where s Z(s²) is one of an LC one-port, and of RL where Z(s²)/s is
    for kind, ratio in (("RC", (s * above, below)), ("RL", (above, s * below))):
        if find_violation(*lowest_terms(*ratio)) is None:
            return kind
    return "RLC"


def realise(request: Driving, form: Form, domain: str = "") -> Realisation:
    """Return the bond graph of a form, analysed back.

    `request`: a positive real function that is not zero. `domain`: the physical domain of the elements;
    default: none. Raises `NoSuchForm` where the function has no such form. Raises `NumericalError` where no
    precision gives the wanted coefficients.
    """
    source: Literal["Se", "Sf"] = "Se" if request.admittance else "Sf"
    for bits, digits in _EXACT_PRECISIONS if form in _CAUER else _SYNTHESIS_PRECISIONS:
        port = (
            _CAUER[form](*request.impedance) if form in _CAUER else _BY_ROOTS[form](*request.impedance, bits)
        )
        graph = bond_graph(with_values(port, partial(_written, bits=bits, digits=digits)), source, domain)
        for node in graph.nodes.values():
            if node.value is not None and not _SMALLEST <= node.value <= _LARGEST:
                raise NumericalError(
                    f"{node.name} of the {form} form is outside the range of doubles",
                    remedy="Scale the function and its frequencies, or take another form.",
                )
        own = request.of_graph(graph)
        residual = max(map(_error, (request.numerator, request.denominator), own))
        if residual <= TOLERANCE:
            return Realisation(form, graph, *own, residual)
    raise NumericalError(
        f"the {form} form has the coefficients of the function only to {residual:.1e}",
        remedy="Scale the function, or take another form.",
    )


def _written(value: Fraction, bits: int, digits: int) -> Fraction:
    """Return a value as it is, or one of half the bits or more, which is irrational, rounded."""
    if max(value.numerator.bit_length(), value.denominator.bit_length()) < bits // 2:
        return value
    if not digits and _SMALLEST <= value <= _LARGEST:
        return Fraction(repr(float(value)))
    from decimal import Context, Decimal

    return Fraction(Context(prec=digits or 17).divide(Decimal(value.numerator), Decimal(value.denominator)))


def _error(requested: Any, realised: Any) -> float:
    """Return the largest relative error of a coefficient; infinite where one is there that should not be."""
    if requested.length() != realised.length():
        return math.inf
    pairs = [(fraction(a), fraction(b)) for a, b in zip(requested.coeffs(), realised.coeffs(), strict=True)]
    return max(0.0 if a == b else abs(float((b - a) / a)) if a else math.inf for a, b in pairs)


def realisations(
    request: Driving, forms: tuple[Form, ...] | None = None, domain: str = ""
) -> tuple[list[Realisation], dict[Form, str]]:
    """Return the realisations of a function, and the reasons why it has no others.

    `request`: a positive real function that is not zero. `forms`: the forms, all of which must exist;
    default: all that do. `domain`: the physical domain of the elements; default: none. Raises `NoSuchForm`
    where a named form does not exist.
    """
    realised, missing = [], dict[Form, str]()
    for form in tracked(FORMS if forms is None else forms, "form"):
        try:
            realised.append(realise(request, form, domain))
        except NoSuchForm as error:
            if forms is not None:
                raise NoSuchForm(
                    f"the function has no {form} form: {error.problem}",
                    remedy="Leave 'forms' out for all that exist; brune always does.",
                    names=("forms",),
                ) from None
            missing[form] = error.problem
    return realised, missing


def add_synthesis(
    result: Result,
    request: Driving,
    realised: Sequence[Realisation],
    missing: Mapping[Form, str],
    scenes: Mapping[Form, str],
    domain: str = "",
) -> None:
    """Add the realisations of a driving-point function to a result.

    Parameters
    ----------
    realised
        Its realisations.
    missing
        The reasons why other forms do not exist.
    scenes
        The text of the scene of each realisation.
    domain
        The physical domain; default: no units.

    Notes
    -----
    ``synthesis/``: the coefficients of the wanted function in descending powers, its zeros and poles;
    ``form`` with the ``residual`` of each. ``synthesis/<form>/``: ``element``, ``type``, ``value`` and
    ``exact`` (the value as text), ``node`` and ``node_type``, ``bond``, ``numerator`` and ``denominator`` of
    the graph's own function, and the ``scene``.
    """
    effort, flow = (UNITS[domain][key] if domain else "" for key in "ef")
    above, below = (flow, effort) if request.admittance else (effort, flow)
    unit = unit_quotient(above, below) if domain else ""
    what = "admittance" if request.admittance else "impedance"
    kind = kind_of(*request.impedance)
    transfer = TransferFunction(*integer_quotient(request.numerator, request.denominator))
    degree = max(request.numerator.degree(), request.denominator.degree())
    result.annotate("synthesis", function=what, unit=unit, domain=domain, kind=kind, degree=int(degree))
    add_coefficients(result, "synthesis", transfer)
    for axis, roots in (("zero", transfer.zeros), ("pole", transfer.poles)):
        result.add_numbered(f"synthesis/{axis}", repeated(roots), "rad/s")
    result.add("synthesis/positive_real", True)
    result.add_axis("synthesis/form", np.array([realisation.form for realisation in realised], dtype=object))
    result.add("synthesis/residual", [realisation.residual for realisation in realised], ("form",))
    for realisation in realised:
        _add_realisation(result, realisation, scenes[realisation.form])
    reasons = "; ".join(f"{form}: {why}" for form, why in missing.items())
    names = [realisation.form for realisation in realised]
    left_out = [*missing] or [form for form in FORMS if form not in names]
    parts = [ScopePart("forms", names, left_out, reasons or "not requested")]
    add_model_scope(result, "synthesis", parts)


def _add_realisation(result: Result, realisation: Realisation, scene: str) -> None:
    group, nodes = f"synthesis/{realisation.form}", list(realisation.graph.nodes.values())
    elements = [node for node in nodes if node.type in VALUED]
    result.add_axis(f"{group}/element", [node.name for node in elements])
    result.add(f"{group}/type", [node.type for node in elements], ("element",))
    values = [float(realisation.graph.value(node.name)) for node in elements]
    result.add(f"{group}/value", values, ("element",))
    result.add(f"{group}/exact", [str(node.value) for node in elements], ("element",))
    result.add_axis(f"{group}/node", [node.name for node in nodes])
    result.add(f"{group}/node_type", [node.type for node in nodes], ("node",))
    result.add_axis(f"{group}/bond", [str(bond) for bond in realisation.graph.bonds])
    own = integer_quotient(realisation.numerator, realisation.denominator)
    add_coefficients(result, group, TransferFunction(*own))
    result.add(f"{group}/residual", realisation.residual)
    result.add(f"{group}/scene", scene)


def integer_quotient(numerator: Any, denominator: Any) -> tuple[Any, Any]:
    """Return two rational polynomials as integer ones with the same quotient (flint `fmpz_poly`)."""
    return numerator.numer() * denominator.denom(), denominator.numer() * numerator.denom()
