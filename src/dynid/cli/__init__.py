"""Command line: one thin function per command, imported when it is called."""

from __future__ import annotations

import atexit
import gc
import os
import sys
from importlib import import_module
from io import TextIOWrapper
from pathlib import Path
from typing import Any

import click

from dynid._version import __version__
from dynid.cli.arguments import guarded

#: The commands: function and one line of `dynid --help`, which imports none of them.
COMMANDS = {
    "run": ("dynid.cli.run:run", "Run one scene and write one HDF5 file."),
    "check": ("dynid.cli.check:check", "Check scenes; with --explain, report method and cost of a run."),
    "study": ("dynid.cli.study:study", "Run or resume a parameter study."),
    "study-merge": ("dynid.cli.study:study_merge", "Merge the shards of a study into one file."),
    "study-worst": (
        "dynid.cli.study:study_worst",
        "Write the sample with the most extreme result as a scene.",
    ),
    "inspect": ("dynid.cli.inspect:inspect", "List what is in a data file, with lines of a scene."),
    "plan": ("dynid.cli.run:plan", "Rank sensors and excitation by Cramér–Rao bounds."),
    "show": ("dynid.cli.results:show", "Print a summary of a result."),
    "report": ("dynid.cli.results:report", "Write an HTML report of a result."),
    "plot": ("dynid.cli.results:plot", "Write the figures of a result as SVG, PNG or PDF."),
    "watch": ("dynid.cli.watch:watch", "Rerun a scene on every change, with a live report."),
    "export": ("dynid.cli.results:export", "Export a result as CSV, Parquet, JSON, .mat or .mtx."),
    "compare": ("dynid.cli.results:compare", "List the differences between two results."),
    "new": ("dynid.cli.start:new", "Write a commented template scene."),
    "library": ("dynid.cli.start:library", "List the models of machines and components, or print one."),
    "schema": ("dynid.cli.start:schema", "Print the JSON Schema of scenes."),
    "bench": ("dynid.cli.bench:bench", "Measure the speed and the error of the algorithms."),
    "demo": ("dynid.cli.start:demo", "Run a tour of the commands in a temporary folder."),
    "doctor": ("dynid.cli.start:doctor", "Report versions, optional packages and folders."),
    "help": ("dynid.cli.start:help_", "Print the manual of a topic."),
}

#: The commands in groups, as `dynid --help` lists them.
GROUPS = {
    "Run": ("demo", "new", "inspect", "check", "run", "plan"),
    "Studies": ("study", "study-merge", "study-worst"),
    "Results": ("show", "report", "plot", "watch", "compare", "export"),
    "Help": ("help", "library", "schema", "doctor", "bench"),
}


#: BibTeX entries of this software and of the papers that it implements.
_CITATION = """\
@software{{dynid,
  title   = {{dynid: bond graphs in the frequency domain, and joint identification on reduced
             finite-element models}},
  author  = {{{{The dynid founders}}}},
  version = {{{version}}}
}}

@article{{park1997,
  title  = {{Understanding of Dynamic System Properties in the Frequency Domain Using Bond Graphs}},
  author = {{Park, Jeon Soo and Kim, Jong Shik}},
  year   = {{1997}}
}}

@article{{yang1997,
  title  = {{A Study on Improving the Accuracy of Finite Element Modeling Using System Identification
            Technique}},
  author = {{Yang, Kyung-Taek}},
  year   = {{1997}}
}}"""


