"""Content of bond graphs: the screen and the page agree, and their statements are correct."""

import re

import numpy as np
import pytest

import dynid
from dynid.bondgraph.analysis_request import RESULTS
from dynid.cli.screen import summary
from dynid.report.content import content
from dynid.report.content.blocks import DefinitionList, NumberedList, Statement, TextTable
from dynid.report.page.html import node
from dynid.result import Result
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source
from dynid.templates.chain import chain_scene

MASSES = """\
dynid: 1
kind: bond-graph
title: Two masses
graph:
  nodes: {F: Se, x: 1, m: {type: I, value: 2}, k: {type: C, value: 0.5}, b: {type: R, value: 1},
          z: 0, c: {type: C, value: 0.1}, y: 1, M: {type: I, value: 3}, d: {type: R, value: 0.2}}
  bonds: [F -> x, x -> m, x -> k, x -> b, x -> z, z -> c, z -> y, y -> M, y -> d]
analysis:
  outputs: [m.f, M.f]
  results: [RESULTS]
"""
EVERY = (
    "transfer_function, zeros, poles, properties, hidden_modes, sensitivities, reduction, prototype, "
    "causality, state_space, frequency_response, time_response"
)
GRIDS = "  frequency: {start: 0.1, stop: 10, points: 5}\n  time: {stop: 1, step: 0.25}\n"


def masses(results=EVERY, more=GRIDS):
    return f"{MASSES.replace('RESULTS', results)}{more}"


def run(text):
    return dynid.run(check_source(parse_source(text, "s.yaml")))


def screen(result):
    """Return what the terminal shows, as one line."""
    return " ".join(summary(result, "now", trace=True).split())


def page(result):
    """Return what the page says, as one line: its content as it is written, then as HTML without tags."""

    def texts(block):
        match block:
            case DefinitionList(items):
                return [text for name, lines in items for text in (name, *lines)]
            case TextTable(columns, rows, _, caption):
                return [*columns, *(text for row in rows for text in row), caption]
            case Statement():
                return [block.whole]
            case NumberedList(items):
                return list(items)

    sections = [section for section in content(result).sections if section.place]
    found = [(s.title, block) for s in sections for block in s.blocks if block.reader != "screen"]
    said = [text for title, block in found for text in (title, *texts(block))]
    shown = [re.sub("<[^>]+>", " ", node(block, title)) for title, block in found]
    return " ".join(" ".join([*said, *shown]).split())


def both_say(result, *phrases):
    for phrase in phrases:
        assert phrase in screen(result)
        assert phrase in page(result)


@pytest.fixture(scope="module")
def everything():
    return run(masses(more=f"  port: x -> z\n{GRIDS}"))


def test_the_port_and_the_system_inside(everything):
    """Behind the port a compliance c beside a mass with damper: Z_B; its zero is -d/M."""
    both_say(
        everything,
        "Z = Z_B/(1 + Z_B*Y_A)",
        "Z_eq = (s*M + d)/(s**2*c*M + s*c*d + 1)",
        "Z_eq = (s**2*m*k + s*k*b + 1)/(s*k)",
        "e_eq of F = 1",
        "-0.06667",
        "F = 1 gives e = 0, f = 0",
    )


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("effort", "an ideal effort source: e = e_eq whatever the flow; it has no Y_eq and f_eq"),
        ("flow", "an ideal flow source: f = f_eq whatever the effort; it has no Z_eq and e_eq"),
    ],
)
def test_a_source_alone_behind_the_port_is_ideal(kind, said):
    text = masses("prototype", "  port: F -> x\n")
    if kind == "flow":
        text = text.replace("F: Se", "F: Sf").replace("x: 1,", "x: 0,")
        text = text.replace("x -> z, z", "x -> o -> z, z").replace("z: 0,", "o: 1, z: 0,")
    result = run(text)
    assert result.group_attrs["bond_graph/port/source"]["form"] == said
    both_say(result, said)


def test_causality_and_the_equations_of_state(everything):
    both_say(
        everything,
        "p_m, q_k, q_c, p_M",
        "zero dynamics, with M.f held at zero by F: states of k (C)",
        "d/dt k.e = 1/k*x.f",
        "d/dt y.f = 1/M*z.e - d/M*y.f",
    )


def test_steps_of_the_reduction(everything):
    both_say(everything, "Z_y = s*M + d", "Y_z = s*c + 1/Z_y")


