"""Scenes that somebody built on purpose, each on a valid one: the same for the same chance."""

from __future__ import annotations

import re
from copy import deepcopy

from dynid.scene.yaml.writer import dump
from tests.fuzz.mutation import at, paths

#: What leaves this name in the folder has been run.
CANARY = "canary"

ATTRIBUTES = [
    *("__class__", "__init__", "__dict__", "__reduce__", "self", "keys", "items", "values", "get", "update"),
    *("format", "model_fields", "model_dump", "name", "type", "value", "kind", "nodes", "bonds", "study"),
    *("pi", "e", "s", "sqrt", "max", "nan", "inf", "None", "True", "null", "true", "on", "0", "1", "1e3"),
    "t1",
]  # fmt: skip

FILES = [
    *("/dev/zero", "/dev/null", "/dev/random", "/dev/full", "/dev/stdin", "/dev/tty", "/proc/self/mem"),
    *("/proc/self/environ", "/proc/self/fd/0", "/", "..", ".", "folder", "pipe", "loop", "empty.csv"),
    *("kept.h5", "kept.csv", "kept.mtx", "kept.mat", "kept.npz", "scene.yaml", "kept.csv/x", "missing.h5"),
    *("x" * 300, "~/x", "$HOME", "file:///etc/passwd", "http://localhost/x.csv", "//x/y"),
    *("a\x00b", "\n", "é.csv"),
]  # fmt: skip

CODE = [
    f"!!python/object/apply:os.system ['touch {CANARY}']",
    f"!!python/object/new:os.system ['touch {CANARY}']",
    f"!!python/object/apply:subprocess.check_output [[touch, {CANARY}]]",
    "!!python/name:os.system",
    "!!python/module:antigravity",
    "!!python/object:dynid.result.Result {}",
    f"__import__('os').system('touch {CANARY}')",
    f"(lambda: open('{CANARY}', 'w'))()",
    f"open('{CANARY}', 'w')",
    f"exec(\"open('{CANARY}', 'w')\")",
    "().__class__.__base__.__subclasses__()",
    f"[open('{CANARY}', 'w') for x in (1,)]",
    f"sqrt(open('{CANARY}', 'w'))",
    "sqrt.__globals__",
    "pi.__class__",
    f"{{{{ open('{CANARY}', 'w') }}}}",
    f"${{touch {CANARY}}}",
    f"`touch {CANARY}`",
    f"!include {CANARY}",
    "!!binary AAAA",
    "!!set {a, b}",
    "!!timestamp 2020-01-01",
]

_HUGE = [5000, 10**5, 10**6, 10**7, 10**9, 2**31, 2**63, 10**30]
_MARK = "marked_for_replacement"


def _put(chance, base, *, only=lambda _: True):
    """Return the text of a scene with a mark at a random place."""
    data = deepcopy(base)
    every = [path for path in paths(data) if only(at(data, path))]
    if not every:
        return dump({"dynid": 1, "kind": "bond-graph", "x": _MARK})
    path = chance.choice(every)
    at(data, path[:-1])[path[-1]] = _MARK
    return dump(data)


def alias_bomb(chance, base):
    """Aliases of aliases of aliases, or of themselves, as lists, mappings and merge keys."""
    depth, wide, form = chance.choice([3, 9, 30, 400]), chance.choice([2, 9, 30]), chance.randrange(4)
    if form == 3:
        bomb = chance.choice(["&a9 [*a9]", "&a9 {k: *a9}", "&a9 {<<: *a9}", "&a9 {k: [1, {l: *a9}]}"])
        return _put(chance, base).replace(_MARK, bomb)
    lines = ["x0: &a0 [lol, lol]" if form == 0 else "x0: &a0 {k: lol}"]
    for k in range(1, depth):
        before = f"*a{k - 1}"
        inside = {
            0: f"[{', '.join([before] * wide)}]",
            1: "{" + ", ".join(f"k{j}: {before}" for j in range(wide)) + "}",
            2: f"{{<<: [{', '.join([before] * wide)}], k{k}: {before}}}",
        }[form]
        lines.append(f"x{k}: &a{k} {inside}")
    return "\n".join(lines) + "\n" + _put(chance, base).replace(_MARK, f"*a{depth - 1}")


