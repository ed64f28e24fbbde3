"""One verdict for the whole system, beside those of loops and channels."""

import math

import pytest

import dynid
from dynid.checks import check_expectations
from dynid.cli.screen import summary
from dynid.report.page.document import page
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

pytestmark = pytest.mark.thorough

#: Two masses that do not act on each other, each on a damper, driven by a loop of its own.
APART = """\
dynid: 1
kind: bond-graph
graph:
  nodes:
    u: Se
    j: '1'
    r: {type: R, value: 1}
    m: {type: I, value: MASS}
    act: Se
    k: '1'
    q: {type: R, value: 2}
    n: {type: I, value: 1}
    pull: Se
  bonds: [u -> j, act -> j, j -> r, j -> m, pull -> k, k -> q, k -> n]
analysis: {inputs: [u], outputs: [m.f], results: [properties]}
control:
  loops:
  - {from: m.f, to: act, controller: {gain: FIRST, delay: 0.4}}
  - {from: n.f, to: pull, controller: {gain: SECOND, delay: LATE}}
expect: [{path: bond_graph/system/stable, value: true}]
"""


def run(text, **values):
    for name, value in values.items():
        text = text.replace(name, str(value))
    loaded = check_source(parse_source(text, "scene.yaml"))
    result = dynid.run(loaded)
    expected = [one.model_dump(exclude_none=True) for one in loaded.model.expect]
    return result, [outcome.passed for outcome in check_expectations(result, expected)]


def system(result):
    return tuple(
        result.value(f"bond_graph/system/{name}") for name in ("stable", "stability", "unstable_poles")
    )


@pytest.mark.parametrize("late", [0, 0.3])
@pytest.mark.parametrize(
    ("second", "verdict"),
    [(1, (True, "stable", 0)), (-2, (False, "marginal", 0)), (-3, (False, "unstable", 1))],
)
def test_a_decoupled_loop_decides_the_system_and_not_its_neighbour(late, second, verdict):
    """Of s + 2 + K e^(-s τ) a root is at 0 for K = -2, and right of it below, whatever the delay is."""
    result, passed = run(APART, MASS=1, FIRST=1, SECOND=second, LATE=late)
    assert system(result) == verdict
    assert result["bond_graph/margins/stable"].data.tolist() == [True, verdict[0]]
    assert passed == [verdict[0]]
    assert f"whole system: {verdict[1]}" in summary(result, "")
    assert f">Whole system: {verdict[1]}" in page(result)


def test_two_neutral_loops_that_do_not_act_on_each_other_have_their_own_margins():
    """m = 0: each loop is 1 + K e^(-s τ) with a root of Re s = ln K/τ; K = 3/4 has the gain margin 4/3."""
    text = APART.replace("    m: {type: I, value: MASS}\n", "").replace("    n: {type: I, value: 1}\n", "")
    text = text.replace(", j -> m", "").replace(", k -> n", "").replace("m.f", "r.f").replace("n.f", "q.f")
    result, passed = run(text, FIRST=0.75, SECOND=1.5, LATE=0.7)
    assert system(result) == (True, "stable", 0)
    assert passed == [True]
    for name, value in (("gain", 4 / 3), ("Ms", 4), ("Mt", 3), ("delay", math.inf), ("phase", math.inf)):
        assert result[f"bond_graph/margins/{name}"].data == pytest.approx([value, value], rel=1e-6)
    result, _ = run(text, FIRST=0.75, SECOND=3, LATE=0.7)
    assert system(result) == (False, "unstable", -1)
    assert result["bond_graph/margins/stable"].data.tolist() == [True, False]


def test_a_part_without_output_counts():
    text = APART[: APART.index("control:")] + APART[APART.index("expect:") :]
    for damper, verdict in ((2, (True, "stable", 0)), (-2, (False, "unstable", 1)), (0, None)):
        changed = text.replace("value: 2", f"value: {damper}") if damper else text.replace(", k -> q", "")
        changed = changed if damper else changed.replace("    q: {type: R, value: 2}\n", "")
        result, _ = run(changed, MASS=1)
        assert system(result) == (verdict or (False, "marginal", 0))
        assert result.value("bond_graph/properties/m.f/u/stable")
        assert ("whole system" in summary(result, "")) == (damper != 2)


