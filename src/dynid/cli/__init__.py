"""The command line: one thin function a command, loaded only when it is called."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from io import TextIOWrapper
from typing import Any

import click

from dynid._version import __version__
from dynid.cli.output import guarded

#: Command: where it is, and what `dynid --help` says about it (so that help loads none of them).
COMMANDS = {
    "run": ("dynid.cli.run:run", "Run one scene and write one HDF5 file."),
    "check": ("dynid.cli.check:check", "Check scenes; with --explain, tell what a run does and costs."),
    "study": ("dynid.cli.study:study", "Run a parameter study, or go on with one."),
    "study-merge": ("dynid.cli.study:study_merge", "Put the shards of a study into one file."),
    "study-worst": ("dynid.cli.study:study_worst", "Write the scene of a study's worst sample."),
    "plan": ("dynid.cli.plan:plan", "Rank sensors and excitation by the bound they give."),
    "show": ("dynid.cli.show:show", "Print a summary of a result."),
    "report": ("dynid.cli.report:report", "Write one HTML page of a result."),
    "plot": ("dynid.cli.plot:plot", "Write the figures of a result as files."),
    "watch": ("dynid.cli.watch:watch", "Run a scene whenever it changes, with a live page."),
    "export": ("dynid.cli.export:export", "Write a result for other tools: CSV, Parquet, JSON, .mat, .mtx."),
    "compare": ("dynid.cli.compare:compare", "List the differences between two results."),
    "new": ("dynid.cli.new:new", "Write a commented template scene."),
    "schema": ("dynid.cli.schema:schema", "Print the JSON Schema of scenes."),
    "bench": ("dynid.cli.bench:bench", "Measure speed against error, now."),
    "help": ("dynid.cli.help:help_", "Explain a topic at length."),
}

#: The commands as `dynid --help` lists them: by what one is about to do.
GROUPS = {
    "Run": ("new", "check", "run", "plan"),
    "Studies": ("study", "study-merge", "study-worst"),
    "Look at results": ("show", "report", "plot", "watch", "compare", "export"),
    "Help": ("help", "schema", "bench"),
}


class LazyGroup(click.Group):
    """A group that imports a command when it is used."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the names of the commands, in the order of use."""
        return [name for names in GROUPS.values() for name in names]

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:  # noqa: ARG002
        """Import and return a command."""
        if name not in COMMANDS:
            return None
        module, _, function = COMMANDS[name][0].partition(":")
        command: click.Command = getattr(import_module(module), function)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command, and suggest one where there is none."""
        if args and args[0].startswith("-"):
            ctx.fail(f"No such option '{args[0]}'")
        if args and args[0] not in COMMANDS:
            from dynid.suggestions import did_you_mean

            ctx.fail(f"no command '{args[0]}'{did_you_mean(args[0], COMMANDS)}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """List the commands without importing any."""
        width = max(map(len, COMMANDS))
        for title, names in GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(width), COMMANDS[name][1]) for name in names])


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="dynid", message="%(prog)s %(version)s")
@click.option(
    "--cite",
    is_flag=True,
    expose_value=False,
    is_eager=True,
    callback=lambda context, _option, asked: _cite(context, asked),
    help="Show how to cite dynid, and exit.",
)
def cli() -> None:
    """Bond graphs in the frequency domain, and joint identification on reduced FE models.

    One YAML scene in, one HDF5 file out. Start with: dynid new bond-graph, then dynid run bond-graph.yaml.
    At length: dynid help
    """


def _cite(context: click.Context, asked: bool) -> None:
    if asked:
        from dynid.cli.citation import citation

        click.echo(citation())
        context.exit()


def main(args: list[str] | None = None) -> None:
    """Run the command line and exit: 0 done, 1 expectation failed, 2 usage or scene, 3 numerics, 4 files."""
    # Threads cut sums up, and rounding with them: a scene gives the same bytes on any number of cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without ω still gets the rest
    # pydantic looks for plugins in all that is installed: as long as it takes to check a scene, for nothing.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
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
        error.show()
        return 2
    except (KeyboardInterrupt, click.Abort):
        click.echo("interrupted; no file was left incomplete", err=True)
        return 130
    except MemoryError:
        click.echo("this needs more memory than there is; ask for fewer points, samples or results", err=True)
        return 3
    except SystemExit:
        return 4  # click's way to say that the reader of our output has left, who needs no message
    except OSError as error:
        said = f"{error.filename or 'the output'} cannot be read or written: {error.strerror or error}"
        click.echo(said, err=True)
        return 4
    except Exception as error:
        click.echo(_unforeseen(error), err=True)
        return 3
    return code if isinstance(code, int) else 0


def _unforeseen(error: Exception) -> str:
    """Say where an error came from that nobody thought of; with DYNID_TRACEBACK set, let it through."""
    if os.environ.get("DYNID_TRACEBACK"):
        raise error
    places = []
    trace = error.__traceback__
    while trace is not None:
        places.append((str(trace.tb_frame.f_globals.get("__name__")), trace.tb_lineno))
        trace = trace.tb_next
    module, line = next(place for place in reversed(places) if place[0].startswith("dynid"))
    said = " ".join(f"{type(error).__name__} {error}".split())
    return f"this is a fault of dynid itself ({said}, {module}:{line}). Please report it, with the scene."
