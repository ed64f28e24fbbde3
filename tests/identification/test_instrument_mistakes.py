"""Suggestions of mistakes of instruments: named where they explain a record, and none of good records."""

import re

import numpy as np
import pytest

from dynid.errors import Diverged, DynidError
from dynid.identification import identify as identification
from dynid.identification.diagnosis.instrument_mistakes import instrument_mistakes
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.identify import _suggesting, identify
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement, unstacked
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.systems.frf_system import frf_data
from dynid.identification.systems.record_values import data
from dynid.lti.signals import Sampled
from dynid.parameters import starts
from dynid.report.content.blocks import Statement
from dynid.report.content.identification import sections
from dynid.scene.load import load_scene
from dynid.scene.run import run_scene
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load

pytestmark = [pytest.mark.thorough, pytest.mark.usefixtures("complete")]

STEP, SAMPLES, GRAVITY = 0.02, 300, 9.80665
CHANNELS = (Channel(1, "acceleration"), Channel(2, "acceleration"), Channel(2, "velocity"))


def model(mass=2.0):
    joint = Joint("j", (1, 2), JointParameter(start=300, true=400), JointParameter(start=0.5, true=0.8))
    return lumped((mass, 1), (Link((1,), 800, 1.5),), [joint])


def force(seed):
    return np.random.default_rng(1000 + seed).standard_normal(SAMPLES)


def load(samples, step=STEP):
    return [Load(1, Sampled(samples, step))]


def record(seed=1, noise=0.05, step=STEP):
    """Values of a good record (samples x channels)."""
    simulation = Measurement(step, SAMPLES, CHANNELS, Simulation(noise, seed))
    return data(model(), load(force(seed), step), simulation).values


def later(values, samples):
    out = np.roll(values, samples)
    out[:samples] = np.nan
    return out


def said(values, driven=None, structure=None):
    """Return what the warnings or the error of an identification suggest."""
    measured = Measurement(STEP, SAMPLES, CHANNELS, values)
    try:
        driving = load(force(1) if driven is None else driven)
        found = identify(structure or model(), Experiment(driving, measured), OutputError())
    except DynidError as error:
        return error.remedy.split("The lack of fit is ")[1:]
    every = found["identification/diagnostics/warnings"].data
    return [one.removeprefix("the lack of fit is ") for one in every if one.startswith("the lack of fit is ")]


@pytest.mark.parametrize(
    ("factors", "expected"),
    [
        ([1, -1, 1], "explained where 2.acceleration is -1 times the model: a reversed sensor (gain: -1)?"),
        (
            [1 / GRAVITY, 1 / GRAVITY, 1],
            "explained where 1.acceleration, 2.acceleration are 0.101972 times the model: recorded in g",
        ),
        ([1, 1, 1000], "explained where 2.velocity is 1000 times the model: a unit that is a thousand times"),
        (
            [1, 1, 1e-3],
            "explained where 2.velocity is 0.001 times the model: a unit that is a thousand times",
        ),
        ([GRAVITY, 1, 1], "explained where 1.acceleration is 9.80665 times the model: recorded in m/s2"),
        (
            [-1, -1, -1],
            "explained where 1.acceleration, 2.acceleration, 2.velocity are -1 times the model: "
            "a reversed sensor (gain: -1)? Or all of them are right, and",
        ),
    ],
)
def test_a_factor_that_explains_the_record_is_suggested(factors, expected):
    (found,) = said(record() * factors)
    assert found.startswith(expected)


@pytest.mark.parametrize("gain", [1.3, 0.6])
def test_the_gain_of_a_channel_that_explains_the_record_is_suggested(gain):
    (found,) = said(record() * [1, 1, gain])
    factor, sign, error = found.partition("2.velocity is ")[2].split()[:3]
    assert sign == "±"
    assert 0 < float(error) < 0.02
    assert abs(float(factor) - gain) < 4 * float(error)
    start = f"{float(factor):.4g}"
    assert f"state gain: NAME in its channel, and parameters: {{NAME: {{start: {start}}}}}" in found


