"""Fields and structures in bond graphs, against matrices that are coupled directly."""

import textwrap

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh

import dynid
from dynid.errors import SceneError, UsageError
from dynid.scene.explanation import explain
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source
from dynid.structure.assembly import PointMass, Spring, Support
from dynid.structure.damping import ProportionalDamping
from dynid.structure.frame import beam
from dynid.structure.reduction.methods import METHODS
from dynid.structure.reduction.mode_selection import Interest, ModeRange

R, L, K_T, J, D, N = 1.0, 0.5, 0.01, 0.01, 0.1, 20.0
BEAM = """
beam: {elements: 4, length: 0.25, EI: 30.0, rhoA: 0.8, supports: [{node: 1, fix: [w]}],
       masses: [{node: 5, m: 0.2}], springs: [{node: 3, direction: w, c: 4.0}],
       damping: {alpha: 0.1, beta: 0.0002}}
"""
MOTOR = """
dynid: 1
kind: bond-graph
graph:
  nodes:
    voltage: Se
    circuit: 1
    R: {type: R, value: 1}
    L: {type: I, value: 0.5, domain: electrical}
    motor: {type: GY, value: 0.01}
    rotor: 1
    J: {type: I, value: 0.01}
    d: {type: R, value: 0.1}
    gear: {type: TF, value: 0.05}
    arm: ARM
    push: Se
  bonds: [voltage -> circuit -> motor -> rotor -> J, circuit -> R, circuit -> L, rotor -> d,
    rotor -> gear -> arm.hub, push -> arm.tip]
analysis:
  inputs: [voltage, push]
  outputs: [arm.tip.f, arm.hub.q, arm.hub.e, L.f]
"""


def scene(text):
    return check_source(parse_source(text.lstrip("\n"), "scene.yaml"))


def faults(text):
    with pytest.raises(SceneError) as raised:
        scene(text)
    return str(raised.value)


def flow(data):
    """Return data as YAML on one line."""
    return yaml.safe_dump(data, default_flow_style=True, width=10_000).strip()


def motor(analysis="", **arm):
    """Return the scene of the motor with the beam behind its gear."""
    structure = {
        "type": "structure",
        "structure": yaml.safe_load(BEAM),
        "ports": {"hub": "theta_1", "tip": "w_5"},
    }
    written = yaml.safe_dump(structure | arm, default_flow_style=True, width=10_000).strip()
    return scene(MOTOR.replace("ARM", written) + textwrap.indent(analysis, "  "))


def bare_beam():
    return beam(
        4, 0.25, 30.0, 0.8,
        supports=[Support(1, ("w",))], masses=[PointMass(5, 0.2)], springs=[Spring(3, "w", 0.0, 4.0)],
        damping=ProportionalDamping(0.1, 0.0002),
    )  # fmt: skip


def coupled(M, C, K, hub, tip, omega):
    """Return the responses of the machine with a structure, inputs voltage and push, by its matrices.

    The rotor turns N times as fast as the hub: its inertia and damper are N^2 times as large there.
    """
    n, answers = len(M), []
    for s in 1j * omega:
        A = np.zeros((n + 2, n + 2), complex)  # current, velocities, torque on the hub
        A[0, 0], A[0, 1:-1] = s * L + R, N * K_T * hub
        A[1:-1, 1:-1], A[1:-1, -1] = s * M + C + K / s, -hub
        A[-1, 0], A[-1, 1:-1], A[-1, -1] = -N * K_T, N**2 * (s * J + D) * hub, 1
        u = np.zeros((n + 2, 2), complex)
        u[0, 0] = 1
        u[1:-1, 1] = tip
        x = np.linalg.solve(A, u)
        answers.append([tip @ x[1:-1], hub @ x[1:-1] / s, x[-1], x[0]])
    return np.array(answers)


OMEGA = np.geomspace(10, 3000, 40)
FREQUENCY = "frequency: {start: 10, stop: 3000, points: 40}\nresults: [frequency_response]\n"


def rows(model):
    return np.array([model.row("theta_1"), model.row("w_5")])


