"""Assemblies of several structures: block-diagonal matrices, DOFs and nodes named ``PART.NAME``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from dynid.defaults import DENSE_STRUCTURES
from dynid.parameters import Parameter
from dynid.structure.damping import ModalPart, ModalSum
from dynid.structure.labels import Node
from dynid.structure.matrices import Array, Label, Matrix, as_array
from dynid.structure.model import StructuralModel, Term
from dynid.structure.nodes import Nodes


def part_name(part: str, name: Label) -> str:
    """Return the name in an assembly of a DOF, node, set or motion of a part: ``arm.20:z`` of ``20:z``."""
    return f"{part}.{name}"


def assembled_parts(
    parts: Mapping[str, StructuralModel], parameters: Iterable[Parameter] = ()
) -> StructuralModel:
    """Return several structures as one, which nothing joins yet.

    Parameters
    ----------
    parts
        The structures by name, none of them reduced, without joints.
    parameters
        The unknown parameters of all of them; each may stand in several.
    """
    sizes = [model.size for model in parts.values()]
    starts, n = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(int), sum(sizes)
    sparse = n > DENSE_STRUCTURES.value or any(model.is_sparse for model in parts.values())

    def placed(matrix: Matrix, start: int) -> Matrix:
        """Return a matrix of the part whose first DOF is at `start` as one of the assembly (n x n)."""
        if sparse:
            from scipy.sparse import coo_array, csc_array  # heavy import, for large models only

            one: Any = coo_array(matrix)
            return csc_array((one.data, (one.row + start, one.col + start)), shape=(n, n))
        whole = np.zeros((n, n))
        whole[start : start + matrix.shape[0], start : start + matrix.shape[0]] = as_array(matrix)
        return whole

    matrices: dict[str, Any] = {}
    terms: list[Term] = []
    modal: list[ModalPart | ModalSum] = []
    for model, start in zip(parts.values(), starts.tolist(), strict=True):
        for letter in "MCK":
            block: Any = placed(getattr(model, letter), start)
            matrices[letter] = matrices[letter] + block if letter in matrices else block
        terms += [term._replace(matrix=placed(term.matrix, start)) for term in model.terms]
        if model.modal is not None:
            modal.append(model.modal.projected(np.eye(model.size, n, k=start)))
    return StructuralModel(
        **matrices,
        dofs=tuple(part_name(name, label) for name, model in parts.items() for label in model.dofs),
        parameters=tuple(parameters),
        terms=tuple(terms),
        modal=ModalSum(tuple(modal)) if modal else None,
        nodes=_nodes({name: model.nodes for name, model in parts.items() if model.nodes is not None}),
        motions={
            part_name(name, motion): {part_name(name, label): weight for label, weight in weights.items()}
            for name, model in parts.items()
            for motion, weights in model.motions.items()
        },
    )


def _nodes(parts: Mapping[str, Nodes]) -> Nodes | None:
    """Return the nodes of all parts that have some."""
    if not parts:
        return None
    numbers: list[Node] = []
    axes: dict[Node, Array] = {}
    sets: dict[str, tuple[Node, ...]] = {}
    lines: list[tuple[Node, Node]] = []
    for name, nodes in parts.items():
        numbers += [part_name(name, node) for node in nodes.numbers]
        axes |= {part_name(name, node): own for node, own in nodes.axes.items()}
        sets |= {
            part_name(name, one): tuple(part_name(name, node) for node in listed)
            for one, listed in nodes.sets.items()
        }
        lines += [(part_name(name, first), part_name(name, last)) for first, last in nodes.lines]
    xyz = np.concatenate([nodes.xyz for nodes in parts.values()])
    notes, doubts = (
        tuple(f"{name}: {said}" for name, nodes in parts.items() for said in getattr(nodes, which))
        for which in ("notes", "doubts")
    )
    return Nodes(tuple(numbers), xyz, axes, sets, tuple(lines), notes, doubts)
