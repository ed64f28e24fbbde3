"""`dynid check --explain` reports before a run what the run will report, and its approximate cost."""

import math
import re
import sys

import numpy as np
import pytest

from dynid.bondgraph.analysis_request import RESULTS
from dynid.cli.check import _received, seconds_text, size_text
from dynid.cli.screen import section_lines
from dynid.errors import Singular
from dynid.report.content.identifiability import identifiability_sections
from dynid.scene.explanation import explain, peak_megabytes, trial
from dynid.scene.load import check_source, load_scene
from dynid.scene.run import run_scene
from dynid.scene.yaml.source import parse_source
from dynid.store import write_result
from dynid.templates.chain import chain_scene
from dynid.trial import messages

pytestmark = pytest.mark.thorough

OSCILLATOR = """
dynid: 1
kind: bond-graph
title: Oscillator
graph:
  nodes: {F: Se, x: 1, m: {type: I, value: 2}, k: {type: C, value: 0.5}, b: {type: R, value: 1},
          far: Se, y: 1, M: {type: I, value: 3}, c: {type: R, value: 1}}
  bonds: [F -> x, x -> m, x -> k, x -> b, far -> y, y -> M, y -> c]
analysis: {inputs: [F], outputs: [m.f], results: [poles, zeros]}
"""


def config(request, name):
    return load_scene(request.config.rootpath / "configs" / f"{name}.yaml")


def facts(explained):
    return {fact.topic: fact.text for fact in explained.facts}


def scene_of(text):
    return check_source(parse_source(text, "scene.yaml"))


def test_a_graph_is_counted_and_what_no_output_depends_on_is_named():
    told = facts(explain(scene_of(OSCILLATOR)))
    assert told["order"] == "3 states, 3 storage elements"
    assert told["left out"] == "far, y, M and c: no output depends on them"
    assert told["engine"].startswith("exact: 2 storage elements")
    assert told["computes"] == "zeros, poles"


def test_steady_states_are_told_with_their_span(request):
    told = facts(explain(config(request, "duffing_beam")))
    assert told["steady states"] == "harmonic balance, 6 … 10 Hz, force at w_7"


@pytest.mark.parametrize(
    ("mass", "told"),
    [
        ("3", None),
        ("3e-9", None),  # its frequency is 2e4 times that of the others
        ("3e-12", "2e+06; the upper ones are set by k2 = 0.01, small = 3e-12"),
        (
            "3e12",
            "the upper ones are set by m = 2, k2 = 0.01, the lower ones are set by k = 0.04, small = 3e+12",
        ),
    ],
)
def test_elements_of_poles_far_from_the_others_are_named(mass, told):
    text = """
dynid: 1
kind: bond-graph
title: A mass in another unit
graph:
  nodes: {F: Se, one: 1, m: {type: I, value: 2}, k: {type: C, value: 0.04}, b: {type: R, value: 0.7},
          zero: 0, k2: {type: C, value: 0.01}, two: 1, small: {type: I, value: MASS}}
  bonds: [F -> one -> m, one -> k, one -> b, one -> zero -> k2, zero -> two -> small]
analysis: {outputs: [small.f], results: [poles]}
"""
    warning = facts(explain(scene_of(text.replace("MASS", mass)))).get("warning", "")
    assert told in warning if told else warning == ""


@pytest.mark.parametrize(("mass", "warned"), [("1.5", False), ("1.5e-12", True)])
def test_a_degree_of_freedom_far_above_the_others_is_named(request, mass, warned):
    suspension = (request.config.rootpath / "configs" / "suspension.yaml").read_text()
    text = suspension.replace("masses: [2, 2, 1.5, 1, 1]", f"masses: [2, 2, {mass}, 1, 1]")
    warning = facts(explain(scene_of(text))).get("warning", "")
    assert ("the upper ones are set by 3: check the units" in warning) == warned


@pytest.mark.parametrize("stages", [1, 7, 30])
def test_a_chain_of_n_stages_has_2n_states(stages):
    explained = explain(scene_of(chain_scene(stages)))
    assert explained.result.value("bond_graph/causality/order") == 2 * stages
    assert facts(explained)["order"] == f"{2 * stages} states, {2 * stages} storage elements"


