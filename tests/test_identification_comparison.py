"""`dynid compare` of two identifications of one record."""

import math
import re

import numpy as np
import pytest

from dynid.checks.comparison import compare_identifications
from dynid.result import Result
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


@pytest.mark.thorough
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


def identified(bic=0.0, names=("a", "b"), values=(1.0, 2.0), evidence=None, reason=None):
    """Return an identification from a record, as far as a comparison reads it."""
    result = Result("identification")
    for name, value in {"log_likelihood": -bic / 2, "bic": bic, "free_parameters": len(names)}.items():
        result.add(f"identification/diagnostics/{name}", value)
    result.add_axis("identification/parameters/name", list(names))
    if values is not None:
        result.add_axis("identification/measurement/measured", np.array(values))
    if evidence is not None:
        result.add("identification/posterior/log_evidence", evidence)
    if reason:
        result.annotate("identification/posterior", no_evidence=reason)
    return result


@pytest.mark.parametrize(
    ("apart", "said"), [(0.5, "hardly"), (-2.5, "positively"), (4.0, "strongly"), (-6.0, "very strongly")]
)
def test_evidence_and_bic_prefer_in_the_words_of_kass_and_raftery(apart, said):
    """From 2, 6 and 10 on, of differences of BIC and twice those of the logarithm of the evidence."""
    better = "second" if apart > 0 else "first"
    *_, bic, evidence = compare_identifications(
        identified(2 * apart, evidence=3.0), identified(evidence=3 + apart)
    )
    assert bic == f"  BIC prefers the {better} {said}: it is less by {2 * abs(apart):.4g}"
    assert evidence == f"  evidence prefers the {better} {said}: the ratio is exp({abs(apart):.4g})"


def test_equal_criteria_prefer_neither_and_evidence_needs_both():
    *_, bic, evidence = compare_identifications(identified(), identified(evidence=1.0))
    assert bic == "  BIC prefers neither"
    assert evidence == "  no ratio of evidence (first: computed with posterior_check: true)"
    *_, evidence = compare_identifications(identified(evidence=1.0), identified(reason="not Gaussian"))
    assert evidence == "  no ratio of evidence (second: not Gaussian)"


@pytest.mark.parametrize("values", [None, (1.0, 2.0, 3.0), (1.0, 2.0 + 1e-8)])
def test_records_of_other_values_are_not_compared(values):
    assert compare_identifications(identified(), identified(values=(1.0, 2.0 + 1e-10)))
    assert not compare_identifications(identified(), identified(values=values))
    assert not compare_identifications(identified(values=None), identified(values=None))