def test_sensitivities_are_what_one_percent_does(everything):
    """Against the roots of the characteristic polynomial with one value a little larger."""

    def poles(**changed):
        v = {"m": 2, "k": 0.5, "b": 1, "c": 0.1, "M": 3, "d": 0.2} | changed
        A = np.array(
            [
                [-v["b"] / v["m"], -1 / v["m"], -1 / v["m"], 0],
                [1 / v["k"], 0, 0, 0],
                [1 / v["c"], 0, 0, -1 / v["c"]],
                [0, 0, 1 / v["M"], -v["d"] / v["M"]],
            ]
        )
        found = np.linalg.eigvals(A)
        return sorted(found[found.imag > 0], key=abs)

    moved = 0.01 * (np.array(poles(k=0.5 * (1 + 1e-6))) - poles()) / 1e-6
    (grid,) = {
        block  # the poles of all channels, in one table
        for part in content(everything).sections
        for block in part.blocks
        if isinstance(block, TextTable)
        and block.caption.startswith("changes if a parameter")
        and block.columns[1].startswith("pole")
    }
    row = next(row for row in grid.rows if row[0] == "k")
    shown = [complex(text.replace(" ", "")) for text in row[1:3]]
    np.testing.assert_allclose(shown, moved, rtol=5e-3)  # three digits are shown
    assert len(grid.columns) == 3
    assert f"k {' '.join(row[1:])}" in screen(everything)


@pytest.mark.parametrize("name", RESULTS)
def test_each_result_can_be_asked_for_alone(name):
    result = run(masses(name))
    assert screen(result).startswith("Two masses bond graph")
    assert "10 nodes, 9 bonds" in screen(result)
    assert "10 nodes, 9 bonds" in page(result)


HIDDEN = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {F: Se, x: 1, m: {type: I, value: 2}, b: {type: R, value: 1},
          G: Se, y: 1, k: {type: C, value: 0.5}, M: {type: I, value: 3}}
  bonds: [F -> x, x -> m, x -> b, G -> y, y -> k, y -> M]
analysis: {inputs: [F, G], outputs: [m.f, M.f], results: [RESULTS]}
"""


def test_hidden_modes_and_what_holds_them():
    result = run(HIDDEN.replace("RESULTS", "transfer_function, poles, hidden_modes"))
    both_say(
        result,
        "-0.5: uncontrollable; its energy is in m 100 %",
        "± 0.8165j: uncontrollable; its energy is in k 50 %, M 50 %",
        "ω_n = 0.8165 rad/s, ζ = 0",
        "none",
    )


def test_another_engine_and_another_reading_say_so():
    result = run(
        masses("transfer_function, zeros, poles, properties", "  engine: float\n  reading: binary\n")
    )
    both_say(
        result,
        "a verdict within them is left undecided",
        "very value is read as the double nearest to it (reading: binary)",
        "0.5 ∏(s − zeros) / ∏(s − poles)",
    )


@pytest.mark.thorough
def test_of_very_many_the_first_are_shown_and_the_others_counted():
    outputs = "m.f, m.e, k.f, k.e, b.f, b.e, c.f, c.e, M.f, M.e, d.f, d.e, m.p, k.q, c.q, M.p"
    result = run(masses().replace("outputs: [m.f, M.f]", f"outputs: [{outputs}]"))
    both_say(result, "… 4 more channels in the file", "relative degree")  # the remarks on zeros
    assert "… 4 more outputs in the file" in page(result)
    assert "… 10 more outputs in the file" in screen(result)
    for output in outputs.split(", "):
        assert f"{output} / F" in page(result)
    many = run(HIDDEN.replace("RESULTS", "transfer_function"))
    assert "more" not in screen(many).partition("left out")[0]


def test_a_formula_too_long_to_expand_is_nested():
    chain = chain_scene(12)
    asked = chain[chain.index("results: [") : chain.index("]", chain.index("results: [")) + 1]
    result = run(chain.replace(asked, "results: [transfer_function]\n  engine: symbolic"))
    group = "bond_graph/transfer_function/v12.f/force"
    program = str(result.value(f"{group}/program")).splitlines()
    assert f"nested, in {len(program)} assignments:" in screen(result)
    both_say(result, " ".join(program[0].split()), "more in the file")


CONFLICT = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {F: Sf, x: 1, m: {type: I, value: 2}, b: {type: R, value: 1}, y: 0, k: {type: C, value: 0.5},
          n: {type: C, value: 3}}
  bonds: [F -> x, x -> m, x -> b, x -> y, y -> k, y -> n]
analysis: {outputs: [k.e], results: [causality, transfer_function, poles]}
"""


