"""Transfer functions as formulas in the parameters: nested as a program, or expanded."""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from dynid.bondgraph.formula_printers import TEXT, FormulaPrinter
from dynid.bondgraph.formulas.expressions import free_letter, print_register, shared
from dynid.bondgraph.program.program import Register
from dynid.bondgraph.reduced_graph import Channel, GraphProgram, ReducedGraph
from dynid.errors import NumericalError, UsageError

if TYPE_CHECKING:
    from dynid.bondgraph.formulas.symbolic import SymbolicQuotient


#: Most terms of numerator or denominator that a reader would read, and most on the way there.
_MAX_READABLE_TERMS, _MAX_TERMS = 40, 4000
#: Largest node of an expression that is written inside another; what is longer gets a name.
_MAX_NESTED_OPERATIONS = 8

Polynomials = tuple[Any, Any]


def readable(reduced: ReducedGraph) -> dict[Channel, Polynomials]:
    """Return numerator and denominator of the channels whose formula is readable (flint `fmpz_mpoly`).

    Elements are written by the expression given for their value, or by their own name where a bare number
    was given. Where that is ambiguous (a parameter called s, a node named like another's parameter), or
    the formula outgrows a page, there is none.
    """
    from dynid.bondgraph.formulas.symbolic import FormulaTooLong

    try:
        formulas = _polynomials(reduced, _MAX_TERMS)
    except (FormulaTooLong, UsageError):
        return {}
    return {
        channel: polynomials
        for channel, polynomials in formulas.items()
        if max(len(polynomial) for polynomial in polynomials) <= _MAX_READABLE_TERMS
    }


def readable_registers(planned: GraphProgram, registers: Iterable[Register]) -> dict[Register, str]:
    """Return the registers whose formula is readable, as text that SymPy could read."""
    from dynid.bondgraph.formulas.symbolic import FormulaTooLong, quotient

    try:
        formulas = _register_polynomials(planned, registers, _MAX_TERMS)
    except (FormulaTooLong, UsageError):
        return {}
    return {
        register: quotient(*polynomials)[0]
        for register, polynomials in formulas.items()
        if max(len(polynomial) for polynomial in polynomials) <= _MAX_READABLE_TERMS
    }


def formulas(reduced: ReducedGraph) -> dict[Channel, str]:
    """Return the channels whose formula is readable, as text that SymPy could read."""
    from dynid.bondgraph.formulas.symbolic import quotient

    return {channel: quotient(*polynomials)[0] for channel, polynomials in readable(reduced).items()}


def expanded(reduced: ReducedGraph, terms: int) -> dict[Channel, Polynomials]:
    """Return numerator and denominator of every channel as polynomials in s and the parameters.

    `terms`: most terms of a polynomial, the intermediate ones included. Raises `NumericalError` where there
    would be more terms. Raises `UsageError` where a value is no rational function of the parameters, or a
    name is ambiguous.
    """
    from dynid.bondgraph.formulas.symbolic import FormulaTooLong

    try:
        return _polynomials(reduced, terms)
    except FormulaTooLong:
        raise NumericalError(
            f"an expanded transfer function has more than {terms:,} terms, or takes far more on the way "
            "(analysis.symbolic.terms)",
            remedy="Raise the guard, or ask for 'form: nested', which grows with the graph only.",
            names=("analysis.symbolic",),
        ) from None


def nested(reduced: ReducedGraph, registers: Iterable[Register], hand: FormulaPrinter = TEXT) -> str:
    """Write registers as a program: named assignments, each used below, none expanded.

    `registers`: what the program ends in; the last assignments are called T, or T1, T2, …. Raises
    `UsageError` where a name is ambiguous.
    """
    symbol_names(reduced)
    requested = list(dict.fromkeys(registers))
    reserved = {*reduced.graph.nodes, *_parameters(reduced)}
    named = shared(reduced.program, requested, _MAX_NESTED_OPERATIONS)
    letter = free_letter(reserved)
    inner = [register for register in named if register not in requested]
    names = {register: f"{letter}{k}" for k, register in enumerate(inner, 1)}
    final = free_letter(reserved, "T")
    ends = {r: final if len(requested) == 1 else f"{final}{k}" for k, r in enumerate(requested, 1)}
    labels = {**names, **ends}
    nodes = reduced.graph.nodes
    lines = [
        f"{hand.name(name)[0]} = {print_register(reduced.program, register, nodes, labels, hand)[0]}"
        for register, name in labels.items()
    ]
    return "\n".join(lines)


def _polynomials(reduced: ReducedGraph, limit: int) -> dict[Channel, Polynomials]:
    channels = reduced.channels()
    formulas = _register_polynomials(reduced, channels.values(), limit)
    return {channel: formulas[register] for channel, register in channels.items()}


