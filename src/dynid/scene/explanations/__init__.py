"""What a run of a scene will do, told before it is done: causality, identifiability and cost."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING

from dynid.errors import NumericalError, UsageError
from dynid.result import Result
from dynid.scene.explanations.explanation import Explanation, Fact
from dynid.scene.schema.accuracy import aspects_of

if TYPE_CHECKING:
    from dynid.scene.load import Scene

#: For every kind the module that explains its scenes; studies are explained a floor above.
EXPLAINERS = {
    "bond-graph": "dynid.scene.explanations.bond_graph",
    "identification": "dynid.scene.explanations.identification",
    "reduction": "dynid.scene.explanations.reduction",
}


def explain(scene: Scene) -> Explanation:
    """Explain a valid scene of a kind that is run by itself.

    Parameters
    ----------
    scene
        The scene.

    Returns
    -------
    Explanation
        What will be modelled, chosen and computed, and what it costs. Where the run is bound to fail, its
        `obstacle` says why.

    Raises
    ------
    FileError
        Where a file that the scene names cannot be read.
    """
    try:
        explained: Explanation = import_module(EXPLAINERS[scene.kind]).explain(scene)
    except (NumericalError, UsageError) as error:  # before there is anything to tell
        return Explanation(Result(scene.kind, scene.title), [], obstacle=error)
    tried = getattr(scene.model, "accuracy", None)
    if tried is None:
        return explained
    what = ", ".join(tried.alternatives or aspects_of(scene.source.data))
    fact = Fact("accuracy", f"alternatives of {what} are tried after it, for at most {tried.budget:g} s")
    return replace(explained, facts=[*explained.facts, fact])
