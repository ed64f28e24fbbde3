"""Arguments of commands and their checks; output that terminals, pipes and files take."""

from __future__ import annotations

import functools
import os
import re
import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import Any, TextIO, cast

import click

from dynid.errors import DynidError, FileError, UsageError
from dynid.suggestions import printable

_ERROR_LENGTH = 200  # characters of an error's own words
#: What users want who name the HDF5 file so.
_OTHER_FILES = dict.fromkeys((".csv", ".parquet", ".json", ".mat"), "To export it: dynid export {}.h5")
_OTHER_FILES |= dict.fromkeys((".html", ".htm"), "For a page: --report {}.html")
_OTHER_FILES |= dict.fromkeys((".png", ".svg", ".pdf"), "For figures: dynid plot {}.h5 -o FOLDER")


def among(source: str) -> Callable[[click.Context, click.Parameter, str], list[str]]:
    """Complete an argument from the names at `module:name`, which are looked up only when the shell asks."""

    def complete(context: click.Context, parameter: click.Parameter, begun: str) -> list[str]:  # noqa: ARG001
        module, _, attribute = source.partition(":")
        names = getattr(import_module(module), attribute)
        return [name for name in (names() if callable(names) else names) if name.startswith(begun)]

    return complete


def set_option(subject: str) -> Callable[[Any], Any]:
    """Return the option that sets values of a scene or a study."""
    text = f"Set a value of the {subject}; repeatable."
    return click.option("--set", "overrides", multiple=True, metavar="PATH=VALUE", help=text)


def refuse_unknown(name: str, names: Collection[str], what: str, remedy: str = "") -> None:
    """Refuse a name that is not among the known ones, and suggest the nearest one.

    `what` is the kind of name, such as ``topic``; the remedy is by default a list of the names.
    """
    if name not in names:
        from dynid.suggestions import did_you_mean

        raise UsageError(
            f"there is no {what} '{name}'{did_you_mean(name, names)}",
            remedy=remedy or f"There are {', '.join(names)}.",
        )


def reads_results(*parameters: str) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Report a result file that a command cannot interpret as an error of that file, in one sentence.

    Result files, which these arguments of the command name, may have been changed by other programs; what
    they lack is no fault of dynid.
    """

    def decorate(command: Callable[..., int]) -> Callable[..., int]:
        @functools.wraps(command)
        def guarded(**arguments: Any) -> int:
            try:
                return command(**arguments)
            except (DynidError, click.ClickException, click.Abort, click.exceptions.Exit):
                raise
            except (OSError, MemoryError):
                raise
            except Exception as error:
                if os.environ.get("DYNID_TRACEBACK"):
                    raise
                values = [arguments[name] for name in parameters]
                files = [
                    name for value in values for name in (value if isinstance(value, tuple) else [value])
                ]
                verb = "do" if len(files) > 1 else "does"
                cause = " ".join(f"{type(error).__name__} {error}".split())[:_ERROR_LENGTH]
                raise FileError(
                    f"{' or '.join(files)} {verb} not hold what a result of dynid holds ({cause})",
                    remedy="Run its scene again; if dynid wrote the file as it is, please report it.",
                    names=files,
                ) from error

        return guarded

    return decorate


def writes_junit(parameter: str) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Write the error that ends a command on a scene into its JUnit file, also over that of a good run."""

    def decorate(command: Callable[..., int]) -> Callable[..., int]:
        @functools.wraps(command)
        def reporting(**arguments: Any) -> int:
            try:
                return command(**arguments)
            except BaseException as error:
                if arguments["junit"]:
                    report_in_junit(Path(arguments["junit"]), arguments[parameter], error)
                raise

        return reporting

    return decorate


def report_in_junit(junit: Path, scene: str, error: BaseException) -> None:
    """Write an error as a JUnit file, over nothing but another one: a scene may be named by mistake."""
    from dynid.checks import junit_xml
    from dynid.file_access import replace_file

    with suppress(OSError, DynidError):
        if junit.exists():
            with junit.open("rb") as file:
                written = file.read(5) == b"<?xml"
        else:
            written = not isinstance(error, UsageError)  # such as of a file that is that of the result
        if written:
            message = f"{type(error).__name__} {error}".strip()
            if isinstance(error, DynidError | click.ClickException):
                message = str(error)
            elif isinstance(error, KeyboardInterrupt):
                message = "interrupted"
            replace_file(junit, junit_xml([], Path(scene).stem, message).encode())


def is_same(file: str, path: str) -> bool:
    """Return whether two names are of the same file."""
    return os.path.realpath(file) == os.path.realpath(path)


def refuse_overwriting(scene: str, target: str, junit: str | None, report: str | None = None) -> None:
    """Refuse to write over the scene, or one output over another."""
    if (kind := Path(target).suffix.lower()) in _OTHER_FILES:
        raise UsageError(
            f"a result is an HDF5 file, not {target}", remedy=_OTHER_FILES[kind].format(Path(target).stem)
        )
    if is_same(target, scene):
        raise UsageError(f"the result would overwrite the scene {scene}", remedy="Name another file with -o.")
    paths = [scene, target]
    for file, what, option in ((junit, "JUnit file", "--junit"), (report, "page", "--report")):
        if file and any(is_same(file, path) for path in paths):
            raise UsageError(f"the {what} would overwrite {file}", remedy=f"Name another file with {option}.")
        paths += [file] if file else []


def refuse_missing_folders(*files: str | None) -> None:
    """Refuse, before any work, to write into folders that do not exist."""
    for file in files:
        if file is not None and not Path(file).parent.is_dir():
            folder = Path(file).parent
            raise FileError(f"{file} cannot be written: there is no folder {folder}", remedy="Make it first.")


#: What is coloured on terminals, and by which number of ANSI.
_COLOURS = {
    "31": r"expectation failed:|not converged|unstable|problem:",
    "32": r"(?<=^ {2})converged(?=:)|(?<=^ {12})stable$|no problems found",
    "33": r"warning:|(?<=^ {2})optimum found, but the model lacks fit|(?<=^ {12})marginal",
}
_MARKED = re.compile("|".join(f"(?P<c{code}>{words})" for code, words in _COLOURS.items()), re.MULTILINE)


def _has_colours(stream: TextIO) -> bool:
    """Return True for a terminal with colours; NO_COLOR and FORCE_COLOR decide where they are set."""
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR"):
        return True
    # Of terminals on Windows, those that understand the escapes name themselves.
    capable = os.name != "nt" or "WT_SESSION" in os.environ or "TERM" in os.environ
    return stream.isatty() and capable and os.environ.get("TERM") != "dumb"


class _Guarded:
    """A text stream that writes control characters as escapes; line feeds and tabs stay."""

    #: `click` bypasses a stream whose encoding it finds unsuitable.
    encoding, errors = "utf-8", "replace"

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream
        self._coloured = _has_colours(stream)

    def write(self, text: str) -> int:
        safe = printable(text)
        if self._coloured:
            safe = _MARKED.sub(lambda match: f"\033[{str(match.lastgroup)[1:]}m{match[0]}\033[0m", safe)
        self.stream.write(safe)
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextmanager
def guarded() -> Iterator[None]:
    """Write control characters as escapes on standard output and standard error."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (
        cast("TextIO", _Guarded(stream)) if stream is not None else stream for stream in before
    )
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def terminal() -> TextIO:
    """Return the unguarded standard error, to move the cursor; texts of files must be made printable."""
    stream: Any = sys.stderr
    return cast("TextIO", stream.stream if isinstance(stream, _Guarded) else stream)