def largest_error(found, wanted):
    return np.max(np.abs(found - wanted) / np.abs(wanted).max(axis=0))


@pytest.mark.parametrize("engine", ["exact", "float"])
def test_a_motor_on_a_full_beam_responds_as_the_coupled_matrices(engine):
    result = dynid.run(motor(f"{FREQUENCY}engine: {engine}\n"))
    model = bare_beam()
    wanted = coupled(*model.dense(), *rows(model), OMEGA)
    assert largest_error(result["bond_graph/frequency_response/response"].data, wanted) < 1e-10


REDUCTIONS = {
    "modal": {"method": "modal", "modes": {"count": 4}},
    "without-residuals": {"method": "modal", "modes": {"count": 5}, "residuals": "none"},
    "craig-bampton": {"method": "craig-bampton", "masters": ["theta_1", "w_5"], "modes": {"count": 3}},
    "serep": {"method": "serep", "masters": ["theta_1", "w_3", "w_5"], "modes": [1, 2, 3]},
    "guyan": {"method": "guyan", "masters": ["theta_1", "w_5", "w_3"]},
}


def reduced(part):
    options = {name: value for name, value in part.items() if name != "method"}
    if isinstance(options.get("modes"), dict):
        options["modes"] = ModeRange(**options["modes"])
    if options.get("residuals") == "none":
        options["residuals"] = ()
    interest = Interest(("theta_1", "w_5"))
    return METHODS[part["method"]](**options, interest=interest).reduce(bare_beam()).model


@pytest.mark.parametrize("name", REDUCTIONS)
def test_a_motor_on_a_reduced_beam_responds_as_its_matrices(name):
    result = dynid.run(motor(FREQUENCY, reduction=REDUCTIONS[name]))
    model = reduced(REDUCTIONS[name])
    wanted = coupled(*model.dense(), *rows(model), OMEGA)
    assert largest_error(result["bond_graph/frequency_response/response"].data, wanted) < 1e-10
    (text,) = result["bond_graph/approximations"].data
    assert "'arm' is a float model" in text


@pytest.mark.thorough
def test_modes_and_their_residuals_have_the_relative_degree_of_the_structure():
    text = "results: [properties, poles]\n"
    full, few = (dynid.run(motor(text, **part)) for part in ({}, {"reduction": REDUCTIONS["modal"]}))
    path = "bond_graph/properties/arm.tip.f/push/relative_degree"
    assert full.value(path) == few.value(path) == 1


FREE = """
dynid: 1
kind: bond-graph
graph:
  nodes:
    force: Se
    arm: ARM
  bonds: [force -> arm.tip]
analysis:
  inputs: [force]
  outputs: [arm.tip.f]
  results: [zeros, poles, properties, causality]
"""
UNDAMPED = {
    "beam": {"elements": 4, "length": 0.25, "EI": 30.0, "rhoA": 0.8, "supports": [{"node": 1, "fix": ["w"]}]}
}


def collocated(**arm):
    structure = {"type": "structure", "structure": UNDAMPED, "ports": {"tip": "w_5"}} | arm
    return dynid.run(
        scene(FREE.replace("ARM", yaml.safe_dump(structure, default_flow_style=True, width=10_000).strip()))
    )


def frequencies(result, name):
    found = result[f"bond_graph/transfer_function/arm.tip.f/force/{name}"].data
    assert np.abs(found.real).max() < 1e-9 * np.abs(found).max()
    return np.sort(found.imag[found.imag > 1e-6])


def elastic(M, K):
    square = eigh(K, M, eigvals_only=True)
    return np.sqrt(square[square > 1e-6 * square[-1]])


def test_zeros_of_a_collocated_port_are_frequencies_with_that_dof_fixed():
    result = collocated()
    model = beam(4, 0.25, 30.0, 0.8, supports=[Support(1, ("w",))])
    M, _, K = model.dense()
    kept = [place for place in range(model.size) if model.dofs[place] != "w_5"]
    square = eigh(K[np.ix_(kept, kept)], M[np.ix_(kept, kept)], eigvals_only=True)
    np.testing.assert_allclose(frequencies(result, "zeros"), np.sqrt(square), rtol=1e-10)
    np.testing.assert_allclose(frequencies(result, "poles"), elastic(M, K), rtol=1e-9)


