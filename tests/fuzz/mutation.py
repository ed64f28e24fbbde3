"""Valid scenes with something wrong in them, at any place: the same for the same seed."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path

from dynid.scene.yaml.source import parse_source, read_source
from dynid.scene.yaml.writer import dump

CONFIGS = sorted((Path(__file__).parents[2] / "configs").rglob("*.yaml"))
TEMPLATES = sorted((Path(__file__).parents[2] / "src/dynid/templates").glob("*.yaml"))

VALUES = [
    *(None, True, False, 0, -1, 1, 2, 3, 0.0, -0.0, 1e-300, 1e300, 1e308, 5e-324, -1e9),
    *(float("nan"), float("inf"), -float("inf"), 10**30, -(10**400), 2**63, 2**64),
    *("", " ", "~", "nan", ".inf", "1e999", "-", "0x10", "1_000", "12:30", "on", "=", "a b", "\x00"),
    *("__class__", "__init__", "self", "keys", "items", "values", "format", "{0.__class__}", "%s", "$x"),
    *("import os", "__import__('os').system('x')", "().__class__", "lambda: 0", "open('/etc/passwd')"),
    *("9**9**9", "1/0", "sqrt(-1)", "log(0)", "exp(1000)", "ω"),
    *("a" * 5000, "(" * 500, "-" * 500 + "1", "1+" * 500 + "1", "sqrt(" * 90 + "2" + ")" * 90),
    *("/dev/zero", "/dev/null", "/etc/passwd", "..", ".", "/", "~/x", "missing.csv", "file://x", "x\ny"),
    *("a -> b", "a -> a", "->", "a ->", "a -> b -> a", "m_s.f", "m_s.", ".f", "m_s.f.e", "study"),
    *([], {}, [[]], [{}], {"": ""}, [None], {"a": None}, [1, 2, 3], ["x"] * 100, {"type": "I"}, {"type": {}}),
    {"start": 1, "stop": 2}, {"kind": "step"}, {"path": "x"}, {"value": 1}, {"distribution": "normal"},
]  # fmt: skip


#: Scenes with keys that no scene that comes along has.
FURTHER = [
    """
dynid: 1
kind: bond-graph
parameters: {L: 1.0e-3, Z: sqrt(L/C), C: 2.0e-6}
models:
  cell:
    ports: [left, right]
    parameters: {L: 1, C: 1}
    nodes: {s: 1, p: 0, l: {type: I, value: L}, c: {type: C, value: C}}
    bonds: [left -> s, s -> l, s -> p, p -> c, p -> right]
graph:
  nodes:
    v: Se
    i: Sf
    line: {model: cell, L: L, C: C, repeat: 4, chain: [right, left], copies: {2: {C: 3*C}, 3: {L: 2*L}}}
    z: 0
    e: {type: R, value: Z}
  bonds: [v -> line.left, line.right -> z, i -> z, z -> e]
analysis:
  outputs: [e.f, e.e]
  time: {stop: 1.0e-3, step: 1.0e-5}
  frequency: {start: 10, stop: 1e4, unit: Hz}
expect:
  - {path: bond_graph/system/stable, value: true}
  - {path: bond_graph/time_response/response, at: {output: e.f, source: v}, min: -10, max: 10}
""",
    """
dynid: 1
kind: identification
parameters:
  kb: {start: 1.0e4, true: 2.0e4, min: 100, max: 1.0e6, prior: {value: 2.0e4, relative_deviation: 0.25}}
  late: {start: 0.001, true: 0.002, min: 0, max: 0.01, scale: linear}
  m2: {value: 1, std: 0.01}
structure:
  lumped:
    masses: [1, m2, 1]
    links: [{dofs: [1], k: kb, c: 2}, {dofs: [1, 2], k: 3.0e4}, {dofs: [2, 3], k: 3.0e4}]
joints:
  left: {dofs: [1, 2], k: {start: 1.0e3, true: 2.0e3}}
  right: {dofs: [2, 3], k: {start: 1.0e3, true: 4.0e3}, c: {start: 5, true: 10}}