def test_storages_that_depend_on_others_are_told():
    result = run(CONFLICT)
    meanings = [str(row["meaning"]) for row in result["bond_graph/causality/dependent_storages"].data]
    assert len(meanings) == 2  # the mass follows the source, one compliance the other
    both_say(result, *(" ".join(meaning.split()) for meaning in meanings))


def test_a_result_of_another_kind_shows_what_it_holds():
    result = Result("weather", "Tomorrow")
    result.add("sky/clouds", [0.1, 0.2], ("hour",), "m")
    said = screen(result)
    assert said.startswith("Tomorrow weather · now")
    assert "clouds" in said


WELL = """\
dynid: 1
kind: bond-graph
graph:
  nodes:
    F: {type: Se, domain: mechanical}
    x: 1
    m: {type: I, value: 2}
    c: {type: R, law: {e: "0.5*f + f*abs(f)"}}
    k: {type: C, law: {e: "-q + 4*q**3"}}
  bonds: [F -> x, x -> m, x -> c, x -> k]
operating_point: {POINT}
analysis: {outputs: [k.q, m.f], results: [energy, time_response], time: {stop: 1, step: 0.25}}
"""


def test_the_operating_point_its_slopes_and_the_range_of_linear_results():
    """The wells of -q + 4 q^3 lie at q = ±1/2, with the slope 12 q^2 - 1 = 2; a damper of slope 0.5."""
    result = run(WELL.replace("POINT", "start: {k.q: 0.4}"))
    result.add_axis("bond_graph/approximations", ["the sums are rounded"])
    both_say(
        result,
        "the sums are rounded",
        "3 equilibria found (stable, unstable, stable); number 1 is analysed",
        "inputs F = 0",
        "of the terms, condition",
        "linear results are exact for the slopes as rounded to doubles",
        "energy in k 50 %, m 50 %; dissipated in c 100 %",
    )
    assert "slope value d c.e / d c.f 0.5 N·s/m d k.e / d k.q 2 N/m" in screen(result)
    assert "slope value d c.e / d c.f 0.5 N·s/m d k.e / d k.q 2 N/m" in page(result)
    assert "m.p 0 N·s k.q 0.5 m" in page(result)
    linear, other = (
        result[f"bond_graph/time_response/{name}"].data[..., 0] for name in ("response", "nonlinear")
    )
    assert linear.shape == other.shape
    deviation = 100 * np.abs(other - linear).max() / np.abs(linear).max()
    both_say(result, f"k.q: the nonlinear response is off the linear one by {deviation:.3g} % of its maximum")
    both_say(result, "integrated with relative tolerance 1e-08; estimated error")


def test_a_given_point_leaves_open_what_it_does_not_say():
    """Without a domain no number has a unit; the response that is left out says why."""
    text = WELL.replace("POINT", "values: {k.q: 1, m.f: 0}").replace("{type: Se, domain: mechanical}", "Se")
    result = run(text)
    both_say(result, "point given", "the point is given")
    assert "slope value d c.e / d c.f 0.5 d k.e / d k.q 11" in screen(result)
    assert "d c.e / d c.f 0.5 d k.e / d k.q 11" in page(result)
    assert "is off the linear one" not in screen(result)


OSCILLATOR = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {F: Se, x: 1, m: {type: I, value: 2}, k: {type: C, value: 0.5}, b: {type: R, value: 1}}
  bonds: [F -> x, x -> m, x -> k, x -> b]
analysis:
  outputs: [m.f, k.q]
  results: [energy, step_info, bandwidth, source_performance]
  frequency: {start: 0.1, stop: 10, points: 5}
