"""Executors of samples: in this process, in several processes, or on a Dask cluster."""

from __future__ import annotations

from dynid.errors import UsageError
from dynid.study.executors.base import SerialExecutor, StudyExecutor

__all__ = ["EXECUTORS", "StudyExecutor", "make_executor"]

EXECUTORS = ("serial", "processes", "dask")


def make_executor(
    executor: str | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    scheduler_file: str | None = None,
    sample_timeout: float | None = None,
) -> StudyExecutor:
    """Return the executor of the samples of a study: `serial`, `processes` or `dask`.

    By default it is `dask` if a scheduler is named here (its address, or the file with its address) or in
    Dask's configuration (such as DASK_SCHEDULER_ADDRESS), else `processes`. `workers` is the number of
    processes, by default one per core; on a cluster, the number of its threads to use. With a time limit of a
    sample (s), `serial` runs samples in a second process, which can be killed.

    Raises
    ------
    UsageError
        If these are contradictory, or no scheduler is named.
    """
    from dynid.study.executors.dask import DaskExecutor, configured_address

    if scheduler and scheduler_file:
        raise UsageError("--scheduler and --scheduler-file name two schedulers", remedy="Give one of them.")
    named = scheduler or scheduler_file
    if executor is None:
        executor = "dask" if named or configured_address() else "processes"
    if executor != "dask" and named:
        raise UsageError(
            f"a scheduler is of no use to the executor '{executor}'", remedy="Use --executor dask."
        )
    if executor == "dask":
        return DaskExecutor(scheduler or configured_address(), scheduler_file, workers, sample_timeout)
    if executor == "processes" or sample_timeout is not None:
        from dynid.study.executors.processes import ProcessExecutor

        return ProcessExecutor(1 if executor == "serial" else workers, sample_timeout)
    return SerialExecutor()
