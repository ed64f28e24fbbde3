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
    return _CONTROL.sub(lambda match: match[0].encode("unicode_escape").decode(), text)


def shortened(texts: Sequence[str], max_items: int = 12, separator: str = ", ") -> str:
    """Write a list of texts: of a long one the first, and the number of the others."""
    more = len(texts) - max_items
    return separator.join([*texts[:max_items], *([f"and {more} more"] if more > 0 else [])])


def did_you_mean(word: str, candidates: Iterable[str]) -> str:
    """Return "; did you mean 'x'?" for the candidate most similar to a word, or '' where none is similar."""
    import heapq  # here, since every command loads this module to print
    from difflib import SequenceMatcher

    if len(word) > 100:
        return ""
    lowered = word.lower()

    def bonus(candidate: str) -> float:
        # Short names (TF, GY, m_1) share few characters; their length and first letter distinguish them.
        alike = len(candidate) == len(lowered) or lowered.startswith(candidate)
        return 0.2 * (candidate[:1] == lowered[:1]) + 0.1 * alike

    def at_most(candidate: str) -> float:
        return 2 * min(len(candidate), len(lowered)) / max(len(candidate) + len(lowered), 1) + bonus(
            candidate
        )

    near = [(name, lowered_name) for name in candidates if at_most(lowered_name := name.lower()) > _CLOSE]
    if len(near) > _MOST:
        near = heapq.nlargest(_MOST, near, key=lambda pair: _shared_ends(pair[1], lowered) - len(pair[1]) / 2)
    matcher = SequenceMatcher(None, "", lowered, autojunk=False)
    best, closest = _CLOSE, ""
    for name, lowered_name in near:
        matcher.set_seq1(lowered_name)
        if at_most(lowered_name) > best and matcher.ratio() + bonus(lowered_name) > best:
            best, closest = matcher.ratio() + bonus(lowered_name), name
    return f"; did you mean '{closest}'?" if closest else ""


def _shared_ends(a: str, b: str) -> int:
    """Return the number of common characters at the beginnings and ends of two words."""
    shorter, ahead, behind = min(len(a), len(b)), 0, 0
    while ahead < shorter and a[ahead] == b[ahead]:
        ahead += 1
    while behind < shorter - ahead and a[-1 - behind] == b[-1 - behind]:
        behind += 1
    return ahead + behind


def did_you_mean_path(path: str, candidates: Iterable[str]) -> str:
    """Return a suggestion for a path into a result: a path or group whose name is the same or similar.

    The name counts first: `bond_graph/poles` is nearer to the poles of a transfer function than to
    `bond_graph/properties`. Without a similar name, the contents of the nearest group are listed.
    """
    paths = _with_groups(candidates, "/")
    if alike := _alike_paths(path, paths, "/"):
        group, _, name = alike[0].rpartition("/")
        count = len(alike) - 1
        more = f" ({count} more {'ends' if count == 1 else 'end'} so: */{name})"
        return f"; did you mean '{alike[0]}'{more if '/' not in path and count else ''}?"
    group = path.rpartition("/")[0]
    while group and group not in paths:
        group = group.rpartition("/")[0]
    held = [
        candidate.rpartition("/")[2] for candidate in paths if group and candidate.rpartition("/")[0] == group
    ]
    return f"; '{group}' holds {shortened(held, 8)}" if held else did_you_mean(path, paths)


def nearest_values(path: str, data: object) -> list[str]:
    """Return the whole dotted paths of values of a scene with the same name as a path, or a similar one.

    Of a node, joint or unknown parameter they are its `value` or `start`. Parameters stand first.
    """
    values = [candidate for candidate in _values(data, "") if candidate != path]
    values.sort(key=lambda candidate: not candidate.startswith("parameters."))
    above, _, last = path.rpartition(".")
    path = above if above and last in _BARE else path
    alike = _alike_paths(path, _with_groups(values, "."), ".")
    nearest = [
        candidate
        for candidate in alike
        if _shared_parts(candidate, path, ".")[0] == _shared_parts(alike[0], path, ".")[0]
    ]
    parameters = [
        candidate for candidate in nearest if candidate.startswith("parameters.")
    ]  # which nodes refer to
    branches: dict[str, None] = {}
    for candidate in parameters or nearest:
        below = [value for value in values if value == candidate or value.startswith(f"{candidate}.")]
        first = [value for value in below if value.rpartition(".")[2] in ("value", "start")]
        branches |= dict.fromkeys(first or below)
    return list(branches)


