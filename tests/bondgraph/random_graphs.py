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


def ill_posed_graph(rng):
    """Return a graph that often has no solution, or more than one: of any form, with values of any size.

    To a random graph are added sources anywhere (some held at zero), bonds beside bonds, rings, parts that no
    element ties down, and one-ports face to face; elements are taken away.
    """
    types, values, bonds, inputs, _ = random_graph(rng, rng.randint(1, 8), rng.choice([0, 0, 1, 2]))
    bonds, only_open = list(bonds), rng.random() < 0.5  # else sources may come to contradict each other

    def add(kind, at=None):
        name = f"z{len(types)}_{len(bonds)}"
        types[name] = kind
        if kind in ("R", "I", "C", "TF", "GY"):
            digits = rng.randint(1, 999)
            values[name] = Fraction(digits) * Fraction(10) ** rng.randint(-12, 10)
        if at is not None:
            bonds.append((name, at) if rng.random() < 0.5 else (at, name))
        return name

    taken = [] if only_open else [n for n, kind in types.items() if kind in "RIC" and rng.random() < 0.4]
    for name in taken:
        loose = next(bond for bond in bonds if name in bond)
        if all(sum(end in bond for bond in bonds) > 1 for end in loose if types[end] in "01"):
            bonds.remove(loose)
            del types[name], values[name]
    places = junctions = [name for name, kind in types.items() if kind in "01"]
    for _ in range(rng.choice([0, 1, 1, 2, 3, 4])):
        a, b = rng.choice(junctions), rng.choice(junctions)
        match rng.choice([1, 4, 4, 9]) if only_open else rng.randrange(9):
            case 0:
                source = add(rng.choice(["Se", "Sf"]), a)
                if rng.random() < 0.5:
                    inputs.append(source)
            case 1 | 6 | 7 if a != b:
                bonds.append((a, b))
            case 2:
                bonds.extend(pairwise([a, add(rng.choice(["TF", "GY"])), b]))
            case 3 | 8:
                junctions = [*junctions, add(rng.choice("01"), a)]
            case 4:
                one = add(rng.choice("01"))
                places = [one, add(rng.choice("01"), one)]
                junctions = junctions + places
            case 9:
                one = add("1" if types[a] == "0" else "0")
                bonds.extend([(a, one), (one, a)])
                places = [one]
            case _:
                other = add(rng.choice(["Se", "Sf", "R", "I", "C"]))
                add(rng.choice(["R", "I", "C"]), other)
    places = places if rng.random() < 0.6 else [*types]
    output = rng.choice([name for name in places if types[name] not in ("TF", "GY")])
    quantity = {"0": rng.choice("ep"), "1": rng.choice("fq")}.get(types[output]) or rng.choice("efqp")
    return types, values, bonds, inputs, (output, quantity)


def driven_ring(rng, junctions, chords):
    """Return a graph of the same form: its source drives a junction on a ring that has no element."""
    types, values, bonds = {}, {}, []

    def add(kind, given=None):
        name = f"n{len(types)}"
        types[name] = kind
        if given is not None:
            values[name] = given
        return name

    def value():
        return Fraction(rng.randint(1, 40), rng.randint(1, 20))

    ring = [add(rng.choice("01")) for _ in range(junctions)]
    pairs = [*pairwise([*ring, ring[0]]), *(rng.sample(ring, 2) for _ in range(chords))]
    for a, b in pairs:
        chain = [a, b]
        if types[a] == types[b] or rng.random() < 0.3:  # a bond between like junctions would merge them
            kind = rng.choice(["TF", "GY", "1" if types[a] == "0" else "0"])
            chain.insert(1, add(kind, None if kind in "01" else value() * rng.choice([1, 1, -1])))
        bonds.extend(pairwise(chain if rng.random() < 0.5 else chain[::-1]))
    for name in [name for name, kind in types.items() if kind in "01" and name != ring[0]]:
        for _ in range(rng.choice([1, 1, 2])):
            bonds.append((name, add(rng.choice("RIC"), value())))
    source = add(rng.choice(["Se", "Sf"]))
    bonds.append((source, ring[0]))
    return types, values, bonds, [source], (source, "f" if types[source] == "Se" else "e")
