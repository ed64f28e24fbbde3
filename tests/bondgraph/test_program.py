"""Programs: what is refused when they are written, and how their parts are named."""

from fractions import Fraction
from weakref import WeakSet

import pytest
from flint import nmod
from sympy import sympify

from dynid.bondgraph.formula_printers import ATOM, SIGN, TEXT, PrintedFraction
from dynid.bondgraph.formulas.expressions import free_letter, print_register, shared
from dynid.bondgraph.graph import Node
from dynid.bondgraph.program.program import ModularPoint, Program
from dynid.bondgraph.reduction.prototypes import Prototype
from tests.bondgraph.graphs import written

PRIME = 2**61 - 1


@pytest.fixture
def program():
    values = {name: nmod(value, PRIME) for name, value in {"x": 3, "y": 5, "z": 7}.items()}
    return Program(ModularPoint(PRIME, values, nmod(11, PRIME)))


def test_a_division_by_what_is_identically_zero_is_refused(program):
    x, y = program.parameter("x"), program.parameter("y")
    nothing = program.sub(program.add(x, y), program.add(y, x))
    for numerator in (x, program.zero, nothing):
        for denominator in (program.zero, nothing):
            with pytest.raises(ZeroDivisionError):
                program.div(numerator, denominator)


def test_a_named_part_counts_as_one_in_what_holds_it_and_a_parameter_needs_no_name(program):
    x, y, z = (program.parameter(name) for name in "xyz")
    total = program.add(x, y)
    product, quotient = program.mul(total, z), program.div(total, program.mul(x, x))
    whole = program.add(product, quotient)
    assert shared(program, [whole], 100) == [total, whole]
    assert product not in shared(program, [whole], 3)  # the product, the name of the sum, and z
    assert product in shared(program, [whole], 2)


def test_signs_move_outwards_and_trivial_operations_are_not_written(program):
    x, y, zero, one = program.parameter("x"), program.parameter("y"), program.zero, program.one
    minus = program.neg(x)
    assert program.add(minus, y) == program.add(y, minus) == program.sub(y, x)
    assert program.sub(y, minus) == program.add(x, y)
    assert program.mul(minus, y) == program.mul(y, minus) == program.neg(program.mul(x, y))
    assert program.div(minus, y) == program.div(x, program.neg(y)) == program.neg(program.div(x, y))
    assert program.mul(x, program.inv(y)) == program.mul(program.inv(y), x) == program.div(x, y)
    assert program.inv(program.div(x, y)) == program.div(y, x)
    assert program.mul(x, zero) == program.mul(zero, x) == program.sub(x, x) == program.div(zero, x) == zero
    assert program.mul(x, one) == program.mul(one, x) == program.add(x, zero) == program.div(x, one) == x
    assert program.div(x, x) == one


def test_registers_that_are_equal_for_all_values_are_one_at_a_general_point():
    values = {"x": nmod(2**50 + 7, PRIME), "y": nmod(3**30, PRIME), "z": nmod(5**20 + 1, PRIME)}
    program = Program(ModularPoint(PRIME, values, nmod(7**18, PRIME), general=True))
    x, y, z = (program.parameter(name) for name in "xyz")
    product = program.mul(program.add(x, y), z)
    assert program.add(program.mul(x, z), program.mul(y, z)) == product
    assert program.sub(program.mul(x, z), product) == program.neg(program.mul(y, z))


def test_parameters_are_those_that_a_register_is_made_of(program):
    x, y, z = (program.parameter(name) for name in "xyz")
    ratio = program.div(program.mul(program.s, x), program.add(program.neg(y), program.constant(2)))
    assert program.parameters([ratio]) == {"x", "y"}
    assert program.parameters([z, program.s]) == {"z"}


def test_numbers_that_are_read_no_more_are_dropped(program):
    alive, alive_at_sums = WeakSet(), []

    class Number:
        def __init__(self, value):
            self.value = value
            alive.add(self)

        def __add__(self, other):
            alive_at_sums.append(len(alive))
            return Number(self.value + other.value)

        def __mul__(self, other):
            return Number(self.value * other.value)

    powers = [program.s]
    for _ in range(20):
        powers.append(program.mul(powers[-1], program.parameter("x")))
    values, s, unity = {name: Number(Fraction(1, 3)) for name in "xyz"}, Number(Fraction(2)), Number(1)
    inputs = len(alive)
    (total,) = program.run([program.sum(powers[1:])], values, s, unity).values()
    assert total.value == 1 - Fraction(1, 3) ** 20
    assert [count - inputs for count in alive_at_sums] == list(range(20, 1, -1))


