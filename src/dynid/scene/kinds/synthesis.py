"""Run a scene of kind `synthesis`, and write its bond graphs as scenes."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from dynid.bondgraph.exact_engine import TransferFunction
from dynid.bondgraph.synthesis.forms import (
    Driving,
    Realisation,
    add_synthesis,
    integer_quotient,
    realisations,
)
from dynid.bondgraph.synthesis.one_port import SOURCE
from dynid.errors import UsageError
from dynid.lti.positive_real import NotPositiveReal, find_violation
from dynid.result import Result
from dynid.scene.load import Scene
from dynid.scene.yaml.writer import flow

if TYPE_CHECKING:
    from dynid.scene.run import PreparationStep
    from dynid.scene.schema.quantities import Quantity
    from dynid.scene.schema.synthesis import SynthesisScene

#: Most digits of a number in an expression; longer ones are parameters.
_MAX_DIGITS = 400


def run(scene: Scene[SynthesisScene], _: Result | None = None) -> Result:
    """Return the bond graphs of a wanted driving-point function, each analysed back.

    Raises `NotPositiveReal` where the function is not positive real; it names the frequency or the pole that
    shows it. Raises `NoSuchForm` where a form that the scene names does not exist.
    """
    model = scene.model
    function = driving_function(scene)
    forms = tuple(model.forms) if model.forms is not None else None
    circuits, missing = realisations(function, forms, model.domain or "")
    result = Result("synthesis", scene.title)
    scenes = {circuit.form: scene_of_realisation(circuit, function, scene.title) for circuit in circuits}
    add_synthesis(result, function, circuits, missing, scenes, model.domain or "")
    return result


def preparation_steps(scene: Scene) -> Iterator[PreparationStep]:
    """Yield the step of a run before the synthesis: the test of positive realness."""
    yield lambda: driving_function(scene)


def driving_function(scene: Scene[SynthesisScene]) -> Driving:
    """Return the wanted driving-point function of a scene, found to be positive real.

    Raises `NotPositiveReal` where it is not.
    """
    model = scene.model
    key = "impedance" if model.impedance is not None else "admittance"

    def exact(coefficients: list[Quantity]) -> list[Fraction]:
        binary = model.reading == "binary"
        return [Fraction(float(coefficient)) if binary else coefficient.exact for coefficient in coefficients]

    function_model = model.function
    function = Driving.of(
        exact(function_model.numerator), exact(function_model.denominator), admittance=model.impedance is None
    )
    violation = find_violation(function.numerator, function.denominator)
    if violation is not None:
        problem = f"the {key} is not positive real: {violation.sentence}"
        raise NotPositiveReal(problem, remedy="No passive bond graph has it.", names=(key,))
    return function


def scene_of_realisation(circuit: Realisation, function: Driving, title: str) -> str:
    """Return a realisation as a scene of kind `bond-graph`, which expects the wanted function."""
    parameters: dict[str, str] = {}
    nodes = []
    for node in circuit.graph.nodes.values():
        keys: dict[str, Any] = {"type": node.type}
        if node.value is not None:
            keys["value"] = _value_text(node.value, node.name, parameters)
        if node.domain:
            keys["domain"] = node.domain
        nodes.append(f"    {node.name}: {flow(keys) if len(keys) > 1 else node.type}")
    transfer = TransferFunction(*integer_quotient(function.numerator, function.denominator))
    group = f"bond_graph/transfer_function/{function.port}/{SOURCE}"
    expected = [
        {"path": f"{group}/{name}", "value": coefficients.tolist(), "rtol": 1e-12}
        for name, coefficients in zip(("numerator", "denominator"), transfer.coefficients(), strict=True)
    ]
    lines = [
        "dynid: 1",
        "kind: bond-graph",
        f"title: {flow(f'{title}, {circuit.form}')}",
        *(["parameters:"] if parameters else []),
        *(f"  {name}: {number}" for name, number in parameters.items()),
        "graph:",
        "  nodes:",
        *nodes,
        "  bonds:",
        *(f"    - {bond}" for bond in circuit.graph.bonds),
        "analysis:",
        f"  inputs: [{SOURCE}]",
        f"  outputs: [{function.port}]",
        "expect:",
        *(f"  - {flow(circuit)}" for circuit in expected),
    ]
    return "\n".join(lines) + "\n"


def _value_text(value: Fraction, name: str, parameters: dict[str, str]) -> Any:
    """Return a value exactly: a number where it is one, else a quotient."""
    if value.denominator == 1 and len(str(value)) < 16:
        return value.numerator
    if Fraction(repr(float(value))) == value:
        return float(value)
    above = _whole_text(value.numerator, f"{name}_numerator", parameters)
    return f"{above}/{_whole_text(value.denominator, f'{name}_denominator', parameters)}"


def _whole_text(number: int, name: str, parameters: dict[str, str]) -> str:
    """Return a whole number, or the name of the parameter that it becomes where it is long."""
    if len(str(number)) <= _MAX_DIGITS:
        return str(number)
    above, below = divmod(number, 10**_MAX_DIGITS)
    head = _whole_text(above, f"{name}_", parameters)
    parameters[name] = f"{head} * 10**{_MAX_DIGITS} + {below}"
    return name


def exported_scene(result: Result, form: str | None = None) -> tuple[str, str]:
    """Return the name of a form of a synthesis, the first if none is given, and its scene.

    Raises `UsageError` where the result has no such form.
    """
    from dynid.suggestions import did_you_mean

    forms = [str(name) for name in result["synthesis/form"].data]
    if form is not None and form not in forms:
        problem = f"the result has no form '{form}'{did_you_mean(form, forms)}"
        raise UsageError(problem, remedy=f"It has {', '.join(forms)}.")
    chosen = form or forms[0]
    return chosen, str(result.value(f"synthesis/{chosen}/scene"))
