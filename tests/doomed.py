"""What a separate process is told to do, and does not survive; it imports nothing else."""

import os
import signal
import time


def returns(_):
    print("never seen")


def fails(_):
    raise ValueError


def lacks_memory(_):
    raise MemoryError


def takes_memory(_):
    return bytearray(2**31)


def crashes(_):
    os.kill(os.getpid(), signal.SIGSEGV)


def never_ends(_):
    time.sleep(1000)