excitation: [{dof: 2, kind: multisine, amplitude: [10, 10], frequency: [20, 90]}]
measurement:
  step: 0.002
  samples: 300
  channels: [{dof: 1, quantity: velocity, delay: late}, {dof: 3, quantity: displacement}]
  noise: {kind: coloured, order: auto}
  simulate: {noise_ratio: 0.02, seed: 1}
estimator: {method: output-error, iterations: 20}
""",
]


def bases():
    """Return the data of all scenes that come along, and of some with further keys."""
    return [
        *(read_source(path).data for path in (*CONFIGS, *TEMPLATES)),
        *(parse_source(text).data for text in FURTHER),
    ]


def paths(data, prefix=()):
    """Yield the path of everything in a scene."""
    entries = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in entries:
        yield (*prefix, key)
        yield from paths(value, (*prefix, key))


def at(data, path):
    for key in path:
        data = data[key]
    return data


def _nested(chance, value):
    for _ in range(chance.choice([1, 3, 60, 2000])):
        value = [value] if chance.random() < 0.5 else {"a": value}
    return value


def _typo(chance, key):
    text = str(key)
    place = chance.randrange(len(text) + 1)
    return text[:place] + chance.choice("aeiou_-. 0\t") + text[place + chance.randint(0, 1) :]


def spoiled_data(chance, base):
    """Return a scene with one to four things changed."""
    data = deepcopy(base)
    for _ in range(chance.choice([1, 1, 1, 2, 4])):
        every = list(paths(data))
        if not every:
            break
        path = chance.choice(every)
        holder, key = at(data, path[:-1]), path[-1]
        act = chance.randrange(7)
        if act == 0:
            del holder[key]
        elif act == 1 and isinstance(holder, dict):
            holder[_typo(chance, key)] = holder.pop(key)
        elif act == 2:
            holder[key] = deepcopy(at(data, chance.choice(every)))
        elif act == 3:
            holder[key] = _nested(chance, holder[key])
        elif act == 4 and isinstance(holder, dict):
            holder[chance.choice(["extra", "__class__", "0", "kind", "type", "value", "", "k"])] = holder[key]
        elif act == 5 and isinstance(holder[key], str):
            text = holder[key]
            holder[key] = _typo(chance, text)
        else:
            holder[key] = deepcopy(chance.choice(VALUES))
    return data


_INSERTS = [
    *(
        "\t",
        "\x00",
        "&a ",
        "*a",
        "<<: ",
        "!!python/object/apply:os.system ",
        "---\n",
        "? ",
        "- ",
        ": ",
        "{",
        "]",
    ),
    *("\u2028", "\r", "#", "'", '"', "|\n", "%YAML 1.1\n", "é", "\ud7ff", "&a [*a, *a]", "- &b [x, x]\n"),
]


def spoiled_text(chance, base):
    """Return the text of a scene with some characters changed."""
    text = dump(base)
    for _ in range(chance.choice([1, 1, 2, 8])):
        place = chance.randrange(len(text) + 1)
        act = chance.randrange(4)
        if act == 0:
            text = text[:place] + text[place + chance.choice([1, 1, 5, 50]) :]
        elif act == 1:
            text = text[:place] + chance.choice(_INSERTS) + text[place:]
        elif act == 2:
            text = text[:place]
        else:
            other = chance.randrange(len(text) + 1)
            text = text[:place] + text[other : other + 40] + text[place:]
    return text


_TYPES = [
    *(None, True, 3, -1.5, "text", "2*3", [], [1, 2], ["a"], [[1]], [None], [{"a": 1}], {}, {"a": 1}),
    {"value": 1},
    {"start": 1, "true": 2},
]


def wrong_type(chance, base):
    """Return a scene with another type at one place."""
    data = deepcopy(base)
    path = chance.choice(list(paths(data)))
    at(data, path[:-1])[path[-1]] = deepcopy(chance.choice(_TYPES))
    return dump(data)
