"""The screen of what a run will do and cost."""

from __future__ import annotations

import math
from collections.abc import Iterator
from textwrap import wrap

from dynid.cli.summary.causality import causality_lines
from dynid.cli.summary.identifiability import identifiability_lines
from dynid.scene.explanations.explanation import CostEstimate, Explanation

#: Seconds below which a part of the work is not worth a word, and the share of the whole.
_LEAST, _SHARE = 0.5, 0.1


def explanation_lines(explained: Explanation) -> Iterator[str]:
    """Yield the screen, line by line: what is known, a part after the other, and what it costs."""
    parts = [
        [line for fact in explained.facts for line in _hanging(fact.topic, fact.text)],
        list(causality_lines(explained.result)),
        identifiability_lines(explained.result),
        [] if explained.cost is None else list(_cost(explained.cost)),
    ]
    for part in filter(None, parts):
        yield ""
        yield from "\n".join(part).rstrip("\n").split("\n")
    yield ""


def _hanging(topic: str, text: str) -> Iterator[str]:
    first, *rest = wrap(text, 94, break_long_words=False) or [""]
    yield f"  {topic:<10}  {first}"
    yield from (f"{'':14}{line}" for line in rest)


def _cost(cost: CostEstimate) -> Iterator[str]:
    memory, file = size_text(1e6 * cost.megabytes), size_text(1e3 * cost.kilobytes)
    yield from _hanging("cost", f"{seconds_text(cost.seconds)}, {memory} of memory; a file of about {file}")
    large = sorted(cost.parts.items(), key=lambda part: -part[1])
    large = [(name, each) for name, each in large if each > max(_LEAST, _SHARE * cost.seconds)]
    if large:
        yield from _hanging("", "; ".join(f"{name} {seconds_text(each)}" for name, each in large))


def seconds_text(seconds: float) -> str:
    """Say how long something takes, as well as one can know."""
    if seconds < 0.5:
        return "well under a second"
    if seconds < 1.5:
        return "about a second"
    if seconds < 90:
        return f"about {_rounded(seconds)} s"
    if seconds < 90 * 60:
        return f"about {_rounded(seconds / 60)} min"
    return f"about {_rounded(seconds / 3600)} h"


def size_text(size: float) -> str:
    """Say how many bytes something takes."""
    for unit, name in ((1e9, "GB"), (1e6, "MB")):
        if size >= unit:
            return f"{_rounded(size / unit)} {name}"
    return f"{_rounded(size / 1e3)} kB"


def _rounded(value: float) -> str:
    """Write a number with the two digits that mean something, one of them below 10."""
    digits = 1 if value >= 10 else 0
    decimals = digits - math.floor(math.log10(value)) if value > 0 else 0
    return f"{round(value, decimals):,.{max(0, decimals)}f}"
