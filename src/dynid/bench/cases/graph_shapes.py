"""Whole analyses of large graphs of several shapes, with all default results, beside a script of SciPy.

Lattices of capacitors joined by resistors, ladders of the same, and chains of masses, springs and dampers;
a unit flow or force enters at one end, and the other end is read. Scenes are read before the clock starts,
but where reading is the work.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from dynid.bench.benchmark import Alternative, Benchmark

#: Angular frequencies of the responses, rad/s.
_OMEGA = np.logspace(-2, 1, 100)


class _Network:
    """Nodes with a capacitance to ground, joined by resistors; a conductance leads from the first to ground.

    The last node is the output.
    """

    def __init__(self, joints: list[tuple[int, int]], count: int) -> None:
        self.count, self.ground = count, 0.5
        self.capacitances = [1 + 0.1 * (3 * node % 5) for node in range(count)]
        self.joints = [(*ends, 1 + 0.3 * (k % 3)) for k, ends in enumerate(joints)]

    def scene(self, *results: str) -> Any:
        """Return the analysis of the bond graph."""
        nodes: dict[str, Any] = {"u": "Sf", "ground": {"type": "R", "value": 1 / self.ground}}
        bonds = ["u -> n0", "n0 -> ground"]
        for node, value in enumerate(self.capacitances):
            nodes |= {f"n{node}": 0, f"c{node}": {"type": "C", "value": value}}
            bonds.append(f"n{node} -> c{node}")
        for k, (tail, head, value) in enumerate(self.joints):
            nodes |= {f"j{k}": 1, f"r{k}": {"type": "R", "value": value}}
            bonds += [f"n{tail} -> j{k} -> n{head}", f"j{k} -> r{k}"]
        return _analysis(nodes, bonds, f"c{self.count - 1}.e", *results)

    def matrices(self) -> tuple[Any, Any]:
        """Return the conductances between nodes, sparse, and the capacitances."""
        from scipy.sparse import coo_array

        tails, heads, values = (np.array(column) for column in zip(*self.joints, strict=True))
        rows = np.concatenate([tails, heads, tails, heads, [0]])
        columns = np.concatenate([tails, heads, heads, tails, [0]])
        conductances = np.concatenate([1 / values, 1 / values, -1 / values, -1 / values, [self.ground]])
        shape = self.count, self.count
        return coo_array((conductances, (rows, columns)), shape=shape).tocsc(), np.array(self.capacitances)


def _analysis(nodes: dict[str, Any], bonds: list[str], output: str, *results: str) -> Any:
    from dynid.scene.load import check_source
    from dynid.scene.yaml.source import built_source

    analysis: dict[str, Any] = {"inputs": ["u"], "outputs": [output], "results": list(results)}
    if "frequency_response" in results:
        analysis["frequency"] = {"start": 0.01, "stop": 10, "points": len(_OMEGA), "unit": "rad/s"}
    graph = {"nodes": nodes, "bonds": bonds}
    data = {"dynid": 1, "kind": "bond-graph", "title": "bench", "graph": graph, "analysis": analysis}
    return check_source(built_source(data, "<bench>"))


def _lattice(side: int) -> _Network:
    across = [(k, k + 1) for k in range(side * side) if (k + 1) % side]
    return _Network([*across, *((k, k + side) for k in range(side * (side - 1)))], side * side)


def _ladder(rungs: int) -> _Network:
    rails = [(k, k + 2) for k in range(2 * rungs - 2)]
    return _Network([*rails, *((2 * k, 2 * k + 1) for k in range(rungs))], 2 * rungs)


def _chain(stages: int) -> tuple[dict[str, Any], list[str]]:
    """Return nodes and bonds of a chain of masses on springs and dampers, the first to ground."""
    nodes: dict[str, Any] = {"u": "Se"}
    bonds = [f"u -> v{stages - 1}"]
    for k, (mass, compliance) in enumerate(zip(*_stages(stages), strict=True)):
        nodes |= {f"v{k}": 1, f"m{k}": {"type": "I", "value": mass}, f"w{k}": 1}
        nodes |= {f"k{k}": {"type": "C", "value": compliance}, f"d{k}": {"type": "R", "value": 0.1}}
        bonds += [f"v{k} -> m{k}", f"w{k} -> k{k}", f"w{k} -> d{k}"]
        if k:
            nodes[f"z{k}"] = 0
            bonds += [f"v{k} -> z{k}", f"z{k} -> w{k}", f"z{k} -> v{k - 1}"]
        else:
            bonds.append("v0 -> w0")
    return nodes, bonds


def _stages(stages: int) -> tuple[list[float], list[float]]:
    return [1 + 0.1 * (k % 7) for k in range(stages)], [0.5 + 0.05 * (k % 5) for k in range(stages)]


def _run(scene: Any) -> Any:
    from dynid.scene.run import run_scene

    result = run_scene(scene)
    if "bond_graph/frequency_response/response" in result:
        return result["bond_graph/frequency_response/response"].data.ravel()
    (group,) = {path.rpartition("/")[0] for path in result if path.endswith("/poles")}
    return result[f"{group}/zeros"].data, result[f"{group}/poles"].data


def _read(text: str) -> int:
    from dynid.scene.load import check_source
    from dynid.scene.yaml.source import parse_source

    return len(check_source(parse_source(text)).model.graph.nodes)


def _composed(text: str) -> int:
    """Parse a scene into PyYAML's tree of texts, in C."""
    import yaml

    tree: Any = yaml.compose(text, Loader=yaml.CSafeLoader)
    for key in ("graph", "nodes"):
        (tree,) = (below for name, below in tree.value if name.value == key)
    return len(tree.value)


