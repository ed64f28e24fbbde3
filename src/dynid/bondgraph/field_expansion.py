"""Multiport fields, transformers and gyrators as ordinary nodes and bonds: the same equations, exactly.

A symmetric matrix is a sum of squares, ``A = L D L^T``. On ports with flows f a field with e = A f,
e = A df/dt or e = A ∫f dt is one element of value D_k (I, R; C of 1/D_k) for every square: on a 0-junction
that takes the flow ``sum_i L_ik f_i`` through transformers. A field of compliances, f = A de/dt, is the dual:
its elements are on 1-junctions. A transformer of a matrix of moduli is one of every entry, between a junction
for its row and one for its column. Source: Karnopp, Margolis & Rosenberg, *System Dynamics*, chapter 7.

Laws hold for inward power, of fields as of one-ports: with S = -1 for ports whose bonds leave the field, and
variables along the arrows, e = Z S f and S f = Y e.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import pairwise
from typing import Literal, cast

from dynid.arithmetic.dependent import Dependent, Real
from dynid.arithmetic.ldl import (
    Indefinite,
    Rows,
    Square,
    at_reference,
    dependent_squares,
    nonzero,
    reference,
    squares,
)
from dynid.bondgraph.graph import FIELDS, Bond, BondGraph, Node, NodeType, Port, Quantity
from dynid.bondgraph.reduction.junctions import unique
from dynid.errors import UsageError

FieldType = Literal["I", "C", "R"]


@dataclass
class Expansion:
    """The ordinary nodes and bonds of a field or structure."""

    name: str
    taken: set[str]  # names of other nodes, to which those of the new nodes are added
    nodes: list[Node] = field(default_factory=list)
    bonds: list[Bond] = field(default_factory=list)
    #: Ports of the graph that have another name: ``field.a.e`` where ``field.a`` is a 1-junction.
    variables: dict[str, Port] = field(default_factory=dict)

    def add(self, kind: NodeType, preferred: str, value: Real | None = None, domain: str = "") -> str:
        """Add a node, and return its name: the wanted one where that is free."""
        name = unique(preferred, self.taken)
        self.taken.add(name)
        exact = None if value is None else reference(value)
        dependent = value if isinstance(value, Dependent) else None
        self.nodes.append(Node(name, kind, exact, None, domain, dependent, self.name))
        return name

    def connect(
        self,
        tail: str,
        head: str,
        modulus: Real | None = None,
        name: str = "",
        kind: Literal["TF", "GY"] = "TF",
    ) -> None:
        """Add a bond; with a modulus a transformer (e1 = n e2) or gyrator (e1 = r f2) with its two bonds."""
        if modulus is None:
            self.bonds.append(Bond(tail, head))
            return
        between = self.add(kind, name, modulus)
        self.bonds += [Bond(tail, between), Bond(between, head)]

    def add_port(
        self,
        port: str,
        kind: Literal["0", "1"],
        quantities: Iterable[str],
        domain: str = "",
        outward: bool = False,
    ) -> str:
        """Add a port, and return the junction behind it to which the interior is connected.

        `kind`: 0 or 1: the junction that bonds of the user are at. `quantities`: the quantities e, f, q, p
        that are outputs. Those that the junction does not have in common are those of one of the other kind
        behind it. `outward`: True where power is positive out of the port.
        """
        outer = self.add(kind, f"{self.name}.{port}", None, domain)
        others = [quantity for quantity in quantities if quantity in ("ep" if kind == "1" else "fq")]
        if not others:
            return outer
        sensor = self.add("0" if kind == "1" else "1", f"{outer}_{others[0]}", None, domain)
        inner = self.add(kind, f"{outer}_inside", None, domain)
        way = [inner, sensor, outer] if outward else [outer, sensor, inner]
        self.bonds += [Bond(tail, head) for tail, head in pairwise(way)]
        for quantity in others:
            name = f"{self.name}.{port}.{quantity}"
            self.variables[name] = Port(sensor, cast("Quantity", quantity), name)
        return inner

    def add_squares(
        self,
        kind: FieldType,
        terms: Sequence[Square],
        junctions: Mapping[int, str],
        labels: Mapping[int, str],
        letter: str = "",
    ) -> None:
        """Add the elements of a matrix to junctions.

        Parameters
        ----------
        kind
            Type of the elements.
        terms
            The matrix as squares.
        junctions
            By row the junction: 1-junctions, or of a field of compliances 0-junctions.
        labels
            By row what the generated names call it.
        letter
            Part of the generated names: the matrix. With it a C stores the energy of a stiffness, and has
            the value 1/D_k on 1-junctions.
        """
        dual = kind == "C" and not letter
        prefix = f"{self.name}_{letter}_" if letter else f"{self.name}_"
        for pivot, value, entries in terms:
            size = Fraction(1) / value if letter and kind == "C" else value
            element = self.add(kind, f"{prefix}{identifier(labels[pivot])}", size)
            junction = junctions[pivot]
            if entries:
                at = f"{self.name}.{letter}_{labels[pivot]}" if letter else f"{self.name}.sum_{labels[pivot]}"
                junction = self.add("1" if dual else "0", at)
                self.connect(junctions[pivot], junction)
            self.connect(junction, element)
            for i, entry in entries.items():
                modulus = Fraction(1) / entry if dual else entry
                self.connect(junctions[i], junction, modulus, f"{element}_{identifier(labels[i])}")


def identifier(label: str) -> str:
    """Return a label as part of a name that formulas can be written in."""
    return "".join(letter if letter.isalnum() else "_" for letter in label)


def expand_field(
    name: str,
    kind: FieldType,
    ports: Sequence[str],
    matrix: Sequence[Sequence[Real]],
    names_in_use: set[str],
    quantities: Mapping[str, Iterable[str]],
    domain: str = "",
    outward: Container[str] = (),
) -> Expansion:
    """Return a field as ordinary nodes.

    Parameters
    ----------
    kind
        I: e = M df/dt; R: e = M f; C: f = M de/dt.
    matrix
        M (ports x ports), symmetric; of unknown parameters positive semidefinite.
    quantities
        By port the quantities that are outputs.
    outward
        Names of the ports whose bonds leave it.

    Raises
    ------
    UsageError
        If the matrix is not symmetric, or, with unknown parameters, indefinite; or an entry needed is
        zero at the start.
    """
    expansion = Expansion(name, names_in_use)
    problem = field_fault(matrix)
    if problem:
        raise UsageError(f"{kind} '{name}': {problem}", names=(name,))
    junctions = {
        row: expansion.add_port(
            port, "0" if kind == "C" else "1", quantities.get(port, ()), domain, port in outward
        )
        for row, port in enumerate(ports)
    }
    rows = nonzero(matrix)
    if kind != "C":  # 1-junctions have the flow f along the arrow, and the effort S e inside: S e = (S Z S) f
        signs = [-1 if port in outward else 1 for port in ports]
        rows = {i: {j: entry * (signs[i] * signs[j]) for j, entry in row.items()} for i, row in rows.items()}
    expansion.add_squares(kind, symmetric_squares(name, rows, signed=True), junctions, dict(enumerate(ports)))
    return expansion


def expand_coupling(
    name: str,
    kind: Literal["TF", "GY"],
    ports: Sequence[str],
    matrix: Sequence[Sequence[Real]],
    names_in_use: set[str],
    quantities: Mapping[str, Iterable[str]],
) -> Expansion:
    """Return a multiport transformer or gyrator as ordinary nodes.

    Parameters
    ----------
    kind
        TF: e1 = N e2, f2 = N^T f1; GY: e1 = N f2, e2 = N^T f1. Power enters at 1 and leaves at 2.
    ports
        Names of its ports: first those of the rows (1), then those of the columns (2).
    matrix
        N (rows x columns).
    quantities
        By port the quantities that are outputs.

    Raises
    ------
    UsageError
        If an entry is zero at the start values of the parameters that it depends on.
    """
    expansion, second = Expansion(name, names_in_use), ports[len(matrix) :]
    rows = [expansion.add_port(port, "1", quantities.get(port, ())) for port in ports[: len(matrix)]]
    column_kind: Literal["0", "1"] = "0" if kind == "TF" else "1"
    columns = [expansion.add_port(out, column_kind, quantities.get(out, ()), outward=True) for out in second]
    for row, into, entries in zip(rows, ports, matrix, strict=False):
        for column, out, entry in zip(columns, second, entries, strict=True):
            if reference(entry):
                expansion.connect(row, column, entry, f"{name}_{identifier(into)}_{identifier(out)}", kind)
            elif isinstance(entry, Dependent):
                raise _zero_at_start(name, "modulus")
    return expansion


def symmetric_squares(name: str, rows: Rows, rounding: float = 0.0, *, signed: bool = False) -> list[Square]:
    """Return a matrix of numbers that may depend on parameters as squares.

    Raises `UsageError` if a square vanishes at the reference values of the parameters, but not at others.
    Raises `Indefinite` if it is indefinite.
    """
    unknown = any(isinstance(entry, Dependent) for row in rows.values() for entry in row.values())
    exact = squares(at_reference(rows), rounding, signed=signed and not unknown)
    if not unknown:
        return exact
    try:
        return dependent_squares(rows, exact)
    except ZeroDivisionError:
        raise _zero_at_start(name, "coupling") from None


def _zero_at_start(name: str, what: str) -> UsageError:
    return UsageError(
        f"a {what} of '{name}' is zero at the start values of its unknown parameters, but not beside",
        remedy="Start at values at which the entries that depend on them differ from zero.",
        names=(name,),
    )


def field_fault(matrix: Sequence[Sequence[Real]]) -> str:
    """Return what is wrong with the matrix of a field, or an empty text."""
    for i, row in enumerate(matrix):
        for j in range(i):
            entry, mirrored = reference(row[j]), reference(matrix[j][i])
            if entry != mirrored:
                return (
                    f"the matrix is not symmetric: entry ({i + 1}, {j + 1}) is {float(entry):g}, "
                    f"({j + 1}, {i + 1}) is {float(mirrored):g}; a gyrator couples ports antisymmetrically"
                )
    if not any(isinstance(entry, Dependent) for row in matrix for entry in row):
        return ""
    try:
        squares(at_reference(nonzero(matrix)))
    except Indefinite:
        import numpy as np  # for a message only

        lowest = float(np.linalg.eigvalsh([[float(entry) for entry in row] for row in matrix])[0])
        return (
            f"the matrix is not positive semidefinite, its lowest eigenvalue is {lowest:.3g}; with unknown "
            "parameters a field is passive"
        )
    return ""


def field_warnings(graph: BondGraph) -> list[str]:
    """Return a sentence for every field that is not passive."""
    active = {
        node.part: None
        for node in graph.nodes.values()
        if node.part and node.type in FIELDS and node.value is not None and node.value < 0
    }
    return [
        f"the field '{name}' is not passive: its matrix has a negative eigenvalue, so it can give energy "
        "without end"
        for name in active
    ]
