"""Laws and operating points in scenes: equilibria, linearisations, nonlinear responses, faults."""

from pathlib import Path

import numpy as np
import pytest
from mpmath import mp, mpf

import dynid
from dynid.errors import Diverged, NumericalError, SceneError, Singular, UsageError
from dynid.scene.load import check_source
from dynid.scene.schema.base import aspects_of
from dynid.scene.yaml.source import parse_source

pytestmark = pytest.mark.thorough

POINT = "bond_graph/operating_point"
CONFIGS = Path(__file__).parents[2] / "configs"


def scene(text):
    return check_source(parse_source(text.lstrip("\n"), "scene.yaml"))


def run(text):
    return dynid.run(scene(text))


def value(result, variable):
    names = list(result[f"{POINT}/variable"].data)
    return result[f"{POINT}/value"].data[names.index(variable)]


def slope(result, name):
    return result[f"{POINT}/slope_value"].data[list(result[f"{POINT}/slope"].data).index(name)]


DUFFING = """
dynid: 1
kind: bond-graph
graph:
  nodes:
    F: Se
    x: 1
    m: {type: I, value: 2}
    c: {type: R, law: {e: "0.5*f + f*abs(f)"}}
    k: {type: C, law: {e: "-q + 4*q**3"}}
  bonds: [F -> x, x -> m, x -> c, x -> k]
OPERATING
analysis: {outputs: [k.q]}
"""


def duffing(point, analysis="{outputs: [k.q]}"):
    return DUFFING.replace("OPERATING", f"operating_point: {point}").replace("{outputs: [k.q]}", analysis)


@pytest.fixture(scope="module")
def servo():
    less = ["analysis.frequency.points=20", "analysis.time.step=4.0e-3", "operating_point.search={starts: 4}"]
    return dynid.run(dynid.load_scene(CONFIGS / "servo_orifices.yaml", less))


@pytest.fixture(autouse=True)
def _digits():
    """Compute by hand with 40 digits, and leave the precision of other tests alone."""
    with mp.workdps(40):
        yield


def servo_point():
    """The equilibrium of the servo by hand: all flows through the orifices, at 40 digits."""
    p, u, x = mpf(10) ** 7, mpf(2) / 10**5, mpf(4) / 10**6
    K = mpf("0.62") * mpf("0.02") * mp.sqrt(mpf(2) / 870)
    # (u + x) sqrt(p - a) = (u - x) sqrt(a); the other chamber alike
    a = p * (u + x) ** 2 / ((u + x) ** 2 + (u - x) ** 2)
    b = p * (u - x) ** 2 / ((u + x) ** 2 + (u - x) ** 2)
    force = (a - b) / 1000 - 500
    q = mp.findroot(lambda q: mpf(400000) * q + mpf(2) * 10**9 * q**3 - force, mpf("0.005"))
    return K, u, x, p, a, b, q


def test_the_equilibrium_of_the_servo_is_that_by_hand(servo):
    K, u, x, p, a, b, q = servo_point()
    expected = {"oil_a.e": a, "oil_b.e": b, "load_spring.q": q, "in_a.f": K * (u + x) * mp.sqrt(p - a)}
    for name, wanted in expected.items():
        assert abs(value(servo, name) / wanted - 1) < 1e-15
    slopes = {
        "d in_a.f / d in_a.e": K * (u + x) / (2 * mp.sqrt(p - a)),
        "d in_a.f / d signal.f": K * mp.sqrt(p - a),
        "d out_a.f / d signal.f": -K * mp.sqrt(a),
        "d load_spring.e / d load_spring.q": 400000 + mpf(6) * 10**9 * q**2,
    }
    for name, wanted in slopes.items():
        assert abs(slope(servo, name) / wanted - 1) < 1e-15
    assert servo.value(f"{POINT}/residual") < 1e-15
    assert list(servo[f"{POINT}/stability"].data) == ["stable"]