def test_causality_is_that_of_the_run(request):
    scene = config(request, "isolator")
    told = explain(scene).result
    done = run_scene(
        check_source(parse_source(scene.source.text.replace("results:", "# results:"), "x.yaml"))
    )
    assert "bond_graph/causality/bonds" in told
    assert told.value("bond_graph/causality/order") == 2  # I_f follows m_s and the source
    assert [row["nodes"] for row in told["bond_graph/causality/dependent_storages"].data] == [
        "I_f, m_s, v_in, tuning"
    ]
    assert done.value("bond_graph/properties/m_s.f/v_in/order") == 2


@pytest.mark.parametrize("name", ["table2", "table4"])
def test_bounds_are_those_of_the_run(request, name):
    scene = config(request, name)
    told, done = explain(scene).result, run_scene(scene)
    bounds = told["identification/identifiability/bound"].data
    assert np.allclose(bounds, done["identification/parameters/cramer_rao"].data, rtol=1e-6)


def test_a_record_is_described(request):
    told = facts(explain(config(request, "table2")))
    assert told["model"].startswith("5 DOFs: 10 physical states; 4 unknown of 4 joint parameters")
    assert told["record"].startswith("800 samples of 2 channels every 0.002 s: 1,600 values")
    assert "ω x step is 0.5, 12.6 samples a period" in told["sampling"]  # 250 rad/s times 0.002 s


DEAF = """
dynid: 1
kind: identification
structure: {lumped: {masses: [1, 1], links: [{dofs: [2], k: 50}]}}
joints:
  seen: {dofs: [1], k: {start: 90, true: 100}, c: {start: 1, true: 1}}
  idle: {dofs: [2], k: {start: 100, true: 100}}
excitation: {dof: 1, kind: sine, amplitude: 1, frequency: 8}
measurement: {step: 0.05, samples: 200, channels: [{dof: 1, quantity: velocity}],
              simulate: {noise_ratio: 0.01}}
"""


def test_what_a_record_cannot_see_is_named_and_is_what_the_run_says(dynid, folder):
    (folder / "deaf.yaml").write_text(DEAF)
    code, out, err = dynid("check", "--explain", "deaf.yaml")
    assert err == ""
    assert "idle.k not identifiable" in out
    done, _, said = dynid("run", "deaf.yaml")
    assert done == code == 0
    assert "not converged: idle.k is not identifiable" in said
    (folder / "deafer.yaml").write_text(
        DEAF.replace("{dof: 1, quantity", "{dof: 2, quantity").replace("idle: {dofs: [2]", "idle: {dofs: [1]")
    )
    code, out, _ = dynid("check", "--explain", "deafer.yaml")
    assert "a run will fail (exit code 3)" in out
    failed, _, said = dynid("run", "deafer.yaml")
    assert failed == code == 3
    assert said.strip() in out


def test_a_structure_that_cannot_be_held_in_doubles_is_foretold(dynid, folder):
    (folder / "lost.yaml").write_text(DEAF.replace("k: 50", "k: 1e140"))
    code, out, _ = dynid("check", "--explain", "lost.yaml")
    failed, _, said = dynid("run", "lost.yaml")
    assert failed == code == 3
    assert said.strip() in out


def test_the_failure_of_a_singular_graph_is_foretold(dynid, folder):
    text = OSCILLATOR.replace("F -> x,", "F -> x, G -> x,").replace("F: Se,", "F: Sf, G: Sf,")
    (folder / "conflict.yaml").write_text(text)
    code, _, err = dynid("check", "--explain", "conflict.yaml")
    failed, _, said = dynid("run", "conflict.yaml")
    assert (code, err) == (failed, said) == (3, said)


def test_bases_are_those_of_the_run(request):
    scene = config(request, "beam_reduction")
    told, done = facts(explain(scene)), run_scene(scene)
    assert told["model"] == "15 DOFs, 2 joints"
    size = done["reduction/serep/coordinate"].data.size
    assert told["bases"].startswith(f"serep: {size} coordinates; masters theta_1, w_4, w_6; 3 modes")
    assert told["modes"].startswith("the lowest 4, by dense matrices")


def test_a_basis_of_modes_alone_has_no_masters():
    modal = LARGE.replace("elements: 300", "elements: 5")
    modal = f"{modal[: modal.index('  - {method: craig')]}  - {{method: modal, modes: [1, 2]}}\n"
    assert facts(explain(scene_of(modal)))["bases"] == "modal: 2 coordinates; 2 modes (those named are kept)"


