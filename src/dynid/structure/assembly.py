"""Assemblies of nodes and elements, with supports, masses and springs at nodes; assemblies of structures.

Matrices of several structures are block-diagonal; their DOFs and nodes are named ``PART.NAME``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.dependent import Dependent, Real, like_terms
from dynid.arrays import Array
from dynid.defaults import DENSE_STRUCTURES
from dynid.errors import UsageError
from dynid.number_format import counted
from dynid.parameters import Parameter
from dynid.structure.damping import ModalDamping, ModalPart, ProportionalDamping
from dynid.structure.joints import Joint
from dynid.structure.labels import Label, Node, Nodes, Outline
from dynid.structure.matrices import DependentMatrix, Matrix, as_array
from dynid.structure.model import StructuralModel, Term


@dataclass(frozen=True)
class Support:
    """Directions in which a node cannot move."""

    node: int
    fix: tuple[str, ...]


@dataclass(frozen=True)
class PointMass:
    """A mass at a node, kg, with rotary inertia J, kg·m2."""

    node: int
    m: Real = 0.0
    J: Real = 0.0


@dataclass(frozen=True)
class Spring:
    """A spring and damper from a node to ground, along one of its directions."""

    node: int
    direction: str
    k: Real = 0.0
    c: Real = 0.0
    eta: Real = 0.0  # loss factor of k


def node_label(direction: str, node: int) -> str:
    """Return the label of a node's DOF, such as ``w_4``."""
    return f"{direction}_{node}"


def free_labels(nodes: int, directions: Sequence[str], fixed: Iterable[tuple[str, int]]) -> list[str]:
    """Return the labels of the free DOFs, node by node."""
    held = set(fixed)
    return [
        node_label(direction, node)
        for node in range(1, nodes + 1)
        for direction in directions
        if (direction, node) not in held
    ]


class Assembly:
    """Sums of blocks over labelled DOFs; DOFs that are not among the labels are held and left out.

    `dofs`: labels of the DOFs (n); `sparse`: True for sparse sums; default: where there are many DOFs.
    """

    def __init__(self, dofs: Sequence[Label], *, sparse: bool | None = None) -> None:
        if not dofs:
            raise UsageError("the supports leave nothing to move")
        self.dofs = tuple(dofs)
        self._sparse = len(self.dofs) > DENSE_STRUCTURES.value if sparse is None else sparse
        self._places = {label: index for index, label in enumerate(self.dofs)}
        self._blocks: dict[str, list[tuple[NDArray[np.intp], DependentMatrix]]] = {
            letter: [] for letter in "MCKH"
        }

    def add(self, letter: str, dofs: Sequence[Label], block: DependentMatrix) -> None:
        """Add a block (d x d) over d DOFs to ``M``, ``C``, ``K`` or ``H``."""
        places = np.array([self._places.get(label, -1) for label in dofs])
        self._blocks[letter].append((places, block))

    def add_stiffness(self, dofs: Sequence[Label], block: DependentMatrix, eta: Real) -> None:
        """Add a stiffness (d x d) over d DOFs and its structural damping, of the loss factor `eta`."""
        not_negative("a loss factor eta", eta)
        self.add("K", dofs, block)
        if eta:
            self.add("H", dofs, block.times(eta))

    def attach(
        self, masses: Iterable[PointMass], springs: Iterable[Spring], translations: Sequence[str]
    ) -> None:
        """Add masses, which move along all `translations`, and springs to ground."""
        for mass in masses:
            parts = {**dict.fromkeys(translations, mass.m), "theta": mass.J}
            for direction, value in parts.items():
                self._point("M", direction, mass.node, value)
        for spring in springs:
            self._point("K", spring.direction, spring.node, spring.k)
            self._point("C", spring.direction, spring.node, spring.c)
            if spring.eta:
                self._point("H", spring.direction, spring.node, spring.k * spring.eta)

    def _point(self, letter: str, direction: str, node: int, value: Real) -> None:
        if letter == "M" or not isinstance(value, Dependent):
            not_negative(f"the value at node {node}", value)
        if value:
            self.add(letter, [node_label(direction, node)], DependentMatrix(np.eye(1)).times(value))

    def sum(self, letter: str) -> DependentMatrix:
        """Return the sum of what was added, its patterns those of the different coefficients."""
        blocks = self._blocks[letter]
        dependent = [
            (places, coefficient, pattern) for places, block in blocks for coefficient, pattern in block.terms
        ]
        patterns: dict[int, tuple[Dependent, list[tuple[NDArray[np.intp], Matrix]]]] = {}
        multiples = like_terms([coefficient for _, coefficient, _ in dependent])
        for (factor, core), (places, _, pattern) in zip(multiples, dependent, strict=True):
            patterns.setdefault(id(core), (core, []))[1].append((places, factor * pattern))
        return DependentMatrix(
            self._summed([(places, block.constant) for places, block in blocks]),
            tuple((core, self._summed(parts)) for core, parts in patterns.values()),
        )

    def _summed(self, blocks: Sequence[tuple[NDArray[np.intp], Matrix]]) -> Matrix:
        n = len(self.dofs)
        rows, columns, values = (np.empty(0, dtype=int), np.empty(0, dtype=int), np.empty(0))
        if blocks:
            rows = np.concatenate([np.repeat(places, len(places)) for places, _ in blocks])
            columns = np.concatenate([np.tile(places, len(places)) for places, _ in blocks])
            values = np.concatenate([as_array(block).ravel() for _, block in blocks])
        free = (rows >= 0) & (columns >= 0)
        rows, columns, values = rows[free], columns[free], values[free]
        if self._sparse:
            from scipy.sparse import coo_array  # heavy import, for large models only

            return coo_array((values, (rows, columns)), shape=(n, n)).tocsc()
        matrix = np.zeros((n, n))
        np.add.at(matrix, (rows, columns), values)
        return matrix

    def model(
        self,
        damping: ProportionalDamping | ModalDamping | None = None,
        joints: Iterable[Joint] = (),
        parameters: Iterable[Parameter] = (),
        nodes: Nodes | None = None,
        *,
        translations: bool = False,
    ) -> StructuralModel:
        """Return the structure, its damping that of `damping` and of what was added."""
        M, C, K = self.sum("M"), self.sum("C"), self.sum("K")
        H = self.sum("H") if self._blocks["H"] else None
        return damped_structure(
            M, C, K, damping, joints, self.dofs, parameters, nodes, translations=translations, H=H
        )


