"""Structures as mass, damping and stiffness matrices with joints between labelled DOFs.

Source: K. T. Yang 1997, eq 1: the joints' matrices C_s, K_s are added to those of the rest.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from dynid.arithmetic.dependent import Dependent, evaluated
from dynid.arrays import Array, guarded
from dynid.errors import UsageError
from dynid.parameters import Parameter, true_values
from dynid.structure import labels
from dynid.structure.damping import ModalPart
from dynid.structure.joints import Joint, angular, unit_of
from dynid.structure.labels import Label, Nodes
from dynid.structure.matrices import Matrix, as_array, as_matrix, check_semidefinite, congruent, is_sparse
from dynid.structure.named_dofs import Motion, NamedDofs

# Beyond this a matrix with all its zeros is not made: 5000 x 5000 takes 0.2 GB.
_MOST_DENSE = 5000
# Motion that is rounding, relative to the largest in the same column of a basis.
_ROUNDING = 16 * float(np.finfo(float).eps)
# The same of computed rigid-body motions.
_RIGID_ENERGY_TOL = 1e-9

#: The note on linear analyses of a structure with nonlinear joints.
TANGENT = (
    "nonlinear joints act by their tangents at rest: small motions, sliders stuck, gaps as they are at rest"
)


class Term(NamedTuple):
    """A part of a matrix that depends on unknown parameters."""

    letter: str  # the matrix: ``M``, ``C``, ``K`` or ``H``
    coefficient: Dependent  # what multiplies `matrix`
    matrix: Matrix  # a constant matrix (n x n)


class Rotor(NamedTuple):
    """What rotation adds: ``speed G`` to the damping and N to the stiffness, both skew-symmetric (n x n)."""

    G: Array  # gyroscopic matrix, kg or kg·m2
    N: Array  # circulatory stiffness
    speed: float  # of rotation, rad/s


@dataclass(frozen=True, eq=False)
class Basis:
    """Basis of a reduced model: ``x = T q``.

    `T`: the basis (N x n): N DOFs of `parent`, n coordinates; `parent`: the model that was reduced; `rigid`:
    coordinates (from 0) in which `parent` moves as a rigid body, joints included: these strain nothing,
    whatever the rounding of T.
    """

    T: Array
    parent: StructuralModel
    rigid: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class StructuralModel(NamedDofs):
    """``(M + M_s) x'' + (C + C_s) x' + (K + K_s) x = f`` (Yang, eq 1), the joints' part kept apart.

    A reduced model is one too: its coordinates are its DOFs, and a `basis` leads back. All DOFs of the model
    it was made from can be named in it, as force directions, read-outs and ends of joints.

    Parameters
    ----------
    M, C, K
        Mass, damping and stiffness without the joints (n x n), symmetric, at the reference values of unknown
        parameters. M and K may be singular (massless
        DOFs, rigid-body modes), not indefinite. They are arrays; if one is sparse, all become `csc_array`.
        Without C there is no damping.
    joints
        The joints.
    dofs
        Labels of the DOFs, whole numbers or texts such as ``w_4``; default: 1 … n. Where the labels are texts
        a number names a DOF by its place, from 1.
    basis
        Of a reduced model, the way back to all DOFs.
    parameters
        Unknown and considered parameters other than those of joints.
    terms
        The parts of M, C and K that depend on them. M, C and K contain them at the reference values.
    modal
        Modal damping of parts whose modes depend on them; C contains it at the reference values.
    nodes
        The nodes, where they are known; in a reduced model those of the full one.
    motions
        Named weighted sums of the full model's DOFs, such as the displacement ``p:x`` of a point. They are
        named like DOFs.
    translations
        True where DOFs whose labels have no direction are translations, as those of point masses.
    H
        Structural damping without the joints (n x n), the imaginary part of the stiffness at positive
        frequencies; None without any.
    viscous_at
        The frequency, rad/s, at which dampers stand for the loss factors of joints; default: none do.
    rotor
        Gyroscopic and circulatory matrices, which only modes, frequency responses and what is identified
        from these know; default: none.

    Raises
    ------
    UsageError
        If shapes, symmetry, signs, labels or joints make no sense.
    """

    M: Matrix
    C: Matrix
    K: Matrix
    joints: tuple[Joint, ...] = ()
    dofs: tuple[Label, ...] = ()
    basis: Basis | None = None
    parameters: tuple[Parameter, ...] = ()
    terms: tuple[Term, ...] = ()
    modal: tuple[ModalPart, ...] = ()
    nodes: Nodes | None = None
    motions: Mapping[str, Motion] = field(default_factory=dict)
    translations: bool = False
    H: Matrix | None = None
    viscous_at: float | None = None
    rotor: Rotor | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", self._viscous(self.joints))
        shape = self.M.shape if is_sparse(self.M) else np.shape(self.M)
        n = shape[0] if shape else 0
        sparse = any(is_sparse(matrix) for matrix in (self.M, self.C, self.K))
        for name in "MKCH":
            if (stored := getattr(self, name)) is not None:
                object.__setattr__(self, name, as_matrix(name, stored, n, sparse=sparse))
        terms = (
            term._replace(matrix=as_matrix(term.letter, term.matrix, n, sparse=sparse)) for term in self.terms
        )
        object.__setattr__(self, "terms", tuple(terms))
        object.__setattr__(self, "dofs", labels.checked(self.dofs, n))
        self._check_motions()
        if self.basis is None:  # a projection of a structure is one
            for name in ("M", "K") if self.H is None else ("M", "K", "H"):
                check_semidefinite(name, getattr(self, name), self.dofs)
        elif self.basis.T.shape != (self.basis.parent.size, n):
            rows, columns = self.basis.T.shape
            raise UsageError(f"the basis is {rows} x {columns}, not {self.basis.parent.size} x {n}")
        self._check_joints()

    def joined(self, joints: Iterable[Joint]) -> StructuralModel:
        """Return the model with other joints, its matrices not checked again.

        Raises UsageError if a joint makes no sense here.
        """
        model = self._copied(joints=self._viscous(joints))
        model._check_joints()
        return model

    def stored_sparse(self) -> StructuralModel:
        """Return the model with its matrices stored as `csc_array`, not checked again."""
        from scipy.sparse import csc_array

        return self._copied(**self.mapped(csc_array))

    def mapped(self, change: Callable[[Any], Any]) -> dict[str, Any]:
        """Return the matrices and the terms of these after a linear change of each matrix."""
        self.needs_symmetric()
        terms = tuple(term._replace(matrix=change(term.matrix)) for term in self.terms)
        H = None if self.H is None else change(self.H)
        return {"M": change(self.M), "C": change(self.C), "K": change(self.K), "H": H, "terms": terms}

    def _copied(self, **changes: Any) -> StructuralModel:
        """Return a copy with other attributes, which are not checked."""
        model = object.__new__(StructuralModel)
        for item in fields(self):
            object.__setattr__(model, item.name, changes.get(item.name, getattr(self, item.name)))
        return model

    @property
    def is_sparse(self) -> bool:
        """True where the matrices are sparse."""
        return is_sparse(self.M)

    def projected(self, T: Array, dofs: Sequence[Label], rigid: Sequence[int] = ()) -> StructuralModel:
        """Return the model in coordinates q with ``x = T q``; the joints come along.

        `T`: the basis (size x n); `dofs`: labels of the coordinates (n): of kept DOFs their own, of others
        any; `rigid`: as of `Basis`.
        """
        self.needs_symmetric()
        M, C, K = (congruent(T, matrix) for matrix in (self.M, self.C, self.K))
        H = None if self.H is None else congruent(T, self.H)
        terms = tuple(term._replace(matrix=_projected_pattern(term, T, rigid)) for term in self.terms)
        modal = tuple(part.projected(T) for part in self.modal)
        basis = Basis(T, self, tuple(rigid))
        return StructuralModel(
            M, C, K, self.joints, tuple(dofs), basis, self.parameters, terms, modal, self.nodes, self.motions,
            H=H,
        )  # fmt: skip

    @property
    def unknowns(self) -> tuple[Parameter, ...]:
        """The unknown parameters: of joints, then of `parameters`, on which loads may depend, too."""
        return (*self.joint_unknowns, *(parameter for parameter in self.parameters if parameter.std is None))

    @cached_property
    def joint_unknowns(self) -> tuple[Parameter, ...]:
        """The joints' own unknown parameters, joint by joint, stiffness before damping."""
        unknowns = tuple(
            Parameter(
                name,
                component.start,
                component.true,
                component.low,
                component.high,
                component.prior,
                unit=unit_of(letter, [self.kind(dof) for dof in joint.dofs])
                if component.matrix is None and key != "eta"
                else "",  # of the factor of a block, of a loss factor
            )
            for joint in self.joints
            for name, letter, component, _, key in joint.terms
            if component.start is not None
        )
        return unknowns + self.law_unknowns

    @cached_property
    def law_unknowns(self) -> tuple[Parameter, ...]:
        """The unknown parameters of nonlinear laws, joint by joint, law by law."""
        if not self.nonlinear:
            return ()
        from dynid.structure.model_laws import law_unknowns

        return law_unknowns(self.joints, self.kind)

    @cached_property
    def nonlinear(self) -> bool:
        """True if a joint has a nonlinear law."""
        return any(joint.laws for joint in self.joints)

    @cached_property
    def names(self) -> frozenset[str]:
        """The names of all parameters on which the matrices depend, known or unknown."""
        numbers: list[Dependent | ModalPart] = [*self.modal, *(term.coefficient for term in self.terms)]
        for joint in self.joints:
            numbers += [coefficient for term in joint.terms for coefficient, _ in term.product.terms]
        names = frozenset().union(*(number.names for number in numbers))
        return names.union(unknown.name for unknown in self.law_unknowns) if self.nonlinear else names

    @cached_property
    def joint_terms(self) -> tuple[Term, ...]:
        """The parts of the matrices of joints that depend on parameters."""
        return tuple(
            Term(term.letter.upper(), coefficient, self._pattern(joint, as_array(block), term.letter))
            for joint in self.joints
            for term in joint.terms
            for coefficient, block in term.product.terms
        )

    def _viscous(self, joints: Iterable[Joint]) -> tuple[Joint, ...]:
        """Return joints whose loss factors act as dampers where the structure says so."""
        if self.viscous_at is None:
            return tuple(joints)
        from dynid.structure.damping import viscous

        return viscous(joints, self.viscous_at)

    def needs_causal(self, what: str) -> None:
        """Refuse a structure with structural damping, which has no motion in time.

        Raises UsageError that names what needs a causal structure.
        """
        if self.hysteretic:
            from dynid.structure.damping import not_causal

            raise not_causal(what)

    def needs_positive(self, omega: Array) -> None:
        """Refuse the frequency 0 for a structure with structural damping.

        Raises UsageError.
        """
        if self.hysteretic and np.any(omega <= 0):
            from dynid.structure.damping import not_positive

            raise not_positive()

    def needs_symmetric(self) -> None:
        """Refuse gyroscopic and circulatory matrices.

        Raises UsageError.
        """
        if self.rotor is not None:
            raise UsageError(
                "gyroscopic and circulatory matrices are for modes, frequency responses, Campbell diagrams "
                "and identifications from frequency responses; this needs symmetric matrices",
                remedy="Leave 'gyroscopic' and 'circulatory' out, or what needs symmetric matrices.",
                names=("structure.matrices.gyroscopic", "structure.matrices.circulatory", "structure"),
            )

    def rotating(self, rotor: Rotor | None) -> StructuralModel:
        """Return the model with these gyroscopic and circulatory matrices, or without any."""
        return self._copied(rotor=rotor)

    @property
    def hysteretic(self) -> bool:
        """True with structural damping, known or unknown, which holds at positive frequencies only."""
        return self.H is not None or any(
            term.letter == "h" for joint in self.joints if joint.eta is not None for term in joint.terms
        )

    def _bare(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Return the matrices without the joints by their letters."""
        sums: dict[str, Any] = {"M": self.M, "C": self.C, "K": self.K, "H": self.H}
        if self.names.isdisjoint(values):
            return sums
        for term in self.terms:
            change = term.coefficient.at(values).value - float(term.coefficient)
            if change:
                sums[term.letter] = sums[term.letter] + change * term.matrix
        for part in self.modal:
            sums["C"] = sums["C"] + self._stored(part.change(values))
        return sums

    @guarded("the sum of mass, stiffness or damping at a DOF", UsageError)
    def with_joints(
        self, values: Mapping[str, float] | None = None, *, loss: bool = False, rotating: bool = False
    ) -> tuple[Matrix, Matrix, Matrix]:
        """Return mass, damping and stiffness with the joints: M + M_s, C + C_s and K + K_s (Yang, eq 1).

        `values`: the parameters by name. Those that are not joints' own (``<joint>.k``, ``<joint>.c``) have
        their reference values where they are absent; `loss`: True for the complex stiffness K + i H of a
        structure with structural damping; `rotating`: True where unsymmetric matrices of a rotor are known.
        Raises UsageError if an unknown parameter of a joint has no value,
        or a name is no parameter.
        """
        if not rotating:
            self.needs_symmetric()
        parameter_values = dict(values or {})
        unknown = parameter_values.keys() - self.names - {parameter.name for parameter in self.parameters}
        if unknown:
            this = "this name" if len(unknown) == 1 else "these names"
            names = [name for name in parameter_values if name in unknown]
            raise UsageError(f"{', '.join(names)}: no unknown parameter has {this}", names=names)
        sums = self._bare(parameter_values)
        for joint in self.joints:
            for name, letter, component, block_of, _ in joint.terms:
                value = (
                    parameter_values.get(name)
                    if component.value is None
                    else evaluated(component.value, parameter_values).value
                )
                if value is None:
                    raise UsageError(f"the joint parameter {name} has no value", names=(name,))
                block = as_array(block_of.at(parameter_values))
                pattern, key = self._pattern(joint, value * block, letter), letter.upper()
                sums[key] = pattern if sums[key] is None else sums[key] + pattern
        if self.nonlinear:
            from dynid.structure.model_laws import tangents

            for joint, by_letter in tangents(self.joints, parameter_values):
                for letter, tangent in by_letter.items():
                    key = letter.upper()
                    sums[key] = sums[key] + self._pattern(joint, tangent, letter)
        if loss and sums["H"] is not None:
            sums["K"] = sums["K"] + 1j * sums["H"]
        if self.rotor is not None:
            sums["C"] = sums["C"] + self.rotor.speed * self.rotor.G
            sums["K"] = sums["K"] + self.rotor.N
        return sums["M"], sums["C"], sums["K"]

    def with_known_joints(self) -> tuple[Matrix, Matrix, Matrix]:
        """Return the matrices with the joints that are known; other ones are left out."""
        known = self.without_laws()
        return known.with_joints({parameter.name: 0.0 for parameter in known.joint_unknowns})

    def without_laws(self) -> StructuralModel:
        """Return the model whose joints have no nonlinear laws: their stiffness, damping and mass alone."""
        if not self.nonlinear:
            return self
        return self.joined(replace(joint, laws=(), offset=None) for joint in self.joints)

    def slopes(
        self, values: Mapping[str, float], names: Iterable[str] | None = None
    ) -> tuple[Mapping[str, Matrix], ...]:
        """Return the derivatives of the matrices of `with_joints` by each unknown parameter's value.

        `values`: the parameters by name; those that are absent have their reference values; `names`: the
        parameters, known or unknown, by which to differentiate; default: `unknowns`.

        It returns for each of them the derivatives by the matrices' letters, ``M``, ``C``, ``K``, ``H``;
        those that vanish are absent.
        """
        requested = [parameter.name for parameter in self.unknowns] if names is None else names
        by_name: dict[str, dict[str, Any]] = {name: {} for name in requested}
        parts = [
            (name, term.letter, rate * term.matrix)
            for term in (*self.joint_terms, *self.terms)
            for name, rate in term.coefficient.at(values).slopes.items()
        ]
        for part in self.modal:
            parts += [(name, "C", self._stored(change)) for name, change in part.slopes(values).items()]
        if self.nonlinear:
            from dynid.structure.model_laws import tangent_slopes

            references = {parameter.name: parameter.start for parameter in self.unknowns}
            parts += [
                (name, letter.upper(), self._pattern(joint, block, letter))
                for name, joint, letter, block in tangent_slopes(self.joints, references | dict(values))
            ]
        for name, letter, component in parts:
            if name in by_name:
                slopes_of_name = by_name[name]
                slopes_of_name[letter] = (
                    slopes_of_name[letter] + component if letter in slopes_of_name else component
                )
        return tuple(by_name.values())

    def mass(self, values: Mapping[str, float] | None = None) -> Matrix:
        """Return the mass matrix with that of the joints, for unknown parameters by name."""
        parameter_values = {parameter.name: parameter.expected for parameter in self.unknowns} | dict(
            values or {}
        )
        return self.with_joints(parameter_values)[0]

    @property
    def affine(self) -> bool:
        """True if every unknown parameter is the factor of stiffness and damping matrices, and of no mass."""
        unknown = {parameter.name for parameter in self.unknowns}
        return not (self.modal or self.nonlinear) and all(
            term.letter != "M" and term.coefficient.is_multiple
            for term in (*self.joint_terms, *self.terms)
            if not unknown.isdisjoint(term.coefficient.names)
        )

    def _stored(self, matrix: Array) -> Matrix:
        """Return a matrix stored as those of the model are."""
        if not self.is_sparse:
            return matrix
        from scipy.sparse import csc_array  # loaded already: the model is sparse

        return csc_array(matrix)

    def dense(
        self, values: Mapping[str, float] | None = None, *, loss: bool = False, rotating: bool = False
    ) -> tuple[Array, Array, Array]:
        """Return the matrices of `with_joints` as arrays.

        Raises UsageError as `with_joints`; also if they would not fit into memory.
        """
        if self.is_sparse and self.size > _MOST_DENSE:
            raise UsageError(
                f"the structure has {self.size} DOFs, more than the {_MOST_DENSE} that this analysis takes",
                remedy="Reduce it first.",
            )
        M, C, K = self.with_joints(values, loss=loss, rotating=rotating)
        return as_array(M), as_array(C), as_array(K)

    def with_parameters(self, parameters: Iterable[Parameter]) -> StructuralModel:
        """Return the model with other `parameters`, those of joints left as they are."""
        return self._copied(parameters=tuple(parameters))

    def with_terms(self, terms: Iterable[Term], parameters: Iterable[Parameter]) -> StructuralModel:
        """Return the model with other terms, which M, C and K contain already, and `parameters` for them."""
        return self._copied(terms=tuple(terms), parameters=tuple(parameters))

    def true_values(self) -> dict[str, float]:
        """Return the true values of the unknown parameters.

        Raises UsageError if one has no true value.
        """
        return true_values(self.unknowns)

    def with_motions(self, motions: Mapping[str, Motion]) -> StructuralModel:
        """Return the model with further motions, its matrices not checked again."""
        model = self._copied(motions={**self.motions, **motions})
        model._check_motions()
        return model

    def _check_joints(self) -> None:
        names = Counter(term.name for joint in self.joints for term in joint.terms)
        names.update(name for joint in self.joints for law in joint.law_parameters for name, _ in law)
        for joint in self.joints:
            of_joint = [
                *(term.name for term in joint.terms),
                *(n for law in joint.law_parameters for n, _ in law),
            ]
            if any(names[name] > 1 for name in of_joint):
                raise UsageError(f"there are two joints named {joint.name}", names=(joint.name,))
            try:
                ends = [self.label(dof) for dof in joint.dofs]
            except UsageError as error:
                raise UsageError(
                    f"joint {joint.name}: {error.problem}", remedy=error.remedy, names=(joint.name,)
                ) from None
            if len(set(ends)) < len(ends):
                raise UsageError(f"joint {joint.name} names a DOF in two ways", names=(joint.name,))

    @cached_property
    def _blur(self) -> Array:
        """Rounding of the displacements that a basis gives, by coordinate (n)."""
        assert self.basis is not None
        return np.asarray(_ROUNDING * np.abs(self.basis.parent.expand(self.basis.T)).max(axis=0))

    def deflection_units(self, unit: str) -> list[str]:
        """Return a unit over the deflection of each joint with laws, some of which are rotations."""
        turning = [
            {self.kind(dof) for dof in joint.dofs} == {"rotation"} for joint in self.joints if joint.laws
        ]
        return [angular(unit) if turns else unit for turns in turning]

    def deflections(self) -> Array:
        """Return the deflections of joints with nonlinear laws, as rows of the displacements (joints x n).

        Coordinates of a reduced model that deflect one by no more than rounding have 0 there.
        """
        rows = np.zeros((0, self.size))
        for joint in self.joints:
            if joint.laws:
                row = np.array([1.0, -1.0])[: len(joint.dofs)] @ np.array(
                    [self.row(dof) for dof in joint.dofs]
                )
                if self.basis is not None:
                    row[np.abs(row) <= 2 * self._blur] = 0.0
                rows = np.vstack([rows, row])
        return rows

    def _pattern(self, joint: Joint, block: Array, letter: str) -> Matrix:
        """Return a block over a joint's DOFs as a matrix of the model (n x n).

        Coordinates of a reduced model whose forces in the joint are rounding of the basis get none: that
        would be a stiffness of its own, some 30 orders below the exact one of the others.
        """
        if self.is_sparse:
            from scipy.sparse import csc_array  # loaded already: the model is sparse

            ends = [self._weights(self.label(dof)) for dof in joint.dofs]
            order = [end for end, weights in enumerate(ends) for _ in weights]
            places = [self._places[label] for weights in ends for label in weights]
            weights_of_ends = [weight for weights in ends for weight in weights.values()]
            picked: Any = csc_array((weights_of_ends, (order, places)), shape=(len(ends), self.size))
            spread: csc_array = (picked.T @ csc_array(block) @ picked).tocsc()
            return spread
        rows = np.array([self.row(dof) for dof in joint.dofs])
        if letter != "m" and self.basis is not None:
            rounding = np.outer(np.abs(block).sum(axis=1), self._blur)
            unstrained = np.asarray(np.all(np.abs(block @ rows) <= rounding, axis=0))
            rows[:, unstrained] = 0.0
            if letter in "kh":
                rows[:, list(self.basis.rigid)] = 0.0
        return np.asarray(rows.T @ block @ rows)


def _projected_pattern(term: Term, T: Array, rigid: Sequence[int]) -> Array:
    """Return a term's matrix in coordinates q with ``x = T q``.

    Coordinates that strain it by no more than rounding get nothing of it; those of rigid-body motions are
    computed, and rounded more.
    """
    product = np.asarray(term.matrix @ T)
    projected: Array = T.T @ product
    projected = (projected + projected.T) / 2
    if term.letter != "M":
        rounding = np.full(T.shape[1], _ROUNDING)
        rounding[list(rigid)] = _RIGID_ENERGY_TOL
        size = np.asarray(abs(term.matrix) @ np.abs(T)).max(axis=0, initial=0.0)
        unstrained = np.abs(product).max(axis=0, initial=0.0) <= rounding * size
        projected[unstrained], projected[:, unstrained] = 0.0, 0.0
    return projected
