"""Keys of samples: what they would compute, as a hash.

Two samples with one key give the same outcome, whatever study they are in and whatever it is called: the
key covers the scene with the sample's values in place, the contents of every file that it names, what is
gathered, and the version of this format, which rises whenever the same scene would give other numbers.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.scene.yaml.source import set_values

if TYPE_CHECKING:
    from dynid.study.plan import Plan

FORMAT = 1
SIZE = 16  # bytes: of 10^7 samples two share a key by chance once in 10^24 studies
_CHUNK = 2**20


class Keyring:
    """Makes the keys of one plan's samples.

    The scene is written as text once, with gaps where samples differ.

    Parameters
    ----------
    plan
        The plan.
    """

    def __init__(self, plan: Plan) -> None:
        self._folder = plan.base.folder
        self._digests: dict[str, bytes] = {}
        gaps = {path: f"\0{place}\0" for place, path in enumerate(plan.settings)}
        data = dict(set_values(plan.base.source, gaps).data)
        data.pop("title", None)  # it changes no number
        document = {"format": FORMAT, "collect": sorted(plan.collect), "scene": data}
        text = _canonical(document)
        pieces, order = _split(text, plan.settings)
        self._pieces, self._order = [piece.encode() for piece in pieces], order
        files = _files(self._folder, _texts(data))
        self._common = hashlib.sha256(b"".join(self._digest(file) for file in files))

    def key(self, override: dict[str, Any]) -> bytes:
        """Return the key of a sample."""
        made = self._common.copy()
        made.update(self._pieces[0])
        for path, piece in zip(self._order, self._pieces[1:], strict=True):
            value = override[path]
            made.update(_canonical(value).encode())
            for file in _files(self._folder, _texts(value)):
                made.update(self._digest(file))
            made.update(piece)
        return made.digest()[:SIZE]

    def _digest(self, file: Path) -> bytes:
        """Return the hash of a file's contents; of one that cannot be read, of its name alone."""
        name = str(file)
        if name not in self._digests:
            made = hashlib.sha256()
            try:
                with file.open("rb") as content:
                    while chunk := content.read(_CHUNK):
                        made.update(chunk)
            except OSError:
                made.update(name.encode())
            self._digests[name] = made.digest()
        return self._digests[name]


def sample_keys(plan: Plan, numbers: Sequence[int]) -> NDArray[np.uint8]:
    """Return the keys of samples of a plan (samples x bytes)."""
    ring = Keyring(plan)
    keys = np.empty((len(numbers), SIZE), dtype=np.uint8)
    for row, number in enumerate(numbers):
        keys[row] = np.frombuffer(ring.key(plan.override(number)), dtype=np.uint8)
    return keys


def _canonical(value: Any) -> str:
    return json.dumps(_with_text_keys(value), sort_keys=True, ensure_ascii=False, separators=(",", ":"))


def _with_text_keys(value: Any) -> Any:
    """Give keys of mappings that are numbers a form of their own, which texts do not have."""
    if isinstance(value, dict):
        return {
            key if isinstance(key, str) else f"\1{key}": _with_text_keys(one) for key, one in value.items()
        }
    return [_with_text_keys(one) for one in value] if isinstance(value, list) else value


def _split(text: str, paths: Sequence[str]) -> tuple[list[str], list[str]]:
    """Split a text at its gaps; return the pieces and which path stands between each two."""
    parts = text.split('"\\u0000')
    pieces, order = [parts[0]], []
    for part in parts[1:]:
        number, _, rest = part.partition('\\u0000"')
        order.append(paths[int(number)])
        pieces.append(rest)
    return pieces, order


def _texts(value: Any) -> Iterator[str]:
    """Yield every text in plain data."""
    stack = [value]
    while stack:
        one = stack.pop()
        if isinstance(one, dict):
            stack += one.values()
        elif isinstance(one, list):
            stack += one
        elif isinstance(one, str):
            yield one


def _files(folder: Path, texts: Iterator[str]) -> list[Path]:
    """Return what texts name files, in one order."""
    found = set()
    for text in texts:
        try:
            if 0 < len(text) < 1000 and "\n" not in text and "\0" not in text and (folder / text).is_file():
                found.add(folder / text)
        except (OSError, ValueError):
            continue
    return sorted(found)
