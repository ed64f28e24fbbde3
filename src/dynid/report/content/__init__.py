"""Content of the report of a result: sections of definitions, tables, statements and formulas."""

from __future__ import annotations

from typing import Any

from dynid.report.content.blocks import Content, Section
from dynid.report.content.common import accuracy, doubtful, expectations, need, responses
from dynid.result import Result
from dynid.scene.kind import KINDS, resolve

#: Content of results that are of no kind of scene.
_OTHERS = {
    "plan": "dynid.report.content.plan",
    "bench": "dynid.report.content.bench",
}


def _module(result: Result) -> Any:
    """Return the module with the content of results of a kind; None for an unknown kind."""
    kind = KINDS.get(result.kind)
    return kind.load("content") if kind else resolve(_OTHERS.get(result.kind, ""))


def content(result: Result) -> Content:
    """Return the content of the report of a result; of an unknown kind, its name only."""
    module = _module(result)
    if module is None:
        return Content(result.kind)
    sections: list[Section] = [
        *module.sections(result),
        *responses(result),
        *doubtful(result),
        *expectations(result),
        *need(result),
        *accuracy(result),
    ]
    return Content(str(module.method(result)), tuple(sections))


def method(result: Result) -> str:
    """Return the kind of analysis and its method; of an unknown kind, its name."""
    module = _module(result)
    return result.kind if module is None else str(module.method(result))