def test_a_gain_of_a_model_that_lacks_fit_nevertheless_is_not_suggested():
    """Two sensors out of calibration: a gain of one explains nearly all of the signal, and not the record."""
    assert said(record(noise=0.005) * [1, 1.1, 1.3]) == []


def test_an_error_ends_a_suggestion_with_one_full_stop():
    def stopped(what):
        return str(_suggesting(Diverged("no optimum", remedy="Start nearer."), [what]))

    assert stopped("the sensor is out of calibration").endswith(
        "The sensor is out of calibration. Start nearer."
    )
    assert stopped("a reversed sensor (gain: -1)?").endswith(" A reversed sensor (gain: -1)? Start nearer.")


def test_a_page_ends_a_suggestion_with_one_full_stop(scene):
    table = np.column_stack([force(1), record()[:, 0], 1.3 * record()[:, 2]]), "F,a,v"
    said = " ".join(
        block.text
        for part in sections(scene(TIME, *table))
        for block in part.blocks
        if isinstance(block, Statement)
    )
    assert "{start: 1.3" in said
    assert ".." not in said
    assert "?." not in said
    assert re.search(r"2\.velocity is (\d\.\d+) ± 0\.\d+ times", said)


def test_a_gain_that_is_hardly_off_is_not_suggested():
    assert said(record() * [1, 1, 1.02]) == []


@pytest.mark.parametrize("samples", [1, 3])
def test_a_delay_of_whole_samples_is_suggested(samples):
    values = record()
    values[:, 2] = later(values[:, 2], samples)
    (found,) = said(values)
    assert f"2.velocity is {samples} sample" in found
    assert f"(delay: {samples * STEP:g})?" in found


def test_another_start_of_the_excitation_is_suggested():
    values = np.column_stack([later(one, 2) for one in record().T])
    (found,) = said(values)
    assert "are 2 samples (0.04 s) later than the model" in found
    assert (
        "Or all of them are right, and the excitation has the inverse mistake (of a file: delay: -0.04)"
        in found
    )


@pytest.mark.parametrize("sign", [1, pytest.param(-1, marks=pytest.mark.slow)])
def test_exchanged_channels_of_one_quantity_are_suggested(sign):
    found = said(record()[:, [1, 0, 2]] * [1, sign, 1])
    assert found[0].startswith(
        "explained where 1.acceleration and 2.acceleration are exchanged: exchanged cables"
    )
    assert [one for one in found[1:] if "exchanged" in one] == []
    reversed_one = "1.acceleration is -1 times the model: a reversed sensor"
    assert [reversed_one in one for one in found[1:]] == ([] if sign > 0 else [True])


@pytest.mark.slow
def test_exchanged_channels_of_different_quantities_are_no_suggestion():
    assert not any("exchanged" in one for one in said(record()[:, [0, 2, 1]]))


def test_delays_of_records_are_in_their_own_steps():
    experiments = []
    for seed, step in ((1, STEP), (2, 2 * STEP)):
        values = record(seed, step=step)
        values[:, 2] = later(values[:, 2], 2)
        measured = Measurement(step, SAMPLES, CHANNELS, values)
        experiments.append(Experiment(load(force(seed), step), measured))
    try:
        found = identify(model(), experiments, OutputError())
        every = " ".join(found["identification/diagnostics/warnings"].data)
    except DynidError as error:
        every = str(error)
    assert "record_1.2.velocity is 2 samples (0.04 s) later than the model" in every
    assert "record_2.2.velocity is 2 samples (0.08 s) later than the model" in every
    assert "(delay: 0.04)?" in every
    assert "(delay: 0.08)?" in every


def test_a_wrong_model_is_no_mistake_of_an_instrument():
    assert said(record(), structure=model(mass=3.0)) == []


