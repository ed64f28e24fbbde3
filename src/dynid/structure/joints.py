"""Joints: springs, dampers and masses, loss factors, or measured blocks, between DOFs or to ground.

Source: K. T. Yang 1997, eq 1 (the matrices C_s, K_s).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from dynid.arithmetic.dependent import Dependent, Real
from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.parameters import ParameterPrior
from dynid.structure.labels import Label
from dynid.structure.matrices import DependentMatrix, as_array, entries

if TYPE_CHECKING:
    from dynid.structure.law import Law

Block: TypeAlias = Sequence[Sequence[Real]] | Array

# A block that is negative by less, relative to its diagonal, is one of rounded or measured digits.
_DEFINITENESS_TOL = 1e-9


@dataclass(frozen=True)
class JointParameter:
    """Stiffness, damping or loss factor of a joint: known (`value`), or unknown (`start`)."""

    # The known value, N/m or N·s/m (N·m/rad, N·m·s/rad for rotations), or one that depends on unknown
    # parameters of the structure, which joints may share.
    value: Real | None = None
    start: float | None = None  # initial guess of an unknown value, positive
    # The unknown's true value where it is known, positive: what simulated records are made with.
    true: float | None = None
    # A block over the joint's DOFs that value, start and true value multiply, symmetric and not indefinite;
    # default: the spring between two DOFs or to ground. With a matrix alone the value is 1.
    matrix: Block | None = None
    # Limits of an unknown value, positive; its start lies within.
    low: float | None = None
    high: float | None = None
    prior: ParameterPrior | None = None  # prior of an unknown value
    signed: bool = (
        False  # True if it may be negative or zero: of a law, estimated itself, not as its logarithm
    )
    spread: float | None = None  # what a signed start of 0 may be off by; default: that of a `Parameter`

    def __post_init__(self) -> None:
        if self.matrix is not None:
            object.__setattr__(self, "matrix", _block(self.matrix))
            if self.value is None and self.start is None:
                object.__setattr__(self, "value", 1.0)
        if (self.value is None) == (self.start is None):
            raise UsageError("a joint parameter takes either a value (known) or a start (unknown)")
        if self.value is not None and self.true is not None:
            raise UsageError("a known joint parameter has no true value beside its value")
        value, signed = self.value, self.signed or isinstance(self.value, Dependent)
        if value is not None and not (math.isfinite(float(value)) and (signed or float(value) >= 0)):
            raise UsageError("a joint parameter's value must be finite and not negative")
        for number in (self.start, self.true):
            if number is not None and not (math.isfinite(number) and (self.signed or number > 0)):
                raise UsageError(
                    "start and true value of an unknown joint parameter must be finite and positive",
                    remedy="Its logarithm is estimated. Leave k or c out where a joint has none.",
                )
        self._check_unknown()

    def _check_unknown(self) -> None:
        """Refuse limits, prior and matrix that make no sense beside a start."""
        limits = [number for number in (self.low, self.high) if number is not None]
        if self.prior is not None:
            limits += [self.prior.value, self.prior.relative]
        if limits and self.start is None:
            raise UsageError("limits and a prior belong to an unknown joint parameter, one with a start")
        if not all(math.isfinite(number) and (self.signed or number > 0) for number in limits):
            raise UsageError("limits and prior of a joint parameter must be finite and positive")
        if self.start is not None and self.matrix is not None and entries(self.matrix).terms:
            raise UsageError(
                "the matrix that an unknown joint parameter multiplies must be known",
                remedy="Leave out the start, or name no unknown parameters in the matrix.",
            )
        low = self.low if self.low is not None else -math.inf
        high = self.high if self.high is not None else math.inf
        if self.start is not None and not low <= self.start <= high:
            raise UsageError("the start of a joint parameter must lie within its limits")


@dataclass(frozen=True)
class JointLaw:
    """A nonlinear law of a joint, with its parameters in the order of the law's names."""

    law: Law
    parameters: tuple[JointParameter, ...]