NODE = """
dynid: 1
kind: reduction
structure:
  lumped: {masses: [1, 1, 1], links: [{dofs: [1], k: 1}, {dofs: [1, 2], k: 1}, {dofs: [2, 3], k: 1},
                                      {dofs: [3], k: 1}]}
reduction:
  - {method: serep, masters: [2], modes: [2]}
"""


def test_a_basis_that_does_not_exist_is_foretold(dynid, folder):
    """The second mode of three equal masses between walls has a node at its only master."""
    (folder / "node.yaml").write_text(NODE)
    code, out, _ = dynid("check", "--explain", "node.yaml")
    failed, _, said = dynid("run", "node.yaml")
    assert failed == code == 3
    assert said.strip() in out


def test_a_structure_that_does_not_exist_is_foretold(dynid, folder):
    block = "joints: {j: {dofs: [1, 2], k: [[1, 2], [2, 1]]}}\n"
    (folder / "block.yaml").write_text(NODE + block)
    code, _, err = dynid("check", "--explain", "block.yaml")
    failed, _, said = dynid("run", "block.yaml")
    assert (code, err) == (failed, said)
    assert failed != 0


RESPONDING = """
dynid: 1
kind: identification
structure: {lumped: {masses: [1, 1], links: [{dofs: [1], k: 50, c: 1}, {dofs: [1, 2], k: 20}]}}
"""
PARTS = {
    "modes": ("modes: {count: 2}", "modes"),
    "frequency": (
        "frequency: {start: 1, stop: 9, points: 700}, inputs: [1]",
        "frequency response at 700 frequencies",
    ),
    "time": ("time: {stop: 40, step: 0.1, input: {dof: 1, kind: step}}", "time response at 401 samples"),
}


@pytest.mark.parametrize("asked", [["modes"], ["frequency"], ["time"], ["modes", "frequency", "time"]])
def test_the_responses_of_a_structure_are_told_as_they_are_run(asked):
    blocks, said = zip(*(PARTS[name] for name in asked), strict=True)
    scene = scene_of(f"{RESPONDING}analysis: {{outputs: [{{dof: 2}}], {', '.join(blocks)}}}\n")
    assert facts(explain(scene))["responses"] == ", ".join(said)


SEEN = DEAF.replace("  idle: {dofs: [2], k: {start: 100, true: 100}}\n", "")


def test_sampling_is_told_where_the_excitation_has_a_band():
    assert facts(explain(scene_of(SEEN)))["sampling"].startswith("excited up to 8 rad/s")
    swept = "chirp, amplitude: 1, start: 9, stop: 2"
    told = facts(explain(scene_of(SEEN.replace("sine, amplitude: 1, frequency: 8", swept))))
    assert told["sampling"].startswith("excited up to 9 rad/s")
    coarse = facts(explain(scene_of(SEEN.replace("step: 0.05", "step: 0.5"))))
    assert coarse["sampling"] == (
        "the excitation may reach half the sampling rate, 6.283 rad/s, and beyond: between samples it is as "
        "its hold says"
    )
    edge = facts(explain(scene_of(SEEN.replace("sine, amplitude: 1, frequency: 8", "step"))))
    assert edge["sampling"].startswith("the excitation may reach half the sampling rate, 62.83 rad/s")


def test_a_ring_down_is_not_said_to_be_excited():
    before, _, after = SEEN.partition("excitation:")
    free = f"{before}initial: {{1: {{v: 1}}}}\n{after.partition(chr(10))[2]}"
    assert facts(explain(scene_of(free)))["sampling"].startswith("no excitation is given; half the sampling")


def test_a_record_of_a_structure_that_was_condensed():
    text = SEEN.replace("masses: [1, 1]", "masses: [1, 1, 1]").replace(
        "[{dofs: [2], k: 50}]", "[{dofs: [1, 2], k: 50}, {dofs: [2, 3], k: 30}, {dofs: [3], k: 20}]"
    )
    told = facts(explain(scene_of(f"{text}reduction: {{method: guyan, masters: [1, 3]}}\n")))
    assert told["model"].startswith("3 DOFs reduced by guyan to 2: 4 states; 2 unknown of 2")
    assert told["basis"] == "2 masters; condition of the slaves' stiffness 1"
    told = facts(explain(scene_of(f"{text}reduction: {{method: joint-aware, modes: [1, 3]}}\n")))
    assert told["basis"].startswith("2 modes")


def test_where_nothing_tells_the_memory_it_is_guessed(monkeypatch):
    assert 10 < peak_megabytes() < 100_000
    monkeypatch.setitem(sys.modules, "resource", None)
    assert peak_megabytes() == 100


