"""Poles, zeros, modes and responses of an identified model with their bands."""

import math

import numpy as np
import pytest

import dynid
from dynid import native
from dynid.identification.derived import (
    DELTA,
    LOGARITHM,
    SAMPLED,
    DerivedQuantities,
    GaussianPosterior,
    RootFamily,
    pairs_of,
)
from dynid.identification.results.write_derived import DerivedRequest, _add_roots
from dynid.identification.results.write_result import Further
from dynid.identification.systems.structure_system import StructureSystem
from dynid.lti.root_slopes import Roots
from dynid.lti.signals import Multisine
from dynid.parameters import Parameter
from dynid.report.content.responses import derived_sections, derived_table
from dynid.result import Result
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.identification.cases import LOADS, VELOCITIES, run, simulated
from tests.screens import lines

DERIVED, WIDTH = "identification/derived", 1.959963984540054


@pytest.fixture(scope="module")
def result():
    return run(measurement=simulated(0.05), further=Further(DerivedRequest()))


def bands(result):
    for path in result:
        if path.startswith(DERIVED) and path.endswith("/value"):
            group = path.removesuffix("/value")
            yield group, *(result[f"{group}/{name}"].data for name in ("value", "low", "high"))


def test_every_value_is_within_its_band(result):
    found = list(bands(result))
    assert {group.split("/")[2] for group, *_ in found} == {
        *("poles", "modes", "zeros", "gains", "frequency_response")
    }
    for group, value, low, high in found:
        for part in (np.real, np.imag):
            assert np.all(part(low) <= part(value)), group
            assert np.all(part(value) <= part(high)), group
        if group.endswith(("/frequency", "/magnitude")):
            assert np.all(low > 0), group


@pytest.mark.usefixtures("complete")
def test_small_systems_have_them_without_a_request(result):
    plain = run(measurement=simulated(0.05, samples=200))
    assert {path for path in plain if path.startswith(DERIVED)} == {
        path for path in result if path.startswith(DERIVED)
    }
    assert [one.group_attrs[DERIVED]["requested"] for one in (plain, result)] == [False, True]


def test_nothing_is_derived_where_nothing_is_requested():
    result = run(measurement=simulated(0.05), further=Further(DerivedRequest(())))
    assert not any(path.startswith(DERIVED) for path in result)


def test_the_truth_is_in_most_bands(result):
    """At the true values of the parameters every mode is within twice its band."""
    from dynid.structure.poles import pole_sensitivities
    from tests.identification.cases import suspension

    model = suspension()
    true = pole_sensitivities(model, {one.name: one.true for one in model.unknowns})
    for name, value in (("frequency", true.omega), ("damping", true.zeta)):
        low, high = (result[f"{DERIVED}/modes/{name}/{end}"].data for end in ("low", "high"))
        middle, half = (low + high) / 2, (high - low) / 2
        assert np.all(np.abs(value - middle) <= 2 * half)


def one_mass(k=8e3, c=4.0, deviations=(0.02, 0.05)):
    """The Gaussian posterior of spring and damper of one mass, and what follows from it."""
    joint = Joint("foot", (1,), JointParameter(start=k), JointParameter(start=c))
    system = StructureSystem(
        lumped([2.0], [], [joint]), [Load(1, Multisine([1], [50]))], [Channel(1, "displacement")]
    )
    unknowns = tuple(Parameter(f"foot.{name}", value) for name, value in (("k", k), ("c", c)))
    eta, far = np.log([k, c]), np.full(2, np.inf)
    return DerivedQuantities(GaussianPosterior(unknowns, eta, np.diag(deviations), -far, far), system)


def test_the_bands_of_one_mass_are_those_of_the_formulas():
    frequency, damping = one_mass().poles.frequencies()
    omega, zeta = math.sqrt(4e3), 4 / (2 * math.sqrt(8e3 * 2))
    np.testing.assert_allclose(frequency.value, omega, rtol=1e-12)
    np.testing.assert_allclose(damping.value, zeta, rtol=1e-9)
    # ln omega = ln k / 2 + …, ln zeta = ln c - ln k / 2 + …
    assert frequency.method.tolist() == damping.method.tolist() == [LOGARITHM]
    by_omega, by_zeta = WIDTH * 0.01, WIDTH * math.hypot(0.01, 0.05)
    np.testing.assert_allclose(frequency.low, omega * math.exp(-by_omega), rtol=1e-9)
    np.testing.assert_allclose(frequency.high, omega * math.exp(by_omega), rtol=1e-9)
    np.testing.assert_allclose(damping.low, zeta * math.exp(-by_zeta), rtol=1e-7)
    np.testing.assert_allclose(damping.high, zeta * math.exp(by_zeta), rtol=1e-7)


