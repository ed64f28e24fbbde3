"""Influence of inputs against closed forms: Ishigami's function, and linear models."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import qmc, sobol_indices, spearmanr

from dynid.report.content.study import variance_sources
from dynid.study.analysis.design import is_logarithmic, one_at_a_time, saltelli_design, tornado
from dynid.study.analysis.influence import (
    Influences,
    classes,
    correlations,
    from_design,
    from_samples,
    scatter,
)
from dynid.study.analysis.sample_statistics import worst, worst_entries
from dynid.study.analysis.table import StudyColumn, StudyTable
from tests.report.pages import study

A, B = 7.0, 0.1


def ishigami(x1, x2, x3):
    """Ishigami & Homma 1990."""
    return np.sin(x1) + A * np.sin(x2) ** 2 + B * x3**4 * np.sin(x1)


def ishigami_indices():
    """Return the closed form of first and total order."""
    v1 = 0.5 * (1 + B * np.pi**4 / 5) ** 2
    v2 = A**2 / 8
    v13 = B**2 * np.pi**8 * (1 / 18 - 1 / 50)
    total = v1 + v2 + v13
    return np.array([v1, v2, 0]) / total, np.array([v1 + v13, v2, v13]) / total


def saltelli(factors, rows, seed=0):
    """Return samples in (0, 1) in rows of A, A with one column of B each, B."""
    points = qmc.Sobol(2 * factors, rng=seed).random(rows)
    a, b = points[:, :factors], points[:, factors:]
    block = np.repeat(a[:, None], factors + 2, axis=1)
    for factor in range(factors):
        block[:, factor + 1, factor] = b[:, factor]
    block[:, -1] = b
    return block.reshape(-1, factors)


def as_blocks(samples):
    """Return samples in rows of d + 2 as blocks: A, B, mixed."""
    factors = samples.shape[1]
    rows = samples.reshape(-1, factors + 2, factors)
    return np.concatenate([rows[:, place] for place in (0, factors + 1, *range(1, factors + 1))])


def columns(samples):
    return {f"x{number + 1}": column for number, column in enumerate(samples.T)}


@pytest.mark.parametrize("arranged", [lambda samples: samples, as_blocks], ids=["rows", "blocks"])
def test_ishigami_from_the_design(arranged):
    inputs = columns(np.pi * (2 * arranged(saltelli(3, 2**12)) - 1))
    design = saltelli_design(inputs)
    assert design.factors == (("x1",), ("x2",), ("x3",))
    found = from_design(*design.split(ishigami(*inputs.values())))
    first, total = ishigami_indices()
    # 4096 rows of a Sobol sequence: far better than the standard errors, which are those of random rows
    assert found.first == pytest.approx(first, abs=0.01)
    assert found.total == pytest.approx(total, abs=0.01)
    assert found.samples == 5 * 2**12


def test_the_estimators_are_those_of_scipy():
    samples = columns(np.pi * (2 * saltelli(3, 2**8) - 1))
    a, b, mixed = saltelli_design(samples).split(ishigami(*samples.values()))
    found = from_design(a, b, mixed)
    other = sobol_indices(func={"f_A": a[None], "f_B": b[None], "f_AB": mixed[:, None]}, n=2**8)
    # scipy centres and scales by A and B together as well, with n - 1 nowhere
    assert found.first == pytest.approx(other.first_order.ravel(), abs=1e-12)
    assert found.total == pytest.approx(other.total_order.ravel(), abs=1e-12)


def test_intervals_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(5)
    first, total = ishigami_indices()
    held = np.zeros(2)
    trials = 300
    for _ in range(trials):
        a, b = rng.uniform(-np.pi, np.pi, (2, 3, 400))
        mixed = np.array([ishigami(*np.where(np.arange(3)[:, None] == i, b, a)) for i in range(3)])
        found = from_design(ishigami(*a), ishigami(*b), mixed)
        held += [
            np.mean(np.abs(found.first - first) <= 1.96 * found.first_error),
            np.mean(np.abs(found.total - total) <= 1.96 * found.total_error),
        ]
    # the linearisation is of first order in 1/sqrt(n): 95 % within a few per cent of coverage
    assert held / trials == pytest.approx([0.95, 0.95], abs=0.03)


def test_rows_with_failed_samples_are_left_out():
    inputs = columns(np.pi * (2 * saltelli(3, 2**12) - 1))
    values = ishigami(*inputs.values())
    values[np.random.default_rng(3).random(values.size) < 0.02] = np.nan
    found = from_design(*saltelli_design(inputs).split(values))
    assert found.first == pytest.approx(ishigami_indices()[0], abs=0.05)


def test_a_design_is_recognised_with_pairs_and_what_follows_from_others():
    samples = saltelli(2, 8)
    inputs = columns(samples) | {"pair": 3 * samples[:, 0], "sum": samples.sum(axis=1)}
    assert saltelli_design({key: inputs[key] for key in ("x1", "pair", "x2")}).factors == (
        ("x1", "pair"),
        ("x2",),
    )
    assert saltelli_design({**inputs, "sum": samples[:, 0] * 0 + 2}).factors == (("x1", "pair"), ("x2",))
    assert saltelli_design(columns(np.random.default_rng(0).random((32, 2)))) is None


@pytest.mark.parametrize("lengths", [(2, 2, 2), (3, 2, 2), (4, 2, 2), (5, 2, 2, 2), (3, 4), (2, 5)])
def test_a_grid_is_no_design_for_indices(lengths):
    inputs = columns(np.stack(np.unravel_index(np.arange(np.prod(lengths)), lengths), axis=-1).astype(float))
    assert saltelli_design(inputs) is None


def test_ishigami_from_any_samples():
    points = 2 * np.pi * qmc.LatinHypercube(3, rng=2).random(20_000).T - np.pi
    found = from_samples([classes(x) for x in points], ishigami(*points))
    # classes of 1/50 of the range and 20,000 random samples
    assert found.first == pytest.approx(ishigami_indices()[0], abs=0.015)
    assert np.all(np.abs(found.first - ishigami_indices()[0]) < 4 * found.first_error)
    assert found.total is None


def test_a_full_grid_gives_the_exact_parts():
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(5.0), np.arange(8.0)))
    values = 3 * x + np.array([0.0, 1, 1, 5, 2, 2, 0, 9])[y.astype(int)]
    found = from_samples([classes(x), classes(y.astype(int).astype(str).astype(object))], values)
    share = 9 * x.var() / values.var()
    # the correction for the number of classes
    assert found.first[0] == pytest.approx(1 - (1 - share) * 39 / 35, abs=1e-12)
    assert found.first.sum() == pytest.approx(1 - (1 - share) * 39 / 35 + 1 - share * 39 / 32, abs=1e-12)


def test_inputs_without_influence_have_none_on_average():
    rng = np.random.default_rng(8)
    shares = [from_samples([classes(rng.random(300))], rng.random(300)).first[0] for _ in range(300)]
    assert np.mean(shares) == pytest.approx(0, abs=4 * np.std(shares) / np.sqrt(300))


def test_what_does_not_vary_has_no_indices():
    assert from_samples([classes(np.arange(100.0))], np.full(100, 0.1)) is None
    assert from_design(np.ones(8), np.ones(8), np.ones((2, 8))) is None
    assert from_samples([classes(np.arange(100.0))], np.full(100, np.nan)) is None


def test_the_tornado_of_a_linear_model_is_the_model():
    rng = np.random.default_rng(4)
    x = {
        "a": rng.random(500),
        "b": 1e6 * rng.random(500),
        "c": rng.random(500),
        "word": np.array(["p"] * 500, object),
    }
    values = 1 + 3 * x["a"] - 2e-6 * x["b"]
    values[::7] = np.nan
    found = tornado(x, values)
    assert [bar.input for bar in found.bars] == ["a", "b", "c"]
    assert {bar.input: bar.slope for bar in found.bars} == pytest.approx(
        {"a": 3, "b": -2e-6, "c": 0}, abs=1e-12
    )
    known = np.sort(x["a"][np.isfinite(values)])
    fifth = round(len(known) / 5)
    swing = 3 * (known[-fifth:].mean() - known[:fifth].mean())
    assert found.bars[0].swing == pytest.approx(swing, rel=1e-12)
    assert [bar.exceeds_chance for bar in found.bars] == [True, True, False]
    assert found.r2 == pytest.approx(1, abs=1e-12)
    assert found.method == "conditional means"


def test_a_tornado_stays_within_the_samples_and_knows_logarithms():
    a, b = (values.ravel() for values in np.meshgrid(np.geomspace(1, 1e4, 9), np.geomspace(1, 1e4, 9)))
    found = tornado({"a": a, "b": b}, 1e4 / (a + b))
    ends = [end for bar in found.bars for end in (bar.at_low, bar.at_high)]
    assert min(ends) >= (1e4 / (a + b)).min()
    assert max(ends) <= (1e4 / (a + b)).max()
    bar = next(bar for bar in found.bars if bar.input == "a")
    lowest = a <= np.sort(a)[15]  # the lowest of 81 samples, and those equal to them
    assert bar.at_low == pytest.approx((1e4 / (a + b))[lowest].mean(), rel=1e-12)
    assert tornado({"a": a, "b": b}, 3 * np.log(a) - np.log(b)).r2 == pytest.approx(1, abs=1e-12)
    straight = tornado({"a": np.log(a), "b": np.log(b)}, 3 * np.log(a) - np.log(b))
    assert {bar.input: bar.slope for bar in straight.bars} == pytest.approx({"a": 3, "b": -1})


def test_inputs_spaced_by_their_logarithm_are_known_on_grids_and_at_random():
    rng = np.random.default_rng(3)
    assert is_logarithmic(np.repeat(np.geomspace(1, 3, 4), 5))
    assert is_logarithmic(10 ** rng.uniform(-2, 2, 200))
    assert not is_logarithmic(np.linspace(1, 1000, 7))
    assert not is_logarithmic(rng.uniform(1, 1000, 200))
    assert not is_logarithmic(np.array([-1.0, 1.0, 10.0, 100.0]))


def test_results_that_no_input_moves_say_so():
    rng = np.random.default_rng(8)
    found = tornado({"x": rng.random(400), "y": rng.random(400)}, rng.normal(size=400))
    assert found.remark == "no input moves the mean by more than two standard errors"


def test_a_bent_response_is_not_trusted():
    x = np.linspace(-1, 1, 101)
    found = tornado({"x": x, "y": np.random.default_rng(1).random(101)}, x**2)
    assert found.r2 < 0.2
    assert "no input moves the mean" in found.remark


def test_inputs_that_move_together_are_not_told_apart():
    x = np.linspace(0, 1, 50)
    found = tornado({"x": x, "twice": 2 * x}, x)
    assert found.bars == ()
    assert "the inputs are collinear" in found.remark


def test_samples_taken_one_at_a_time_are_taken_as_they_are():
    centre = np.array([1.0, 2.0, 3.0])
    rows = [centre]
    for place in range(3):
        for step in (-0.5, 0.5):
            rows.append(centre + step * (np.arange(3) == place))
    inputs = columns(np.array(rows))
    found = tornado(inputs, inputs["x1"] ** 2 + 10 * inputs["x2"])
    assert found.method == "one at a time"
    assert [(bar.input, bar.low, bar.high) for bar in found.bars][:2] == [("x2", 1.5, 2.5), ("x1", 0.5, 1.5)]
    assert [bar.slope for bar in found.bars] == pytest.approx([10, 2, 0])
    assert one_at_a_time(columns(np.random.default_rng(0).random((9, 2)))) is None


def test_samples_one_at_a_time_that_fail_or_stay_have_no_bar():
    inputs = {**columns(np.array([[1.0, 2.0], [0.0, 2.0], [2.0, 2.0], [1.0, 3.0]])), "x3": np.full(4, 7.0)}
    found = tornado(inputs, np.array([5.0, 3.0, 7.0, np.nan]))
    assert [(bar.input, bar.at_low, bar.at_high, bar.slope) for bar in found.bars] == [("x1", 3, 7, 2)]
    assert tornado(inputs, np.full(4, np.nan)) is None


def test_there_is_no_tornado_of_nothing_and_no_trust_in_what_stays():
    assert tornado({}, np.zeros(0)) is None
    assert tornado({"word": np.array(["p", "q", "r"], object)}, np.arange(3.0)) is None
    rng = np.random.default_rng(5)
    found = tornado({"x": rng.random(20), "y": rng.random(20)}, np.full(20, 3.0))
    assert [bar.swing for bar in found.bars] == [0, 0]
    assert np.isnan(found.r2)
    assert found.remark == "the result does not vary"


def test_inputs_that_stay_have_no_influence_and_texts_no_direction():
    nothing = Influences(SimpleNamespace(varied={"x": np.ones(9), "y": np.ones(0)}))
    assert nothing.inputs == {}
    assert nothing.of(np.arange(9.0)) is None
    words = np.array(["p", "q", "r"] * 20, object)
    found = Influences(SimpleNamespace(varied={"word": words, "x": np.arange(60.0) // 3}))
    values = np.tile([1.0, 5.0, 9.0], 20)
    assert found.of(values).first == pytest.approx([1, 1 - 59 / 40])  # any x has all words: corrected for 20
    assert np.isnan(found.direction(0, values))
    assert found.direction(1, found.inputs["x"]) == pytest.approx(1)


def test_a_design_of_one_whole_row_has_no_indices():
    a, b, mixed = np.array([1.0, np.nan]), np.array([2.0, 3.0]), np.array([[4.0, 5.0]])
    assert from_design(a, b, mixed) is None


def test_classes_of_one_sample_each_tell_nothing():
    each = np.arange(60)
    found = from_samples([each, 0 * each, each // 30], each.astype(float))
    assert np.isnan(found.first[0])
    assert found.first[1] == 0
    assert found.first[2] > 0.5


def test_correlations_know_lines_and_ranks():
    x = np.linspace(0.1, 4, 200)
    y = np.where(np.arange(200) % 9 == 0, np.nan, np.exp(x))
    assert correlations([x, np.ones(200)], [y])[:, 0] == pytest.approx([0.87, np.nan], abs=0.05, nan_ok=True)
    assert correlations([x], [y], ranks=True)[0, 0] == pytest.approx(1, abs=1e-12)
    assert correlations([x], [-y], ranks=True)[0, 0] == pytest.approx(-1, abs=1e-12)
    ties = np.array([1.0, 1, 2, 2, 3, 3])
    other = np.array([3.0, 1, 2, 5, 5, 7])
    assert correlations([ties], [other], ranks=True)[0, 0] == pytest.approx(
        spearmanr(ties, other)[0], abs=1e-12
    )


def test_a_scatter_is_thinned_in_order():
    x, _ = scatter(np.arange(1000.0), np.where(np.arange(1000) % 2, np.nan, 1.0), max_points=100)
    assert len(x) == 100
    assert (x[0], x[-1]) == (0, 998)
    assert np.all(np.diff(x) > 0)


@pytest.mark.parametrize(("direction", "place"), [("max", 3), ("min", 2), ("abs", 2)])
def test_the_worst_sample(direction, place):
    assert worst(np.array([np.nan, 1.0, -9.0, 5.0, 5.0]), direction) == place


def test_what_is_missing_is_never_the_worst():
    assert worst(np.array([np.nan, -np.inf])) == 1
    rows = np.array([[np.nan, -np.inf], [np.nan, np.nan], [3.0, -4.0]])
    np.testing.assert_array_equal(worst_entries(rows), [-np.inf, np.nan, 3])
    np.testing.assert_array_equal(worst_entries(rows, "abs"), [-np.inf, np.nan, -4])
    np.testing.assert_array_equal(worst_entries(np.zeros((2, 0))), [np.nan, np.nan])


def test_no_sample_is_worst_where_all_failed():
    assert worst(np.array([np.nan, np.nan])) is None


def test_numbers_without_an_input_that_matters_are_counted_in_one_line():
    table = StudyTable(study(count=60, failed=()))
    noise = np.random.default_rng(7).normal(size=(2, 60))
    shown = [("mode/omega", StudyColumn(name, "", values)) for name, values in zip("ab", noise, strict=True)]
    rows, _ = variance_sources(table, shown, 9)
    assert rows == [("each of 2 numbers", "no input alone")]
    driven = [*shown, ("mode/omega", StudyColumn("c", "", table.inputs["parameters.k"]))]
    rows, _ = variance_sources(table, driven, 9)
    assert [name for name, _ in rows] == ["a", "b", "c"]
    assert rows[0][1] == "no input alone"
    assert rows[2][1].startswith("k ↑")