def test_a_cut_and_alternatives_are_announced():
    asked = "results: [poles, zeros], port: x -> m}\naccuracy: {budget: 7}\n"
    told = facts(explain(scene_of(OSCILLATOR.replace("results: [poles, zeros]}", asked))))
    assert told["port"].startswith("cut at x -> m")
    assert told["accuracy"] == "alternatives of engine are tried after it, for at most 7 s"


RATIOS = """
dynid: 1
kind: bond-graph
graph:
  nodes: {F: Sf, a: 0, n: {type: TF, value: 0.3}, p: {type: TF, value: 3}, c: 0, q: {type: TF, value: 0.1},
          b: 0, m: {type: I, value: 2}, r: {type: R, value: 1}}
  bonds: [F -> a, a -> n -> b, a -> p -> c -> q -> b, b -> m, b -> r]
analysis: {inputs: [F], outputs: [m.f], results: [poles]}
"""


def test_numbers_are_read_as_the_run_reads_them():
    """In decimals 3 times 0.1 is 0.3, so that one of two paths is redundant; in doubles it is not."""
    words = "is not determined: this part floats, or a loop through it has no unique solution"
    assert words in facts(explain(scene_of(RATIOS)))["warning"]
    assert "warning" not in facts(explain(scene_of(RATIOS.replace("[poles]", "[poles], reading: binary"))))


def test_formulas_are_announced_with_their_limits():
    explained = explain(
        scene_of(OSCILLATOR.replace("[poles, zeros]", "[transfer_function], engine: symbolic"))
    )
    assert facts(explained)["engine"].startswith("symbolic: ")


def test_everything_that_can_be_asked_is_asked():
    grids = "frequency: {start: 1, stop: 2, points: 5}, time: {stop: 1, step: 0.1}"
    every = scene_of(OSCILLATOR.replace("[poles, zeros]", f"[{', '.join(RESULTS)}], {grids}"))
    told = facts(explain(every))
    assert "not requested" not in told
    assert told["computes"] == ", ".join(RESULTS).replace("_", " ")


def test_the_float_engine_says_why_and_what_it_cannot():
    scene = scene_of(chain_scene(250).replace("results: [", "results: [poles, "))
    explained = explain(scene)
    told = facts(explained)
    assert told["engine"].startswith(
        "float: 500 storage elements; chosen by default: exact zeros and poles up to 400"
    )
    assert any("error estimates" in fact.text for fact in explained.facts)


LARGE = """
dynid: 1
kind: reduction
structure:
  beam: {elements: 300, length: 10, EI: 150, rhoA: 0.8, supports: [{node: 1, fix: [w, theta]}]}
reduction:
  - {method: craig-bampton, masters: [w_150, w_301], modes: {count: 10}}
  - {method: guyan, masters: {count: 12, choose: qr}}
"""


def test_bases_of_a_large_structure_are_not_made_to_be_explained():
    explained = explain(scene_of(LARGE))
    told = facts(explained)
    assert told["model"] == "600 DOFs, 0 joints"
    assert told["bases"] == "craig-bampton: masters w_150, w_301; modes count 10"
    assert told[""] == "guyan: masters count 12, choose qr"
    assert told["modes"].startswith("the lowest 12, by sparse Lanczos")


@pytest.fixture
def explained_by(monkeypatch):
    """Let another function explain scenes in the separate process."""

    def change(function):
        monkeypatch.setattr(
            "dynid.trial.messages",
            lambda _, *arguments, seconds: messages(function, *arguments, seconds=seconds),
        )

    return change


def test_a_stage_without_progress_is_cut_off_and_named(dynid, folder, explained_by):
    (folder / "one.yaml").write_text(OSCILLATOR)
    explained_by("tests.doomed:explains_and_never_ends")
    code, out, err = dynid("check", "--explain", "one.yaml")
    assert (code, err) == (0, "")
    said = " ".join(out.split())
    assert "graph 2 nodes cost more than 5 s (a trial run" in said
    assert "was cut off: after 5 s of processor time it was at 'poles of loop 7', which has no" in said


def test_an_explanation_without_an_end_is_cut_off_and_named(dynid, folder, explained_by):
    (folder / "one.yaml").write_text(OSCILLATOR)
    explained_by("tests.doomed:begins_and_never_ends")
    code, out, err = dynid("check", "--explain", "one.yaml")
    assert (code, err) == (0, "")
    assert "one.yaml: valid (bond-graph: Oscillator)" in out
    assert "the explanation is not complete: after 5 s of processor time it was at 'assigning" in out


