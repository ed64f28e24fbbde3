import math
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynid.checks import CheckOutcome, check_expectations, compare, junit_xml
from dynid.checks.expectations import samples_meet
from dynid.result import Result, Variable


def table(column, text):
    return np.array([(text, 1.0)], dtype=[(column, object), ("x", float)])


@pytest.fixture
def result():
    found = Result("bond-graph", "t", {"seed": 3})
    base = "bond_graph/properties/m_s.f/v_in"
    found.add(f"{base}/relative_degree", 1)
    found.add(f"{base}/dc_gain", math.inf)
    found.add(f"{base}/stable", True)
    found.add(f"{base}/prototype", "d")
    found.add(f"{base}/zeros", [1 + 2j, -1j], ("zero",))
    found.add(f"{base}/empty", [], ("none",))
    found.add(f"{base}/lost", math.nan)
    found.annotate(base, symbolic="K/s")
    found.add_axis("identification/parameters/parameter", ["upper.k", "upper.c"])
    found.add("identification/parameters/error_percent", [0.04, -0.3], ("parameter",))
    found.add_axis("identification/history/time", [0.0, 0.1, 0.2])
    found.add(
        "identification/history/estimate", np.arange(6.0).reshape(3, 2), ("time", "entry"), "N", hold="spline"
    )
    found.add("steps", table("rule", "a"), ("step",))
    return found


BASE = "bond_graph/properties/m_s.f/v_in/"
ERRORS = "identification/parameters/error_percent"
HISTORY = "identification/history/estimate"


@pytest.mark.parametrize(
    ("path", "demand"),
    [
        (f"{BASE}relative_degree", {"value": 1}),
        (f"/{BASE}relative_degree", {"value": 1.0000000001}),
        (f"{BASE}dc_gain", {"value": math.inf}),
        (f"{BASE}dc_gain", {"min": 5}),
        (f"{BASE}stable", {"value": True}),
        (f"{BASE}prototype", {"value": "d"}),
        (f"{BASE}zeros", {"value": [[1, 2], "-1j"]}),
        (f"{BASE}zeros", {"value": ["1 + 2j", [0, -1]]}),
        (f"{BASE}zeros", {"max_abs": 2.3}),
        (f"{BASE}zeros", {"part": "real", "min": 0, "max": 1}),
        (f"{BASE}zeros", {"part": "imaginary", "value": [2, -1]}),
        (f"{BASE}zeros", {"part": "magnitude", "at": {"zero": 1}, "min": 2.2, "max": 2.3}),
        (f"{BASE}empty", {"value": []}),
        (f"{BASE}symbolic", {"value": "K/s"}),
        (f"{HISTORY}/hold", {"value": "spline"}),
        ("kind", {"value": "bond-graph"}),
        ("seed", {"value": 3}),
        (ERRORS, {"max_abs": 0.4}),
        (ERRORS, {"value": [0, 0], "atol": 0.31}),
        (ERRORS, {"max_abs": 0.05, "at": {"parameter": "upper.k"}}),
        (HISTORY, {"value": 5, "at": {"time": 0.2, "entry": 2}}),
        (HISTORY, {"value": [[0, 1], [2, 3], [4, 5]]}),
        (HISTORY, {"min": 0, "max": 5}),
    ],
)  # fmt: skip
def test_met_expectations(result, path, demand):
    [outcome] = check_expectations(result, [{"path": path, **demand}])
    assert outcome.passed, outcome.message


