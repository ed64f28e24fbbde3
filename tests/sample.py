"""The sample of many similar cases that the default run checks; `-m slow` runs the others."""

import pytest


def sample(cases, count, *named):
    """Return the cases of a parametrisation, all but a sample marked slow.

    The sample is `count` cases, spread evenly from the first to the last, and those that are `named`.
    """
    cases = list(cases)
    quick = {round(at * (len(cases) - 1) / max(count - 1, 1)) for at in range(count)}
    return [case if at in quick or case in named else _slow(case) for at, case in enumerate(cases)]


def _slow(case):
    values = case if type(case) is tuple else (case,)
    return pytest.param(*values, marks=pytest.mark.slow)