def test_the_linearisation_of_the_servo_is_that_by_hand(servo):
    """Spool to displacement of the spring: both chambers, piston, mass; at 40 digits."""
    K, u, x, p, a, b, q = servo_point()
    A, C, m, d = mpf(1) / 1000, mpf(1) / 10**4 / mpf("1.4e9"), 30, 4000
    stiffness = 400000 + mpf(6) * 10**9 * q**2
    top, bottom = (
        servo[f"bond_graph/transfer_function/load_spring.q/spool/{part}"].data
        for part in ("numerator", "denominator")
    )
    for s in (mpf(3), mpf(200), mpf(1500)):
        flows = []
        for sign, e, other in ((1, p - a, a), (-1, p - b, b)):
            into = sign * K * (mp.sqrt(e) + mp.sqrt(other))
            leak = K * ((u + sign * x) / mp.sqrt(e) + (u - sign * x) / mp.sqrt(other)) / 2
            flows.append((into, C * s + leak))
        # pressure = (flow in - A s q)/(C s + leak) in a, (flow in + A s q)/(…) in b
        stiff = m * s**2 + d * s + stiffness + sum(A**2 * s / capacity for _, capacity in flows)
        wanted = A * (flows[0][0] / flows[0][1] - flows[1][0] / flows[1][1]) / stiff
        found = mp.polyval([mpf(c) for c in top], s) / mp.polyval([mpf(c) for c in bottom], s)
        assert abs(found / wanted - 1) < 1e-12


def test_the_nonlinear_response_of_the_servo_is_that_of_its_equations(servo):
    from scipy.integrate import solve_ivp

    K, u, _, p, a, b, q = map(float, servo_point())
    C, A = 1e-4 / 1.4e9, 1e-3

    def flow(opening, drop):
        return K * opening * np.sign(drop) * np.sqrt(abs(drop))

    def rates(_, z, spool=8e-6):
        pa, pb, v, y = z
        return [
            (flow(u + spool, p - pa) - flow(u - spool, pa) - A * v) / C,
            (flow(u - spool, p - pb) - flow(u + spool, pb) + A * v) / C,
            (A * (pa - pb) - 500 - 4000 * v - 4e5 * y - 2e9 * y**3) / 30,
            v,
        ]

    times = servo["bond_graph/time_response/time"].data
    wanted = solve_ivp(rates, (0, times[-1]), [a, b, 0, q], "DOP853", times, rtol=1e-11, atol=1e-9)
    found = servo["bond_graph/time_response/nonlinear"].data
    for k, row, rest in ((0, 3, q), (1, 0, a)):
        own = wanted.y[row] - rest
        np.testing.assert_allclose(found[:, k], own, atol=1e-6 * np.abs(own).max())
    deviation = servo["bond_graph/time_response/nonlinear_deviation"].data
    assert np.all((deviation > 0.01) & (deviation < 0.2))


def test_a_small_input_has_the_linear_response():
    text = duffing(
        "{choose: stable}",
        "{outputs: [k.q], time: {stop: 5, step: 0.1, input: {kind: step, amplitude: 1.0e-6}}}",
    )
    assert run(text)["bond_graph/time_response/nonlinear_deviation"].data[0] < 1e-5


def test_all_equilibria_of_a_double_well_are_found():
    result = run(duffing("{}"))
    names = list(result[f"{POINT}/variable"].data)
    found = result[f"{POINT}/equilibria"].data[:, names.index("k.q")]
    assert found[0] == 0
    assert sorted(found) == [-0.5, 0, 0.5]
    stability = dict(zip(found, result[f"{POINT}/stability"].data, strict=True))
    assert stability == {-0.5: "stable", 0: "unstable", 0.5: "stable"}
    assert "3 equilibria" in result["bond_graph/warnings"].data[0]


@pytest.mark.parametrize(
    ("point", "at"), [("{start: {k.q: 0.4}}", 0.5), ("{choose: stable}", None), ("{choose: 3}", None)]
)
def test_an_equilibrium_is_chosen(point, at):
    result = run(duffing(point))
    assert abs(value(result, "k.q")) == 0.5
    assert at is None or value(result, "k.q") == at
    assert slope(result, "d k.e / d k.q") == 2
    assert slope(result, "d c.e / d c.f") == 0.5


