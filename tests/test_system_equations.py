"""The systems of `configs/`: their graphs against Newton's and Kirchhoff's equations written down by hand.

Each function returns T(s), output x input, from the balance of forces, flows and voltages; it shares nothing
with bond graphs but the parameters of the scene.
"""

from pathlib import Path

import numpy as np
import pytest
from numpy.linalg import solve

import dynid

CONFIGS = Path(__file__).parents[1] / "configs"


def isolator(s, p):
    spring = p["A_p"] ** 2 * (s * p["I_f"] + 1 / (s * p["C_a"]))  # between base and body
    body = s * p["m_s"] + p["b"] + spring
    return [[spring / body]]


def isolator_active(s, p):
    spring = p["A_p"] ** 2 * (s * p["I_f"] + 1 / (s * p["C_a"]))
    body = s * p["m_s"] + p["b"] + spring
    return [[spring / body, -p["A_p"] / body]]  # the pressure pushes the body back


def quarter_car(s, p):
    strut = p["k_s"] / s + p["c_s"]
    tyre = p["k_t"] / s
    wheel, body = solve(
        [[s * p["m_w"] + strut + tyre, -strut], [-strut, s * p["m_b"] + strut]],
        [tyre, 0],
    )
    return [[body], [tyre * (1 - wheel)], [(wheel - body) / s]]


def half_car(s, p):
    struts = [p["k_1"] / s + p["c_1"], p["k_2"] / s + p["c_2"]]
    tyre = p["k_t"] / s
    reach = np.array([[1, p["a"]], [1, -p["b"]]])  # velocity of the corners by heave and pitch
    dynamic = np.zeros((4, 4), complex)
    dynamic[:2, :2] = np.diag([s * p["m"], s * p["J"]]) + reach.T @ np.diag(struts) @ reach
    dynamic[:2, 2:] = -reach.T @ np.diag(struts)
    dynamic[2:, :2] = -np.diag(struts) @ reach
    dynamic[2:, 2:] = np.diag([s * p["m_1"] + tyre, s * p["m_2"] + tyre]) + np.diag(struts)
    return solve(dynamic, np.vstack([np.zeros((2, 2)), tyre * np.eye(2)]))[:2]


def dc_motor(s, p):
    circuit, rotor = s * p["L"] + p["R"], s * p["J"] + p["d"]
    current, speed = solve([[circuit, p["k_t"]], [-p["k_t"], rotor]], np.eye(2))
    return [speed, current]


def hydraulic_servo(s, p):
    chamber = s * p["V"] / p["beta"] + p["G_l"]
    rod = s * p["m"] + p["d"] + p["k"] / s
    pressure, speed = solve([[chamber, p["A"]], [-p["A"], rod]], np.eye(2))
    return [speed, speed / s, pressure]


def loudspeaker(s, p):
    coil = p["R_e"] + s * p["L_e"]
    cone = s * p["M_m"] + p["R_m"] + 1 / (s * p["C_m"])
    vent = s * p["M_v"] + p["R_v"]
    # current, velocity, pressure, vent flow
    rows = [
        [coil, p["Bl"], 0, 0],
        [-p["Bl"], cone, p["S_d"], 0],
        [0, -p["S_d"], s * p["C_b"], 1],
        [0, 0, -1, vent],
    ]
    _, velocity, _, flow = solve(rows, [1, 0, 0, 0])
    return [[velocity], [flow]]


def two_tank(s, p):
    first, second = s * p["A_1"] / p["rho_g"], s * p["A_2"] / p["rho_g"] + 1 / p["R_2"]
    pipe = 1 / p["R_12"]
    return np.reshape(solve([[first + pipe, -pipe], [-pipe, second + pipe]], [1, 0]), (2, 1))


def hoist(s, p):
    # current, speed of the drum, speed of the load, with everything seen from the drum
    inertia = p["n"] ** 2 * p["J"] + p["J_d"]
    rope = p["k"] / s + p["c"]
    rows = [
        [s * p["L"] + p["R"], p["k_t"] * p["n"], 0],
        [-p["k_t"] * p["n"], s * inertia + p["n"] ** 2 * p["d"] + p["r"] ** 2 * rope, -p["r"] * rope],
        [0, -p["r"] * rope, s * p["m"] + rope],
    ]
    _, drum, load = solve(rows, [[1, 0], [0, 0], [0, -1]])
    return [load, p["k"] / s * (p["r"] * drum - load)]


def rlc_ladder(s, p):
    # Butterworth of order 5 between equal resistors
    poles = np.exp(1j * np.pi * (0.5 + (np.arange(5) + 0.5) / 5))
    return [[p["R"] / (2 * p["R"]) / np.prod(s - poles)]]


def lattice_all_pass(s, p):
    return [[(p["R"] - s * p["L"]) / (p["R"] + s * p["L"])]]


@pytest.mark.parametrize(
    "system",
    [
        isolator,
        isolator_active,
        quarter_car,
        half_car,
        dc_motor,
        hydraulic_servo,
        loudspeaker,
        two_tank,
        hoist,
        rlc_ladder,
        lattice_all_pass,
    ],
    ids=lambda system: system.__name__,
)
def test_a_graph_obeys_the_equations_of_its_system(system):
    path = CONFIGS / f"{system.__name__}.yaml"
    scene = dynid.load_scene(path)
    result = dynid.run(scene)
    group = "bond_graph/transfer_function"
    outputs = [str(port) for port in scene.model.analysis.outputs]
    inputs = scene.model.analysis.inputs
    parameters = {}
    for name, text in scene.source.data["parameters"].items():
        parameters[name] = float(eval(str(text), {"pi": np.pi, "sin": np.sin}, parameters))
    poles = np.abs(result[f"{group}/{outputs[0]}/{inputs[0]}/poles"].data)
    for s in poles.max() * np.array([0.3 + 0.2j, 1.1j, -0.4 + 2j, 5.0]):
        expected = np.asarray(system(s, parameters))
        for row, output in enumerate(outputs):
            for column, source in enumerate(inputs):
                numerator, denominator = (
                    result[f"{group}/{output}/{source}/{part}"].data for part in ("numerator", "denominator")
                )
                value = np.polyval(numerator, s) / np.polyval(denominator, s)
                # both sides are floating-point sums of a handful of terms, evaluated off the poles
                assert value == pytest.approx(expected[row, column], rel=1e-10), (output, source, s)