def test_zeros_of_a_reduced_port_are_those_of_the_reduced_model():
    part = {"method": "modal", "modes": {"count": 4}}
    result = collocated(reduction=part)
    model = (
        METHODS["modal"](modes=ModeRange(4), interest=Interest(("w_5",)))
        .reduce(beam(4, 0.25, 30.0, 0.8, supports=[Support(1, ("w",))]))
        .model
    )
    M, _, K = model.dense()
    row = model.row("w_5")
    held = np.linalg.svd(row[None, :])[2][1:].T  # motions in which the port stands still
    square = eigh(held.T @ K @ held, held.T @ M @ held, eigvals_only=True)
    np.testing.assert_allclose(frequencies(result, "zeros"), np.sqrt(square), rtol=1e-10)


def test_a_rigid_motion_has_no_stiffness():
    result = collocated()
    poles = result["bond_graph/transfer_function/arm.tip.f/force/poles"].data
    assert np.count_nonzero(poles == 0) == 1  # of the speed: 1/(s J) of the rigid rotation
    few = collocated(reduction={"method": "modal", "modes": {"count": 3}})
    poles = few["bond_graph/transfer_function/arm.tip.f/force/poles"].data
    assert np.count_nonzero(poles == 0) == 1


@pytest.mark.thorough
def test_a_port_between_machine_and_structure_is_decomposed():
    small = {"beam": UNDAMPED["beam"] | {"elements": 2}}
    ports = {"hub": "theta_1", "tip": "w_3"}
    result = dynid.run(motor("port: gear -> arm.hub\nresults: [causality]\n", structure=small, ports=ports))
    assert "bond_graph/port/prototype" in result


@st.composite
def semidefinite(draw, size=4):
    """Return the entries of L D L^T as whole numbers, singular ones among them."""
    whole = st.integers(-3, 3)
    L = np.tril([[draw(whole) for _ in range(size)] for _ in range(size)], -1) + np.eye(size, dtype=int)
    return L @ np.diag([draw(st.integers(0, 4)) for _ in range(size)]) @ L.T


def field_scene(kind, matrix):
    """Return a field whose ports each have a load: one ohm and one storage, so that all is determined."""
    dual = kind == "C"
    nodes = {
        "u": "Sf" if dual else "Se",
        "field": {"type": kind, "matrix": matrix.tolist(), "ports": [*"abcd"]},
    }
    bonds = ["u -> j0"]
    for place, port in enumerate("abcd"):
        nodes |= {f"j{place}": 0 if dual else 1, f"R{place}": {"type": "R", "value": place + 1}}
        nodes |= {f"S{place}": {"type": kind if kind != "R" else "I", "value": 2}}
        bonds += [f"j{place} -> R{place}", f"j{place} -> S{place}", f"j{place} -> field.{port}"]
    analysis = {"outputs": [*(f"field.{port}.{q}" for port in "abcd" for q in "ef")]}
    analysis |= {"frequency": {"start": 0.3, "stop": 7, "points": 3}, "results": ["frequency_response"]}
    return scene(
        yaml.safe_dump(
            {
                "dynid": 1,
                "kind": "bond-graph",
                "graph": {"nodes": nodes, "bonds": bonds},
                "analysis": analysis,
            }
        )
    )


@settings(max_examples=12, deadline=None)
@given(semidefinite(), st.sampled_from("ICR"))
def test_a_field_is_its_matrix(matrix, kind):
    assert "bond_graph/warnings" not in check_field(matrix, kind)


