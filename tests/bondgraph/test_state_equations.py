"""State equations as text and as a system of python-control, against the tableau and the matrices."""

import re
from fractions import Fraction

import control
import numpy as np
import pytest
from flint import fmpq, fmpq_mat

import dynid
from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from dynid.bondgraph.graph_state_space import state_space
from dynid.bondgraph.state_equations import state_equations
from dynid.errors import UsageError
from dynid.lti.signals import Step
from dynid.store import write_result
from tests.bondgraph.graphs import ISOLATOR, chain, written
from tests.bondgraph.tableau import transfer_at
from tests.bondgraph.test_state_space import regular


def equations(graph):
    return state_equations(graph, state_space(graph).states)


class Read:
    """Equations as a reader would evaluate them, in fractions: linear in states, inputs and their rates."""

    def __init__(self, found, graph):
        self.inputs = graph.inputs
        self.values = {name: graph.graph.value(name) for name in graph.valued}
        for definition in found.definitions:
            name, _, text = definition.partition(" = ")
            self.values[name] = eval(text, {}, dict(self.values))
        left, self.rates = (
            zip(*(line.split(" = ") for line in found.states), strict=True) if found.states else ((), ())
        )
        self.states = [self.plain(name.removeprefix("d/dt ")) for name in left]
        self.outputs = [line.split(" = ")[1] for line in found.outputs]

    def plain(self, text):
        """Give variables names that Python can read."""
        text = re.sub(r"\(d(\d*)/dt\d* (\w+)\)", r"rate_\1_\2", text)
        text = re.sub(r"integral:", "integral_", text)
        return re.sub(r"\b([^\W\d]\w*)\.([efqp])\b", r"\1_at_\2", text)

    def at(self, text, variables):
        text = self.plain(text)
        zero = dict.fromkeys(re.findall(r"rate_\d*_\w+|\w+_at_[efqp]", text), Fraction(0))
        return Fraction(eval(text, {}, {**zero, **dict.fromkeys(self.inputs, 0), **self.values, **variables}))

    def transfer(self, source, s):
        """Return T(s): the input is exp(st), so that its k-th rate is s^k times it."""
        driven = {source: Fraction(1)}
        driven |= {f"rate_{'' if k == 1 else k}_{source}": s**k for k in range(1, 9)}
        alone = {name: {name: Fraction(1)} for name in self.states}
        rows = [[self.at(rate, alone[name]) for name in self.states] for rate in self.rates]
        free = [[self.at(rate, driven)] for rate in self.rates]
        size = len(rows)
        system = [[s * (i == j) - rows[i][j] for j in range(size)] for i in range(size)]
        solved = matrix(system).solve(matrix(free)) if size else []
        states = {
            name: Fraction(int(solved[k, 0].p), int(solved[k, 0].q)) for k, name in enumerate(self.states)
        }
        return self.at(self.outputs[0], {**driven, **states})


def matrix(table):
    return fmpq_mat([[fmpq(x.numerator, x.denominator) for x in row] for row in table])


@pytest.mark.parametrize(("junctions", "loops"), [(4, 0), (6, 2), (4, 4)])
def test_the_written_equations_have_exactly_the_transfer_function_of_the_tableau(junctions, loops):
    point, checked, shared = Fraction(7, 3), 0, 0
    for *case, inputs, output, graph in regular(range(5000, 5100), junctions, loops):
        expected = transfer_at(*case, inputs, output, point)
        if expected is None:
            continue
        found = equations(graph)
        shared += bool(found.definitions)
        for source in inputs:
            assert Read(found, graph).transfer(source, point) == expected[source]
            checked += 1
    assert checked >= 20
    assert shared or junctions < 6  # larger ones need named parts


def test_the_isolators_equations_read_as_in_a_book():
    graph = written(*ISOLATOR, "m_s.f")
    found = equations(graph)
    mass = "(m_s + tuning**2*I_f)"  # the fluid's inertia is folded in
    assert found.states == (
        f"d/dt body.f = -b/{mass}*body.f + tuning/{mass}*C_a.e + tuning**2*I_f/{mass}*(d/dt v_in)",
        "d/dt C_a.e = -tuning/C_a*body.f + tuning/C_a*v_in",
    )
    assert found.outputs == ("m_s.f = body.f",)
    assert found.definitions == ()


