"""Names in messages: suggestions for misspelt ones, short paths, printable text."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

#: Control characters except line feed and tab; marks of writing direction; surrogates.
_CONTROL = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)

#: Least similarity of a suggestion; most candidates compared in full (scenes may have thousands of faults).
_CLOSE, _MOST = 0.7, 30


def printable(text: str) -> str:
    """Return a text with its control characters written as escapes; line feeds and tabs stay."""
    return _CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def shortened(texts: Sequence[str], most: int = 12, separator: str = ", ") -> str:
    """Write a list of texts: of a long one the first, and the number of the others."""
    more = len(texts) - most
    return separator.join([*texts[:most], *([f"and {more} more"] if more > 0 else [])])


def did_you_mean(word: str, candidates: Iterable[str]) -> str:
    """Return "; did you mean 'x'?" for the candidate most similar to a word, or '' where none is similar."""
    import heapq  # here, since every command loads this module to print
    from difflib import SequenceMatcher

    if len(word) > 100:
        return ""
    lowered = word.lower()

    def bonus(other: str) -> float:
        # Short names (TF, GY, m_1) share few characters; their length and first letter distinguish them.
        alike = len(other) == len(lowered) or lowered.startswith(other)
        return 0.2 * (other[:1] == lowered[:1]) + 0.1 * alike

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
    """Return the number of common characters at the beginnings and ends of two words."""
    least, ahead, behind = min(len(one), len(other)), 0, 0
    while ahead < least and one[ahead] == other[ahead]:
        ahead += 1
    while behind < least - ahead and one[-1 - behind] == other[-1 - behind]:
        behind += 1
    return ahead + behind


def did_you_mean_path(path: str, candidates: Iterable[str]) -> str:
    """Return a suggestion for a path into a result: a path, or a group of the same depth."""
    depth = path.count("/") + 1
    near = ("/".join(candidate.split("/")[:depth]) for candidate in candidates)
    return did_you_mean(path, dict.fromkeys(near))


#: Last parts of dotted paths that are no names by themselves.
_BARE = frozenset({"value", "start", "true", "min", "max"})


def short_paths(paths: Sequence[str]) -> list[str]:
    """Return the shortest meaningful ends of dotted paths where these differ, else the paths."""
    ends = []
    for path in paths:  # the last parts, from one that is neither a number nor a bare word
        parts = path.split(".")
        names = [place for place, part in enumerate(parts) if not part.isdigit() and part not in _BARE]
        ends.append(path if "," in path else ".".join(parts[names[-1] if names else 0 :]))
    return ends if len(set(ends)) == len(ends) else list(paths)