@dataclass(frozen=True)
class Joint:
    """A spring and a damper in parallel, with mass if it has any; or blocks over several DOFs."""

    name: str  # its name; its parameters are called ``<name>.k`` and ``<name>.c``
    dofs: tuple[Label, ...]  # one DOF (joint to ground) or two; with blocks any number
    # Stiffness and damping: a number is a known value, a square array a block over the DOFs, absent zero.
    k: JointParameter | Real | Block | None = None
    c: JointParameter | Real | Block | None = None
    # Mass, which may depend on parameters of the structure. A number is shared equally between the DOFs.
    m: JointParameter | Real | Block | None = None
    # Loss factor of its stiffness: structural damping, an imaginary part ``eta k`` of the stiffness.
    eta: JointParameter | Real | None = None
    # The direction of one component of a joint between points, such as ``x``: its parameters are called
    # ``<name>.k.x`` and ``<name>.c.x``.
    component: str = ""
    # The frequency, rad/s, at which a damper eta k / omega stands for the loss factor; default: none does.
    viscous_at: float | None = None
    laws: tuple[JointLaw, ...] = ()  # nonlinear laws, in parallel with stiffness and damping
    offset: JointParameter | None = None  # deflection at rest by a preload, m or rad: laws begin there

    def __post_init__(self) -> None:
        object.__setattr__(self, "dofs", tuple(self.dofs))
        try:
            for letter in ("k", "c", "m", "eta"):
                component = getattr(self, letter)
                if isinstance(component, Sequence | np.ndarray):
                    component = JointParameter(matrix=component)
                elif component is not None and not isinstance(component, JointParameter):
                    component = JointParameter(
                        value=component if isinstance(component, Dependent) else float(component)
                    )
                object.__setattr__(self, letter, component)
        except UsageError as error:
            raise UsageError(
                f"joint {self.name}: {error.problem}", remedy=error.remedy, names=(self.name,)
            ) from None
        if isinstance(self.eta, JointParameter) and (self.k is None or self.eta.matrix is not None):
            raise self._refused("has a loss factor eta: a number that multiplies its stiffness k")
        blocks = {
            component.letter: component for component in self.terms if component.parameter.matrix is not None
        }
        scalar = any(term.parameter.matrix is None and term.parameter is not self.eta for term in self.terms)
        scalar = scalar or bool(self.laws)
        if not self.dofs or len(set(self.dofs)) != len(self.dofs) or (scalar and len(self.dofs) > 2):
            raise self._refused("must name one DOF (to ground) or two different ones")
        for letter, component in blocks.items():
            if len(component.block) != len(self.dofs):
                size = len(component.block)
                raise self._refused(f"names {len(self.dofs)} DOFs, but its {letter} is {size} x {size}")
        if isinstance(self.m, JointParameter) and self.m.start is not None:
            raise self._refused("can have unknown stiffness and damping of its own, not mass")

    @property
    def law_parameters(self) -> tuple[tuple[tuple[str, JointParameter], ...], ...]:
        """Names and parameters of each law, and last those of the offset, if there is one.

        A parameter is called ``<joint>.<name>``; of a further law of its kind, or where an earlier law has
        one of that name, ``<joint>.<kind>_<number>.<name>`` (of the first of its kind without number).
        """
        component = f".{self.component}" if self.component else ""
        named, used, counts = [], set[str](), dict[str, int]()
        for item in self.laws:
            kind = item.law.kind
            counts[kind] = counts.get(kind, 0) + 1
            numbered = f"{kind}_{counts[kind]}" if counts[kind] > 1 else kind
            further = counts[kind] > 1 or not used.isdisjoint(item.law.names)
            prefix = f"{self.name}.{numbered}" if further else self.name
            used |= {*item.law.names}
            names = [f"{prefix}.{name}{component}" for name in item.law.names]
            named.append(tuple(zip(names, item.parameters, strict=True)))
        offset = () if self.offset is None else ((f"{self.name}.offset{component}", self.offset),)
        return (*named, offset)

    def _refused(self, said: str) -> UsageError:
        return UsageError(f"joint {self.name} {said}", names=(self.name,))

    @property
    def terms(self) -> tuple[_JointTerm, ...]:
        """Its contributions to the matrices, stiffness first."""
        parts = {"k": self.k, "c": self.c, "m": self.m}
        count, terms = len(self.dofs), []
        component = f".{self.component}" if self.component else ""
        direction = np.array([1.0, -1.0])[:count]
        for letter, values in parts.items():
            if not isinstance(values, JointParameter):
                continue
            if values.matrix is not None:
                block = entries(values.matrix)
            else:
                pattern = np.eye(count) / count if letter == "m" else np.outer(direction, direction)
                block = DependentMatrix(pattern)
            terms.append(_JointTerm(f"{self.name}.{letter}{component}", letter, values, block, letter))
        if isinstance(self.eta, JointParameter):
            block = terms[0].product  # of its stiffness
            letter = "h" if self.viscous_at is None else "c"
            block = block if self.viscous_at is None else block.times(1 / self.viscous_at)
            terms.append(_JointTerm(f"{self.name}.eta{component}", letter, self.eta, block, "eta"))
        return tuple(terms)


