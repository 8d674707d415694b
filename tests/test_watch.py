"""`auroraqd watch`: what it shows of a run, also of one that is being written, and how it ends."""

import json
import os
import pty
import signal
import subprocess
import time

import commands
import numpy as np
import pytest

import auroraqd
from auroraqd.cli._drawn import character_map, sparkline


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A run, and one that is a generation further."""
    place, task = tmp_path_factory.mktemp("watch"), auroraqd.tasks.Ballistic()
    aurora = auroraqd.Aurora(2, "hand-coded", seed=0, batch_size=50).run(task, generations=4)
    auroraqd.save(aurora, place / "run", config={"task": "ballistic", "generations": 9, "seed": 0, "descriptor": "x\x1b[2J"})
    return place / "run"


def watched(*arguments, code=0):
    done = commands.cli("watch", *arguments, "--once")
    assert done.returncode == code, done.stdout + done.stderr
    return done


def test_it_shows_how_the_run_is(saved):
    said = watched(saved).stdout
    skills = auroraqd.load(saved)
    assert "generation 4 of 9, 200 evaluations, saved" in said
    assert f"ground truth, {len(skills):,} skills" in said
    for name in ("skills", "l ", "added a generation"):
        assert f"\n{name}" in said
    assert "error" not in said  # the descriptor is not learned
    assert sum(0x2800 < ord(letter) < 0x2900 for letter in said) > 30
    assert "\x1b" not in said


def test_it_needs_no_unicode(saved):
    line, environment = [*commands.CLI, "watch", saved, "--once"], {**os.environ, "PYTHONIOENCODING": "ascii"}
    said = subprocess.run(line, env=environment, capture_output=True, text=True, check=True).stdout
    assert said.isascii()
    assert "#" in said


def copy(saved, folder, **content):
    for name in ("config.json", "history.csv", "repertoire.safetensors"):
        (folder / name).write_bytes(content.get(name.partition(".")[0], (saved / name).read_bytes()))
    return folder


def test_the_last_good_checkpoint_is_shown(saved, tmp_path):
    half = (saved / "repertoire.safetensors").read_bytes()[:1000]
    copy(saved, tmp_path, repertoire=half)
    assert "is damaged" in watched(tmp_path, code=1).stderr
    (tmp_path / "repertoire.previous.safetensors").write_bytes((saved / "repertoire.safetensors").read_bytes())
    assert "generation 4 of 9" in watched(tmp_path).stdout


def test_a_run_without_a_checkpoint_and_what_is_no_run(saved, tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"seed": 1}))
    assert "no checkpoint yet" in watched(tmp_path).stdout
    assert "there is no folder" in watched(tmp_path / "none", code=1).stderr
    auroraqd.save(auroraqd.Aurora(2, "genotype", seed=0), tmp_path / "empty")
    assert "no checkpoint yet" in watched(tmp_path / "empty").stdout


def test_it_follows_a_run_and_ends_with_control_c(saved, tmp_path):
    copy(saved, tmp_path)
    ours, theirs = pty.openpty()
    line = [*commands.CLI, "watch", tmp_path, "--every", "0.1"]
    with subprocess.Popen(line, stdout=theirs, stderr=theirs, stdin=theirs, env={**os.environ, "TERM": "xterm"}) as process:
        os.close(theirs)
        said = b""

        def until(words):
            nonlocal said
            end = time.monotonic() + 120
            while words not in said:
                assert time.monotonic() < end, said
                said += os.read(ours, 65536)

        try:
            until(b"generation 4 of 9")
            (tmp_path / "repertoire.safetensors").write_bytes(b"half")  # a run that is killed, or another's disk
            until(b"what was read before is shown")
            task = auroraqd.tasks.Ballistic()
            further = auroraqd.Aurora(2, "hand-coded", seed=0, batch_size=50).run(task, generations=5)
            auroraqd.save(further, tmp_path, config={"generations": 9}, overwrite=True)
            until(b"generation 5 of 9")
            process.send_signal(signal.SIGINT)
            assert process.wait(60) == 0
        finally:
            process.kill()
            os.close(ours)


def test_sparklines():
    assert sparkline([0, 1, 2, 3, 4, 5, 6, 7], 20) == "▁▂▃▄▅▆▇█"
    assert sparkline([3, 3, np.nan, 3], 20) == "▁▁ ▁"
    assert sparkline([np.nan], 20) == " "
    assert sparkline([], 20) == ""
    assert sparkline([-1.7e308, 0, 1.7e308, np.inf], 20) == "▁▅█ "
    assert sparkline(range(1000), 8) == "▁▂▃▄▅▆▇█"
    assert sparkline([0, 1], 8, plain=True) == "_#"


def test_maps_of_characters():
    corners = [[0, 0], [0, 1], [1, 1]]
    assert character_map(corners, 2, 2) == ["\u2801\u2808", "\u2840\u2800"]
    assert character_map(corners, 2, 2, plain=True) == ["##", "# "]
    assert character_map([[np.nan, 1]], 2, 1) == ["\u2800\u2800"]
    assert character_map(np.empty((0, 2)), 2, 1, plain=True) == ["  "]
    assert character_map([[1e308, -1e308], [-1e308, 1e308]], 1, 1) == ["\u2881"]