@pytest.mark.parametrize(
    ("path", "demand", "message"),
    [
        (f"{BASE}relative_degree", {"value": 0}, "relative_degree is 1, expected 0"),
        (f"{BASE}relative_degree", {"value": 1.1}, "relative_degree is 1, expected 1.1"),
        (f"{BASE}relative_degree", {"value": True}, "relative_degree is a real number, expected true"),
        (f"{BASE}relative_degree", {"value": math.inf}, "relative_degree is 1, expected inf"),
        (f"{BASE}relative_degree", {"value": [1]}, "relative_degree is a real number, expected [1]"),
        (f"{BASE}relative_degree", {"value": "1+2j"}, "relative_degree is a real number, expected '1+2j'"),
        (f"{BASE}relative_degree", {"value": None}, "relative_degree is a real number, expected None"),
        (f"{BASE}relative_degree", {}, "relative_degree is 1, but nothing is expected of it"),
        (f"{BASE}dc_gain", {"value": -math.inf}, "dc_gain is inf, expected -inf"),
        (f"{BASE}dc_gain", {"value": 1e300}, "dc_gain is inf, expected 1e+300"),
        (f"{BASE}stable", {"value": 1}, "stable is a Boolean, expected 1"),
        (f"{BASE}stable", {"max": 1}, "stable is true, expected a real number for 'max'"),
        (f"{BASE}prototype", {"value": "e"}, "prototype is 'd', expected 'e'"),
        (f"{BASE}prototype", {"max_abs": 1}, "prototype is 'd', expected a number for 'max_abs'"),
        (f"{BASE}zeros", {"value": [[1, 2], 0]}, "at zero 2, expected 0j (1 of 2 entries miss)"),
        (f"{BASE}zeros", {"value": [0]}, "zeros has 2 entries, expected 1"),
        (f"{BASE}zeros", {"min": 0}, "expected a real number for 'min'"),
        (f"{BASE}empty", {"value": 0}, "empty is empty, expected 0"),
        (f"{BASE}empty", {"max_abs": 1}, "empty is empty, expected 1"),
        (
            f"{BASE}zeros",
            {"part": "real", "max": 0.5},
            "zeros has the real part 1 at zero 1, expected at most 0.5 (1 of 2 entries miss)",
        ),
        (f"{BASE}zeros", {"max": 0.5}, "for 'max': add 'part', which is real, imaginary or magnitude"),
        (f"{BASE}dc_gain", {"part": "real", "max": 1}, "dc_gain is inf, which is not complex: leave out"),
        (f"{BASE}lost", {"value": math.nan}, "lost is nan, expected nan"),
        (f"{BASE}lost", {"min": 0}, "lost is nan, expected at least 0"),
        (f"{BASE}lost", {"max_abs": 1}, "lost is nan"),
        (f"{BASE}relative_degre", {"value": 1}, f"did you mean '{BASE}relative_degree'?"),
        (ERRORS, {"max_abs": 0.05}, "is -0.3 at parameter 'upper.c', expected a magnitude of at most 0.05"),
        (ERRORS, {"value": 0, "at": {"parameter": "uper.k"}}, "did you mean 'upper.k'?"),
        (ERRORS, {"value": 0, "at": {"parametr": "upper.k"}}, "did you mean 'parameter'?"),
        (ERRORS, {"value": 0, "at": {"parameter": 1.0}}, "no parameter 1; there are: 'upper.k', 'upper.c'"),
        (HISTORY, {"value": 5, "at": {"time": 0.15}}, "estimate has no time 0.15; there are: 0, 0.1, 0.2"),
        (HISTORY, {"value": 5, "at": {"entry": 3.0}}, "estimate has no entry 3; there are: 1, 2"),
        (HISTORY, {"max": 4}, "is 5 N at time 0.2, entry 2, expected at most 4 N (1 of 6 entries miss)"),
        ("steps", {"value": 1}, "steps is a table"),
    ],
)  # fmt: skip
def test_unmet_expectations_say_what_was_found(result, path, demand, message):
    [outcome] = check_expectations(result, [{"path": path, **demand}])
    assert not outcome.passed
    assert message in outcome.message


@given(st.floats(allow_nan=False), st.floats(allow_nan=False))
def test_a_value_meets_itself_and_only_its_neighbours(a, b):
    result = Result("k")
    result.add("x", a)
    same, other = check_expectations(
        result, [{"path": "x", "value": a}, {"path": "x", "value": b, "rtol": 0}]
    )
    assert same.passed
    assert other.passed == (a == b)


@pytest.mark.parametrize(
    ("value", "demand", "message"),
    [
        (0.689084729297614, {"max": 0.08}, "x is 0.6891 s, expected at most 0.08 s"),
        (0.0800000012345, {"max": 0.08}, "x is 0.0800000012 s, expected at most 0.08 s"),
        (-1234567.25, {"min": 2}, "x is -1.235e+06 s, expected at least 2 s"),
        (0.30000000000000004, {"value": 0.3, "rtol": 0}, "x is 0.30000000000000004 s, expected 0.3 s"),
        (123.456, {"value": 123, "rtol": 0.001}, "x is 123.5 s, expected 123 s"),
    ],
)
def test_a_miss_is_said_with_its_unit_and_the_digits_that_show_it(value, demand, message):
    result = Result("k")
    result.add("x", value, units="s")
    [outcome] = check_expectations(result, [{"path": "x", **demand}])
    assert outcome.message == message


