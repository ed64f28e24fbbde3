"""The work of a call, counted in calls of functions: what a clock would measure on an idle machine only."""

import sys
from contextlib import contextmanager


def calls_of(function, *arguments):
    """Return the number of calls of functions that a call makes."""
    with at_most(calls=float("inf")) as count:
        function(*arguments)
    return count[0]


@contextmanager
def at_most(calls):
    """Raise if the block makes more calls of functions than `calls`, at once and not at its end."""
    count = [0]

    def counter(_frame, event, _argument):
        count[0] += event in ("call", "c_call")
        assert count[0] <= calls, f"more than {calls:,} calls"

    before = sys.getprofile()
    sys.setprofile(counter)
    try:
        yield count
    finally:
        sys.setprofile(before)