"""


def test_characteristics_of_steps_bands_modes_and_sources():
    """Of k/m = 1 rad^2/s^2 and a damping ratio of 1/4."""
    zeta, wave = 0.25, np.sqrt(1 - 0.25**2)
    overshoot = 100 * np.exp(-np.pi * zeta / wave)
    peak, at = 0.5 * (1 + overshoot / 100), np.pi / wave
    half = 1 - 2 * zeta**2
    band = np.sqrt(half + np.sqrt(half**2 + 1))
    largest, where = 0.5 / (2 * zeta * wave), np.sqrt(half)
    result = run(OSCILLATOR)
    both_say(
        result,
        f"overshoot {overshoot:.4g} % · peak {peak:.4g} at {at:.4g} s",
        f"{band:.4g} rad/s (-3 dB of T(0)) · largest |T| {largest:.4g} at {where:.4g} rad/s",
        "partly defined: rise time, settling time and overshoot refer to the final value, which is 0",
        "largest |T| 1 at 1 rad/s · partly defined: T(0) is 0, which the bandwidth refers to",
        "energy in m 50 %, k 50 %; dissipated in b 100 %",
        "at an amplitude of 1 at most 0.5 W at 1 rad/s, where |Z| = 1",
    )


def test_what_no_resistor_damps_and_shares_that_are_not_defined():
    free = OSCILLATOR.replace(", b: {type: R, value: 1}", "").replace(", x -> b", "")
    both_say(
        run(free),
        "undefined: there is no steady state; marginal, not stable: poles at ±1j lie on the imaginary axis",
        "energy in m 50 %, k 50 %; no resistor damps it",
    )
    both_say(
        run(OSCILLATOR.replace("value: 0.5", "value: -0.5")),
        "undefined: shares of energy are not defined for elements of negative values",
    )


LOOP = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {u: Se, j: 1, J: {type: I, value: 0.5}, b: {type: R, value: DAMPING}}
  bonds: [u -> j, j -> J, j -> b]
control:
  loops: [{from: J.f, to: u, controller: {CONTROLLER}, reference: r}]
analysis: {outputs: [J.f], results: [properties]}
"""


HEADS = "gain margin phase margin delay margin Ms Mt closed loop"


def crossing(gain, damping):
    """Return where |gain / (s/2 + damping)| is 1, rad/s."""
    return 2 * np.sqrt(gain**2 - damping**2)


@pytest.mark.parametrize(("damping", "said"), [(0.2, ""), (-0.2, " J.f -> u: least gain 0.1 of this one")])
def test_margins_of_a_loop_without_delay(damping, said):
    result = run(LOOP.replace("DAMPING", str(damping)).replace("CONTROLLER", "gain: 2"))
    omega = crossing(2, damping)
    phase = np.pi - np.angle(0.5j * omega + damping)
    assert (
        f"{HEADS} J.f -> u ∞ {np.degrees(phase):.4g}° at {omega:.4g} rad/s {phase / omega:.4g} s 1 "
        in screen(result)
    )
    assert f" 1 {2 / (2 + damping):.4g} stable{said}" in screen(result)


@pytest.mark.thorough
def test_margins_and_poles_of_a_loop_with_delay():
    """The loop turns by pi where atan(2.5 w) + 0.1 w = pi, and crosses 1 as without the delay."""
    from scipy.optimize import brentq

    turned = brentq(lambda w: np.arctan(2.5 * w) + 0.1 * w - np.pi, 1, 30)
    gain = np.hypot(0.5 * turned, 0.2) / 2
    omega = crossing(2, 0.2)
    phase = np.pi - np.arctan(2.5 * omega) - 0.1 * omega
    stable = screen(run(LOOP.replace("DAMPING", "0.2").replace("CONTROLLER", "gain: 2, delay: 0.1")))
    assert "responses, margins and verdicts on stability have the delays as they are" in stable
    assert "Padé" not in stable
    assert (
        f"{HEADS} J.f -> u {gain:.4g} at {turned:.4g} rad/s {np.degrees(phase):.4g}° at {omega:.4g} rad/s "
        f"{phase / omega:.4g} s 1.419 0.9091 stable"
    ) in stable
    assert "poles with delays poles -9.573 ± 4.94j, -30.01 ± 74.77j" in stable
    unstable = screen(run(LOOP.replace("DAMPING", "0.2").replace("CONTROLLER", "gain: 20, delay: 0.1")))
    assert "unstable: 2 roots lie in the right half-plane (Nyquist count with delays)" in unstable
    assert f"and gain times {gain / 10:.4g} " in unstable
    assert "J.f -> u not defined not defined not defined not defined not defined unstable" in unstable
    assert "margins, Ms and Mt are not defined where the closed loop is not stable" in unstable
    assert "J.f -> u: its roots cross the axis at gain " in unstable


