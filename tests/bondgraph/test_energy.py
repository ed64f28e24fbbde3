"""Energy of modes and elements, and what sources give, against closed forms and the balance of power."""

import math
import random

import numpy as np
import pytest

import dynid
from dynid.errors import SceneError
from tests.bondgraph.random_graphs import random_graph


def run(nodes, bonds, results, *, control=None, inputs=None, output="m.f", **analysis):
    scene = {
        "kind": "bond-graph",
        "graph": {"nodes": nodes, "bonds": bonds},
        "analysis": {"outputs": [output], "results": results, **analysis},
    }
    if control:
        scene["control"] = control
    if inputs:
        scene["analysis"]["inputs"] = inputs
    return dynid.run(dynid.scene_from(scene))


def node(kind, value):
    return {"type": kind, "value": value}


CHAIN = {"F": "Se", "a": 1, "m": node("I", 2), "k": node("C", 0.125), "b": node("R", 0.4)}
CHAIN_BONDS = ["F -> a -> m", "a -> k", "a -> b"]


def test_an_oscillator_has_half_its_energy_in_each_storage():
    result = run(CHAIN, CHAIN_BONDS, ["energy"])
    np.testing.assert_allclose(result["bond_graph/energy/stored_share"].data, [[0.5, 0.5]], rtol=1e-14)
    assert list(result["bond_graph/energy/storage"].data) == ["m", "k"]
    np.testing.assert_allclose(result["bond_graph/energy/decay_rate"].data, [[0.1]], rtol=1e-14)
    np.testing.assert_allclose(
        result["bond_graph/energy/poles"].data, [-0.1 + 1j * math.sqrt(4 - 0.01)], rtol=1e-14
    )


def test_an_overdamped_oscillator_has_its_energy_where_the_pole_says():
    """Of a real pole s the mass has m f², the spring f²/(k s²)·…: shares m s² : 1/C."""
    result = run(CHAIN | {"b": node("R", 20)}, CHAIN_BONDS, ["energy"])
    poles = result["bond_graph/energy/poles"].data
    for pole, shares in zip(poles.real, result["bond_graph/energy/stored_share"].data, strict=True):
        mass, spring = 2 * pole**2, 8
        np.testing.assert_allclose(shares, np.array([mass, spring]) / (mass + spring), rtol=1e-13)


def test_coupled_oscillators_are_those_of_the_eigenvectors():
    """Two masses between walls, k – kc – k: the modes share energy as (φ² m) and the springs' stretches."""
    nodes = {
        "F": "Se",
        "a": 1,
        "m": node("I", 1),
        "k1": node("C", 0.5),
        "link": 0,
        "c": 1,
        "kc": node("C", 1),
        "d": node("R", 0.1),
        "z": 1,
        "n": node("I", 1),
        "k2": node("C", 0.5),
    }
    bonds = ["F -> a -> m", "a -> k1", "a -> link -> z -> n", "z -> k2", "link -> c -> kc", "c -> d"]
    result = run(nodes, bonds, ["energy"])
    names = list(result["bond_graph/energy/storage"].data)
    shares = result["bond_graph/energy/stored_share"].data
    poles = result["bond_graph/energy/poles"].data
    place = int(np.argmin(np.abs(poles - 1j * math.sqrt(2))))  # in phase
    expected = {"m": 0.25, "n": 0.25, "k1": 0.25, "k2": 0.25, "kc": 0.0}
    np.testing.assert_allclose(shares[place], [expected[name] for name in names], atol=1e-14)
    assert result["bond_graph/energy/dissipated_share"].data[place].sum() <= 1
    assert abs(result["bond_graph/energy/decay_rate"].data[place]).max() < 1e-14
    # against each other: the link is stretched by 2, ω0² = 2 + 2 kc = 4, σ = 2 d / 2
    other = int(np.argmin(np.abs(poles - 2j)))
    np.testing.assert_allclose(poles[other], -0.1 + 1j * math.sqrt(4 - 0.01), rtol=1e-14)
    springs = np.array([0.5 * 2, 0.5 * 2, 0.5 * 4]) * 0.5  # of amplitude 1: k/2, k/2, kc 2²/2
    np.testing.assert_allclose(
        [shares[other][names.index(name)] for name in ("k1", "k2", "kc")],
        springs / springs.sum() / 2,
        rtol=1e-13,
    )
    np.testing.assert_allclose(result["bond_graph/energy/decay_rate"].data[other], [0.1], rtol=1e-13)


