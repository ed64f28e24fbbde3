"""Clocks of channels in scenes: what does not go with them is refused at its place."""

import re
from pathlib import Path

import pytest

import dynid
from dynid.errors import FileError, SceneError, UsageError
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

SCENE = Path(__file__).parents[2] / "configs" / "machine_clocks.yaml"
CLOCK = "clock: {step: 0.001, start: 0.25, samples: 700, drift: drift}"
LAW = "bolt: {dofs: [2, 3], laws: [{kind: cubic, k3: {start: 1.0e9}}]"
MODAL = """dynid: 1
kind: modal-analysis
band: {low: 1, high: 40, unit: Hz}
measurement:
  step: 1/1024
  samples: 900
  channels: [{dof: 1, quantity: acceleration}, {dof: 2, quantity: acceleration, clock: {samples: 700}}]
  file: {path: ../data/machine_daq.npz, columns: [acc_1, acc_3]}
"""


def scene(*changes):
    text = SCENE.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


def run(text):
    loaded = check_source(parse_source(text, str(SCENE)))
    try:
        dynid.run(loaded)
    except (UsageError, FileError) as error:
        raise SceneError([loaded.locate(error)]) from None


@pytest.mark.parametrize(
    ("text", "place", "message"),
    [
        (scene((CLOCK, "clock: {}")), 31, "a 'clock' states how it differs from the record's"),
        (scene((CLOCK, "clock: {drift: 0.2}")), 31, "at most 0.1: another rate is another 'step'"),
        (scene((CLOCK, "clock: {step: 0.001, samples: 701, drift: drift}")), 35, "has 700 samples, but"),
        (scene((CLOCK, "clock: {step: 0.002, samples: 700, drift: drift}")), 35, "'step' is 0.002"),
        (scene(("{dof: 3, quantity", "{clock: {start: 1}, dof: 3, quantity")), 34, "different clocks"),
        (scene(("  file:", "  noise: {kind: coloured, correlated: true}\n  file:")), 26, "not 'correlated'"),
        (scene(("  file:", "  prepare: [{decimate: 2}]\n  file:")), 26, "'decimate' filters all channels"),
        (scene(("expect:", "estimator: {method: filter}\nexpect:")), 37, "Use method: auto, or output-error"),
        (scene(("bolt: {dofs: [2, 3]", LAW)), 28, "leave out its 'clock', or the laws"),
        (MODAL, 7, "channels of a modal analysis have one clock"),
    ],
)  # fmt: skip
def test_what_does_not_go_with_clocks_is_refused_at_its_place(text, place, message):
    with pytest.raises(SceneError, match=re.escape(message)) as refused:
        run(text)
    assert f"machine_clocks.yaml:{place}:" in str(refused.value)