@pytest.mark.parametrize("kind", ["I", "C", "R"])
@pytest.mark.parametrize(
    "matrix",
    [
        [[1, 2, 0, 0], [2, 1, 0, 0], [0, 0, 3, 0], [0, 0, 0, 0]],
        [[0, 2, 0, 0], [2, 0, 0, 1], [0, 0, 0, 0], [0, 1, 0, 0]],  # no diagonal
        [[0, 1, 1, 1], [1, 0, 1, 1], [1, 1, 0, 1], [1, 1, 1, 0]],
        [[-1, 3, 0, 2], [3, -2, 1, 0], [0, 1, 5, 1], [2, 0, 1, -4]],
    ],
)
def test_a_field_that_is_not_passive_is_its_matrix_with_a_warning(matrix, kind):
    (warning,) = check_field(np.array(matrix), kind)["bond_graph/warnings"].data
    assert warning.startswith("the field 'field' is not passive: its matrix has a negative eigenvalue")


def test_a_field_that_is_not_passive_is_reported_before_a_run():
    explained = explain(field_scene("C", np.diag([1, 2, -1, 0])))
    (warning,) = [text for name, text in explained.facts if name == "warning"]
    assert "the field 'field' is not passive" in warning


def test_a_field_of_unknown_parameters_is_passive_at_their_start():
    text = """
dynid: 1
kind: identification
parameters: {a: {start: 1, true: 1.1}}
graph:
  nodes:
    u: Se
    one: 1
    two: 1
    r: {type: R, value: 1}
    field: {type: I, matrix: [[a, 2], [2, a]], ports: [a, b]}
  bonds: [u -> one -> field.a, one -> r, two -> field.b]
excitation: [{source: u, kind: step}]
measurement: {step: 0.1, samples: 20, channels: [{output: r.f}], simulate: {noise_ratio: 0.1, seed: 1}}
"""
    message = "the matrix is not positive semidefinite, its lowest eigenvalue is -0.9; with unknown"
    with pytest.raises((SceneError, UsageError), match=message):
        dynid.run(scene(text))


def check_field(matrix, kind):
    """Compare a field with its matrix over frequency, and return the result."""
    result = dynid.run(field_scene(kind, matrix))
    found = result["bond_graph/frequency_response/response"].data[:, :, 0]
    for s, answer in zip(1j * np.geomspace(0.3, 7, 3), found, strict=True):
        own = matrix if kind == "R" else s * matrix
        R = np.diag(np.arange(1, 5))
        load = (np.linalg.inv(R) if kind == "C" else R) + 2 * s * np.eye(4)
        common = np.linalg.solve(load + own, np.eye(4)[0])
        balanced = own @ common
        e, f = (common, balanced) if kind == "C" else (balanced, common)
        np.testing.assert_allclose(answer, np.column_stack([e, f]).ravel(), rtol=1e-10, atol=1e-12)
    return result


FIELD = """
dynid: 1
kind: bond-graph
graph:
  nodes:
    u: Se
    one: 1
    r: {type: R, value: 1}
    field: NODE
  bonds: [u -> one -> field.a, one -> r, BOND]
analysis: {outputs: [OUT]}
"""
ONE = "{type: I, matrix: [[1]], ports: [a]}"
STRUCTURE = "{type: structure, structure: {lumped: {masses: [1]}}, "


