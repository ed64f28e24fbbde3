"""The printed summary of an identification."""

from types import SimpleNamespace

import numpy as np
import pytest

from dynid.identification.diagnosis.verdict import verdict
from dynid.number_format import limit, p_text, percent, quantity, share_text, unit_text, with_error
from dynid.report.content.blocks import Statement
from dynid.report.content.identification import cautions, method, noise_sentences, sections
from dynid.result import Result
from tests.identification.cases import run, simulated
from tests.screens import lines


def outcome(warned=(), lacks_fit=False, **changed):
    """Return a small result, made up: two parameters and what the screen reads of them."""
    values = {
        "start": [10.0, 5e3],
        "true": [20.0, 11e3],
        "estimate": [25.0, 11152.0],
        "standard_error": [10.0, 1004.0],
        "cramer_rao": [8.0, 990.0],
    }
    diagnostics = {
        "settled": True,
        "explained": True,
        "redundancy": 8,
        "signal_p": 0.0,
        "white": True,
        "whiteness_p": 0.44,
        "condition": 1.8,
        "distance_to_optimum": [0.1, 0.2],
    }
    values |= {name: value for name, value in changed.items() if name in values}
    diagnostics |= {name: value for name, value in changed.items() if name in diagnostics}
    result = Result("identification")
    group = "identification/parameters"
    result.add(f"{group}/name", ["a.c", "a.k"], ("parameter",))
    result.add(f"{group}/unit", ["N.s/m", "N/m"], ("parameter",))
    for name, value in values.items():
        result.add(f"{group}/{name}", value, ("parameter",))
    error = 100 * np.abs(np.divide(values["estimate"], values["true"]) - 1)
    result.add(f"{group}/error_percent", error, ("parameter",))
    result.add("identification/history/component", ["1.displacement", "1.velocity"], ("component",))
    result.add("identification/measurement/channel", ["1.velocity"], ("channel",))
    result.add("identification/measurement/measured", np.ones((9, 1)), ("time", "channel"))
    group = "identification/diagnostics"
    good = diagnostics["settled"] and diagnostics["explained"] and diagnostics["redundancy"] > 0
    result.add(f"{group}/converged", good)
    result.add(f"{group}/lacks_fit", lacks_fit or not diagnostics["explained"])
    result.add(f"{group}/residual_ratio", [0.05], ("channel",))
    result.add(f"{group}/parameter", ["a.c", "a.k"], ("parameter",))
    distance = np.array(diagnostics.pop("distance_to_optimum"))
    result.add(f"{group}/distance_to_optimum", distance, ("parameter",))
    compared = SimpleNamespace(
        has_signal=diagnostics["signal_p"] < 1e-4,
        lack_of_fit_p=3e-9 if lacks_fit or not diagnostics["explained"] else 0.5,
        lacks_fit=lacks_fit or not diagnostics["explained"],
        signal_explained=0.9998 if lacks_fit else 0.61,
        **{name: diagnostics[name] for name in ("signal_p", "explained", "redundancy")},
    )
    posterior = SimpleNamespace(
        likelihood=SimpleNamespace(names=["a.c", "a.k"]),
        distance_to_optimum=distance,
        optimal=diagnostics["settled"],
        converged=diagnostics["settled"] and diagnostics["explained"] and diagnostics["redundancy"] > 0,
        optima=None,
        ambiguous=False,
        undetermined=(),
        comparison=compared,
        noun="record",
        estimate=SimpleNamespace(disputed=False),
        rejection=None,
    )
    result.add(f"{group}/verdict", verdict(posterior))
    result.add_axis(f"{group}/warnings", np.array(warned, dtype=object))
    for name, value in diagnostics.items():
        result.add(f"{group}/{name}", value)
    return result


def test_interval_is_that_of_the_logarithm_and_the_bound_is_relative_to_the_truth():
    # 25 exp(±1.96 x 0.4) and 11152 exp(±1.96 x 0.09003); 8 / 20 and 990 / 11000.
    assert lines(outcome()) == [
        "  2 physical states, 2 unknown parameters; 9 samples of 1.velocity",
        "",
        "                 start        estimate   95 % interval    true  error  CR bound",
        "    a.c [N·s/m]  10.00         25 ± 10   11.41 … 54.75   20.00   25 %      40 %",
        "    a.k [N/m]    5 000  11 200 ± 1 000  9 348 … 13 300  11 000  1.4 %     9.0 %",
        "",
        "  converged: optimum found, the model explains the record",
        "",
        "  redundancy 8: few, an error in what is known may stay unseen",
        "  RMS residual 5 % of the signal",
        "  the residuals are white (p = 0.44; level 1e-6)",
        "  well conditioned; the parameters are distinguishable (condition number 1.8)",
        "  largest relative standard error: 40 % (a.c)",
    ]


