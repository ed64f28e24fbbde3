"""Figures of studies: of bounded size for any number of samples, with the values of the statistics."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from dynid.cli.screen import summary
from dynid.report import figures
from dynid.report.figure import leading
from dynid.result import Result
from dynid.study.analysis.sample_statistics import statistics
from tests.report.test_plot import well_laid_out


def study(inputs, outputs):
    """Return a study in which nothing failed."""
    count = len(next(iter(inputs.values())))
    result = Result("study", "Many")
    result.add_axis("study/sample", np.arange(count))
    result.add("study/exit_code", np.zeros(count, dtype=int), ("sample",))
    for name, values in inputs.items():
        result.add(f"study/samples/{name}", values, ("sample",))
    for path, values in outputs.items():
        dims = ("sample", "pole")[: values.ndim]
        result.add(f"study/results/{path}", values, dims, "rad/s")
    return result


def random(count, seed=0):
    rng = np.random.default_rng(seed)
    x = rng.uniform(1, 2, (count, 3))
    y = {
        f"bond_graph/properties/m.f/v/y_{k}": x @ rng.normal(size=3) + 0.1 * rng.normal(size=count)
        for k in range(4)
    }
    return study({f"parameters.p_{k}": x[:, k] for k in range(3)}, y)


def drawn(result):
    return {figure.name: figure for figure in figures(result)}


@pytest.mark.parametrize("count", [5, 60, 10_000])
def test_figures_are_small_readable_and_the_same_each_time(count):
    result = random(count)
    found, again = drawn(result), drawn(result)
    assert {"distributions", "parallel", "scatter", "tornado", "sobol"} <= set(found)
    for name, figure in found.items():
        ET.fromstring(figure.svg)
        assert figure.svg == again[name].svg
        assert well_laid_out(figure.svg) == [], name
        assert len(figure.svg) < 400_000
    assert sum(len(figure.svg) for figure in found.values()) < 700_000


def test_what_is_thinned_out_is_said_and_statistics_are_of_all():
    result = random(10_000)
    found = drawn(result)
    assert "400 of 10,000 samples are drawn" in found["parallel"].caption
    row = found["distributions"].table.rows[0]
    own = statistics(result["study/results/bond_graph/properties/m.f/v/y_0"].data)
    assert row[1:] == tuple(value.item() for value in own.values())
    assert row[-1] == 10_000


def test_a_grid_of_two_parameters_is_a_map_with_every_value():
    x, y = (part.ravel() for part in np.meshgrid([1.0, 10.0, 100.0], [2.0, 3.0], indexing="ij"))
    found = drawn(study({"parameters.a": x, "parameters.b": y}, {"some/product": x * y}))
    assert [row[-1] for row in found["map"].table.rows] == (x * y).tolist()
    titles = [t.text for t in ET.fromstring(found["map"].svg).iter("{http://www.w3.org/2000/svg}title")]
    assert "a 100, b 3: 300" in titles


def test_poles_over_one_parameter_are_a_root_locus():
    gain = np.linspace(0, 4, 9)
    poles = np.stack([-1 + 1j * np.sqrt(gain), -1 - 1j * np.sqrt(gain)], axis=1)
    result = study({"parameters.k": gain}, {"bond_graph/transfer_function/y/u/poles": poles})
    figure = drawn(result)["root-locus-y-u"]
    assert [complex(row[2], row[3]) for row in figure.table.rows] == poles.ravel().tolist()
    assert well_laid_out(figure.svg) == []
    result["study/results/bond_graph/transfer_function/y/u/poles"].attrs["approximate"] = "order 6"
    assert drawn(result)["root-locus-y-u"].caption == f"{figure.caption} Order 6."
    assert "  approximate, order 6: poles\n" in f"{summary(result, '')}\n"


def test_a_study_without_results_has_no_figures():
    result = study({"parameters.a": np.array([1.0, 2.0])}, {})
    assert drawn(result) == {}


def test_a_grid_leads_with_the_results_over_its_axes():
    a, b = (values.ravel() for values in np.meshgrid([1.0, 2.0, 4.0], [1.0, 2.0]))
    plane = study({"parameters.a": a, "parameters.b": b}, {"properties/y": 1 + 1e-4 * a * b})
    assert leading("study", figures(plane))[0].name == "map"
    assert ">1.0002<" in drawn(plane)["map"].svg  # digits that tell the cells apart
    line = study({"parameters.a": np.arange(1.0, 5.0)}, {"properties/y": np.arange(4.0) ** 2})
    assert leading("study", figures(line))[0].name == "course"
    texts = [t.text or "" for t in ET.fromstring(drawn(line)["course"].svg).iter(f"{SVG}text")]
    assert [text for text in texts if "rad/s" in text] == ["y (rad/s)"]  # once
    assert leading("study", figures(random(60)))[0].name == "distributions"


SVG = "{http://www.w3.org/2000/svg}"


def plots(figure):
    """Return the title and the ends of the x axis of each subplot."""
    found = []
    for group in ET.fromstring(figure.svg).iter(f"{SVG}g"):
        if group.get("class") == "plot":
            texts = [t.text for t in group.iter(f"{SVG}text") if "strong" in t.get("class", "")]
            found.append((texts, tuple(map(float, group.get("data-x").split()[1:]))))
    return found


def test_a_tornado_is_of_the_samples_and_has_a_share_for_each_result():
    a, b = (values.ravel() for values in np.meshgrid(np.geomspace(1, 1e4, 9), np.geomspace(1, 1e4, 9)))
    noise = np.random.default_rng(1).normal(size=81)
    results = {"some/curved": 1e4 / (a + b), "some/straight": np.log(a) - np.log(b), "some/noise": noise}
    tornado = drawn(study({"parameters.a": a, "parameters.b": b}, results))["tornado"]
    assert [titles for titles, _ in plots(tornado)] == [["curved"], ["straight"]]
    shares = [t.text for t in ET.fromstring(tornado.svg).iter(f"{SVG}text") if "R²" in (t.text or "")]
    assert len(shares) == 2
    assert shares[1] == "R² 1.00"
    assert 0 < float(shares[0].removeprefix("R² ")) < 0.9
    values = [row[4:6] for row in tornado.table.rows if "curved" in row[0]]
    assert (1e4 / (a + b)).min() <= np.min(values)
    assert np.max(values) <= (1e4 / (a + b)).max()
    assert "No bars for noise: no input moves the mean" in tornado.caption


def test_what_a_study_derives_from_its_inputs_is_no_input_of_their_influence():
    rng = np.random.default_rng(4)
    a, b = rng.uniform(0.9, 1.6, 40), rng.uniform(1, 10, 40)
    inputs = {"parameters.a": a, "parameters.b": b}
    results = {"some/number": 0.1 * a + b + 0.3 * b**2}
    own, other = study(inputs, results), study(inputs | {"root": np.sqrt(a)}, results)
    other.attrs["scene"] = "dynid: 1\nkind: study\nderive: {root: sqrt(a)}\n"
    for name in ("tornado", "sobol"):
        assert repr(drawn(other)[name].table.rows) == repr(drawn(own)[name].table.rows)  # some are NaN
    alone = study({"parameters.a": a, "root": np.sqrt(a)}, {"some/number": a})
    alone.attrs["scene"] = other.attrs["scene"]
    assert "tornado" not in drawn(alone)


def test_parts_of_a_variance_are_drawn_from_0_to_100_percent_with_standard_errors():
    a, b = (values.ravel() for values in np.meshgrid(np.arange(1.0, 10.0), np.arange(1.0, 10.0)))
    figure = drawn(study({"parameters.a": a, "parameters.b": b}, {"some/y": a, "some/z": a * b}))["sobol"]
    assert [ends for _, ends in plots(figure)] == [(0, 100), (0, 100)]
    assert min(row[2] for row in figure.table.rows) < 0
    assert "Negative estimates are drawn as 0" in figure.caption
    assert "± standard error" in figure.svg


def test_the_magnitudes_of_a_conjugate_pair_are_one_number():
    k = np.linspace(1, 4, 9)
    poles = np.stack([-1 + 1j * k, -1 - 1j * k], axis=1)
    figure = drawn(study({"parameters.k": k}, {"some/poles": poles}))["distributions"]
    assert [row[0] for row in figure.table.rows] == ["|poles[1]| (rad/s)"]


def test_results_that_some_samples_lack_leave_no_sample_without_a_line():
    count = np.arange(7.0)
    late = np.where(count < 5, np.nan, count)
    result = study({"modes.count": count}, {"some/early": count**2, "some/late": late})
    figure = drawn(result)["parallel"]
    assert [row[0] for row in figure.table.rows] == list(range(7))
    assert "1 result with missing values is omitted" in figure.caption
    texts = [t.text for t in ET.fromstring(figure.svg).iter(f"{SVG}text") if "tick" in t.get("class", "")]
    assert {"0", "1", "2", "3", "4", "5", "6"} <= set(texts)
    assert "0.5" not in texts
    every = study({"modes.count": count}, {"some/late": late})
    assert "2 of 7 samples are drawn, the others lack a value" in drawn(every)["parallel"].caption


def test_inputs_spaced_by_their_logarithm_have_logarithmic_axes_everywhere():
    a, b = (values.ravel() for values in np.meshgrid(np.geomspace(1, 1e4, 9), np.linspace(1, 9, 9)))
    found = drawn(study({"parameters.a": a, "parameters.b": b}, {"some/y": a / b}))
    for name in ("map", "scatter"):
        axes = {
            g.get("data-x").split()[0]: g
            for g in ET.fromstring(found[name].svg).iter(f"{SVG}g")
            if g.get("data-x")
        }
        assert set(axes) == ({"log"} if name == "map" else {"log", "lin"})
    levels = sorted({float(path.split()[1]) for path in lines_of(found["parallel"].svg)})
    assert np.diff(levels) == pytest.approx(np.full(8, levels[1] - levels[0]), abs=0.2)


def lines_of(svg):
    """Return the beginning of the line of each sample: x and y."""
    paths = (
        path.get("d") for path in ET.fromstring(svg).iter(f"{SVG}path") if "fine" in path.get("class", "")
    )
    return [line.partition("L")[0] for d in paths for line in d.split("M")[1:]]


def test_figures_of_some_columns_say_of_how_many():
    rng = np.random.default_rng(2)
    x = {f"parameters.p_{k}": rng.random(20) for k in range(5)}
    found = drawn(study(x, {f"some/y_{k}": rng.random(20) for k in range(6)}))
    assert "6 of 11 columns" in found["scatter"].caption
    assert "9 of 11 columns" in found["parallel"].caption
