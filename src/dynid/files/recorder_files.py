"""Files of data recorders: TDMS, MF4, WAV and Parquet, each by the package of its format.

The packages read in a separate process, which copies channels of numbers into a NumPy archive.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dynid import trial
from dynid.files.recordings import RecordedChannel, Recording, not_numbers
from dynid.files.table import DataFile
from dynid.files.untrusted import MOST_NUMBERS, DiedError, archived, check_size, read_errors

#: Memory of the separate process, bytes: of packages, for each byte of the file, and at most.
_LEAST_MEMORY, _GROWTH, _MOST_MEMORY = 2**32, 64, 2**32 + 24 * MOST_NUMBERS
#: Bytes of a file that are read in a second, at least.
_BYTES_A_SECOND = 5_000_000
_MAX_CHANNELS = 10_000


class _Parsed(NamedTuple):
    """A channel as its package reads it; values that are no numbers are None, and `what` names them."""

    channel: RecordedChannel
    values: Any = None
    times: Any = None


class _Recorder(NamedTuple):
    """A format: what its files are, the package that reads them, and the function with it."""

    what: str
    package: str
    parse: Callable[[str], Iterator[_Parsed]]


def recording(name: str, file: DataFile) -> Recording:
    """Return the recording in a file of a format, one of `RECORDERS`."""

    def converted_file() -> Path:
        recorder = RECORDERS[name]
        return converted(file, recorder.what, recorder.package, archive, name)

    with np.load(converted_file(), allow_pickle=False) as stored:
        index = json.loads(str(stored["index"]))

    def array(member: str) -> Any:
        with np.load(converted_file(), allow_pickle=False) as stored:
            return stored[member]

    return Recording(file, tuple(RecordedChannel(*channel) for channel in index), array)


def converted(
    file: DataFile,
    what: str,
    package: str,
    function: Callable[..., None],
    *arguments: str,
    bytes_a_second: float = _BYTES_A_SECOND,
    extra: str = "recorders",
) -> Path:
    """Return the archive that a function with a package of an extra writes of a file.

    A file takes 30 s and the time of its bytes at most; an array `problem` in the archive is refused.
    """
    if not _is_installed(package):
        file.refuse(
            f"is {what}, and {package} is not installed", f"Install it: pip install 'dynid[{extra}]'."
        )
    with read_errors(file.path, what):
        check_size(file.path)
        size = file.path.stat().st_size
    seconds = trial.SECONDS + size / bytes_a_second
    memory = min(_LEAST_MEMORY + _GROWTH * size, _MOST_MEMORY)
    problem = f"{package} crashes, or takes over {seconds:.0f} s or {memory / 2**30:.1f} GiB"
    try:
        target = archived(file.path, function, *arguments, seconds=seconds, memory=memory)
    except DiedError:
        target = None
    if target is not None:
        with np.load(target, allow_pickle=False) as stored:
            if "problem" not in stored:
                return target
            problem = str(stored["problem"]).rstrip(". ")
    file.refuse(f"cannot be read as {what}: {problem}", "It may be damaged; save it again.")


def _is_installed(package: str) -> bool:
    try:
        return find_spec(package) is not None
    except ModuleNotFoundError:  # the package around it
        return False


def archive(path: str, target: str, name: str) -> None:
    """Write the channels of a file, or why it has none, into a NumPy archive."""
    members: dict[str, Any] = {}
    index: list[RecordedChannel] = []
    kept: dict[int, str] = {}

    def stored(values: Any) -> str:
        if id(values) not in kept:
            kept[id(values)] = f"a{len(members)}"
            members[kept[id(values)]] = values
        return kept[id(values)]

    with problems_in(target):
        for parsed in RECORDERS[name].parse(path):
            channel, values = parsed.channel, None
            if parsed.values is not None:
                channel, values = _plain(channel, np.asarray(parsed.values))
            values, times = ("" if array is None else stored(array) for array in (values, parsed.times))
            index.append(channel._replace(values=values, times=times))
            if len(index) > _MAX_CHANNELS:
                raise ValueError(f"it has more than {_MAX_CHANNELS} channels")
        np.savez(target, index=json.dumps(index), **members)


@contextmanager
def problems_in(target: str) -> Iterator[None]:
    """Write what a package raises on a damaged file into an archive, and silence its warnings."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except Exception as error:
        said = " ".join(str(error).split())[:200] or type(error).__name__
        lack = "it claims more than the memory"
        np.savez(target, problem=lack if isinstance(error, MemoryError) else said)


def _plain(channel: RecordedChannel, values: Any) -> tuple[RecordedChannel, Any]:
    """Return a channel with values that are real numbers, or with what they are in place of them."""
    if values.dtype.kind in "mM":  # of dates and times the seconds since the first
        seconds = (values - values[:1]) / np.timedelta64(1, "s") if len(values) else np.empty(0)
        return channel._replace(unit="s", length=len(values)), seconds
    what = not_numbers(values.dtype) or (f"an array of the shape {values.shape}" if values.ndim != 1 else "")
    if what:
        return channel._replace(what=what, length=len(values)), None
    if values.dtype.kind == "b":
        values = values.astype(np.uint8)
    return channel._replace(length=len(values)), values