@pytest.mark.parametrize(
    ("values", "demand", "message"),
    [
        # 1.2 misses by 10 times what is tolerated beside 1, 110 by 5 times what is beside 100.
        ([1.2, 110, 1], {"value": [1, 100, 1], "rtol": 0.02}, "is 1.2 at n 1, expected 1 (2 of 3 entries"),
        ([1.2, 110, 1], {"value": [1, 100, 1], "atol": 0.1}, "is 110 at n 2, expected 100 (2 of 3 entries"),
        ([1, 2, 7, 3], {"value": 1, "rtol": 0}, "is 7 at n 3, expected 1 (3 of 4 entries miss)"),
        ([6, -9, 7], {"max_abs": 5}, "is -9 at n 2, expected a magnitude of at most 5 (3 of 3 entries miss)"),
        ([2.5, 110], {"max_abs": [1, 100]}, "is 2.5 at n 1, expected a magnitude of at most 1 (2 of 2"),
        ([6, 9, 7], {"max": 5}, "is 9 at n 2, expected at most 5 (3 of 3 entries miss)"),
        ([6, -9, -math.inf, 7], {"min": 5}, "is -inf at n 3, expected at least 5 (2 of 4 entries miss)"),
        ([6, math.nan, 7], {"max": 5}, "is nan at n 2, expected at most 5 (3 of 3 entries miss)"),
        ([1j, 3, -4j], {"max_abs": 2}, "is -0-4j at n 3, expected a magnitude of at most 2 (2 of 3 entries"),
        ([True, False, False], {"value": True}, "is false at n 2, expected true (2 of 3 entries miss)"),
        (
            [-1, 8, -3, 2],
            {"min": 0, "max": 5},
            "is -3 at n 3, expected at least 0 (2 of 4 entries miss); "
            "is 8 at n 2, expected at most 5 (1 of 4 entries miss)",
        ),
        ([math.nan, 1], {"min": 0, "max": 5}, "is nan at n 1, expected at least 0 (1 of 2 entries miss)"),
    ],
)  # fmt: skip
def test_of_several_entries_the_worst_is_named(values, demand, message):
    result = Result("k")
    result.add("x", values, ("n",))
    [outcome] = check_expectations(result, [{"path": "x", **demand}])
    assert message in outcome.message
    assert outcome.message.count("expected") == message.count("expected")


def change(result, path, data, dims=()):
    other = Result(result.kind, "another title", {"seed": 4})
    other.merge(result)
    other._variables.pop(path)
    if data is not None:
        other.add(path, data, dims)
    return other


def test_a_result_does_not_differ_from_itself(result):
    assert compare(result, result) == []
    assert compare(result, change(result, "steps", result["steps"].data, ("step",))) == []


@pytest.mark.parametrize(
    ("path", "data", "dims", "message"),
    [
        (f"{BASE}dc_gain", None, (), "only in the first"),
        (f"{BASE}dc_gain", 2.0, (), "inf against 2"),
        (f"{BASE}prototype", "e", (), "'d' against 'e'"),
        (f"{BASE}stable", "true", (), "true against 'true'"),
        (f"{BASE}zeros", [1 + 2j, -1.1j], ("zero",), "at entry 2 (1 of 2 entries differ)"),
        (f"{BASE}zeros", [1 + 2j], ("zero",), "shape (2,) against (1,)"),
        (f"{BASE}zeros", [1 + 2j, -1j], ("root",), "dimensions ('zero',) against ('root',)"),
        ("steps", table("rule", "b"), ("step",), "rule: 'a' against 'b'"),
        ("steps", table("role", "a"), ("step",), "columns"),
    ],
)  # fmt: skip
def test_differences_are_told(result, path, data, dims, message):
    [difference] = compare(result, change(result, path, data, dims))
    assert difference.path == path
    assert message in difference.message


def test_differences_of_kind_units_and_attributes():
    a, b = Result("x"), Result("y")
    a.add("v", 1.0, (), "m")
    b.add("v", 1.0, (), "kg")
    a.add("w", 1.0, hold="linear")
    b.add("w", 1.0, hold="spline", extra=True)
    a.annotate("g", gain=1.0)
    b.annotate("g", gain=1.0 + 1e-12, more=1)
    assert [difference.path for difference in compare(a, b)] == ["kind", "v", "w/extra", "w/hold", "g/more"]


