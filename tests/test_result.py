import numpy as np
import pytest

from dynid.errors import UsageError
from dynid.result import Result


def make(**changes):
    values = {
        "kind": "k",
        "title": "t",
        "seed": 1,
        "y": [1.0, np.nan],
        "note": float("nan"),
        "units": "m",
    } | changes
    result = Result(values["kind"], values["title"], {"seed": values["seed"], "created": str(id(values))})
    result.add_axis("g/time", [0.0, 0.1], "s")
    result.add("g/y", values["y"], ("time",), values["units"], note=values["note"])
    result.annotate("g", symbolic=values.get("symbolic", "a/b"))
    return result


def test_equal_whatever_their_provenance():
    assert make().equals(make())


@pytest.mark.parametrize(
    "change",
    [
        {"kind": "x"}, {"title": "x"}, {"seed": 2}, {"seed": True}, {"y": [1.0, 2.0]}, {"y": ["a", "b"]},
        {"note": 1.0}, {"units": "kg"}, {"symbolic": "b"},
    ],
)  # fmt: skip
def test_any_change_makes_them_unequal(change):
    assert not make().equals(make(**change))


def test_an_empty_annotation_is_none():
    result = make()
    result.annotate("elsewhere")
    assert result.equals(make())


def test_tables_compare_column_by_column_with_nan():
    def table(number):
        result = Result("k")
        result.add("t", np.array([("a", number)], dtype=[("rule", "U3"), ("value", float)]), ("step",))
        return result

    assert table(np.nan).equals(table(np.nan))
    assert not table(1.0).equals(table(2.0))
    assert table(1.0)["t"].data.dtype["rule"].kind == "O"


@pytest.mark.parametrize(
    ("data", "dtype"),
    [
        ([1, 2], np.int64), (np.array([1], np.uint8), np.int64), (np.array([1], np.float32), np.float64),
        (np.array([1], np.complex64), np.complex128), (["a", "bü"], object), (True, np.bool_),
        ([], np.float64),
    ],
)  # fmt: skip
def test_values_are_kept_in_few_types(data, dtype):
    result = Result("k")
    result.add("x", data, ("n",) if np.ndim(data) else ())
    assert result["x"].data.dtype == dtype


def test_other_types_are_refused():
    with pytest.raises(TypeError, match="numbers, Booleans and texts"):
        Result("k").add("x", np.array(["2024-01-01"], dtype="datetime64[D]"), ("n",))


def test_scalars_come_back_as_python_values():
    result = Result("k")
    result.add("text", "abc")
    result.add("number", 3)
    assert (result.value("text"), result.value("number")) == ("abc", 3)


def test_axes_must_match_the_dimensions_and_paths_are_written_once():
    result = make()
    with pytest.raises(ValueError, match="axes"):
        result.add("z", [1.0], ("a", "b"))
    with pytest.raises(ValueError, match="already"):
        result.add("g/y", [1.0], ("a",))
    with pytest.raises(ValueError, match="already"):
        result.merge(make())


def test_a_wrong_path_is_answered_with_the_nearest_as_a_key_error():
    result = make()
    for wrong, said in [
        ("y", "the result has no 'y'; did you mean 'g/y'?"),
        ("g/yy", "'g/yy'"),
        (3, "no '3'"),
    ]:
        for ask in (result.__getitem__, result.value):
            with pytest.raises(KeyError) as caught:
                ask(wrong)
            assert isinstance(caught.value, UsageError)
            assert said in str(caught.value)
    assert ("g/y" in result, "y" in result, result.get("y"), result.get("y", 3)) == (True, False, None, 3)


def test_merging_takes_arrays_and_annotations():
    result = Result("k", "t", {"seed": 1})
    result.merge(make())
    assert result.equals(make())