def _register_polynomials(
    planned: GraphProgram, registers: Iterable[Register], limit: int
) -> dict[Register, Polynomials]:
    from dynid.bondgraph.formulas.symbolic import variables

    requested = list(registers)
    symbols, unity = variables(["s", *symbol_names(planned)], limit)
    values = {name: symbol_value(planned, name, symbols, unity) for name in planned.valued}
    run = planned.run(requested, values, symbols["s"], unity)
    common = _common_factors(planned, values, symbols["s"], unity, requested)
    formulas = {}
    for register in requested:  # a common factor is sought only where there is one
        formula = run[register]
        numerator, denominator = formula.lowest_terms() if common[register] else formula.multiplied_out()
        if denominator.leading_coefficient() < 0:
            numerator, denominator = -numerator, -denominator
        content = int(numerator.content()) if numerator != 0 else 1
        content_of_both = math.gcd(content, int(denominator.content())) if content > 1 else 1
        if content_of_both > 1:
            numerator, denominator = numerator // content_of_both, denominator // content_of_both
        formulas[register] = numerator, denominator
    return formulas


def _common_factors(
    reduced: GraphProgram,
    values: dict[str, SymbolicQuotient],
    s: SymbolicQuotient,
    unity: SymbolicQuotient,
    registers: Iterable[Register],
) -> dict[Register, bool]:
    """Return, for each register, whether numerator and denominator, multiplied out, have a common factor.

    On a random line through the space of s and the parameters polynomials become polynomials in one variable,
    modulo a prime, which have a common factor only if there is one in the large.
    """
    from dynid.bondgraph.program.factored import ModularQuotient, PolynomialFactor, polynomial, primes

    registers, prime = list(registers), min(reduced.program.prime, next(primes()))
    source = random.Random(0x11AE)
    lines = [polynomial([source.randrange(prime), source.randrange(1, prime)], prime) for _ in s.ring.names()]

    met: dict[PolynomialFactor, PolynomialFactor] = {}

    def restricted(value: SymbolicQuotient) -> ModularQuotient:
        if value.factors is None:
            return ModularQuotient(None, 1, prime)
        for factor in value.factors:
            if factor not in met:
                met[factor] = PolynomialFactor(_on_line(factor.polynomial, lines, prime))
        factors = {met[factor]: power for factor, power in value.factors.items()}
        return ModularQuotient(factors, value.sign, prime)

    images = {name: restricted(value) for name, value in values.items()}
    run = reduced.run(registers, images, restricted(s), restricted(unity))
    parts = {register: run[register].multiplied_out() for register in registers}
    return {r: above == 0 or above.gcd(below).degree() > 0 for r, (above, below) in parts.items()}


def _on_line(restricted: Any, lines: Sequence[Any], prime: int) -> Any:
    """Return a polynomial where each of its variables is one of these of a single one, modulo a prime."""
    from dynid.bondgraph.program.factored import polynomial

    total = polynomial([0], prime)
    for exponents, coefficient in restricted.terms():
        term = polynomial([int(coefficient) % prime], prime)
        for line, power in zip(lines, exponents, strict=True):
            if power:
                term = term * line ** int(power)
        total = total + term
    return total


def symbol_names(reduced: GraphProgram) -> list[str]:
    """Return the symbols needed.

    Raises `UsageError` where they are ambiguous.
    """
    nodes = [reduced.graph.nodes[name] for name in reduced.valued]
    parameters = _parameters(reduced)
    if "s" in parameters:
        raise _ambiguous("s", "is the variable of the transfer function")
    named = [node.name for node in nodes if not (node.formula and node.formula.names)]
    for name in named:
        if not name.isidentifier():
            raise _ambiguous(name, "would be read as arithmetic")
        if name == "s" or name in parameters:
            raise _ambiguous(name, "stands for two things")
    return [*dict.fromkeys([*named, *sorted(parameters)])]


def _parameters(reduced: GraphProgram) -> set[str]:
    """Return the parameters that values are written in."""
    nodes = (reduced.graph.nodes[name] for name in reduced.valued)
    return {name for node in nodes if node.formula for name in node.formula.names}


def _ambiguous(name: str, why: str) -> UsageError:
    return UsageError(
        f"formulas cannot be written in the name '{name}': it {why}",
        remedy="Give it another name.",
        names=[name],
    )


def symbol_value(
    reduced: GraphProgram, name: str, symbols: dict[str, SymbolicQuotient], unity: SymbolicQuotient
) -> SymbolicQuotient:
    """Return the value of a node as a formula in the symbols.

    Raises `KeyError` where its expression is no rational function.
    """
    from dynid.bondgraph.formulas.symbolic import apply

    formula = reduced.graph.nodes[name].formula
    if formula is None or not formula.names:
        return symbols[name]

    def leaf(item: Fraction | str) -> SymbolicQuotient:
        return symbols[item] if isinstance(item, str) else unity.constant(item)

    try:
        value: SymbolicQuotient = formula.fold(leaf, apply)
    except (KeyError, ZeroDivisionError):
        raise UsageError(
            f"the value of '{name}', {formula.text}, is no short rational function of the parameters",
            remedy="Name it by a parameter of its own, or ask for 'form: nested'.",
            names=[name],
        ) from None
    return value
