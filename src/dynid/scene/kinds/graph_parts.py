"""Graphs of scenes with exact values, their fields and structures expanded, and their loops closed."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, cast

from dynid.arithmetic.dependent import Dependent, Real, substituted
from dynid.arithmetic.expression import Expression, parse
from dynid.arithmetic.ldl import reference
from dynid.arithmetic.numbers import Number
from dynid.bondgraph.field_expansion import Expansion, FieldType, expand_coupling, expand_field
from dynid.bondgraph.graph import LINE, TWO_PORTS, Bond, BondGraph, Node, NodeType, Port, no_collection
from dynid.errors import DynidError
from dynid.model_scope import ScopePart
from dynid.scene.schema.laws import variables_of
from dynid.scene.schema.quantities import Quantity
from dynid.scene.schema.raw import STRUCTURE, law_variable

if TYPE_CHECKING:
    from dynid.bondgraph.analysis_request import Reading
    from dynid.bondgraph.controller_circuits import Loop
    from dynid.bondgraph.operating_point.element_laws import Law
    from dynid.bondgraph.operating_point.linearisation import Linearisation
    from dynid.bondgraph.state_feedback import FeedbackRequest, StateFeedback
    from dynid.scene.load import Scene
    from dynid.scene.schema.bond_graph import GraphModel, NodeModel
    from dynid.scene.schema.control import ControlModel, LoopModel, PidModel
    from dynid.scene.schema.laws import OperatingPointModel


class BuiltGraph(NamedTuple):
    """The bond graph of a scene, with its fields and structures expanded."""

    graph: BondGraph  #: The graph.
    #: The requested variables: at a port of a field or structure under the name that the scene gives it.
    outputs: tuple[Port, ...]
    #: Structures that enter by a reduced model: what was kept and left out of them, and how.
    approximations: tuple[ScopePart, ...]
    #: Of a graph with feedback: the graph without it, and the loops.
    opened: BondGraph | None = None
    loops: tuple[Loop, ...] = ()
    #: Of a graph with laws: its linearisation at the operating point, which `graph` is.
    linearisation: Linearisation | None = None
    law_outputs: tuple[Port, ...] = ()  #: The requested variables, as the graph with laws has them.
    law_loops: tuple[Loop, ...] = ()  #: The loops, as the graph with laws has what they measure.
    feedback: StateFeedback | None = None  #: The designed feedback of states.


@no_collection()
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
        If there is no equilibrium, a law has no slope there, or there are no gains of the states.
    """
    requested: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    outputs = list(outputs)
    measured = control.measured if control else []
    nonlinear = point is not None or any(has_law(node) for node in graph.nodes.values())
    laws: dict[str, Law] = {}
    if nonlinear:
        laws = _laws_of(scene, graph)
        measured += [port for law in laws.values() for port in law.ports]
        given = () if point is None else (point.values, point.start, point.search.ranges)
        measured += [_port(name) for values in given for name in values]
    for output in dict.fromkeys([*outputs, *measured]):
        holder, _, port = output.node.rpartition(".")
        requested[holder][port].append(output.quantity)
    names = set(graph.nodes)
    nodes: list[Node] = []
    bonds = [bond for chain in graph.bonds for bond in chain]
    outward = _outward_ports(bonds)
    variables: dict[str, Port] = {}
    approximations: list[ScopePart] = []
    lines = _Lines()
    for name, node in graph.nodes.items():
        if node.type == STRUCTURE:
            expansion = Expansion(name, names)
            at_ports, leaving = requested[name], outward[name]
            left_out = _expand_structure(scene, expansion, node, at_ports, reading, leaving, band)
            approximations += [left_out] if left_out is not None else []
        elif node.type == LINE:
            lines.expand(name, node, [*names, *(node.name for node in nodes)])
            continue
        elif node.matrix is not None:
            expansion = _expand_field(name, node, names, requested[name], reading, outward[name])
        else:
            value = node.value
            exact, formula = (None, None) if value is None else (value.exact, value.expression)
            if name in laws:
                exact, formula = Fraction(1), None  # in place of the slope
            dependent = None if value is None else value.dependent
            kind = cast("NodeType", node.type)
            nodes.append(Node(name, kind, exact, formula, node.domain or "", dependent))
            continue
        nodes += expansion.nodes
        bonds += expansion.bonds
        variables |= expansion.variables
    flat_variables = dict(variables)
    asked = tuple(variables.get(str(output), output) for output in outputs)
    built = BuiltGraph(lines.attached(nodes, bonds), asked, tuple(approximations))
    if nonlinear:
        linear = _linear_graph(built.graph, laws, point, variables)
        asked = tuple(linear.variables.get(output, output) for output in asked)
        variables |= {str(port): variable for port, variable in linear.variables.items()}
        flat = built.outputs
        built = built._replace(graph=linear.graph, outputs=asked, linearisation=linear, law_outputs=flat)
    if control is None:
        return _closed(built, lines.loops) if lines.loops else built
    built = built._replace(law_loops=tuple(_loops(control, flat_variables)))
    loops = [*_loops(control, variables), *lines.loops]
    if control.states is not None:
        from dynid.bondgraph.state_feedback import design_feedback, feedback_loops

        feedback = design_feedback(built.graph, _feedback_request(control, variables))
        opened, loops = feedback_loops(built.graph, feedback)
        built = built._replace(graph=opened, feedback=feedback)
    return _closed(built, loops)