def test_infinitely_many_and_undecided_poles_have_numbers_of_their_own():
    late = APART.replace("from: n.f", "from: n.e")
    result, _ = run(late, MASS=1, FIRST=1, SECOND=1.5, LATE=0.3)  # L = 1.5 s/(s + 2) e^(-0.3 s)
    assert system(result) == (False, "unstable", -1)
    result, _ = run(late, MASS=1, FIRST=1, SECOND=1, LATE=0.3)
    assert system(result) == (False, "at the limit", -2)
    result, _ = run(late, MASS=1, FIRST=1, SECOND=0.5, LATE=0.3)
    assert system(result) == (True, "stable", 0)
    assert result["bond_graph/margins/gain"].data[1] == pytest.approx(2, rel=1e-6)


DIFFERENTIATES = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {s: Sf, j: '0', r: {type: R, value: 2}, c: {type: C, value: 3}, act: Sf}
  bonds: [s -> j, act -> j, j -> r, j -> c]
analysis: {inputs: [s], outputs: [c.e], results: [properties]}
control:
  loops:
  - {from: c.f, to: act, controller: {numerator: [0.2, 1], denominator: [1], delay: 0.7}}
  - {from: c.e, to: act, controller: {gain: 3, delay: 0.1}}
"""


def test_a_loop_that_differentiates_with_a_delay_has_infinitely_many_unstable_poles():
    """(s + 1) s/(s + 1/6) e^(-0.7 s), up to factors: a delayed s² against a prompt s."""
    result, _ = run(DIFFERENTIATES)
    assert system(result) == (False, "unstable", -1)
    assert "differentiates more often" in result.value("bond_graph/system/reason")
    assert "bond_graph/margins/poles" not in result


#: Three inertias around a 0-junction: the flow that circulates through two of them is a mode at 0.
CIRCULATING = """\
dynid: 1
kind: bond-graph
graph:
  nodes:
    act: Se
    a: '1'
    l1: {type: I, value: 0.5}
    d: {type: R, value: DAMPING}
    b: '0'
    l2: {type: I, value: 1.5}
    l3: {type: I, value: "sqrt(3)"}
  bonds: [act -> a, a -> l1, a -> b, b -> l2, BRANCH]
analysis: {inputs: [r], outputs: [l2.f], results: [properties]}
control:
  loops:
  - {from: l2.q, to: act, controller: {numerator: NUMERATOR, denominator: [1, 9], delay: LATE}, reference: r}
"""


@pytest.mark.parametrize("late", [0, 0.05])
@pytest.mark.parametrize("branch", ["b -> l3", "l3 -> b"])
def test_a_mode_at_0_beside_the_integral_of_a_measurement_counts(branch, late):
    """∫f2 gives the loop a pole at 0 of its own; the flow that circulates in l1 and l3 is another one."""
    text = CIRCULATING.replace("BRANCH", branch).replace(", DAMPING", "").replace("LATE", str(late))
    without = text.replace("    d: {type: R, value: DAMPING}\n", "")
    assert system(run(without, NUMERATOR="[8, 1]")[0]) == (False, "marginal", 0)


@pytest.mark.parametrize("late", [0, 0.05])
def test_an_integral_of_a_measurement_alone_is_no_hidden_mode(late):
    """l3 as a resistor: nothing circulates, and ∫f2 is in the loop."""
    text = CIRCULATING.replace("LATE", str(late)).replace("DAMPING", "1").replace("BRANCH", "b -> l3, a -> d")
    text = text.replace('l3: {type: I, value: "sqrt(3)"}', 'l3: {type: R, value: "sqrt(3)"}')
    for numerator in ("[8, 1]", "[8, 0]"):  # [8, 0]: the integral only holds a constant
        assert system(run(text, NUMERATOR=numerator)[0]) == (True, "stable", 0), numerator


@pytest.mark.parametrize("late", ["sqrt(3)", "5**(1/3)", "exp(1/3)", "pi/4"])
@pytest.mark.parametrize(
    ("factor", "expected"), [("(1-1e-10)", "stable"), ("1", "at the limit"), ("1.0001", "unstable")]
)
def test_irrational_delays_are_not_rounded_to_doubles(late, factor, expected):
    """Of s + k e^(-s τ) two roots reach the axis at k τ = π/2: no verdict comes from the rounding of τ."""
    text = """\
