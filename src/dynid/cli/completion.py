"""Sources of the shell's completions of arguments."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import click


def among(names: Callable[[], Iterable[str]]) -> Callable[[click.Context, click.Parameter, str], list[str]]:
    """Complete an argument from names, which are looked up only when the shell asks."""
    return lambda context, parameter, begun: [name for name in names() if name.startswith(begun)]  # noqa: ARG005
