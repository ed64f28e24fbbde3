"""Ten published bond graphs, as scenes: everything that is exact must come out exactly."""

import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import dynid
from tests.bondgraph.graphs import reduced, transfers

FOLDER = Path(__file__).parents[2] / "../shared/data/bondgraphs"
FILES = sorted(FOLDER.glob("*.json"))

pytestmark = pytest.mark.skipif(not FILES, reason=f"the published graphs are not at {FOLDER}")


def published(file):
    return json.loads(file.read_text(encoding="utf-8"))


def output_of(graph):
    return f"{graph['output']['element']}.{graph['output']['kind']}"


def scene_text(graph):
    nodes = [
        f"    {e['name']}: {{type: '{e['type']}'"
        + (f", value: {e['value_exact']}}}" if e["value_exact"] else "}")
        for e in graph["elements"]
    ]
    return "\n".join(
        [
            "dynid: 1",
            "kind: bond-graph",
            "graph:",
            "  nodes:",
            *nodes,
            "  bonds:",
            *(f"    - {tail} -> {head}" for tail, head in graph["bonds"]),
            "analysis:",
            f"  inputs: [{', '.join(graph['inputs'])}]",
            f"  outputs: [{output_of(graph)}]",
            "  results: [transfer_function, zeros, poles, properties, frequency_response, state_space]",
            "  frequency: {start: 0.01, stop: 100, points: 9}",
        ]
    )


def fractions(texts):
    return [Fraction(text) for text in texts]


def rounded(texts):
    return [float(value) for value in fractions(texts)]


def value_at(numerator, denominator, s):
    """Evaluate by Horner's rule in Gaussian rationals, kept as pairs; `s` is imaginary."""

    def horner(coefficients):
        re, im = Fraction(0), Fraction(0)
        for coefficient in coefficients:
            re, im = coefficient - im * s, re * s
        return re, im

    (a, b), (c, d) = horner(numerator), horner(denominator)
    size = c * c + d * d
    return complex(float((a * c + b * d) / size), float((b * c - a * d) / size))


def assert_same_roots(found, expected):
    """Match each expected root to a different found one; the file prints 17 digits of the exact roots."""
    left = list(found)
    assert len(left) == len(expected)
    for re, im in expected:
        nearest = min(left, key=lambda root: abs(root - complex(re, im)))
        # the published digits were rounded once, ours once more
        assert abs(nearest - complex(re, im)) <= 1e-15 * abs(nearest)
        left.remove(nearest)


@pytest.fixture(params=FILES, ids=lambda file: file.stem)
def graph(request):
    return published(request.param)


@pytest.fixture
def result(graph, tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text(scene_text(graph), encoding="utf-8")
    return dynid.run(dynid.load_scene(scene))


def channels(graph):
    return [(source, graph["expected"][source]) for source in graph["inputs"]]


def test_the_transfer_function_is_exactly_the_published_one(graph):
    types = {e["name"]: e["type"] for e in graph["elements"]}
    values = {e["name"]: Fraction(e["value_exact"]) for e in graph["elements"] if e["value_exact"]}
    found = transfers(reduced(types, values, graph["bonds"], graph["inputs"], output_of(graph)))
    for source, expected in channels(graph):
        channel = found[output_of(graph), source]
        lead = int(channel.denominator.leading_coefficient())
        for polynomial, name in ((channel.numerator, "num_exact"), (channel.denominator, "den_exact")):
            descending = [Fraction(int(c), lead) for c in reversed(polynomial.coeffs())]
            assert descending == fractions(expected[name]), name


def test_the_coefficients_of_the_scene_are_correctly_rounded(graph, result):
    for source, expected in channels(graph):
        group = f"bond_graph/transfer_function/{output_of(graph)}/{source}"
        assert result.value(f"{group}/numerator").tolist() == rounded(expected["num_exact"])
        assert result.value(f"{group}/denominator").tolist() == rounded(expected["den_exact"])


def test_zeros_and_poles_are_the_published_ones(graph, result):
    for source, expected in channels(graph):
        group = f"bond_graph/transfer_function/{output_of(graph)}/{source}"
        assert_same_roots(result.value(f"{group}/zeros"), expected["zeros"])
        assert_same_roots(result.value(f"{group}/poles"), expected["poles"])


def test_relative_degree_and_phase_are_the_published_ones(graph, result):
    for source, expected in channels(graph):
        group = f"bond_graph/properties/{output_of(graph)}/{source}"
        assert result.value(f"{group}/relative_degree") == expected["relative_degree"]
        assert result.value(f"{group}/minimum_phase") is expected["minimum_phase_zeros_strictly_LHP"]
        verdict = result.value(f"{group}/zero_stability")
        assert verdict.startswith("minimum phase") is expected["minimum_phase_zeros_strictly_LHP"]


def test_the_frequency_response_is_the_exact_one(graph, result):
    omega = result.value("bond_graph/frequency_response/omega")
    response = result.value("bond_graph/frequency_response/response")
    for place, (_, expected) in enumerate(channels(graph)):
        numerator, denominator = fractions(expected["num_exact"]), fractions(expected["den_exact"])
        exact = [value_at(numerator, denominator, Fraction(w)) for w in omega]
        assert (np.abs(response[:, 0, place] - exact) <= 1e-12 * np.abs(exact)).all()


def test_the_state_equations_have_the_published_poles(graph, result):
    found = np.linalg.eigvals(result.value("bond_graph/state_space/A"))
    scale = np.abs(found).max(initial=0.0)
    for source, expected in channels(graph):
        for re, im in expected["poles"]:
            # QR is backward stable with respect to the norm of A, which stiff graphs make large
            assert np.abs(found - complex(re, im)).min() <= 1e-12 * scale, source