def damped_structure(
    M: DependentMatrix,
    C: DependentMatrix,
    K: DependentMatrix,
    damping: ProportionalDamping | ModalDamping | None = None,
    joints: Iterable[Joint] = (),
    dofs: Sequence[Label] = (),
    parameters: Iterable[Parameter] = (),
    nodes: Nodes | None = None,
    *,
    translations: bool = False,
    H: DependentMatrix | None = None,
) -> StructuralModel:
    """Return the structure of matrices that may depend on parameters, with C, H and those of `damping`."""
    modal: tuple[ModalPart, ...] = ()
    viscous_at = None
    if damping is not None:
        of_modes, modal = damping.of(M, K)
        C = C + of_modes
    if isinstance(damping, ProportionalDamping):
        viscous_at = damping.viscous_at
        if damping.eta:
            H = K.times(damping.eta) if H is None else H + K.times(damping.eta)
    elif damping is not None and H is not None:
        raise UsageError(
            "damping ratios of modes stand beside loss factors eta: one damping of each stiffness is needed",
            remedy="Leave one of them out.",
            names=("damping",),
        )
    if H is not None and viscous_at is not None:
        C, H = C + H.times(1 / viscous_at), None
    matrices = {
        letter: matrix.merged() for letter, matrix in zip("MCKH", (M, C, K, H), strict=True) if matrix
    }
    terms = tuple(
        Term(letter, coefficient, pattern)
        for letter, matrix in matrices.items()
        for coefficient, pattern in matrix.terms
    )
    references: dict[str, Any] = {letter: matrix.reference for letter, matrix in matrices.items()}
    return StructuralModel(
        **references,
        joints=tuple(joints),
        dofs=tuple(dofs),
        parameters=tuple(parameters),
        terms=terms,
        modal=modal,
        nodes=nodes,
        translations=translations,
        viscous_at=viscous_at,
    )


def check_nodes(what: str, items: Iterable[Any], nodes: int, directions: Sequence[str]) -> None:
    """Refuse items with a `node`, from 1, or along directions that do not exist.

    Raises UsageError naming the first.
    """
    for item in items:
        if not 1 <= item.node <= nodes:
            raise UsageError(f"there is no node {item.node} for a {what}", remedy=f"Nodes are 1 to {nodes}.")
        along = item.fix if isinstance(item, Support) else getattr(item, "direction", None)
        for direction in (along,) if isinstance(along, str) else along or ():
            if direction not in directions:
                raise UsageError(f"a node has no direction {direction!r}", remedy=f"It has {directions}.")