def test_tolerances_of_a_comparison_are_symmetric():
    a, b = Result("x"), Result("x")
    a.add("v", [1.0, 100.0], ("n",))
    b.add("v", [1.1, 100.0], ("n",))
    for first, second in ((a, b), (b, a)):
        assert compare(first, second, rtol=0.0915) == []
        assert compare(first, second, rtol=0, atol=0.11) == []
        assert len(compare(first, second, rtol=0.09)) == 1


def pair(path, one, other, dims, units=""):
    """Return two results of one array."""
    results = Result("x"), Result("x")
    for result, data in zip(results, (one, other), strict=True):
        result.add(path, np.asarray(data), dims, units)
    return results


FIELDS = [
    ("reduction/serep/mac", ("mode", "full_mode")),
    ("bond_graph/frequency_response/response", ("omega", "output", "input")),
    ("bond_graph/time_response/response", ("time", "output")),
    ("structure/modes/shape", ("dof", "mode")),
    ("modal/shape", ("mode", "channel")),
    ("reduction/guyan/stiffness", ("coordinate", "column")),
    ("reduction/guyan/T", ("dof", "coordinate")),
    ("identification/parameters/correlation", ("parameter", "other")),
]
ENTRIES = [
    ("identification/parameters/estimate", ("parameter",)),
    ("identification/parameters/standard_error", ("parameter",)),
    ("reduction/serep/frequencies", ("mode",)),
    ("bond_graph/transfer_function/y/u/poles", ("pole",)),
    ("bond_graph/transfer_function/y/u/numerator", ("numerator_power",)),
    ("bond_graph/time_response/time", ("time",)),
    ("bond_graph/sensitivities/y/u/pole_sensitivity", ("pole", "parameter")),
]


@pytest.mark.parametrize(("path", "dims"), FIELDS)
@pytest.mark.parametrize("kind", [float, complex])
def test_round_off_in_an_array_of_one_quantity_is_relative_to_its_largest_entry(path, dims, kind):
    rng = np.random.default_rng(len(path))
    shape = (4, 3, 2)[: len(dims)]
    one = rng.standard_normal(shape).astype(kind)
    one.ravel()[:2] = 50.0, 0.0
    other = one + 3e-14 * rng.standard_normal(shape)  # below 1e-9 of 50, beyond that of 0
    first, second = pair(path, one, other, dims, "m")
    assert compare(first, second) == compare(second, first) == []
    assert len(compare(first, second, elementwise=True)) == 1
    other.ravel()[1] = 1e-7  # more than 1e-9 of the largest
    assert [str(difference.path) for difference in compare(*pair(path, one, other, dims, "m"))] == [path]
    assert compare(*pair(path, one, other, dims, "m"), rtol=2.1e-9) == []
    other.ravel()[1] = math.nan
    assert len(compare(*pair(path, one, other, dims, "m"), rtol=1.0)) == 1


@pytest.mark.parametrize(("path", "dims"), ENTRIES)
def test_quantities_of_their_own_are_compared_by_their_own_size(path, dims):
    one = np.full((3, 2)[: len(dims)], 50.0)
    one.ravel()[1] = 1e-6
    other = one.copy()
    other.ravel()[1] *= 1 + 1e-8
    assert len(compare(*pair(path, one, other, dims))) == 1
    assert compare(*pair(path, one, other, dims), rtol=2e-8) == []


def test_columns_of_several_units_have_their_own_largest_entries():
    one = np.array([[1e6, 1e-6], [2e6, 0.0]])
    other = one + np.array([[0, 1e-12], [0, 1e-13]])
    path, dims = "identification/measurement/measured", ("time", "channel")
    assert compare(*pair(path, one, other, dims, "m/s")) == []
    (difference,) = compare(*pair(path, one, other, dims))
    assert "2 of 4 entries" in difference.message
    assert compare(*pair(path, one, other, dims), rtol=1.1e-6) == []


def test_samples_of_a_study_have_their_own_largest_entries():
    path, dims = "study/results/bond_graph/frequency_response/response", ("sample", "omega")
    one = np.array([[1e6, 1.0], [1e-6, 0.0]])
    assert compare(*pair(path, one, np.add(one, [[1e-5, 1e-5], [1e-17, 1e-17]]), dims, "m")) == []
    (difference,) = compare(*pair(path, one, np.add(one, [[1e-5, 1e-5], [1e-12, 1e-17]]), dims, "m"))
    assert difference.message.endswith("at entry 2, 1 (1 of 4 entries differ)")
    scalar, scalars = "study/results/bond_graph/properties/y/u/dc_gain", np.array([1e6, 1e-6])
    assert len(compare(*pair(scalar, scalars, scalars * (1 + 1e-8), ("sample",)))) == 1