def test_where_no_process_can_be_started_a_scene_is_explained_in_this_one(dynid, folder, monkeypatch):
    (folder / "one.yaml").write_text(OSCILLATOR)
    separate = dynid("check", "--explain", "one.yaml")
    monkeypatch.setattr("dynid.trial.messages", lambda *_, **__: None)
    here = dynid("check", "--explain", "one.yaml")
    assert [line for line in here[1].splitlines() if "cost" not in line] == [
        line for line in separate[1].splitlines() if "cost" not in line
    ]
    assert (here[0], here[2]) == (separate[0], separate[2]) == (0, "")


def test_an_unforeseen_error_of_an_explanation_is_not_hidden():
    with pytest.raises(RuntimeError, match="KeyError 'x'"):
        _received([{"progress": "a"}, {"unforeseen": "KeyError 'x'"}])


STUDY = """
dynid: 1
kind: study
scene: one.yaml
vary: {graph.nodes.m.value: {values: [1, 2, 3]}}
collect: [bond_graph/transfer_function]
"""


def test_a_study_counts_what_is_left_and_says_why_samples_run_alone(dynid, folder):
    (folder / "one.yaml").write_text(OSCILLATOR)
    (folder / "s.yaml").write_text(STUDY)
    _, out, _ = dynid("check", "--explain", "s.yaml")
    assert "samples        3 by grid over graph.nodes.m.value" in out
    assert "finished       none in s.h5" in out
    assert "batched        yes" in out
    assert dynid("study", "s.yaml", "--executor", "serial", "-q")[0] == 0
    assert "3 of them, in s.h5" in dynid("check", "--explain", "s.yaml")[1]
    (folder / "s.yaml").write_text(
        STUDY.replace("graph.nodes.m.value: {values: [1, 2, 3]}", "analysis.engine: {values: [exact, float]}")
    )
    assert "no, one by one: analysis.engine is no parameter" in dynid("check", "--explain", "s.yaml")[1]


@pytest.mark.parametrize("name", ["isolator", "table2", "beam_reduction", "beam_frf", "half_car"])
def test_a_file_is_as_large_as_was_said_within_a_factor(request, tmp_path, name):
    scene = config(request, name)
    said = trial(scene).kilobytes
    write_result(run_scene(scene), tmp_path / "x.h5")
    size = (tmp_path / "x.h5").stat().st_size / 1000
    assert size / 1.5 <= said <= 1.5 * size


def test_a_failure_that_only_the_run_shows_is_foretold(dynid, folder, monkeypatch):
    def fails(_):
        raise Singular("the search does not end", names=["m"])

    (folder / "one.yaml").write_text(OSCILLATOR)
    monkeypatch.setattr("dynid.trial.messages", lambda *_, **__: None)
    monkeypatch.setattr("dynid.scene.run.run_scene", fails)
    code, out, _ = dynid("check", "--explain", "one.yaml")
    assert code == 3
    assert "a run will fail (exit code 3):\n  one.yaml:6:24: the search does not end" in out
    assert "cost" not in out


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.01, "well under a second"),
        (1.2, "about a second"),
        (3.4, "about 3 s"),
        (42.3, "about 42 s"),
        (200, "about 3 min"),
        (36_000, "about 10 h"),
        (math.pi * 1e6, "about 870 h"),
    ],
)
def test_times_are_said_as_well_as_they_are_known(seconds, text):
    assert seconds_text(seconds) == text


@pytest.mark.parametrize(("size", "text"), [(640, "0.6 kB"), (3.2e7, "32 MB"), (4.6e9, "5 GB")])
def test_sizes_are_said_with_one_or_two_digits(size, text):
    assert size_text(size) == text


def test_faults_are_said_as_without(dynid, folder):
    (folder / "bad.yaml").write_text(OSCILLATOR.replace("value: 2", "valu: 2"))
    assert dynid("check", "--explain", "bad.yaml") == dynid("check", "bad.yaml")
    assert dynid("check", "--explain", "-q", "small.yaml")[1] == ""


