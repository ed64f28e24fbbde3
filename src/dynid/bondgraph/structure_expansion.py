"""Structures as parts of a bond graph: all degrees of freedom exactly, or the finite-mode bond graph.

Source of the finite-mode bond graph: Karnopp, Margolis & Rosenberg, *System Dynamics*, chapter 10.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from fractions import Fraction
from typing import Any, Literal

import numpy as np

from dynid.arithmetic.ldl import Indefinite, Square
from dynid.arithmetic.numbers import to_fraction
from dynid.arrays import Array
from dynid.bondgraph.field_expansion import Expansion, FieldType, identifier, symmetric_squares
from dynid.defaults import STRUCTURES_IN_GRAPHS
from dynid.errors import UsageError
from dynid.structure import labels
from dynid.structure.matrices import NAMES, Label, Matrix, triplets
from dynid.structure.model import StructuralModel
from dynid.structure.modes import modes
from dynid.structure.reduction.reduced_model import StructuralReduction

Reading = Literal["decimal", "binary"]

# Rounding of a sum of positive and negative terms, relative to their sizes.
_CANCELLATION_RTOL = 16 * float(np.finfo(float).eps)
_ELEMENTS: tuple[tuple[str, FieldType], ...] = (("M", "I"), ("C", "R"), ("K", "C"))
_DOMAINS = {"translation": "mechanical", "rotation": "rotational"}


def expand_structure(
    expansion: Expansion,
    model: StructuralModel,
    ports: Mapping[str, Label],
    quantities: Mapping[str, Iterable[str]],
    reading: Reading = "decimal",
    domain: str = "",
    outward: Container[str] = (),
) -> None:
    """Add a structure with all its degrees of freedom: a 1-junction each, I, R and C fields by M, C and K.

    Every number of the matrices, joints included, is taken as the fraction that it is read as. What is left
    of the stiffness of a rigid-body motion is rounding of these numbers, and zero.

    Parameters
    ----------
    ports
        DOFs of the ports by name.
    quantities
        By port the quantities that are outputs.
    reading
        What a float means.
    domain
        The domain of its ports; default: from the labels of the DOFs.
    outward
        Names of the ports whose effort is that out of the structure.

    Raises
    ------
    UsageError
        If there is no such DOF, the structure is too large, a matrix has a negative eigenvalue, or modal
        damping depends on unknown parameters.
    """
    model.needs_causal("bond graph")
    if model.size > STRUCTURES_IN_GRAPHS.value:
        raise UsageError(
            f"the structure '{expansion.name}' has {model.size} DOFs, more than the "
            f"{STRUCTURES_IN_GRAPHS.value} that enter a bond graph one by one",
            remedy="Give it a 'reduction'.",
            names=(expansion.name,),
        )
    at = _places(expansion.name, model, ports)
    names = {index: name for name, index in at.items()}
    texts = {index: str(names.get(index, label)) for index, label in enumerate(model.dofs)}
    junctions = {}
    for index, label in enumerate(model.dofs):
        port_domain = domain or _DOMAINS.get(labels.kind(label), "")
        if index in names:
            port = names[index]
            junctions[index] = expansion.add_port(
                port, "1", quantities.get(port, ()), port_domain, port in outward
            )
        else:
            junctions[index] = expansion.add("1", f"{expansion.name}.{label}", None, port_domain)
    for letter, kind in _ELEMENTS:
        squares = _squares(expansion.name, model, letter, reading)
        expansion.add_squares(kind, squares, junctions, texts, letter)


def _places(name: str, model: StructuralModel, ports: Mapping[str, Label]) -> dict[str, int]:
    places: dict[str, int] = {}
    for port, dof in ports.items():
        index = model.index(dof)
        if index in places.values():
            raise UsageError(f"two ports of '{name}' are at DOF {model.label(dof)}", names=(name,))
        places[port] = index
    return places


def _squares(name: str, model: StructuralModel, letter: str, reading: Reading) -> list[Square]:
    """Return mass, damping or stiffness, joints included, as squares."""
    if letter == "C" and model.modal:
        raise UsageError(
            f"the modal damping of '{name}' depends on unknown parameters through its modes; a bond graph "
            "has no element for it",
            remedy="Give proportional damping (alpha, beta), or make the parameters of its modes known.",
            names=(name,),
        )
    expected = {
        unknown.name: unknown.expected for unknown in model.joint_unknowns
    }  # all others: their reference
    matrix = dict(zip("MCK", model.with_joints(expected), strict=True))[letter]
    rows: dict[int, dict[int, Any]] = {index: {} for index in range(model.size)}
    for i, j, entry in _entries(matrix):
        rows[i][j] = to_fraction(entry, reading)
    for term in (*model.joint_terms, *model.terms):
        if term.letter == letter:
            change = term.coefficient - to_fraction(term.coefficient.reference)
            for i, j, entry in _entries(term.matrix):
                rows[i][j] = rows[i].get(j, Fraction(0)) + change * to_fraction(entry, reading)
    try:
        return symmetric_squares(name, rows, _CANCELLATION_RTOL)
    except Indefinite:
        raise UsageError(
            f"the {NAMES[letter]} of '{name}' has a negative eigenvalue",
            remedy="A bond graph needs matrices of a passive structure, with all their digits.",
            names=(name,),
        ) from None


def _entries(matrix: Matrix) -> Iterable[tuple[int, int, float]]:
    rows, columns, entries = triplets(matrix)
    return zip(rows.tolist(), columns.tolist(), entries.tolist(), strict=True)


def expand_modes(
    expansion: Expansion,
    reduction: StructuralReduction,
    ports: Mapping[str, Label],
    quantities: Mapping[str, Iterable[str]],
    domain: str = "",
    outward: Container[str] = (),
) -> None:
    """Add the finite-mode bond graph of a reduced structure: a float model.

    One 1-junction with I and C per mode of the reduced model, residual vectors among them with their own
    mass; transformers of modal displacements lead to the ports; a modal R field where damping couples modes.
    Rigid-body modes have no C. With unknown parameters in the structure its modes are not constant: the
    coordinates are then displacements of DOFs, on the fixed basis of the reduction.

    Raises `UsageError` if there is no such DOF, a coordinate has no mass, or modal damping depends on unknown
    parameters.
    """
    model = reduction.model
    model.needs_causal("bond graph")
    rows = np.array([model.row(dof) for dof in ports.values()])
    if model.terms or model.joint_terms:
        coordinates, shapes = _displacements(model, rows)
        displaced = model.projected(shapes, coordinates)
        squares = {letter: _squares(expansion.name, displaced, letter, "binary") for letter, _ in _ELEMENTS}
        texts = dict(enumerate(map(str, coordinates)))
    else:
        shapes, squares = _modal(expansion.name, model)
        texts = {index: f"mode_{index + 1}" for index in range(shapes.shape[1])}
    values = rows @ shapes
    values[np.abs(values) <= _CANCELLATION_RTOL * np.abs(model.expand(shapes)).max(axis=0)] = 0.0
    junctions = {index: expansion.add("1", f"{expansion.name}.{text}") for index, text in texts.items()}
    for letter, kind in _ELEMENTS:
        expansion.add_squares(kind, squares[letter], junctions, texts, letter)
    for (port, dof), motion in zip(ports.items(), values, strict=True):
        kind_of = domain or _DOMAINS.get(labels.kind(_full(model).label(dof)), "")
        inner = expansion.add_port(port, "1", quantities.get(port, ()), kind_of, port in outward)
        force = expansion.add("0", f"{expansion.name}.{port}_force", None, kind_of)
        expansion.connect(inner, force)
        if not motion.any():
            raise UsageError(
                f"no coordinate of the reduced structure '{expansion.name}' moves the port '{port}'",
                remedy="Keep more modes, or residual vectors.",
                names=(expansion.name,),
            )
        for index in np.flatnonzero(motion).tolist():
            modulus = 1 / Fraction(float(motion[index]))
            name = f"{expansion.name}_{port}_{identifier(texts[index])}"
            expansion.connect(force, junctions[index], modulus, name)


def _full(model: StructuralModel) -> StructuralModel:
    return model if model.basis is None else _full(model.basis.parent)


def _modal(name: str, model: StructuralModel) -> tuple[Array, dict[str, list[Square]]]:
    """Return the modes of a reduced model (r x r), and modal mass, damping and stiffness as squares."""
    M, C, K = model.dense()
    natural = modes(M, C, K)
    if len(natural.omega) < model.size:
        raise UsageError(
            f"the reduced structure '{name}' has coordinates without mass, which no mode moves",
            remedy="Reduce to DOFs with mass, or to modes.",
            names=(name,),
        )
    unity, stiffness = Fraction(1), [Fraction(float(omega)) ** 2 for omega in natural.omega]
    shapes = natural.shapes
    damping = shapes.T @ C @ shapes
    parts = np.sqrt(np.einsum("im,ij,jm->m", np.abs(shapes), np.abs(C), np.abs(shapes)))
    damping[np.abs(damping) <= model.size * _CANCELLATION_RTOL * np.outer(parts, parts)] = 0.0
    undamped = np.diag(damping) <= 0
    damping[undamped], damping[:, undamped] = 0.0, 0.0
    rows: dict[int, dict[int, Any]] = {index: {} for index in range(len(damping))}
    for i, j, entry in _entries((damping + damping.T) / 2):
        rows[i][j] = Fraction(entry)
    try:
        dissipated = symmetric_squares(name, rows, _CANCELLATION_RTOL)
    except Indefinite:
        raise UsageError(
            f"the damping of '{name}' has a negative eigenvalue",
            remedy="A bond graph needs matrices of a passive structure.",
            names=(name,),
        ) from None
    mass = [Square(index, unity, {}) for index in range(len(stiffness))]
    springs = [Square(index, value, {}) for index, value in enumerate(stiffness) if value]
    return shapes, {"M": mass, "C": dissipated, "K": springs}


def _displacements(model: StructuralModel, rows: Array) -> tuple[list[Label], Array]:
    """Return DOFs whose displacements are coordinates of a reduced model, and the coordinates by these.

    DOFs are chosen by pivoted QR of the basis, those of the ports first.
    """
    from scipy.linalg import qr  # heavy import, needed here only

    full = _full(model)
    motion = model.expand(np.eye(model.size))
    size = np.abs(motion).max(axis=0)
    weight = np.ones(len(motion))
    for row in rows:
        weight[np.all(np.abs(motion - row) <= _CANCELLATION_RTOL * size, axis=1)] = 1e3
    pivots = qr((motion / size * weight[:, None]).T, mode="economic", pivoting=True)[2][: model.size]
    return [full.dofs[index] for index in pivots], np.linalg.inv(motion[pivots])