def test_a_given_point_is_taken_and_its_rates_are_a_warning():
    result = run(duffing("{values: {k.q: 0.25, m.f: 3}, inputs: {F: 0}}"))
    assert slope(result, "d k.e / d k.q") == -1 + 12 * 0.25**2
    assert slope(result, "d c.e / d c.f") == 6.5
    assert "no equilibrium: d(m.p)/dt = -10.31" in result["bond_graph/warnings"].data[0]
    assert f"{POINT}/equilibria" not in result


def test_a_law_of_zero_slope_leaves_its_element_out():
    result = run(duffing("{start: {k.q: 0.5}}").replace("0.5*f + f*abs(f)", "f*abs(f)"))
    assert result.group_attrs[POINT]["flat"] == "c"
    np.testing.assert_allclose(result["bond_graph/transfer_function/k.q/F/denominator"].data, [1, 0, 1])


def test_stored_energy_of_a_flat_spring_is_refused():
    text = duffing("{start: {k.q: 0}}").replace("-q + 4*q**3", "q**3") + "initial: {k: {e: 0.1}}\n"
    with pytest.raises(UsageError, match="it stores nothing there"):
        run(text)
    result = run(text.replace("initial: {k: {e: 0.1}}", ""))
    assert list(result[f"{POINT}/stability"].data) == ["neutral"]
    assert "does not determine k.q" in result["bond_graph/warnings"].data[0]


CRANK = """
dynid: 1
kind: bond-graph
parameters: {r: 0.5}
models:
  crank:
    ports: [shaft, slide]
    parameters: {r: 1, f: 3}
    nodes:
      shaft: 1
      n: {type: TF, value: "r*cos(shaft.q)"}
      slide: 1
      damper: {type: R, law: {e: "f*abs(f) + 2*f*shaft.q"}}
    bonds: [shaft -> n -> slide, slide -> damper]
graph:
  nodes:
    T: Se
    W: Se
    arm: 1
    J: {type: I, value: 2}
    k: {type: C, value: 0.01}
    c: {model: crank, r: r}
    x: 1
    m: {type: I, value: 10}
  bonds: [T -> arm, arm -> J, arm -> k, arm -> c.shaft, c.slide -> x, W -> x, x -> m]
operating_point: {inputs: {T: 3, W: -98}, search: {starts: 4}}
analysis:
  inputs: [T]
  outputs: [arm.q, c.damper.e]
  time: {stop: 1, step: 0.02, input: {kind: step, amplitude: 0.1, source: T}}
"""


@pytest.fixture(scope="module")
def crank():
    return run(CRANK)


def test_a_crank_in_a_model_is_linearised_with_its_geometric_stiffness(crank):
    """J phi'' + n m x'' + … with dx = n dphi, W n(phi) turns with the arm; a parameter f stays apart."""
    phi = mp.findroot(lambda p: 3 - 98 * mp.cos(p) / 2 - 100 * p, mpf("-0.4"))
    assert abs(value(crank, "k.q") / phi - 1) < 1e-15
    n, slope_n = mp.cos(phi) / 2, -mp.sin(phi) / 2
    bottom = [2 + 10 * n**2, 2 * phi * n**2, 100 + 98 * slope_n]
    top, found = (
        crank[f"bond_graph/transfer_function/arm.q/T/{part}"].data for part in ("numerator", "denominator")
    )
    np.testing.assert_allclose(found, [float(c / bottom[0]) for c in bottom], rtol=1e-13)
    np.testing.assert_allclose(top[-1], float(1 / bottom[0]), rtol=1e-13)