@pytest.mark.parametrize(
    ("node", "bond", "out", "message", "line"),
    [
        ("{type: I, matrix: [[1, 2]], ports: [a]}", "r -> one", "r.f", "not square", 8),
        ("{type: I, matrix: [[1, 2], [3, 4]], ports: [a, b]}", "field.b -> r", "r.f", "entry (2, 1) is 3", 8),
        ("{type: I, matrix: E2, ports: [a]}", "field.a -> r", "r.f", "'ports' names 1", 8),
        ("{type: I, matrix: E2, ports: [a, a]}", "field.a -> r", "r.f", "listed twice", 8),
        ("{type: I, matrix: E2, ports: [a, base]}", "field.bse -> r", "r.f", "mean 'field.base'", 9),
        ("{type: I, matrix: E2, ports: [a, b]}", "field -> r", "r.f", "attach at its ports: field.a", 9),
        ("{type: I, matrix: E2, ports: [a, b]}", "one -> r", "r.f", "port 'field.b' has no bond", 8),
        ("ONE", "r -> field.a", "r.f", "port 'field.a' has 2 bonds", 8),
        ("ONE", "u.x -> one", "r.f", "'u' has no named ports", 9),
        ("ONE", "one -> r", "field.f", "name a port of it, such as field.a.f", 10),
        ("{type: Se, matrix: [[1]], ports: [a]}", "one -> r", "r.f", "only I, C, R, TF and GY", 8),
        ("{type: I, ports: [a]}", "one -> r", "r.f", "a field is written", 8),
        ("{type: I, matrix: [[1]], ports: [a b]}", "one -> r", "r.f", "'a b' cannot name a port; use", 8),
        (
            "{type: structure, structure: {lumped: {masses: [1]}}, ports: {a.b: 1}}",
            "one -> r",
            "r.f",
            "'a.b' cannot name a port; use",
            8,
        ),
        (
            "{type: I, matrix: [[1]], value: 1, ports: [a]}",
            "one -> r",
            "r.f",
            "a field has a 'matrix', and no 'value'",
            8,
        ),
        ("{type: structure, ports: {a: 1}}", "one -> r", "r.f", "a structure is written {type: structure", 8),
        (f"{STRUCTURE}ports: [a]}}", "one -> r", "r.f", "a structure is written {type: structure", 8),
        (
            STRUCTURE + "joints: {j: {dofs: [1], k: 1, laws: [{kind: cubic, k3: 1}]}}, ports: {a: 1}}",
            "one -> r",
            "r.f",
            "joint 'j' has nonlinear laws, and a bond graph takes a structure as linear",
            8,
        ),
        (
            f"{STRUCTURE}value: 1, ports: {{a: 1}}}}",
            "one -> r",
            "r.f",
            "a structure has no 'value' and no 'matrix'",
            8,
        ),
        (
            f"{STRUCTURE}joints: {{j: {{dofs: [1], k: {{start: 1}}}}}}, ports: {{a: 1}}}}",
            "one -> r",
            "r.f",
            "joint 'j' in a bond graph has values, no 'start'; name an unknown of 'parameters'",
            8,
        ),
        (
            f"{STRUCTURE}joints: {{j: {{points: [a, b], k: {{x: 3}}}}}}, ports: {{a: 1}}}}",
            "one -> r",
            "r.f",
            "joint 'j' is between points, which a structure in a bond graph has not",
            8,
        ),
        (
            "{type: I, value: 1, joints: {}, structure: {lumped: {masses: [1]}}}",
            "one -> r",
            "r.f",
            "belongs to a node",
            8,
        ),
        (
            "{type: structure, structure: {lumped: {masses: [1, 2]}}, ports: {a: 3}}",
            "one -> r",
            "r.f",
            "no DOF 3",
            8,
        ),
        (
            "{type: structure, structure: {lumped: {masses: [1]}}, ports: {a: 1, b: 1}}",
            "one -> r",
            "r.f",
            "at DOF 1",
            8,
        ),
    ],
)
def test_faults_of_fields_and_structures_are_located(node, bond, out, message, line):
    node = node.replace("E2", "[[1, 0], [0, 1]]").replace("ONE", ONE)
    printed = faults(FIELD.replace("NODE", node).replace("BOND", bond).replace("OUT", out))
    assert any(message in text and f":{line}:" in text for text in printed.splitlines()), printed


def test_the_matrix_of_a_field_is_not_judged_by_a_parameter_without_a_value():
    text = FIELD.replace("NODE", ONE.replace("[[1]]", "[[-x]]")).replace(", one -> r, BOND", ", one -> r")
    printed = faults(text.replace("OUT", "r.f") + "parameters: {x: 1/0}\n")
    assert printed == "scene.yaml:11:17: division by zero (at character 1 of '1/0')"


def test_stored_energy_of_a_field_is_refused():
    text = FIELD.replace("NODE", ONE).replace(", BOND", "").replace("OUT", "r.f")
    assert "stored energy is given to single I and C" in faults(text + "initial: {field: {f: 1}}\n")