def _values(data: object, above: str) -> Iterator[str]:
    """Yield the dotted paths of the values in nested mappings, and in lists of these."""
    if isinstance(data, list) and any(isinstance(item, dict) for item in data):
        data = dict(enumerate(data))
    if not isinstance(data, dict):
        yield above
        return
    for key, value in data.items():
        yield from _values(value, f"{above}.{key}" if above else str(key))


def _with_groups(candidates: Iterable[str], separator: str) -> dict[str, None]:
    """Return paths, each followed by the groups that hold it."""
    paths: dict[str, None] = {}
    for candidate in candidates:
        while candidate and candidate not in paths:
            paths[candidate] = None
            candidate = candidate.rpartition(separator)[0]  # noqa: PLW2901 - from the path to its groups
    return paths


def _alike_paths(path: str, listed: Iterable[str], separator: str) -> list[str]:
    """Return the paths whose name is that of a path, or else a similar one; the nearest first."""
    names: dict[str, list[str]] = {}
    for candidate in listed:
        names.setdefault(candidate.rpartition(separator)[2], []).append(candidate)
    group, _, name = path.rpartition(separator)
    if name not in names:  # a similar name, in a group of which the path has a part
        near = {
            last: None
            for last, paths in names.items()
            if not group or any(_shared_parts(candidate, path, separator)[0] for candidate in paths)
        }
        name = did_you_mean(name, near).removeprefix("; did you mean '").removesuffix("'?")
    return sorted(
        names.get(name, []), key=lambda candidate: _shared_parts(candidate, path, separator), reverse=True
    )


def _shared_parts(a: str, b: str, separator: str) -> tuple[int, int]:
    """Return the number of common parts of two paths, and of common characters at their ends."""
    return len(set(a.split(separator)) & set(b.split(separator))), _shared_ends(a, b)


def short_paths(paths: Sequence[str]) -> list[str]:
    """Return the shortest meaningful ends of dotted paths where these differ, else the paths."""
    ends = []
    for path in paths:  # the last parts, from one that is neither a number nor a bare word
        parts = path.split(".")
        names = [index for index, word in enumerate(parts) if not word.isdigit() and word not in _BARE]
        ends.append(path if "," in path else ".".join(parts[names[-1] if names else 0 :]))
    return ends if len(set(ends)) == len(ends) else list(paths)


def distinct_ends(paths: Sequence[str]) -> list[str]:
    """Return of each path the shortest end, of whole parts between slashes, that no other path has.

    Labels in brackets may have slashes too; they belong to the last part.
    """
    ends = []
    for path in paths:
        groups, bracket, labels = path.partition("[")
        parts = groups.split("/")
        ends.append([*parts[:-1], f"{parts[-1]}{bracket}{labels}"])
    counts = Counter("/".join(parts[k:]) for parts in ends for k in range(len(parts)))
    return [
        next((end for k in range(len(parts), 0, -1) if counts[end := "/".join(parts[k - 1 :])] == 1), path)
        for path, parts in zip(paths, ends, strict=True)
    ]


def without_decimal_comma(text: str) -> str:
    """Return what to write for a number with a comma, such as `0,02`; empty for other texts."""
    match = re.fullmatch(r"\s*([-+]?\d+),(\d+(?:[eE][-+]?\d+)?)\s*", text)
    if match is None:
        return ""
    number = f"{match[1]}.{match[2]}"
    # Three digits behind a comma may be thousands.
    alternative = f" or {match[1]}{match[2]}" if re.fullmatch(r"\d{3}", match[2]) and int(match[1]) else ""
    return f"decimals stand behind a point: did you mean {number}{alternative}?"
