"""What the command line says of itself: help in any width, and completion by shells."""

import inspect
import os
import re
import shutil
import subprocess
import sys

import pytest
import typer
from typer.testing import CliRunner

from auroraqd.archives.unstructured import UnstructuredArchive
from auroraqd.cli import app
from auroraqd.cli._names import NAMES
from auroraqd.experiments import settings
from auroraqd.experiments.catalogue import EXPERIMENTS

COMMANDS = typer.main.get_command(app).commands


def asked(*words, width=None, **environment):
    done = CliRunner().invoke(app, words, env={"COLUMNS": "10000"} | environment, prog_name="auroraqd", terminal_width=width)
    assert done.exit_code == 0
    return done.stdout


@pytest.mark.parametrize("width", [60, 80, 120])
def test_help_is_whole_in_any_width(width):
    overview = " ".join(asked("--help", width=width).split())
    for name, command in COMMANDS.items():
        done = asked(name, "--help", width=width)
        assert max(map(len, done.splitlines())) <= width
        said = " ".join(re.sub(r"-\n +", "-", done).split())  # words with hyphens may be on two lines
        purpose, *rest = inspect.cleandoc(command.help).split("\n\n")
        assert f"{name} {' '.join(purpose.split())}" in overview
        for paragraph in (purpose, *rest, *(parameter.help for parameter in command.params)):
            assert " ".join(paragraph.split()) in said, f"{name}: {paragraph}"


@pytest.mark.parametrize("width", [60, 80])
def test_examples_in_help_are_in_one_line_to_be_copied(width):
    found = 0
    for name, command in COMMANDS.items():
        for example in re.findall(r"Example: .*", command.help):
            assert f"  {example}" in asked(name, "--help", width=width).splitlines()
            found += 1
    assert found >= 6


def test_names_that_are_completed_are_those_that_there_are():
    there = {
        "task": settings.TASKS,
        "experiment": [*EXPERIMENTS, "paper"],
        "descriptor": settings.DESCRIPTORS,
        **settings.STRATEGIES,
    }
    assert {kind: {name for name in names if ":" not in name} for kind, names in there.items()} == {
        kind: set(names) for kind, names in NAMES.items() if kind != "competition"
    }
    for name in NAMES["competition"]:
        assert UnstructuredArchive(competition=name).competition == name


@pytest.mark.parametrize(
    ("words", "completions"),
    [
        ("auroraqd r", {"run", "repeat", "resume", "reproduce"}),
        ("auroraqd run ", {"ballistic", "air-hockey", "air-hockey-camera", "maze", "hexapod", "octopus-arm"}),
        ("auroraqd run air", {"air-hockey", "air-hockey-camera"}),
        ("auroraqd run ballistic --archive cvt", {"cvt", "cvt-prior"}),
        ("auroraqd run ballistic --selection ", set(NAMES["selection"])),
        ("auroraqd run ballistic --save", {"--save-config"}),
        ("auroraqd run mymodule:", set()),
    ],
)
def test_what_shells_are_told(words, completions):
    bash = asked(_AURORAQD_COMPLETE="complete_bash", COMP_WORDS=words, COMP_CWORD=str(words.count(" ")))
    assert set(bash.split()) == completions
    fish = asked(_AURORAQD_COMPLETE="complete_fish", _TYPER_COMPLETE_FISH_ACTION="get-args", _TYPER_COMPLETE_ARGS=words)
    assert {line.partition("\t")[0] for line in fish.splitlines() if line} == completions
    zsh = asked(_AURORAQD_COMPLETE="complete_zsh", _TYPER_COMPLETE_ARGS=words)
    assert all(name in zsh for name in completions)


def test_completion_imports_nothing_heavy():
    line = [sys.executable, "-X", "importtime", "-m", "auroraqd"]
    asking = {"_AURORAQD_COMPLETE": "complete_bash", "COMP_WORDS": "auroraqd run b", "COMP_CWORD": "2"}
    done = subprocess.run(line, env=os.environ | asking, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["ballistic"]
    assert not re.search(r"\| (numpy|numba|sklearn|matplotlib|scipy|jax)\n", done.stderr)


IN_SHELLS = {  # what the shells themselves make of it
    "bash": """
eval "$(auroraqd --show-completion)"
COMP_WORDS=(auroraqd run ba) COMP_CWORD=2
_auroraqd_completion auroraqd
echo "${COMPREPLY[@]}"
complete -p auroraqd
""",
    "fish": """
auroraqd --show-completion | source
complete -C "auroraqd run ba"
complete -C "auroraqd "
""",
    "zsh": """
autoload -Uz compinit; compinit -D
eval "$(auroraqd --show-completion)"
_arguments() { print -r -- "$@" }
words=(auroraqd run ba) CURRENT=3
$_comps[auroraqd]
""",
}
SHELLS = {"bash": ["bash", "--norc", "-c"], "zsh": ["zsh", "-f", "-c"], "fish": ["fish", "--no-config", "-c"]}


@pytest.mark.parametrize("shell", SHELLS)
def test_shells_complete(tmp_path, shell):
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not there")
    (tmp_path / "auroraqd").write_text(f'#!/bin/sh\nexec "{sys.executable}" -m auroraqd "$@"\n')
    (tmp_path / "auroraqd").chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}", "HOME": str(tmp_path)}
    done = subprocess.run([*SHELLS[shell], IN_SHELLS[shell]], env=environment, capture_output=True, text=True, check=True)
    assert not done.stderr
    assert "ballistic" in done.stdout.splitlines()[0]
    assert "air-hockey" not in done.stdout
    if shell == "bash":
        assert "-F _auroraqd_completion auroraqd" in done.stdout
    if shell == "fish":  # with what each is for, which must not be taken for more names
        assert {line.partition("\t")[0] for line in done.stdout.splitlines()[1:]} == set(COMMANDS)
