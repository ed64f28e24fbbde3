"""The bond graph of a scene: fields and structures expanded, laws linearised, loops closed."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, cast

from dynid.arithmetic.dependent import Real
from dynid.bondgraph.fields import Expansion, FieldType, expand_coupling, expand_field
from dynid.bondgraph.graph import TWO_PORTS, BondGraph, Node, NodeType, Port
from dynid.errors import DynidError
from dynid.model_scope import ScopePart
from dynid.scene.schema.raw import STRUCTURE

if TYPE_CHECKING:
    from dynid.bondgraph.control import Loop
    from dynid.bondgraph.operating_point.laws import Law
    from dynid.bondgraph.operating_point.linearisation import Linearisation
    from dynid.bondgraph.request import Reading
    from dynid.scene.load import Scene
    from dynid.scene.schema.bond_graph import GraphModel, NodeModel
    from dynid.scene.schema.control import ControlModel
    from dynid.scene.schema.laws import OperatingPointModel
    from dynid.scene.schema.quantities import Quantity


class BuiltGraph(NamedTuple):
    """The bond graph of a scene, with its fields and structures expanded.

    Parameters
    ----------
    graph
        The graph.
    outputs
        The requested variables: at a port of a field or structure under the name that the scene gives it.
    approximations
        Structures that enter by a reduced model: what was kept and left out of them, and how.
    opened, loops
        Of a graph with feedback: the graph without it, and the loops.
    linearisation
        Of a graph with laws: its linearisation at the operating point, which `graph` is.
    law_outputs
        The requested variables, as the graph with laws has them.
    """

    graph: BondGraph
    outputs: tuple[Port, ...]
    approximations: tuple[ScopePart, ...]
    opened: BondGraph | None = None
    loops: tuple[Loop, ...] = ()
    linearisation: Linearisation | None = None
    law_outputs: tuple[Port, ...] = ()


def build_graph(
    scene: Scene,
    graph: GraphModel,
    outputs: Iterable[Port],
    reading: Reading,
    band: float | None = None,
    control: ControlModel | None = None,
    point: OperatingPointModel | None = None,
) -> BuiltGraph:
    """Build the graph of a scene, with exact values, its fields and structures expanded.

    Laws are linearised at the operating point; then loops are closed.

    Parameters
    ----------
    scene
        The scene.
    graph
        Its graph.
    outputs
        The requested variables.
    reading
        What a float means, in the matrices of fields and structures.
    band
        The highest frequency of interest, rad/s, where one is known: for reductions that keep the modes of a
        band.
    control
        Feedback.
    point
        The operating point.

    Raises
    ------
    UsageError
        If a matrix is not that of a passive field or structure.
    NumericalError
        If there is no equilibrium, or a law has no slope there.
    """
    wanted: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    outputs = list(outputs)
    measured = [loop.measured for loop in control.loops] if control else []
    nonlinear = point is not None or any(has_law(node) for node in graph.nodes.values())
    laws: dict[str, Law] = {}
    if nonlinear:
        from dynid.scene.kinds.laws import law_variables, laws_of

        laws = laws_of(scene, graph)
        measured += law_variables(scene, graph, point)
    for output in dict.fromkeys([*outputs, *measured]):
        holder, _, port = output.node.rpartition(".")
        wanted[holder][port].append(output.quantity)
    taken = set(graph.nodes)
    nodes: list[Node] = []
    bonds = [bond for chain in graph.bonds for bond in chain]
    variables: dict[str, Port] = {}
    approximations: list[ScopePart] = []
    for name, node in graph.nodes.items():
        if node.type == STRUCTURE:
            made = Expansion(name, taken)
            left_out = _expand_structure(scene, made, node, wanted[name], reading, band)
            approximations += [left_out] if left_out is not None else []
        elif node.matrix is not None:
            made = _expand_field(name, node, taken, wanted[name], reading)
        else:
            value = node.value
            exact, formula = (None, None) if value is None else (value.exact, value.expression)
            if name in laws:
                exact, formula = Fraction(1), None  # in place of the slope
            dependent = None if value is None else value.dependent
            kind = cast("NodeType", node.type)
            nodes.append(Node(name, kind, exact, formula, node.domain or "", dependent))
            continue
        nodes += made.nodes
        bonds += made.bonds
        variables |= made.variables
    asked = tuple(variables.get(str(output), output) for output in outputs)
    built = BuiltGraph(BondGraph(nodes, bonds), asked, tuple(approximations))
    if nonlinear:
        from dynid.scene.kinds.laws import linear_graph

        linear = linear_graph(built.graph, laws, point, variables)
        asked = tuple(linear.variables.get(output, output) for output in asked)
        variables |= {str(port): other for port, other in linear.variables.items()}
        built = built._replace(
            graph=linear.graph, outputs=asked, linearisation=linear, law_outputs=built.outputs
        )
    if control is None:
        return built
    from dynid.bondgraph.control import close_loops
    from dynid.scene.kinds.control import loop_of

    loops = [
        loop_of(loop, variables.get(str(loop.measured), loop.measured), place)
        for place, loop in enumerate(control.loops)
    ]
    closed = close_loops(built.graph, loops)
    asked = tuple(closed.variables.get(output, output) for output in asked)
    return built._replace(graph=closed.graph, outputs=asked, opened=built.graph, loops=tuple(loops))


def has_law(node: NodeModel) -> bool:
    """Return True if a node has a law, or a modulus that depends on variables."""
    return node.law is not None or (node.value is not None and node.value.variable)


def _expand_field(
    name: str, node: NodeModel, taken: set[str], wanted: Mapping[str, Iterable[str]], reading: Reading
) -> Expansion:
    assert node.matrix is not None

    def number(entry: Quantity) -> Real:
        known = Fraction(float(entry)) if reading == "binary" else entry.exact
        return known if entry.dependent is None else entry.dependent

    matrix = [[number(entry) for entry in row] for row in node.matrix]
    ports = cast("list[str]", node.ports)
    if node.type in TWO_PORTS:
        return expand_coupling(name, cast("Literal['TF', 'GY']", node.type), ports, matrix, taken, wanted)
    return expand_field(name, cast("FieldType", node.type), ports, matrix, taken, wanted, node.domain or "")


def _expand_structure(
    scene: Scene,
    made: Expansion,
    node: NodeModel,
    wanted: Mapping[str, Iterable[str]],
    reading: Reading,
    band: float | None,
) -> ScopePart | None:
    """Expand a structure; return what was left out of it, None of a full one."""
    from dynid.bondgraph.structures import expand_modes, expand_structure
    from dynid.scene.kinds.reduction import build_reductor
    from dynid.scene.kinds.structures import build_structure
    from dynid.structure.reduction.mode_selection import Interest

    ports = cast("dict[str, Any]", node.ports)
    place = f"graph.nodes.{made.name}"
    assert node.structure is not None
    try:
        model = build_structure(scene, node.structure, node.joints, type(node), ("graph", "nodes", made.name))
        if node.reduction is None:
            expand_structure(made, model, ports, wanted, reading, node.domain or "")
            return None
        dofs = tuple(dict.fromkeys(model.label(dof) for dof in ports.values()))
        reductor = build_reductor(node.reduction, Interest(dofs, band), "reduction")
        reduced = reductor.reduce(model)
        expand_modes(made, reduced, ports, wanted, node.domain or "")
    except DynidError as error:
        first = [
            name for name in error.names if name.partition(".")[0] in ("structure", "reduction", "joints")
        ]
        error.names = (*(f"{place}.{name}" for name in first), made.name, *error.names)
        raise
    kept = reduced.model.size
    how = f"{node.reduction.method} reduction of {model.size} DOFs"
    text = f"'{made.name}' is a float model of {kept} modes: {how}"
    text = "; ".join(part for part in (text, reduced.rule, reduced.doubt) if part)
    return ScopePart(f"coordinates of {made.name}", kept, model.size - kept, text)
