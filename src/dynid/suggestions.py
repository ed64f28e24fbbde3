"""Names in messages: suggestions for misspelt ones, short paths, printable text."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

#: Control characters except line feed and tab; marks of writing direction; surrogates.
_CONTROL = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)

#: Least similarity of a suggestion; most candidates compared in full (scenes may have thousands of faults).
_CLOSE, _MOST = 0.7, 30
#: Last parts of dotted paths that are no names by themselves.
_BARE = frozenset({"value", "start", "true", "min", "max"})


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
    """Return a suggestion for a path into a result: a path or group whose name is the same or similar.

    The name counts first: `bond_graph/poles` is nearer to the poles of a transfer function than to
    `bond_graph/properties`. Without a similar name, the contents of the nearest group are listed.
    """
    every = _with_groups(candidates, "/")
    if alike := _alike_paths(path, every, "/"):
        group, _, name = alike[0].rpartition("/")
        count = len(alike) - 1
        more = f" ({count} more {'ends' if count == 1 else 'end'} so: */{name})"
        return f"; did you mean '{alike[0]}'{more if '/' not in path and count else ''}?"
    group = path.rpartition("/")[0]
    while group and group not in every:
        group = group.rpartition("/")[0]
    held = [known.rpartition("/")[2] for known in every if group and known.rpartition("/")[0] == group]
    return f"; '{group}' holds {shortened(held, 8)}" if held else did_you_mean(path, every)


def nearest_values(path: str, data: object) -> list[str]:
    """Return the whole dotted paths of values of a scene with the same name as a path, or a similar one.

    Of a node, joint or unknown parameter they are its `value` or `start`. Parameters stand first.
    """
    values = [known for known in _values(data, "") if known != path]
    values.sort(key=lambda known: not known.startswith("parameters."))
    above, _, last = path.rpartition(".")
    path = above if above and last in _BARE else path
    alike = _alike_paths(path, _with_groups(values, "."), ".")
    nearest = [
        known
        for known in alike
        if _shared_parts(known, path, ".")[0] == _shared_parts(alike[0], path, ".")[0]
    ]
    parameters = [known for known in nearest if known.startswith("parameters.")]  # which nodes refer to
    whole: dict[str, None] = {}
    for known in parameters or nearest:
        below = [value for value in values if value == known or value.startswith(f"{known}.")]
        first = [value for value in below if value.rpartition(".")[2] in ("value", "start")]
        whole |= dict.fromkeys(first or below)
    return list(whole)


def _values(data: object, above: str) -> Iterator[str]:
    """Yield the dotted paths of the values in nested mappings, and in lists of these."""
    if isinstance(data, list) and any(isinstance(each, dict) for each in data):
        data = dict(enumerate(data))
    if not isinstance(data, dict):
        yield above
        return
    for key, value in data.items():
        yield from _values(value, f"{above}.{key}" if above else str(key))


def _with_groups(candidates: Iterable[str], separator: str) -> dict[str, None]:
    """Return paths, each followed by the groups that hold it."""
    every: dict[str, None] = {}
    for candidate in candidates:
        while candidate and candidate not in every:
            every[candidate] = None
            candidate = candidate.rpartition(separator)[0]  # noqa: PLW2901 - from the path to its groups
    return every


def _alike_paths(path: str, every: Iterable[str], separator: str) -> list[str]:
    """Return the paths whose name is that of a path, or else a similar one; the nearest first."""
    names: dict[str, list[str]] = {}
    for known in every:
        names.setdefault(known.rpartition(separator)[2], []).append(known)
    group, _, name = path.rpartition(separator)
    if name not in names:  # a similar name, in a group of which the path has a part
        near = {
            last: None
            for last, paths in names.items()
            if not group or any(_shared_parts(known, path, separator)[0] for known in paths)
        }
        name = did_you_mean(name, near).removeprefix("; did you mean '").removesuffix("'?")
    return sorted(names.get(name, []), key=lambda known: _shared_parts(known, path, separator), reverse=True)


def _shared_parts(one: str, other: str, separator: str) -> tuple[int, int]:
    """Return the number of common parts of two paths, and of common characters at their ends."""
    return len(set(one.split(separator)) & set(other.split(separator))), _shared_ends(one, other)


def short_paths(paths: Sequence[str]) -> list[str]:
    """Return the shortest meaningful ends of dotted paths where these differ, else the paths."""
    ends = []
    for path in paths:  # the last parts, from one that is neither a number nor a bare word
        parts = path.split(".")
        names = [place for place, part in enumerate(parts) if not part.isdigit() and part not in _BARE]
        ends.append(path if "," in path else ".".join(parts[names[-1] if names else 0 :]))
    return ends if len(set(ends)) == len(ends) else list(paths)


def distinct_ends(paths: Sequence[str]) -> list[str]:
    """Return of each path the shortest end, of whole parts between slashes, that no other path has.

    Labels in brackets may have slashes too; they belong to the last part.
    """
    every = []
    for path in paths:
        groups, bracket, labels = path.partition("[")
        parts = groups.split("/")
        every.append([*parts[:-1], f"{parts[-1]}{bracket}{labels}"])
    counts = Counter("/".join(parts[k:]) for parts in every for k in range(len(parts)))
    return [
        next((end for k in range(len(parts), 0, -1) if counts[end := "/".join(parts[k - 1 :])] == 1), path)
        for path, parts in zip(paths, every, strict=True)
    ]


def without_decimal_comma(text: str) -> str:
    """Return what to write for a number with a comma, such as `0,02`; empty for other texts."""
    match = re.fullmatch(r"\s*([-+]?\d+),(\d+(?:[eE][-+]?\d+)?)\s*", text)
    if match is None:
        return ""
    number = f"{match[1]}.{match[2]}"
    # Three digits behind a comma may be thousands.
    other = f" or {match[1]}{match[2]}" if re.fullmatch(r"\d{3}", match[2]) and int(match[1]) else ""
    return f"decimals stand behind a point: did you mean {number}{other}?"
