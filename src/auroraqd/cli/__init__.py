"""The command line, a module for what belongs together. Heavy imports are inside the commands: `--help` must answer at once."""

import sys
import warnings
from typing import Annotated

import typer

from auroraqd import __version__
from auroraqd.cli import discover, reproduce, show, watch
from auroraqd.cli._shared import UserError, console, errors

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Let a robot find out by itself what it can do: Quality-Diversity with learned behavioural descriptors (AURORA).",
)
_runs = discover.run, discover.repeat, discover.resume
for command in (*_runs, watch.watch, show.show, show.explore, show.animate, reproduce.reproduce):
    app.command()(command)


def _show_version(wanted: bool) -> None:
    if wanted:
        console.print(f"auroraqd {__version__}", highlight=False)
        raise typer.Exit


@app.callback()
def _options(
    _version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def main() -> None:
    """The `auroraqd` command."""
    warnings.showwarning = lambda message, *_, **__: errors.print(f"Warning: {message}", highlight=False)
    try:
        app(standalone_mode=True)
    except OSError as error:  # one that nobody made a sentence of has a number and a file
        _fail(f"{error.filename}: {error.strerror}" if error.filename and error.strerror else str(error))
    except (UserError, ValueError) as error:
        _fail(str(error))
    except MemoryError as error:
        _fail(f"there is not enough memory: {error}")


def _fail(message: str) -> None:
    errors.print("Error: ", end="", style="bold red")
    errors.print(message, highlight=False)
    sys.exit(1)