class _JointTerm(NamedTuple):
    """A joint's contribution: name, letter (k, c, m, h), parameter, the block (d x d) it multiplies, key."""

    name: str
    letter: str
    parameter: JointParameter
    whole: DependentMatrix
    key: str  # of the joint: k, c, m, eta

    @property
    def block(self) -> Array:
        """The block at the reference values of parameters."""
        return as_array(self.whole.reference)

    @property
    def product(self) -> DependentMatrix:
        """The block times its value, of an unknown one as the parameter that it is."""
        parameter = self.parameter
        unknown = None if parameter.start is None else Dependent.parameter(self.name, parameter.start)
        return self.whole.times(unknown or parameter.value or 0.0)


def unit_of(letter: str, kinds: Collection[str]) -> str:
    """Return the unit of a value (k, c, m) between DOFs of these kinds; empty if one is "unknown"."""
    if "unknown" in kinds:
        return ""
    turning = set(kinds) == {"rotation"}
    return {"k": ("N/m", "N.m/rad"), "c": ("N.s/m", "N.m.s/rad"), "m": ("kg", "kg.m^2")}[letter][turning]


def angular(unit: str) -> str:
    """Return the unit over a rotation of one over a deflection: m becomes rad, N a moment."""
    return unit.replace("m", "rad").replace("N", "N.m")


def _block(values: Block) -> tuple[tuple[Real, ...], ...]:
    """Return a block as rows, checked at the reference values of parameters."""
    try:
        block = np.array(values, dtype=float)
    except ValueError:
        raise UsageError("the rows of a joint's matrix differ in length") from None
    if block.ndim != 2 or block.shape[0] != block.shape[1] or not block.size:
        raise UsageError(f"a joint's matrix must be square, not {' x '.join(map(str, block.shape))}")
    if not np.isfinite(block).all():
        raise UsageError("a joint's matrix has entries that are not finite numbers")
    size = float(np.abs(block).max())
    gap = np.abs(block - block.T)
    if gap.max() > _DEFINITENESS_TOL * size:
        i, j = np.unravel_index(int(np.argmax(gap)), gap.shape)
        raise UsageError(
            f"a joint's matrix must be symmetric: entry ({i + 1}, {j + 1}) is {block[i, j]:g}, "
            f"({j + 1}, {i + 1}) is {block[j, i]:g}"
        )
    block = (block + block.T) / 2
    lowest = float(np.linalg.eigvalsh(block / (size or 1.0))[0]) * size
    if lowest < -_DEFINITENESS_TOL * size:
        raise UsageError(
            f"a joint's matrix must not be indefinite: its lowest eigenvalue is {lowest:.3g}",
            remedy="A passive joint stores and dissipates energy; check its signs.",
        )
    return tuple(
        tuple(entry if isinstance(entry, Dependent) else even for entry, even in zip(*rows, strict=True))
        for rows in zip(values, block.tolist(), strict=True)
    )
