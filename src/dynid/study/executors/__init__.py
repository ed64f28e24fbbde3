"""Where samples run: in this process, in several, or on a Dask cluster; all by `concurrent.futures`."""

from __future__ import annotations

from dynid.errors import UsageError
from dynid.study.executors.crew import Crew

__all__ = ["EXECUTORS", "Crew", "hire"]

EXECUTORS = ("serial", "processes", "dask")


def hire(
    executor: str | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    scheduler_file: str | None = None,
) -> Crew:
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

    Raises
    ------
    UsageError
        Where these do not go together, or there is no scheduler to ask.
    """
    from dynid.study.executors.dask import DaskCrew, configured_address

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
        return DaskCrew(scheduler or configured_address(), scheduler_file, workers)
    if executor == "processes":
        from dynid.study.executors.processes import ProcessCrew

        return ProcessCrew(workers)
    from dynid.study.executors.serial import SerialCrew

    return SerialCrew()
