"""The command line, a module for what belongs together. Heavy imports are inside the commands: `--help` must answer at once."""

import os
import sys
import warnings
from typing import Annotated

import typer

from auroraqd import __version__
from auroraqd.cli import discover, doctor, new_task, reproduce, show, watch
from auroraqd.cli._shared import UserError, console, errors

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Let a robot find out by itself what it can do: Quality-Diversity with learned behavioural descriptors (AURORA).",
)
_runs = discover.run, discover.repeat, discover.resume
_looks = watch.watch, show.show, show.explore, show.animate
for command in (*_runs, *_looks, show.deploy, new_task.new_task, doctor.doctor, reproduce.reproduce):
    purpose = (command.__doc__ or "").partition("\n\n")[0]  # whole, for Typer would cut it; in a line, as shells want it
    app.command(short_help=" ".join(purpose.split()))(command)


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
    if "_AURORAQD_COMPLETE" in os.environ:  # a shell asks, and wants a line for each name, however long
        os.environ["COLUMNS"] = "10000"
    warnings.showwarning = lambda message, *_, **__: errors.print(f"Warning: {message}", highlight=False)
    try:
        app(prog_name="auroraqd")
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
