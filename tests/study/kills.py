"""Run a study in children that are killed at a given byte of what they write, and resume it.

Prints, for each kill, how many samples were finished, and how many of them were run again after it.
"""

import os
import signal
import sys

import numpy as np

from dynid.scene.load import load_scene
from dynid.study import scheduler
from dynid.study.executors import SerialExecutor
from dynid.study.journal import Journal
from dynid.study.keys import Keyring
from dynid.study.plan import make_plan
from dynid.study.run import journal_name, run_study


class Logged(SerialExecutor):
    """The serial pool, which logs the key of every sample before it is run."""

    def __init__(self, plan):
        super().__init__()
        self.ring = Keyring(plan)

    def submit(self, call, job, overrides):
        with open("ran.log", "a") as log:  # noqa: PTH123
            for one in overrides:
                (key,) = self.ring.keys([[value] for value in one.values()], 1)
                log.write(f"{key.tobytes().hex()}\n")
        return super().submit(call, job, overrides)


def dying(budget):
    """Return a `pwrite` that kills its process when that many bytes have been written, in the middle."""
    original, left = os.pwrite, [budget]

    def pwrite(descriptor, content, place):
        if len(content) > left[0]:
            original(descriptor, bytes(content)[: left[0]], place)
            os.kill(os.getpid(), signal.SIGKILL)
        left[0] -= len(content)
        return original(descriptor, content, place)

    return pwrite


def in_child(plan, target, budget=None):
    """Run the study in a child; return what its end was, and the keys of what it ran."""
    open("ran.log", "w").close()  # noqa: PTH123
    child = os.fork()
    if not child:
        if budget is not None:
            os.pwrite = dying(budget)
        run_study(plan, target, Logged(plan))
        os._exit(0)
    end = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    with open("ran.log") as log:  # noqa: PTH123
        return end, [bytes.fromhex(line) for line in log]


def main(journal, total, kills):
    """Kill at random bytes, one study each: most of them of the journal, the rest of the file too."""
    scheduler._MAX_CHUNK_SAMPLES = 1  # every sample is a record of its own
    plan = make_plan(load_scene("masses.yaml"))
    random = np.random.default_rng(7)
    budgets = [*random.integers(0, journal, kills - kills // 4), *random.integers(0, total, kills // 4)]
    for number, budget in enumerate(map(int, budgets)):
        target = f"{number}.h5"
        end, _ = in_child(plan, target, budget)
        assert end == -signal.SIGKILL, end
        left = os.path.exists(journal_name(target))  # noqa: PTH110
        keys = Journal.read_keys(journal_name(target)) if left else []
        finished = {key.tobytes() for key in keys}
        end, ran = in_child(plan, target)
        assert end == 0, end
        assert len(ran) == len(set(ran))
        print(len(finished), len(finished & set(ran)), len(finished | set(ran)))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