def test_storage_in_derivative_causality_has_a_nonlinear_response(crank):
    """The crank's mass moves with the arm: phi'' by hand, with the centrifugal term of the modulus."""
    from scipy.integrate import solve_ivp

    phi = value(crank, "k.q")

    def rates(_, z):
        p, w = z
        n, slope_n = np.cos(p) / 2, -np.sin(p) / 2
        v = n * w
        force = -98 - v * abs(v) - 2 * v * p - 10 * slope_n * w**2
        return [w, (3.1 - 100 * p + n * force) / (2 + 10 * n**2)]

    times = crank["bond_graph/time_response/time"].data
    wanted = solve_ivp(rates, (0, 1), [phi, 0], "DOP853", times, rtol=1e-11, atol=1e-13).y[0] - phi
    found = crank["bond_graph/time_response/nonlinear"].data[:, 0]
    np.testing.assert_allclose(found, wanted, atol=1e-5 * np.abs(wanted).max())


def test_feedback_is_closed_around_the_linearisation():
    text = (
        duffing("{start: {k.q: 0.5}}")
        + "control: {loops: [{from: k.q, to: F, controller: {gain: 5}, reference: r}]}\n"
    )
    result = run(text)
    np.testing.assert_allclose(result["bond_graph/transfer_function/k.q/r/denominator"].data, [1, 0.25, 3.5])


FLOATING = """
dynid: 1
kind: bond-graph
graph:
  nodes:
    Q: Sf
    a: 0
    tank: {type: C, law: {e: "q + q**2"}}
    valve: {type: R, law: {e: "f*abs(f) + f"}}
    between: 1
    b: 0
    other: {type: C, value: 1}
  bonds: [Q -> a, a -> tank, a -> between -> b, between -> valve, b -> other]
operating_point: {start: {tank.q: 2, other.q: 1}}
analysis: {outputs: [tank.e]}
"""


def test_what_is_conserved_is_that_of_the_start():
    """Both tanks share what is in them: q + q^2 = 3 - q."""
    assert value(run(FLOATING), "tank.q") == 1


#: Its level is zero at rest, where the slope of its outlet is infinite.
EMPTY_TANK = """dynid: 1
kind: bond-graph
graph:
  nodes: {Q: Sf, tank: 0, C: {type: C, value: 2e-4}, R: {type: R, law: {f: 1e-3*sqrt(e)}}}
  bonds: [Q -> tank, tank -> C, tank -> R]
analysis: {inputs: [Q], outputs: [C.e]}
"""


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        (
            FLOATING.replace("{start", "{inputs: {Q: 1}, start"),
            Singular,
            "Q changes other.q and tank.q at a constant rate",
        ),
        (
            duffing("{inputs: {F: 1}, search: {starts: 0}, choose: 2}"),
            Singular,
            "equilibrium 2 is chosen, but 1 was found",
        ),
        (duffing("{search: {starts: 0}, choose: stable}"), Singular, "the equilibrium is not stable"),
        (
            duffing("{inputs: {F: 3}}").replace("-q + 4*q**3", "1 + q**2").replace("F: 3", "F: 0"),
            NumericalError,
            "equilibrium",
        ),
        (duffing("{values: {k.q: 1}}"), Singular, "does not determine 'c.f'"),
        (duffing("{}").replace("0.5*f + f*abs(f)", "f + abs(f)"), Singular, "kink at the operating point"),
        (
            duffing("{values: {k.q: 0, c.f: 1}}").replace("-q + 4*q**3", "sqrt(q)"),
            NumericalError,
            "determined|slope",
        ),
        (EMPTY_TANK, NumericalError, "no equilibrium was found"),
    ],
)
def test_points_without_a_linearisation_are_refused(text, error, message):
    with pytest.raises((error, Diverged), match=message):
        run(text)


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("-q + 4*q**3", "-k*q", 9, "no parameter or variable 'k'"),
        ("-q + 4*q**3", "-q + xx.q", 9, "'xx.q': no node 'xx'; did you mean 'x'"),
        ("-q + 4*q**3", "-q + x.e", 9, "a 1-junction has one flow only"),
        ("-q + 4*q**3", "-p", 9, "'p' is not the variable of this law, which is q"),
        ("-q + 4*q**3", "q +", 9, "this is not arithmetic"),
        ('{e: "-q + 4*q**3"}', "{f: q}", 9, "the law of C is {e: …} of q"),
        ('{e: "-q + 4*q**3"}', "{e: q, f: q}", 9, "a law gives the effort or the flow"),
        ('law: {e: "-q + 4*q**3"}', "value: 1, law: {e: q}", 9, "C has a 'law' or a 'value', not both"),
        (
            "{type: I, value: 2}",
            "{type: I, value: x.f}",
            7,
            "the value of I cannot depend on variables; write a law",
        ),
        ("F: Se", "F: {type: Se, law: {e: f}}", 5, "only R, I and C have a law, not Se"),
        ("c: {type: R, law: {e", "c: {type: TF, law: {e", 8, "a TF has a modulus, and no law"),
        ("value: 2}", "value: 2}\n    n: {type: TF, value: 2*y.q}", 8, "'y.q': no node 'y'"),
        ("OPERATING", "operating_point: {inputs: {G: 1}}", 11, "no node 'G'"),
        ("OPERATING", "operating_point: {inputs: {m: 1}}", 11, "'m' is no source"),
        ("OPERATING", "operating_point: {start: {k: 1}}", 11, "'k' is no variable: NODE.e"),
        ("OPERATING", "operating_point: {start: {kk.q: 1}}", 11, "'kk.q': no node 'kk'; did you mean 'k.q'"),
        ("OPERATING", "operating_point: {values: {x.e: 1}}", 11, "a 1-junction has one flow only"),
        ("OPERATING", "operating_point: {values: {k.q: 1}, start: {k.q: 1}}", 11, "is not solved for"),
        ("OPERATING", "operating_point: {search: {ranges: {k.q: [1, 0]}}}", 11, "starts above its end"),
        ("OPERATING", "operating_point: {choose: 0}", 11, "choose"),
        ('{e: "-q + 4*q**3"}', "{e: 3}", 9, "'e' must be a text, not 3"),
        ("value: 2}", "value: 2*}", 7, "this is not arithmetic"),
    ],
)
def test_faults_are_located(old, new, line, message):
    text = DUFFING.replace(old, new).replace("OPERATING", "")
    with pytest.raises(SceneError) as caught:
        scene(text)
    found = [fault for fault in caught.value.faults if message in fault.message]
    assert found, str(caught.value)
    assert found[0].line == line


