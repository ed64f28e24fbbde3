"""Scenes whose values cancel by design: constant resistances, perfect coupling, bridges in balance."""

import math
import random

import numpy as np
import pytest

import dynid
from dynid.scene.load import load_scene
from dynid.study.executors import SerialExecutor
from dynid.study.plan import make_plan
from dynid.study.run import run_study

pytestmark = pytest.mark.thorough

PROPERTIES = "bond_graph/properties"


@pytest.fixture
def answer(tmp_path):
    def run(text, *overrides):
        path = tmp_path / "scene.yaml"
        path.write_text(f"dynid: 1\nkind: bond-graph\n{text}")
        return dynid.run(dynid.load_scene(path, overrides))

    return run


def properties(result, channel):
    names = ("order", "relative_degree", "stable", "dc_gain", "high_frequency_gain")
    return {name: result[f"{PROPERTIES}/{channel}/{name}"].data[()] for name in names}


ZOBEL = """
parameters: {{L: {L}, C: {C}, R: {R}}}
graph:
  nodes:
    u: Se
    v: 0
    b1: 1
    L: {{type: I, value: L}}
    R1: {{type: R, value: R}}
    b2: 1
    C: {{type: C, value: C}}
    R2: {{type: R, value: R}}
  bonds: [u -> v, v -> b1, b1 -> L, b1 -> R1, v -> b2, b2 -> C, b2 -> R2]
analysis:
  inputs: [u]
  outputs: [u.f, L.f]
  results: [transfer_function, zeros, poles, properties, hidden_modes, state_space, step_info, prototype]
"""


@pytest.mark.parametrize(
    ("L", "C", "R"),
    [
        ("0.0047", "1.3e-6", "sqrt(L/C)"),
        ("0.11", "9.1e-8", "(L/C)**0.5"),
        ("sqrt(3)*1e-3", "cos(pi/6)*1e-6", "sqrt(2000)"),
        ("pi*1e-3", "exp(1)*1e-6", "sqrt(L)/sqrt(C)"),
        ("2e-4", "7e-7", "exp((log(L) - log(C))/2)"),
    ],
)
def test_a_constant_resistance_has_order_zero(answer, L, C, R):
    result = answer(ZOBEL.format(L=L, C=C, R=R))
    names = {"pi": math.pi, "cos": math.cos, "exp": math.exp, "sqrt": math.sqrt}
    inertia, compliance = (eval(text, names) for text in (L, C))
    resistance = math.sqrt(inertia / compliance)
    found = properties(result, "u.f/u")
    assert (found["order"], found["relative_degree"], found["stable"]) == (0, 0, True)
    assert found["dc_gain"] == pytest.approx(1 / resistance, rel=1e-14)
    assert found["high_frequency_gain"] == pytest.approx(1 / resistance, rel=1e-14)
    hidden = result[f"{PROPERTIES}/u.f/u/hidden_modes"].data
    assert hidden == pytest.approx([-resistance / inertia] * 2, rel=1e-12)
    causes = result[f"{PROPERTIES}/u.f/u/hidden_mode_cause"].data
    assert list(causes) == ["uncontrollable and unobservable"] * 2
    assert properties(result, "L.f/u")["order"] == 1
    assert result[f"{PROPERTIES}/u.f/u/peak"].data == pytest.approx(1 / resistance, rel=1e-14)


COILS = """
parameters: {{L1: {L1}, L2: {L2}, M: {M}}}
graph:
  nodes:
    u: Se
    a: 1
    r1: {{type: R, value: 3}}
    tr: {{type: I, matrix: [[L1, M], [M, L2]], ports: [p, s]}}
    b: 1
    r2: {{type: R, value: 11}}
  bonds: [u -> a -> r1, a -> tr.p, b -> tr.s, b -> r2]
analysis:
  inputs: [u]
  outputs: [r2.e, r1.f]
  results: [transfer_function, zeros, poles, properties, state_space, time_response]
  time: {{stop: 0.01, step: 0.001, input: {{kind: step}}}}
"""


