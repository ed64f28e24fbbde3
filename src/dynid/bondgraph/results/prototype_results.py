"""The trace of a reduction, its prototype, and the zero and pole dynamics of the prototype in a result."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.ldl import reference
from dynid.bondgraph.analysis_request import Analysis, Engine, modelled_storages
from dynid.bondgraph.exact_engine import TransferFunction
from dynid.bondgraph.formula_printers import ATOM, LATEX, PRODUCT, SUM, TEXT, FormulaPrinter, Printed
from dynid.bondgraph.formulas.expressions import length, print_register, print_sum
from dynid.bondgraph.reduced_graph import GraphProgram, ReducedGraph
from dynid.bondgraph.reduction.prototypes import Prototype
from dynid.bondgraph.reduction.reducer import Reduction
from dynid.bondgraph.results.channels import add_coefficients, add_roots, roots_of
from dynid.lti.positive_real import fraction, nearest_double
from dynid.result import Result

if TYPE_CHECKING:
    from dynid.bondgraph.decomposition.prototype_dynamics import PrototypeDynamics

#: Bits of the denominator of a coefficient that is written as a fraction.
_MAX_FRACTION_BITS = 64

# --- steps and prototypes -------------------------------------------------------------------------

#: Longest nested formula of a prototype's system that is written out, in operations.
_MAX_SYSTEM_OPERATIONS = 40


def add_reductions(result: Result, reduced: ReducedGraph, analysis: Analysis) -> None:
    """Add the steps to every output, the prototypes and their dynamics, as far as they are asked for."""
    drawn, rows = reduced, list[tuple[str, ...]]()
    if analysis.late:
        drawn = ReducedGraph(analysis.named_delays.graph, reduced.inputs, reduced.outputs)
        rows = [*_delay_rows(analysis)]
    if "reduction" in analysis.results:
        reductions = {str(port): reduction for port, reduction in drawn.reductions.items()}
        add_traces(result, "bond_graph/reduction", drawn, reductions, "output", rows)
    _add_prototypes(result, drawn)
    if "prototype" in analysis.results:
        _add_output_dynamics(result, reduced, analysis.engine)


def _delay_rows(analysis: Analysis) -> Iterator[tuple[str, ...]]:
    """Yield what the names of delays and lines stand for: rule, nodes, equation, meaning and LaTeX."""
    graph, late = analysis.named_delays.graph, [loop for loop in analysis.loops if loop.delayed]
    for (name, _), loop in zip(
        analysis.named_delays.delayed, (loop for loop in late if not loop.line), strict=True
    ):
        sign, delay = "-" if graph.value(name) < 0 else "", f"{float(reference(loop.delay)):g}"
        meaning = f"the answer of the loop from {loop.measured} to {loop.source} is {delay} s late"
        texts = (f"{hand.name(name)[0]} = {sign}" for hand in (TEXT, LATEX))
        text, latex = next(texts) + f"exp(-{delay}*s)", next(texts) + f"e^{{-{delay} s}}"
        yield "delay", name, text, meaning, latex
    for loop in {loop.line: loop for loop in late if loop.line}.values():
        arms = [name for name, node in graph.nodes.items() if node.part == loop.line and node.type == "R"]
        Z, T = (f"{float(reference(value)):g}" for value in (graph.value(arms[0]), loop.delay))
        meaning = f"line {loop.line} is a T of impedances: one along each half, one across"
        first, second, across = arms
        text = f"{first} = {second} = {Z}*tanh({T}*s/2); {across} = {Z}/sinh({T}*s)"
        first, second, across = (LATEX.name(arm)[0] for arm in arms)
        tanh, sinh = rf"{Z} \tanh\frac{{{T} s}}{{2}}", rf"\frac{{{Z}}}{{\sinh {T} s}}"
        yield "line", loop.line, text, meaning, rf"{first} = {second} = {tanh};\quad {across} = {sinh}"


def add_traces(
    result: Result,
    group: str,
    planned: GraphProgram,
    reductions: Mapping[str, Reduction],
    of: str,
    definitions: Sequence[tuple[str, ...]] = (),
) -> None:
    """Add the steps of reductions as one table; its column `of` says which reduction a step belongs to.

    `definitions`: rows ahead of each: rule, nodes, equation, meaning and LaTeX.
    """
    rows = []
    for name, reduction in reductions.items():
        rows += [(*definition[:4], name, definition[4]) for definition in definitions]
        written = zip(*(equations(planned, reduction, hand) for hand in (TEXT, LATEX)), strict=True)
        for step, (text, latex) in zip(reduction.steps, written, strict=True):
            rows.append((step.rule, ", ".join(step.nodes), text, step.meaning, name, latex))
    result.add_numbered(f"{group}/step", table(rows, ("rule", "nodes", "equation", "meaning", of, "latex")))


def table(rows: Sequence[tuple[Any, ...]], names: Sequence[str]) -> NDArray[np.void]:
    """Return rows of texts as an array with a name for every column."""
    return np.array([tuple(row) for row in rows], dtype=[(name, object) for name in names])


def _add_prototypes(result: Result, reduced: ReducedGraph) -> None:
    """Add the prototype at every output: its letter, its equation, and the systems A and B."""
    ports = list(reduced.reductions)
    result.add_axis("bond_graph/reduction/output", [str(port) for port in ports])
    letters = [reduced.reductions[port].prototype.letter for port in ports]
    if len(ports) == 1:
        result.add("bond_graph/reduction/prototype", letters[0])
    else:
        result.add("bond_graph/reduction/prototype", letters, ("output",))
    left_out = [", ".join(reduced.dropped(port)) for port in ports]
    result.add("bond_graph/reduction/dropped", left_out, ("output",))
    prototypes = [reduced.reductions[port].prototype for port in ports]
    for hand, suffix in ((TEXT, ""), (LATEX, "_latex")):
        texts = [prototype.equation(hand) for prototype in prototypes]
        result.add(f"bond_graph/reduction/prototype_equation{suffix}", texts, ("output",))
        for system, index in (("system_a", 0), ("system_b", 1)):
            texts = [
                system_text(reduced, reduction.prototype, index, reduction.labels, hand)
                for reduction in reduced.reductions.values()
            ]
            result.add(f"bond_graph/reduction/{system}{suffix}", texts, ("output",))


def system_text(
    planned: GraphProgram, prototype: Prototype, index: int, labels: Mapping[int, str], hand: FormulaPrinter
) -> str:
    """Write system A or B of a prototype: nested while that is readable, else by the names of the steps."""
    name, register = prototype.systems[index]
    nested = length(planned.program, register, _MAX_SYSTEM_OPERATIONS) < _MAX_SYSTEM_OPERATIONS
    text, _ = print_register(planned.program, register, planned.graph.nodes, {} if nested else labels, hand)
    return f"{hand.name(name)[0]} = {text}"


def equations(planned: GraphProgram, reduction: Reduction, hand: FormulaPrinter) -> Iterator[str]:
    """Yield the equations of every step, in terms of what was defined before."""
    registers = {name: register for register, name in reduction.labels.items()}
    labels: dict[int, str] = {}
    for step in reduction.steps:
        lines = []
        for name, parts in step.definitions:
            if callable(parts):
                text, _ = parts(hand)
            else:
                terms: list[Printed] = []  # registers by their names, but not by the one being defined
                for variable in dict.fromkeys(variable for _, variable in parts):
                    registers_of = [(r, labels.get(r) == name) for r, by in parts if by == variable]
                    coefficients = print_sum(planned.program, registers_of, planned.graph.nodes, labels, hand)
                    if variable:
                        coefficients = [hand.scaled(hand.listed(coefficients), variable)]
                    terms += coefficients
                text, _ = hand.listed([term for term in terms if not term[0].startswith("0")])
            lines.append(f"{hand.name(name)[0]} = {text}")
            if name in registers:
                labels[registers[name]] = name
        yield ("; " if hand is TEXT else r";\quad ").join(lines)


# --- zero and pole dynamics -----------------------------------------------------------------------

#: Most storage elements with which the dynamics of a prototype are formed unasked.
_MAX_PROTOTYPE_SIZE = 150


def _add_output_dynamics(result: Result, reduced: ReducedGraph, engine: Engine) -> None:
    """Add the dynamics of the prototype at every output; of a large graph only for the exact engine."""
    size = modelled_storages(reduced)
    if size > _MAX_PROTOTYPE_SIZE and engine != "exact":
        note = f"not formed: {size:,} storage elements; exact equations of A and B: "
        note += f"up to {_MAX_PROTOTYPE_SIZE}"
        result.annotate("bond_graph/reduction", dynamics=f"{note}; 'engine: exact' forms them all the same")
        return
    from dynid.bondgraph.decomposition.prototype_dynamics import prototype_dynamics

    for port, reduction in reduced.reductions.items():
        dynamics = prototype_dynamics(reduced, reduction.prototype)
        add_dynamics(result, f"bond_graph/reduction/dynamics/{port}", dynamics)


def add_dynamics(result: Result, group: str, dynamics: PrototypeDynamics) -> None:
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
    result.add(f"{zero}/response_name", dynamics.prototype.response_name)
    _add_response(result, f"{zero}/response", dynamics.response)
    result.annotate(zero, note=_zero_note(dynamics))
    result.add(f"{pole}/equation", dynamics.pole_equation)
    _add_condition(result, pole, "", dynamics.pole)
    _add_condition(result, pole, "missed_", dynamics.missed_modes)
    _add_condition(result, pole, "foreign_", dynamics.foreign_modes)
    result.annotate(pole, note=_pole_note(dynamics))
    _add_response(result, f"{group}/driving_point", dynamics.driving_point)
    if dynamics.driving_point is not None:
        result.annotate(f"{group}/driving_point", equation=dynamics.prototype.equation(TEXT))
    shared = dynamics.prototype.shared()
    result.add(f"{group}/independent", not shared)
    result.add(f"{group}/shared_junctions", ", ".join(shared))
    if dynamics.natural != 0:
        modes = roots_of(dynamics.natural)
        add_roots(result, group, "natural_modes", modes)
        result.add(f"{group}/net_power", dynamics.net_power(modes), ("natural_mode",))
        add_roots(result, group, "hidden_modes", roots_of(dynamics.hidden_modes))


def _add_response(result: Result, group: str, response: TransferFunction | None) -> None:
    """Add a response at the port with its zeros and poles, where it exists."""
    if response is None:
        return
    add_ratio(result, group, response)
    add_roots(result, group, "zeros", () if response.vanishes else roots_of(response.numerator))
    add_roots(result, group, "poles", roots_of(response.denominator))


def add_ratio(result: Result, group: str, ratio: TransferFunction, formula: str | None = None) -> None:
    """Add a rational function: coefficients in descending powers, denominator monic, and exact as a text."""
    add_coefficients(result, group, ratio)
    printed: list[Printed] = []
    for polynomial in (ratio.numerator, ratio.denominator):
        text = polynomial_text(polynomial)
        is_atom = text.isalnum()
        printed.append((text, ATOM if is_atom else SUM if " " in text or text.startswith("-") else PRODUCT))
    exact = printed[0] if ratio.denominator == 1 else TEXT.quotient(*printed)
    result.add(f"{group}/exact", exact[0])
    if formula is not None:
        result.annotate(group, symbolic=formula)


def polynomial_text(polynomial: Any) -> str:
    """Write a polynomial in s as SymPy would read it, highest power first; what is irrational as decimals."""
    from dynid.arithmetic.field_polynomials import settled_coefficients

    text = ""
    for power, coefficient in sorted(enumerate(settled_coefficients(polynomial)), reverse=True):
        if coefficient == 0:
            continue
        variable = {0: "", 1: "s"}.get(power, f"s**{power}")
        exact = fraction(abs(coefficient))  # of a field its decimals are those of a double
        short = exact.denominator.bit_length() < _MAX_FRACTION_BITS
        size = str(exact) if short else repr(nearest_double(exact))
        size = "" if abs(coefficient) == 1 and variable else size
        sign = (" - " if coefficient < 0 else " + ") if text else "-" * (coefficient < 0)
        text += f"{sign}{'*'.join(factor_text for factor_text in (size, variable) if factor_text)}"
    return text or "0"


def _add_condition(result: Result, group: str, prefix: str, polynomial: Any) -> None:
    """Add the roots of a polynomial; one that is identically zero has none to list."""
    if polynomial != 0:
        from dynid.arithmetic.field_polynomials import primitive

        polynomial = primitive(polynomial)
    result.add(f"{group}/{prefix}polynomial", polynomial_text(polynomial))
    roots = roots_of(polynomial) if polynomial != 0 else ()
    add_roots(result, group, f"{prefix}roots", roots)


def _zero_note(dynamics: PrototypeDynamics) -> str:
    named = dynamics.prototype.response_name
    if dynamics.prototype.fixed:
        note = f"sufficient, not necessary: the zeros of {named} are all roots of A + B"
    elif dynamics.prototype.letter == "c":
        note = f"{named} vanishes at the zeros of Z_B and at the poles of Y_A alike"
    else:
        note = (
            f"exact: the zeros of {named} are those of Y_B*Z_A; f/e, which the paper does not name, vanishes "
            "at the zeros of Y_B and at the poles of Z_A"
        )
    return f"{note}; the requested channel has the zeros of its equivalent source besides"


def _pole_note(dynamics: PrototypeDynamics) -> str:
    shared = ", ".join(dynamics.prototype.shared())
    if shared:
        return (
            f"A and B are not independent: the driven junction lies on a loop, and both contain {shared}; "
            "the equation is the balance of the driven junction, which every natural mode that moves it "
            "fulfils, but not that of two systems: its polynomial counts the shared part twice "
            "(foreign_roots), and the natural modes are the roots of the determinant of the whole"
        )
    if dynamics.prototype.fixed:
        return (
            "the natural modes with the driving port removed; of the driving point they are the zeros, its "
            "poles are those of A and B"
        )
    return "modes that cancel in the product of A and B are missed: all are roots of D_A*D_B + N_A*N_B"
