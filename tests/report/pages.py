"""Results of every kind, as small as they can be, and what is wanted of their pages."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from pathlib import Path

from dynid.result import Result
from dynid.scene.kinds.planning import run_plan
from dynid.scene.load import check_source, load_scene
from dynid.scene.run import run_scene
from dynid.scene.yaml.source import parse_source

CONFIGS = Path(__file__).parents[2] / "configs"
HOSTILE = "</script><script>alert(1)</script>\"'><img src=x onerror=alert(2)>&amp;\u202e\u0007\u2028]]>"


def template(kind):
    return (files("dynid") / "templates" / f"{kind}.yaml").read_text(encoding="utf-8")


@cache
def result_of(kind):
    """Return the result of a kind: of its template, or made up as the command would."""
    made = {"bench": bench, "study": study, "plan": plan}
    return made[kind]() if kind in made else run(template(kind))


def run(text):
    return run_scene(check_source(parse_source(text, "scene.yaml")))


def plan():
    return run_plan(load_scene(CONFIGS / "table1.yaml"))


def bench():
    result = Result("bench", "Benchmarks of dynid")
    result.annotate("bench", clock="wall", seconds=2.0, machine="Abacus 3, 2 cores")
    result.annotate(
        "bench/roots", title="Roots of a chain", size="N", measure="worst relative", failed="slow: too slow",
        missing="", chosen="exact up to 60 states",
    )  # fmt: skip
    for name, time, best in (("exact", [0.01, 0.1], [True, True]), ("float", [0.002, 0.3], [True, False])):
        group = f"bench/roots/{name}"
        result.annotate(group, peer=False, exponent=1.5)
        result.add_axis(f"{group}/size", [20, 100])
        for column, values in (("time", time), ("memory", [1e6, 2e7]), ("error", [0.0, 3e-14])):
            result.add(f"{group}/{column}", values, ("size",), "s" if column == "time" else "")
        result.add(f"{group}/pareto", best, ("size",))
        result.add(f"{group}/default", [name == "exact"] * 2, ("size",))
    return result


def study(count=60, failed=(7,), pending=(), seed=3):
    """Return a study as its file holds it: two inputs, a number, a list of three, a text."""
    import numpy as np

    random = np.random.default_rng(seed)
    stiffness, damping = random.uniform(1e4, 2e4, count), random.uniform(0.1, 10, count)
    result = Result("study", "Tuning a mount", {"scene": "kind: study\n", "seed": seed})
    code = np.zeros(count, dtype=int)
    code[list(failed)], code[list(pending)] = 3, -1
    lost = code != 0
    result.add_axis("study/sample", np.arange(count))
    names = np.array(["pending", "done", "", "", "failed"], dtype=object)
    result.add("study/status", names[code + 1], ("sample",))
    result.add("study/exit_code", code, ("sample",))
    result.add("study/key", np.full(count, "00", dtype=object), ("sample",))
    result.add("study/error", np.where(code == 3, "no <b>root</b> at 3", "").astype(object), ("sample",))
    result.add("study/samples/parameters.k", stiffness, ("sample",))
    result.add("study/samples/parameters.c", damping, ("sample",))
    omega = np.where(lost, np.nan, np.sqrt(stiffness))
    result.add("study/results/mode/omega", omega, ("sample",), "rad/s")
    three = np.where(lost[:, None], np.nan, omega[:, None] * [1.0, 2.0, 3.0])
    result.add("study/results/mode/all", three, ("sample", "number"), "rad/s")
    said = np.where(lost, "", np.where(damping > 1, "stable", "ringing")).astype(object)
    result.add("study/results/mode/verdict", said, ("sample",))
    result.add("study/expect/0", ~lost & (damping > 1), ("sample",))
    return result
