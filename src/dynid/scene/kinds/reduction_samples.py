"""Samples of a reduction that differ in numbers of the structure and its joints, side by side in stacks.

What they share is read, checked and assembled once: the matrices are sums of constant patterns, whose factors
are evaluated for all samples. Only the methods of which something is collected are run, those samples
together for which a method chooses the same masters and modes. A sample beyond the usual case (see
`dynid.structure.reduction.stacked_methods`), or with a fault, is run alone.

Numbers agree with those of each sample alone within the rounding of the matrices' entries, which
``frequency_uncertainty`` states: their sums and products are taken in another order. Every plan is checked
against the scene as it stands.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.dependent import Dependent, Real
from dynid.arithmetic.expression import Expression
from dynid.arithmetic.numbers import Number
from dynid.arrays import Array
from dynid.defaults import DENSE_MODES
from dynid.errors import DynidError
from dynid.result import Variable
from dynid.scene.batch import (
    NotShared,
    Overrides,
    SampleColumn,
    VariedNumbers,
    evaluate,
    run_alone,
    run_exemplar,
    varied_parameter,
)
from dynid.scene.kinds.parameters import with_quantities
from dynid.scene.kinds.reduction import methods_of, responses_of
from dynid.scene.kinds.structures import build_structure
from dynid.scene.load import Scene, with_text_keys
from dynid.scene.outcomes import SampleBlock, SampleOutcomes
from dynid.scene.schema.quantities import Quantity
from dynid.scene.schema.raw import read_names
from dynid.scene.schema.reduction import ReductionScene
from dynid.scene.yaml.source import path_of, set_values
from dynid.structure.correlation import frac
from dynid.structure.frf import direct
from dynid.structure.matrices import as_array
from dynid.structure.ports import Ports, ports
from dynid.structure.reduction.stacked_methods import StackedEnergies, StackedReduction, compared, stacked
from dynid.structure.reduction.stacked_modes import Choice, Stack
from dynid.structure.reduction_comparison import ARRAYS

# Structures of more DOFs are run one by one: the work in their matrices is all that counts there.
_MAX_DOFS = DENSE_MODES.value
# Numbers in the matrices of the samples that are worked on together: these are in fast memory.
_STACK_NUMBERS = 50_000
# A constant entry smaller than this part of the varied ones at the reference has lost digits to them.
_MIN_CONSTANT = 1 / 64
# How far a plan may differ from the scene run alone, relative to an array's largest entry.
_AGREEMENT = 1e-9


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
        cancelled = (rest != 0) & (np.abs(rest) < _MIN_CONSTANT * size)
        return cls(rest, list(terms), bool(cancelled.any()))

    def at(self, values: Mapping[str, Array], count: int) -> tuple[Array, NDArray[np.bool_]]:
        """Return the matrices of samples (s x n x n), and which of them have all their digits."""
        total = np.broadcast_to(self.constant, (count, *self.constant.shape)).copy()
        exact = np.ones(count, dtype=bool)

        def leaf(item: Real) -> Any:
            return values[item.operands[0]] if isinstance(item, Dependent) else float(item)

        for coefficient, pattern in self.terms:
            factor = np.broadcast_to(coefficient.fold(leaf, _operated), (count,))
            total += factor[:, None, None] * pattern
            large = np.abs(factor) > _MIN_CONSTANT * abs(float(coefficient))
            exact &= np.isfinite(factor) & (not self.weak or large)
        return total, exact


_OPERATIONS: dict[str, Callable[..., Any]] = {
    **{"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "**": operator.pow},
    **{"neg": operator.neg, "sqrt": np.sqrt},
}


def _operated(node: Dependent, operands: list[Any]) -> Any:
    if node.operation not in _OPERATIONS:
        raise NotShared(f"the matrices take the function {node.operation} of what varies")
    return _OPERATIONS[node.operation](*operands)


class ReductionSamples:
    """Samples of one structure and its reductions."""

    def __init__(self, scene: Scene, paths: Sequence[str], collect: tuple[str, ...]) -> None:
        self._scene, self._collect = scene, collect
        model = self._varying_model(scene, paths)
        self._model = model
        self._structure = build_structure(replace(scene, model=model), model.structure, model.joints)
        size = self._structure.size
        if self._structure.hysteretic:
            raise NotShared("structural damping is computed sample by sample")
        if self._structure.is_sparse or size > _MAX_DOFS:
            raise NotShared(f"structures of more than {_MAX_DOFS} DOFs are reduced one by one")
        self._step = max(1, _STACK_NUMBERS // size**2)
        self._bare = self._varying_matrices(joints=False)
        self._joints = self._varying_matrices(joints=True)
        self._responses = responses_of(model, self._structure)
        reference = {path: float(self._numbers.fixed[name]) for path, name in self._parameters.items()}
        self._exemplars: dict[tuple[Choice, ...], Mapping[str, Variable] | None] = {}
        exemplar = run_exemplar(scene, collect)
        located = methods_of(model)
        self._requested = {path: _array_at(path, variable, located) for path, variable in exemplar.items()}
        requested = {key for key in self._requested.values() if key is not None}
        self._responding = any(group == "frf" for group, _ in requested)
        self._names = {
            name: {array for group, array in requested if group == name}
            for name in located
            if self._responding or any(group == name for group, _ in requested)
        }
        damped = self._responding or any("damping" in array for _, array in requested)
        if damped and self._structure.modal:
            raise NotShared("modal damping is computed sample by sample")
        self._methods = {name: stacked(located[name].method, self._structure) for name in self._names}
        self._check(reference, exemplar)

    def _varying_matrices(self, *, joints: bool) -> list[_VaryingMatrix]:
        """Return M, C and K without the joints, or the joints' part of these."""
        structure, matrices = self._structure, []
        terms = structure.joint_terms if joints else structure.terms
        for letter, joined in zip("MCK", structure.with_joints(), strict=True):
            bare = as_array(getattr(structure, letter))
            parts = [(term.coefficient, as_array(term.matrix)) for term in terms if term.letter == letter]
            matrices.append(_VaryingMatrix.of(as_array(joined) - bare if joints else bare, parts))
        return matrices

    def _varying_model(self, scene: Scene, paths: Sequence[str]) -> ReductionScene:
        """Return the model of the scene, each quantity that varies a parameter of its own."""
        from pydantic import ValidationError

        source = scene.source
        if source.written is not None:
            raise NotShared("the scene is composed of files")
        self._parameters: dict[str, str] = {}  # by path
        for index, path in enumerate(paths):
            name = varied_parameter(scene.model.parameters, path.split("."))
            if name is None:  # a value in the structure: as if it were written with a parameter
                value: Any = source.data
                for key in path_of(source, path):
                    value = value.get(key) if isinstance(value, dict) else value[key]
                if isinstance(value, bool) or not isinstance(value, int | float | str):
                    raise NotShared(f"{path} is no number of the structure or its joints")
                name = f"varied_value_{index}"
                source = set_values(source, {f"parameters.{name}": value, path: name})
            self._parameters[path] = name
        fixed = read_names(source)[0].parameters
        if odd := next((path for path, name in self._parameters.items() if name not in fixed), ""):
            raise NotShared(f"{odd} is no number of the structure or its joints")
        free = {name: float(fixed[name]) for name in self._parameters.values()}
        self._numbers = VariedNumbers(source, fixed, self._parameters)
        names = read_names(source, free=free)[0]
        try:
            model = ReductionScene.model_validate(with_text_keys(source.data), context=names)
        except ValidationError:
            problem = "what varies is more than numbers of the structure and its joints"
            raise NotShared(problem) from None
        self._expressions: dict[str, Expression] = {}

        def own(quantity: Quantity) -> Quantity:
            if quantity.dependent is None or quantity.expression is None:
                return quantity
            text = quantity.expression.text
            self._expressions[text] = quantity.expression
            number = Dependent.parameter(text, float(quantity.value))
            return Quantity(quantity.value, quantity.expression, number)

        return cast("ReductionScene", with_quantities(model, own))

    def _check(self, reference: Mapping[str, float], exemplar: Mapping[str, Variable]) -> None:
        (block,) = self.run([reference]).blocks or (None,)
        if block is None:
            raise NotShared(
                "the scene as it stands is no usual case: rigid-body motions or massless DOFs, soft springs, "
                "masters that barely see a mode, or choices of masters and modes that rounding may change"
            )
        for path, variable in exemplar.items():
            data, stacked_data = variable.data, block.values[path].data[0]
            if data.dtype.kind in "fc":
                size = 1.0 if path.endswith("error") else np.abs(data).max(initial=0.0)
                agrees = bool(np.all(np.abs(data - stacked_data) <= _AGREEMENT * size))
            else:
                agrees = np.array_equal(data, stacked_data)
            if not agrees:
                raise NotShared(f"rounding moves {path} of the scene as it stands")

    def run(self, overrides: Overrides) -> SampleOutcomes:
        """Return the outcomes of samples; those beyond the usual case are pending."""
        blocks: list[SampleBlock] = []
        for start in range(0, len(overrides), self._step):
            blocks += self._blocks(overrides[start : start + self._step], start)
        return SampleOutcomes(blocks, len(overrides))

    def _blocks(self, overrides: Overrides, start: int) -> Iterator[SampleBlock]:
        """Yield the samples of the usual case by what the methods choose, their rows counted from `start`."""
        count = len(overrides)
        values, sure = self._quantities(overrides)
        with np.errstate(all="ignore"):  # of samples that are not sure
            matrices, finite = _stacked(self._bare, values, count)
            bare, sure = Stack(*matrices), sure & finite
            jointed = bare
            if self._structure.joints:
                joints, finite = _stacked(self._joints, values, count)
                jointed = Stack(*(a + b for a, b in zip(matrices, joints, strict=True)))
                sure &= finite
            try:
                choices = []
                for method in self._methods.values():
                    chosen, certain = method.choose(bare, jointed)
                    choices.append(chosen)
                    sure &= certain
            except np.linalg.LinAlgError:
                return
        groups: dict[tuple[Choice, ...], list[int]] = {}
        for s in np.flatnonzero(sure).tolist():
            groups.setdefault(tuple(chosen[s] for chosen in choices), []).append(s)
        for choice, members in groups.items():
            if choice not in self._exemplars:
                alone = run_alone(self._scene, overrides[members[0]], self._collect)
                self._exemplars[choice] = None if alone.error else alone.values
            exemplar = self._exemplars[choice]
            if exemplar is not None and exemplar.keys() == self._requested.keys():
                samples = np.array(members)
                own_values = {text: column[samples] for text, column in values.items()}
                some = bare if len(members) == count else bare[samples]
                both = some if jointed is bare else jointed if len(members) == count else jointed[samples]
                yield from self._block(exemplar, choice, some, both, own_values, start + samples)

    def _block(
        self,
        exemplar: Mapping[str, Variable],
        choice: Sequence[Choice],
        bare: Stack,
        jointed: Stack,
        values: Mapping[str, Array],
        rows: NDArray[np.intp],
    ) -> Iterator[SampleBlock]:
        """Yield the samples of the usual case of those with one choice of the methods."""
        try:
            with np.errstate(all="ignore"):
                arrays, sure = self._arrays(choice, bare, jointed, values)
        except np.linalg.LinAlgError:
            return
        samples = np.flatnonzero(sure)
        if not len(samples):
            return
        collected: dict[str, Variable] = {}
        for path, variable in exemplar.items():
            data, key = variable.data, self._requested[path]
            whole = np.broadcast_to(data, (len(samples), *data.shape))
            stack = whole if key is None else arrays[key][samples]
            collected[path] = Variable(("sample", *variable.dims), stack, variable.units, variable.attrs)
        yield SampleBlock(rows[samples], collected, np.zeros((len(samples), 0), dtype=bool))

    def _quantities(self, overrides: Overrides) -> tuple[dict[str, Array], NDArray[np.bool_]]:
        """Return the values of quantities by their expressions (samples), and where all are positive."""
        count = len(overrides)
        parameters = self._numbers.at(overrides)
        sure = np.ones(count, dtype=bool)
        for name in self._parameters.values():  # also one that nothing depends on must have a value
            sure &= np.array([value is not None for value in cast("SampleColumn", parameters[name])])
        values = {}
        for text, expression in self._expressions.items():
            column = np.array([_float(value) for value in evaluate(expression, parameters, count)])
            positive = np.isfinite(column) & (column > 0)
            values[text] = np.where(positive, column, float(1))
            sure &= positive
        return values, sure

    def _arrays(
        self, choice: Sequence[Choice], bare: Stack, jointed: Stack, values: Mapping[str, Array]
    ) -> tuple[dict[tuple[str, str], Array], NDArray[np.bool_]]:
        """Return the collected arrays by the reduction, or `frf`, and their names; and which are sure."""
        reductions = {
            name: method.reduce(bare, jointed, chosen)
            for (name, method), chosen in zip(self._methods.items(), choice, strict=True)
        }
        if reductions:  # none of a study that collects nothing of them
            jointed.modes(max(max(reduction.numbers) for reduction in reductions.values()))
        sure = np.ones(len(bare.M), dtype=bool)
        arrays: dict[tuple[str, str], Array] = {}
        for name, reduction in reductions.items():
            names = self._names[name]
            compared_arrays, usual = compared(jointed, reduction, names, lambda: self._energies(bare, values))
            sure &= usual
            for array, data in compared_arrays.items():
                arrays[name, array] = data
                sure &= np.isfinite(data).all(axis=tuple(range(1, data.ndim)))
        if self._responding:
            self._add_responses(arrays, jointed, reductions, sure)
        return arrays, sure

    def _energies(self, bare: Stack, values: Mapping[str, Array]) -> StackedEnergies:
        structure, count = self._structure, len(bare.M)
        dofs_of_parts = self._model.substructures.values()
        parts = [np.array([structure.index(dof) for dof in dofs]) for dofs in dofs_of_parts]
        rest = np.setdiff1d(np.arange(structure.size), np.concatenate([np.zeros(0, dtype=int), *parts]))
        parts += [rest] if len(rest) else []
        joints, _ = _stacked(self._joint_stiffness, values, count)
        return StackedEnergies(bare.K, parts, joints)

    @cached_property
    def _joint_stiffness(self) -> list[_VaryingMatrix]:
        matrices, structure = [], self._structure
        for joint in structure.joints:
            single = structure.joined([joint])
            stiffness = (term for term in single.joint_terms if term.letter == "K")
            terms = [(term.coefficient, as_array(term.matrix)) for term in stiffness]
            matrices.append(_VaryingMatrix.of(as_array(single.with_joints()[2]) - as_array(single.K), terms))
        return matrices

    def _add_responses(
        self,
        out: dict[tuple[str, str], Any],
        full: Stack,
        reductions: Mapping[str, StackedReduction],
        sure: NDArray[np.bool_],
    ) -> None:
        """Add the frequency responses, sample by sample; one that fails is not sure any more."""
        asked = self._responses
        assert asked is not None
        forces, rows, powers = ports(self._structure, asked.inputs, asked.outputs)
        shape = (len(sure), len(asked.omega), len(asked.outputs), len(asked.inputs))
        responses = {name: np.zeros(shape, dtype=complex) for name in ("full", *reductions)}
        shares = np.zeros((len(sure), len(reductions), *shape[2:]))
        for s in np.flatnonzero(sure):
            try:
                exact = direct(full.M[s], full.C[s], full.K[s], Ports(forces, rows, powers), asked.omega)
                for index, (name, reduction) in enumerate(reductions.items()):
                    where = Ports(reduction.T[s].T @ forces, rows @ reduction.T[s], powers)
                    responses[name][s] = direct(
                        reduction.jointed.M[s],
                        reduction.jointed.C[s],
                        reduction.jointed.K[s],
                        where,
                        asked.omega,
                    )
                    shares[s, index] = frac(responses[name][s], exact)
            except DynidError:
                sure[s] = False
            else:
                responses["full"][s] = exact
        out.update({("frf", name): array for name, array in (*responses.items(), ("frac", shares))})