def test_what_cancels_in_a_formula_or_in_a_term_of_it_is_not_written(program):
    x, y, z = (program.parameter(name) for name in "xyz")
    nodes = {name: Node(name, "R", Fraction(1)) for name in "xyz"}
    ratio = program.div(program.mul(x, y), program.mul(x, z))
    assert print_register(program, ratio, nodes, {})[0] == "y/z"
    below = program.add(program.mul(y, y), program.mul(y, z))
    total = program.add(x, program.div(program.mul(y, z), below))
    text, _ = print_register(program, total, nodes, {})
    assert sympify(text) == sympify("x + z/(y + z)")
    assert (text[:4], text.count("y")) == ("x + ", 1)
    nothing = program.sub(
        program.mul(x, program.add(y, z)), program.add(program.mul(x, y), program.mul(x, z))
    )
    assert print_register(program, program.mul(z, nothing), nodes, {}) == ("0", ATOM)
    whole = program.add(program.add(x, y), z)
    shares = program.sum(program.div(part, whole) for part in (x, y, z))
    assert print_register(program, shares, nodes, {})[0] == "1"  # no two of them cancel, but all three do
    total = program.add(x, y)
    ratios = program.add(program.div(x, total), program.div(y, total))
    assert sympify(print_register(program, program.add(ratios, z), nodes, {})[0]) == sympify("z + 1")
    assert sympify(print_register(program, program.add(x, total), nodes, {})[0]) == sympify("2*x + y")
    assert print_register(program, program.add(x, total), nodes, {})[0].count("x") == 1


def test_a_formula_that_outgrows_its_polynomials_is_written_as_it_stands():
    names = [f"{letter}{k}" for letter in "ab" for k in range(11)]
    values = {name: nmod(3 + place, PRIME) for place, name in enumerate(names)}
    program = Program(ModularPoint(PRIME, values, nmod(101, PRIME)))
    nodes = {name: Node(name, "R", Fraction(1)) for name in names}
    sums = [program.add(*(program.parameter(f"{letter}{k}") for letter in "ab")) for k in range(11)]
    factor = program.parameter("a0")
    for count, ending in ((10, ")"), (11, ")*a0/a0")):  # 1024 and 2048 terms, of 2000
        whole = program.div(program.mul(program.product(sums[:count]), factor), factor)
        text, _ = print_register(program, whole, nodes, {})
        assert text.endswith(ending)
        assert text.count("+") == count


def test_constants_are_integers(program):
    two = program.constant(2)
    found = program.run([two, program.one, program.zero], {}, Fraction(0), Fraction(1))
    assert found == {two: 2, program.one: 1, program.zero: 0}


def test_a_letter_of_names_is_lengthened_until_nothing_has_it():
    assert [free_letter(taken) for taken in ({"tx"}, {"t", "u"}, {"t1", "t_2"})] == ["t", "t_", "t__"]


@pytest.mark.parametrize(
    ("kind", "fixed", "said"),
    [
        ("1", True, "dependent: the source sets the common flow, A and B answer with their efforts"),
        ("0", True, "dependent: the source sets the common effort, A and B answer with their flows"),
        ("1", False, "independent: B (b) sets the common flow, A (a) answers with its effort"),
        ("0", False, "independent: B (b) sets the common effort, A (a) answers with its flow"),
    ],
)
def test_a_prototype_says_what_depends_on_what(program, kind, fixed, said):
    x, y = program.parameter("x"), program.parameter("y")
    assert Prototype(program, kind, fixed, x, y, "a", "b").type == said


def test_what_is_zero_sets_nothing():
    """B is the subtree behind, not the resistance of zero beside it, though that is named first."""
    graph = written("Se u, 1 j, R r 0, 0 z, C c 2, R q 3", "u -> j -> r, j -> z -> c, z -> q", "j.f")
    (reduction,) = graph.reductions.values()
    assert (reduction.prototype.name_a, reduction.prototype.name_b) == ("r", "z")


def test_numbers_are_decimals_where_they_have_one():
    assert TEXT.number(Fraction(2)) == PrintedFraction(("2", ATOM))
    assert TEXT.number(Fraction(5, 2)) == PrintedFraction(("2.5", ATOM))
    assert TEXT.number(Fraction(-1, 3)) == PrintedFraction(TEXT.integer(-1), TEXT.integer(3))


def test_a_negative_unit_is_a_sign():
    assert TEXT.scaled(("-1", SIGN), "e_1")[0] == "-e_1"
    assert TEXT.scaled(("1", SIGN), "e_1")[0] == "e_1"