TIME = "{outputs: [k.q], time: {stop: 1, step: 0.1, input: {kind: KIND}}}"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            duffing("{choose: stable}", TIME.replace("KIND", "impulse")),
            "an impulse has no nonlinear response",
        ),
        (duffing("{values: {k.q: 1, m.f: 0}}", TIME.replace("KIND", "step")), "the point is given"),
        (
            duffing("{start: {k.q: 0.5}}", TIME.replace("KIND", "step"))
            + "control: {lqr: {states: [k.q, m.f], weights: {k.q: 1, F: 1}, references: {F: r}}}\n",
            "gains of states are closed around the linearisation",
        ),
        (
            duffing("{}", TIME.replace("KIND", "step"))
            .replace("F: Se", "F: Sf")
            .replace("-q + 4*q**3", "q + q**3"),
            "a source drives a storage element in derivative causality",
        ),
        (  # pulled over the hill of its spring
            duffing("{}", TIME.replace("KIND", "step, amplitude: 20").replace("stop: 1", "stop: 3"))
            .replace("-q + 4*q**3", "q - q**3")
            .replace("0.5*f + f*abs(f)", "0.1*f"),
            "grows without bound",
        ),
    ],
)
def test_a_nonlinear_response_that_is_left_out_says_why(monkeypatch, text, reason):
    monkeypatch.setattr("dynid.bondgraph.results.operating_point._MOST_EVALUATIONS", 2000)
    result = run(text)
    assert reason in result.group_attrs["bond_graph/time_response"]["nonlinear"]
    assert "bond_graph/time_response/nonlinear" not in result


def test_values_of_one_variable_that_differ_are_refused():
    with pytest.raises(UsageError, match=r"'x.f' and 'F.f' are one variable"):
        run(duffing("{values: {x.f: 1, F.f: 2, k.q: 1}}"))


