"""Many samples of a graph at once have the numbers, to the last bit, that each has alone."""

import random
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from dynid.bondgraph.graph import Port
from dynid.bondgraph.sampling.analysis import SampledAnalysis, shared
from dynid.errors import DynidError, Singular
from dynid.lti.signals import Step
from tests.bondgraph.graphs import build, chain, parse
from tests.bondgraph.graphs import port as port_of
from tests.bondgraph.random_graphs import coincident_graph, random_graph

pytestmark = pytest.mark.thorough

ASKED = frozenset({"transfer_function", "zeros", "poles", "properties", "hidden_modes"})
#: What the exact engine alone has the numbers for; beside these every path is compared.
ALONE = ("error_bound", "cause", "elements", "exact")


def alone(graph, analysis):
    try:
        return analyse(graph, analysis)
    except DynidError:
        return None


def assert_same(one, other):
    assert one.dims == other.dims
    assert one.units == other.units
    assert one.data.dtype == other.data.dtype
    if one.data.dtype == object:
        assert one.data.tolist() == other.data.tolist()
    else:
        assert one.data.tobytes() == other.data.tobytes()


def compared(graph, analysis, samples, *, skip=ALONE):
    """Run samples together and each alone; return how many were answered together."""
    results = [alone(graph.with_values(sample), analysis) for sample in samples]
    exemplar = next((result for result in results if result is not None), None)
    if exemplar is None:
        return 0
    wanted = [p for p in exemplar if shared([p], analysis) and not p.endswith(skip) and "/exact" not in p]
    try:
        family = SampledAnalysis(graph, analysis, list(samples[0]), wanted)
    except Singular:
        return 0
    values = {name: [sample[name] for sample in samples] for name in samples[0]}
    found = family.run(values, len(samples))
    answered = 0
    for result, told in zip(results, found, strict=True):
        if told is None:
            continue
        answered += 1
        assert result is not None, "a sample that fails alone has an answer"
        for path in wanted:
            if path in result:
                assert_same(told[path], result[path])
    halves = family.run({n: v[:1] for n, v in values.items()}, 1) + family.run(
        {n: v[1:] for n, v in values.items()}, len(samples) - 1
    )
    for whole, part in zip(found, halves, strict=True):
        assert (whole is None) == (part is None)
        for path in whole or ():
            assert_same(whole[path], part[path])
    return answered


@pytest.mark.thorough
@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 5), st.integers(0, 2))
def test_samples_of_a_random_graph(seed, junctions, loops):
    rng = random.Random(seed)
    types, values, bonds, inputs, (node, quantity) = random_graph(rng, junctions, loops)
    graph = build(types, values, bonds)
    varied = rng.sample(list(values), min(3, len(values)))
    analysis = Analysis(tuple(inputs), (Port(node, quantity),), ASKED)
    samples = [
        {
            name: Fraction(rng.randint(1, 400), rng.randint(1, 90)) * rng.choice([1, 1, 1, -1])
            for name in varied
        }
        for _ in range(4)
    ]
    if varied:
        compared(graph, analysis, samples)


@pytest.mark.thorough
@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 4))
def test_samples_full_of_coincidences(seed, junctions):
    rng = random.Random(seed)
    types, values, bonds, inputs, (node, quantity) = coincident_graph(rng, junctions)
    graph = build(types, values, bonds)
    varied = rng.sample(list(values), min(3, len(values)))
    analysis = Analysis(tuple(inputs), (Port(node, quantity),), ASKED)

    def value(name):
        zero = types[name] not in ("TF", "GY") and rng.random() < 0.15
        return Fraction(0 if zero else rng.choice([1, 1, 1, 2, -1]))

    if varied:
        compared(graph, analysis, [{name: value(name) for name in varied} for _ in range(5)])


def stages(count):
    types, values, pairs = parse(*chain(count))
    return build(types, values, pairs), values


