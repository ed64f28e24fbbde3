"""The forms of a driving-point impedance: which exist, and each analysed back by the exact engine."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any, Literal, get_args

from dynid.bondgraph.exact_engine import ExactEngine
from dynid.bondgraph.graph import BondGraph, Port
from dynid.bondgraph.plan import ReducedGraph
from dynid.bondgraph.synthesis.brune import brune
from dynid.bondgraph.synthesis.cauer import NoSuchForm, cauer, second_cauer
from dynid.bondgraph.synthesis.foster import foster, second_foster
from dynid.bondgraph.synthesis.one_port import SOURCE, bond_graph, with_values
from dynid.errors import NumericalError
from dynid.lti.positive_real import fraction, lowest_terms

Form = Literal["cauer", "cauer-2", "foster", "foster-2", "brune"]

#: The forms, in the order of the result.
FORMS: tuple[Form, ...] = get_args(Form)


#: Precision of irrational values, bits, and the significant decimals to which they are rounded; the first
#: pair that meets the tolerance is taken. 0: the shortest decimal of the nearest double.
_PRECISIONS = ((512, 0), (1024, 24), (4096, 60))
#: Cauer's forms are exact; values of more bits than a scene can hold are rounded to this many decimals.
_EXACT = ((28_000, 300),)
#: Range of doubles.
_SMALLEST, _LARGEST = Fraction(1, 10**300), Fraction(10**300)
#: Largest relative error of the coefficients of the graph's own impedance.
TOLERANCE = 1e-13
_CAUER = {"cauer": cauer, "cauer-2": second_cauer}
_BY_ROOTS = {"foster": foster, "foster-2": second_foster, "brune": brune}


@dataclass(frozen=True)
class Realisation:
    """A bond graph with the wanted driving-point impedance, or admittance.

    Parameters
    ----------
    form
        The form.
    graph
        The graph; its source is `SOURCE`.
    numerator, denominator
        Its own driving-point function as the exact engine finds it, in lowest terms, the denominator monic
        (flint `fmpq_poly`).
    residual
        Largest relative error of a coefficient; 0 where the function is the wanted one exactly.
    """

    form: Form
    graph: BondGraph
    numerator: Any
    denominator: Any
    residual: float


@dataclass(frozen=True)
class Driving:
    """A wanted driving-point function N/D in lowest terms, the denominator monic.

    Parameters
    ----------
    numerator, denominator
        Polynomials (flint `fmpq_poly`).
    admittance
        True: flow over effort, driven by an effort source; else effort over flow, driven by a flow source.
    """

    numerator: Any
    denominator: Any
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


def realise(wanted: Driving, form: Form, domain: str = "") -> Realisation:
    """Return the bond graph of a form, analysed back.

    Parameters
    ----------
    wanted
        A positive real function that is not zero.
    form
        The form.
    domain
        The physical domain of the elements; absent: none.

    Raises
    ------
    NoSuchForm
        Where the function has no such form.
    NumericalError
        Where no precision gives the wanted coefficients.
    """
    source: Literal["Se", "Sf"] = "Se" if wanted.admittance else "Sf"
    for bits, digits in _EXACT if form in _CAUER else _PRECISIONS:
        port = _CAUER[form](*wanted.impedance) if form in _CAUER else _BY_ROOTS[form](*wanted.impedance, bits)
        graph = bond_graph(with_values(port, partial(_written, bits=bits, digits=digits)), source, domain)
        _refuse_extremes(graph, form)
        found = _analysed(wanted, form, graph)
        if found.residual <= TOLERANCE:
            return found
    raise NumericalError(
        f"the {form} form has the coefficients of the function only to {found.residual:.1e}",
        remedy="Scale the function, or take another form.",
    )


def _refuse_extremes(graph: BondGraph, form: Form) -> None:
    """Raise where the value of an element is beyond the range of doubles, in which a scene holds it."""
    for node in graph.nodes.values():
        if node.value is not None and not _SMALLEST <= node.value <= _LARGEST:
            raise NumericalError(
                f"{node.name} of the {form} form is outside the range of doubles",
                remedy="Scale the function and its frequencies, or take another form.",
            )


def _analysed(wanted: Driving, form: Form, graph: BondGraph) -> Realisation:
    """Return a graph with its own driving-point function."""
    numerator, denominator = wanted.of_graph(graph)
    above, below = _error(wanted.numerator, numerator), _error(wanted.denominator, denominator)
    return Realisation(form, graph, numerator, denominator, max(above, below))


def _written(value: Fraction, bits: int, digits: int) -> Fraction:
    """Return a value as it is, or one of half the bits or more, which is irrational, rounded."""
    if max(value.numerator.bit_length(), value.denominator.bit_length()) < bits // 2:
        return value
    if not digits and _SMALLEST <= value <= _LARGEST:
        return Fraction(repr(float(value)))
    from decimal import Context, Decimal

    return Fraction(Context(prec=digits or 17).divide(Decimal(value.numerator), Decimal(value.denominator)))


def _error(wanted: Any, found: Any) -> float:
    """Return the largest relative error of a coefficient; infinite where one is there that should not be."""
    if wanted.length() != found.length():
        return math.inf
    pairs = [(fraction(a), fraction(b)) for a, b in zip(wanted.coeffs(), found.coeffs(), strict=True)]
    return max(0.0 if a == b else abs(float((b - a) / a)) if a else math.inf for a, b in pairs)


def realisations(
    wanted: Driving, forms: tuple[Form, ...] | None = None, domain: str = ""
) -> tuple[list[Realisation], dict[Form, str]]:
    """Return the realisations of a function, and the reasons why it has no others.

    Parameters
    ----------
    wanted
        A positive real function that is not zero.
    forms
        The forms, all of which must exist; absent: all that do.
    domain
        The physical domain of the elements; absent: none.

    Raises
    ------
    NoSuchForm
        Where a named form does not exist.
    """
    found, missing = [], dict[Form, str]()
    for form in FORMS if forms is None else forms:
        try:
            found.append(realise(wanted, form, domain))
        except NoSuchForm as error:
            if forms is not None:
                raise NoSuchForm(
                    f"the function has no {form} form: {error.problem}",
                    remedy="Leave 'forms' out for all that exist; brune always does.",
                    names=("forms",),
                ) from None
            missing[form] = error.problem
    return found, missing
