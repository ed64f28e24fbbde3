"""Solids of isotropic elastic materials from meshes, with consistent mass."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.dependent import Dependent, Real
from dynid.arrays import Array, guarded
from dynid.defaults import DENSE_STRUCTURES
from dynid.errors import UsageError
from dynid.parameters import Parameter
from dynid.structure.assembly import damped_structure, not_negative
from dynid.structure.damping import ModalDamping, ProportionalDamping
from dynid.structure.joints import Joint
from dynid.structure.labels import DIRECTIONS, Nodes
from dynid.structure.matrices import DependentMatrix, Matrix, nothing
from dynid.structure.model import StructuralModel
from dynid.structure.solid_elements import ELEMENTS, Places, integrated, stiffness
from dynid.structure.solid_mesh import Block, SolidMesh, check_elements, doubled_nodes, surface
from dynid.suggestions import did_you_mean, shortened

# Entries of element matrices that are made at once.
_ELEMENT_MATRIX_ENTRIES = 4_000_000
# Beyond this Poisson's ratio fully integrated elements lock under volume-preserving strain.
_INCOMPRESSIBLE = 0.49


@dataclass(frozen=True)
class Material:
    """An isotropic elastic material: Young's modulus, Pa, Poisson's ratio, density, kg/m3, loss factor."""

    E: Real
    nu: float
    rho: Real
    eta: Real = 0.0


@dataclass(frozen=True)
class SetSupport:
    """Directions x, y, z in which all nodes of a set, or one node, cannot move."""

    at: str | int
    fix: tuple[str, ...]


@guarded("the matrices of the solid", UsageError)
def solid(
    mesh: SolidMesh,
    materials: Material | Mapping[str, Material],
    *,
    supports: Iterable[SetSupport] = (),
    damping: ProportionalDamping | ModalDamping | None = None,
    joints: Iterable[Joint] = (),
    parameters: Iterable[Parameter] = (),
) -> StructuralModel:
    """Return the structure of a meshed solid; its free DOFs node by node, ``1:x 1:y 1:z`` first.

    Nodes that belong to no solid element are left out. What may be wrong with the mesh, or too coarse in
    it, is in the nodes' `doubts`.

    Parameters
    ----------
    mesh
        The mesh.
    materials
        The material, or those of its groups of elements.
    supports
        Supports of sets of nodes, or of single nodes.
    damping
        Damping of the material.
    joints
        The joints, between DOFs such as ``20:z``.
    parameters
        Unknown parameters, on which E, rho and damping may depend.

    Raises
    ------
    UsageError
        If elements are folded, inverted or overlap, an element has no material or two, or a set, a node or a
        number makes no sense.
    """
    check_elements(mesh)
    outer = surface(mesh)
    layers = list(_layers(mesh, materials))
    used = np.unique(np.concatenate([block.cells.ravel() for block in mesh.blocks]))
    compact = np.full(len(mesh.xyz), -1)
    compact[used] = np.arange(len(used))
    numbers = [mesh.numbers[node_index] for node_index in used]
    sets = {name: compact[members][compact[members] >= 0] for name, members in mesh.sets.items()}
    free = np.ones((len(used), 3), dtype=bool)
    at = {number: node_index for node_index, number in enumerate(numbers)}
    for node_index, support in enumerate(supports):
        for direction in support.fix:
            free[_supported(node_index, support, sets, at), DIRECTIONS[:3].index(direction)] = False
    if not free.any():
        raise UsageError("the supports leave nothing to move", names=("supports",))
    M, K, H = _matrices(mesh, layers, compact, np.flatnonzero(free))
    labels = [f"{numbers[node]}:{DIRECTIONS[axis]}" for node, axis in np.argwhere(free).tolist()]
    nodes = Nodes(
        tuple(numbers),
        mesh.xyz[used],
        sets={
            name: tuple(numbers[member] for member in members)
            for name, members in sets.items()
            if len(members)
        },
        lines=tuple(
            tuple(numbers[corner] for corner in face)
            for faces in outer.faces
            for face in compact[faces].tolist()
        ),
        doubts=(*mesh.doubts, *_doubts(mesh, layers, outer.parts)),
    )
    C = DependentMatrix(nothing(len(labels), sparse=len(labels) > DENSE_STRUCTURES.value))
    return damped_structure(M, C, K, damping, joints, labels, parameters, nodes, H=H)


class _Layer(NamedTuple):
    """Elements of one material; `members`: for each block the places of its elements."""

    material: Material
    members: tuple[Places, ...]


def _layers(mesh: SolidMesh, materials: Material | Mapping[str, Material]) -> Iterator[_Layer]:
    """Yield the materials with their elements."""
    if isinstance(materials, Material):
        _check("the material", "materials", materials)
        yield _Layer(materials, tuple(np.arange(len(block.cells)) for block in mesh.blocks))
        return
    layer_of_element = [np.full(len(block.cells), -1) for block in mesh.blocks]
    names = list(materials)
    for number, (name, material) in enumerate(materials.items()):
        where = f"materials.{name}"
        _check(f"the material of '{name}'", where, material)
        if name not in mesh.groups:
            there = did_you_mean(name, mesh.groups) or f"; it has {shortened(list(mesh.groups), 8) or 'none'}"
            raise UsageError(f"the mesh has no group of solid elements '{name}'{there}", names=(where,))
        for owner, members in zip(layer_of_element, mesh.groups[name], strict=True):
            if np.any(owner[members] >= 0):
                other_name = names[int(owner[members].max())]
                raise UsageError(
                    f"the groups '{other_name}' and '{name}' have elements in common", names=(where,)
                )
            owner[members] = number
        yield _Layer(material, mesh.groups[name])
    missing = sum(int((owner < 0).sum()) for owner in layer_of_element)
    if missing:
        rest = [name for name in mesh.groups if name not in materials]
        raise UsageError(
            f"{missing} of {sum(map(len, layer_of_element))} elements have no material",
            remedy=f"Groups without one: {shortened(rest, 8)}."
            if rest
            else "They belong to no group of the mesh.",
            names=("materials",),
        )


def _check(what: str, where: str, material: Material) -> None:
    try:
        not_negative(f"rho of {what}", material.rho)
        not_negative(f"eta of {what}", material.eta)
        if not 0 < float(material.E) < math.inf:
            raise UsageError(f"E of {what} must be positive and finite")
        if not -1 < material.nu < 0.5:
            raise UsageError(f"nu of {what} must lie between -1 and 0.5, not at {material.nu:g}")
    except UsageError as error:
        raise UsageError(error.problem, remedy=error.remedy, names=(where,)) from None


def _supported(
    number: int, support: SetSupport, sets: Mapping[str, Places], at: Mapping[int, int]
) -> Places | int:
    """Return the places of the nodes of a support."""
    if isinstance(support.at, int):
        if support.at not in at:
            raise UsageError(f"the solid has no node {support.at}", names=(f"supports.{number}.node",))
        return at[support.at]
    if support.at not in sets:
        hint = did_you_mean(support.at, sets) or f"; it has {shortened(list(sets), 8) or 'none'}"
        raise UsageError(f"the mesh has no set '{support.at}'{hint}", names=(f"supports.{number}.set",))
    if not len(sets[support.at]):
        raise UsageError(
            f"no node of the set '{support.at}' belongs to a solid element", names=(f"supports.{number}.set",)
        )
    return sets[support.at]


class _Share(NamedTuple):
    """Elements of a block with their Lamé constants, Pa, and density, kg/m3."""

    block: Block
    first: float
    shear: float
    density: float


def _matrices(
    mesh: SolidMesh, layers: Sequence[_Layer], compact: Places, free: Places
) -> tuple[DependentMatrix, DependentMatrix, DependentMatrix | None]:
    """Return mass, stiffness, structural damping over the free DOFs: known numbers, then each unknown."""
    dense = len(free) <= DENSE_STRUCTURES.value

    def sums(chosen: Sequence[tuple[_Layer, float, float]]) -> tuple[Matrix, Matrix]:
        """Return mass and stiffness of layers with numbers E and rho."""
        shares = [
            _Share(
                Block(block.kind, compact[block.cells[members]]), 2 * nu / (1 - 2 * nu) * shear, shear, rho
            )
            for layer, E, rho in chosen
            for nu in [layer.material.nu]
            for shear in [E / 2 / (1 + nu)]
            for block, members in zip(mesh.blocks, layer.members, strict=True)
            if len(members)
        ]
        return _assembled(shares, mesh.xyz[compact >= 0], free, dense)

    def known(value: Real) -> float:
        return 0.0 if isinstance(value, Dependent) else float(value)

    constant = sums([(layer, known(layer.material.E), known(layer.material.rho)) for layer in layers])
    M, K = (DependentMatrix(matrix) for matrix in constant)
    for layer in layers:
        E, rho = layer.material.E, layer.material.rho
        if isinstance(E, Dependent) or isinstance(rho, Dependent):
            mass, stiff = sums([(layer, 1.0, 1.0)])
            M = DependentMatrix(M.constant, (*M.terms, (rho, mass))) if isinstance(rho, Dependent) else M
            K = DependentMatrix(K.constant, (*K.terms, (E, stiff))) if isinstance(E, Dependent) else K
    losses = [(layer, layer.material.E * layer.material.eta) for layer in layers if layer.material.eta]
    if not losses:
        return M, K, None
    H = DependentMatrix(sums([(layer, known(loss), 0.0) for layer, loss in losses])[1])
    terms = [(loss, sums([(layer, 1.0, 0.0)])[1]) for layer, loss in losses if isinstance(loss, Dependent)]
    return M, K, DependentMatrix(H.constant, tuple(terms))


def _assembled(shares: Sequence[_Share], xyz: Array, free: Places, dense: bool) -> tuple[Matrix, Matrix]:
    """Return mass and stiffness (over `free` of 3 N DOFs) of elements whose cells count the rows of `xyz`."""
    from scipy.sparse import bsr_array, csr_array, eye_array, kron  # heavy import, for solids only

    count = len(xyz)
    pairs = [
        (share.block.cells[:, :, None] * count + share.block.cells[:, None, :]).ravel() for share in shares
    ]
    keys, slots = np.unique(np.concatenate(pairs), return_inverse=True)
    del pairs
    rows, columns = np.divmod(keys, count)
    starts = np.searchsorted(rows, np.arange(count + 1))
    blocks, masses, at = np.zeros((9, len(keys))), np.zeros(len(keys)), 0
    for share in shares:
        n = share.block.cells.shape[1]
        step = max(_ELEMENT_MATRIX_ENTRIES // (3 * n) ** 2, 1)
        for start in range(0, len(share.block.cells), step):
            chunk = slice(start, start + step)
            cells = share.block.cells[chunk]
            strain, mass = integrated(ELEMENTS[share.block.kind], xyz[cells])
            stiff = stiffness(strain, share.first, share.shear)
            here = slots[at : at + mass.size]
            at += mass.size
            for entry in range(9):
                values = stiff[:, :, entry // 3, :, entry % 3].ravel()
                blocks[entry] += np.bincount(here, values, len(keys))
            masses += np.bincount(here, (mass * share.density).ravel(), len(keys))
    shape = (3 * count, 3 * count)
    K: Any = bsr_array((blocks.T.reshape(-1, 3, 3), columns, starts), shape=shape).tocsc()
    M: Any = kron(csr_array((masses, columns, starts), shape=(count, count)), eye_array(3), format="csc")
    mass, stiff = (matrix[:, free][free] for matrix in (M, K))
    return (mass.toarray(), stiff.toarray()) if dense else (mass, stiff)


def _doubts(mesh: SolidMesh, layers: Sequence[_Layer], parts: NDArray[np.int32]) -> Iterator[str]:
    """Yield what may be wrong with a mesh or too coarse in it, a sentence each."""
    counts = {block.kind: 0 for block in mesh.blocks}
    for block in mesh.blocks:
        counts[block.kind] += len(block.cells)
    if counts.get("tetra"):
        yield (
            f"the mesh has {counts['tetra']:,} linear tetrahedra, which lock: they are much too stiff in "
            "bending, and frequencies are too high; make elements of second order (gmsh: -order 2)"
        )
    for kind, name in (("hexahedron", "hexahedra"), ("wedge", "wedges")):
        if counts.get(kind):
            yield (
                f"the mesh has {counts[kind]:,} linear {name}, which are too stiff in bending unless several "
                "lie across each thickness; elements of second order are not"
            )
    if any(layer.material.nu > _INCOMPRESSIBLE for layer in layers):
        yield f"Poisson's ratio is above {_INCOMPRESSIBLE}: the elements lock as the volume cannot change"
    several = int(parts.max()) + 1
    if several > 1:
        sizes = sorted(np.bincount(parts).tolist(), reverse=True)
        shown = shortened([f"{size:,}" for size in sizes], 8)
        doubled = doubled_nodes(mesh.xyz[np.unique(np.concatenate([b.cells.ravel() for b in mesh.blocks]))])
        nodes = f"; {doubled:,} pairs of nodes lie at one place: merge them if the parts belong together"
        yield (
            f"the mesh has {several} parts without a common face (of {shown} elements)"
            f"{nodes if doubled else ''}; joints or supports must hold each"
        )