def test_a_chain_of_ten_stages_is_answered_together():
    graph, values = stages(10)
    rng = random.Random(4)
    varied = ["m1", "k3", "b5", "k10"]
    samples = [
        {name: values[name] * Fraction(rng.randint(500, 2000), 1000) for name in varied} for _ in range(5)
    ]
    analysis = Analysis(("F",), (port_of("m10.f"),), frozenset({"zeros", "poles", "properties"}))
    assert compared(graph, analysis, samples) == 5


def test_long_decimals_beside_what_varies():
    graph, values = stages(7)
    rng = random.Random(6)
    graph = graph.with_values(
        {name: value * Fraction(repr(rng.uniform(0.5, 2))) for name, value in values.items()}
    )
    samples = [{name: values[name] * k for name in ("m1", "k3", "b5", "k7")} for k in (1, 2)]
    analysis = Analysis(("F",), (port_of("m7.f"),), frozenset({"zeros", "poles", "properties"}))
    assert compared(graph, analysis, samples) == 2


def test_with_every_value_varied_the_plan_alone_is_shared():
    graph, values = stages(6)
    rng = random.Random(5)
    samples = [
        {name: value * Fraction(rng.randint(500, 2000), 1000) for name, value in values.items()}
        for _ in range(2)
    ]
    analysis = Analysis(("F",), (port_of("m6.f"),), frozenset({"zeros", "poles"}))
    assert compared(graph, analysis, samples, skip=("nothing",)) == 2


def test_responses_and_error_bounds_are_those_of_each_sample():
    graph, values = stages(2)
    samples = [{"m1": Fraction(k), "k2": values["k2"] * k} for k in (1, 2, 3)]
    analysis = Analysis(
        ("F",),
        (port_of("m2.f"), port_of("k1.e")),
        ASKED | {"frequency_response", "time_response"},
        omega=np.geomspace(0.1, 100, 7),
        times=np.linspace(0, 1, 5),
        signals=(("F", Step(1.0)),),
        initial={"m1": Fraction(1, 3)},
    )
    assert compared(graph, analysis, samples, skip=("nothing",)) == 3


def test_equal_stages_have_repeated_and_paired_roots():
    nodes = "Se F, 1 v, I m 2, C k 1, 0 z, 1 w, I n 2, C l 1, 1 x, I o 2, C p 1, R r 3"
    bonds = "F -> v, v -> m, v -> k, v -> z, z -> w, w -> n, w -> l, z -> x, x -> o, x -> p, v -> r"
    graph = build(*parse(nodes, bonds))
    samples = [{"r": Fraction(k), "m": Fraction(k, 3)} for k in (1, 2, 5)]
    for output in ("m.f", "o.f", "l.q"):
        assert compared(graph, Analysis(("F",), (port_of(output),), ASKED - {"hidden_modes"}), samples) == 3


@pytest.mark.parametrize(
    ("sample", "why"),
    [
        ({"r": Fraction(0), "k": Fraction(1)}, "a value of zero is another structure"),
        ({"r": Fraction(-2), "k": Fraction(1)}, "a pivot vanishes"),
    ],
)
def test_a_degenerate_sample_is_left_to_be_run_alone(sample, why):
    types, values, bonds = parse("Se u, 1 j, R r 1, R q 2, C k 1", "u -> j -> r, j -> q, j -> k")
    graph = build(types, values, bonds)
    analysis = Analysis(("u",), (port_of("k.e"),), frozenset({"poles"}))
    path = "bond_graph/transfer_function/k.e/u/poles"
    family = SampledAnalysis(graph, analysis, ["r", "k"], [path])
    fine = {"r": Fraction(3), "k": Fraction(1)}
    found = family.run({name: [sample[name], fine[name]] for name in fine}, 2)
    single = alone(graph.with_values(sample), analysis)
    if found[0] is not None:
        assert_same(found[0][path], single[path])
    else:
        assert why
    assert_same(found[1][path], analyse(graph.with_values(fine), analysis)[path])