@pytest.mark.parametrize(
    ("L1", "L2", "M"),
    [
        ("3.1e-3", "7.7e-3", "sqrt(L1*L2)"),
        ("2e-3", "sqrt(5)*1e-3", "sqrt(L1)*sqrt(L2)"),
        ("sqrt(2)*1e-3", "3*sqrt(2)*1e-3", "sqrt(6)*1e-3"),
        ("pi*1e-3", "2*pi*1e-3", "pi*sqrt(2)*1e-3"),
    ],
)
def test_perfectly_coupled_coils_are_of_order_one(answer, L1, L2, M):
    """Z = [[3 + s L1, s M], [s M, 11 + s L2]] with L1 L2 = M^2: det Z = 33 + s (3 L2 + 11 L1)."""
    result = answer(COILS.format(L1=L1, L2=L2, M=M))
    names = {"pi": math.pi, "sqrt": math.sqrt}
    one, two = (eval(text, names) for text in (L1, L2))
    slope = 3 * two + 11 * one
    for channel in ("r2.e/u", "r1.f/u"):
        found = properties(result, channel)
        assert (found["order"], found["relative_degree"], found["stable"]) == (1, 0, True)
        poles = result[f"bond_graph/transfer_function/{channel}/poles"].data
        assert poles == pytest.approx([-33 / slope], rel=1e-13)
    high = properties(result, "r2.e/u")["high_frequency_gain"]
    assert abs(high) == pytest.approx(11 * math.sqrt(one * two) / slope, rel=1e-13)
    assert "not passive" not in str(result.get("bond_graph/warnings"))
    assert len(result["bond_graph/state_space/state"].data) == 1


def test_nearly_perfect_coupling_is_not_perfect(answer):
    result = answer(COILS.format(L1="2e-3", L2="5e-3", M="sqrt(L1*L2)*(1 - 10**(-14))"))
    assert properties(result, "r1.f/u")["order"] == 2
    assert properties(result, "r1.f/u")["stable"]


FIELD = """
parameters: {{a: {a}, b: {b}, c: {c}}}
graph:
  nodes:
    u: Se
    x: 1
    y: 1
    z: 1
    k: {{type: {kind}, matrix: [[a**2, a*b, a*c], [b*a, b**2, b*c], [c*a, c*b, c**2]], ports: [p, q, r]}}
    mx: {{type: {other}, value: 2}}
    my: {{type: {other}, value: 3}}
    mz: {{type: {other}, value: 5}}
  bonds: [u -> x, x -> k.p, y -> k.q, z -> k.r, x -> mx, y -> my, z -> mz]
analysis:
  inputs: [u]
  outputs: [mx.f, my.f]
  results: [zeros, poles, properties, hidden_modes]
"""


@pytest.mark.parametrize("values", [("sqrt(2)", "sqrt(3)", "sqrt(6)"), ("2**(1/3)", "pi", "sqrt(7)/3")])
@pytest.mark.parametrize("kind", ["I", "R"])
def test_a_field_of_rank_one(answer, kind, values):
    """v v^T s^j + diag(2, 3, 5) s^k: one mode, at the value of the secular equation, none else is seen."""
    other = "R" if kind == "I" else "I"
    result = answer(FIELD.format(kind=kind, other=other, **dict(zip("abc", values, strict=True))))
    names = {"pi": math.pi, "sqrt": math.sqrt}
    v = [eval(text, names) for text in values]
    secular = sum(each**2 / weight for each, weight in zip(v, (2, 3, 5), strict=True))
    pole = -1 / secular if kind == "I" else -secular
    for channel in ("mx.f/u", "my.f/u"):
        poles = result[f"bond_graph/transfer_function/{channel}/poles"].data
        moving = poles[poles != 0]
        assert moving == pytest.approx([pole], rel=1e-13)


BRIDGE = """
parameters: {{r1: {r1}, r2: {r2}, r3: {r3}, r4: {r4}}}
graph:
  nodes:
    u: Se
    top: 0
    left: 0
    right: 0
    d: 1
    m: {{type: I, value: 0.3}}
    s: 1
    rs: {{type: R, value: 2}}
    e1: 1
    e2: 1
    e3: 1
    e4: 1
    R1: {{type: R, value: r1}}
    R2: {{type: R, value: r2}}
    R3: {{type: R, value: r3}}
    R4: {{type: R, value: r4}}
  bonds: [u -> s, s -> rs, s -> top, top -> e1 -> left, top -> e2 -> right, e1 -> R1, e2 -> R2,
          left -> e3, right -> e4, e3 -> R3, e4 -> R4, left -> d -> right, d -> m]
analysis:
  inputs: [u]
  outputs: [m.f, u.f]
  results: [zeros, poles, properties, hidden_modes]
"""


@pytest.mark.parametrize(
    "values",
    [
        ("sqrt(2)", "sqrt(6)", "sqrt(3)", "3"),
        ("7*sqrt(5)", "14*sqrt(5)", "3**(1/3)", "2*3**(1/3)"),
        ("pi", "pi**2", "log(4)", "2*pi*log(2)"),
        ("1 + sqrt(2)", "1", "1", "sqrt(2) - 1"),
    ],
)
def test_a_bridge_in_balance_does_not_move_its_diagonal(answer, values):
    result = answer(BRIDGE.format(**dict(zip(("r1", "r2", "r3", "r4"), values, strict=True))))
    assert properties(result, "m.f/u")["relative_degree"] == math.inf
    assert properties(result, "m.f/u")["dc_gain"] == 0
    assert properties(result, "u.f/u")["order"] == 0
    assert len(result[f"{PROPERTIES}/u.f/u/hidden_modes"].data) == 1


