"""Nodes of a test matched to those of a model, by number or by position, and their directions to its DOFs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.structure.labels import DIRECTIONS, Label, Node, Nodes, node_direction
from dynid.structure.model import StructuralModel
from dynid.structure.named_dofs import Motion
from dynid.suggestions import shortened

#: Components of a direction below this are those of rounded axes: data sets 18 have six digits.
_AXIS_COMPONENT_TOL = 1e-4
#: Nodes of a model that lie closer than this part of the tolerance are at one place.
_COINCIDENT = 1e-6


@dataclass(frozen=True, eq=False)
class Matching:
    """The rule by which nodes of a test are matched to nodes of a model.

    Raises UsageError if the axes are not orthonormal and right-handed, or positions are compared without a
    tolerance.
    """

    # ``number``, or ``position``: the closest node of the model that has DOFs, or moves rigidly with others;
    # no point.
    by: str = "number"
    # How far a node of the test may lie from its node of the model, m; needed for positions. With numbers and
    # positions of the test it is checked; None: it is not.
    tolerance: float | None = None
    # Origin of the test's coordinates in those of the model (3), m.
    origin: Array = field(default_factory=lambda: np.zeros(3))
    # Directions x, y, z of the test in the coordinates of the model, rows (3 x 3).
    axes: Array = field(default_factory=lambda: np.eye(3))
    # Nodes of the model by nodes of the test, where neither number nor position is right.
    pairs: Mapping[Node, Node] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not np.allclose(self.axes @ self.axes.T, np.eye(3), atol=1e-6) or np.linalg.det(self.axes) < 0:
            raise UsageError(
                "the axes of the test are not orthonormal and right-handed",
                remedy="Rows are its x, y and z in the coordinates of the model.",
                names=("match.axes",),
            )
        if self.by == "position" and self.tolerance is None:
            raise UsageError(
                "nodes matched by position need a 'tolerance'",
                remedy="Give it in m: tolerance: 0.01.",
                names=("match.tolerance",),
            )


def matched_dofs(
    model: StructuralModel,
    places: Sequence[tuple[Node, str]],
    how: Matching,
    test: Nodes | None = None,
) -> list[Motion]:
    """Return the motions of a model that sensors of a test measure.

    `model`: the model. Without nodes of its own, its labels say which DOF is at which node; a structure whose
    DOFs are numbers has one at each node, whatever its direction. `places`: node and direction of each
    sensor, such as ``(20, "-z")``; `how`: where the nodes of the test lie; `test`: nodes of the test with
    their positions and axes. None: directions are those of the model's DOFs.

    Raises UsageError if nodes are not there, lie too far from any, or two lie at one; if a direction has no
    DOFs.

    It returns for each sensor the weights of the DOFs, by their own labels: one DOF, or motion of the model,
    with weight 1 or -1 where its direction is that of one.
    """
    labels_of_nodes = _by_node(model)
    nodes = _matched_nodes(model, labels_of_nodes, list(dict.fromkeys(node for node, _ in places)), how, test)
    turned = test is not None or not np.array_equal(how.axes, np.eye(3))
    motions: list[Motion] = []
    for measured, along in places:
        sign, bare = (-1.0, along[1:]) if along.startswith("-") else (1.0, along)
        node = nodes[measured]
        here = labels_of_nodes[node]
        parts = {bare: 1.0}
        if "" in here:  # a numbered DOF
            parts = {"": 1.0}
        elif turned:
            parts = _components(model.nodes, node, measured, bare, how, test)
        if not parts.keys() <= here.keys():
            meant = " ".join(f"{weight:+.3g} {name}" for name, weight in parts.items())
            is_along = f", which is {meant} of the model" if turned else ""
            raise UsageError(
                f"{measured}:{along} of the test{is_along}: node {node} of the model has {', '.join(here)}",
                remedy="Leave the channel out, or turn the axes of the test: match: {axes: …}.",
                names=("match.axes", "match"),
            )
        motions.append(_sum_of(model, {here[name]: sign * weight for name, weight in parts.items()}))
    return motions


def _sum_of(model: StructuralModel, weights: Motion) -> Motion:
    """Return a single DOF or motion as it is, a sum of several by the DOFs' own labels."""
    if len(weights) == 1:
        return weights
    total: dict[Label, float] = {}
    for label, weight in weights.items():
        for dof, weight_of_dof in model.motions.get(str(label), {label: 1.0}).items():
            total[dof] = total.get(dof, 0.0) + weight * weight_of_dof
    return total


