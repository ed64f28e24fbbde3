"""Searches with the modes in the band: their responses, the estimate of the whole model, the work saved."""

from functools import cache

import numpy as np
import pytest

from dynid.arithmetic.dependent import Dependent
from dynid.identification.estimators import auto
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.identify import identify
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Simulation
from dynid.identification.systems.band_limited_system import BAND_FACTOR, band_limited
from dynid.identification.systems.frf_system import FrfSystem
from dynid.identification.systems.structure_system import StructureSystem
from dynid.parameters import Parameter
from dynid.structure.assembly import PointMass, Spring, Support
from dynid.structure.damping import ProportionalDamping
from dynid.structure.frame import beam
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel
from tests.identification.cases import diagnostic, parameter

pytestmark = pytest.mark.thorough

LINES = np.linspace(20, 400, 120)
FUNCTIONS = tuple(Frf(Channel(dof, "acceleration"), "w_31") for dof in ("w_16", "w_31"))
TRUE = {"EI": 1.7e3, "rhoA": 0.4, "k": 3e3, "tip": 0.5}


def whole_beam(factor=0.9, *, free=False, damping=(1.0, 1e-5), joints=()):
    """A beam of 30 elements with unknown EI, rhoA, spring and tip mass: more than 58 DOFs."""
    named = [(name, value) for name, value in TRUE.items() if not (free and name == "k")]
    starts = {name: value * factor ** (-1) ** at for at, (name, value) in enumerate(named)}
    p = {name: Dependent.parameter(name, start) for name, start in starts.items()}
    return beam(
        30, 6.0, p["EI"], p["rhoA"], supports=[] if free else [Support(1, ("w", "theta"))],
        masses=[PointMass(31, p["tip"])], springs=[] if free else [Spring(21, "w", p["k"])],
        damping=ProportionalDamping(*damping), joints=joints,
        parameters=[Parameter(name, start, TRUE[name]) for name, start in starts.items()],
    )  # fmt: skip


JOINT = Joint("elbow", ("theta_9", "theta_14"), JointParameter(start=800.0), JointParameter(start=5.0))
MODELS = {
    "clamped": whole_beam(),
    "free, with rigid-body motions": whole_beam(free=True),
    "without damping": whole_beam(damping=(0.0, 0.0)),
    "with a joint": whole_beam(joints=[JOINT]),
}


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS.keys())
@pytest.mark.parametrize("factor", [0.05, 1.0, 20.0])
def test_responses_of_the_band_are_those_of_the_whole_structure(model, factor):
    of = FrfSystem.of(model, FUNCTIONS)
    found = band_limited(of.system, LINES, of.pairs, BAND_FACTOR)
    values = {one.name: one.start * factor**place for place, one in enumerate(model.unknowns)}
    values = {name: value if name != "rhoA" else TRUE["rhoA"] for name, value in values.items()}
    (H, slopes), (near, by_value) = (
        system.paired_response(values, LINES, of.pairs) for system in (of.system, found)
    )
    assert np.abs(near - H).max() < 1e-6 * np.abs(H).max()
    for k, value in enumerate(values.values()):
        off = np.abs(by_value - slopes)[..., k].max()
        assert off < 1e-6 * max(np.abs(H).max() / value, np.abs(slopes[..., k]).max())


class Evaluations:
    """Counts evaluations of the whole model."""

    def __init__(self, monkeypatch):
        self.count, evaluate = 0, StructureSystem._whole_response

        def counted(system, *given, **options):
            self.count += 1
            return evaluate(system, *given, **options)

        monkeypatch.setattr(StructureSystem, "_whole_response", counted)


@cache
def measured(factor, seed=1, ratio=0.02, estimator=None, **options):
    source = Simulation(ratio, seed, noise_by_line=True) if ratio else Simulation()
    return identify(whole_beam(factor), FrfMeasurement(LINES, FUNCTIONS, source, **options), estimator)


def assert_same(found, other):
    errors = parameter(other, "standard_error")
    assert np.all(np.abs(parameter(found, "estimate") - parameter(other, "estimate")) < 2e-3 * errors)
    assert parameter(found, "standard_error") == pytest.approx(errors, rel=1e-4)


def test_the_estimate_and_its_bars_are_those_of_the_whole_model():
    options = {"proportional": True}
    assert_same(measured(0.99, **options), measured(0.99, estimator=OutputError(), **options))


def test_a_search_evaluates_the_whole_model_a_few_times(monkeypatch):
    evaluations = Evaluations(monkeypatch)
    result = measured(0.85, seed=2, proportional=True)
    assert diagnostic(result, "converged")  # the first attempt ends in residuals as large as the responses
    assert np.abs(parameter(result, "error_percent")).max() < 1
    assert diagnostic(result, "starts") > 1
    # Three compare derivatives of like parameters, one tests joints; rounding decides how often the end of a
    # search is confirmed by the whole model.
    assert evaluations.count <= 24


def test_clean_responses_give_the_parameters_back_exactly():
    assert parameter(measured(0.95, ratio=0.0), "error_percent").max() < 1e-8


def test_a_band_that_is_too_narrow_is_widened(monkeypatch):
    """Noise that is taken for white leaves a lack of fit: only the whole model can confirm an optimum."""
    once, tried, limit = auto.Auto(multi_start=False), [], auto.FrfLikelihood.band_limited
    few = FrfMeasurement(LINES[::2], FUNCTIONS, Simulation(0.02, 3, noise_by_line=True))
    expected = identify(whole_beam(0.99), few, once)

    def recorded(likelihood, band):
        tried.append(band)
        return limit(likelihood, band)

    monkeypatch.setattr(auto, "BAND_FACTOR", 0.05)
    monkeypatch.setattr(auto.FrfLikelihood, "band_limited", recorded)
    assert_same(identify(whole_beam(0.99), few, once), expected)
    assert tried[:2] == [0.05, 0.1]


def test_small_structures_those_with_massless_dofs_and_local_joints_are_taken_whole():
    few = lumped([1.0] * 5, [Link((1,), 1e3)], [Joint("a", (2, 3), JointParameter(start=1.0))])
    chain = [Link((k, k + 1), 1e3) for k in range(1, 60)]
    massless = lumped(
        [0.0 if k == 9 else 1.0 for k in range(60)], chain, [Joint("a", (2, 3), JointParameter(start=1.0))]
    )
    local = lumped([1.0] * 60, chain, [Joint("a", (2, 3), JointParameter(start=1.0))])
    for model in (few, massless, local):
        of = FrfSystem.of(model, (Frf(Channel(1, "acceleration"), 1),))
        assert band_limited(of.system, LINES, of.pairs, BAND_FACTOR) is None
