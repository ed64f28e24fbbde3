"""Discrete symmetries of a model: permutations of its unknown parameters that no record can distinguish.

Where a permutation of the parameters leaves the prediction of a record as it is, the likelihood has an
optimum at each image of the estimate: two equal branches, or the halves of a mirror-symmetric structure that
is measured on its axis, may exchange their values.

A permutation of like parameters fixes every point at which like parameters are equal, and there permutes the
derivatives of the prediction. So parameters whose derivatives differ at such a point are in no symmetry,
which excludes nearly all models at once. For the others permutations are found as automorphisms of graphs are
(B. D. McKay, Congressus Numerantium 30 (1981) 45–87): one parameter is raised, which distinguishes those that
belong to it, and derivatives are matched. What is found is confirmed at a random point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations
from weakref import WeakKeyDictionary

import numpy as np

from dynid.arrays import Array, guarded
from dynid.errors import DynidError
from dynid.identification.likelihood.frf_record import FrfLikelihood
from dynid.identification.likelihood.likelihood import Likelihood
from dynid.identification.systems.parametric_model import Model
from dynid.parameters import starts
from dynid.structure.model import StructuralModel

Permutation = tuple[int, ...]
"""Places of the images of the parameters: the value of parameter k goes to parameter `permutation[k]`."""

# Predictions and derivatives are exact to about 1e-12, lightly damped ones of long records to 1e-8; those of
# different models differ by about as much as they are.
_MODEL_RTOL = 1e-6
# A basis for other parameters changes derivatives by less than this part.
_NEARLY_EQUAL_REL_TOL = 0.3
# Coordinates that are raised, in units, one after the other: no two alike, nor sums of others.
_RAISED = (0.41, 0.29, 0.17, 0.11)
# The step over which a prediction is differenced, in units.
_DIFFERENCE_STEP = 0.07
# Deviation of the random point at which a permutation is confirmed, in units.
_RANDOM_POINT_DEVIATION = 0.3
# Points at which a prediction may not exist, one after the other, before a search is given up.
_POINT_ATTEMPTS = 3
# Symmetries of likelihoods without noise, by what each parameter is.
_SHARED: WeakKeyDictionary[Likelihood, dict[tuple[str, ...], list[Permutation]]] = WeakKeyDictionary()
#: Most evaluations of a search for symmetries.
MOST_EVALUATIONS = 200


def like_parameters(model: Model) -> list[str]:
    """Return of each unknown parameter what it is, in words: only like ones may be interchangeable.

    That is where it acts (stiffness, damping, mass; types of nodes), and its scale.
    """
    roles: dict[str, set[str]] = {unknown.name: set() for unknown in model.unknowns}
    acting: list[tuple[str, Sequence[str]]] = []
    if isinstance(model, StructuralModel):
        acting = [(term.letter, tuple(term.coefficient.names)) for term in (*model.joint_terms, *model.terms)]
    else:
        from dynid.identification.systems.graph_system import IdentifiedGraph

        nodes = model.graph.nodes.values() if isinstance(model, IdentifiedGraph) else ()
        acting = [(node.type, tuple(node.dependent.names)) for node in nodes if node.dependent is not None]
    for role, names in acting:
        for name in names:
            if name in roles:
                roles[name].add(role)
    return [
        f"{unknown.scale} {' '.join(sorted(roles[unknown.name])) or unknown.unit}"
        for unknown in model.unknowns
    ]


def distinct_kinds(kinds: Sequence[str], names: Sequence[str], alone: Sequence[bool]) -> list[str]:
    """Return what each parameter is, its name for those that are to be exchanged with no other."""
    return [name if single else kind for kind, name, single in zip(kinds, names, alone, strict=True)]


def image(permutation: Permutation, eta: Array) -> Array:
    """Return the image of coordinates (p) by a permutation."""
    moved = np.empty_like(eta)
    moved[list(permutation)] = eta
    return moved


def images(permutations: Sequence[Permutation], eta: Array, same: Array, max_count: int) -> list[Array]:
    """Return coordinates (p) with their images by the group of permutations, each once, up to `max_count`.

    Two are one where no coordinate differs by more than `same` (p).
    """
    orbit = [eta]
    for point in orbit:
        for permutation in permutations:
            moved = image(permutation, point)
            if len(orbit) < max_count and not any(
                np.all(np.abs(moved - point_of_orbit) <= same) for point_of_orbit in orbit
            ):
                orbit.append(moved)
    return orbit


def symmetries(likelihood: Likelihood, kinds: Sequence[str], eta: Array) -> list[Permutation]:
    """Return permutations of the unknown parameters that leave the prediction as it is, without the identity.

    They generate the group of all. Of large records the first parts are compared: a symmetry shows in any.
    Likelihoods that share their records without noise share their symmetries.

    `likelihood`: the likelihood of the records, whose values do not matter; `kinds`: what each parameter is
    (p): only those of one kind are exchanged. `eta`: coordinates (p) near which predictions exist.
    """
    if (noiseless := likelihood.noiseless) is not None:
        shared = _SHARED.setdefault(noiseless, {})
        if (key := tuple(kinds)) not in shared:
            shared[key] = symmetries(noiseless, kinds, starts(noiseless.unknowns))
        return shared[key]
    try:
        return _Search(likelihood.shortened(eta), kinds, eta).permutations()
    except (DynidError, ArithmeticError, np.linalg.LinAlgError):
        return []  # without a prediction there is nothing to compare


def nearly_symmetric(likelihood: Likelihood, kinds: Sequence[str], eta: Array) -> bool:
    """Return True if derivatives of like parameters nearly agree where these are equal."""
    try:
        return bool(_Search(likelihood.shortened(eta), kinds, eta).candidates(_NEARLY_EQUAL_REL_TOL))
    except (DynidError, ArithmeticError, np.linalg.LinAlgError):
        return False


def centre_of(kinds: Sequence[str], eta: Array) -> Array:
    """Return the coordinates (p) at which like parameters are equal: their means."""
    array = np.array(kinds)
    return np.array([eta[array == kind].mean() for kind in kinds])


class _ExhaustedError(ArithmeticError):
    """The search has used up its evaluations."""


@dataclass(eq=False)
class _Search:
    """A search for symmetries; see `symmetries`."""

    likelihood: Likelihood
    kinds: Sequence[str]
    eta: Array
    evaluations: int = 0
    _signatures: dict[bytes, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.units = self.likelihood.priors.units
        self.levels = [record.data.rms for record in self.likelihood.records]
        self.has_derivatives = isinstance(self.likelihood, FrfLikelihood)
        kinds = list(self.kinds)
        self.comparable = np.array([kinds.count(kind) > 1 for kind in kinds])

    def permutations(self) -> list[Permutation]:
        """Return the permutations."""
        pairs = self.candidates(_MODEL_RTOL)
        if not pairs:
            return []
        centre = centre_of(self.kinds, self.eta)
        confirmed: list[Permutation] = []
        point, residuals = self._random_point(centre)
        for i, j in pairs:
            if any(permutation[i] == j or permutation[j] == i for permutation in confirmed):
                continue
            try:
                permutation = self._extended(centre, [(i, j)])
                if permutation is not None and _alike(residuals, self._residuals(image(permutation, point))):
                    confirmed.append(permutation)
            except _ExhaustedError:
                break
        return confirmed

    def candidates(self, tolerance: float) -> list[tuple[int, int]]:
        """Return the pairs of parameters whose derivatives agree where like parameters are equal."""
        if not self.comparable.any():
            return []
        rows = self._derivatives(centre_of(self.kinds, self.eta))
        pairs = combinations(np.flatnonzero(self.comparable).tolist(), 2)
        return [
            (i, j)
            for i, j in pairs
            if self.kinds[i] == self.kinds[j] and rows[i].any() and _alike(rows[i], rows[j], tolerance)
        ]

    def _random_point(self, centre: Array) -> tuple[Array, Array]:
        """Return a point at which no parameters are equal, with the residuals there."""
        generator = np.random.Generator(np.random.PCG64(0))
        for attempt in range(_POINT_ATTEMPTS):
            point = centre + _RANDOM_POINT_DEVIATION / 2**attempt * self.units * generator.standard_normal(
                len(centre)
            )
            try:
                return point, self._residuals(point)
            except DynidError:
                if attempt == _POINT_ATTEMPTS - 1:
                    raise
        raise AssertionError

    def _extended(self, centre: Array, fixed: list[tuple[int, int]]) -> Permutation | None:
        """Return a permutation with these images of parameters, if derivatives allow one; else None."""
        raised = np.zeros((2, len(centre)))
        for size, pair in zip(_RAISED, fixed, strict=False):
            for point, k in zip(raised, pair, strict=True):
                point[k] = size * self.units[k]
        source, target = (self._derivatives(centre + point) for point in raised)
        allowed = np.array(
            [
                [self.kinds[k] == self.kinds[m] and _alike(source[k], target[m]) for m in range(len(centre))]
                for k in range(len(centre))
            ]
        )
        assigned = dict(fixed)
        if not all(allowed[k, m] for k, m in fixed):
            return None
        for k in np.argsort(allowed.sum(axis=1), kind="stable").tolist():  # what is unique comes first
            if k in assigned:
                continue
            left = [m for m in np.flatnonzero(allowed[k]).tolist() if m not in assigned.values()]
            if not left:
                return None
            back = [m for m in left if assigned.get(m) == k]  # an exchange, else none
            assigned[k] = back[0] if back else k if k in left else left[0]
        return tuple(assigned[k] for k in range(len(centre)))

    def _derivatives(self, eta: Array) -> Array:
        """Return what the prediction changes by with each parameter (p x values)."""
        # Only frequency responses have derivatives that a symmetry permutes. Those of a record of time are
        # taken at a fitted initial state, whose unobservable part is arbitrary, and modes whose frequencies
        # coincide have none: there they are differences over a finite step.
        key = eta.tobytes()
        if key in self._signatures:
            return self._signatures[key]
        if self.has_derivatives:
            self._count()
            with guarded("the prediction"):
                fit = self.likelihood.fit(eta, self.levels)
                rows = self.likelihood.information(fit, self.levels, prior=False).projected.T
        else:
            base = self._residuals(eta)
            rows = np.zeros((len(eta), len(base)))
            for k in np.flatnonzero(self.comparable):
                step = np.where(np.arange(len(eta)) == k, _DIFFERENCE_STEP * self.units, 0.0)
                rows[k] = self._residuals(eta + step) - base
        self._signatures[key] = rows
        return rows

    def _residuals(self, eta: Array) -> Array:
        """Return the residuals of all records in units of their RMS (values), initial states fitted."""
        self._count()
        with guarded("the prediction"):
            residuals = [
                record.residual(eta) / level
                for record, level in zip(self.likelihood.records, self.levels, strict=True)
            ]
        return np.concatenate([np.nan_to_num(residual).ravel() for residual in residuals])

    def _count(self) -> None:
        self.evaluations += 1
        if self.evaluations > MOST_EVALUATIONS:
            raise _ExhaustedError


def _alike(first: Array, second: Array, tolerance: float = _MODEL_RTOL) -> bool:
    """Return True if two arrays are equal to a tolerance, by default that of round-off."""
    largest = max(float(np.linalg.norm(first)), float(np.linalg.norm(second)))
    return float(np.linalg.norm(first - second)) <= tolerance * largest


def interchangeable(names: Sequence[str], permutations: Sequence[Permutation]) -> list[list[list[str]]]:
    """Return sets of groups of parameters that are interchangeable as wholes, by name.

    Each set has two or more groups of one length; the values of one group may stand in any other.
    """
    orbits: list[set[int]] = []
    for permutation in permutations:
        for k, m in enumerate(permutation):
            if k != m:
                touched = [orbit for orbit in orbits if k in orbit or m in orbit]
                orbits = [orbit for orbit in orbits if orbit not in touched]
                orbits.append({k, m}.union(*touched))
    # Orbits that one permutation moves together are of one set; their members belong together in groups.
    sets: list[list[set[int]]] = []
    for orbit in sorted(orbits, key=min):
        for members in sets:
            together = any(
                any(p[k] != k for k in orbit) and any(p[k] != k for k in members[0]) for p in permutations
            )
            if together and len(members[0]) == len(orbit):
                members.append(orbit)
                break
        else:
            sets.append([orbit])
    return [_groups(names, members, permutations) for members in sets]


def _groups(
    names: Sequence[str], orbits: Sequence[set[int]], permutations: Sequence[Permutation]
) -> list[list[str]]:
    """Return the groups of parameters, one of each orbit, that permutations move together."""
    first = [min(orbit) for orbit in orbits]
    groups, edge = {first[0]: first}, [first]
    while edge:
        group = edge.pop()
        for permutation in permutations:
            moved = [permutation[k] for k in group]
            if moved[0] not in groups:
                groups[moved[0]] = moved
                edge.append(moved)
    return [[names[k] for k in groups[head]] for head in sorted(groups)]
