"""Outcomes side by side, and as bytes: each sample comes back as it went in."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from dynid.checks import check_expectations
from dynid.result import Result, Variable
from dynid.scene.outcomes import SampleOutcome, SampleOutcomes
from dynid.study.work import meets, packed, unpacked

NUMBERS = st.sampled_from([np.float64, np.complex128, np.int64, np.bool_])
TEXTS = st.text(max_size=4).map(lambda text: np.array(text, dtype=object))


@st.composite
def variables(draw):
    """Draw an array of up to two axes, with units and attributes."""
    if draw(st.integers(0, 5)) == 0:
        data = draw(TEXTS)
    else:
        data = draw(
            arrays.arrays(draw(NUMBERS), draw(arrays.array_shapes(min_dims=0, max_dims=2, max_side=3)))
        )
    attrs = draw(st.dictionaries(st.sampled_from("ab"), st.sampled_from([1, 1.0, True, "x"]), max_size=1))
    return Variable(tuple("xy"[: data.ndim]), data, draw(st.sampled_from(["", "rad/s"])), attrs)


DONE = st.builds(
    SampleOutcome,
    st.dictionaries(st.sampled_from(["a/x", "a/y", "b"]), variables(), max_size=3),
    expectations=st.tuples(st.booleans(), st.booleans()),
)
FAILURES = st.builds(SampleOutcome, error=st.text(min_size=1, max_size=4), exit_code=st.integers(2, 4))


def assert_equal(found, outcome):
    assert (found.error, found.exit_code) == (outcome.error, outcome.exit_code)
    assert found.expectations == outcome.expectations
    assert list(found.values) == list(outcome.values)
    for path, variable in outcome.values.items():
        other = found.values[path]
        assert variable.equals(other)
        assert variable.data.dtype.kind == "O" or variable.data.tobytes() == other.data.tobytes()


@settings(max_examples=30)
@given(st.lists(DONE | FAILURES, max_size=6), st.data())
def test_outcomes_come_back_bit_by_bit(outcomes, data):
    together = unpacked(packed(SampleOutcomes.of(outcomes)).content)
    assert len(together) == len(outcomes)
    for found, outcome in zip(together, outcomes, strict=True):
        assert_equal(found, outcome)
    if outcomes:
        places = np.array(data.draw(st.lists(st.integers(0, len(outcomes) - 1), max_size=8)), dtype=np.intp)
        rows = np.arange(len(places)) + 10
        for block in together.picked(places, rows):
            for number, row in enumerate(block.rows):
                assert_equal(block.outcome(number), outcomes[places[row - 10]])


def test_what_all_samples_share_is_there_once():
    omega = Variable(("omega",), np.linspace(1, 2, 1000), "rad/s")
    one = len(packed(SampleOutcomes.of([SampleOutcome({"omega": omega})])).content)
    equal = [
        SampleOutcome({"omega": Variable(omega.dims, omega.data.copy(), omega.units)}) for _ in range(50)
    ]
    for outcomes in (equal, [SampleOutcome({"omega": omega})] * 50):
        assert len(packed(SampleOutcomes.of(outcomes)).content) < one + 50 * 5


def test_pending_samples_are_in_no_block_until_they_are_completed():
    some = SampleOutcomes.of([None, SampleOutcome(error="no", exit_code=2), None])
    assert some.pending == [0, 2]
    with pytest.raises(LookupError):
        some[0]
    values = {"a": Variable((), np.array(1.5))}
    whole = some.completed([SampleOutcome(values), SampleOutcome(error="neither", exit_code=4)])
    assert whole.exit_codes.tolist() == [0, 2, 4]
    assert [outcome.error for outcome in whole] == ["", "no", "neither"]
    assert whole[0].values["a"].data == 1.5


EXPECTED = [
    {"path": "g/x", "value": 1.0},
    {"path": "g/x", "min": 0.5, "max": 2},
    {"path": "g/v", "value": [1, 2], "atol": 0.5},
    {"path": "g/v", "at": {"mode": 1}, "max": 1},
    {"path": "g/v", "at": {"mode": 3}, "max": 1},
    {"path": "g/v", "value": [1, 2, 3]},
    {"path": "g/z", "max_abs": 2},
    {"path": "g/z", "value": "1+2j"},
    {"path": "g/z", "max": 2},
    {"path": "g/t", "value": "a"},
    {"path": "g/t", "value": 1},
    {"path": "g/b", "value": True},
    {"path": "g/gone", "value": True},
    {"path": "kind", "value": "made up"},
    {"path": "g/x"},
]


@settings(max_examples=30)
@given(
    st.lists(
        st.tuples(st.sampled_from([np.nan, 0.25, 1.0, 2.0, np.inf]), st.booleans()), min_size=1, max_size=5
    )
)
def test_samples_are_judged_together_as_each_by_itself(samples):
    outcomes = []
    for x, turned in samples:
        values = {
            "g/x": Variable((), np.array(x)),
            "g/mode": Variable(("mode",), np.array([2, 1] if turned else [1, 2])),
            "g/v": Variable(("mode",), np.array([x, 2.0])),
            "g/z": Variable((), np.array(complex(x, 2))),
            "g/t": Variable((), np.array("a" if turned else "b", dtype=object)),
            "g/b": Variable((), np.array(turned)),
        }
        outcomes.append(SampleOutcome(values))
    (block,) = SampleOutcomes.of(outcomes).blocks
    together = meets(block, EXPECTED, "made up", "")
    for outcome, met in zip(outcomes, together.tolist(), strict=True):
        alone = Result("made up")
        for path, variable in outcome.values.items():
            alone.put(path, variable)
        assert met == [one.passed for one in check_expectations(alone, EXPECTED)]
