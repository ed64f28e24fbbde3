"""What a result says was left out is what was left out, and what is not needed is not loaded."""

import json
import random
import subprocess
import sys

import numpy as np
import pytest

from dynid.bondgraph.analysis_request import RESULTS
from dynid.errors import DynidError, Singular
from dynid.scene.load import check_source
from dynid.scene.run import run_scene
from dynid.scene.yaml.source import parse_source
from tests.bondgraph.random_graphs import random_graph
from tests.bondgraph.tableau import transfer_at

#: Where the arrays of a bond-graph result stand that somebody asked for.
GROUPS = {
    "causality": "bond_graph/causality/",
    "state_space": "bond_graph/state_space/",
    "frequency_response": "bond_graph/frequency_response/",
    "time_response": "bond_graph/time_response/",
    "sensitivities": "bond_graph/sensitivities/",
    "reduction": "bond_graph/reduction/steps",
}
SPY = """
import sys
import dynid, dynid.scene.run
before = set(sys.modules)
result = dynid.run(sys.argv[1])
print(*sorted(sys.modules))
print(*result)
"""


def run(data):
    return run_scene(check_source(parse_source(json.dumps(data), "scene.yaml")))


def said(result, group):
    """Return what a result says, by part: kept and left out, counted and named, and why."""
    names = ("kept", "left_out", "kept_names", "left_out_names", "why")
    columns = [result[f"{group}/need/{name}"].data for name in names]
    rows = zip(*columns, strict=True)
    found = dict(zip(result[f"{group}/need/part"].data, rows, strict=True))
    for _, left, _, names, why in found.values():
        assert bool(why) == bool(left)  # a reason for what is left out, and for nothing else
        assert not names or len(names.split(", ")) == left
    return found


def graph_scene(types, values, bonds, inputs, output, results):
    nodes = {
        name: {"type": kind, "value": str(values[name])} if name in values else {"type": kind}
        for name, kind in types.items()
    }
    analysis = {
        "inputs": inputs,
        "outputs": [f"{output[0]}.{output[1]}"],
        "results": results,
        "frequency": {"start": 1, "stop": 2, "points": 3},
        "time": {"stop": 0.2, "step": 0.1},
    }
    chains = [f"{a} -> {b}" for a, b in bonds]
    return {
        "dynid": 1,
        "kind": "bond-graph",
        "graph": {"nodes": nodes, "bonds": chains},
        "analysis": analysis,
    }


@pytest.mark.thorough
def test_a_graph_says_what_was_left_out_of_it():
    ran = dropped = 0
    for seed in range(60):
        rng = random.Random(seed)
        types, values, bonds, inputs, output = random_graph(rng, rng.randint(1, 5), rng.choice([0, 0, 1]))
        results = rng.sample(RESULTS, rng.randint(1, 5))
        try:
            result = run(graph_scene(types, values, bonds, inputs[:1], output, results))
        except DynidError:
            continue
        ran += 1
        found = said(result, "bond_graph")
        assert set(found["results"][2].split(", ")) == set(results)
        assert found["results"][0] + found["results"][1] == len(RESULTS)
        for name, start in GROUPS.items():
            assert any(path.startswith(start) for path in result) == (name in results), name
        exact = {
            "transfer_function",
            "zeros",
            "poles",
            "properties",
            "hidden_modes",
            "sensitivities",
            "prototype",
        }
        engines = ["exact"] * bool(exact & set(results)) + ["symbolic"] * ("transfer_function" in results)
        assert found["engines"][2] == ", ".join(engines)
        assert found["elements"][0] + found["elements"][1] == len(types)
        left_out = [name for name in found["elements"][3].split(", ") if name]
        dropped += len(left_out)
        changed = {name: v * 3 if name in left_out else v for name, v in values.items()}
        s = 987654321
        assert transfer_at(types, values, bonds, inputs[:1], output, s) == transfer_at(
            types, changed, bonds, inputs[:1], output, s
        )
        if "states" in found and "poles" in results:
            group = f"bond_graph/transfer_function/{output[0]}.{output[1]}/{inputs[0]}"
            poles = result[f"{group}/poles"].data.size
            assert found["states"][0] >= poles  # hidden ones are states, too
    assert ran > 30
    assert dropped > 10


def chain_scene(rng, **more):
    masses = [rng.uniform(1, 3) for _ in range(rng.randint(4, 7))]
    links = [{"dofs": [1], "k": 2e4, "c": 20}]
    links += [{"dofs": [k, k + 1], "k": rng.uniform(1e4, 4e4), "c": 20} for k in range(1, len(masses) - 1)]
    lumped = {"lumped": {"masses": masses, "links": links}}
    return len(masses), {"dynid": 1, "structure": lumped, **more}


@pytest.mark.parametrize("seed", range(6))
def test_an_identification_says_what_was_left_out_of_it(seed):
    rng = random.Random(seed)
    n, data = chain_scene(rng, kind="identification")
    known = rng.random() < 0.5
    damping = 20 if known else {"start": 10, "true": 20}
    data["joints"] = {"j": {"dofs": [n - 1, n], "k": {"start": 1.5e4, "true": 2e4}, "c": damping}}
    data["excitation"] = [{"dof": n, "kind": "multisine", "amplitude": [100, 100], "frequency": [40, 90]}]
    measured = seed != 5
    size = n
    if measured:
        channels = [{"dof": dof, "quantity": "velocity"} for dof in (n - 1, n)]
        simulate = {"noise_ratio": 0.01, "seed": seed, "model": "reduced" if seed % 2 else "full"}
        data["measurement"] = {"step": 0.004, "samples": 150, "channels": channels, "simulate": simulate}
    if seed % 2:
        size = n - 1
        data["reduction"] = {"method": "serep", "masters": {"count": size}, "modes": {"count": size}}
    if seed > 2:
        data["analysis"] = {"modes": {"count": 2}}
    found = said(run(data), "identification")
    assert found["states"][:2] == (2 * size, 2 * (n - size))
    if seed % 2:
        assert found["coordinates"][:2] == (size, n - size)
        assert found["modes"][:2] == (size, n - size)
        assert f"the lowest {size} are kept" in found["modes"][4]
    unknown = ["j.k"] if known else ["j.k", "j.c"]
    assert found["parameters"][2] == (", ".join(unknown) if measured else "")
    assert found["parameters"][3] == (("j.c" if known else "") if measured else "j.k, j.c")
    assert found["engines"][2] == ("filter, maximum likelihood" if measured else "")
    asked = [*(["parameters"] if measured else []), *(["modes"] if seed > 2 else [])]
    assert found["results"][2] == ", ".join(asked)
    if seed > 2:
        assert found["modes shown"][:2] == (2, size - 2)


