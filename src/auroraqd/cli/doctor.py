"""`auroraqd doctor`: to see what is there, and what is wrong."""

import typer
from rich.text import Text

from auroraqd.cli._shared import busy, console


def doctor() -> None:
    """Print versions, cores, BLAS, devices and caches, and what is wrong with them.

    If something is, the exit status is 1. What it prints belongs into a report of a bug.
    """
    from auroraqd.cli._health import findings

    with busy("looking"):
        found = list(findings())
    width = max(len(finding.name) for finding in found)
    for finding in found:  # a line each, however long: it is to be copied
        line = Text.assemble((f"{finding.name:<{width}}", "bold"), "  ", finding.found)
        console.print(line, highlight=False, soft_wrap=True)
    wrong = [finding for finding in found if finding.wrong]
    console.print("\nWhat is wrong:" if wrong else "\nNothing is wrong.", highlight=False)
    for finding in wrong:
        console.print(f"- {finding.name}: {finding.wrong}", highlight=False, soft_wrap=True)
    if wrong:
        raise typer.Exit(1)
