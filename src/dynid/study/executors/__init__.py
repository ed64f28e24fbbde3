"""Executors of samples: in this process, in several, or on a Dask cluster, with `concurrent.futures`."""

from __future__ import annotations

from dynid.errors import UsageError
from dynid.study.executors.executor_base import StudyExecutor

__all__ = ["EXECUTORS", "StudyExecutor", "make_executor"]

EXECUTORS = ("serial", "processes", "dask")


def make_executor(
    executor: str | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    scheduler_file: str | None = None,
    sample_timeout: float | None = None,
) -> StudyExecutor:
    """Return what runs samples.

    Parameters
    ----------
    executor
        `serial`, `processes` or `dask`; absent: `dask` where a scheduler is named here or in Dask's own
        configuration (such as DASK_SCHEDULER_ADDRESS), else `processes`.
    workers
        How many processes, by default one for each core; on a cluster, how many of its threads to use.
    scheduler, scheduler_file
        The address of a Dask scheduler, or the file in which it has written it.
    sample_timeout
        How long a sample may take, s; absent: any time. What takes longer is killed, so that `serial` runs
        samples in a process of its own then.

    Raises
    ------
    UsageError
        Where these do not go together, or there is no scheduler to ask.
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
    if sample_timeout is not None:
        from dynid.study.executors.processes import cores
        from dynid.study.executors.timed import TimedExecutor

        return TimedExecutor(1 if executor == "serial" else workers or cores(), sample_timeout)
    if executor == "processes":
        from dynid.study.executors.processes import ProcessExecutor

        return ProcessExecutor(workers)
    from dynid.study.executors.serial import SerialExecutor

    return SerialExecutor()