def per_element(
    what: str, quantity: Real | Sequence[Real], count: int, *, zero: bool = False
) -> Sequence[Real]:
    """Return a property of each element (count), from one number for all or a list.

    Raises UsageError if the list has another length, or a value is not positive (or with `zero`, is
    negative).
    """
    numbers = list(quantity) if isinstance(quantity, Sequence | np.ndarray) else [quantity]
    if isinstance(quantity, Sequence | np.ndarray) and len(numbers) != count:
        raise UsageError(f"{what} has {counted(len(numbers), 'entry')} for {counted(count, 'element')}")
    values = np.array([float(value) for value in numbers])
    if not np.all(np.isfinite(values) & ((values >= 0) if zero else (values > 0))):
        raise UsageError(f"{what} must be {'finite and not negative' if zero else 'positive'}")
    reals = [value if isinstance(value, Dependent) else np.float64(value) for value in numbers]
    return reals if len(numbers) == count else reals * count


def not_negative(what: str, value: Real) -> None:
    """Refuse a value that is negative or not finite.

    Raises UsageError naming it.
    """
    number = float(value)
    if not (math.isfinite(number) and number >= 0):
        raise UsageError(f"{what} must be finite and not negative, not {number:g}")


def part_name(prefix: str, name: Label) -> str:
    """Return the name in an assembly of a DOF, node, set or motion of a part: ``arm.20:z`` of ``20:z``."""
    return f"{prefix}.{name}"


def assembled_parts(
    parts: Mapping[str, StructuralModel], parameters: Iterable[Parameter] = ()
) -> StructuralModel:
    """Return several structures as one, which nothing joins yet.

    `parts`: the structures by name, none of them reduced, without joints; `parameters`: the unknown
    parameters of all of them; each may stand in several.
    """
    sizes = [model.size for model in parts.values()]
    starts, n = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(int), sum(sizes)
    sparse = n > DENSE_STRUCTURES.value or any(model.is_sparse for model in parts.values())

    def placed(matrix: Matrix, start: int) -> Matrix:
        """Return a matrix of the part whose first DOF is at `start` as one of the assembly (n x n)."""
        if sparse:
            from scipy.sparse import coo_array, csc_array  # heavy import, for large models only

            triplets: Any = coo_array(matrix)
            return csc_array((triplets.data, (triplets.row + start, triplets.col + start)), shape=(n, n))
        dense = np.zeros((n, n))
        dense[start : start + matrix.shape[0], start : start + matrix.shape[0]] = as_array(matrix)
        return dense

    frequencies = {model.viscous_at for model in parts.values()} - {None}
    if len(frequencies) > 1:
        raise UsageError(
            "the parts of the assembly have dampers equivalent at different frequencies",
            remedy="Write one frequency in all of them: it is that of the joints, too.",
            names=("structures",),
        )
    matrices: dict[str, Any] = {}
    terms: list[Term] = []
    modal: list[ModalPart] = []
    for model, start in zip(parts.values(), starts.tolist(), strict=True):
        model.needs_symmetric()
        for letter in "MCKH":
            if getattr(model, letter) is None:
                continue
            block: Any = placed(getattr(model, letter), start)
            matrices[letter] = matrices[letter] + block if letter in matrices else block
        terms += [term._replace(matrix=placed(term.matrix, start)) for term in model.terms]
        modal += [part.projected(np.eye(model.size, n, k=start)) for part in model.modal]
    return StructuralModel(
        **matrices,
        dofs=tuple(part_name(name, label) for name, model in parts.items() for label in model.dofs),
        parameters=tuple(parameters),
        terms=tuple(terms),
        modal=tuple(modal),
        nodes=_nodes({name: model.nodes for name, model in parts.items() if model.nodes is not None}),
        motions={
            part_name(name, motion): {part_name(name, label): weight for label, weight in weights.items()}
            for name, model in parts.items()
            for motion, weights in model.motions.items()
        },
        translations=all("unknown" not in model.kinds for model in parts.values()),
        viscous_at=next(iter(frequencies), None),
    )


def _nodes(parts: Mapping[str, Nodes]) -> Nodes | None:
    """Return the nodes of all parts that have some."""
    if not parts:
        return None
    numbers: list[Node] = []
    axes: dict[Node, Array] = {}
    sets: dict[str, tuple[Node, ...]] = {}
    lines: list[Outline] = []
    for name, nodes in parts.items():
        numbers += [part_name(name, node) for node in nodes.numbers]
        axes |= {part_name(name, node): own_axes for node, own_axes in nodes.axes.items()}
        sets |= {
            part_name(name, set_name): tuple(part_name(name, node) for node in listed)
            for set_name, listed in nodes.sets.items()
        }
        lines += [tuple(part_name(name, node) for node in line) for line in nodes.lines]
    xyz = np.concatenate([nodes.xyz for nodes in parts.values()])
    notes, doubts = (
        tuple(f"{name}: {said}" for name, nodes in parts.items() for said in getattr(nodes, which))
        for which in ("notes", "doubts")
    )
    return Nodes(tuple(numbers), xyz, axes, sets, tuple(lines), notes, doubts)
