"""Words for messages."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import SequenceMatcher


def did_you_mean(word: str, candidates: Iterable[str]) -> str:
    """Say "; did you mean 'x'?" for the candidate closest to a word, or nothing when none is close."""
    if len(word) > 100:
        return ""
    lowered = word.lower()
    matcher = SequenceMatcher(None, "", lowered, autojunk=False)
    best, closest = 0.7, ""
    for candidate in candidates:
        other = candidate.lower()
        # Short names (TF, GY, m_1) share few characters; their length and first letter tell more.
        bonus = 0.2 * (other[:1] == lowered[:1]) + 0.1 * (len(other) == len(lowered))
        matcher.set_seq1(other)
        if matcher.real_quick_ratio() + bonus > best and matcher.ratio() + bonus > best:
            best, closest = matcher.ratio() + bonus, candidate
    return f"; did you mean '{closest}'?" if closest else ""