def passive(seed):
    rng = random.Random(seed)
    types, values, bonds, inputs, (name, quantity) = random_graph(rng, rng.randint(2, 7), rng.choice([0, 1]))
    values = {key: abs(value) for key, value in values.items()}
    nodes = {
        key: {"type": kind, "value": str(values[key])} if key in values else kind
        for key, kind in types.items()
    }
    return nodes, [" -> ".join(bond) for bond in bonds], inputs, f"{name}.{quantity}"


def test_in_random_passive_graphs_the_resistors_damp_every_mode():
    """2 σ W = -P in every mode; at every frequency active power is dissipated, reactive power is stored."""
    checked = 0
    for seed in range(40):
        nodes, bonds, inputs, output = passive(seed)
        try:
            result = run(
                nodes,
                bonds,
                ["energy", "source_performance"],
                inputs=inputs[:1],
                output=output,
                frequency={"start": 0.3, "stop": 5, "points": 4},
            )
        except dynid.errors.Singular:
            continue
        get = lambda name, r=result: r[f"bond_graph/energy/{name}"].data  # noqa: E731
        rates, poles = get("decay_rate"), get("poles")
        np.testing.assert_allclose(
            rates.sum(axis=1), -poles.real, rtol=1e-8, atol=1e-9 * (abs(poles).max(initial=1))
        )
        if len(poles):
            np.testing.assert_allclose(get("stored_share").sum(axis=1), 1, rtol=1e-12)
        source = f"bond_graph/source_performance/{inputs[0]}"
        active = result[f"{source}/active_power"].data
        np.testing.assert_allclose(get("power").sum(axis=2)[:, 0], active, rtol=1e-9, atol=1e-12)
        checked += 1
        if any(one["type"] == "GY" for one in nodes.values() if isinstance(one, dict)):
            continue  # behind a gyrator reactive power has the other sign
        signs = [1 if nodes[name]["type"] == "I" else -1 for name in get("storage")]
        net = (get("energy")[:, 0] * signs).sum(axis=1) * 2 * get("omega")
        reactive, size = (result[f"{source}/{name}_power"].data for name in ("reactive", "apparent"))
        np.testing.assert_allclose(net, reactive, atol=1e-9 * (size.max() + abs(net).max()))
    assert checked >= 20


def test_a_source_gives_the_power_of_its_impedance():
    """1 V on R = 2, L = 0.5, C = 0.1 in series: Z = R + j(ωL - 1/(ωC))."""
    nodes = {"V": {"type": "Se", "domain": "electrical"}, "j": 1}
    nodes |= {"R": node("R", 2), "L": node("I", 0.5), "C": node("C", 0.1)}
    grid = {"start": 1, "stop": 10, "points": 7}
    result = run(
        nodes, ["V -> j -> R", "j -> L", "j -> C"], ["source_performance"], output="j.f", frequency=grid
    )
    group = "bond_graph/source_performance/V"
    omega = result["bond_graph/source_performance/omega"].data
    impedance = 2 + 1j * (0.5 * omega - 10 / omega)
    np.testing.assert_allclose(result[f"{group}/impedance"].data, impedance, rtol=1e-13)
    np.testing.assert_allclose(result[f"{group}/flow"].data, 1 / impedance, rtol=1e-13)
    np.testing.assert_allclose(result[f"{group}/active_power"].data, 1 / abs(impedance) ** 2, rtol=1e-13)
    np.testing.assert_allclose(
        result[f"{group}/reactive_power"].data, impedance.imag / (2 * abs(impedance) ** 2), rtol=1e-12
    )
    units = {
        name: result[f"{group}/{name}"].units for name in ("effort", "flow", "impedance", "active_power")
    }
    assert units == {"effort": "V", "flow": "A", "impedance": "V/A", "active_power": "W"}


def test_an_arrow_into_a_source_turns_no_power():
    nodes = {"v": "Sf", "j": 0, "R": node("R", 2), "C": node("C", 0.1)}
    grid = {"start": 1, "stop": 10, "points": 3}
    tails = ["v -> j -> R", "j -> v, j -> R"]
    powers = []
    for text in tails:
        bonds = [*text.split(", "), "j -> C"]
        result = run(nodes, bonds, ["source_performance"], output="R.f", frequency=grid)
        powers.append(result["bond_graph/source_performance/v/active_power"].data)
    np.testing.assert_array_equal(*powers)
    assert (powers[0] > 0).all()


