"""Plans: which samples a study has."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.stats import qmc

from dynid.errors import SceneError, UsageError
from dynid.scene.load import load_scene
from dynid.study.plan import as_column, correlated, make_plan, unit_samples
from tests.study.small import SCENE, written

HEAD = "dynid: 1\nkind: study\nscene: mass.yaml\n"


def plan_of(folder, text, scene=SCENE):
    return make_plan(load_scene(written(folder, HEAD + text, scene)))


def column(folder, factor, method="latin-hypercube", samples=4096):
    plan = plan_of(
        folder,
        f"vary: {{parameters.m: {factor}}}\nsampling: {{method: {method}, samples: {samples}, seed: 3}}\n",
    )
    return plan.arrays["parameters.m"]


@pytest.mark.thorough
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(lengths=st.lists(st.integers(1, 4), min_size=1, max_size=4), zipped=st.booleans())
def test_a_grid_is_the_product_of_its_groups_the_last_fastest(tmp_path, lengths, zipped):
    paths = ["parameters.m", "parameters.b", "title", "analysis.frequency"][: len(lengths)]
    values = [[f"{10 * place + k + 1}" for k in range(length)] for place, length in enumerate(lengths)]
    if len(lengths) > 2:
        values[2] = [f"t{text}" for text in values[2]]
    if len(lengths) > 3:
        values[3] = [f"{{start: {k}, stop: 9, points: 2}}" for k in range(1, lengths[3] + 1)]
    zipped = zipped and len(lengths) > 1 and lengths[0] == lengths[1]
    text = "vary:\n" + "".join(
        f"  {path}: {{values: [{', '.join(some)}]}}\n" for path, some in zip(paths, values, strict=True)
    )
    plan = plan_of(tmp_path, text + ("zip: [[parameters.m, parameters.b]]\n" if zipped else ""))
    groups = [list(zip(*values[:2], strict=True)), *([v] for v in ())] if zipped else []
    axes = [*groups, *([(v,) for v in some] for some in values[2 if zipped else 0 :])]
    expected = [sum(combination, ()) for combination in itertools.product(*axes)]
    assert plan.size == len(expected) == math.prod(lengths[1 if zipped else 0 :])
    for number, wanted in enumerate(expected):
        found = plan.override(number)
        assert list(found) == paths
        assert [str(one) for one in found.values()][:3] == list(wanted)[:3]


def test_a_list_goes_through_all_values_together(tmp_path):
    plan = plan_of(
        tmp_path,
        "vary:\n  parameters.m: [1, 2.5, 4]\n  parameters.b: {start: 1, stop: 3, points: 3}\n"
        "sampling: {method: list}\n",
    )
    assert [plan.override(n) for n in range(plan.size)] == [
        {"parameters.m": m, "parameters.b": b} for m, b in [(1, 1), (2.5, 2), (4, 3)]
    ]


def test_tuples_set_several_paths_at_once(tmp_path):
    plan = plan_of(tmp_path, "vary:\n  parameters.m, parameters.b: {values: [[1, 10], [2, 20]]}\n")
    assert [plan.override(n) for n in range(2)] == [
        {"parameters.m": 1, "parameters.b": 10}, {"parameters.m": 2, "parameters.b": 20}
    ]  # fmt: skip


def test_whole_numbers_stay_whole_and_ends_are_exact(tmp_path):
    plan = plan_of(tmp_path, "vary:\n  parameters.m: {start: 1, stop: 9, points: 3}\n")
    assert [type(plan.override(n)["parameters.m"]) for n in range(3)] == [int] * 3
    plan = plan_of(tmp_path, "vary:\n  parameters.m: {start: 0.1, stop: 0.7, points: 4, scale: log}\n")
    values = plan.arrays["parameters.m"]
    assert (values[0], values[-1]) == (0.1, 0.7)
    np.testing.assert_allclose(values[1:] / values[:-1], 7 ** (1 / 3), rtol=1e-14)


@pytest.mark.parametrize(
    ("factor", "law"),
    [
        ("{distribution: uniform, low: 2, high: 5}", stats.uniform(2, 3)),
        ("{start: 2, stop: 5}", stats.uniform(2, 3)),
        ("{distribution: loguniform, low: 1, high: 100}", stats.loguniform(1, 100)),
        ("{start: 1, stop: 100, scale: log}", stats.loguniform(1, 100)),
        ("{distribution: normal, mean: 50, std: 4}", stats.norm(50, 4)),
        ("{distribution: normal, mean: 5, std: 4, low: 1, high: 7}", stats.truncnorm(-1, 0.5, 5, 4)),
        ("{distribution: normal, mean: 1, std: 1, low: 8, high: 20}", stats.truncnorm(7, 19, 1, 1)),
        ("{distribution: triangular, low: 1, mode: 2, high: 5}", stats.triang(0.25, 1, 4)),
        (
            "{distribution: lognormal, mean: 10, std: 3}",
            stats.lognorm(math.sqrt(math.log(1.09)), scale=10 / math.sqrt(1.09)),
        ),
    ],
)
@pytest.mark.parametrize("method", ["latin-hypercube", "sobol"])
def test_every_stratum_of_a_distribution_has_one_value(tmp_path, factor, law, method):
    values = np.sort(law.cdf(column(tmp_path, factor, method)))
    strata = np.arange(4097) / 4096
    assert (values >= strata[:-1] - 1e-9).all()
    assert (values <= strata[1:] + 1e-9).all()


def test_a_lognormal_has_the_mean_and_deviation_that_are_given(tmp_path):
    values = column(tmp_path, "{distribution: lognormal, mean: 10, std: 3}", samples=2**16)
    assert values.mean() == pytest.approx(10, rel=1e-4)
    assert values.std() == pytest.approx(3, rel=2e-3)  # what the last stratum holds is left to chance


def test_whole_numbers_are_drawn_each_as_often(tmp_path):
    values = column(tmp_path, "{distribution: integer, low: 3, high: 10}", samples=80)
    assert np.unique(values, return_counts=True)[1].tolist() == [10] * 8
    assert (values.min(), values.max()) == (3, 10)
    choice = column(tmp_path, "{values: [1, 2, 4]}", samples=30)
    assert np.unique(choice, return_counts=True)[1].tolist() == [10] * 3


def test_random_samples_follow_their_distribution(tmp_path):
    values = column(tmp_path, "{distribution: normal, mean: 50, std: 4}", "random")
    assert stats.kstest(values, stats.norm(50, 4).cdf).pvalue > 0.001


@pytest.mark.parametrize(("samples", "factors"), [(1, 1), (7, 3), (200, 5)])
def test_a_latin_hypercube_is_that_of_scipy(samples, factors):
    points = qmc.LatinHypercube(factors, rng=np.random.default_rng(4)).random(samples)
    np.testing.assert_array_equal(unit_samples("latin-hypercube", samples, factors, 4), points)


@pytest.mark.parametrize("method", ["random", "latin-hypercube", "sobol"])
def test_a_seed_gives_the_same_samples_and_another_one_others(method):
    one, same, other = (unit_samples(method, 64, 3, seed) for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.isclose(one, other).any(axis=1).all()
    assert ((one > 0) & (one < 1)).all()


@pytest.mark.parametrize("strata", [True, False])
@pytest.mark.parametrize("rho", [-0.9, 0.3, 0.8])
def test_correlations_are_those_asked_for(strata, rho):
    unit = unit_samples("latin-hypercube" if strata else "sobol", 4096, 3, 1)
    made = correlated(unit, [(0, 2, rho)], strata)
    scores = stats.norm.ppf(made)
    # Reordering leaves the values as they are, so that correlations are met as well as ranks allow.
    expected = np.array([[1, 0, rho], [0, 1, 0], [rho, 0, 1]])
    np.testing.assert_allclose(np.corrcoef(scores, rowvar=False), expected, atol=0.02)
    if strata:
        assert np.array_equal(np.sort(made, axis=0), np.sort(unit, axis=0))


def test_impossible_correlations_are_refused():
    with pytest.raises(UsageError, match="not positive definite"):
        correlated(unit_samples("random", 8, 3, 0), [(0, 1, 0.9), (1, 2, 0.9), (0, 2, -0.9)], False)


def test_the_design_for_indices_exchanges_one_column_at_a_time():
    design = unit_samples("sobol", 8, 3, 5, indices=True)
    A, B, *mixed = design.reshape(5, 8, 3)
    assert not np.isclose(A, B).any()
    for factor, block in enumerate(mixed):
        others = [k for k in range(3) if k != factor]
        assert np.array_equal(block[:, factor], B[:, factor])
        assert np.array_equal(block[:, others], A[:, others])


def test_derived_quantities_follow_from_others_and_from_the_scene(tmp_path):
    scene = SCENE.replace("b: 1}", "b: 1, c: m * 3}")
    plan = plan_of(
        tmp_path,
        "vary:\n  parameters.m: [1, 2, 4]\n"
        "derive: {parameters.b: sqrt(m) * ratio, ratio: c / m, twice: 2 * b}\n",
        scene,
    )
    assert plan.settings == ("parameters.m", "parameters.b")
    np.testing.assert_allclose(plan.arrays["parameters.b"], 3 * np.sqrt([1, 2, 4]), rtol=1e-15)
    np.testing.assert_allclose(plan.arrays["twice"], 6 * np.sqrt([1, 2, 4]), rtol=1e-15)


def test_a_derived_quantity_follows_the_start_of_an_unknown_parameter(tmp_path):
    scene = SCENE.replace("b: 1}", "b: 1, c: {start: m * 3}}")
    derive = "derive: {ratio: 2 * c}\n"
    fixed = plan_of(tmp_path, f"vary:\n  parameters.m: [1, 2, 4]\n{derive}", scene)
    np.testing.assert_allclose(fixed.arrays["ratio"], [6, 12, 24], rtol=1e-15)
    varied = plan_of(tmp_path, f"vary:\n  parameters.c.start: [1, 2, 4]\n{derive}", scene)
    np.testing.assert_allclose(varied.arrays["ratio"], [2, 4, 8], rtol=1e-15)


ONE = "vary: {parameters.m: [1, 2]}\n"
TWO = "vary: {parameters.m: [1, 2], parameters.b: [1, 2]}\n"
RANGES = "vary: {parameters.m: {start: 1, stop: 2}, parameters.b: {start: 1, stop: 2}}\n"
RELATED = "correlation: [{between: [parameters.m, parameters.b], value: 0.5}]"


def test_a_distribution_on_a_grid_is_divided_into_equally_likely_values(tmp_path):
    text = "vary: {parameters.m: {distribution: normal, mean: 3, std: 0.5, points: 4}}\n"
    expected = stats.norm(3, 0.5).ppf([0.125, 0.375, 0.625, 0.875])
    np.testing.assert_allclose(plan_of(tmp_path, text).arrays["parameters.m"], expected, rtol=1e-12)


def test_ends_and_steps_that_are_no_whole_numbers(tmp_path):
    plan = plan_of(tmp_path, "vary: {parameters.m: {start: 0.5, stop: 2.5, points: 3}}\n")
    assert plan.arrays["parameters.m"].tolist() == [0.5, 1.5, 2.5]
    plan = plan_of(tmp_path, "vary: {parameters.m: {start: 1, stop: 2, points: 3}}\n")
    assert plan.arrays["parameters.m"].tolist() == [1.0, 1.5, 2.0]


def test_a_lognormal_that_is_cut_off_keeps_its_shape_in_between(tmp_path):
    values = column(tmp_path, "{distribution: lognormal, mean: 1, std: 1, low: 0.5, high: 2}")
    assert 0.5 <= values.min() < 0.501 < 1.999 < values.max() <= 2
    sigma = math.sqrt(math.log(2))
    whole = stats.lognorm(sigma, scale=math.exp(-(sigma**2) / 2))
    inside = whole.cdf(2) - whole.cdf(0.5)
    assert stats.kstest(values, lambda x: (whole.cdf(x) - whole.cdf(0.5)) / inside).statistic < 1e-3


def test_a_plan_for_indices_says_how_it_is_laid_out(tmp_path):
    plan = plan_of(tmp_path, f"{RANGES}sampling: {{method: sobol, samples: 8, indices: true}}\n")
    assert plan.size == 8 * (2 + 2)
    assert (plan.attrs["design"], plan.attrs["base_samples"]) == ("saltelli", 8)
    assert plan.attrs["factors"] == "parameters.m\nparameters.b"


FAULTS = [
    ("vary: {parameters.mm: [1]}", ":4:8: mass.yaml has no parameter 'mm'; did you mean 'm'?"),
    ("vary: {parameters.mm.start: [1]}", ":4:8: mass.yaml has no parameter 'mm'; did you mean 'm'?"),
    ("vary: {parameters.m: [x, y]}", ":4:8: no parameter 'x'"),
    ("vary: {analysis.outputz: [1]}", ":4:8: 'outputz' is not a key of analysis; did you mean 'outputs'?"),
    ("vary: {m: [1]}", ":4:8: 'm' is not a key of a scene; did you mean 'parameters.m'?"),
    ("vary: {graph.m: [1]}", ":4:8: 'm' is not a key of graph; did you mean 'graph.nodes.m.value'?"),
    ("vary: {scale: [1]}", ":4:8: 'scale' is not a key of a scene; write the whole path of a value, such as"),
    ("vary: {parameters.m: 5}", ":4:22: what varies has 'values', 'start' and 'stop', or a 'distribution'"),
    ("vary: {parameters.m: {start: 0, stop: 1, scale: log}}", ":4:22: a logarithmic scale has two ends"),
    ("vary: {parameters.m: {start: 1, stop: 2}}", ":4:22: 'parameters.m' needs 'points'"),
    ("vary: {parameters.m: {distribution: norma, mean: 1, std: 1}}", "did you mean 'normal'?"),
    ("vary: {parameters.m: [1]}\nzip: [[parameters.m, parameters.x]]", ":5:22: 'parameters.x' is not in"),
    (f"{TWO}zip: [[m, b]]", ":5:8: 'm' is not in 'vary'; did you mean 'parameters.m'?"),
    ("vary: {parameters.m: [1], parameters.b: [1, 2]}\nsampling: {method: list}", "the same number of"),
    ("vary: {parameters.m: [1, 2], parameters.b: [1]}\nzip: [[parameters.m, parameters.b]]", ":5:7: what"),
    ("vary: {parameters.m: [1]}\nsampling: {method: sobol}", "'sobol' needs the number of 'samples'"),
    ("vary: {parameters.m: [1]}\nsampling: {samples: 5}", "a grid has as many samples as its values give"),
    ("vary: {parameters.m: [1]}\nderive: {x: y, y: x}", "'x' is defined by itself: x -> y -> x"),
    ("vary: {parameters.m: [1]}\nderive: {x: 2 * mm}", ":5:13: there is no 'mm' among what is varied"),
    ("vary: {parameters: [{m: 1}], parameters.m: [1]}", "is a part of parameters, which is set as well"),
    ("vary: {'parameters.m, parameters.b': [[1]]}", "this entry takes a list of 2 values"),
    ("vary: {parameters.m: {start: 1, stop: 2, points: 9999999}, parameters.b: [1, 2]}",
     "samples are too many for one study"),
    # paths
    ("vary: {parameters..m: [1]}", ":4:23: 'parameters..m' is no dotted path into the scene, such as"),
    ("vary: {parameters/m: [1]}", ":4:22: 'parameters/m' is no dotted path into the scene, such as"),
    (f"{ONE}derive: {{parameters.m: '2'}}", ":4:22: parameters.m is set twice"),
    ("vary: {'parameters.m, parameters.b': {start: 1, stop: 2, points: 3}}", ":4:38: several paths together"),
    ("vary: {'parameters.m, parameters.b': {values: [[1, 2]], name: 'x, y, z'}}",
     ":4:63: 'name' has not the 2 names of parameters.m, parameters.b"),
    # groups
    (f"{TWO}zip: [[parameters.m, parameters.b, parameters.m]]", ":5:36: 'parameters.m' is in 'zip' twice"),
    (f"{TWO}zip: [[parameters.m, parameters.b]]\nsampling: {{method: list}}",
     ":5:6: 'zip' joins values of a grid; 'list' has none"),
    # sampling
    (f"{ONE}sampling: {{indices: true}}", ":5:21: Sobol indices need 'method: sobol'"),
    (f"{RANGES}sampling: {{method: sobol, samples: 8, indices: true, {RELATED}}}",
     ":5:48: Sobol indices are of values that are drawn independently"),
    (f"{RANGES}sampling: {{method: sobol, samples: 4194304, indices: true}}",
     ":5:36: indices of 2 values take too many samples"),
    (f"{RANGES}sampling: {{{RELATED}}}", ":5:25: the values of a grid are not drawn"),
    (f"{RANGES}sampling: {{method: random, samples: 4, {RELATED.replace('.b]', '.bb]')}}}",
     ":5:79: 'parameters.bb' is not in 'vary'; did you mean 'parameters.b'?"),
    (f"{TWO}sampling: {{method: random, samples: 4, {RELATED}}}",
     ":5:79: 'parameters.b' is a choice of values, which has no correlation"),
    (f"{RANGES}sampling: {{method: random, samples: 4, {RELATED.replace('.b]', '.m]')}}}",
     ":5:54: a value is not correlated with itself"),
    # what is derived
    (f"{ONE}derive: {{x: 2 +}}", ":5:13: this is not arithmetic; an operand or operator is missing"),
    (f"{ONE}derive: {{parameters..b: '2'}}", ":5:25: 'parameters..b' is neither a name nor a dotted path"),
    (f"{ONE}derive: {{parameters.b: 2*b}}", ":5:24: 'parameters.b' is defined by itself"),
    ("vary: {title: [a, b]}\nderive: {parameters.b: 2*title}", ":5:24: title is not a number in every"),
    # factors
    ("vary: {parameters.m: [null]}", ":4:23: a value is a number, a text, true, false, or a list or"),
    ("vary: {parameters.m: {start: 1, stop: 2, points: 1}}", ":4:22: one point cannot be at both"),
    ("vary: {parameters.m: {distribution: uniform, low: 2, high: 1}}", ":4:22: 'low' is not below 'high'"),
    ("vary: {parameters.m: {distribution: loguniform, low: -1, high: 1}}", ":4:22: 'low' of a log-uniform"),
    ("vary: {parameters.m: {distribution: integer, low: 0.5, high: 3}}", ":4:22: 'low' and 'high' of whole"),
    ("vary: {parameters.m: {distribution: lognormal, mean: -1, std: 1}}", ":4:22: 'mean' of a lognormal"),
    ("vary: {parameters.m: {distribution: normal, mean: 1, std: 1, low: 2, high: 1}}",
     ":4:22: 'low' is not below 'high'"),
    ("vary: {parameters.m: {distribution: lognormal, mean: 1, std: 1, high: -1}}",
     ":4:22: 'high' of a lognormal distribution is above 0"),
    ("vary: {parameters.m: {distribution: triangular, low: 1, mode: 3, high: 2}}",
     ":4:22: 'low', 'mode' and 'high' do not follow each other"),
    ("vary: {parameters.m: {distribution: triangular, low: 1}}",
     ":4:22: distribution 'triangular' needs the keys low, mode, high"),
    ("vary: {parameters.m: {distribution: uniform, min: 1, max: 2}}",
     ":4:22: distribution 'uniform' needs the keys low, high; write 'low' for 'min'; write 'high' for 'max'"),
    ("vary: {parameters.m: {distribution: normal, mean: 1, std: 1, max: 2}}",
     ":4:22: distribution 'normal' needs the keys mean, std; write 'high' for 'max'"),
    ("vary: {parameters.m: {distribution: uniform, low: 1, high: 2, seed: 3}}",
     "is not a key of vary.parameters.m; its keys are points, name, distribution, low, high"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "said"), FAULTS)
def test_faults_of_a_study_have_their_place(tmp_path, text, said):
    with pytest.raises(SceneError) as caught:
        plan_of(tmp_path, text + "\n")
    assert said in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / "masses.yaml"))


def test_a_misspelt_key_hides_no_other_fault(tmp_path):
    text = "vary: {parameters.m: {valus: [1], values: [1, 2]}, parameters.mm: [1, 2]}\n"
    with pytest.raises(SceneError) as caught:
        plan_of(tmp_path, f"{text}expct: []\n")
    said = [(fault.line, fault.column, fault.message.split()[0]) for fault in caught.value.faults]
    assert said == [(4, 23, "'valus'"), (4, 52, "mass.yaml"), (5, 1, "'expct'")]


def test_a_missing_scene_hides_no_misspelt_key(tmp_path):
    study = tmp_path / "study.yaml"
    study.write_text("dynid: 1\nkind: study\nscene: none.yaml\nvary: {parameters.m: [1, 2]}\nexpct: []\n")
    with pytest.raises(SceneError, match=r"study\.yaml:5:1: 'expct' is not a key"):
        load_scene(study)


def test_a_quantity_that_a_parameter_leads_back_to_is_refused(tmp_path):
    scene = SCENE.replace("{m: 2, b: 1}", "{m: 2 * b, b: 1}")
    with pytest.raises(SceneError, match=r"it is defined by itself: "):
        plan_of(tmp_path, "vary: {title: [a, b]}\nderive: {parameters.b: 3 * m}\n", scene)


def test_values_of_one_kind_are_an_array_of_it_and_others_texts():
    assert as_column([True, False]).dtype == bool
    assert as_column([1, 2.5]).dtype == float
    assert as_column([True, 2, "x", [1]]).tolist() == ["true", "2", "x", "[1]"]