def test_without_truth_there_is_neither_error_nor_bound():
    said = lines(outcome(true=[np.nan, np.nan]))
    assert said[2:5] == [
        "                 start        estimate   95 % interval",
        "    a.c [N·s/m]  10.00         25 ± 10   11.41 … 54.75",
        "    a.k [N/m]    5 000  11 200 ± 1 000  9 348 … 13 300",
    ]
    said = lines(outcome(true=[np.nan, 11e3]))
    assert said[2].split() == ["start", "estimate", "95", "%", "interval", "true", "error"]
    assert said[3].split()[-4:] == ["…", "54.75", "-", "-"]


def test_an_interval_of_orders_of_magnitude_stays_readable_and_positive():
    said = lines(outcome(standard_error=[100.0, 50e3]))
    assert "0.009843 … 63 500" in said[3]
    assert "1.702 … 7.307e+07" in said[4]
    assert said[-1].endswith("largest relative standard error: 448 % (a.k)")


CASES = {
    "both": ({}, "converged: optimum found, the model explains the record", ""),
    "lack of fit": (
        {"lacks_fit": True},
        "optimum found, but the model lacks fit (p = 3e-09): it explains 99.98 % of the signal, and the "
        "intervals are nominal, as a rule too narrow",
        "",
    ),
    "off the optimum": (
        {"settled": False, "distance_to_optimum": [2.8123, 0.2]},
        "NOT converged: 2.8 standard errors of a.c from the optimum; the model explains the record",
        "use method auto, or more passes",
    ),
    "no fit": (
        {"explained": False, "white": False, "whiteness_p": 1e-9},
        "NOT converged: optimum found; the model does not explain the record: lack of fit p = 3e-09, "
        "61 % of the signal explained",
        "check model, units, signs and starts, and whether a joint is nonlinear",
    ),
    "noise": (
        {"explained": False, "signal_p": 0.31},
        "NOT converged: optimum found; the record shows no response, only noise (p = 0.31)",
        "excite more, or measure elsewhere, longer or with less noise",
    ),
    "no redundancy": (
        {"redundancy": 0},
        "NOT converged: optimum found; nothing in the record could contradict the model (redundancy 0)",
        "add channels or excitation frequencies, or fix a parameter",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_the_verdict_says_whether_the_optimum_is_found_and_the_record_explained(case):
    changed, verdict, remedy = CASES[case]
    result = outcome(**changed)
    p, white = changed.get("whiteness_p", 0.44), "white" if changed.get("white", True) else "not white"
    said = "  the residuals are white (p = 0.44; level 1e-6)"
    if white == "not white":
        said = f"  the residuals are not white (p = {p:.2g})"
    shown = " ".join(" ".join(lines(result)).split())
    assert verdict in shown
    assert said.strip() in shown
    said = f"not converged: {verdict.removeprefix('NOT converged: ')}: {remedy}"
    assert list(cautions(result)) == ([said] if remedy else [])


@pytest.mark.parametrize("case", CASES)
def test_error_bars_of_a_rejected_result_are_not_printed(case):
    changed, verdict, _ = CASES[case]
    said = "\n".join(lines(outcome(**changed)))
    rejected = verdict.startswith("NOT")
    assert ("±" in said, "interval" in said, "standard error:" in said, "bound" in said) == (
        not rejected,
    ) * 4
    assert ("error bars are not printed: the estimate is not converged" in said) == rejected
    assert "25" in said


def test_every_warning_is_a_caution_of_its_own():
    warned = ["a.c may be clipped", "a.k is vague"]
    assert list(cautions(outcome(warned=warned))) == warned


def test_error_bars_of_what_is_no_noise_are_called_nominal():
    nominal = "  error bars are nominal: the residuals are not white noise"
    assert nominal in lines(outcome(white=False))
    assert nominal not in lines(outcome())
    assert nominal not in lines(outcome(white=False, explained=False))
    assert nominal not in lines(run(measurement=simulated(0.05)))


def test_intervals_of_a_model_that_lacks_fit_are_called_nominal_and_its_verdict_is_not_good():
    said = lines(outcome(lacks_fit=True, white=False))
    assert "nominal 95 % interval" in said[2]
    assert not any("converged" in line for line in said)
    assert not any(line.startswith("  error bars are nominal") for line in said)
    tones = [
        [
            block.tone
            for section in sections(outcome(lacks_fit=lacking))
            for block in section.blocks
            if section.title == "Parameters" and isinstance(block, Statement)
        ]
        for lacking in (True, False)
    ]
    assert tones == [["bad"], ["good"]]


@pytest.mark.parametrize(
    ("p", "text"), [(0.0, "p < 1e-300"), (1e-310, "p < 1e-300"), (2e-300, "p = 2e-300"), (0.314, "p = 0.31")]
)
def test_a_p_value_of_zero_is_an_inequality(p, text):
    assert p_text(p) == text


@pytest.mark.parametrize(
    ("part", "text"),
    [
        (1.0, "100 %"),
        (0.9742, "97.42 %"),
        (0.99998, "99.998 %"),
        (1 - 2e-8, "99.999998 %"),
        (1 - 1e-12, "more than 99.999999 %"),
    ],
)
def test_less_than_all_is_not_100_percent(part, text):
    assert share_text(part) == text


def test_estimates_from_a_record_without_noise_have_no_error_bars():
    result = run(measurement=simulated(0.0))
    screen = lines(result)
    assert screen[2].split() == ["start", "estimate", "true", "error"]
    row = screen[3].split("  ")
    assert [cell.strip() for cell in row if cell][:4] == ["j2.k [N/m]", "10 000", "20 000.0", "20 000"]
    assert any(line.startswith("  the residuals are round-off: the record has no noise") for line in screen)
    assert not any("error bars are nominal" in line or "standard error" in line for line in screen)


def test_warnings_stand_below_the_verdict():
    said = lines(outcome(warned=["a.c may be clipped"]))
    assert said[said.index("  warning: a.c may be clipped") - 1].startswith("  converged: ")


def test_a_condition_is_put_in_words():
    said = "  badly conditioned; the parameters are hardly distinguishable (condition number 1.2e+03)"
    assert said in lines(outcome(condition=1234.0))


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (11152.0, 1004.0, "11 200 ± 1 000"),
        (20.14, 0.3, "20.14 ± 0.30"),
        (20031.3, 33.7, "20 031 ± 34"),
        (20.0, 0.0996, "20.00 ± 0.10"),
        (4.3, 35.2, "4 ± 35"),
        (1234567.0, 234567.0, "1 230 000 ± 230 000"),
        (19999.9999233, 3.9e-6, "19 999.9999233 ± 3.9e-06"),
        (20000.0, 1e-14, "20 000.0000000000 ± 1.0e-14"),
        (2.00314e9, 3.4e6, "(2.0031 ± 0.0034)e+09"),
        (2.5e-7, 1.2e-6, "(2.5 ± 12.0)e-07"),
        (20.0, 0.0, "20.00 ± 0"),
    ],
)
def test_value_and_error_have_the_same_decimals(value, error, text):
    assert with_error(value, error) == text


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (19965.4, 34.0, "19 965"),
        (3456789.0, 1e6, "3 457 000"),
        (19.55, 0.3, "19.55"),
        (0.0123456, 5.0, "0.01235"),
        (1.23456e12, 1e12, "1.235e+12"),
        (11.4142, None, "11.41"),
        (0.0, 1.0, "0"),
        (float("nan"), None, "-"),
    ],
)
def test_quantities_are_readable(value, error, text):
    assert quantity(value, error) == text