def test_a_short_circuit_and_an_open_end_are_infinite_not_undefined():
    nodes = {"V": "Se", "j": 1, "L": node("I", 1), "C": node("C", 1)}
    grid = {"start": 0.5, "stop": 1, "points": 2, "scale": "linear"}
    result = run(
        nodes, ["V -> j -> L", "j -> C"], ["source_performance", "energy"], output="j.f", frequency=grid
    )
    group = "bond_graph/source_performance/V"
    assert result[f"{group}/impedance"].data[1] == 0
    assert np.isinf(result["bond_graph/energy/energy"].data[1]).all()
    assert not any(
        np.isnan(np.atleast_1d(found.data).astype(complex)).any()
        for path, found in result.items()
        if path.startswith(group) and found.data.dtype.kind in "fc"
    )
    nodes = {"V": "Se", "j": 0, "L": node("I", 1), "C": node("C", 1)}
    result = run(nodes, ["V -> j -> L", "j -> C"], ["source_performance"], output="L.f", frequency=grid)
    assert np.isinf(result[f"{group}/impedance"].data[1].real)


def test_elements_of_negative_values_have_no_shares():
    result = run(CHAIN | {"b": node("R", -0.4)}, CHAIN_BONDS, ["energy"])
    assert "negative values" in str(result.value("bond_graph/energy/status"))
    assert "bond_graph/energy/stored_share" not in result


def test_repeated_poles_share_the_energy_of_all_their_motions():
    """Two equal oscillators beside each other: each mode, in any basis, holds a quarter everywhere."""
    nodes = {"F": "Se", "j": 0}
    bonds = ["F -> j"]
    for k in "pq":
        nodes |= {f"{k}1": 1, f"m{k}": node("I", 1), f"k{k}": node("C", 1), f"b{k}": node("R", "0.25")}
        bonds += [f"j -> {k}1 -> m{k}", f"{k}1 -> k{k}", f"{k}1 -> b{k}"]
    result = run(nodes, bonds, ["energy"], output="mp.f")
    np.testing.assert_allclose(
        result["bond_graph/energy/stored_share"].data, np.full((2, 4), 0.25), rtol=1e-12
    )
    assert result["bond_graph/energy/repeated"].data.all()
    np.testing.assert_allclose(
        result["bond_graph/energy/dissipated_share"].data, np.full((2, 2), 0.5), rtol=1e-12
    )


def test_a_critically_damped_oscillator_has_one_motion():
    """s = -1 twice: the free motion e^{-t} has m = 1 and k = 1 equal shares."""
    nodes = CHAIN | {"m": node("I", 1), "k": node("C", 1), "b": node("R", 2)}
    result = run(nodes, CHAIN_BONDS, ["energy"])
    np.testing.assert_allclose(result["bond_graph/energy/stored_share"].data, np.full((2, 2), 0.5), rtol=1e-6)
    assert result["bond_graph/energy/repeated"].data.all()


def beside(parts):
    """Return the nodes and bonds of parts beside each other, all driven by one effort."""
    nodes, bonds = {"F": "Se", "j": 0}, ["F -> j"]
    for k, (elements, links) in enumerate(parts):
        nodes |= {f"{name}{k}": element for name, element in elements.items()}
        ends = [link.split(" -> ") for link in links]
        bonds += [f"j -> a{k}", *(" -> ".join(f"{name}{k}" for name in names) for names in ends)]
    return nodes, bonds


def carts(m, n, b):
    """Two carts on a damper: poles 0 and -b (1/m + 1/n)."""
    elements = {"a": 1, "m": node("I", m), "s": 0, "b": node("R", b), "c": 1, "n": node("I", n)}
    return elements, ["a -> m", "a -> s", "s -> b", "s -> c", "c -> n"]


def oscillator(m, k, b):
    elements = {"a": 1, "m": node("I", m), "k": node("C", k), "b": node("R", b)}
    return elements, ["a -> m", "a -> k", "a -> b"]


