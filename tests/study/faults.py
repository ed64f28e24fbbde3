"""Samples that hang or kill their process. Workers import this module: it needs nothing heavy."""

import os
import signal
import time
from pathlib import Path

from dynid.study import work


def faulty(faults, folder, job, overrides):
    """Run a chunk in a process beside the study's, unless a sample in it has a fault."""
    for one in overrides:
        what = faults.get(one["parameters.m"])
        if what is not None:
            with (Path(folder) / "seen.txt").open("a") as seen:
                seen.write(f"{os.getpid()} {len(overrides)}\n")
        if what == "hangs":
            signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT, signal.SIGTERM])
            time.sleep(1000)
        elif what == "dies":
            os.kill(os.getpid(), signal.SIGKILL)
    return work.run_chunk(job, overrides)


def poisoned(poison, job, overrides):
    """Run a chunk in a worker, unless that dies of it."""
    victims, times, folder = poison
    for one in overrides:
        if one["parameters.m"] in victims:
            marks = list(Path(folder).glob(f"death-{one['parameters.m']}-*"))
            if len(marks) < times:
                (Path(folder) / f"death-{one['parameters.m']}-{len(marks)}").touch()
                os.kill(os.getpid(), signal.SIGKILL)
    return work.run_chunk(job, overrides)