def test_values_against_the_equations_are_a_warning():
    result = run(duffing("{values: {x.f: 1, m.f: 2, c.f: 2, k.q: 1}}"))
    assert any("contradict the equations" in text for text in result["bond_graph/warnings"].data)


@pytest.mark.parametrize(("old", "new"), [("", ""), ("value: 2}", "value: 2*}")])
def test_laws_are_refused_where_parameters_are_identified(old, new):
    text = duffing("{}").replace("kind: bond-graph", "kind: identification").replace(old, new)
    with pytest.raises(SceneError, match="laws are for scenes of kind bond-graph") as caught:
        scene(text)
    places = [fault.line for fault in caught.value.faults if fault.message.startswith("laws are for")]
    assert places == [8, 9]
    assert any("this is not arithmetic" in fault.message for fault in caught.value.faults) == bool(new)


def test_a_law_of_a_port_of_a_field_is_linearised():
    """m x'' + (1 + K11) x = F with e = f(q_a) = K11 q_a beside: the law reads the effort of the port."""
    text = """
dynid: 1
kind: bond-graph
graph:
  nodes:
    F: Se
    x: 1
    m: {type: I, value: 2}
    k: {type: C, matrix: [[0.25]], ports: [a]}
    c: {type: R, law: {e: "f + 3*f*abs(k.a.e) + 2*k.a.e"}}
  bonds: [F -> x, x -> m, x -> k.a, x -> c]
operating_point: {inputs: {F: 6}}
analysis: {outputs: [x.q]}
"""
    result = run(text)
    # at rest 3 e = 6 with e = q/C; then m s^2 + (1 + 3 e) s + 3/C
    assert value(result, "k.a.e") == 2
    assert slope(result, "d c.e / d c.f") == 7
    found = result["bond_graph/transfer_function/x.q/F/denominator"].data
    np.testing.assert_allclose(found, [1, 3.5, 6], rtol=1e-13)


def test_a_range_of_starts_in_order_is_searched():
    result = run(duffing("{start: {k.q: 0.4}, search: {starts: 4, ranges: {k.q: [-0.6, -0.4]}}}"))
    names = list(result[f"{POINT}/variable"].data)
    assert -0.5 in result[f"{POINT}/equilibria"].data[:, names.index("k.q")]
    assert value(result, "k.q") == 0.5


@pytest.mark.parametrize("point", ["", "operating_point: {}"])
def test_samples_of_a_graph_with_laws_are_run_alone(point):
    from dynid.scene.batch import why_alone

    made = scene(DUFFING.replace("OPERATING", point))
    reason = why_alone(made, ["graph.nodes.m.value"], ())
    assert reason == "every sample has an operating point of its own"


def test_laws_without_an_operating_point_are_linearised_at_an_equilibrium_at_rest():
    text = DUFFING.replace("OPERATING", "").replace("-q + 4*q**3", "3*q + 4*q**3")
    found = run(text)["bond_graph/transfer_function/k.q/F/denominator"].data
    np.testing.assert_allclose(found, [1, 0.25, 1.5], rtol=1e-13)


HARD = DUFFING.replace("-q + 4*q**3", "3*q + 4*q**3")
HARD = HARD.replace("OPERATING", "operating_point: {search: {starts: 4}}")


def over_time(text, more=""):
    return text.replace("{outputs: [k.q]}", f"{{outputs: [k.q], time: {{stop: 5, step: 0.1{more}}}}}")