@pytest.mark.parametrize("engine", ["exact", "float"])
def test_poles_at_the_origin_are_counted(engine):
    """Each pair of carts has a pole at 0, which eigenvalues in floating point give as 1e-17."""
    parts = [carts("1/3", "7/11", "13/17"), carts("0.3", "1.7", "2.9"), carts("5/7", "3/13", "1/19")]
    result = run(*beside(parts), ["energy"], output="m0.f", engine=engine)
    repeated, poles = (result[f"bond_graph/energy/{name}"].data for name in ("repeated", "poles"))
    assert repeated.tolist() == [True] * 3 + [False] * 3
    assert np.abs(poles[:3]).max() <= (0 if engine == "exact" else 1e-13)
    assert ("note" in result["bond_graph/energy/repeated"].attrs) is (engine == "float")
    stored = result["bond_graph/energy/stored_share"].data
    np.testing.assert_allclose(stored[:3], np.tile(stored[:1], (3, 1)), rtol=1e-9)
    momenta = [(1 / 3, 7 / 11), (0.3, 1.7), (5 / 7, 3 / 13)]  # carts of a pair move together
    shares = [mass / sum(pair) / 3 for pair in momenta for mass in pair]
    np.testing.assert_allclose(stored[0], shares, rtol=1e-9)


@pytest.mark.parametrize("engine", ["exact", "float"])
def test_poles_that_are_near_each_other_are_not_repeated(engine):
    """Compliances apart by 4e-9 of themselves: each motion is that of one oscillator."""
    parts = [oscillator("3/7", "1/5", "1/100"), oscillator("3/7", "50000000/249999999", "1/100")]
    result = run(*beside(parts), ["energy"], output="m0.f", engine=engine)
    assert not result["bond_graph/energy/repeated"].data.any()
    stored = np.sort(result["bond_graph/energy/stored_share"].data, axis=1)
    np.testing.assert_allclose(stored, [[0, 0, 0.5, 0.5]] * 2, atol=1e-3)


def test_a_double_pole_of_irrational_values_is_repeated():
    """Critically damped: b = 2 sqrt(m/k) with m = 3, C = 1/7 has the double pole -sqrt(7/3)."""
    nodes = CHAIN | {"m": node("I", 3), "k": node("C", "1/7"), "b": node("R", "2*sqrt(21)")}
    result = run(nodes, CHAIN_BONDS, ["energy"])
    assert result["bond_graph/energy/repeated"].data.tolist() == [True, True]
    np.testing.assert_allclose(result["bond_graph/energy/poles"].data, [-math.sqrt(7 / 3)] * 2, rtol=1e-15)
    np.testing.assert_allclose(
        result["bond_graph/energy/stored_share"].data, np.full((2, 2), 0.5), rtol=1e-12
    )


def test_a_controller_feeds_a_mode():
    """Velocity feedback of gain 0.2 adds 0.2 to the damper's 0.4 N s/m of a mass of 2 kg."""
    loops = {"loops": [{"from": "m.f", "to": "F", "controller": {"gain": "0.2"}, "reference": "r"}]}
    result = run(CHAIN, CHAIN_BONDS, ["energy"], control=loops)
    np.testing.assert_allclose(result["bond_graph/energy/decay_rate"].data, [[0.1]], rtol=1e-13)
    np.testing.assert_allclose(result["bond_graph/energy/growth_rate_by_control"].data, [-0.05], rtol=1e-12)


def test_the_states_of_a_controller_store_no_energy():
    loops = {
        "loops": [{"from": "m.f", "to": "F", "controller": {"pid": {"kp": 1, "ki": 2}}, "reference": "r"}]
    }
    grid = {"start": 1, "stop": 2, "points": 2}
    result = run(CHAIN, CHAIN_BONDS, ["energy"], control=loops, frequency=grid)
    assert "controllers" in str(result.value("bond_graph/energy/status"))
    assert list(result["bond_graph/energy/storage"].data) == ["m", "k"]
    assert result["bond_graph/energy/energy"].data.shape == (2, 1, 2)


def test_a_graph_without_storage_has_no_modes():
    result = run({"V": "Se", "j": 1, "R": node("R", 2)}, ["V -> j -> R"], ["energy"], output="R.f")
    assert result["bond_graph/energy/stored_share"].data.shape == (0, 0)


def test_the_performance_of_sources_needs_frequencies():
    with pytest.raises(SceneError, match="'source_performance' needs the block 'frequency'"):
        run(CHAIN, CHAIN_BONDS, ["source_performance"])