def _closed(built: BuiltGraph, loops: Sequence[Loop]) -> BuiltGraph:
    """Return a graph with its loops closed."""
    from dynid.bondgraph.controller_circuits import close_loops

    closed = close_loops(built.graph, loops)
    outputs = tuple(closed.variables.get(output, output) for output in built.outputs)
    return built._replace(
        graph=closed.graph,
        outputs=outputs,
        opened=built.graph,
        loops=tuple(loops),
        law_outputs=built.law_outputs or built.outputs,
    )


class _Lines:
    """The lines of a graph, as what they stand for."""

    def __init__(self) -> None:
        self.loops: list[Loop] = []
        self._nodes: list[Node] = []
        self._bonds: list[Bond] = []
        self._ends: dict[str, tuple[str, str]] = {}

    def expand(self, name: str, node: NodeModel, names: Iterable[str]) -> None:
        from dynid.bondgraph.transmission_line import expand_line

        used = [*names, *(node.name for node in self._nodes)]
        line = expand_line(name, _number(node.impedance), _number(node.delay), node.domain or "", used)
        self._nodes += line.nodes
        self._bonds += line.bonds
        self.loops += line.loops
        self._ends[name] = line.ends

    def attached(self, nodes: list[Node], bonds: list[Bond]) -> BondGraph:
        """Return the graph of other nodes and bonds, with the lines where these attach to them."""
        ends = self._ends
        if not ends:
            return BondGraph(nodes, bonds)
        joined = [
            Bond(ends.get(bond.tail, ("", bond.tail))[1], ends.get(bond.head, (bond.head, ""))[0])
            for bond in bonds
        ]
        return BondGraph([*nodes, *self._nodes], [*joined, *self._bonds])


def _loops(control: ControlModel, variables: Mapping[str, Port]) -> Iterator[Loop]:
    for index, loop in enumerate(control.loops):
        yield _loop(loop, variables.get(str(loop.measured), loop.measured), index)


def _outward_ports(bonds: Iterable[Bond]) -> dict[str, set[str]]:
    """Return, by node, its ports that have a single bond, which leaves."""
    counts, ports = Counter(end for bond in bonds for end in bond), defaultdict(set)
    for bond in bonds:
        if counts[bond.tail] == 1:
            holder, _, port = bond.tail.rpartition(".")
            ports[holder].add(port)
    return ports


def has_law(node: NodeModel) -> bool:
    """Return True if a node has a law, or a modulus that depends on variables."""
    return node.law is not None or (node.value is not None and node.value.variable)


def _expand_field(
    name: str,
    node: NodeModel,
    names: set[str],
    requested: Mapping[str, Iterable[str]],
    reading: Reading,
    outward: Container[str],
) -> Expansion:
    assert node.matrix is not None

    def number(entry: Quantity) -> Real:
        value = Fraction(float(entry)) if reading == "binary" else entry.exact
        return value if entry.dependent is None else entry.dependent

    matrix = [[number(entry) for entry in row] for row in node.matrix]
    ports = cast("list[str]", node.ports)
    if node.type in TWO_PORTS:
        return expand_coupling(name, cast("Literal['TF', 'GY']", node.type), ports, matrix, names, requested)
    kind, domain = cast("FieldType", node.type), node.domain or ""
    return expand_field(name, kind, ports, matrix, names, requested, domain, outward)