def test_a_loop_below_one_has_no_phase_margin_and_one_that_no_gain_stabilises_no_changes():
    low = screen(run(LOOP.replace("DAMPING", "0.2").replace("CONTROLLER", "gain: 0.1")))
    assert f"{HEADS} J.f -> u ∞ ∞ ∞ 1 {0.1 / 0.3:.4g} stable" in low
    never = screen(run(LOOP.replace("DAMPING", "-0.2").replace("CONTROLLER", "gain: -2")))
    assert "J.f -> u: unstable: pole at 4.4 lies in the right half-plane" in never
    assert "roots cross the axis" not in never


def test_a_law_that_is_flat_at_its_point_says_so():
    both_say(
        run(WELL.replace("POINT", "start: {k.q: 0}").replace("-q + 4*q**3", "q**3")),
        "k: no effort or flow of its own in the linearisation",
        "1 equilibrium found, neutral",
        "energy in m 100 %; dissipated in c 100 %",
    )


def test_a_port_of_a_source_and_one_storage():
    """Neither side determines where it rests; the pole at 0 is of the storage alone."""
    result = run("""\
dynid: 1
kind: bond-graph
graph:
  nodes: {F: Sf, x: 1, z: 0, c: {type: C, value: 2}}
  bonds: [F -> x, x -> z, z -> c]
analysis: {outputs: [c.e], port: x -> z, results: [prototype]}
""")
    both_say(
        result,
        "F: no static characteristic: a side has no finite line at s -> 0, or both lines are parallel",
        "(eq 12): none",
        "missed: at 0 rad/s",
        "net power over the port 0 (eq 9)",
    )


CHANNELS = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {F: Se, G: Se, H: Se, j: 1, m: {type: I, value: 2}, b: {type: R, value: 1},
          k: {type: C, value: 0.5}, l: {type: R, value: 3}}
  bonds: [F -> j -> m, G -> j, H -> j, j -> b, j -> k, j -> l]
analysis:
  outputs: [m.f, m.e, m.p, k.e, k.f, k.q, b.e, b.f, l.e, l.f, F.f, G.f, H.f]
  results: [RESULTS]
"""


def test_of_39_channels_6_are_shown_in_full_and_30_in_a_table():
    table = screen(run(CHANNELS.replace("RESULTS", "properties")))
    assert "k.q / H 2 2 0.5 0 minimum phase stable" in table
    assert "G.f / H 2 1 0 0 marginal, not minimum phase stable … 3 more channels in the file" in table
    assert "H.f / F" not in table
    alone = screen(run(CHANNELS.replace("RESULTS", "transfer_function")))
    assert "m.e / H T(s) = s^2 / (s^2 + 2 s + 1)" in alone


def test_of_many_storages_and_bonds_the_first_are_shown():
    """Of 30 compliances at one effort, 29 depend on the first; 31 bonds."""
    places = range(1, 31)
    result = run(
        "dynid: 1\nkind: bond-graph\ngraph:\n"
        f"  nodes: {{F: Sf, y: 0, {', '.join(f'k{i}: {{type: C, value: {i}}}' for i in places)}}}\n"
        f"  bonds: [F -> y, {', '.join(f'y -> k{i}' for i in places)}]\n"
        "analysis: {outputs: [k1.e], results: [causality]}\n"
    )
    said = " ".join(summary(result, "now", trace=True).split())
    assert said.count("is in derivative causality: its displacement is determined by k1 (C)") == 12
    assert "derivative: k13 (C) is in derivative causality" in said
    assert "… 17 more derivatives in the file bonds (bar: causal stroke): F |-> y, y |-> k1, y ->| k2" in said
    assert "y ->| k23, … (31 in all) zeros" in said
    assert "… 17 more derivatives in the file" in page(result)


def test_of_many_steps_of_a_reduction_the_first_are_shown():
    chain = chain_scene(16)
    asked = chain[chain.index("results: [") : chain.index("]", chain.index("results: [")) + 1]
    result = run(chain.replace(asked, "results: [reduction]"))
    said = " ".join(summary(result, "now", trace=True).split())
    steps = len(result["bond_graph/reduction/steps"].data)
    assert f"v16.f reduced in {steps - 1} steps to prototype d: Y = Y_B/(1 + Y_B*Z_A)" in said
    assert f"12. source swap: e_eq_j2 = 1/Y_j2*f_eq_v2 … {steps - 12} more steps in the file" in said
    assert f"… {steps - 60} more steps in the file" in page(result)
