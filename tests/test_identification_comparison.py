"""`dynid compare` of two identifications of one record."""

import math
import re

import pytest

from dynid.checks.likelihoods import compare_identifications
from dynid.structure.joints import Joint
from dynid.structure.lumped import lumped
from tests.identification.cases import LINKS, MASSES, diagnostic, run, simulated, unknown


def model(c3=None, k3=None):
    joints = [
        Joint("j2", (2, 3), unknown(2e4), unknown(20.0)),
        Joint("j3", (3, 4), k3 or unknown(2e4), c3 or unknown(20.0)),
    ]
    return lumped(MASSES, LINKS, joints)


@pytest.fixture(scope="module")
def full():
    return run(model(), simulated(0.05))


@pytest.mark.parametrize(("c3", "preferred"), [(20.0, "first"), (22.0, "second")])
def test_the_smaller_model_is_preferred_where_it_is_right(full, c3, preferred):
    truth = model()
    small = run(model(c3), simulated(0.05), truth=truth)
    lines = compare_identifications(small, full)
    ratio = 2 * (diagnostic(full, "log_likelihood") - diagnostic(small, "log_likelihood"))
    said = next(line for line in lines if "likelihood ratio" in line)
    assert float(re.search(r"= ([-\d.e+]+);", said)[1]) == pytest.approx(ratio, rel=1e-3)
    assert "the first model is the second one with j3.c fixed (nested)" in said
    p = float(re.search(r"p-value is ([\d.e-]+)", said)[1])
    assert p == pytest.approx(math.erfc(math.sqrt(ratio / 2)), rel=0.05, abs=1e-300)
    assert f"BIC prefers the {preferred}" in "\n".join(lines)
    assert "no ratio of evidence" in lines[-1]


def test_models_with_other_unknowns_are_not_nested():
    small, other = (
        run(model(**known), simulated(0.05), truth=model()) for known in ({"c3": 20.0}, {"k3": 2e4})
    )
    assert any("not nested" in line for line in compare_identifications(small, other))


def test_other_records_are_not_compared(full):
    assert not compare_identifications(full, run(model(), simulated(0.05, seed=2)))