def test_an_algebraic_loop_is_solved_in_symbols():
    graph = written(
        "Se u, 1 a, I m 1, 0 j, R r1 2, 1 b, R r2 3, C k 5",
        "u -> a -> m, a -> j -> r1, j -> b -> r2, b -> k",
        "m.f",
    )
    assert equations(graph).states == (
        "d/dt a.f = -r1*r2/(m*r1 + m*r2)*a.f - r1/(m*r1 + m*r2)*k.e + 1/m*u",
        "d/dt k.e = r1/(r1*k + r2*k)*a.f - 1/(r1*k + r2*k)*k.e",
    )


def test_values_that_cancel_are_put_into_the_equations():
    """R r1 and R r2 cancel: with these numbers, not with others, the flow is a state no more."""
    graph = written(
        "Se u, 1 j, R r1 1, R r2 -1, C c 2, I m 0", "u -> j -> r1, j -> r2, j -> c, j -> m", "c.e"
    )
    assert state_space(graph).states == ()
    assert equations(graph).states == ()
    assert equations(graph).outputs == ("c.e = u",)


def test_a_long_chain_is_written_stage_by_stage():
    found = equations(written(*chain(100), "m100.f"))
    assert len(found.states) == 200
    assert max(len(line) for line in found.states) < 120


# --- in a result, and in python-control ----------------------------------------------------------


def analysed(graph, *results, **more):
    return analyse(graph.graph, Analysis(graph.inputs, graph.outputs, frozenset(results), **more))


def test_every_row_of_the_matrices_has_its_equation():
    result = analysed(written(*ISOLATOR, "m_s.f"), "state_space")
    states = result["bond_graph/state_space/state"].data
    lines = result["bond_graph/state_space/equations"].data
    assert [line.split(" = ")[0] for line in lines] == [f"d/dt {state}" for state in states]
    assert "less a multiple of the input" in result.group_attrs["bond_graph/state_space"]["note"]


def test_python_control_gets_the_system_with_its_names():
    graph = written(*chain(3), "m3.f", "k1.e")
    system = analysed(graph, "state_space").to_control()
    assert system.input_labels == ["F"]
    assert system.output_labels == ["m3_f", "k1_e"]
    assert system.state_labels == ["v1_f", "v2_f", "k1_e", "v3_f", "k2_e", "k3_e"]
    expected = state_space(graph)
    assert np.array_equal(system.A, expected.A)


def test_a_file_gives_the_same_system(tmp_path):
    result = analysed(written(*chain(2), "m2.f"), "state_space", "causality")
    write_result(result, tmp_path / "chain.h5")
    again = dynid.open_result(tmp_path / "chain.h5")
    assert again.equals(result)
    assert np.array_equal(again.to_control().A, result.to_control().A)


def test_python_control_simulates_the_same_response():
    graph, times = written(*chain(3), "m3.f"), np.linspace(0, 1, 51)
    result = analysed(graph, "state_space", "time_response", times=times, signals=(("F", Step()),))
    _, found = control.step_response(result.to_control(), times)
    ours = result.value("bond_graph/time_response/response")[:, 0]
    # both propagate exactly; control's is an expm of the same matrix
    assert np.abs(found - ours).max() <= 1e-11 * np.abs(ours).max()


def test_python_control_finds_the_exact_poles_and_frequency_response():
    omega = np.geomspace(1, 100, 7)
    graph = written(*ISOLATOR, "m_s.f")
    result = analysed(graph, "state_space", "poles", "frequency_response", omega=omega)
    system = result.to_control()
    poles = result.value("bond_graph/transfer_function/m_s.f/v_in/poles")
    assert np.sort_complex(control.poles(system)) == pytest.approx(np.sort_complex(poles), rel=1e-12)
    ours = result.value("bond_graph/frequency_response/response")[:, 0, 0]
    assert system(1j * omega) == pytest.approx(ours, rel=1e-12)


def test_a_system_without_states_is_a_gain_in_python_control():
    system = analysed(
        written("Se u, 1 j, R r 2, R q 3", "u -> j -> r, j -> q", "q.e"), "state_space"
    ).to_control()
    assert (system.nstates, system.D.item()) == (0, 0.6)


def test_an_improper_system_is_refused_with_the_reason():
    result = analysed(written("Sf u, 1 j, I m 3, R r 2", "u -> j -> m, j -> r", "u.e"), "state_space")
    with pytest.raises(UsageError, match=r"output 'u\.e' follows a derivative of input 'u'"):
        result.to_control()


def test_a_result_without_state_equations_says_what_to_ask_for():
    result = analysed(written(*ISOLATOR, "m_s.f"), "poles")
    with pytest.raises(UsageError, match=r"Add state_space to analysis\.results"):
        result.to_control()