def test_the_band_of_the_compliance_is_that_of_the_spring():
    derived = one_mass()
    (pair,) = pairs_of([("x", "m")], [("f", "N")])
    gains = derived.gains(pair, derived.zeros(pair))
    np.testing.assert_allclose(gains["dc"].value, 1 / 8e3, rtol=1e-12)
    np.testing.assert_allclose(gains["dc"].high, np.exp(WIDTH * 0.02) / 8e3, rtol=1e-9)
    assert gains["high_frequency"].value == gains["high_frequency"].high == 0
    magnitude, phase = derived.response(np.array([0.0, 1e5]), pair)
    np.testing.assert_allclose(magnitude.low[0], np.exp(-WIDTH * 0.02) / 8e3, rtol=1e-9)
    np.testing.assert_allclose(magnitude.value[1], 1 / (2 * 1e10), rtol=1e-5)
    np.testing.assert_allclose(phase.value[1], -math.pi, atol=1e-4)


def test_a_pole_that_may_split_has_the_quantiles_of_samples():
    """The damping ratio is 0.98 with a deviation of 5 %: the imaginary part has no linear band."""
    c = 0.98 * 2 * math.sqrt(8e3 * 2)
    derived = one_mass(c=c)
    _, imaginary = derived.poles.parts()
    assert imaginary.method.tolist() == [SAMPLED]
    assert imaginary.low[0] == 0
    _, damping = derived.poles.frequencies()
    assert damping.high[0] > 1
    np.testing.assert_allclose(damping.high, 0.98 * math.exp(WIDTH * math.hypot(0.01, 0.05)), rtol=1e-6)


@pytest.mark.thorough
def test_a_curved_quantity_has_the_quantiles_of_samples():
    """Of k in a posterior 60 % wide, 1 / |k - m w^2| has a pole inside the band."""
    (pair,) = pairs_of([("x", "m")], [("f", "N")])
    magnitude, _ = one_mass(deviations=(0.6, 0.05)).response(np.array([math.sqrt(4e3) * 1.1]), pair)
    assert magnitude.method.tolist() == [SAMPLED]
    drawn = np.random.default_rng(5).standard_normal((20_000, 2)) * [0.6, 0.05]
    k, c = 8e3 * np.exp(drawn[:, 0]), 4 * np.exp(drawn[:, 1])
    w = math.sqrt(4e3) * 1.1
    size = 1 / np.abs(k - 2 * w * w + 1j * w * c)
    np.testing.assert_allclose(
        [magnitude.low[0], magnitude.high[0]], np.quantile(size, [0.025, 0.975]), rtol=0.35
    )


def test_what_holds_for_all_values_is_stated_as_such():
    """Two masses without a fixture and without damping: everything is on the axis, whatever the spring."""
    joint = Joint("bolt", (1, 2), JointParameter(start=1e4))
    system = StructureSystem(
        lumped([2.0, 1.0], [], [joint]), [Load(1, Multisine([1], [50]))], [Channel(1, "velocity")]
    )
    far = np.full(1, np.inf)
    posterior = GaussianPosterior((Parameter("bolt.k", 1e4),), np.log([1e4]), np.array([[0.1]]), -far, far)
    derived = DerivedQuantities(posterior, system)
    assert derived.poles.reference.origin == 2
    verdict = derived.poles.verdict("stable", "pole", "stable")
    assert verdict.always
    assert not verdict.holds
    assert verdict.probability == 0
    assert "2 poles at the origin and 2 poles on the imaginary axis" in verdict.statement
    family = derived.zeros(pairs_of([("v", "m/s")], [("f", "N")])[0])
    assert family.on_axis.all()  # one at the origin, two where the second mass absorbs
    real, imaginary = family.parts()
    assert not real.low.any()
    assert not real.high.any()
    np.testing.assert_allclose(imaginary.value[-1], 100.0, rtol=1e-12)
    np.testing.assert_allclose(imaginary.high[-1], 100.0 * math.exp(WIDTH * 0.05), rtol=1e-9)


