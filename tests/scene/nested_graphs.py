"""Flat graphs cut into nested models at random."""

from collections import Counter, defaultdict


def nested(rng, types, values, bonds, depth=3):
    """Return models, nodes, bonds of a graph with parts as instances, and the flat name of every node."""
    paths = dict.fromkeys(types, ())  # the instances around each node, from outside
    for level in range(depth):
        within = defaultdict(list)
        for name, path in paths.items():
            if len(path) == level:
                within[path].append(name)
        for path, names in within.items():
            parts = rng.randint(1, 4)
            for name in names:
                part = rng.randrange(parts + 1)
                paths[name] = (*path, f"m{part}") if part else path
    return _written(rng, types, values, bonds, paths)


def _written(rng, types, values, bonds, paths):
    holders = {path[:level] for path in paths.values() for level in range(len(path) + 1)} | {()}
    ports, texts = defaultdict(list), defaultdict(list)
    leaving = Counter(
        end for k, bond in enumerate(bonds) for end in bond if paths[end] and _leaves(bond, paths, end)
    )
    direct = {
        end for end, count in leaving.items() if count == 1 and rng.random() < 0.5
    }  # nodes that are ports
    for k, bond in enumerate(bonds):
        for holder in holders:
            ends = []
            for side, end in zip("th", bond, strict=True):
                path, level = paths[end], len(holder)
                if path == holder:
                    ends.append(end)
                elif path[:level] == holder:
                    inner = end if end in direct and len(path) == level + 1 else f"p{k}{side}"
                    ends.append(f"{path[level]}.{inner}")
                else:
                    ends.append(None)
            if ends == [None, None]:
                continue
            if None in ends:
                place = 1 - ends.index(None)
                if bond[place] in direct and paths[bond[place]] == holder:
                    ports[holder].append(bond[place])
                    continue
                port = f"p{k}{'th'[place]}"
                ports[holder].append(port)
                ends[1 - place] = port
            elif "." in ends[0] and "." in ends[1] and ends[0].split(".")[0] == ends[1].split(".")[0]:
                continue  # within an instance
            texts[holder].append(f"{ends[0]} -> {ends[1]}")
    models, nodes = {}, {}
    for holder in sorted(holders, key=len, reverse=True):
        own = {name: _node(types[name], values.get(name)) for name, path in paths.items() if path == holder}
        given = {}
        for name in own:
            if "value" in own[name] and holder and rng.random() < 0.5:
                given[f"v_{name}"], own[name]["value"] = own[name]["value"], f"v_{name}"
        for path in holders:
            if path[:-1] == holder and path:
                own[path[-1]] = {"model": "_".join(path), **models["_".join(path)].pop("given")}
        if holder:
            usual = {
                name: value if rng.random() < 0.3 else rng.choice([None, 7]) for name, value in given.items()
            }
            models["_".join(holder)] = {
                "ports": ports[holder],
                "parameters": usual,
                "nodes": own,
                "bonds": texts[holder],
                "given": {name: value for name, value in given.items() if usual[name] != value},
            }
        else:
            nodes = own
    return models, nodes, texts[()], {name: ".".join((*path, name)) for name, path in paths.items()}


def _leaves(bond, paths, end):
    (other,) = [one for one in bond if one != end] or [end]
    return paths[other][: len(paths[end])] != paths[end]


def _node(kind, value):
    return {"type": kind} | ({} if value is None else {"value": str(value)})