@pytest.mark.parametrize(
    ("factor", "expected"), [(1 / GRAVITY, "recorded in g (unit: g)?"), (-1, "gain: -1")]
)
def test_a_factor_of_a_frequency_response_is_suggested(factor, expected):
    channels = tuple(Frf(Channel(dof, "acceleration"), 1) for dof in (1, 2))
    omega = np.linspace(5, 45, 81)
    simulated = FrfMeasurement(omega, channels, Simulation(0.03, 3))
    values = unstacked(frf_data(model(), simulated).values)
    try:
        found = identify(model(), FrfMeasurement(omega, channels, values * [1, factor]))
        every = " ".join(found["identification/diagnostics/warnings"].data)
    except DynidError as error:
        every = str(error)
    assert "lack of fit is explained where 2.acceleration" in every
    assert expected in every


def suggested_of_good_records(monkeypatch, seeds):
    """Return the suggestions for good records, whether their fit gives cause for them or not."""
    found = []

    def checked(posterior, begun, _suggest):
        etas = [posterior.fit.eta, starts(begun.unknowns)]
        found.append(instrument_mistakes(posterior.likelihood, etas))
        return posterior

    monkeypatch.setattr(identification, "_checked", checked)
    for seed in seeds:
        simulation = Measurement(STEP, SAMPLES, CHANNELS, Simulation(0.05, seed))
        identify(model(), Experiment(load(force(seed)), simulation), OutputError())
    assert len(found) == len(seeds)
    return [one for one in found if one]


def test_good_records_give_no_cause_for_suggestions(monkeypatch):
    assert suggested_of_good_records(monkeypatch, [1]) == []


@pytest.mark.slow
def test_none_of_many_good_records_gives_cause_for_suggestions(monkeypatch):
    assert suggested_of_good_records(monkeypatch, range(2, 64)) == []


@pytest.mark.usefixtures("poor_starts")
def test_a_reversed_sensor_is_suggested_after_a_start_too_far_away_to_show_it():
    def joint(name, dofs, k, c):
        start = JointParameter(start=2e4, true=k), JointParameter(start=5, true=c)
        return Joint(name, dofs, *start)

    chain = lumped((2, 3, 1.5), (), [joint("a", (1, 2), 4e4, 15), joint("b", (2, 3), 2.5e4, 8)])
    channels = (Channel(1, "acceleration"), Channel(3, "acceleration"))
    tones = np.random.default_rng(7).standard_normal((2, 156))
    t = np.arange(1024)[:, None] / 1024
    shaking = np.sin(2 * np.pi * np.arange(2, 80, 0.5) * t + 3 * tones[1]) @ tones[0]
    driven = load(40 * shaking / shaking.std() * np.minimum(1, t[:, 0] / 0.05) ** 2, 1 / 1024)
    simulation = Measurement(1 / 1024, 1024, channels, Simulation(0.02, 1))
    good = data(chain, driven, simulation).values
    with pytest.raises(DynidError) as error:
        identify(chain, Experiment(driven, Measurement(1 / 1024, 1024, channels, good * [1, -1])))
    cause, _, general = error.value.remedy.partition("(gain: -1)? ")
    assert (
        cause == "The lack of fit is explained where 3.acceleration is -1 times the model: a reversed sensor "
    )
    assert general.startswith("Start nearer")


SCENE = """\
dynid: 1
kind: identification
PARAMETERSstructure:
  lumped: {masses: [2, 1], links: [{dofs: [1], k: 800, c: 1.5}]}
joints:
  j: {dofs: [1, 2], k: {start: 300}, c: {start: 0.5}}
"""
TIME = """\
excitation: [{dof: 1, kind: file, path: x.csv, column: F, gain: FORCE}]
measurement:
  step: 0.02
  samples: 300
  channels: [{dof: 1, quantity: acceleration}, {dof: 2, quantity: velocity, gain: GAIN}]
  file: {path: x.csv, columns: [a, v]}
"""
LINES = """\
measurement:
  channels:
    - {dof: 1, quantity: acceleration, reference: {dof: 1}}
    - {dof: 2, quantity: velocity, reference: {dof: 1}, gain: GAIN}
  frf: {file: {path: x.csv, columns: [[ar, ai], [vr, vi]], frequency: f (Hz)}}
"""


