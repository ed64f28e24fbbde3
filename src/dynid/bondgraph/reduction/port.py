"""From the root's common variable to the variable asked for."""

from __future__ import annotations

from dataclasses import dataclass

from dynid.bondgraph.graph import JUNCTIONS, SOURCES, Port, bond_sign
from dynid.bondgraph.reduction.network import STORED, Network
from dynid.bondgraph.reduction.program import Program, Register


@dataclass(frozen=True)
class PortForm:
    """An output as a linear form: of the root's common variable, of what drives the root, and of itself.

    Parameters
    ----------
    common, drive, own
        Coefficients.
    by
        The input that `own` multiplies: the output's node, or the energy that it stores at t = 0.
    """

    common: Register
    drive: Register
    own: Register
    by: str

    def scaled(self, program: Program, factor: Register) -> PortForm:
        """Return the form times a factor."""
        common, drive, own = (program.mul(factor, part) for part in (self.common, self.drive, self.own))
        return PortForm(common, drive, own, self.by)


def port_form(net: Network, port: Port, total: Register) -> PortForm:
    """Write an output in terms of the root's common variable.

    The displacement of a C and the momentum of an I are its state, q = C e and p = I f; any other
    displacement or momentum is the integral of flow or effort.

    Parameters
    ----------
    net
        The network, reduced to its root.
    port
        The output.
    total
        What stands on the root: Z_A + Z_B on a 1-junction, Y_A + Y_B on a 0-junction.
    """
    program, graph = net.program, net.structure.graph
    form = _form(net, port.node, graph.behind(port).quantity, total)
    if graph.is_state(port):
        value = program.parameter(port.node)
        return form.scaled(program, value if bond_sign(graph, port.node) > 0 else program.neg(value))
    return form.scaled(program, program.inv(program.s)) if port.quantity in "qp" else form


def _form(net: Network, name: str, quantity: str, total: Register) -> PortForm:
    """Write an effort or flow: common to the junction, set by a source, or the answer of what is asked."""
    program, kind = net.program, net.structure.graph.nodes[name].type
    zero, one = program.zero, program.one
    if kind in SOURCES and quantity == ("e" if kind == "Se" else "f"):
        return PortForm(zero, zero, one, name)
    if kind in JUNCTIONS or quantity == ("f" if net.root.kind == "1" else "e"):
        return PortForm(one, zero, zero, name)
    if kind in SOURCES:  # it fixes the common variable; its reaction balances the junction
        form = PortForm(program.neg(total), one, zero, name)
    else:
        source = f"{STORED}{name}"
        own = program.neg(net.stored(name, net.root)) if source in net.inputs else zero
        form = PortForm(net.immittance(name, net.root), zero, own, source)
    outward = bond_sign(net.structure.graph, name) > 0
    return form if outward else form.scaled(program, program.neg(one))


def channel(net: Network, form: PortForm, source: str, common: Register) -> Register:
    """Write the transfer function from a source to an output.

    Parameters
    ----------
    net
        The network, reduced to its root.
    form
        The output in terms of the root's common variable.
    source
        The input.
    common
        The transfer function from the source to the common variable.
    """
    program = net.program
    drive = net.root.sources.get(source, program.zero)
    value = program.add(program.mul(form.common, common), program.mul(form.drive, drive))
    return program.add(value, form.own) if source == form.by else value