def test_the_probability_of_stability_is_that_of_the_sign():
    """A damping with a Gaussian posterior around 0.5 deviations is positive with probability Phi(0.5)."""
    k, c, deviation = 8e3, 4.0, 8.0
    system = one_mass(k, c).system
    far = np.full(2, np.inf)
    unknowns = (Parameter("foot.k", k), Parameter("foot.c", c, scale="linear"))
    posterior = GaussianPosterior(unknowns, np.array([math.log(k), c]), np.diag([1e-6, deviation]), -far, far)
    verdict = DerivedQuantities(posterior, system).poles.verdict("stable", "pole", "stable")
    assert verdict.holds
    assert not verdict.always
    assert verdict.probability == pytest.approx(0.5 * (1 + math.erf(0.5 / math.sqrt(2))), abs=0.04)


def test_methods_are_recorded(result):
    found = set()
    for path in result:
        if path.startswith(DERIVED) and path.rpartition("/")[2].startswith("method"):
            found |= set(np.atleast_1d(result[path].data).tolist())
    assert found <= {DELTA, LOGARITHM, SAMPLED}
    assert LOGARITHM in found


def test_a_link_with_known_values_gives_a_zero_without_a_band():
    """The zeros of the part behind the sensor do not depend on the joints."""
    links = [Link((1,), 2e4, 20), Link((2, 3), 3e4, 30)]
    joint = Joint("j", (1, 2), JointParameter(start=1e4, true=2e4))
    model = lumped([2.0, 1.0, 1.0], links, [joint])
    system = StructureSystem(model, [Load(1, LOADS[0].signal)], [VELOCITIES[0]._replace(dof=2)])
    far = np.full(1, np.inf)
    posterior = GaussianPosterior((Parameter("j.k", 2e4),), np.log([2e4]), np.array([[0.1]]), -far, far)
    real, imaginary = (
        DerivedQuantities(posterior, system).zeros(pairs_of([("v", "m/s")], [("f", "N")])[0]).parts()
    )
    pair = np.flatnonzero(imaginary.value > 1)
    np.testing.assert_allclose(real.value[pair], -15, rtol=1e-9)
    np.testing.assert_allclose(imaginary.high[pair], imaginary.value[pair], rtol=1e-9)


def test_the_report_and_the_screen_have_the_modes_with_their_bands(result):
    """The zero of 2.velocity / 5 is that of a known spring and mass: it is certain."""
    table = derived_table(result)
    columns, rows = table.columns, table.rows
    assert columns == ("", "rad/s", "95 % band", "ζ in %", "95 % band")
    assert [row[0] for row in rows] == [
        *(f"mode {k}" for k in range(1, 6)),
        *("zero 1 of 2.velocity/5", "zero 1 of 3.velocity/5", "zero 2 of 3.velocity/5"),
    ]
    for column, (name, factor) in enumerate((("frequency", 1.0), ("damping", 100.0))):
        low, high = (factor * result[f"{DERIVED}/modes/{name}/{end}"].data for end in ("low", "high"))
        for k in range(5):
            found = [float(text) for text in rows[k][2 * column + 2].split(" … ")]
            assert found == pytest.approx([low[k], high[k]], abs=0.03 * (high[k] - low[k]))
    certain = rows[5]
    assert (certain[2], certain[4]) == ("for all values", "for all values")
    assert float(certain[1]) == pytest.approx(math.sqrt(25_000), abs=0.05)
    (section,) = derived_sections(result)
    table, *said = section.blocks
    assert table.rows == rows
    assert said[0].text == "stable (probability >0.999)"
    assert said[1].text.startswith("2.velocity/5: not minimum phase for any values of the parameters")
    screen = "\n".join(lines(result, rows=3))
    assert "mode 3" in screen
    assert "mode 4" not in screen
    assert "    … 5 more rows in the file\n  stable (probability >0.999)\n  2.velocity/5: not" in screen


@pytest.mark.parametrize(("gaussian", "word"), [(True, "is"), (False, "is not")])
def test_a_posterior_that_was_checked_is_judged_without_a_table(gaussian, word):
    result = Result("identification")
    assert not list(derived_sections(result))
    for name, value in {"k_hat": 0.314, "gaussian": gaussian, "effective_samples": 812.4}.items():
        result.add(f"identification/posterior/{name}", value)
    result.annotate("identification/posterior", samples=1000)
    (section,) = derived_sections(result)
    (said,) = section.blocks
    assert said.text == f"the posterior {word} Gaussian (k = 0.31, 812 effective samples of 1000)"


