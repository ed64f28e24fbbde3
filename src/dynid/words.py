"""Words for messages."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Sequence
from difflib import SequenceMatcher

#: How close a candidate must be, and how many are compared in full: scenes may have thousands of wrong names.
_CLOSE, _MOST = 0.7, 30


def did_you_mean(word: str, candidates: Iterable[str]) -> str:
    """Say "; did you mean 'x'?" for the candidate closest to a word, or nothing when none is close."""
    if len(word) > 100:
        return ""
    lowered = word.lower()

    def bonus(other: str) -> float:
        # Short names (TF, GY, m_1) share few characters; their length and first letter tell more.
        return 0.2 * (other[:1] == lowered[:1]) + 0.1 * (len(other) == len(lowered))

    def at_most(other: str) -> float:
        return 2 * min(len(other), len(lowered)) / max(len(other) + len(lowered), 1) + bonus(other)

    near = [(name, other) for name in candidates if at_most(other := name.lower()) > _CLOSE]
    if len(near) > _MOST:
        near = heapq.nlargest(_MOST, near, key=lambda each: _shared_ends(each[1], lowered) - len(each[1]) / 2)
    matcher = SequenceMatcher(None, "", lowered, autojunk=False)
    best, closest = _CLOSE, ""
    for name, other in near:
        matcher.set_seq1(other)
        if at_most(other) > best and matcher.ratio() + bonus(other) > best:
            best, closest = matcher.ratio() + bonus(other), name
    return f"; did you mean '{closest}'?" if closest else ""


def _shared_ends(one: str, other: str) -> int:
    """Return how many characters two words share at their beginnings and ends."""
    least, ahead, behind = min(len(one), len(other)), 0, 0
    while ahead < least and one[ahead] == other[ahead]:
        ahead += 1
    while behind < least - ahead and one[-1 - behind] == other[-1 - behind]:
        behind += 1
    return ahead + behind


def did_you_mean_path(path: str, candidates: Iterable[str]) -> str:
    """Say the same of a path into a result: for paths, and for groups as deep as it is."""
    depth = path.count("/") + 1
    near = ("/".join(candidate.split("/")[:depth]) for candidate in candidates)
    return did_you_mean(path, dict.fromkeys(near))


#: Last parts of dotted paths that say nothing by themselves.
_BARE = frozenset({"value", "start", "true", "min", "max"})


def short_paths(paths: Sequence[str]) -> list[str]:
    """Return the ends of dotted paths that still say what they are, where these tell them apart."""
    ends = [path if "," in path else _end(path) for path in paths]
    return ends if len(set(ends)) == len(ends) else list(paths)


def _end(path: str) -> str:
    """Return the last parts of a dotted path, from one that is neither a number nor a bare word."""
    parts = path.split(".")
    telling = [place for place, part in enumerate(parts) if not part.isdigit() and part not in _BARE]
    return ".".join(parts[telling[-1] if telling else 0 :])
