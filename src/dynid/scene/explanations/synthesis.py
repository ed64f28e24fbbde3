"""Explanation of a synthesis: the wanted function, and the forms that exist."""

from __future__ import annotations

import time
from typing import cast

from dynid.bondgraph.synthesis.forms import kind_of, realisations
from dynid.number_format import counted
from dynid.result import Result
from dynid.scene.explanations.explanation import (
    CostEstimate,
    Explanation,
    Fact,
    file_kilobytes,
    peak_megabytes,
)
from dynid.scene.kinds.synthesis import wanted
from dynid.scene.load import Scene
from dynid.scene.schema.synthesis import SynthesisScene


def explain(scene: Scene) -> Explanation:
    """Return the explanation of a scene of kind `synthesis`, whose forms are made: that takes no time."""
    model = cast("SynthesisScene", scene.model)
    began = time.thread_time()
    function = wanted(scene)
    what = "admittance" if function.admittance else "impedance"
    degree = max(function.numerator.degree(), function.denominator.degree())
    facts = [Fact("function", f"a positive real {what} of degree {degree}: {kind_of(*function.impedance)}")]
    found, missing = realisations(function, None if model.forms is None else tuple(model.forms))
    for place, one in enumerate(found):
        text = f"{one.form}: {counted(len(one.graph.nodes), 'node')}, {counted(len(one.graph.bonds), 'bond')}"
        facts.append(Fact("forms" if place == 0 else "", text))
    facts += [Fact("", f"no {form}: {why}") for form, why in missing.items()]
    parts = {"synthesis": time.thread_time() - began}
    values = sum(3 * len(one.graph.nodes) for one in found)
    kilobytes = file_kilobytes(8 + 14 * len(found), values)
    return Explanation(
        Result("synthesis", scene.title), facts, CostEstimate(parts, peak_megabytes(), kilobytes)
    )