def deep_nesting(chance, base):
    """Lists and mappings in one another, in flow and in block style, closed or not."""
    depth = chance.choice([20, 200, 3000, 50_000])
    form = chance.randrange(6)
    if form == 4:
        depth = min(depth, 600)
        return "".join(f"{' ' * k}a:\n" for k in range(depth)) + " " * depth + "b\n"
    deep = {
        0: "[" * depth + "]" * depth,
        1: "{a: " * depth + "}" * depth,
        2: "[" * depth,
        3: "[{a: " * (depth // 2) + "}]" * (depth // 2),
        5: "\n" + "- " * depth + "x",
    }[form]
    return _put(chance, base).replace(_MARK, deep, 1)


def cyclic_parameters(chance, base):
    """Parameters that are made of themselves, of thousands of others, or of ever larger numbers."""
    data, length = deepcopy(base), chance.choice([1, 2, 3, 40, 1500])
    names = [f"p{k}" for k in range(length)]
    law = chance.choice(
        ["{}", "{} + 1", "{0} * {0}", "{0} ** {0}", "1 / {}", "-{}", "sqrt({})", "({0} + {0}) * {0}", "{}{}"]
    )
    found = {
        name: law.format(other, other) for name, other in zip(names, [*names[1:], names[0]], strict=True)
    }
    if chance.random() < 0.5:  # a chain with an end
        found[names[-1]] = chance.choice([1, 2.5, 0, -3, "pi", "nan", "p", 10**20])
    given = data.get("parameters") if isinstance(data, dict) else None
    data["parameters"] = {**(given if isinstance(given, dict) else {}), **found}
    numbers = [path for path in paths(data) if isinstance(at(data, path), int | float)]
    for path in chance.sample(numbers, min(2, len(numbers))):
        at(data, path[:-1])[path[-1]] = names[0]
    return dump(data)


def bad_numbers(chance, base):
    """Numbers that are none, or are far too large or small."""
    data = deepcopy(base)
    numbers = [path for path in paths(data) if isinstance(at(data, path), int | float)]
    for path in chance.sample(numbers, min(len(numbers), chance.choice([1, 1, 2, 50]))):
        at(data, path[:-1])[path[-1]] = _MARK
    text = dump(data)
    written = [
        *(".nan", ".NaN", ".inf", "-.inf", "+.Inf", "nan", "NaN", "inf", "1e400", "-1e999999999", "1e-400"),
        *("9" * 400, "-" + "9" * 5000, "0x" + "f" * 5000, "0o7777", "0b11", "1" + "0" * 20, "1e308"),
        *("5e-324", "0." + "3" * 3000, "1_000", "1,5", "1e"),
        *("--1", "+-1", "1e3.5", "Infinity", "1j", "٣", "-0", "1:30"),
    ]  # fmt: skip
    while _MARK in text:
        text = text.replace(_MARK, chance.choice(written), 1)
    return text


def whole_range(chance, base):
    """Numbers over the whole range of floats, of either sign, in a fraction of the scene's numbers."""
    data = deepcopy(base)
    numbers = [path for path in paths(data) if type(at(data, path)) in (int, float) and path[-1] != "dynid"]
    share = chance.choice([1, 1, 2, len(numbers)])
    for path in chance.sample(numbers, min(len(numbers), share)):
        size = 10.0 ** chance.uniform(-323, 308) * chance.choice([1, 1, 1, -1])
        at(data, path[:-1])[path[-1]] = chance.choice([size, size, 1e300, -1e308, 1.7e308, 5e-324, 1e160])
    return dump(data)


def deep_names(chance, base):
    """Paths, chains and lists of names that are longer than anything they could name, as values and keys."""
    data = deepcopy(base)
    every = [path for path in paths(data) if path not in (("dynid",), ("kind",))]
    for path in sorted(
        chance.sample(every, min(len(every), chance.choice([1, 1, 3]))), key=len, reverse=True
    ):
        joint, name = (
            chance.choice([".", ".", "/", " -> ", ",", " "]),
            chance.choice(["a", "1", "m_s", "graph"]),
        )
        long, holder = joint.join([name] * chance.choice([70, 300, 3000])), at(data, path[:-1])
        if isinstance(holder, dict) and chance.random() < 0.5:
            holder[long] = holder[path[-1]]
        else:
            holder[path[-1]] = long
    return dump(data)


def nested_models(chance, base):
    """Models within models, more than anybody can expand, in a graph of the scene or a new one."""
    data, depth = deepcopy(base), chance.choice([3, 20, 60, 1000])
    models = {}
    for level in range(depth):
        below = {"model": f"m{level + 1}"}
        if chance.random() < 0.3:
            below["repeat"] = chance.choice([2, 300, 20_000])
        models[f"m{level}"] = {"nodes": dict.fromkeys("abcd"[: chance.choice([1, 2, 4])], below)}
    end = chance.choice(
        [{"nodes": {}}, {"nodes": {"r": {"type": "R", "value": 1}}}, {"nodes": {"a": models["m0"]}}]
    )
    models[f"m{depth}"] = chance.choice([end, end, {"nodes": {"a": {"model": "m0"}}}])
    graph = data.get("graph") if isinstance(data.get("graph"), dict) else {}
    nodes = graph.get("nodes") if isinstance(graph.get("nodes"), dict) else {}
    data["graph"] = {**graph, "nodes": {**nodes, "x": {"model": "m0"}}}
    data["models"] = models
    return dump(data)


def huge_sizes(chance, base):
    """Counts that nobody can wait for or store: of whatever a scene counts."""
    data = deepcopy(base)
    counts = [path for path in paths(data) if type(at(data, path)) is int and path[-1] != "dynid"]
    for path in chance.sample(counts, min(len(counts), chance.choice([1, 1, 2]))):
        at(data, path[:-1])[path[-1]] = chance.choice(_HUGE)
    if chance.random() < 0.2:
        every = [path for path in paths(data) if path != ("dynid",)]
        path, long = chance.choice(every), chance.choice([10**3, 10**5])
        value = at(data, path)
        at(data, path[:-1])[path[-1]] = chance.choice(
            [[value] * (long // 100), "x" * long, {f"k{k}": value for k in range(long // 100)}]
        )
    return dump(data)


def attribute_names(chance, base):
    """Names that mean something to Python, YAML or the formulas, everywhere that a name stands."""
    text = dump(base)
    words = sorted(set(re.findall(r"[A-Za-z_][A-Za-z_0-9]*", text)))
    for word in chance.sample(words, min(len(words), chance.choice([1, 1, 3]))):
        text = re.sub(rf"\b{re.escape(word)}\b", chance.choice(ATTRIBUTES), text)
    return text


def hostile_files(chance, base):
    """Devices, directories, pipes, loops, other people's files, wherever a scene has a text."""
    data = deepcopy(base)
    texts = [path for path in paths(data) if isinstance(at(data, path), str)]
    named = [path for path in texts if re.search(r"\.(csv|mtx|mat|h5|npz|uff|yaml|inp)$", at(data, path))]
    form = chance.randrange(3)
    if named and form:
        path = chance.choice(named)
        at(data, path[:-1])[path[-1]] = chance.choice(FILES)
    elif isinstance(data.get("structure"), dict) and form:
        files = {key: chance.choice(FILES) for key in ("mass", "stiffness", "damping")}
        data["structure"] = {"matrices": files}
    elif isinstance(data.get("measurement"), dict):
        data["measurement"].pop("simulate", None)
        data["measurement"]["file"] = {"path": chance.choice(FILES), "columns": ["a", "b"]}
    elif texts:
        path = chance.choice(texts)
        at(data, path[:-1])[path[-1]] = chance.choice(FILES)
    return dump(data)


def code(chance, base):
    """Text that would run if anybody ran it."""
    return _put(chance, base).replace(_MARK, chance.choice(CODE))