def test_a_response_by_modes_says_how_many():
    beam = {"elements": 300, "length": 10, "EI": 150, "rhoA": 0.8}
    found = said(
        run(
            {
                "dynid": 1,
                "kind": "identification",
                "structure": {"beam": {**beam, "supports": [{"node": 1, "fix": ["w", "theta"]}]}},
                "analysis": {
                    "inputs": ["w_301"],
                    "outputs": [{"dof": "w_301"}],
                    "frequency": {"start": 0.1, "stop": 30, "points": 50},
                },
            }
        ),
        "identification",
    )
    kept, left_out, *_ = found["modes of the frequency response"]
    assert 0 < kept < 20  # a cantilever has five modes up to 30 rad/s
    assert kept + left_out == 600


@pytest.mark.parametrize("seed", range(4))
def test_a_reduction_says_what_was_left_out_of_it(seed):
    rng = random.Random(seed)
    n, data = chain_scene(rng, kind="reduction")
    data["joints"] = {"j": {"dofs": [n - 1, n], "k": 2e4}}
    kept = rng.randint(1, n - 2)
    data["reduction"] = [
        {"method": "guyan", "masters": [n - 1, n]},
        {
            "method": "serep",
            "masters": {"count": kept},
            "modes": {"below": 1e4} if kept > n else {"count": kept},
        },
    ]
    if seed % 2:
        data["frequency"] = {"start": 1, "stop": 9, "points": 2}
    result = run(data)
    found = said(result, "reduction")
    for name in ("guyan", "serep"):
        size = len(result[f"reduction/{name}/coordinate"].data)
        assert found[f"coordinates of {name}"][:2] == (size, n - size)
    assert found["modes of serep"][:2] == (kept, n - kept)
    assert "modes of guyan" not in found  # static condensation has none
    assert found["methods"][2] == "serep, guyan"
    assert found["engines"][2] == "dense matrices"
    assert ("frequency_response" in found["results"][2]) == bool(seed % 2)


@pytest.mark.thorough
def test_poles_alone_load_no_symbols_no_figures_no_compiler_and_propagate_nothing(tmp_path):
    data = graph_scene(
        {"u": "Se", "j": "1", "m": "I", "r": "R", "c": "C"}, {"m": 2, "r": 3, "c": "1/5"},
        [("u", "j"), ("j", "m"), ("j", "r"), ("j", "c")], ["u"], ("m", "f"), ["poles"],
    )  # fmt: skip
    path = tmp_path / "poles.yaml"
    path.write_text(json.dumps(data))
    left = subprocess.run(
        [sys.executable, "-c", SPY, str(path)], capture_output=True, text=True, timeout=600, check=True
    )
    modules, arrays = (set(line.split()) for line in left.stdout.splitlines())
    heavy = {"sympy", "matplotlib", "numba", "control", "scipy.signal", "scipy.optimize", "scipy.integrate"}
    assert modules & heavy == set()
    # Neither the propagation nor the engines that are said to be left out were loaded.
    analyses = ("structure", "identification", "lti.time_response", "lti.timeline", "bondgraph.state_space",
                "bondgraph.formulas.transfer", "bondgraph.floating")  # fmt: skip
    absent = tuple(f"dynid.{name}" for name in analyses)
    assert [name for name in modules if name.startswith(absent)] == []
    group = "bond_graph/transfer_function/m.f/u/"
    computed = {path for path in arrays if not path.startswith("bond_graph/need/")}
    assert computed == {f"{group}pole", f"{group}poles", f"{group}pole_error_bound"}


def test_poles_alone_call_no_propagation(monkeypatch):
    def refuse(*_):
        raise AssertionError("a time response was computed")

    monkeypatch.setattr("dynid.lti.refined_response.refined_response", refuse)
    data = graph_scene({"u": "Se", "j": "1", "m": "I", "r": "R"}, {"m": 2, "r": 3},
                       [("u", "j"), ("j", "m"), ("j", "r")], ["u"], ("m", "f"), ["poles"])  # fmt: skip
    found = run(data)["bond_graph/transfer_function/m.f/u/poles"].data
    np.testing.assert_allclose(found, [-1.5])
    data["analysis"]["results"] = ["time_response"]
    with pytest.raises(AssertionError, match="time response"):  # the spy sees one that is asked for
        run(data)


def test_an_undetermined_graph_still_says_what_was_asked():
    data = graph_scene({"u": "Se", "r": "R", "a": "0", "b": "0"}, {"r": 2},
                       [("u", "r"), ("a", "b")], ["u"], ("b", "e"), ["causality"])  # fmt: skip
    assert said(run(data), "bond_graph")["results"][2] == "causality"
    data["analysis"]["results"] = ["poles"]
    with pytest.raises(Singular):
        run(data)