def test_massless_coordinates_of_a_full_structure_are_algebraic():
    text = (
        FIELD.replace(
            "NODE",
            """{type: structure, ports: {a: 1}, structure: {lumped: {masses: [0, 2],
        links: [{dofs: [1, 2], k: 50, c: 1}, {dofs: [2], k: 30}]}}}""",
        )
        .replace(", BOND", "")
        .replace("OUT", "field.a.f")
    )
    result = dynid.run(scene(text))
    numerator, denominator = (
        result[f"bond_graph/transfer_function/field.a.f/u/{name}"].data
        for name in ("numerator", "denominator")
    )
    for s in (0.3 + 1j, 2.0):
        K, C, M = np.array([[50, -50], [-50, 80]]), np.array([[1, -1], [-1, 1]]), np.diag([0, 2])
        Z = s * M + C + K / s + np.diag([1, 0])
        wanted = np.linalg.solve(Z, [1, 0])[0]
        assert np.polyval(numerator, s) / np.polyval(denominator, s) == pytest.approx(wanted, rel=1e-12)


def test_a_structure_too_large_is_to_be_reduced():
    arm = {"beam": {"elements": 150, "length": 0.01, "EI": 1.0, "rhoA": 1.0}}
    with pytest.raises(UsageError, match="enter a bond graph one by one"):
        collocated(structure=arm, ports={"tip": "w_151"})


OUTWARD = """
dynid: 1
kind: bond-graph
graph:
  nodes:
    u: Se
    one: 1
    d: {type: R, value: 3}
    arm: {type: structure, structure: {lumped: {masses: [2, 1], links: [{dofs: [1, 2], k: 20, c: 0.5}]}},
          ports: {left: 1, right: 2}REDUCTION}
    tip: KIND
    r: {type: R, value: 0.75}
  bonds: [u -> one, one -> d, LEFT, arm.right -> tip, tip -> r]
analysis:
  outputs: [arm.left.e, arm.left.f, arm.right.e, arm.right.f, arm.right.q, one.f, r.e, r.f]
  results: [frequency_response]
  frequency: {start: 0.5, stop: 9, points: 3}
"""


@pytest.mark.parametrize("reduction", ["", ", reduction: {method: modal, modes: {count: 2}}"])
@pytest.mark.parametrize("junction", [0, 1])
@pytest.mark.parametrize("left", ["one -> arm.left", "arm.left -> one"])
def test_ports_of_a_structure_have_the_velocity_of_their_dof_and_the_force_along_the_arrow(
    left, junction, reduction
):
    text = OUTWARD.replace("LEFT", left).replace("KIND", str(junction)).replace("REDUCTION", reduction)
    result = dynid.run(scene(text))
    M, K, C = np.diag([2, 1]), 20 * np.array([[1, -1], [-1, 1]]), 0.5 * np.array([[1, -1], [-1, 1]])
    for s, row in zip(
        1j * np.geomspace(0.5, 9, 3), result["bond_graph/frequency_response/response"].data, strict=True
    ):
        v = np.linalg.solve(s * M + C + K / s + np.diag([3, 0.75]), [1, 0])
        force = 0.75 * v[1]  # of the tip on r
        push = (1 - 3 * v[0]) * (1 if left.startswith("one") else -1)  # of one on the arm, along the arrow
        wanted = [push, v[0], force, v[1], v[1] / s, v[0], force, v[1]]
        np.testing.assert_allclose(row[:, 0], wanted, rtol=1e-10)


def test_the_effort_of_a_port_with_several_bonds_is_the_force_on_the_structure():
    text = OUTWARD.replace("LEFT", "one -> arm.left, arm.left -> r2").replace("KIND", "1")
    text = text.replace("REDUCTION", "").replace("    r: ", "    r2: {type: R, value: 4}\n    r: ")
    row = dynid.run(scene(text))["bond_graph/frequency_response/response"].data[0, :, 0]
    assert row[0] == pytest.approx(1 - 3 * row[5] - 4 * row[5], rel=1e-12)