def test_an_error_bound_is_compared_by_the_scale_of_what_it_bounds():
    results = Result("x"), Result("x")
    for result, bound in zip(results, (1e-15, 3e-15), strict=True):
        result.add("r/response", np.array([1.0, 0.1]), ("omega",), "m")
        result.add("r/response_error_bound", np.array([bound, bound]), ("omega",), "m")
    assert compare(*results) == []
    assert len(compare(*results, elementwise=True)) == 1


def test_junit_counts_and_survives_any_text():
    outcomes = [
        CheckOutcome(True, "a/b", "= 1", "1", "b is 1"),
        CheckOutcome(False, "a/<c>", "= 'x\0'", "2", "c is\x1b \ud800 & not"),
    ]
    suite = ElementTree.fromstring(junit_xml(outcomes, 'scene "<1>"').encode()).find("testsuite")
    assert (suite.get("tests"), suite.get("failures"), suite.get("name")) == ("2", "1", 'scene "<1>"')
    good, bad = suite.findall("testcase")
    assert good.find("failure") is None
    assert bad.find("failure").get("message") == "c is� � & not"


def hertz(found, **expectation):
    (outcome,) = check_expectations(found, [{"path": "p/natural_frequency", **expectation}])
    return outcome


def test_frequencies_are_expected_in_hertz():
    found = Result("bond-graph", "t")
    found.add("p/natural_frequency", [20.0, 2 * math.pi * 19], ("mode",), "rad/s")
    inside = {"at": {"mode": 2}, "min": 18, "max": 21}
    assert hertz(found, **inside, unit="Hz").passed
    assert not hertz(found, **inside).passed
    assert hertz(found, at={"mode": 1}, value=20, unit="rad/s").passed
    missed = hertz(found, at={"mode": 2}, max=18.5, unit="Hz")
    assert missed.message == "natural_frequency is 19 Hz, expected at most 18.5 Hz"
    assert missed.expected == "at mode 2 <= 18.5 Hz"


def test_what_is_no_frequency_is_not_expected_in_hertz(result):
    (outcome,) = check_expectations(result, [{"path": ERRORS, "max": 1, "unit": "Hz"}])
    assert outcome.message == "error_percent is in no unit, which is no frequency: leave out 'unit'"


def test_samples_are_expected_in_hertz_as_one_is():
    omega = 2 * math.pi * np.array([[19.0], [25.0]])
    samples = {"p/w": Variable(("sample", "mode"), omega, "rad/s")}

    def one(place):
        found = Result("bond-graph")
        found.add("p/w", omega[place], ("mode",), "rad/s")
        return found

    met = samples_meet(samples, 2, one, [{"path": "p/w", "max": 21, "unit": "Hz"}])
    assert met.tolist() == [[True], [False]]


def test_samples_are_expected_by_a_part_as_one_is():
    poles = np.array([[-3 + 4j, -3 - 4j], [-1 + 9j, -7]])
    samples = {"p/poles": Variable(("sample", "pole"), poles, "rad/s")}

    def one(place):
        found = Result("bond-graph")
        found.add("p/poles", poles[place], ("pole",), "rad/s")
        return found

    demands = [{"path": "p/poles", "part": part, "max": 5} for part in ("real", "imaginary", "magnitude")]
    demands.append({"path": "p/poles", "part": "real", "max": -2})
    met = samples_meet(samples, 2, one, demands)
    assert met.tolist() == [[True, True, True, True], [True, False, False, False]]


@pytest.mark.parametrize(
    ("data", "found"),
    [
        ([79.84014448226601], "79.8401 deg"),
        ([math.nan], "-"),
        ([math.nan, 1 / 3], "[-, 0.333333] deg"),
        ([math.inf], "∞ deg"),
        ([-1 / 3 + 2j], "-0.333333+2j deg"),
        ([12345678], "12345678 deg"),
        (0.1 + 0.2, "0.3 deg"),
        (np.zeros(7), "an array of 7 deg"),
    ],
)
def test_what_is_found_is_written_with_six_digits(data, found):
    result = Result("t")
    result.add("p/x", data, ("loop",) * np.ndim(data), "deg")
    (outcome,) = check_expectations(result, [{"path": "p/x", "max_abs": 0}])
    assert outcome.found == found