OSCILLATOR = """
parameters: {{m: {m}, k: {k}, b: {b}}}
graph:
  nodes: {{F: Se, j: 1, m: {{type: I, value: m}}, k: {{type: C, value: 1/k}}, b: {{type: R, value: b}}}}
  bonds: [F -> j -> m, j -> k, j -> b]
analysis:
  inputs: [F]
  outputs: [m.f, k.q]
  results: [transfer_function, zeros, poles, properties, step_info, time_response]
  time: {{stop: 1, step: 0.1, input: {{kind: step}}}}
"""


@pytest.mark.parametrize(
    ("m", "k", "b"),
    [("1.7", "3.1", "2*sqrt(k*m)"), ("sqrt(2)", "pi", "sqrt(4*m)*k**0.5"), ("2", "5", "2*exp(log(10)/2)")],
)
def test_critical_damping_is_a_double_pole(answer, m, k, b):
    result = answer(OSCILLATOR.format(m=m, k=k, b=b))
    names = {"pi": math.pi, "sqrt": math.sqrt}
    mass, stiffness = (eval(text, names) for text in (m, k))
    rate = math.sqrt(stiffness / mass)
    poles = result["bond_graph/transfer_function/m.f/F/poles"].data
    assert poles[0] == poles[1]
    assert poles[0].imag == 0
    assert poles[0].real == pytest.approx(-rate, rel=1e-15)
    # the velocity is t exp(-w t)/m, largest at 1/w
    assert result[f"{PROPERTIES}/m.f/F/peak_time"].data == pytest.approx(1 / rate, rel=1e-13)
    assert result[f"{PROPERTIES}/m.f/F/peak"].data == pytest.approx(math.exp(-1) / rate / mass, rel=1e-13)
    assert result[f"{PROPERTIES}/k.q/F/overshoot"].data == 0


LOOP = """
parameters: {{a: {a}, K: {K}}}
graph:
  nodes:
    act: Se
    j1: 1
    m1: {{type: I, value: 1}}
    r1: {{type: R, value: a}}
  bonds: [act -> j1, j1 -> m1, j1 -> r1]
analysis:
  inputs: [w]
  outputs: [m1.f]
  results: [transfer_function, poles, properties, frequency_response]
  frequency: {{start: 0.1, stop: 10, points: 5}}
control:
  loops:
    - {{from: m1.f, to: act, reference: w, controller: {{numerator: [K], denominator: [1, 2*a, a**2]}}}}
"""


@pytest.mark.parametrize("a", ["sqrt(2)", "3**(1/3)", "pi"])
@pytest.mark.parametrize(
    ("gain", "stable"), [("8*a**3", 0), ("8*a**3*(1 - 10**(-12))", -1), ("8*a*a**2.000001", 1)]
)
def test_a_loop_at_its_critical_gain_has_poles_on_the_axis(answer, a, gain, stable):
    """L = K/(s + a)^3 is critical at K = 8 a^3, at w = a sqrt(3)."""
    result = answer(LOOP.format(a=a, K=gain))
    poles = result["bond_graph/transfer_function/m1.f/w/poles"].data
    pair = poles[poles.imag != 0]
    assert [np.sign(pole.real) for pole in pair] == [stable] * 2
    assert bool(result["bond_graph/margins/stable"].data[0]) is (stable < 0)
    verdict = str(result["bond_graph/margins/stability"].data[0])
    assert verdict.startswith({-1: "stable", 0: "marginal", 1: "unstable"}[stable])
    if stable == -1:
        assert result["bond_graph/margins/gain"].data[0] == pytest.approx(1 + 1e-12, abs=1e-14)


def test_a_value_set_on_the_command_line_cancels_as_well(answer):
    text = ZOBEL.format(L="0.0047", C="1.3e-6", R="3")
    assert properties(answer(text), "u.f/u")["order"] == 2
    changed = answer(text, "parameters.R=sqrt(L/C)", "parameters.C=sqrt(2)*1e-6")
    assert properties(changed, "u.f/u")["order"] == 0


