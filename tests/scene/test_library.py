"""The models that come with dynid, against the transfer functions of the textbooks, and their passivity."""

import numpy as np
import pytest

import dynid
from dynid.scene.models import library_names, library_text
from dynid.scene.yaml.source import parse_source

POINTS = [0.3 + 0.2j, 4j, 60j, 2 + 700j]
#: Ports whose arrows point out of the model.
OUTWARD = {"shaft", "load", "right", "rod", "air"}


def model(name):
    (data,) = parse_source(library_text(name)).data["models"].values()
    return data


def values(name, **given):
    """Return the values of a model's parameters as numbers."""
    found = dict(given)
    for key, text in model(name)["parameters"].items():
        if key not in found:
            found[key] = float(eval(str(text), {"pi": np.pi, "sqrt": np.sqrt}, dict(found)))
    return found


def responses(name, given, kinds, outputs):
    """Return T(s) of every output and source at POINTS, with a source of a kind at every port."""
    nodes = {"x": {"model": name, **given}} | {f"s_{port}": kind for port, kind in kinds.items()}
    bonds = [f"x.{port} -> s_{port}" if port in OUTWARD else f"s_{port} -> x.{port}" for port in kinds]
    scene = {
        "kind": "bond-graph",
        "graph": {"nodes": nodes, "bonds": bonds},
        "analysis": {"outputs": outputs},
    }
    result = dynid.run(dynid.scene_from(scene))

    def polynomial(path, part, s):
        root = f"bond_graph/transfer_function/{path}/{part}"
        return sum(c * s**p for c, p in zip(result[root].data, result[f"{root}_power"].data, strict=True))

    return {
        (output, port): np.array(
            [
                polynomial(f"{output}/s_{port}", "numerator", s)
                / polynomial(f"{output}/s_{port}", "denominator", s)
                for s in POINTS
            ]
        )
        for output in outputs
        for port in kinds
    }


def dc_motor(s, p):
    return p.k / ((p.J * s + p.b) * (p.L * s + p.R) + p.k**2)


def gear(s, p):
    inertia, friction = p.J1 + p.J2 / p.n**2, p.b1 + p.b2 / p.n**2
    return 1 / p.n / (inertia * s + friction)


def flexible_shaft(s, p):
    return p.G * np.pi * p.d**4 / (32 * p.l) * (1 / s + p.eta)


def hydraulic_cylinder(s, p):
    """Return velocity over volume flow into a, with b held at constant pressure."""
    area, leak = p.A_a, p.leak
    return area / ((p.V_a / p.beta * s + leak) * (p.m * s + p.friction) + area**2)


def line_segment(s, p):
    area = np.pi * p.d**2 / 4
    z = p.rho * p.l / area * s + 128 * p.mu * p.l / (np.pi * p.d**4)
    return 1 / (1 + z * area * p.l / p.K * s)


def quarter_car(s, p):
    """Return the body's velocity over that of the road."""
    strut = p.b_s * s + p.k_s
    body, wheel = p.m_s * s**2 + strut, p.m_u * s**2 + strut + p.k_t
    return strut * p.k_t / (body * wheel - strut**2)


def loudspeaker(s, p):
    """Return the cone's velocity over the voltage."""
    mechanical, coil = p.Mms * s + p.Rms + 1 / (p.Cms * s), p.Le * s + p.Re
    return p.Bl / (coil * mechanical + p.Bl**2)


def tuned_damper(s, p):
    """Return the force on the host over its velocity; the tuning is Den Hartog's."""
    k = p.mu * p.K / (1 + p.mu) ** 2
    b = 2 * p.mu * p.M * np.sqrt(p.K / p.M) * np.sqrt(3 * p.mu / (8 * (1 + p.mu) ** 3))
    return 1 / (1 / (p.m * s) + s / (k + b * s))


CASES = {
    "dc_motor": (dc_motor, {"supply": "Se", "shaft": "Se"}, "x.J.f", "supply"),
    "gear": (gear, {"drive": "Se", "load": "Se"}, "x.J2.f", "drive"),
    "flexible_shaft": (flexible_shaft, {"left": "Sf", "right": "Sf"}, "s_right.e", "left"),
    "hydraulic_cylinder": (hydraulic_cylinder, {"a": "Sf", "b": "Se", "rod": "Se"}, "x.m.f", "a"),
    "line_segment": (line_segment, {"left": "Se", "right": "Sf"}, "s_right.e", "left"),
    "quarter_car": (quarter_car, {"road": "Sf", "body": "Se"}, "x.m_s.f", "road"),
    "loudspeaker": (loudspeaker, {"supply": "Se", "air": "Se"}, "x.Mms.f", "supply"),
    "tuned_damper": (tuned_damper, {"host": "Sf"}, "s_host.e", "host"),
}


