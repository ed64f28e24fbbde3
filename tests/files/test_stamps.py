"""Time stamps: rounding, dropped and duplicated samples, jitter, resampling; faults at their rows."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.errors import FileError
from dynid.files import read_measured
from dynid.files.stamps import Clock, clock_of, printed_resolution
from dynid.files.table import TableLayout


def clock(times, step, form="%.17g"):
    printed = [form % t for t in times]
    return clock_of(np.array(printed, dtype=float), step, printed_resolution(printed))


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from([0.001, 1 / 1024, 1 / 3000, 0.02]),
    st.integers(20, 400),
    st.sampled_from(["%.6f", "%.7g", "%.17g", "%.5f"]),
    st.floats(0, 100),
    st.data(),
)
def test_dropped_samples_are_found_at_their_places(step, count, form, start, data):
    gone = data.draw(st.sets(st.integers(1, count - 2), max_size=count // 8))
    places = np.array([k for k in range(count) if k not in gone])
    found = clock(start + step * places, step, form)
    assert isinstance(found, Clock)
    assert found.dropped == len(gone)
    assert found.duplicated == 0
    if gone:
        np.testing.assert_array_equal(found.rows, places)
    assert abs(found.drift) < 1e-6 + 2e-5 / (count * step)


def test_duplicated_samples_are_counted():
    places = np.array([0, 1, 2, 2, 3, 4, 6, 7, 8, 9])
    found = clock(0.01 * places, 0.01, "%.3f")
    assert (found.dropped, found.duplicated) == (1, 1)
    assert found.warnings() == [
        "by its times the record has dropped 1 sample: they count as missing",
        "by its times the record has 1 sample twice: one of each is used",
    ]


def test_jitter_is_measured_and_beyond_a_tenth_of_a_step_refused():
    generator = np.random.default_rng(5)
    shake = generator.standard_normal(2000)
    found = clock(0.01 * np.arange(2000) + 1e-4 * shake, 0.01)
    assert found.jitter == pytest.approx(1e-4 * np.std(shake), rel=0.01)
    assert "0.98 % of a step" in found.warnings()[0]
    assert not isinstance(clock(0.01 * np.arange(2000) + 1e-3 * shake, 0.01), Clock)


def test_drift_is_measured():
    assert clock(0.01 * (1 + 5e-7) * np.arange(1000), 0.01).drift == pytest.approx(5e-7, rel=1e-6)
    assert "0.01001 s apart, but 'step' is 0.01 s" in clock(0.01001 * np.arange(1000), 0.01).problem


@pytest.fixture
def written(tmp_path):
    def write(times, values, form="%.6f"):
        rows = [f"{form % t},{v!r}" for t, v in zip(times, np.asarray(values).tolist(), strict=True)]
        (tmp_path / "x.csv").write_text("\n".join(["Time (s),v", *rows]))
        return tmp_path / "x.csv"

    return write


def test_dropped_samples_of_a_channel_are_missing_and_those_of_a_signal_are_refused(written):
    places = np.array([0, 1, 2, 5, 6, 7, 8, 9])
    path = written(0.01 * places, places.astype(float))
    expected = [[k if k in places else np.nan] for k in range(10)]
    found = read_measured.read_columns(path, None, step=0.01)
    np.testing.assert_array_equal(found.values, expected)
    assert found.clock.dropped == 2
    with pytest.raises(FileError, match=r"x\.csv:5: a sample of the signal is missing.*resample: true"):
        read_measured.read_signal(path, None, step=0.01)


def test_duplicates_that_differ_are_refused_at_their_row(written):
    times = 0.01 * np.array([0, 1, 2, 2, 3])
    assert len(read_measured.read_columns(written(times, [0.0, 1, 2, 2, 3]), None, step=0.01).values) == 4
    with pytest.raises(FileError, match=r"x\.csv:5: the time of the row before, with other values"):
        read_measured.read_columns(written(times, [0.0, 1, 2, 9, 3]), None, step=0.01)


def test_resampling_interpolates_at_even_times(written):
    generator = np.random.default_rng(2)
    times = 0.01 * np.delete(np.arange(400), [50, 51, 200]) + 2e-3 * generator.uniform(-1, 1, 397)
    times[0] = 0.0
    path, layout = written(times, np.sin(9 * times), "%.9f"), TableLayout(resample=True)
    values, _, first = read_measured.read_signal(path, None, step=0.01, layout=layout)
    np.testing.assert_allclose(values, np.sin(9 * 0.01 * np.arange(len(values))), atol=1e-4)
    assert first == 0
    assert 399 <= len(values) <= 400
    found = read_measured.read_columns(path, None, step=0.01, layout=layout).values
    np.testing.assert_array_equal(found[:, 0], values)


@pytest.mark.parametrize(
    ("times", "values", "said"),
    [
        ([0, 1, 9, 10, 11], [0.0] * 5, "x.csv:4: the time goes on by 0.08 s: more than 4 steps"),
        ([0, 1, 7, 8, 20], [0.0] * 5, "x.csv:4: the time goes on by 0.06 s: more than 4 steps"),
        ([0, 1, 1, 2, 3], [0.0] * 5, "x.csv:4: the time does not go on"),
        ([0, 2, 4, 6, 8], [0.0] * 5, "the times are 0.02 s apart, but 'step' is 0.01 s"),
        ([0, 1, 2, 3, 4], [0.0, 1, np.nan, 3, 4], "x.csv:4: a sample is missing"),
    ],
)
def test_what_cannot_be_resampled_is_refused(written, times, values, said):
    path = written(0.01 * np.array(times), values)
    with pytest.raises(FileError) as caught:
        read_measured.read_columns(path, None, step=0.01, layout=TableLayout(resample=True))
    assert said in str(caught.value)


def test_without_times_nothing_is_resampled(tmp_path):
    (tmp_path / "x.csv").write_text("v\n1\n2\n")
    with pytest.raises(FileError, match="has no times to resample by") as caught:
        read_measured.read_columns(
            tmp_path / "x.csv", None, step=1, scene_key="f", layout=TableLayout(resample=True)
        )
    assert caught.value.names == ("f.resample",)