@pytest.mark.parametrize(
    ("orders", "said"),
    [
        ([0], "coloured noise (autoregression): a white"),
        ([2, 0], "coloured noise (autoregression): a of order 2 (0.5, -0.25), b white"),
        ([5], "coloured noise (autoregression): a of order 5 (0.5, -0.25, 0.125, -0.0625, …)"),
        ([0, 0, 0, 1], "coloured noise (autoregression): a white, b white, c white, …"),
    ],
)
def test_coloured_noise_has_its_orders_and_first_coefficients(orders, said):
    result, group = Result("identification"), "identification/noise"
    assert not list(noise_sentences(result))
    result.add_axis(f"{group}/channel", list("abcd"[: len(orders)]))
    result.add(f"{group}/order", orders, ("channel",))
    row = [0.5, -0.25, 0.125, -0.0625, 0.03125]
    result.add(f"{group}/coefficients", np.array([row] * len(orders)), ("channel", "lag"))
    assert list(noise_sentences(result)) == [said]


def test_noise_in_proportion_to_the_response_is_in_per_cent():
    result, group = Result("identification"), "identification/noise"
    result.add_axis(f"{group}/channel", ["a", "b"])
    result.add(f"{group}/ratio", [0.021, 0.005], ("channel",))
    assert list(noise_sentences(result)) == ["noise in proportion to the response: 2.1 % in a, 0.5 % in b"]


