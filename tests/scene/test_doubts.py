"""Doubts about valid scenes: lists that may hold decimal commas, masses and blocks that nothing uses."""

import pytest

from dynid.scene.run import scene_doubts
from tests.scene.example_scenes import ISOLATOR, JOINTS, check

UNEXPECTING = ISOLATOR.partition("expect:")[0]
LIST, LINKS = "[2, 2, 1.5, 1, 1]", "{dofs: [4, 5], k: 2.0e4, c: 20}"


def doubts_of(text):
    return [(doubt.line, doubt.column, doubt.message) for doubt in scene_doubts(check(text))]


@pytest.mark.parametrize("text", [ISOLATOR, JOINTS])
def test_the_documented_examples_raise_none(text):
    assert doubts_of(text) == []


@pytest.mark.parametrize(
    ("masses", "meant"),
    [
        ("[2,1, 2,0, 15]", "[2.1, 2.0, 15]"),
        ("[2, 1,5, 15, 3]", "[2, 1.5, 15, 3]"),
        ("[3,1, 1,7, 1]", "[3.1, 1.7, 1]"),
    ],
)
def test_a_list_whose_commas_may_be_decimal_is_doubted_with_what_it_may_mean(masses, meant):
    [(line, column, message)] = doubts_of(JOINTS.replace(LIST, masses))
    assert (line, column) == (5, 13)
    assert f"decimals stand behind a point: {meant}." in message


@pytest.mark.parametrize(
    "masses",
    [
        "[2,2,1,1,1]",
        "[2, 2, 1, 1, 1]",
        "[2,2,1, 1, 1]",  # no two of three are one number
        "[2.0,2, 1,1, 1]",
        "[2,2, 1.5,1, 1]",
        "\n      [2,2,\n      1,1,\n      1]",
    ],
)
def test_other_lists_are_not(masses):
    assert doubts_of(JOINTS.replace(LIST, masses)) == []


def test_whole_numbers_such_as_dofs_may_be_grouped():
    text = JOINTS + "identifiability: false\nreduction: {method: guyan, masters: [1,2, 3,4, 5]}\n"
    assert doubts_of(text) == []


def test_masses_that_nothing_names_are_doubted_at_the_first():
    text = JOINTS.replace(f", {LINKS}", "").replace("dof: 5", "dof: 3")
    [(line, column, message)] = doubts_of(text)
    assert (line, column) == (5, 25)
    assert message.startswith("masses 4, 5 of 5: no link, joint, load or channel names")
    [(_, _, one)] = doubts_of(text.replace("dof: 3, quantity", "dof: 4, quantity"))
    assert one.startswith("mass 5 of 5: ")


RESULTS = "[transfer_function, zeros, poles, properties, frequency_response, time_response]"


@pytest.mark.parametrize(
    ("results", "doubted"),
    [
        ("[poles]", ["frequency", "time"]),
        ("[poles, time_response]", ["frequency"]),
        ("[frequency_response, bandwidth, transfer_function]", ["time"]),
        ("[energy, time_response]", []),
        ("[source_performance, time_response]", []),
    ],
)
def test_a_grid_with_which_nothing_is_computed_is_doubted(results, doubted):
    lines = {"frequency": 27, "time": 28}
    text = UNEXPECTING.replace(RESULTS, results).replace("initial: {m_s: {f: 0.1}}\n", "")
    found = doubts_of(text)
    assert [(line, column) for line, column, _ in found] == [(lines[name], 3) for name in doubted]
    for (_, _, message), name in zip(found, doubted, strict=True):
        assert f"'results' does not list '{name}_response'" in message


def test_margins_of_loops_use_the_frequencies():
    loop = "control: {loops: [{from: m_s.f, to: v_in, controller: {gain: 0.1}, reference: r}]}\n"
    text = UNEXPECTING.replace(RESULTS, "[properties, time_response]")
    assert [line for line, _, _ in doubts_of(text)] == [27]
    assert doubts_of(text.replace("inputs: [v_in]", "inputs: [r]") + loop) == []


def test_elements_of_negative_values_are_doubted_once_at_the_first():
    assert doubts_of(UNEXPECTING.replace("b: 50", "b: -50")) == [
        (11, 25, "not passive: R 'b' (-50) has a negative value and can give energy without end")
    ]
    [(line, column, message)] = doubts_of(
        UNEXPECTING.replace("b: 50", "b: -50").replace("C_a: 1.0e-8", "C_a: -1.0e-8")
    )
    assert (line, column) == (11, 25)
    assert message.startswith("not passive: R 'b' (-50), C 'C_a' (-1e-08) have negative values and")
    # moduli, zero resistance and falling laws are none
    assert doubts_of(UNEXPECTING.replace("A_p: 0.01", "A_p: -0.01").replace("b: 50", "b: 0")) == []
    assert doubts_of(UNEXPECTING.replace("{type: R, value: b}", '{type: R, law: {e: "-b*f"}}')) == []


def test_hidden_modes_asked_of_a_loop_with_a_delay_are_doubted():
    loop = "control: {loops: [{from: m_s.f, to: v_in, controller: {gain: 0.1, delay: 0.1}, reference: r}]}\n"
    text = UNEXPECTING.replace(RESULTS, "[frequency_response, time_response, hidden_modes]")
    text = text.replace("inputs: [v_in]", "inputs: [r]")
    [(_, _, message)] = doubts_of(text + loop)
    assert message.startswith("hidden modes are not listed of a graph with delays in loops")
    assert doubts_of(text + loop.replace(", delay: 0.1", "")) == []
