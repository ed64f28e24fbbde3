"""Samples of a reduction that differ in numbers of the structure and its joints, side by side in stacks.

What they share is read, checked and assembled once: the matrices are sums of constant patterns, whose factors
are evaluated for all samples. A sample beyond the usual case (see `dynid.structure.reduction.stacks`), or
with a fault, is run alone.

Numbers agree with those of each sample alone within the rounding of the matrices' entries, which
``frequency_uncertainty`` states: their sums and products are taken in another order. Every plan is checked
against the scene as it stands.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.dependent import Dependent, Real
from dynid.arithmetic.expression import Expression
from dynid.arithmetic.numbers import Number
from dynid.arrays import Array
from dynid.defaults import DENSE_MODES
from dynid.errors import DynidError, SceneError
from dynid.result import Variable
from dynid.scene.batch import (
    BatchKey,
    NotShared,
    SampleColumn,
    dependent_parameters,
    evaluate,
    numbers,
    varied_parameter,
)
from dynid.scene.kinds.parameters import with_quantities
from dynid.scene.kinds.reduction import interest_of, responses_of, run
from dynid.scene.kinds.structures import build_structure
from dynid.scene.load import Scene, with_text_keys
from dynid.scene.outcomes import SampleBlock, SampleOutcomes, gather
from dynid.scene.schema.quantities import Quantity
from dynid.scene.schema.raw import read_names
from dynid.scene.schema.reduction import (
    CraigBamptonModel,
    DynamicModel,
    GuyanModel,
    JointAwareModel,
    MastersModel,
    ModalModel,
    ModesModel,
    ReductionScene,
    SerepModel,
    result_names,
)
from dynid.scene.yaml.source import path_of, set_values
from dynid.structure.correlation import frac
from dynid.structure.frf import Ports, direct
from dynid.structure.matrices import as_array
from dynid.structure.model import StructuralModel
from dynid.structure.ports import ports
from dynid.structure.reduction import stacks
from dynid.structure.reduction.masters import indices_of, interesting
from dynid.structure.reduction.mode_selection import Interest
from dynid.structure.reduction.stacks import Stack, StackedReduction
from dynid.units import angular_factor

Overrides = Sequence[Mapping[str, Any]]

# Structures of more DOFs are run one by one: the work in their matrices is all that counts there.
_MOST_DOFS = DENSE_MODES.value
# Numbers in the matrices of the samples that are worked on together: these are in fast memory.
_TOGETHER = 50_000
# A constant part below this part of the varied ones at the reference has lost digits to them.
_BESIDE = 1 / 64
# How far a plan may differ from the scene run alone, beside the uncertainty of frequencies: in parts of an
# array's largest entry.
_AGREEMENT = 1e-9


def batched(template: Scene, overrides: Overrides, collect: tuple[str, ...]) -> SampleOutcomes | None:
    """Run samples together where they differ in numbers of the structure and its joints alone.

    Returns
    -------
    SampleOutcomes or None
        Those that are to be run alone are pending; None where the samples share too little.
    """
    paths = tuple(overrides[0]) if overrides else ()
    if not paths or any(tuple(one) != paths for one in overrides):
        return None
    plan = _planned(BatchKey.of(template, paths, collect))
    if isinstance(plan, str):
        return None
    step = max(1, _TOGETHER // plan.size**2)
    rows = range(0, len(overrides), step)
    blocks = [plan.run(overrides[row : row + step], row) for row in rows]
    return SampleOutcomes([block for block in blocks if len(block)], len(overrides))


def why_alone(template: Scene, paths: Sequence[str], collect: tuple[str, ...]) -> str:
    """Return why samples that differ at these paths are not run together; empty where they are."""
    plan = _planned(BatchKey.of(template, paths, collect))
    return plan if isinstance(plan, str) else ""


@lru_cache(maxsize=4)
def _planned(family: BatchKey) -> _ReductionBatch | str:
    """Return the plan of a batch, made once a process; or why there is none."""
    from pydantic import ValidationError

    try:
        exemplar = run(family.scene)
        plan = _ReductionBatch(family.scene, family.paths, gather(exemplar, family.collect))
        plan.check()
        return plan
    except NotShared as why:
        return str(why)
    except ValidationError:
        return "what varies is more than numbers of the structure and its joints"
    except (DynidError, ArithmeticError, SceneError):
        return "the scene as it stands cannot be run"


class _VaryingMatrix(NamedTuple):
    """A matrix (n x n) as a constant one and patterns with factors that vary; `weak`: digits are lost."""

    constant: Array
    terms: list[tuple[Dependent, Array]]
    weak: bool

    @classmethod
    def of(cls, reference: Array, terms: Sequence[tuple[Dependent, Array]]) -> _VaryingMatrix:
        """Return the matrix with this value at the reference values of the parameters."""
        varied = sum((float(c) * pattern for c, pattern in terms), np.zeros_like(reference))
        size = sum((np.abs(float(c) * pattern) for c, pattern in terms), np.zeros_like(reference))
        rest = reference - varied
        rest[np.abs(rest) <= 8 * np.finfo(float).eps * size] = 0.0
        beside = (rest != 0) & (np.abs(rest) < _BESIDE * size)
        return cls(rest, list(terms), bool(beside.any()))

    def at(self, values: Mapping[str, Array], count: int) -> tuple[Array, NDArray[np.bool_]]:
        """Return the matrices of samples (s x n x n), and which of them have all their digits."""
        total = np.broadcast_to(self.constant, (count, *self.constant.shape)).copy()
        whole = np.ones(count, dtype=bool)
        for coefficient, pattern in self.terms:
            factor = np.broadcast_to(coefficient.fold(_leaf(values), _operated), (count,))
            total += factor[:, None, None] * pattern
            whole &= np.isfinite(factor) & (
                not self.weak or np.abs(factor) > _BESIDE * abs(float(coefficient))
            )
        return total, whole


def _leaf(values: Mapping[str, Array]) -> Callable[[Real], Any]:
    return lambda item: values[item.operands[0]] if isinstance(item, Dependent) else float(item)


def _operated(node: Dependent, operands: list[Any]) -> Any:
    """Return the result of an operation on numbers, or arrays of them."""
    a, b = operands[0], operands[-1]
    match node.operation:
        case "+":
            return a + b
        case "-":
            return a - b
        case "*":
            return a * b
        case "/":
            return a / b
        case "**":
            return a**b
        case "neg":
            return -a
        case "sqrt":
            return np.sqrt(a)
    raise NotShared(f"the matrices take the function {node.operation} of what varies")


class _ReductionBatch:
    """Samples of one structure and its reductions.

    Parameters
    ----------
    scene
        The scene.
    paths
        The dotted paths of what varies.
    exemplar
        What is collected, of the scene as it stands.
    """

    def __init__(self, scene: Scene, paths: Sequence[str], exemplar: Mapping[str, Variable]) -> None:
        self._exemplar = exemplar
        model = self._varying_model(scene, paths)
        self._structure = build_structure(Scene(scene.source, model), model.structure, model.joints)
        self.size = self._structure.size
        if self._structure.is_sparse or self.size > _MOST_DOFS:
            raise NotShared(f"structures of more than {_MOST_DOFS} DOFs are reduced one by one")
        if self._structure.modal is not None:
            raise NotShared("modal damping is computed sample by sample")
        bare: list[_VaryingMatrix] = []
        joints: list[_VaryingMatrix] = []
        for letter, joined in zip("MCK", self._structure.with_joints(), strict=True):
            own = as_array(getattr(self._structure, letter))
            for found, whole, terms in (
                (bare, own, self._structure.terms),
                (joints, as_array(joined) - own, self._structure.joint_terms),
            ):
                parts = [(one.coefficient, as_array(one.matrix)) for one in terms if one.letter == letter]
                found.append(_VaryingMatrix.of(whole, parts))
        self._bare, self._joints = bare, joints
        names = result_names([part.method for part in model.reduction])
        self._methods = {
            name: _method(part, self._structure, interest_of(model))
            for name, part in zip(names, model.reduction, strict=True)
        }
        self._responses = responses_of(model, self._structure)
        for path in exemplar:
            self._array(path)  # raises where it is none of these

    def _varying_model(self, scene: Scene, paths: Sequence[str]) -> ReductionScene:
        """Return the model of the scene, each quantity that varies a parameter of its own."""
        source = scene.source
        if source.written is not None:
            raise NotShared("the scene is composed of files")
        self._parameters: dict[str, str] = {}  # by path
        for place, path in enumerate(paths):
            name = varied_parameter(scene.model.parameters, path.split("."))
            if name is None:  # a value in the structure: as if it were written with a parameter
                value: Any = source.data
                for key in path_of(source, path):
                    value = value.get(key) if isinstance(value, dict) else value[key]
                if isinstance(value, bool) or not isinstance(value, int | float | str):
                    raise NotShared(f"{path} is no number of the structure or its joints")
                name = f"varied_value_{place}"
                source = set_values(source, {f"parameters.{name}": value, path: name})
            self._parameters[path] = name
        self._fixed = read_names(source)[0].parameters
        if odd := next((path for path, name in self._parameters.items() if name not in self._fixed), ""):
            raise NotShared(f"{odd} is no number of the structure or its joints")
        self.reference = {path: float(self._fixed[name]) for path, name in self._parameters.items()}
        free = {name: float(self._fixed[name]) for name in self._parameters.values()}
        self._dependent = dependent_parameters(source.data.get("parameters") or {}, free)
        names = read_names(source, free=free)[0]
        model = ReductionScene.model_validate(with_text_keys(source.data), context=names)
        self._expressions: dict[str, Expression] = {}

        def own(quantity: Quantity) -> Quantity:
            if quantity.dependent is None or quantity.expression is None:
                return quantity
            text = quantity.expression.text
            self._expressions[text] = quantity.expression
            number = Dependent.parameter(text, float(quantity.value))
            return Quantity(quantity.value, quantity.expression, number)

        return cast("ReductionScene", with_quantities(model, own))

    def check(self) -> None:
        """Compare the scene as it stands with its run alone."""
        found = self.run([self.reference], 0)
        if not len(found):
            raise NotShared(
                "the scene as it stands is no usual case: rigid-body motions or massless DOFs, soft springs, "
                "or masters that barely see a mode"
            )
        for path, variable in self._exemplar.items():
            data, other = variable.data, found.values[path].data[0]
            if data.dtype.kind in "fc":
                size = np.abs(data).max(initial=0.0)
                if path.endswith("error"):
                    size = 1.0
                agrees = bool(np.all(np.abs(data - other) <= _AGREEMENT * size))
            else:
                agrees = np.array_equal(data, other)
            if not agrees:
                raise NotShared(f"rounding moves {path} of the scene as it stands")

    def run(self, overrides: Overrides, first: int) -> SampleBlock:
        """Return the samples of the usual case, their rows counted from `first`."""
        count = len(overrides)
        values, sure = self._quantities(overrides)
        try:
            with np.errstate(all="ignore"):  # of samples that are not sure
                arrays, usual = self._arrays(values, count)
        except np.linalg.LinAlgError:
            arrays, usual = {}, np.zeros(count, dtype=bool)
        places = np.flatnonzero(sure & usual)
        found: dict[str, Variable] = {}
        for path, variable in self._exemplar.items() if len(places) else ():
            data = variable.data
            key = self._array(path)
            stack = np.broadcast_to(data, (len(places), *data.shape)) if key is None else arrays[key][places]
            found[path] = Variable(("sample", *variable.dims), stack, variable.units, variable.attrs)
        return SampleBlock(first + places, found, np.zeros((len(places), 0), dtype=bool))

    def _quantities(self, overrides: Overrides) -> tuple[dict[str, Array], NDArray[np.bool_]]:
        """Return the values of quantities by their expressions (samples), and where all are positive."""
        count = len(overrides)
        known: dict[str, Number | SampleColumn] = dict(self._fixed)
        for path, name in self._parameters.items():
            known[name] = numbers([one[path] for one in overrides])
        for name, expression in self._dependent.items():
            known[name] = evaluate(expression, known, count)
        sure = np.ones(count, dtype=bool)
        for name in self._parameters.values():  # also one that nothing depends on must have a value
            sure &= np.array([value is not None for value in cast("SampleColumn", known[name])])
        values = {}
        for text, expression in self._expressions.items():
            column = np.array([_float(value) for value in evaluate(expression, known, count)])
            positive = np.isfinite(column) & (column > 0)
            values[text] = np.where(positive, column, float(1))
            sure &= positive
        return values, sure

    def _arrays(
        self, values: Mapping[str, Array], count: int
    ) -> tuple[dict[tuple[str, str], Array], NDArray[np.bool_]]:
        """Return the collected arrays by the reduction, or `frf`, and their names; and which are sure."""
        sure = np.ones(count, dtype=bool)
        bare: list[Array] = []
        joints: list[Array] = []
        for matrices, varying in ((bare, self._bare), (joints, self._joints)):
            for each in varying:
                matrix, whole = each.at(values, count)
                whole &= np.isfinite(matrix).all(axis=(1, 2))
                matrices.append(np.where(whole[:, None, None], matrix, np.eye(self.size)))
                sure &= whole
        own = full = Stack(*bare)
        if self._structure.joints:
            full = Stack(*(a + b for a, b in zip(bare, joints, strict=True)))
        made = {name: reduce(own, full) for name, reduce in self._methods.items()}
        wanted = {key for path in self._exemplar if (key := self._array(path))}
        modes = full.modes(max(max(one.numbers) for one in made.values()))
        out: dict[tuple[str, str], Array] = {}
        for name, one in made.items():
            names = {array for group, array in wanted if group == name}
            found, usual = stacks.compared(modes, full, one, names)
            sure &= usual
            for item in names & found.keys():
                out[name, item] = found[item]
                sure &= np.isfinite(found[item]).all(axis=tuple(range(1, found[item].ndim)))
        if any(group == "frf" for group, _ in wanted):
            self._add_responses(out, full, made, sure)
        return out, sure

    def _add_responses(
        self,
        out: dict[tuple[str, str], Any],
        full: Stack,
        made: Mapping[str, StackedReduction],
        sure: NDArray[np.bool_],
    ) -> None:
        """Add the frequency responses, sample by sample; one that fails is not sure any more."""
        asked = self._responses
        assert asked is not None
        forces, rows, powers = ports(self._structure, asked.inputs, asked.outputs)
        shape = (len(sure), len(asked.omega), len(asked.outputs), len(asked.inputs))
        responses = {name: np.zeros(shape, dtype=complex) for name in ("full", *made)}
        shares = np.zeros((len(sure), len(made), *shape[2:]))
        for s in np.flatnonzero(sure):
            try:
                exact = direct(full.M[s], full.C[s], full.K[s], Ports(forces, rows, powers), asked.omega)
                for place, (name, one) in enumerate(made.items()):
                    where = Ports(one.T[s].T @ forces, rows @ one.T[s], powers)
                    responses[name][s] = direct(
                        one.whole.M[s], one.whole.C[s], one.whole.K[s], where, asked.omega
                    )
                    shares[s, place] = frac(responses[name][s], exact)
            except DynidError:
                sure[s] = False
            else:
                responses["full"][s] = exact
        out.update({("frf", name): array for name, array in (*responses.items(), ("frac", shares))})

    def _array(self, path: str) -> tuple[str, str] | None:
        """Return the reduction, or `frf`, and the name of a collected array; None of a constant one."""
        group, _, name = path.rpartition("/")
        of = group.removeprefix("reduction/")
        if self._exemplar[path].dims == (name,) or (name in _CONSTANT and group.startswith("reduction/")):
            return None
        if of == "frf" and (name in ("full", "frac") or name in self._methods):
            return "frf", name
        if of in self._methods and (name in stacks.NAMES or (name == "condition" and self._methods[of].sees)):
            return of, name
        raise NotShared(f"{path} is computed sample by sample")


#: Arrays of reductions that do not depend on numbers, where masters and modes are given.
_CONSTANT = frozenset({"masters", "modes", "unit"})


def _float(value: Number | None) -> float:
    try:
        return np.nan if value is None else float(value)
    except OverflowError:
        return np.nan


class _Method(NamedTuple):
    """A reduction of stacks; `sees`: it states the condition of the modes at the masters."""

    reduce: Callable[[Stack, Stack], StackedReduction]
    sees: bool = False

    def __call__(self, bare: Stack, whole: Stack) -> StackedReduction:
        """Reduce structures, given without and with joints."""
        return self.reduce(bare, whole)


def _method(part: Any, structure: StructuralModel, interest: Interest) -> _Method:
    """Return a method of the scene for stacks."""
    if isinstance(masters := getattr(part, "masters", None), MastersModel):
        raise NotShared("masters are chosen sample by sample")
    given = indices_of(structure, masters) if masters else interesting(structure, interest)
    match part:
        case JointAwareModel() if part.residuals not in (None, [], "none"):
            return _on_modal_coordinates(part, structure, interest, part.residuals)
        case ModalModel():
            return _on_modal_coordinates(part, structure, interest, part.residuals or "auto")
        case SerepModel() | JointAwareModel():
            modes = _numbers_of(part.modes, len(given) if masters else None)
            if len(modes) != len(given):
                raise NotShared("coordinates are chosen where masters are not as many as modes")
            given = given if masters else np.sort(given)
            aware = isinstance(part, JointAwareModel)
            retained = aware or not structure.joints
            reduce = partial(
                stacks.on_modes, masters=given, modes=modes, joint_aware=aware, retained=retained
            )
            return _Method(reduce, sees=True)
        case GuyanModel():
            return _Method(partial(stacks.condensed, masters=given))
        case DynamicModel():
            band = interest.band
            omega = (
                band and band / 2
                if part.frequency is None
                else angular_factor(part.unit) * float(part.frequency)
            )
            return _Method(partial(stacks.condensed, masters=given, omega=omega or 0.0))
        case CraigBamptonModel():
            return _Method(partial(stacks.condensed, masters=given, fixed=_numbers_of(part.modes, None)))
    raise NotShared(f"the method {part.method} chooses sample by sample")


def _on_modal_coordinates(
    part: JointAwareModel | ModalModel, structure: StructuralModel, interest: Interest, residuals: Any
) -> _Method:
    loads = np.zeros(0, dtype=np.intp)
    if residuals == "auto":
        loads = interesting(structure, interest)
    elif residuals and residuals != "none":
        loads = indices_of(structure, residuals, "residuals")
    modes = _numbers_of(part.modes, None)
    return _Method(partial(stacks.on_modal_coordinates, modes=modes, loads=loads))


def _numbers_of(given: Any, masters: int | None) -> list[int]:
    """Return the numbers of modes that are given, or one a master."""
    if isinstance(given, list):
        return given
    count = given.count if isinstance(given, ModesModel) else masters
    if count is None:
        raise NotShared("how many modes are kept depends on their frequencies")
    return list(range(1, count + 1))
