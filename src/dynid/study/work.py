"""Work of a study: chunks of samples as they are run, and their outcomes packed as bytes."""

from __future__ import annotations

import json
import socket
import struct
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid._version import __version__
from dynid.checks import samples_meet
from dynid.errors import FileError
from dynid.result import Variable
from dynid.scene.batch import Expected, run_batch, why_alone
from dynid.scene.load import check_source
from dynid.scene.outcomes import SampleBlock, SampleOutcomes, is_shared
from dynid.scene.yaml.source import parse_source

if TYPE_CHECKING:
    from dynid.scene.load import Scene


@dataclass(frozen=True)
class Job:
    """Data that all samples of a study share."""

    text: str  # of the scene
    file: str  # of the scene
    collect: tuple[str, ...]  # paths of the outputs
    version: str = __version__

    @classmethod
    def of(cls, base: Scene, collect: tuple[str, ...]) -> Job:
        """Return the job of a scene, with an absolute path for workers in other folders."""
        return cls(base.source.resolved_text(), str(Path(base.source.file).absolute()), collect)


@dataclass(frozen=True)
class Done:
    """Result of a chunk: the outcomes in order, and the time they took, s, on the clock and of processors."""

    outcomes: Packed
    seconds: float
    processor_seconds: float


def prepare(job: Job, paths: Sequence[str]) -> None:
    """Read the scene, and plan samples that differ in the values at paths: chunks find both."""
    why_alone(_template(job.text, job.file), paths, job.collect)


def run_chunk(job: Job, overrides: Sequence[Mapping[str, Any]]) -> Done:
    """Run samples; the error of a failed one is its outcome."""
    if job.version != __version__:
        problem = f"a worker on {socket.gethostname()} has dynid {__version__}, and the study {job.version}"
        raise FileError(problem, remedy="Install the same version on all workers, and run the study again.")
    template = _template(job.text, job.file)
    started = time.perf_counter(), time.process_time()
    outcomes = packed(run_batch(template, overrides, job.collect, meets))
    return Done(outcomes, time.perf_counter() - started[0], time.process_time() - started[1])


@lru_cache(maxsize=4)
def _template(text: str, file: str) -> Scene:
    """Parse the scene, once in each worker."""
    return check_source(parse_source(text, file))


def meets(block: SampleBlock, expected: Expected, kind: str, title: str) -> NDArray[np.bool_]:
    """Return for samples of a scene whether each expectation is met (samples x expectations)."""
    return samples_meet(block.values, len(block), lambda sample: block.result(sample, kind, title), expected)


_LENGTH = struct.Struct("<I")
#: The beginning of every heading; the number of samples follows, and a comma.
START = b'{"count":'


@dataclass(frozen=True)
class Packed:
    """Outcomes as bytes: one exit code per sample, and everything else."""

    exit_codes: bytes
    content: bytes

    def __len__(self) -> int:
        return len(self.exit_codes)

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Mask of the failed samples."""
        return np.frombuffer(self.exit_codes, np.int8).astype(np.bool_)


def packed(outcomes: SampleOutcomes) -> Packed:
    """Return outcomes, none of them pending, as bytes."""
    pieces: list[bytes] = []
    blocks = []
    for block in outcomes.blocks:
        pieces += [block.rows.astype("<i4").tobytes(), block.met.tobytes()]
        arrays = []
        for path, variable in block.values.items():
            kept = variable.data[:1] if _is_one_row(variable.data) else variable.data
            arrays.append(
                [
                    path,
                    variable.dims[1:],
                    variable.units,
                    dict(variable.attrs),
                    variable.data.dtype.str,
                    kept.shape,
                ]
            )
            if variable.data.dtype.kind == "O":
                arrays[-1].append(kept.ravel().tolist())
            else:
                pieces.append(kept.tobytes())
        about: dict[str, Any] = {"samples": len(block), "met": block.met.shape[1], "arrays": arrays}
        if block.errors:
            about |= {"errors": block.errors, "exit_codes": block.exit_codes}
        blocks.append(about)
    heading = {"count": len(outcomes), "blocks": blocks}
    text = json.dumps(heading, separators=(",", ":"), default=lambda value: value.item()).encode()
    return Packed(outcomes.exit_codes.tobytes(), b"".join([_LENGTH.pack(len(text)), text, *pieces]))


def unpacked(content: bytes) -> SampleOutcomes:
    """Return outcomes from bytes; their arrays are views of these bytes."""
    (length,) = _LENGTH.unpack_from(content)
    begin = _LENGTH.size + length
    heading = json.loads(content[_LENGTH.size : begin])
    reader = _Reader(content, begin)
    blocks = []
    for about in heading["blocks"]:
        count = about["samples"]
        rows = reader.take("<i4", count).astype(np.intp)
        met = reader.take("?", count, about["met"])
        values = {}
        for path, dims, units, attrs, kind, shape, *texts in about["arrays"]:
            data: NDArray[Any]
            if texts:
                data = np.empty(len(texts[0]), dtype=object)
                data[:] = texts[0]
                data = data.reshape(shape)
            else:
                data = reader.take(kind, *shape)
            shared = np.broadcast_to(data, (count, *shape[1:]))
            values[path] = Variable(("sample", *dims), shared, units, attrs)
        errors, codes = (tuple(about.get(what, ())) for what in ("errors", "exit_codes"))
        blocks.append(SampleBlock(rows, values, met, errors, codes))
    return SampleOutcomes(blocks, heading["count"])


def _is_one_row(data: NDArray[Any]) -> bool:
    if is_shared(data) or len(data) == 1:
        return True
    if data.dtype.kind == "O":
        return bool(np.all(data == data[:1]))
    rows = np.ascontiguousarray(data).view(np.uint8).reshape(len(data), -1)
    # Most arrays already differ in their second row.
    return bool(np.array_equal(rows[0], rows[1]) and np.all(rows == rows[:1]))


class _Reader:
    def __init__(self, content: bytes, begin: int) -> None:
        self.content, self.place = content, begin

    def take(self, kind: str, *shape: int) -> NDArray[Any]:
        data = np.frombuffer(self.content, kind, int(np.prod(shape, dtype=np.int64)), self.place)
        self.place += data.nbytes
        return data.reshape(shape)
