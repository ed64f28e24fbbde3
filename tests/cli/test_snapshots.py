"""The screen of every kind of result: words exactly, numbers to 2 %.

Durations, memory and estimated errors are not compared.

To write the snapshots again after a change of screens: `python -m tests.cli.test_snapshots`.
"""

import re
import sys
from pathlib import Path

import pytest

from dynid.cli.screen import summary
from dynid.result import Result
from dynid.scene.load import load_scene
from dynid.scene.run import run_scene
from dynid.store import open_stored

ROOT = Path(__file__).parents[2]
CONFIGS, TEMPLATES = ROOT / "configs", ROOT / "src/dynid/templates"
SNAPSHOTS = Path(__file__).parent / "snapshots"
SCENES = {
    "bond-graph": CONFIGS / "isolator.yaml",
    "bond-graph-port": CONFIGS / "isolator_port.yaml",
    "bond-graph-channels": CONFIGS / "dc_motor.yaml",
    "bond-graph-feedback": CONFIGS / "isolator_controlled.yaml",
    "bond-graph-laws": CONFIGS / "servo_orifices.yaml",
    "design": CONFIGS / "isolator_design.yaml",
    "synthesis": CONFIGS / "synthesis_impedance.yaml",
    "structure": TEMPLATES / "structure.yaml",
    "reduction": TEMPLATES / "reduction.yaml",
    "identification": CONFIGS / "suspension_noisy.yaml",
    "identification-graph": CONFIGS / "motor_shaft.yaml",
    "modes": CONFIGS / "chain_modes.yaml",
    "modal-analysis": TEMPLATES / "modal-analysis.yaml",
}
NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:[ ,]\d{3})*(?:\.\d+)?(?:e[-+]?\d+)?")
# An estimated error is of the size of rounding, which differs between processors.
MEASURED = re.compile(
    r"(?<=  )\s*\d[\d.]* (?:[mµn]?s|min|[kMG]?B)(?=  |$|\n)|(?<=took )\d[\d.]* [mµ]?s"
    r"|(?<=estimated error )[\d.e-]+|(?<=s  )\s*-(?=\n)"  # memory below the resolution of the system
)


def compared(screen):
    """Return the words of a screen, their distances left out, and its numbers."""
    words = " ".join(MEASURED.sub(" TIME", screen).split())
    numbers = [float(re.sub("[ ,]", "", text).replace("−", "-")) for text in NUMBER.findall(words)]
    return NUMBER.sub("#", words), numbers


def screens(folder):
    """Yield the name and the screen of each kind."""
    for name, path in SCENES.items():
        yield name, lambda path=path: summary(run_scene(load_scene(path)), "")
    yield "plan", lambda: planned(TEMPLATES / "identification.yaml")
    yield "study", lambda: studied(folder)
    yield "bench", lambda: summary(benchmark(), "")


def planned(path):
    """Return the screen of `dynid plan`."""
    from dynid.scene.kinds.planning import run_plan

    return summary(run_plan(load_scene(path)), "")


def studied(folder):
    """Return the screen of a study of three samples, one of which fails."""
    from dynid.study.executors import SerialExecutor
    from dynid.study.plan import make_plan
    from dynid.study.run import run_study

    (folder / "scene.yaml").write_text(
        """dynid: 1
kind: bond-graph
parameters: {m: 1, k: 4}
graph:
  nodes: {F: Se, one: 1, m: {type: I, value: m}, k: {type: C, value: 1 / sqrt(k)}, b: {type: R, value: 1}}
  bonds: [F -> one -> m, one -> k, one -> b]
analysis: {inputs: [F], outputs: [m.f], results: [poles, properties]}
expect: [{path: bond_graph/properties/m.f/F/order, value: 2}]
""",
        encoding="utf-8",
    )
    (folder / "study.yaml").write_text(
        """dynid: 1
kind: study
title: Three springs
scene: scene.yaml
vary: {parameters.k: {values: [4, 9, -1]}}
sampling: {method: list}
collect: [bond_graph/properties/m.f/F/order, bond_graph/transfer_function/m.f/F/poles]
""",
        encoding="utf-8",
    )
    run_study(make_plan(load_scene(folder / "study.yaml")), folder / "study.h5", SerialExecutor())
    with open_stored(folder / "study.h5") as stored:
        return summary(stored, "")


def benchmark():
    """Return a benchmark with made-up measurements."""
    result = Result("bench", "benchmarks")
    group = "bench/zeros-poles"
    result.annotate("bench", clock="wall", seconds=1.5)
    result.annotate(group, title="zeros and poles of a chain", size="stages", measure="relative", failed="")
    made_up = {"exact": ((0.01, 0.2), (0, 0), True), "float": ((0.001, 0.01), (1e-13, 2e-12), False)}
    for name, (seconds, errors, default) in made_up.items():
        result.add_axis(f"{group}/{name}/size", [10, 100])
        result.add(f"{group}/{name}/time", list(seconds), ("size",), "s")
        result.add(f"{group}/{name}/memory", [1e6, 2e6], ("size",), "B")
        result.add(f"{group}/{name}/error", [float(error) for error in errors], ("size",))
        for column, values in (("pareto", [True, True]), ("default", [default, default])):
            result.add(f"{group}/{name}/{column}", values, ("size",))
        result.annotate(f"{group}/{name}", peer="")
    return result


NAMES = [name for name, _ in screens(None)]


@pytest.mark.parametrize("name", NAMES)
def test_the_screen_is_as_it_was(name, tmp_path):
    screen = dict(screens(tmp_path))[name]()
    words, numbers = compared(screen)
    expected, before = compared((SNAPSHOTS / f"{name}.txt").read_text(encoding="utf-8"))
    assert words == expected
    assert numbers == pytest.approx(before, rel=0.02, abs=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_the_answer_stands_within_the_first_fifteen_lines(name):
    lines = (SNAPSHOTS / f"{name}.txt").read_text(encoding="utf-8").splitlines()
    answer = re.compile(
        r"poles   |zeros  |designed|estimate  |^ +\d+ +\d|full  |gain$|min .*max|median|exact"
    )
    assert any(answer.search(line) for line in lines[2:15])


if __name__ == "__main__":
    import tempfile

    for name, screen in screens(Path(tempfile.mkdtemp())):
        if name in sys.argv[1:] or not sys.argv[1:]:
            (SNAPSHOTS / f"{name}.txt").write_text(screen() + "\n", encoding="utf-8")
            print(f"wrote tests/cli/snapshots/{name}.txt")
