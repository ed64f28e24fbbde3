"""Result files that somebody else may have changed: what they lack is their fault, in one sentence."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from typing import Any

import click

from dynid.errors import DynidError, FileError

_LONGEST = 200  # characters of a file's own words


def reads_results(*parameters: str) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Have a command blame the result files that it reads for what cannot be made of them.

    Parameters
    ----------
    *parameters
        The command's arguments that name such files.
    """

    def decorate(command: Callable[..., int]) -> Callable[..., int]:
        @functools.wraps(command)
        def guarded(**given: Any) -> int:
            try:
                return command(**given)
            except (DynidError, click.ClickException, click.Abort, click.exceptions.Exit):
                raise
            except (OSError, MemoryError):
                raise
            except Exception as error:
                if os.environ.get("DYNID_TRACEBACK"):
                    raise
                raise _misfit([given[name] for name in parameters], error) from error

        return guarded

    return decorate


def _misfit(given: list[Any], error: Exception) -> FileError:
    files = [name for one in given for name in (one if isinstance(one, tuple) else [one])]
    said = " ".join(f"{type(error).__name__} {error}".split())[:_LONGEST]
    several = len(files) > 1
    problem = (
        f"{' or '.join(files)} {'do' if several else 'does'} not hold what a result of dynid holds ({said})"
    )
    remedy = "Run its scene again; if dynid wrote the file as it is, please report it."
    return FileError(problem, remedy=remedy, names=files)
