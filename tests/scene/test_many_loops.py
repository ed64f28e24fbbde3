"""Many loops: one determinant for those that share a source, margins within a limit of roots."""

import numpy as np
import pytest

import dynid
from dynid.bondgraph.results import margin_results as margins
from dynid.cli.screen import summary
from dynid.progress import progress_to
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

pytestmark = pytest.mark.thorough

PLANT = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {F: Se, j: 1, m: {type: I, value: 1}, k: {type: C, value: 1}, b: {type: R, value: 2}}
  bonds: [F -> j -> m, j -> k, j -> b]
analysis: {outputs: [m.f], results: [properties]}
control:
  loops:
"""


def run(loops):
    lines = [
        f"  - {{from: {port}, to: F, controller: {{numerator: {top}, denominator: {bottom}}}}}\n"
        for port, top, bottom in loops
    ]
    return dynid.run(check_source(parse_source(PLANT + "".join(lines), "scene.yaml")))


def polynomial(loops, left_out=None):
    """Return s^2 + 2 s + 1 + the sum of the controllers' answers, times their denominators."""
    whole = np.array([1.0, 2.0, 1.0])
    for _, _, bottom in loops:
        whole = np.polymul(whole, bottom)
    for number, (port, top, _) in enumerate(loops):
        term = np.array(top, float) if port == "k.q" else np.polymul(top, [1.0, 0.0])
        for other, (_, _, bottom) in enumerate(loops):
            term = np.polymul(term, bottom) if other != number else term
        whole = np.polyadd(whole, term) if number != left_out else whole
    return whole


def test_loops_that_share_a_source_have_the_margins_of_their_sum():
    loops = [(port, [1 + k], [1 + k % 3, 2 + k]) for k in range(2) for port in ("k.q", "m.f")]
    result = run(loops)
    roots = np.roots(polynomial(loops))
    assert result.value("bond_graph/system/stable") == bool(roots.real.max() < 0)
    s = 1j * result["bond_graph/sensitivity_functions/omega"].data
    for number in range(len(loops)):
        sensitivity = np.polyval(polynomial(loops, number), s) / np.polyval(polynomial(loops), s)
        found = result["bond_graph/sensitivity_functions/S"].data[:, number]
        np.testing.assert_allclose(found, sensitivity, rtol=1e-9)


@pytest.mark.parametrize(("gain", "stable"), [(1, True), (-1, False)])
def test_margins_beyond_a_number_of_roots_are_left_out_with_the_count(monkeypatch, gain, stable):
    monkeypatch.setattr(margins, "ROOTS", 150)
    monkeypatch.setattr(margins, "_LOCI", 1500)
    loops = [("k.q", [gain], [1, 2 + k]) for k in range(4)]
    messages = []
    with progress_to(messages.append):
        result = run(loops)
    assert result.value("bond_graph/system/stable") == stable
    values = result["bond_graph/margins/Ms"].data
    assert np.isfinite(values[:1]).all()
    assert np.isnan(values[-1])
    reason = result["bond_graph/margins/undecided"].data[-1]
    assert reason.startswith("left out: the margins of 4 loops take 336 roots of polynomials")
    assert reason in " ".join(summary(result, "").split())
    assert result["bond_graph/margins/stable"].data[-1] == stable
    assert "margins of loop 2 of 4" in messages
    assert "left_out" in result.group_attrs["bond_graph/root_locus"]


@pytest.mark.parametrize("delay", [0, 0.3])
def test_loci_whose_roots_cost_too_much_are_left_out_with_the_reason(monkeypatch, delay):
    monkeypatch.setattr(margins, "_ROOT_WORK", 500)
    text = PLANT + f"  - {{from: m.f, to: F, controller: {{gain: 0.5, delay: {delay}}}}}\n"
    result = dynid.run(check_source(parse_source(text, "scene.yaml")))
    assert result.value("bond_graph/system/stable")
    assert np.isfinite(result["bond_graph/margins/Ms"].data).all()
    reason = result.group_attrs["bond_graph/root_locus"]["left_out"]
    assert "loop 1" in reason
    assert "more than 500 multiplications" in reason
    assert not any(path.startswith("bond_graph/root_locus/") for path in result)


@pytest.mark.parametrize("exponent", [-250, -140, -5, 90, 220])
def test_extreme_values_in_delayed_loops_end_without_overflow(exponent):
    loop = "  - {from: m.f, to: F, controller: {gain: 0.5, delay: 0.3}}\n"
    text = (PLANT + loop).replace("type: C, value: 1", f"type: C, value: 1e{exponent}")
    text = text.replace("results: [properties]", "frequency: {start: 0.1, stop: 9, points: 5}")
    result = dynid.run(check_source(parse_source(text, "scene.yaml")))
    # the damping 2 + 0.5 Re exp(-jω 0.3) is positive at every frequency, whatever the spring is
    assert str(result.value("bond_graph/system/stability")) in ("stable", "undecided")


def test_sixteen_gains_are_their_sum():
    result = run([("k.q", [1], [1]) for _ in range(16)])
    assert result.value("bond_graph/system/stable")
    s = 1j * result["bond_graph/sensitivity_functions/omega"].data
    expected = (s * s + 2 * s + 16) / (s * s + 2 * s + 17)
    np.testing.assert_allclose(result["bond_graph/sensitivity_functions/S"].data[:, 7], expected, rtol=1e-12)


@pytest.mark.thorough
def test_root_loci_of_loops_of_one_delay_are_roots_of_their_characteristic_function():
    loops = [("m.f", [0.5], "[1], delay: 0.1"), ("k.q", [0.3], "[1], delay: 0.1")]
    result = run(loops)
    for number in (1, 2):
        group = f"bond_graph/root_locus/loop_{number}"
        poles = result[f"{group}/poles"].data
        gains = np.broadcast_to(result[f"{group}/gain"].data[:, None], poles.shape)
        s, gain = poles[np.isfinite(poles)], gains[np.isfinite(poles)]
        velocity, position = (gain, 1.0) if number == 1 else (1.0, gain)
        late = (0.5 * velocity * s + 0.3 * position) * np.exp(-0.1 * s)
        residual = np.abs(s * s + 2 * s + 1 + late) / (np.abs(s) ** 2 + 1 + np.abs(late))
        assert len(s) > 100
        assert residual.max() < 1e-9
        np.testing.assert_array_equal(result[f"{group}/zeros"].data, [0.0] if number == 1 else [])