def _expand_structure(
    scene: Scene,
    expansion: Expansion,
    node: NodeModel,
    requested: Mapping[str, Iterable[str]],
    reading: Reading,
    outward: Container[str],
    band: float | None,
) -> ScopePart | None:
    """Expand a structure; return what was left out of it, None of a full one."""
    from dynid.bondgraph.structure_expansion import expand_modes, expand_structure
    from dynid.scene.kinds.reduction import build_reductor
    from dynid.scene.kinds.structures import build_structure
    from dynid.structure.reduction.mode_selection import Interest

    ports = cast("dict[str, Any]", node.ports)
    path = f"graph.nodes.{expansion.name}"
    assert node.structure is not None
    try:
        model = build_structure(scene, node.structure, node.joints, node, ("graph", "nodes", expansion.name))
        if node.reduction is None:
            expand_structure(expansion, model, ports, requested, reading, node.domain or "", outward)
            return None
        dofs = tuple(dict.fromkeys(model.label(dof) for dof in ports.values()))
        reductor = build_reductor(node.reduction, Interest(dofs, band), "reduction")
        reduced = reductor.reduce(model)
        expand_modes(expansion, reduced, ports, requested, node.domain or "", outward)
    except DynidError as error:
        inside = ("structure", "reduction", "joints")
        within = [f"{path}.{name}" for name in error.names if name.partition(".")[0] in inside]
        error.names = (*within, expansion.name, *error.names)
        raise
    kept = reduced.model.size
    how = f"{node.reduction.method} reduction of {model.size} DOFs"
    text = f"'{expansion.name}' is a float model of {kept} modes: {how}"
    text = "; ".join(note for note in (text, reduced.rule, reduced.doubt) if note)
    return ScopePart(f"coordinates of {expansion.name}", kept, model.size - kept, text)


def _loop(loop: LoopModel, measured: Port, index: int) -> Loop:
    from dynid.bondgraph.controller_circuits import Limits, Loop, Sampling

    controller, path = loop.controller, f"control.loops.{index}"
    quotient: tuple[list[Real], list[Real]]
    if controller.pid is not None:
        quotient = _pid(controller.pid)
    elif controller.numerator is not None and controller.denominator is not None:
        quotient = [*map(_number, controller.numerator)], [*map(_number, controller.denominator)]
    else:
        quotient = [_number(controller.gain)], [Fraction(1)]
    delay, sampling = _number(controller.delay), None
    if controller.sample is not None:
        times = _number(controller.sample), _number(controller.computation)
        sampling = Sampling(*times, controller.method or "tustin")
    limits = None
    if controller.limits is not None:
        low, high = controller.limits.min, controller.limits.max
        limits = Limits(low.exact, high.exact, controller.tracking_time or Fraction(0))
    return Loop(
        *(measured, loop.source, *quotient, loop.reference, delay, path, loop.setpoint, sampling),
        limits=limits,
    )


def _feedback_request(control: ControlModel, variables: Mapping[str, Port]) -> FeedbackRequest:
    """Return the states that are fed back, with their weights or the poles to be placed."""
    from dynid.bondgraph.state_feedback import FeedbackRequest

    def at(name: str) -> Port:
        return variables.get(name, _port(name))

    model = control.states
    assert model is not None
    states = tuple(at(str(port)) for port in model.states)
    sources, setpoints = tuple(model.sources), {at(name): w for name, w in model.setpoints.items()}
    if control.lqr is not None:
        weights = control.lqr.weights
        by_variable = {at(name): weight.exact for name, weight in weights.items() if name not in sources}
        by_source = [weights[name].exact for name in sources]
        return FeedbackRequest(
            states, sources, by_variable, by_source, (), model.references, setpoints, "control.lqr"
        )
    assert control.placement is not None
    poles = tuple(root for pole in control.placement.poles for root in pole.roots)
    return FeedbackRequest(states, sources, {}, (), poles, model.references, setpoints, "control.placement")


def _pid(pid: PidModel) -> tuple[list[Real], list[Real]]:
    """Return kp + ki/s + kd s/(tf s + 1) as one quotient; without an integral there is no pole at 0."""
    kp, ki, kd, tf = (_number(gain) for gain in (pid.kp, pid.ki, pid.kd, pid.tf))
    if not reference(ki) and not isinstance(ki, Dependent):
        return [kp * tf + kd, kp], [tf, Fraction(1)]
    return [kp * tf + kd, kp + ki * tf, ki], [tf, Fraction(1), Fraction(0)]