def test_samples_of_a_study_cancel_each_by_itself(tmp_path):
    (tmp_path / "network.yaml").write_text(
        "dynid: 1\nkind: bond-graph\n" + ZOBEL.format(L="0.0047", C="1.3e-6", R="sqrt(L/C)")
    )
    study = tmp_path / "study.yaml"
    study.write_text(
        """
dynid: 1
kind: study
scene: network.yaml
vary:
  parameters.L: {values: [0.0013, 0.004, 0.0052]}
  parameters.C: {values: [1.0e-6, 1.3e-6]}
collect:
  - bond_graph/properties/u.f/u/order
  - bond_graph/properties/u.f/u/dc_gain
"""
    )
    run_study(make_plan(load_scene(study)), tmp_path / "study.h5", SerialExecutor())
    result = dynid.open_result(tmp_path / "study.h5")
    orders = result["study/results/bond_graph/properties/u.f/u/order"].data
    assert orders.tolist() == [0] * 6  # a batch and a run alike: the ratios 1300 and 4000 have rational roots
    gains = result["study/results/bond_graph/properties/u.f/u/dc_gain"].data
    expected = [math.sqrt(C / L) for L in (0.0013, 0.004, 0.0052) for C in (1e-6, 1.3e-6)]
    assert sorted(gains) == pytest.approx(sorted(expected), rel=1e-14)


UNDAMPED = """
parameters: {{m: {m}, k: {k}}}
graph:
  nodes: {{F: Se, j: 1, m: {{type: I, value: m}}, k: {{type: C, value: 1/k}}}}
  bonds: [F -> j -> m, j -> k]
analysis:
  inputs: [F]
  outputs: [m.f, k.e]
  engine: {engine}
  results: [zeros, poles, properties, frequency_response]
  frequency: {{start: 1, stop: 3, points: 3, scale: linear}}
"""


@pytest.mark.parametrize("engine", ["exact", "float"])
@pytest.mark.parametrize(("m", "k"), [("sqrt(3)", "4*sqrt(3)"), ("pi", "pi*4"), ("2**(1/3)", "16**(1/3)*2")])
def test_a_response_at_an_undamped_mode_is_infinite(answer, m, k, engine):
    result = answer(UNDAMPED.format(m=m, k=k, engine=engine))
    response = abs(result["bond_graph/frequency_response/response"].data[:, 0, 0])
    mass = eval(m, {"pi": math.pi, "sqrt": math.sqrt})
    assert response == pytest.approx([1 / mass / 3, np.inf, 3 / mass / 5], rel=1e-14)
    poles = result["bond_graph/transfer_function/m.f/F/poles"].data
    assert poles.real.tolist() == [0, 0]
    assert sorted(poles.imag) == pytest.approx([-2, 2], rel=0 if engine == "exact" else 4e-16)


UNITS = """
parameters: {{z: {z}, t: {t}}}
graph:
  nodes:
    act: Se
    j1: 1
    m1: {{type: I, value: {m1}*z*t}}
    r1: {{type: R, value: {r1}*z}}
    z1: 0
    l1: 1
    k1: {{type: C, value: {c1}*t/z}}
    b1: {{type: R, value: {b1}*z}}
    j2: 1
    m2: {{type: I, value: {m2}*z*t}}
  bonds: [act -> j1, j1 -> m1, j1 -> r1, j1 -> z1, z1 -> l1, l1 -> k1, l1 -> b1, z1 -> j2, j2 -> m2]
analysis: {{inputs: [w], outputs: [m1.f, m2.f], results: [poles, properties]}}
control:
  loops:
    - from: {at}
      to: act
      reference: w
      controller: {{numerator: [{p}*z, {q}*z/t], denominator: [1, {d}/t]}}
"""


@pytest.mark.parametrize("seed", range(5))
def test_a_loop_in_irrational_units_has_the_margins_of_the_rational_one(answer, seed):
    rng = random.Random(seed)
    names = ("m1", "r1", "c1", "b1", "m2", "p", "q", "d")
    values = {name: f"{rng.randint(1, 30)}/{rng.randint(1, 9)}" for name in names}
    values["at"] = rng.choice(["m1.f", "m2.f"])
    values["d"] = rng.choice(["0", values["d"]])
    z, t = rng.choice(
        [("sqrt(2)", "3**(1/3)"), ("pi", "sqrt(5)"), ("exp(1)", "1"), ("1 + sqrt(3)", "log(2)")]
    )
    rational = answer(UNITS.format(z="1", t="1", **values))
    result = answer(UNITS.format(z=z, t=t, **values))
    known = {"sqrt": math.sqrt, "pi": math.pi, "exp": math.exp, "log": math.log}
    period = eval(t, known)
    units = {"delay": period} | dict.fromkeys(("gain_crossover", "phase_crossover"), 1 / period)
    for name in ("stable", "unstable_poles", "gain", "gain_reduction", "phase", "Ms", "Mt", *units):
        found, expected = (each[f"bond_graph/margins/{name}"].data[0] for each in (result, rational))
        assert found == pytest.approx(expected * units.get(name, 1), rel=1e-11, nan_ok=True), name
    poles, others = (each["bond_graph/transfer_function/m1.f/w/poles"].data for each in (result, rational))
    assert np.sort_complex(poles * period) == pytest.approx(np.sort_complex(others), rel=1e-11)