def _by_node(model: StructuralModel) -> dict[Node, dict[str, Label]]:
    """Return the labels of the DOFs at each node, by direction; of a numbered DOF for all of them.

    Nodes that move rigidly with others have motions in place of DOFs.
    """
    labels: dict[Node, dict[str, Label]] = {}
    for label in model.dofs:
        node, along = (label, "") if isinstance(label, int) else node_direction(label) or (label, "")
        if along and along in labels.get(node, {}):
            raise UsageError(
                f"the DOFs {labels[node][along]} and {label} have one node and direction",
                remedy="List the channels with the labels of the structure.",
            )
        labels.setdefault(node, {})[along] = label
    places = {} if model.nodes is None else model.nodes.places
    for name in model.motions:
        node_at = node_direction(name)
        if node_at is not None and node_at[0] in places:
            labels.setdefault(node_at[0], {}).setdefault(node_at[1], name)
    return labels


def _matched_nodes(
    model: StructuralModel,
    model_nodes: Mapping[Node, object],
    test_nodes: Sequence[Node],
    how: Matching,
    test: Nodes | None,
) -> dict[Node, Node]:
    """Return the node of the model for each node of the test."""
    pairs = {node: how.pairs[node] for node in test_nodes if node in how.pairs}
    missing = [
        f"{node} ({model_node})" for node, model_node in pairs.items() if model_node not in model_nodes
    ]
    if missing:
        raise UsageError(
            f"the model has no nodes with DOFs for nodes of the test: {_listed(missing)}",
            names=("match.nodes",),
        )
    rest = [node for node in test_nodes if node not in pairs]
    if how.by == "position":
        pairs |= _closest(model, model_nodes, rest, how, test)
    else:
        lacking = [str(node) for node in rest if node not in model_nodes]
        if lacking:
            raise UsageError(
                f"the model has no DOFs at {len(lacking)} of the {len(test_nodes)} nodes of the test: "
                f"{_listed(lacking)}; it has some at {_listed([str(node) for node in model_nodes])}",
                remedy="Match by position (match: {by: position, tolerance: …}), or list pairs under "
                "match: {nodes: {TEST: MODEL}}.",
                names=("match",),
            )
        pairs |= {node: node for node in rest}
        if how.tolerance is not None:
            _check_distances(model, pairs, how, test)
    by_model: dict[Node, list[Node]] = {}
    for node, model_node in pairs.items():
        by_model.setdefault(model_node, []).append(node)
    double = [
        f"{' and '.join(map(str, nodes))} at {model_node}"
        for model_node, nodes in by_model.items()
        if len(nodes) > 1
    ]
    if double:
        raise UsageError(
            f"nodes of the test lie at one node of the model: {_listed(double)}",
            remedy="The model is coarser than the test: leave sensors out, or list pairs under match: "
            "{nodes: {TEST: MODEL}}.",
            names=("match",),
        )
    return pairs


def _placed(nodes: Sequence[Node], how: Matching, test: Nodes | None) -> Array:
    """Return nodes of the test in the coordinates of the model (N x 3)."""
    if test is None:
        raise UsageError(
            "the nodes of the test have no positions",
            remedy="Name a Universal File that has them: match: {geometry: FILE}.",
            names=("match.geometry", "match"),
        )
    lacking = [str(node) for node in nodes if node not in test.places]
    if lacking:
        raise UsageError(
            f"the geometry of the test lacks {len(lacking)} of its nodes: {_listed(lacking)}",
            names=("match.geometry", "match"),
        )
    return np.asarray(how.origin + test.xyz[[test.places[node] for node in nodes]] @ how.axes)