def table_of_responses(gain):
    """Return columns of two frequency responses, the second times a gain."""
    frfs = tuple(Frf(CHANNELS[k], 1) for k in (0, 2))
    f = np.linspace(1, 8, 80)
    H = unstacked(frf_data(model(), FrfMeasurement(2 * np.pi * f, frfs, Simulation(0.02, 1))).values)
    columns = np.column_stack([f, H[:, 0].real, H[:, 0].imag, gain * H[:, 1].real, gain * H[:, 1].imag])
    return columns, "f (Hz),ar,ai,vr,vi"


@pytest.fixture
def scene(tmp_path):
    """Return what runs a scene with a file, parameters, and the gain of its second channel or its force."""

    def run(end, columns, heads, parameters="", gain="1", force="1"):
        np.savetxt(tmp_path / "x.csv", columns, delimiter=",", header=heads, comments="")
        text = (SCENE + end).replace("PARAMETERS", parameters).replace("GAIN", gain).replace("FORCE", force)
        (tmp_path / "scene.yaml").write_text(text)
        return run_scene(load_scene(tmp_path / "scene.yaml"))

    return run


def suggestions(result):
    """Return what the warnings of a result suggest."""
    every = result["identification/diagnostics/warnings"].data
    return [one for one in every if one.startswith("the lack of fit is explained where")]


def suggested_gain(result, where):
    """Return the parameters that the warnings of a result suggest, of a parameter `g`."""
    warnings = " ".join(result["identification/diagnostics/warnings"].data)
    found = re.search(rf"state gain: NAME in {where}, and (parameters: .*?}}}})", warnings)
    assert found is not None
    return f"{found[1].replace('NAME', 'g')}\n"


def assert_explained(result, gain):
    assert result.value("identification/diagnostics/converged")
    assert not result.value("identification/diagnostics/lacks_fit")
    place = list(result.value("identification/parameters/parameter")).index("g")
    estimate, deviation = (
        result.value(f"identification/parameters/{name}")[place] for name in ("estimate", "standard_error")
    )
    assert abs(estimate - gain) < 4 * deviation < 0.1


@pytest.mark.parametrize(
    ("end", "gain"),
    [*(pytest.param(TIME, gain, marks=pytest.mark.slow) for gain in (1.3, -1.3)), (LINES, 1.3)],
)
def test_a_scene_with_the_suggested_gain_explains_the_record(scene, end, gain):
    table = np.column_stack([force(1), record()[:, 0], gain * record()[:, 2]]), "F,a,v"
    if end is LINES:
        table = table_of_responses(gain)
    parameters = suggested_gain(scene(end, *table, gain="1" if gain > 0 else "-1"), "its channel")
    assert_explained(scene(end, *table, parameters, gain="g"), gain)


@pytest.mark.parametrize("factor", [1.15, pytest.param(0.9, marks=pytest.mark.slow)])
def test_a_scene_with_the_suggested_gain_of_the_excitation_explains_the_record(scene, factor):
    values = record(noise=0.01)
    table = np.column_stack([factor * force(1), values[:, 0], values[:, 2]]), "F,a,v"
    first = scene(TIME, *table)
    (warning,) = suggestions(first)
    assert "1.acceleration, 2.velocity are" in warning
    assert f"the excitation, recorded {factor:g} times as large as it is, or all sensors" in warning
    parameters = suggested_gain(first, "the excitation")
    start = re.search(r"start: ([0-9.]+)", parameters)[1]
    assert float(start) == pytest.approx(factor, rel=0.01)
    assert_explained(scene(TIME, *table, parameters, force="g"), factor)


def test_no_factor_of_a_channel_of_unknown_gain_is_suggested(scene):
    values = record(noise=0.01)
    table = np.column_stack([1.15 * force(1), values[:, 0], values[:, 2]]), "F,a,v"
    found = scene(TIME, *table, "parameters: {g: {start: 0.87}}\n", gain="g")
    (warning,) = suggestions(found)
    assert warning.startswith("the lack of fit is explained where 1.acceleration is 0.8")
    assert "the excitation, recorded 1.15 times as large as it is, or the sensor out of cal" in warning
