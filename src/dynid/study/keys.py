"""Keys of samples: hashes of all that their outcomes depend on.

Samples with equal keys have equal outcomes, in any study: the key covers the scene with the values of the
sample, the contents of every file that it names, the outputs to collect, and the version of this format,
which increases when the same scene would give other numbers.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.scene.yaml.source import set_values

if TYPE_CHECKING:
    from dynid.study.plan import Plan

FORMAT = 1
SIZE = 16  # bytes: the probability of equal keys of any two of 10^7 samples is 10^-24
_FILE_CHUNK_BYTES = 2**20
_SAMPLE_BLOCK = 4096  # samples whose values are in memory as text at a time

Keys = NDArray[np.uint8]
"""Keys of samples (samples x bytes)."""


class Keyring:
    """Factory of the keys of the samples of a plan, whose scene is written as text once, with gaps."""

    def __init__(self, plan: Plan) -> None:
        self._folder = plan.base.folder
        self._digests: dict[str, bytes] = {}
        gaps = {path: f"\0{index}\0" for index, path in enumerate(plan.settings)}
        data = dict(set_values(plan.base.source, gaps).data)
        data.pop("title", None)  # it changes no number
        document = {"format": FORMAT, "collect": sorted(plan.collect), "scene": data}
        first, *parts = _canonical(document).split('"\\u0000')
        gaps_and_pieces = [text.partition('\\u0000"') for text in parts]
        self._places = [int(gap) for gap, _, _ in gaps_and_pieces]  # of the paths in the plan, one per gap
        files = _files(self._folder, _texts(data))
        self._common = hashlib.sha256(b"".join(self._digest(file) for file in files))
        self._common.update(first.encode())
        pieces = [piece.encode().replace(b"%", b"%%") for _, _, piece in gaps_and_pieces]
        self._form = b"%s".join([b"", *pieces])

    def keys(self, columns: Sequence[Sequence[Any]], count: int) -> Keys:
        """Return the keys of `count` samples from their values at each path that is set, in its order."""
        columns_encoded = [self._encoded_column(columns[index]) for index in self._places]
        rows = zip(*columns_encoded, strict=True) if columns_encoded else iter([()] * count)
        digests = b"".join(self._hashed(row) for row in rows)
        return np.frombuffer(digests, np.uint8).reshape(count, SIZE)

    def _hashed(self, encoded: Sequence[bytes]) -> bytes:
        digest = self._common.copy()
        digest.update(self._form % tuple(encoded))
        return digest.digest()[:SIZE]

    def _encoded_column(self, values: Sequence[Any]) -> list[bytes]:
        """Return values as texts, each followed by the hashes of the files that it names."""
        if {*map(type, values)} == {float} and all(map(isfinite, values)):
            return " ".join(map(repr, values)).encode().split()
        return [self._encoded(value) for value in values]

    def _encoded(self, value: Any) -> bytes:
        digests = [self._digest(file) for file in _files(self._folder, _texts(value))]
        return b"".join([_canonical(value).encode(), *digests])

    def _digest(self, file: Path) -> bytes:
        """Return the hash of a file's contents; of its name, if it cannot be read."""
        name = str(file)
        if name not in self._digests:
            digest = hashlib.sha256()
            try:
                with file.open("rb") as content:
                    while chunk := content.read(_FILE_CHUNK_BYTES):
                        digest.update(chunk)
            except OSError:
                digest.update(name.encode())
            self._digests[name] = digest.digest()
        return self._digests[name]


def sample_keys(plan: Plan, numbers: Sequence[int] | NDArray[np.int64]) -> Keys:
    """Return the keys of samples of a plan (samples x bytes)."""
    ring, parts = Keyring(plan), [np.empty((0, SIZE), np.uint8)]
    for start in range(0, len(numbers), _SAMPLE_BLOCK):
        some = numbers[start : start + _SAMPLE_BLOCK]
        parts.append(ring.keys([plan.values(path, some) for path in plan.settings], len(some)))
    return np.concatenate(parts)


def found_in(keys: Keys, requested: Keys) -> NDArray[np.int64]:
    """Return the last index of each wanted key among the known ones; -1 if it is not there."""
    if not len(keys):
        return np.full(len(requested), -1, dtype=np.int64)
    order = np.argsort(as_texts(keys), kind="stable")
    ordered, texts = as_texts(keys)[order], as_texts(requested)
    last = np.searchsorted(ordered, texts, side="right") - 1
    hit = (last >= 0) & (ordered[np.maximum(last, 0)] == texts)
    return np.where(hit, order[np.maximum(last, 0)], -1)


def as_texts(keys: Keys) -> NDArray[np.bytes_]:
    """Return keys as byte strings, which can be sorted."""
    texts: NDArray[np.bytes_] = np.ascontiguousarray(keys).view(f"S{SIZE}").reshape(len(keys))
    return texts


def _canonical(value: Any) -> str:
    return json.dumps(_with_text_keys(value), sort_keys=True, ensure_ascii=False, separators=(",", ":"))


def _with_text_keys(value: Any) -> Any:
    """Return data with numeric keys of mappings as texts that no text key equals."""
    if isinstance(value, dict):
        return {
            key if isinstance(key, str) else f"\1{key}": _with_text_keys(entry)
            for key, entry in value.items()
        }
    return [_with_text_keys(entry) for entry in value] if isinstance(value, list) else value


def _texts(value: Any) -> Iterator[str]:
    stack = [value]
    while stack:
        entry = stack.pop()
        if isinstance(entry, dict):
            stack += entry.values()
        elif isinstance(entry, list):
            stack += entry
        elif isinstance(entry, str):
            yield entry


def _files(folder: Path, texts: Iterator[str]) -> list[Path]:
    files = set()
    for text in texts:
        try:
            if 0 < len(text) < 1000 and "\n" not in text and "\0" not in text and (folder / text).is_file():
                files.add(folder / text)
        except (OSError, ValueError):
            continue
    return sorted(files)
