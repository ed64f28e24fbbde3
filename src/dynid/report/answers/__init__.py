"""What a result says, as facts and tables: the reader's question first, then how it is known."""

from __future__ import annotations

from importlib import import_module

from dynid.report.answers.blocks import Answer, Part
from dynid.report.answers.common import accuracy, doubtful, expectations, need, responses
from dynid.result import Result

_KINDS = {
    "bond-graph": "dynid.report.answers.bond_graph",
    "identification": "dynid.report.answers.identification",
    "reduction": "dynid.report.answers.reduction",
    "plan": "dynid.report.answers.plan",
    "bench": "dynid.report.answers.bench",
    "study": "dynid.report.answers.study",
}


def answer(result: Result) -> Answer:
    """Return what a result says.

    Parameters
    ----------
    result
        Of any kind; of an unknown one nothing but its name is known.
    """
    if result.kind not in _KINDS:
        return Answer(method(result))
    parts: list[Part] = [
        *import_module(_KINDS[result.kind]).parts(result),
        *responses(result),
        *doubtful(result),
        *expectations(result),
        *need(result),
        *accuracy(result),
    ]
    return Answer(method(result), tuple(parts))


def method(result: Result) -> str:
    """Name the kind of analysis, and how it was done."""
    if result.kind not in _KINDS:
        return result.kind
    return str(import_module(_KINDS[result.kind]).method(result))