def test_the_loss_of_huber_is_named_as_the_method():
    result = Result("identification")
    assert method(result) == "structure"
    result.add("identification/diagnostics/passes", 2)
    result.add_axis("identification/stages/stage", ["a filter pass"])
    result.add("identification/stages/chosen", 1)
    result.annotate("identification", estimator="filter")
    assert method(result) == "identification · 2 filter passes"
    result.annotate("identification", loss="huber")
    assert method(result) == "identification · maximum likelihood with Huber's loss"


@pytest.mark.parametrize("count", [0, 2, 25])
def test_modes_of_a_structure_and_its_massless_dofs(count):
    """The first 12 massless DOFs are listed."""
    result, group = Result("identification"), "structure/modes"
    result.add_axis(f"{group}/omega", [0.0, 2 * np.pi])
    for name, values in {"damping": [0.0, 0.02], "name": ["", ""]}.items():
        result.add(f"{group}/{name}", values, ("omega",))
    result.add(f"{group}/rigid", 1)
    result.add_axis(f"{group}/dof", [str(k) for k in range(30)])
    if count:
        result.add_axis(f"{group}/massless", [f"d{k}" for k in range(1, count + 1)])
    screen = lines(result)
    (section,) = sections(result)
    table, *remark = section.blocks
    assert table.rows[1] == ("2", "6.2832", "1.0000", "2 %")
    said = {0: "no massless DOFs", 2: "2 massless DOFs", 25: "25 massless DOFs"}[count]
    assert table.caption == f"2 modes of 30 DOFs; 1 rigid-body mode, {said}"
    assert screen[0] == f"  {table.caption}"
    assert screen[3].split() == ["2", "6.2832", "1.0000", "2", "%"]
    names = ", ".join(f"d{k}" for k in range(1, min(count, 12) + 1))
    listed = f"massless: {names}{', … (25 in all)' if count == 25 else ''}"
    assert [statement.text for statement in remark] == ([listed] if count else [])
    assert screen[4:] == ([f"  {listed}"] if count else [])


@pytest.mark.parametrize(
    ("value", "text"),
    [(20000.0, "20 000"), (-0.0, "0"), (0.5, "0.5"), (1310.82, "1 311"), (1 / 6, "0.1667"), (np.inf, "∞"),
     (4.43787e11, "4.438e+11")],
)  # fmt: skip
def test_gains_have_four_digits_unless_they_are_short(value, text):
    assert limit(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.0, "1.0 %"),
        (0.0, "0 %"),
        (0.07, "0.070 %"),
        (12.34, "12 %"),
        (1.7e-13, "1.7e-13 %"),
        (99.4, "99 %"),
        (99.6, "100 %"),
    ],
)
def test_percentages_have_two_digits_trailing_zeros_included(value, text):
    assert percent(value) == text


@pytest.mark.parametrize(
    ("unit", "text"),
    [
        ("N.s/m", "N·s/m"),
        ("m3/(s.Pa)", "m³/(s·Pa)"),
        ("kg.m^2", "kg·m²"),
        ("1", ""),
        ("", ""),
        ("m.s^-2", "m·s⁻²"),
    ],
)
def test_units_are_written_as_in_figures(unit, text):
    assert unit_text(unit) == text


def test_a_large_value_has_the_digits_of_a_small_error():
    assert quantity(25_999_440.0, 210.0) == "2.599944e+07"
    assert quantity(73_066_000.0, 50e3) == "7.307e+07"
    assert quantity(4e9, 4e9) == quantity(4e9) == "4e+09"
    assert quantity(3.1e-9, 1e-15) == "3.1000000e-09"