def test_ends_of_a_band_that_nothing_bounds_are_infinite():
    """Roots that no sample has leave their band open, in both parts."""
    far = np.array([np.inf])
    posterior = GaussianPosterior((Parameter("k", 1.0),), np.zeros(1), np.eye(1), -far, far)
    here = Roots(np.array([-1 + 2j, -1 - 2j]), np.full((2, 1), np.inf + 0j), 0)
    result = Result("identification")
    _add_roots(result, "roots", "pole", RootFamily(posterior, lambda etas: [None] * len(etas), here))
    assert result["roots/value"].data.tolist() == [-1 + 2j]
    for name, end in (("low", -math.inf), ("high", math.inf)):
        both = result[f"roots/{name}"].data
        assert both.real.tolist() == both.imag.tolist() == [end]


CLEAN_CHAIN = """
dynid: 1
kind: identification
structure:
  lumped: {masses: [1, 1.5, 2, 1], links: [{dofs: [1], k: 900, c: 3}, {dofs: [3, 4], k: 1200, c: 3}]}
derived: [poles, zeros, modes]
joints:
  upper: {dofs: [1, 2], k: {start: 700, true: 1000}, c: {start: 2, true: 2.5}}
  lower: {dofs: [2, 3], k: {start: 700, true: 800}, c: {start: 3, true: 2}}
excitation: [{dof: 4, kind: multisine, amplitude: [1, 1, 1], frequency: [9, 23, 41]}]
measurement:
  step: 0.01
  samples: 300
  channels: [{dof: 1, quantity: velocity}, {dof: 2, quantity: acceleration}]
  simulate: {noise_ratio: 0, settle: 10}
"""


@pytest.mark.thorough
def test_a_clean_record_has_zeros_of_one_shape_with_and_without_the_library(monkeypatch):
    """Three links with k/c = 400 stand between the force and mass 1, two between it and mass 2."""
    roots = {}
    for wish in ("0", "1" if native.found() else "0"):
        monkeypatch.setenv(native.VARIABLE, wish)
        roots[wish] = dynid.run(check_source(parse_source(CLEAN_CHAIN.lstrip("\n"))))
    for result in roots.values():
        for output, count in (("1.velocity", 3), ("2.acceleration", 2)):
            group = f"identification/derived/zeros/{output}/4"
            value, multiplicity = (result[f"{group}/{name}"].data for name in ("value", "multiplicity"))
            multiple = (multiplicity == count) & (value != 0)
            assert multiple.sum() == count
            np.testing.assert_allclose(value[multiple], -400, rtol=1e-9)
            for end in ("low", "high"):
                assert np.abs(result[f"{group}/{end}"].data[multiple] + 400).max() < 1e-6
        assert result["identification/derived/gains/2.acceleration/4/dc/value"].data == 0
    one, other = roots["0"], roots[max(roots)]
    shapes = [
        {path: result[path].data.shape for path in result if "/derived/" in path} for result in (one, other)
    ]
    assert shapes[0] == shapes[1]


def test_repeated_roots_of_equal_branches_stay_on_the_axis():
    """Three equal branches on a mass have two modes of their own at sqrt(k/m), also zeros of the mass."""
    links = [{"dofs": [1, branch], "k": 400} for branch in (2, 3, 4)]
    data = {
        "kind": "identification",
        "structure": {"lumped": {"masses": [2, 1, 1, 1], "links": links}},
        "joints": {"ground": {"dofs": [1], "k": {"start": 300, "true": 500}}},
        "derived": ["poles", "zeros"],
        "excitation": [{"dof": 1, "kind": "multisine", "amplitude": [1, 1, 1], "frequency": [5, 13, 31]}],
        "measurement": {
            "step": 0.01,
            "samples": 200,
            "channels": [{"dof": 1, "quantity": "displacement"}, {"dof": 2, "quantity": "velocity"}],
            "simulate": {"noise_ratio": 0.01, "seed": 1},
        },
    }
    result = dynid.run(dynid.scene_from(data))
    for group, repeated in (("poles", 2), ("zeros/1.displacement/1", 3), ("zeros/2.velocity/1", 2)):
        value, on_axis, multiplicity = (
            result[f"{DERIVED}/{group}/{name}"].data for name in ("value", "on_axis", "multiplicity")
        )
        np.testing.assert_allclose(value[multiplicity > 1], 20j, rtol=1e-12)
        assert multiplicity[multiplicity > 1].tolist() == [repeated] * repeated
        assert on_axis.all()
        assert not value.real.any()
    assert result[f"{DERIVED}/verdicts/always"].data.all()
