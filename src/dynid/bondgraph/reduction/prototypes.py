"""The four prototypes of Park & Kim 1997, Fig. 2, and the choice of the systems A and B.

On a 1-junction A and B are impedances, on a 0-junction admittances. Where the source fixes the common
variable (a, b) both answer it independently: feedforward. Where it does not (c, d) B sets the common
variable and drives A, which acts back: feedback.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from dynid.bondgraph.formula_printers import TEXT, FormulaPrinter, Printed
from dynid.bondgraph.graph import STORAGES, Port
from dynid.bondgraph.program.program import Program, Register
from dynid.bondgraph.reduction.network import Immittance, NodalNetwork

#: The names of a prototype's systems.
SYSTEMS = ("Z_A", "Z_B", "Y_A", "Y_B")


@dataclass(frozen=True)
class Prototype:
    """The prototype at the port of interest."""

    program: Program
    kind: str  # the junction, '0' or '1'
    fixed: bool  # whether a source fixes its common variable
    #: part_a, part_b: Impedances of A and B on a 1-junction, admittances on a 0-junction.
    part_a: Register
    part_b: Register
    #: name_a, name_b: What they stand for.
    name_a: str
    name_b: str
    #: Writes the determinant of the whole with the driving port removed (the common variable free, its
    #: balance without a source), times s for every storage that integrates: its zeros are the natural modes.
    #: None: it is not known.
    released: Callable[[], Register] | None = field(default=None, compare=False)
    #: Finds the user's junctions that A and B share, where the driven junction lies on a loop; none: A and B
    #: are independent.
    shared: Callable[[], tuple[str, ...]] = field(default=tuple, compare=False)
    suffix: str = ""  # what stands behind the names of the systems, where others have these names

    @property
    def letter(self) -> str:
        """The letter of Fig. 2."""
        return {("1", True): "a", ("0", True): "b", ("0", False): "c", ("1", False): "d"}[
            self.kind, self.fixed
        ]

    def relation(self, hand: FormulaPrinter) -> Printed:
        """Write the right-hand side of the driving-point relation (eqs 1 to 4)."""
        names = {"a": ("Z_A", "Z_B"), "b": ("Y_A", "Y_B"), "c": ("Y_A", "Z_B"), "d": ("Z_A", "Y_B")}
        a, b = (hand.name(f"{name}{self.suffix}") for name in names[self.letter])
        if self.fixed:
            return hand.total(a, b)
        return hand.quotient(b, hand.total(hand.integer(1), hand.product(b, a)))

    def equation(self, hand: FormulaPrinter = TEXT) -> str:
        """Write the driving-point relation (eqs 1 to 4)."""
        return f"{'Z' if self.letter in 'ac' else 'Y'} = {self.relation(hand)[0]}"

    @property
    def systems(self) -> tuple[tuple[str, Register], tuple[str, Register]]:
        """Names and registers of A and B: B by its inverse where it sets the common variable (c, d)."""
        a, b = ("Z_A", "Z_B") if self.kind == "1" else ("Y_A", "Y_B")
        register_b = self.part_b
        if not self.fixed and not self.program.is_zero(self.part_b):
            b = "Y_B" if self.kind == "1" else "Z_B"
            register_b = self.program.inv(self.part_b)
        return (f"{a}{self.suffix}", self.part_a), (f"{b}{self.suffix}", register_b)

    @property
    def response_name(self) -> str:
        """The response whose zeros eqs 5 to 8 give, over the source."""
        return {"a": "e/f", "b": "f/e", "c": "e_B/f", "d": "e_A/e"}[self.letter]

    @property
    def response(self) -> Register:
        """The register of that response: the driving point of a, b and c, the effort of A in d."""
        total = self.program.add(self.part_a, self.part_b)
        if self.fixed:
            return total
        return self.program.div(self.part_a if self.letter == "d" else self.program.one, total)

    @property
    def type(self) -> str:
        """The type: dependent on the source, or independent, setting the common variable itself."""
        common, answer = ("flow", "effort") if self.kind == "1" else ("effort", "flow")
        if self.fixed:
            return f"dependent: the source sets the common {common}, A and B answer with their {answer}s"
        if self.program.is_zero(self.part_a):
            return f"independent: B ({self.name_b}) sets the common {common}"
        return (
            f"independent: B ({self.name_b}) sets the common {common}, A ({self.name_a}) answers with its "
            f"{answer}"
        )

    def describe(self, root: str) -> str:
        """Return a sentence that describes the prototype."""
        source = {"a": "flow", "b": "effort", "c": "flow", "d": "effort"}[self.letter]
        number = {"a": 1, "b": 2, "c": 3, "d": 4}[self.letter]
        if self.program.is_zero(self.part_a):
            how = f"B ({self.name_b}) is alone on it, there is no A"
        elif self.fixed:
            how = f"the {source} source drives A ({self.name_a}) and B ({self.name_b}) alike (feedforward)"
        else:
            sets = "flow" if self.kind == "1" else "effort"
            how = f"B ({self.name_b}) sets the {sets} and A ({self.name_a}) acts back on it (feedback)"
        return f"prototype {self.letter}: {source} source on {self.kind}-junction {root}; {how}, eq {number}"


@dataclass(frozen=True)
class DrivenRelation:
    """The response of a prototype to its source, ready to be printed."""

    prototype: Prototype
    source: str

    def __call__(self, hand: FormulaPrinter) -> Printed:
        """Write the driving-point relation times the source."""
        return hand.scaled(self.prototype.relation(hand), self.source)


def split_root(network: NodalNetwork, port: Port, fixed: bool) -> tuple[Immittance, list[Immittance]]:
    """Split the immittances on the root into the systems B and A.

    Where a source fixes the common variable (a, b) B is the output's element. Else (c, d) B sets the common
    variable: the storage that integrates it there (I on a 1, C on a 0; the output's own first), else the
    output's element, else any element, else the last subtree; what is zero with these values sets nothing.
    """
    graph, terms, elements = network.graph, network.root.terms, network.elements
    integrating = "I" if network.root.kind == "1" else "C"

    def rank(term: Immittance) -> int:
        if network.program.is_zero(term.register):
            return 6
        if term.name not in elements:
            return 5
        is_output, kind = term.name == port.node, graph.nodes[term.name].type
        if kind == integrating and not fixed:
            return 0 if is_output else 1
        return 2 if is_output else 4 if kind in STORAGES else 3

    if not terms:
        return Immittance("nothing", network.program.zero), []
    chosen = min(terms, key=rank)
    rest = [term for term in terms if term is not chosen]
    return chosen, sorted(rest, key=lambda term: -rank(term))  # what was reduced first, then elements