def _nodal(matrices: tuple[Any, Any]) -> Any:
    """Factorise the nodal matrix at every frequency."""
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import splu

    conductances, capacitances = matrices
    stored, flow = diags_array(capacitances, format="csc"), np.zeros(len(capacitances), dtype=complex)
    flow[0] = 1.0
    return np.array([_symmetric(splu, conductances + 1j * w * stored).solve(flow)[-1] for w in _OMEGA])


def _symmetric(splu: Callable[..., Any], matrix: Any, order: str = "MMD_AT_PLUS_A") -> Any:
    options = {"SymmetricMode": True}
    return splu(matrix.tocsc(), permc_spec=order, diag_pivot_thresh=0.0, options=options)


def _masses(stages: int) -> Any:
    """Factorise the dynamic stiffness of a chain's masses at every frequency."""
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import splu

    masses, compliances = map(np.array, _stages(stages))

    def joined(rates: Any) -> Any:
        return diags_array([rates + np.append(rates[1:], 0), -rates[1:], -rates[1:]], offsets=[0, 1, -1])

    stiffness, damping = joined(1 / compliances).tocsc(), joined(np.full(stages, 0.1)).tocsc()
    inertia, force = diags_array(masses, format="csc"), np.zeros(stages, dtype=complex)
    force[-1] = 1.0

    def velocity(w: float) -> complex:
        matrix = stiffness + 1j * w * damping - w**2 * inertia
        return complex(1j * w * _symmetric(splu, matrix, "NATURAL").solve(force)[0])

    return np.array(list(map(velocity, _OMEGA)))


def _recursion(stages: int) -> Any:
    """Move the impedance seen from mass to mass, at all frequencies."""
    masses, compliances = _stages(stages)
    s = 1j * _OMEGA
    springs = [1 / (compliance * s) + 0.1 for compliance in compliances]
    seen, ratio = springs[0] + s * masses[0], np.ones_like(s)
    for k in range(1, stages):
        ratio = ratio * springs[k] / (springs[k] + seen)
        seen = s * masses[k] + springs[k] * seen / (springs[k] + seen)
    return ratio / seen


def _eigenvalues(matrices: tuple[Any, Any]) -> Any:
    """Return zeros by QZ on the system's pencil and poles, dense."""
    from scipy.linalg import block_diag, eigvals

    A = -matrices[0].toarray() / matrices[1][:, None]
    size = len(A)
    pencil = np.block([[A, np.eye(size)[:, :1] / matrices[1][0]], [np.eye(size)[-1:], np.zeros((1, 1))]])
    zeros = eigvals(pencil, block_diag(np.eye(size), np.zeros((1, 1))))
    return zeros[np.isfinite(zeros)], np.linalg.eigvals(A)


