"""What a separate process is told to do, and does not survive; it imports little else."""

import os
import signal
import time

from dynid.trial import limit_processor_time


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


def sends_and_never_ends(send, number):
    """Send numbers, then compute without an end, and where no signal of Python is handled."""
    for k in range(int(number)):
        send({"number": k})
    limit_processor_time(0.2)
    sum(range(10**18))


def explains_and_never_ends(send, *_):
    """Send an explanation and some progress, then compute without an end."""
    send({"progress": "reducing the graph"})
    send({"lines": ["", "  graph  2 nodes"]})
    send({"progress": "poles of loop 7"})
    limit_processor_time(0.1)
    sum(range(10**18))


def begins_and_never_ends(send, *_):
    """Send some progress, then compute without an end."""
    send({"progress": "assigning causality"})
    limit_processor_time(0.1)
    sum(range(10**18))


def crashes_after_a_message(send):
    send([1, 2])
    os.kill(os.getpid(), signal.SIGSEGV)


def never_ends(_):
    time.sleep(1000)
