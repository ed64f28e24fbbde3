"""Numbers over the whole range of double precision, in every key that holds one."""

import math
import random

import numpy as np
import pytest

from dynid.errors import SceneError, UsageError
from dynid.identification.diagnosis.instrument_mistakes import _best
from dynid.identification.records.measurement import check_finite
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source
from dynid.scene.yaml.writer import dump
from tests.fuzz.judge import Sandbox
from tests.fuzz.mutation import at, bases, paths
from tests.sample import sample

SIZES = [5e-324, 1e-300, 1e-155, 1e-30, 1e30, 1e90, 1e100, 1e149, 1e151, 1e155, 1e300, 1.7e308]


def keys():
    """Return a scene and a path for every key of numbers, whatever the names above it."""
    scenes = {}
    for data in bases():
        for path in paths(data):
            if type(at(data, path)) in (int, float) and path[-1] != "dynid":
                shape = tuple("*" if isinstance(key, int) else key for key in path)
                scenes.setdefault((data["kind"], shape[0], *shape[-2:]), (data, path))
    return [scenes[key] for key in sorted(scenes, key=str)]


def with_value(data, path, value):
    """Return a scene with another value at a path."""
    if not path:
        return value
    copy = data.copy()
    copy[path[0]] = with_value(data[path[0]], path[1:], value)
    return copy


@pytest.mark.parametrize("part", sample(range(60), 1))
def test_a_number_of_any_size_is_valid_or_refused_at_its_place(tmp_path, part):
    sandbox, chance = Sandbox(tmp_path), random.Random(part)
    for data, path in keys()[part::60]:
        for size in chance.sample(SIZES, 3):
            value = chance.choice([size, size, -size])
            assert sandbox.judge(dump(with_value(data, path, value))).wrong == "", f"{path} = {value}"


@pytest.mark.slow
@pytest.mark.parametrize("part", range(40))
def test_a_scene_with_a_number_of_any_size_runs_or_is_refused(tmp_path, part):
    sandbox, chance = Sandbox(tmp_path), random.Random(part)
    for data, path in keys()[part::40]:
        value = chance.choice(SIZES) * chance.choice([1, 1, -1])
        verdict = sandbox.judge(dump(with_value(data, path, value)), "run", seconds=60)
        assert verdict.wrong == "", f"{path} = {value}"


GRAPH = """dynid: 1
kind: bond-graph
parameters: {big: 1e100}
graph:
  nodes: {F: Se, j: 1, m: {type: I, value: 1e-300}, b: {type: R, value: 1e300}}
  bonds: [F -> j -> m, j -> b]
analysis: {outputs: [m.f], frequency: {start: 1, stop: STOP}}
"""


def test_elements_of_graphs_are_exact_at_any_size_and_other_numbers_have_a_limit():
    check_source(parse_source(GRAPH.replace("STOP", "1e150"), "s.yaml"))
    for stop in ("1.01e150", "big*big", "1e308"):
        with pytest.raises(SceneError, match=r"s\.yaml:7:56: .* is too large: numbers reach 1e\+150"):
            check_source(parse_source(GRAPH.replace("STOP", stop), "s.yaml"))


@pytest.mark.parametrize("size", [1e-160, 1e-90, 1.0, 1e98, 1e149, 1e300])
def test_a_reversed_scaled_and_late_channel_is_recognised_at_any_size(size):
    predicted = np.random.default_rng(3).standard_normal(300)
    factors = np.array([-1000.0, -1.0, 1.0, 1000.0])
    recorded = -1000 * size * np.roll(predicted, 2)
    correction = _best(recorded, size * predicted, factors, in_time=True)
    assert (correction.factor, correction.delay) == (-1000.0, 2)


def test_measured_values_whose_squares_overflow_are_refused():
    for values in ([1.0, -1e151], [1j * 1e200, 2]):
        with pytest.raises(UsageError, match=r"values reach 1e\+\d+; they may reach 1e\+150"):
            check_finite(np.array(values), "values", "sample")
    with pytest.raises(UsageError, match="must be finite, or NaN where a sample is missing"):
        check_finite(np.array([1.0, math.inf]), "values", "sample")
    check_finite(np.array([1e150, math.nan]), "values", "sample")