def _tdms(path: str) -> Iterator[_Parsed]:
    """Yield the channels of a TDMS file of National Instruments, scaled, with the clocks of waveforms."""
    from nptdms import TdmsFile

    size = Path(path).stat().st_size
    with TdmsFile.open(path) as stored:
        channels = [channel for group in stored.groups() for channel in group.channels()]
        claimed = sum(len(channel) for channel in channels)
        if claimed > size:
            raise ValueError(f"it claims {claimed} values in {size} bytes")
        if stored.file_status.incomplete_final_segment:
            raise ValueError("its last segment is not complete: it is truncated")
        starts = [channel.properties.get("wf_start_time") for channel in channels]
        first = min((start for start in starts if isinstance(start, np.datetime64)), default=None)
        for channel, began in zip(channels, starts, strict=True):
            properties = channel.properties
            after = (
                float((began - first) / np.timedelta64(1, "us")) * 1e-6
                if first is not None and isinstance(began, np.datetime64)
                else 0.0
            )
            unit = properties.get("unit_string") or properties.get("NI_UnitDescription") or ""
            yield _Parsed(
                RecordedChannel(
                    channel.name,
                    channel.group_name,
                    str(unit).strip(),
                    len(channel),
                    after + float(properties.get("wf_start_offset", 0.0)),
                    float(properties.get("wf_increment", 0.0)),
                ),
                channel[:] if len(channel) else np.empty(0),
            )


def _mf4(path: str) -> Iterator[_Parsed]:
    """Yield the channels of a measurement data file (ASAM MDF), converted, with the times of their groups."""
    mdf: Any = import_module("asammdf").MDF
    with mdf(path, process_bus_logging=False) as stored:
        for number, group in enumerate(stored.groups):
            name = str(getattr(group.channel_group, "acq_name", "") or f"group {number + 1}")
            master = stored.masters_db.get(number)
            kind = None if master is None else getattr(group.channels[master], "sync_type", 1)
            times = stored.get_master(number) if kind == 1 else None
            step = 0.0
            for index, _ in enumerate(group.channels):
                if index == master:
                    continue
                signal = stored.get(group=number, index=index, ignore_invalidation_bits=True)
                channel = RecordedChannel(
                    str(signal.name), name, str(signal.unit or "").strip(), len(signal.samples), step=step
                )
                yield _Parsed(channel, _valid(signal), times)


def _valid(signal: Any) -> Any:
    """Return the samples of a signal of an MDF; NaN where they are marked as invalid."""
    samples, invalid = np.asarray(signal.samples), signal.invalidation_bits
    if invalid is None or samples.dtype.kind not in "iufb" or not np.any(invalid):
        return samples
    return np.where(np.asarray(invalid, dtype=bool), np.nan, samples.astype(float))


def _wav(path: str) -> Iterator[_Parsed]:
    """Yield the channels of a WAV file; integers are divided by their full scale and reach from -1 to 1."""
    from scipy.io import wavfile

    warnings.filterwarnings("error", message="Reached EOF prematurely")
    rate, samples = wavfile.read(path)
    if samples.dtype == np.uint8:
        samples = (samples.astype(float) - 128) / 128
    elif samples.dtype.kind == "i":
        samples = samples / -float(np.iinfo(samples.dtype).min)
    columns = samples.reshape(len(samples), -1)
    for number in range(columns.shape[1]):
        channel = RecordedChannel(f"channel {number + 1}", "", "", len(columns), step=1 / rate)
        yield _Parsed(channel, columns[:, number])


def _parquet(path: str) -> Iterator[_Parsed]:
    """Yield the columns of a Parquet file, with the units in their metadata."""
    from pyarrow import parquet, types  # type: ignore[import-untyped, unused-ignore]

    with parquet.ParquetFile(path) as stored:
        if stored.metadata.num_rows * max(stored.metadata.num_columns, 1) > MOST_NUMBERS:
            raise ValueError(f"it claims {stored.metadata.num_rows} rows of {stored.metadata.num_columns}")
        table = stored.read()
    for field, column in zip(table.schema, table.columns, strict=True):
        metadata = {
            key.decode(errors="replace").lower(): value for key, value in (field.metadata or {}).items()
        }
        unit = (metadata.get("units") or metadata.get("unit") or b"").decode(errors="replace").strip()
        numeric = (
            types.is_integer(field.type) or types.is_floating(field.type) or types.is_boolean(field.type)
        )
        channel = RecordedChannel(field.name, "", unit, len(column))
        if numeric or types.is_temporal(field.type) or types.is_decimal(field.type):
            decimal = types.is_decimal(field.type)
            yield _Parsed(channel, (column.cast("float64") if decimal else column).to_numpy())
        else:
            yield _Parsed(
                channel._replace(what="text" if types.is_string(field.type) else str(field.type)[:40])
            )


RECORDERS: dict[str, _Recorder] = {
    "tdms": _Recorder("a TDMS file", "nptdms", _tdms),
    "mf4": _Recorder("a measurement data file (MDF)", "asammdf", _mf4),
    "wav": _Recorder("a WAV file", "scipy", _wav),
    "parquet": _Recorder("a Parquet file", "pyarrow", _parquet),
}
"""Formats of recorders by name."""