#: Arrays of reductions that are the same for all samples with equal masters and modes.
_CONSTANT = frozenset({"masters", "modes", "unit"})


def _array_at(path: str, variable: Variable, names: Collection[str]) -> tuple[str, str] | None:
    """Return the reduction, or `frf`, and the name of a collected array; None of a constant one."""
    group, _, name = path.rpartition("/")
    reduction = group.removeprefix("reduction/")
    if variable.dims == (name,) or group == "reduction/need" or (reduction != group and name in _CONSTANT):
        return None
    if reduction == "frf" and (name in ("full", "frac") or name in names):
        return "frf", name
    if reduction in names and name in ARRAYS:
        return reduction, name
    raise NotShared(f"{path} is computed sample by sample")


def _stacked(
    matrices: Sequence[_VaryingMatrix], values: Mapping[str, Array], count: int
) -> tuple[list[Array], NDArray[np.bool_]]:
    """Return matrices of samples (s x n x n), unity where not all of them are finite with all digits."""
    stacks, sure = [], np.ones(count, dtype=bool)
    for varying in matrices:
        matrix, exact = varying.at(values, count)
        exact &= np.isfinite(matrix).all(axis=(1, 2))
        stacks.append(np.where(exact[:, None, None], matrix, np.eye(matrix.shape[-1])))
        sure &= exact
    return stacks, sure


def _float(value: Number | None) -> float:
    try:
        return np.nan if value is None else float(value)
    except OverflowError:
        return np.nan