@pytest.mark.parametrize("element", ["k: {e: 0.5}", "m: {f: 0.2}"])
def test_the_nonlinear_response_from_stored_energy_is_that_of_its_equations(element):
    """q' = f(p), p' = -e(q) - r(f), from the state at which the law of the element gives e or f."""
    from scipy.integrate import solve_ivp

    text = over_time(HARD).replace("{type: I, value: 2}", '{type: I, law: {f: "p/2 + p**3"}}')
    result = run(f"{text}initial: {{{element}}}\n")
    q, p = 0.0, 0.0
    if element.startswith("k"):
        q = float(mp.findroot(lambda q: 3 * q + 4 * q**3 - mpf("0.5"), mpf("0.15")))
    else:
        p = float(mp.findroot(lambda p: p / 2 + p**3 - mpf("0.2"), mpf("0.3")))

    def rates(_, state):
        q, p = state
        f = p / 2 + p**3
        return [f, -3 * q - 4 * q**3 - 0.5 * f - f * abs(f)]

    times = result["bond_graph/time_response/time"].data
    wanted = solve_ivp(rates, (0, times[-1]), [q, p], "DOP853", times, rtol=1e-11, atol=1e-13).y[0]
    found = result["bond_graph/time_response/nonlinear"].data[:, 0]
    np.testing.assert_allclose(found, wanted, atol=1e-5 * np.abs(wanted).max())


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            over_time(HARD).replace("3*q + 4*q**3", "q/(1 + q**2)") + "initial: {k: {e: 2}}\n",
            "the stored energy at t = 0 is no value of the law of its element",
        ),
        (
            CRANK + "initial: {J: {f: 0.1}}\n",
            "stored energy is given to storage elements in derivative causality",
        ),
        (
            EMPTY_TANK.replace(
                "[C.e]", "[C.e], time: {stop: 5, step: 0.1, input: {kind: step, amplitude: -2e-3}}"
            )
            + "operating_point: {inputs: {Q: 1.0e-3}, start: {C.e: 1}}\n",
            "the nonlinear response leaves the range of a law: the law has no finite value there",
        ),
        (
            over_time(HARD, ", input: {kind: step, amplitude: 2}")
            .replace("0.5*f + f*abs(f)", "f/(1 + f**2)")
            .replace("    m: {type: I, value: 2}\n", "")
            .replace("x -> m, ", ""),
            "the equations of the nonlinear response have no solution near the last one",
        ),
    ],
)
def test_a_nonlinear_response_that_has_no_values_says_why(text, reason):
    result = run(text)
    said = result.group_attrs["bond_graph/time_response"]["nonlinear"]
    assert said == f"left out: {reason}"
    assert "bond_graph/time_response/nonlinear" not in result
    assert "bond_graph/time_response/response" in result


@pytest.mark.parametrize(("stop", "frequency"), [("2.0e+6", "3.0e+7"), ("5.0e+7", "1.0e+6")])
def test_a_nonlinear_response_of_which_no_sample_is_reached_says_why(stop, frequency):
    """The solver fails in its first step, and warns in words of its own."""
    signal = f"{{kind: sine, frequency: {frequency}}}"
    times = f"{{outputs: [k.q], time: {{stop: {stop}, step: 1.0e+4, input: {signal}}}}}"
    result = run(duffing("{start: {k.q: 0.5}}", times))
    reason = result.group_attrs["bond_graph/time_response"]["nonlinear"]
    assert "the nonlinear response was integrated to 0 s only: no step is short enough" in reason
    assert "end it before" in reason


def test_a_nonlinear_response_is_of_graphs_up_to_a_size(monkeypatch):
    monkeypatch.setattr("dynid.bondgraph.results.operating_point._MAX_VARIABLES", 9)
    result = run(over_time(HARD, ", input: {kind: step}"))
    said = result.group_attrs["bond_graph/time_response"]["nonlinear"]
    assert said == "left out: the graph has 10 variables, more than 9"


def test_an_iteration_that_does_not_end_finds_nothing(monkeypatch):
    monkeypatch.setattr("dynid.bondgraph.operating_point.newton._MAX_STEPS", 1)
    with pytest.raises(Diverged, match="no equilibrium was found from any start"):
        run(duffing("{start: {k.q: 0.4}, search: {starts: 0}, inputs: {F: 1}}"))


def small_limit(monkeypatch):
    from types import SimpleNamespace

    for module in ("newton", "equilibrium"):
        name = f"dynid.bondgraph.operating_point.{module}.DENSE_EQUILIBRIUM"
        monkeypatch.setattr(name, SimpleNamespace(value=1))