def test_a_missing_file_has_its_place_before_the_run_as_in_it(dynid, folder):
    dynid("new", "record", "--no-schema")
    (folder / "record.csv").unlink()
    said = dynid("run", "record.yaml")
    code, _, err = dynid("check", "--explain", "record.yaml")
    assert code == said[0] == 4
    assert said[2] in err  # which tells of the force as well, of the same file
    assert re.fullmatch(r"(record.yaml:\d+:\d+: record.csv is no file.*\n){2}", err)


UNKNOWN = """
dynid: 1
kind: identification
parameters: {k0: {start: 10, true: 20}}
structure:
  lumped: {masses: [2, 1], links: [{dofs: [1], k: 5*k0, c: 1}]}
joints:
  j: {dofs: [1, 2], k: k0, c: 1}
excitation: {dof: 2, kind: sine, frequency: 3}
measurement:
  step: 0.01
  samples: 100
  channels: [{dof: 2, quantity: velocity}]
  simulate: {noise_ratio: 0.05, seed: 1}
estimator: {loss: huber}
"""


def test_unknown_parameters_and_hubers_loss_are_told():
    told = facts(explain(scene_of(UNKNOWN)))
    assert told["model"] == "2 DOFs: 4 physical states; 1 unknown parameter"
    assert "Huber" in told["estimator"]
    found = run_scene(scene_of(UNKNOWN))
    assert found.group_attrs["identification"]["loss"] == "huber"


def test_causality_alone_is_explained_where_a_variable_is_not_determined():
    text = """
dynid: 1
kind: bond-graph
graph: {nodes: {u: Se, r: {type: R, value: 1}, a: 0, b: 0}, bonds: [u -> r, a -> b]}
analysis: {outputs: [b.e], results: [causality]}
"""
    told = explain(scene_of(text))
    assert told.obstacle is None
    assert "the effort of 'a' and 'b' is not determined" in facts(told)["warning"]
    more = explain(scene_of(text.replace("[causality]", "[causality, properties]")))
    assert isinstance(more.obstacle, Singular)
    contradictory = text.replace("b: 0", "b: 0, f: Sf, g: Sf, c: 1").replace("[u", "[f -> c, c -> g, u")
    assert isinstance(explain(scene_of(contradictory)).obstacle, Singular)


def test_an_analysis_of_an_identified_graph_that_has_no_solution_is_foretold():
    text = """
dynid: 1
kind: identification
graph: {nodes: {u: Se, r: {type: R, value: r}, a: 0, b: 0}, bonds: [u -> r, a -> b]}
parameters: {r: {start: 1}}
analysis: {outputs: [b.e], results: [poles]}
"""
    told = explain(scene_of(text))
    assert isinstance(told.obstacle, Singular)
    assert "graph" in facts(told)


BRANCHES = """
dynid: 1
kind: identification
parameters:
  {Ra: {start: 2, true: 1}, La: {start: 0.3, true: 0.5}, Rb: {start: 3, true: 4}, Lb: {start: 0.4, true: 0.2}}
graph:
  nodes: {V: Se, u: 0, a: 1, ra: {type: R, value: Ra}, la: {type: I, value: La},
          b: 1, rb: {type: R, value: Rb}, lb: {type: I, value: Lb}}
  bonds: [V -> u, u -> a, a -> ra, a -> la, u -> b, b -> rb, b -> lb]
excitation: [{source: V, kind: random, amplitude: 5, seed: 2}]
measurement: {step: 0.05, samples: 400, channels: [{output: V.f}], simulate: {noise_ratio: 0.01, seed: 1}}
"""


def test_interchangeable_branches_are_named_before_a_run_and_reported_after_it():
    scene = scene_of(BRANCHES)
    group, said = (
        "identification/identifiability/interchangeable",
        "(Ra, La) and (Rb, Lb) are interchangeable",
    )
    explained = explain(scene).result
    assert explained.value(f"{group}/set").tolist() == [said]
    assert explained.value(f"{group}/optima") == 2
    assert any(said in line for line in section_lines(identifiability_sections(explained)))
    result = run_scene(scene)
    assert result.value("identification/diagnostics/equivalent_optima") == 2
    found = result.value("identification/equivalent_optima/estimate")
    np.testing.assert_allclose(found[np.argsort(found[:, 0])], [[1, 0.5, 4, 0.2], [4, 0.2, 1, 0.5]], rtol=0.1)
    warned = [text for text in result.value("identification/diagnostics/warnings") if text.startswith(said)]
    assert len(warned) == 1
    assert "la.e" in warned[0] or "lb.e" in warned[0]