def _number(quantity: Quantity | None) -> Real:
    if quantity is None:
        return Fraction(0)
    return quantity.exact if quantity.dependent is None else quantity.dependent


def with_gains(control: ControlModel, parameters: Mapping[str, Number]) -> ControlModel:
    """Return feedback whose numbers depend on the scene's parameters, or on themselves by their paths."""
    dependents = {name: Dependent.parameter(name, value) for name, value in parameters.items()}
    loops = []
    for index, loop in enumerate(control.loops):
        path = f"control.loops.{index}.controller"
        controller = _dependent(loop.controller, path, dependents)
        loops.append(loop.model_copy(update={"controller": controller}))
    return control.model_copy(update={"loops": loops})


def _dependent(section: Any, path: str, dependents: Mapping[str, Dependent]) -> Any:
    """Return a part of a controller with numbers that depend on parameters."""
    from pydantic import BaseModel

    if isinstance(section, Quantity):
        if section.expression is not None and section.expression.names:
            return replace(section, dependent=substituted(section.expression, dependents))
        return (
            replace(section, dependent=Dependent.parameter(path, section.exact)) if section.value else section
        )
    if isinstance(section, list):
        return [_dependent(entry, f"{path}.{k}", dependents) for k, entry in enumerate(section)]
    if isinstance(section, BaseModel):
        values = {name: _dependent(value, f"{path}.{name}", dependents) for name, value in section}
        return section.model_copy(update=values)
    return section


def _laws_of(scene: Scene, graph: GraphModel) -> dict[str, Law]:
    from dynid.bondgraph.operating_point.element_laws import Law

    laws: dict[str, Law] = {}
    names = scene.names
    for name, node in graph.nodes.items():
        gives: Literal["e", "f", "value"]
        if node.law is not None:
            gives = "f" if node.law.e is None else "e"
            expression = parse(getattr(node.law, gives))
        elif node.value is not None and node.value.variable:
            gives, expression = "value", cast("Expression", node.value.expression)
        else:
            continue
        variable = law_variable(node.type, gives)
        variables = {variable: Port(name, variable)} if variable in expression.names else {}  # type: ignore[arg-type]
        others = variables_of(expression, names.nodes)
        variables |= {key: port for key, port in others.items() if key != variable}
        fixed = expression.names - variables.keys() - {"pi"}
        constants = {key: names.parameters[key] for key in fixed}
        laws[name] = Law(gives, expression, constants, variables)
    return laws


def _linear_graph(
    graph: BondGraph,
    laws: Mapping[str, Law],
    point: OperatingPointModel | None,
    variables: Mapping[str, Port],
) -> Linearisation:
    """Return a graph with laws, linearised at its operating point.

    Without a point it is the equilibrium with all sources zero. `variables` are those at ports of fields and
    structures, which have other names in the graph. Raises `NumericalError` where there is no equilibrium, or
    a law has no slope there.
    """
    from dynid.bondgraph.operating_point.element_laws import LawGraph
    from dynid.bondgraph.operating_point.equilibrium import OperatingPointRequest, find_operating_point
    from dynid.bondgraph.operating_point.linearisation import linearised
    from dynid.scene.schema.laws import OperatingPointModel

    def at(name: str) -> Port:
        return variables.get(name, _port(name))

    renamed = {
        name: replace(
            law, variables={key: variables.get(str(port), port) for key, port in law.variables.items()}
        )
        for name, law in laws.items()
    }
    point = point or OperatingPointModel()
    request = OperatingPointRequest(
        inputs={name: value.exact for name, value in point.inputs.items()},
        values={at(name): value.exact for name, value in point.values.items()},
        start={at(name): value.exact for name, value in point.start.items()},
        starts=point.search.starts,
        seed=point.search.seed,
        ranges={at(name): (float(low), float(high)) for name, (low, high) in point.search.ranges.items()},
        choose=point.choose,
    )
    return linearised(find_operating_point(LawGraph(graph, renamed), request))


def _port(name: str) -> Port:
    node, _, quantity = name.rpartition(".")
    return Port(node, quantity)  # type: ignore[arg-type]