dynid: 1
kind: bond-graph
graph: {nodes: {j: '1', m: {type: I, value: 1}, act: Se}, bonds: [act -> j, j -> m]}
analysis: {inputs: [u], outputs: [m.f], results: [properties]}
control:
  loops: [{from: m.f, to: act, reference: u, controller: {gain: "FACTOR*pi/(2*(LATE))", delay: LATE}}]
"""
    assert system(run(text, FACTOR=factor, LATE=late)[0])[1] == expected


#: A mass on a damper, and another damper with a junction 'x' whose flow goes around between it and 'z'.
FREE = """\
dynid: 1
kind: bond-graph
graph:
  nodes:
    {u: Se, j: '1', r: {type: R, value: B}, m: {type: I, value: 3}, p: Sf, z: '0', y: {type: R, value: 2},
     x: '1'}
  bonds: [u -> j, j -> r, j -> m, p -> z, z -> y, z -> x, x -> z]
analysis: {inputs: [u], outputs: [m.f], results: [properties]}
"""
LOOP = "control: {loops: [{from: m.f, to: p, controller: {gain: 3, delay: LATE}}]}\n"


@pytest.mark.parametrize(("damper", "kind", "right"), [(0.7, "singular", -2), (-0.7, "unstable", -2)])
@pytest.mark.parametrize("loop", ["", LOOP.replace("LATE", "0"), LOOP.replace("LATE", "0.2")])
def test_a_part_without_a_unique_solution_makes_the_system_singular(loop, damper, kind, right):
    result, _ = run(FREE + loop, B=damper)
    assert system(result) == (False, kind, right)
    if kind == "singular":
        reason = str(result.value("bond_graph/system/reason"))
        assert reason.startswith("a part has no unique solution: the flow of 'x' is not determined")
        assert reason in " ".join(summary(result, "").split())


@pytest.mark.parametrize("gain", [2, -5])
@pytest.mark.parametrize("late", [0, 0.2])
def test_loops_that_leave_a_variable_open_are_decided(late, gain):
    """Two flow sources on one junction, each driven by a loop: their efforts have a sum alone."""
    text = FREE[: FREE.index("  nodes")] + "  nodes: {u: Se, p: Sf, q: Sf, j: '1', m: {type: I, value: 3}}\n"
    text += "  bonds: [u -> j, p -> j, q -> j, j -> m]\n"
    text += "analysis: {inputs: [u], outputs: [m.f], results: [properties]}\n"
    loops = ", ".join(
        f"{{from: m.{y}, to: {source}, controller: {{gain: {gain}, delay: {late}}}}}"
        for y, source in (("e", "p"), ("p", "q"))
    )
    result, _ = run(f"{text}control: {{loops: [{loops}]}}\n")
    assert system(result) == (False, "singular", -2)
    assert "the effort of 'q" in str(result.value("bond_graph/system/reason"))


@pytest.mark.parametrize(("gain", "verdict"), [(2, (True, "stable", 0)), (-2, (False, "unstable", 1))])
def test_a_loop_that_alone_ties_a_junction_is_decided_without_cutting_it(gain, verdict):
    """The source 'a' is a damper of its gain: without it nothing takes up the effort of 'u'."""
    text = FREE[: FREE.index("  nodes")] + "  nodes: {u: Se, a: Se, j: '1', x: '0', c: {type: C, value: 3}}\n"
    text += "  bonds: [u -> j, a -> j, j -> x, x -> c]\n"
    text += "analysis: {inputs: [u], outputs: [c.e], results: [properties]}\n"
    result, _ = run(text + f"control: {{loops: [{{from: j.f, to: a, controller: {{gain: {gain}}}}}]}}\n")
    assert system(result) == verdict
