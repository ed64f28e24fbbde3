"""Words for messages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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
