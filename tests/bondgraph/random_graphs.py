"""Random linear bond graphs: trees and loops, TF and GY anywhere, any bond direction."""

from fractions import Fraction
from itertools import pairwise


def random_graph(rng, junctions, extra):
    """Return (types, values, bonds, inputs, output) from a `random.Random`."""
    types, values, bonds = {}, {}, []

    def directed(a, b):
        bonds.append((a, b) if rng.random() < 0.5 else (b, a))

    def value():
        return Fraction(rng.randint(1, 40), rng.randint(1, 20))

    def connect(a, b):
        chain = [a]
        for _ in range(rng.choice([0, 0, 0, 0, 1, 1, 2])):
            name = f"t{len(types)}"
            types[name] = rng.choice(["TF", "GY"])
            values[name] = value() * rng.choice([1, 1, -1])
            chain.append(name)
        chain.append(b)
        if rng.random() < 0.5:
            chain.reverse()
        if len(chain) == 2:
            directed(*chain)
        else:
            bonds.extend(pairwise(chain))

    names = [f"j{k}" for k in range(junctions)]
    for name in names:
        types[name] = rng.choice("01")
    for k in range(1, junctions):
        connect(names[rng.randrange(k)], names[k])
    for _ in range(extra if junctions > 1 else 0):
        connect(*rng.sample(names, 2))
    for name in names:
        for _ in range(rng.choice([0, 1, 1, 2, 3])):
            element = f"x{len(types)}"
            types[element] = rng.choice("RIC")
            values[element] = value()
            directed(name, element)
    inputs = []
    for _ in range(rng.choice([1, 1, 2, 3])):
        source = f"u{len(types)}"
        types[source] = rng.choice(["Se", "Sf"])
        inputs.append(source)
        directed(rng.choice(names), source)
    if not any(name in bond for bond in bonds for name in names):
        return random_graph(rng, junctions, extra)
    loose = [name for name in names if not any(name in bond for bond in bonds)]
    for name in loose:
        del types[name]
    output = rng.choice([name for name, kind in types.items() if kind not in ("TF", "GY")])
    quantity = {"0": rng.choice("ep"), "1": rng.choice("fq")}.get(types[output]) or rng.choice("efqp")
    return types, values, bonds, inputs, (output, quantity)


def coincident_graph(rng, junctions):
    """Return a graph of the same form, full of equal, opposite and zero values, sources and self-loops."""
    types, values, bonds, inputs = {}, {}, [], []

    def add(kind, value=None):
        name = f"n{len(types)}"
        types[name] = kind
        if value is not None:
            values[name] = Fraction(value)
        return name

    def connect(a, b, least=0):
        two_ports = [
            add(rng.choice(["TF", "GY"]), rng.choice([1, 1, -1, 2]))
            for _ in range(max(least, rng.choice([0, 0, 0, 1, 1, 2, 3])))
        ]
        chain = [a, *two_ports, b]
        if rng.random() < 0.5:
            chain.reverse()
        bonds.extend(pairwise(chain))

    def one_port():
        kind = rng.choice(["R", "I", "C", "R", "I", "C", "Se", "Sf"])
        if kind in ("R", "I", "C"):
            return add(kind, 0 if rng.random() < 0.1 else rng.choice([1, 1, 1, 2, 3, -1, -1, -2]))
        source = add(kind)
        if rng.random() < 0.8:
            inputs.append(source)
        return source

    names = [add(rng.choice("01")) for _ in range(junctions)]
    for k in range(1, junctions):
        connect(names[rng.randrange(k)], names[k])
    for _ in range(rng.choice([0, 0, 1, 2, 3])):
        a, b = rng.choice(names), rng.choice(names)
        connect(a, b, least=int(a == b))
    for name in names:
        for _ in range(rng.choice([0, 0, 1, 1, 2])):
            connect(name, one_port())
    if not inputs:
        inputs.append(add(rng.choice(["Se", "Sf"])))
        connect(rng.choice(names), inputs[0])
    output = rng.choice([name for name, kind in types.items() if kind not in ("TF", "GY")])
    quantity = {"0": rng.choice("ep"), "1": rng.choice("fq")}.get(types[output]) or rng.choice("efqp")
    return types, values, bonds, inputs, (output, quantity)
