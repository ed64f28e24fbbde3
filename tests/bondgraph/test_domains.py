"""Units of a graph's variables follow from the physical domains of its nodes."""

from fractions import Fraction
from pathlib import Path
from typing import get_args

import pytest

import dynid
from dynid.bondgraph.graph import UNITS, Node, unit_quotient
from dynid.errors import UsageError
from dynid.report.drawing.sketch import COLOUR, ELEMENT_UNITS
from dynid.scene.schema.bond_graph import Domain

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.mark.parametrize(
    ("above", "below", "unit"),
    [
        ("m/s", "N", "m/(s.N)"),
        ("m/s", "m/s", "1"),
        ("N.m", "A", "N.m/A"),
        ("Pa", "m3/s", "Pa.s/m3"),
        ("V", "rad/s", "V.s/rad"),
        ("m", "m3/s", "s/m2"),
        ("rad", "N.m.s", "rad/(N.m.s)"),
        ("m", "m3", "1/m2"),
    ],
)
def test_the_unit_of_a_quotient(above, below, unit):
    assert unit_quotient(above, below) == unit


@pytest.mark.parametrize("domain", get_args(Domain))
def test_every_domain_has_units_that_belong_together_and_a_colour(domain):
    units = UNITS[domain]
    # Displacement and momentum are the integrals of flow and effort: J/s is W, V s/s is V.
    for quantity, rate in (("q", "f"), ("p", "e")):
        known = {"J/W": "s", "A.s/A": "s", "V.s/V": "s"}
        found = unit_quotient(units[quantity], units[rate])
        assert known.get(found, found) == "s"
    assert domain in COLOUR
    assert domain in ELEMENT_UNITS


@pytest.fixture(scope="module")
def motor():
    return dynid.run(dynid.load_scene(CONFIGS / "dc_motor.yaml"))


def test_results_bear_the_units_of_their_domains(motor):
    group = "bond_graph/time_response"
    units = dict(zip(motor[f"{group}/output"].data, motor[f"{group}/unit"].data, strict=True))
    assert units == {"J.f": "rad/s", "L.f": "A"}
    sources = dict(zip(motor[f"{group}/source"].data, motor[f"{group}/input_unit"].data, strict=True))
    assert sources == {"voltage": "V", "torque": "N.m"}
    response = motor["bond_graph/frequency_response/unit"]
    assert response.dims == ("output", "input")
    assert response.data.tolist() == [["rad/(s.V)", "rad/(s.N.m)"], ["A/V", "A/(N.m)"]]
    assert motor["bond_graph/properties/J.f/voltage/dc_gain"].units == "rad/(s.V)"
    assert motor["bond_graph/properties/J.f/voltage/relative_degree"].units == ""
    assert motor.group_attrs["bond_graph/transfer_function/L.f/torque"]["unit"] == "A/(N.m)"


@pytest.mark.parametrize(("domain", "hint"), [("mecanical", "; did you mean 'mechanical'?"), ("optical", "")])
def test_a_domain_that_there_is_not_is_refused_where_a_node_is_made(domain, hint):
    with pytest.raises(UsageError) as refused:
        Node("m", "I", Fraction(2), domain=domain)
    said = f"node 'm': there is no domain '{domain}'{hint}"
    assert refused.value.problem == said
    assert refused.value.remedy.startswith("It is one of mechanical, rotational, ")
    assert refused.value.names == ("m",)


def test_without_domains_nothing_is_said_of_units():
    silent = ["graph.nodes.L={type: I, value: L}", "graph.nodes.J={type: I, value: J}"]
    result = dynid.run(dynid.load_scene(CONFIGS / "dc_motor.yaml", silent))
    assert "bond_graph/time_response/unit" not in result
    assert "bond_graph/frequency_response/unit" not in result
    assert result["bond_graph/properties/J.f/voltage/dc_gain"].units == ""
    assert "unit" not in result.group_attrs["bond_graph/transfer_function/L.f/torque"]


def test_one_domain_told_leaves_the_other_side_of_a_gyrator_unknown():
    half = ["graph.nodes.L={type: I, value: L}"]
    result = dynid.run(dynid.load_scene(CONFIGS / "dc_motor.yaml", half))
    assert result["bond_graph/time_response/unit"].data.tolist() == ["rad/s", ""]
    assert result["bond_graph/frequency_response/unit"].data.tolist() == [["", "rad/(s.N.m)"], ["", ""]]


def test_a_port_has_the_units_of_its_domain():
    result = dynid.run(dynid.load_scene(CONFIGS / "isolator_port.yaml"))
    group = "bond_graph/port"
    assert result[f"{group}/frequency_response/source_Z_eq"].units == "N.s/m"
    assert result[f"{group}/frequency_response/load_Y_eq"].units == "m/(s.N)"
    assert result[f"{group}/performance/source_flow"].units == "m/s"
    assert result[f"{group}/performance/operating_effort"].units == "N"