def _nodes_of(model: StructuralModel) -> Nodes:
    if model.nodes is None:
        raise UsageError(
            "the nodes of the model have no positions",
            remedy="Match by number, or give the structure its nodes.",
            names=("match.by", "match"),
        )
    return model.nodes


def _closest(
    model: StructuralModel,
    model_nodes: Mapping[Node, object],
    test_nodes: Sequence[Node],
    how: Matching,
    test: Nodes | None,
) -> dict[Node, Node]:
    """Return the closest node of the model for each node of the test."""
    assert how.tolerance is not None
    nodes = _nodes_of(model)
    candidates = [node for node in nodes.numbers if node in model_nodes and node not in nodes.points]
    xyz = nodes.xyz[[nodes.places[node] for node in candidates]]
    pairs: dict[Node, Node] = {}
    far, between = [], []
    for node, point in zip(test_nodes, _placed(test_nodes, how, test), strict=True):
        distances = np.linalg.norm(xyz - point, axis=1)
        at = int(np.argmin(distances))
        pairs[node] = candidates[at]
        here = np.linalg.norm(xyz - xyz[at], axis=1) <= _COINCIDENT * how.tolerance
        if distances[at] > how.tolerance:
            far.append((float(distances[at]), f"{node}: {distances[at]:.4g} m from {candidates[at]}"))
        elif np.count_nonzero(here) > 1:
            several = [str(candidates[k]) for k in np.flatnonzero(here)]
            between.append(f"{node} at {', '.join(several)}")
    if far:
        raise UsageError(
            f"{len(far)} of {len(test_nodes)} nodes of the test lie more than {how.tolerance:g} m from the "
            f"nodes of the model: {_listed([text for _, text in sorted(far, reverse=True)])}",
            remedy="Give the position of the test in the model (match: {origin: …, axes: …}), or a larger "
            "tolerance.",
            names=("match.tolerance", "match"),
        )
    if between:
        raise UsageError(
            f"several nodes of the model are at the place of one of the test: {_listed(between)}",
            remedy="Say which one is meant: match: {nodes: {TEST: MODEL}}.",
            names=("match",),
        )
    return pairs


def _check_distances(
    model: StructuralModel, pairs: Mapping[Node, Node], how: Matching, test: Nodes | None
) -> None:
    """Refuse nodes of one number that lie apart."""
    assert how.tolerance is not None
    nodes = _nodes_of(model)
    for node in pairs.values():
        if node not in nodes.places:
            raise UsageError(f"node {node} of the model has no position", names=("match.tolerance", "match"))
    apart = _placed(list(pairs), how, test) - nodes.xyz[[nodes.places[node] for node in pairs.values()]]
    far = sorted(zip(np.linalg.norm(apart, axis=1).tolist(), pairs, strict=True), key=lambda item: -item[0])
    texts = [f"{node}: {distance:.4g} m" for distance, node in far if distance > how.tolerance]
    if texts:
        raise UsageError(
            f"{len(texts)} of {len(pairs)} nodes of the test lie more than {how.tolerance:g} m from the node "
            f"of the model with their number: {_listed(texts)}",
            remedy="The numbers differ, or the coordinates do: match by position, or give origin and axes.",
            names=("match.tolerance", "match"),
        )


def _components(
    nodes: Nodes | None, node: Node, measured: Node, along: str, how: Matching, test: Nodes | None
) -> dict[str, float]:
    """Return a direction of a node of the test as a sum of the directions of a node of the model."""
    axis = DIRECTIONS.index(along)
    measured_axes = np.eye(3) if test is None else test.axes_of(measured)
    axes = np.eye(3) if nodes is None else nodes.axes_of(node)
    weights = axes @ (measured_axes[axis % 3] @ how.axes)
    weights[np.abs(weights) < _AXIS_COMPONENT_TOL] = 0.0
    weights /= np.linalg.norm(weights)
    names = DIRECTIONS[:3] if axis < 3 else DIRECTIONS[3:]
    return {name: float(weight) for name, weight in zip(names, weights, strict=True) if weight}


def _listed(texts: Sequence[str]) -> str:
    return shortened(texts, separator="; ")
