"""The work of a call, counted in calls of functions: what a clock would measure on an idle machine only."""

import sys
from contextlib import contextmanager


@contextmanager
def at_most(calls):
    """Raise if the block makes more calls of functions than `calls`, at once and not at its end."""
    count = 0

    def counter(_frame, event, _argument):
        nonlocal count
        count += event in ("call", "c_call")
        assert count <= calls, f"more than {calls:,} calls"

    before = sys.getprofile()
    sys.setprofile(counter)
    try:
        yield
    finally:
        sys.setprofile(before)