def test_equilibria_of_large_graphs_are_found_by_sparse_factors_alone(monkeypatch):
    small = run(duffing("{start: {k.q: 0.4}, search: {starts: 0}}"))
    small_limit(monkeypatch)
    result = run(duffing("{start: {k.q: 0.4}, search: {starts: 0}}"))
    assert value(result, "k.q") == value(small, "k.q") == 0.5
    assert "stable" in small[f"{POINT}/stability"].data
    assert set(result[f"{POINT}/stability"].data) == {"neutral"}


def test_a_singular_equilibrium_of_a_large_graph_is_not_found(monkeypatch):
    text = duffing("{search: {starts: 0}}").replace("-q + 4*q**3", "q**3")
    assert value(run(text), "k.q") == 0
    small_limit(monkeypatch)
    with pytest.raises(Diverged, match="no equilibrium was found from any start"):
        run(text)


@pytest.mark.parametrize(("starts", "choose", "refused"), [(90_000, 7, 0), (90_000, 2, 0), (12, 7, 1)])
def test_a_check_makes_few_of_many_starts_and_leaves_what_they_miss_to_the_run(
    starts, choose, refused, monkeypatch
):
    from dynid.bondgraph.operating_point import equilibrium
    from dynid.scene.run import preparation_errors

    made, iterate = [], equilibrium.iterate
    monkeypatch.setattr(equilibrium, "iterate", lambda *given: made.append(1) or iterate(*given))
    text = duffing(f"{{choose: {choose}, search: {{starts: {starts}}}}}")
    errors = preparation_errors(check_source(parse_source(text)))
    assert len({error.problem for error in errors}) == refused
    assert 0 < len(made) < 100


DAMPER = """
dynid: 1
kind: bond-graph
graph:
  nodes: {F: Se, m: {type: I, value: m}, c: {type: R, value: 4}, b: 1}
  bonds: [F -> b -> m, b -> c]
parameters: {m: 2}
analysis: {outputs: [m.f], results: [poles, time_response], time: {stop: 1, step: 0.1}}
"""


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("c: {type: R, value: 4}", "c: {type: R, value: x.f}", "'x.f': no node 'x'"),
        ("c: {type: R, value: 4}", "c: {type: Q, value: m.f}", "unknown node type 'Q'"),
        ("b: 1}", "b: 1, d: {type: R, law: {e: g.f}}, g: X}", "name a variable of a single node or port"),
        ("kind: bond-graph", "kind: identification", "laws are for scenes of kind bond-graph"),
        ("step: 0.1}", "step: 0.1, input: {kind: step, gain: 2}}", "'gain' belongs to the excitation of a"),
    ],
)
def test_faults_of_variables_and_signals(old, new, said):
    text = DAMPER.replace(old, new)
    if "identification" in text:
        text = text.replace("m: 2", "m: {start: 2}").replace("R, value: 4", "R, value: m.f")
    with pytest.raises(SceneError) as caught:
        scene(text)
    assert any(said in fault.message for fault in caught.value.faults), caught.value


@pytest.mark.parametrize(
    ("old", "new", "propagated"),
    [
        ("", "", True),
        (", time_response", "", False),
        ("step: 0.1}", "step: 0.1, input: {source: F, kind: impulse}}", False),
        ("step: 0.1}}", "step: 0.1}}\ninitial: {m: {f: 1}}", False),
        (
            "step: 0.1}}",
            "step: 0.1, input: {source: F, kind: sine, frequency: 2}}}\ninitial: {m: {f: 1}}",
            True,
        ),
    ],
)
@pytest.mark.parametrize("kind", ["bond-graph", "identification"])
def test_propagation_is_chosen_where_a_signal_drives_a_response(kind, old, new, propagated):
    text = DAMPER.replace(old, new).replace("kind: bond-graph", f"kind: {kind}")
    text = text.replace("m: 2", "m: {start: 2}") if kind == "identification" else text
    assert ("propagation" in aspects_of(scene(text).model)) == propagated