class _LazyGroup(click.Group):
    """Group of commands, each imported when it is used."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the names of the commands, in the order of `dynid --help`."""
        return [name for names in GROUPS.values() for name in names]

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:  # noqa: ARG002
        if name not in COMMANDS:
            return None
        module, _, function = COMMANDS[name][0].partition(":")
        command: click.Command = getattr(import_module(module), function)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; suggest the nearest name for an unknown one."""
        if args and args[0].startswith("-"):
            raise click.NoSuchOption(args[0], ctx=ctx)
        if args and args[0] not in COMMANDS:
            ctx.fail(_unknown_command(args[0]))
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """List the commands without importing any."""
        width = max(map(len, COMMANDS))
        for title, names in GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(width), COMMANDS[name][1]) for name in names])


#: What other programs call the commands.
_OTHER_WORDS = {
    "run": "analyse analyze compute execute identify simulate solve start",
    "check": "lint test validate verify",
    "new": "create init make template",
    "show": "cat info open print summary view",
    "report": "html page",
    "plot": "bode draw figure graph",
    "compare": "diff",
    "doctor": "debug env",
    "help": "docs man manual usage",
    "library": "components models",
    "--version": "version",
    "--cite": "cite citation",
}


def _unknown_command(name: str) -> str:
    """Return the message for what is no command; a file is meant to be run or shown."""
    suffix = Path(name).suffix.lower()
    for suffixes, verb in (((".yaml", ".yml"), "run"), ((".h5", ".hdf5"), "show")):
        if suffix in suffixes:
            return f"'{name}' is a file, no command; write: dynid {verb} {name}"
    if Path(name).is_file():
        return f"'{name}' is a file, no command; a scene names measured data: dynid inspect {name}"
    if Path(f"{name}.yaml").is_file():
        return f"no command '{name}'; write: dynid run {name}.yaml"
    for command, words in _OTHER_WORDS.items():
        if name.lower() in words.split():
            return f"no command '{name}'; write: dynid {command}"
    from dynid.suggestions import did_you_mean

    return f"no command '{name}'{did_you_mean(name, COMMANDS) or '; they are ' + ', '.join(COMMANDS)}"


def citation() -> str:
    """Return BibTeX entries of this version and of the papers that it implements."""
    return _CITATION.format(version=__version__)


def _cite(context: click.Context, _option: click.Parameter, asked: bool) -> None:
    if asked:
        click.echo(citation())
        context.exit()


@click.group(cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="dynid", message="%(prog)s %(version)s")
@click.option(
    "--cite",
    is_flag=True,
    expose_value=False,
    is_eager=True,
    callback=_cite,
    help="Show how to cite dynid, and exit.",
)
def cli() -> None:
    """Bond graphs in the frequency domain, and joint identification on reduced FE models.

    Each run reads one YAML scene and writes one HDF5 file. To start: dynid demo, or dynid new
    bond-graph and dynid run bond-graph.yaml. Manual: dynid help
    """


def main(args: list[str] | None = None) -> None:
    """Run the command line and exit: 0 done, 1 expectation failed, 2 usage or scene, 3 numerics, 4 files."""
    # Sums over threads depend on their number; with one, a scene gives the same bytes on every machine.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")  # for terminals that cannot print ω
    # The search of pydantic for plugins in all installed packages takes as long as checking a scene.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    # Modules and schemas live to the end: searching them for garbage takes a fifth of a short run.
    gc.set_threshold(10_000, 50)
    atexit.register(gc.freeze)
    with guarded():
        sys.exit(_exit_code(args))


def _exit_code(args: list[str] | None) -> int:
    from dynid.errors import DynidError

    try:
        code: Any = cli.main(args, prog_name="dynid", standalone_mode=False)
    except DynidError as error:
        click.echo(str(error), err=True)
        return error.exit_code
    except click.exceptions.Exit as leave:
        return leave.exit_code
    except click.ClickException as error:
        if isinstance(error, click.NoSuchOption):
            context, name = error.ctx, error.option_name
            options = (
                [option_name for option in context.command.get_params(context) for option_name in option.opts]
                if context
                else []
            )
            words = [
                f"-{word.partition('=')[0]}"
                for word in (sys.argv[1:] if args is None else args)
                if word.startswith(name)
            ]
            words += ["--version"] if name in ("-v", "-V") else []
            meant = next((option_name for option_name in words if option_name in options), None)
            error = click.UsageError(f"{error.message} Did you mean '{meant}'?", context) if meant else error
        error.show()
        return 2
    except (KeyboardInterrupt, click.Abort):
        click.echo("interrupted; no file was left incomplete", err=True)
        return 130
    except MemoryError:
        click.echo("this needs more memory than there is; ask for fewer points, samples or results", err=True)
        return 3
    except SystemExit:
        return 4  # click exits so when the reader of a pipe has closed it
    except OSError as error:
        file = error.filename or "the output"
        click.echo(f"{file} cannot be read or written: {error.strerror or error}", err=True)
        return 4
    except Exception as error:
        click.echo(_unforeseen(error), err=True)
        return 3
    return code if isinstance(code, int) else 0


def _unforeseen(error: Exception) -> str:
    """Return the report of an unexpected error and its place; raise it if DYNID_TRACEBACK is set."""
    if os.environ.get("DYNID_TRACEBACK"):
        raise error
    places = []
    trace = error.__traceback__
    while trace is not None:
        places.append((str(trace.tb_frame.f_globals.get("__name__")), trace.tb_lineno))
        trace = trace.tb_next
    module, line = next(place for place in reversed(places) if place[0].startswith("dynid"))
    cause = " ".join(f"{type(error).__name__} {error}".split())
    return f"this is a fault of dynid itself ({cause}, {module}:{line}). Please report it, with the scene."