def _response_error(exact: Callable[[int], Any], size: int, response: Any) -> float:
    """Return the largest distance from another method where the response is a normal number."""
    with np.errstate(all="ignore"):
        true = exact(size)
        normal = np.abs(true) > 1e-280
        return float(np.max(np.abs(response - true)[normal] / np.abs(true)[normal], initial=0.0))


def _roots_error(side: int, roots: Any) -> float:
    """Return the largest error of the poles, those of a symmetric matrix; inf for a wrong number of zeros."""
    from scipy.linalg import eigh

    conductances, capacitances = _lattice(side).matrices()
    poles = eigh(-conductances.toarray(), np.diag(capacitances), eigvals_only=True)
    if len(roots[0]) != (side - 1) ** 2:  # between the corners lie 2 (side - 1) resistors
        return float("inf")
    return float(np.max(np.abs(np.sort(roots[1].real) - poles) / np.abs(poles[0])))


def _scene(network: Callable[[int], _Network], *results: str) -> Callable[[int], Any]:
    return lambda size: _with_text(network(size).scene(*results))


def _with_text(scene: Any) -> Any:
    """Return a scene whose text is written, as it is of a scene that was read: a result has it."""
    scene.to_yaml()
    return scene


def _responses(title: str, size: str, network: Callable[[int], _Network], sizes: Any, full: Any) -> Benchmark:
    def matrices(count: int) -> Any:
        return network(count).matrices()

    return Benchmark(
        title=title,
        size=size,
        sizes=sizes,
        full=full,
        alternatives=(
            Alternative("dynid", _run, _scene(network, "frequency_response")),
            Alternative("sparse-nodal", _nodal, matrices, peer=True),
        ),
        error=partial(_response_error, lambda count: _nodal(matrices(count))),
        measure="largest relative distance from sparse-nodal",
        default=lambda _: "dynid",
    )


MESH_RESPONSE = _responses(
    "Frequency response of a square RC lattice at 100 frequencies, with peaks",
    "side",
    _lattice,
    (20, 40),
    (70, 100),
)
LADDER_PEAKS = _responses(
    "Frequency response of an RC ladder at 100 frequencies, with peaks",
    "rungs",
    _ladder,
    (100, 1000),
    (10_000, 50_000),
)
CHAIN_WHOLE = Benchmark(
    title="Frequency response of a chain of masses at 100 frequencies, with peaks",
    size="stages",
    sizes=(1000, 10_000),
    full=(30_000, 100_000),
    alternatives=(
        Alternative(
            "dynid",
            _run,
            lambda stages: _with_text(_analysis(*_chain(stages), "m0.f", "frequency_response")),
        ),
        Alternative("sparse-nodal", _masses, peer=True),
        Alternative("recursion", _recursion, peer=True),
    ),
    error=partial(_response_error, _recursion),
    measure="largest relative distance from recursion, where the response is above 1e-280",
    default=lambda _: "dynid",
)
CHAIN_READING = Benchmark(
    title="Reading and checking the scene of a chain of masses",
    size="stages",
    sizes=(100, 1000),
    full=(10_000, 30_000),
    alternatives=(
        Alternative("dynid", _read),
        Alternative("built", lambda chain: len(_analysis(*chain, "m0.f").model.graph.nodes), _chain),
        Alternative("compose", _composed, peer=True),
    ),
    error=lambda stages, count: abs(count / (6 * stages) - 1),
    problem=lambda stages: _analysis(*_chain(stages), "m0.f").to_yaml(),
    measure="relative error of the number of nodes",
    default=lambda _: "dynid",
    remark="compose knows neither values nor nodes: it parses YAML into a tree of texts",
)
MESH_ROOTS = Benchmark(
    title="Zeros and poles of a square RC lattice, certified",
    size="side",
    sizes=(10, 14),
    full=(20,),
    alternatives=(
        Alternative("dynid", _run, _scene(_lattice, "zeros", "poles")),
        Alternative("eigvals", _eigenvalues, lambda side: _lattice(side).matrices(), peer=True),
    ),
    error=_roots_error,
    measure="largest error of a pole over the smallest; inf: a wrong number of zeros",
    default=lambda _: "dynid",
    remark="eigvals bounds no error, and does not know how many zeros are finite",
)
