"""Default results cost at most ten times the requested response or fit, counted on benchmarked shapes."""

import tempfile
from pathlib import Path

import numpy as np
import pytest

from dynid.bench.cases import frequency_response, graph_shapes, long_records, startup, zeros_poles
from dynid.result import Selection
from dynid.scene.kinds import identification
from dynid.scene.kinds.explain_graph import explain
from dynid.scene.load import check_source, load_scene
from dynid.scene.run import run_scene
from dynid.scene.yaml.source import built_source
from dynid.structure import backends
from dynid.structure.modes import sparse
from tests.work import operations_of

CONFIGS = Path(__file__).parents[2] / "configs"
USUAL = {"transfer_function", "zeros", "poles", "properties", "reduction"}
SHAPES = {
    "chain": lambda size: graph_shapes._analysis(*graph_shapes._chain(size), "m0.f").source.data,
    "lattice": lambda side: graph_shapes._lattice(side).scene().source.data,
    "ladder": lambda rungs: graph_shapes._ladder(rungs).scene().source.data,
    "tree": lambda junctions: _data(frequency_response.tree(junctions)),
    "rails": lambda stages: _data(frequency_response.ladder(stages)),
    "mesh": lambda side: _data(zeros_poles._mesh(side)),
}


def _data(reduced):
    """The scene of a graph that a benchmark has built."""
    nodes = {
        name: {"type": node.type} | ({} if node.value is None else {"value": str(node.value)})
        for name, node in reduced.graph.nodes.items()
    }
    bonds = [f"{bond.tail} -> {bond.head}" for bond in reduced.graph.bonds]
    outputs = [str(port) for port in reduced.outputs]
    analysis = {"inputs": list(reduced.inputs), "outputs": outputs}
    return {"dynid": 1, "kind": "bond-graph", "graph": {"nodes": nodes, "bonds": bonds}, "analysis": analysis}


def scene_of(shape, size, results=None, **further):
    data = SHAPES[shape](size)
    analysis = {key: data["analysis"][key] for key in ("inputs", "outputs")}
    analysis["frequency"] = {"start": 0.01, "stop": 10, "points": 100}
    if results is not None:
        analysis["results"] = results
    return check_source(built_source(data | further | {"analysis": analysis}, "<test>"))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("shape", "size"),
    [("chain", 40), ("tree", 80), ("ladder", 90), ("lattice", 12), ("mesh", 3), ("mesh", 5)],
)
def test_default_results_take_few_operations(shape, size):
    scenes = [scene_of(shape, size, results) for results in (["frequency_response"], None)]
    for scene in scenes:  # imports
        run_scene(scene)
    requested, default = (operations_of(run_scene, scene) for scene in scenes)
    assert default < 10 * requested, (requested, default)


RECORDS = {
    "short": lambda: load_scene(
        CONFIGS / "suspension_noisy.yaml"
    ),  # 800 samples of two channels, four unknowns
    "wide": lambda: long_records._scene(1000),  # of sixty channels, twelve unknowns
}


@pytest.mark.thorough
@pytest.mark.usefixtures("complete")
@pytest.mark.parametrize("record", RECORDS)
def test_default_results_of_identifications_take_few_operations(record):
    def requested(scene):
        identification.run(scene, Selection("identification", ["identification/parameters/estimate"]))

    short = RECORDS["short"]()
    for function in (requested, run_scene):  # imports
        function(short)
    scene = RECORDS[record]()
    fit, default = (operations_of(function, scene) for function in (requested, run_scene))
    assert default < 10 * fit, (fit, default)


@pytest.mark.parametrize(
    ("shape", "size"), [("chain", 101), ("tree", 201), ("ladder", 101), ("lattice", 15), ("mesh", 9)]
)
def test_large_graphs_have_their_response_alone(shape, size):
    scene = scene_of(shape, size)
    result = run_scene(scene)
    assert not [path for path in result if path.split("/")[1] in {"transfer_function", "properties"}]
    needs = dict(zip(result["bond_graph/need/part"].data, result["bond_graph/need/why"].data, strict=True))
    assert "list them in 'analysis.results'" in needs["default results"]
    assert any(needs["default results"] in fact.text for fact in explain(scene).facts)
    requested = run_scene(scene_of(shape, size, ["frequency_response"]))
    path = "bond_graph/frequency_response/response"
    np.testing.assert_array_equal(result[path].data, requested[path].data)


def test_large_graphs_have_what_is_expected_of_them_and_all_without_a_response():
    path = "bond_graph/properties/m0.f/u/relative_degree"
    expected = scene_of("chain", 101, expect=[{"path": path, "value": 101}])
    assert run_scene(expected).value(path) == 101
    data = SHAPES["chain"](101)
    analysis = {key: data["analysis"][key] for key in ("inputs", "outputs")}
    alone = run_scene(check_source(built_source(data | {"analysis": analysis}, "<test>")))
    assert alone.value(path) == 101
    assert "bond_graph/transfer_function/m0.f/u/poles" in alone


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("case", "count"), [(startup.MANY_MODES, 2), (startup.PLATE, 2), (startup.CRAIG_BAMPTON, 4)]
)
def test_structures_are_factorised_once_and_once_for_a_proof(monkeypatch, tmp_path, case, count):
    """SEREP shares modes with its comparison; of Craig-Bampton inner and constraint modes share factors."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    rows, factorise = [], backends.factorise

    def counted(matrix, *arguments, **options):
        rows.append(matrix.shape[0])
        return factorise(matrix, *arguments, **options)

    for module in (backends, sparse):
        monkeypatch.setattr(module, "factorise", counted)
    run_scene(load_scene(case.problem(2500) / "plate.yaml"))
    assert len(rows) == count
    assert max(rows) == 2500