def at_the_shaft(s, p):
    """Return speed over torque, the supply short-circuited; torque and speed positive outwards."""
    return -1 / (p.J * s + p.b + p.k**2 / (p.L * s + p.R))


def at_the_load(s, p):
    return -1 / (p.J2 * s + p.b2 + p.n**2 * (p.J1 * s + p.b1))


def at_the_rod(s, p):
    """Return velocity over force outwards, both chambers closed."""
    a, b, leak = p.V_a / p.beta * s + p.leak, p.V_b / p.beta * s + p.leak, p.leak
    force = np.linalg.solve([[a, -leak], [-leak, b]], [p.A_a, -p.A_b]) @ [p.A_a, -p.A_b]
    return -1 / (p.m * s + p.friction + force)


def at_the_body(s, p):
    strut = p.b_s + p.k_s / s
    wheel = p.m_u * s + p.k_t / s
    return 1 / (p.m_s * s + strut * wheel / (strut + wheel))


def at_the_cone(s, p):
    """Return volume flow over pressure outwards, the supply short-circuited."""
    return -(p.Sd**2) / (p.Mms * s + p.Rms + 1 / (p.Cms * s) + p.Bl**2 / (p.Le * s + p.Re))


PORTS = {
    "dc_motor": (at_the_shaft, {"supply": "Se", "shaft": "Se"}, "shaft"),
    "gear": (at_the_load, {"drive": "Se", "load": "Se"}, "load"),
    "hydraulic_cylinder": (at_the_rod, {"a": "Sf", "b": "Sf", "rod": "Se"}, "rod"),
    "quarter_car": (at_the_body, {"road": "Sf", "body": "Se"}, "body"),
    "loudspeaker": (at_the_cone, {"supply": "Se", "air": "Se"}, "air"),
}
#: Values with which no effect hides behind another one.
OTHERS = {"hydraulic_cylinder": {"A_b": 1.2e-3, "V_b": 3e-4, "leak": 2e-10}, "gear": {"b2": 0.3, "J1": 2e-4}}


class Values(dict):
    __getattr__ = dict.__getitem__


def test_every_model_has_a_case():
    assert sorted(CASES) == library_names()


@pytest.mark.parametrize("others", [False, True])
@pytest.mark.parametrize("name", CASES)
def test_a_model_has_the_transfer_function_of_the_textbook(name, others):
    formula, kinds, output, port = CASES[name]
    given = OTHERS.get(name, {}) if others else {}
    p = Values(values(name, **given))
    found = responses(name, given, kinds, [output])[output, port]
    # Two sums of the same few terms in double precision, rounded in different order.
    np.testing.assert_allclose(found, [formula(s, p) for s in POINTS], rtol=1e-13)


@pytest.mark.parametrize("name", PORTS)
def test_a_model_answers_at_its_other_port_as_the_textbook_says(name):
    formula, kinds, port = PORTS[name]
    given = OTHERS.get(name, {})
    p = Values(values(name, **given))
    found = responses(name, given, kinds, [f"s_{port}.f"])[f"s_{port}.f", port]
    np.testing.assert_allclose(found, [formula(s, p) for s in POINTS], rtol=1e-12)


@pytest.mark.parametrize("name", CASES)
def test_a_model_is_passive_at_its_ports(name):
    """The immittance matrix of the ports has a positive semidefinite Hermitian part wherever Re s >= 0."""
    _, kinds, *_ = CASES[name]
    other = {"Se": "f", "Sf": "e"}
    outputs = [f"s_{port}.{other[kind]}" for port, kind in kinds.items()]
    found = responses(name, {}, kinds, outputs)
    sign = {port: -1 if port in OUTWARD else 1 for port in kinds}
    matrix = np.array([[found[output, port] for port in kinds] for output in outputs])
    for row, port in enumerate(kinds):
        matrix[row] *= sign[port]
    # Rows and columns of sources of effort and of flow: power into the model is e conj(f) of every port.
    for at in np.moveaxis(matrix, 2, 0):
        hermitian = (at + at.conj().T) / 2
        scale = np.diag(1 / np.sqrt(np.maximum(np.abs(at).max(axis=1), 1e-300)))
        assert np.linalg.eigvalsh(scale @ hermitian @ scale).min() > -1e-12


@pytest.mark.parametrize("name", CASES)
def test_a_model_says_what_it_is_and_where_it_is_from(name):
    data = model(name)
    assert data["title"]
    assert data["source"]
    text = library_text(name)
    for key in data["parameters"]:
        if isinstance(data["parameters"][key], int | float):
            line = next(line for line in text.splitlines() if line.strip().startswith(f"{key}:"))
            assert "#" in line, f"{key} has no unit"
