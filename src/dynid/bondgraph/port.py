"""From the root's common variable to the variable asked for."""

from __future__ import annotations

from dynid.bondgraph.graph import Port
from dynid.bondgraph.network import Network
from dynid.bondgraph.program import Register


def channel(
    net: Network, port: Port, source: str, total: Register, held: dict[str, Register] | None
) -> Register:
    """Write the transfer function from a source to the port, by the prototype's equation.

    Parameters
    ----------
    net
        The network, reduced to its root.
    port
        The output.
    source
        The input.
    total
        What stands on the root: Z_A + Z_B on a 1-junction, Y_A + Y_B on a 0-junction.
    held
        The root's unknown by source, where a constraint fixes it.
    """
    program = net.program
    junction = net.structure.junctions[net.root]
    node = net.structure.graph.nodes[port.node]
    drive = net.sources[net.root].get(source, program.zero)
    if held is not None:
        common = held.get(source, program.zero)
    elif junction.fixing is not None:
        common = program.one if source == junction.fixing else program.zero
    else:
        common = program.div(drive, total)
    of_common = port.quantity in (("f", "q") if junction.kind == "1" else ("e", "p"))
    own = program.one if source == port.node else program.zero
    bond = net.structure.graph.bonds_of(port.node)[0]
    outward = bond.head == port.node  # the arrow points at the node
    if node.type in ("Se", "Sf"):
        sets = "e" if node.type == "Se" else "f"
        if port.quantity in ((sets, "p") if sets == "e" else (sets, "q")):
            value = own
        elif port.node == junction.fixing:
            reaction = program.sub(program.mul(total, common), drive)
            value = program.neg(reaction) if outward else reaction
        else:
            value = common
    elif of_common:
        value = common
    else:
        value = program.mul(net.immittance(port.node, net.root), common)
        value = value if outward else program.neg(value)
    return program.div(value, program.s) if port.quantity in "qp" else value
