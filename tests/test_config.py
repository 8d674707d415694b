"""Options of commands in TOML files."""

import json
import tomllib

import commands
import pytest
import typer

from auroraqd.cli import app

RUN = ["run", "ballistic", "--descriptor", "genotype", "-n", 3, "--batch-size", 20, "--no-figures"]


def command(*arguments, cwd, ok=True):
    done = commands.cli(*arguments, cwd=cwd)
    assert (done.returncode == 0) == ok, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    return done


def files_of(folder):
    """What a run has left, without when and by which command."""
    config = json.loads((folder / "config.json").read_text())
    del config["provenance"]["command"], config["provenance"]["date"]
    names = ("repertoire.safetensors", "snapshots/00000001.safetensors")
    return config, *((folder / name).read_bytes() for name in names if (folder / name).exists())


def test_a_run_by_saved_options_is_the_same_run(tmp_path):
    odd = ["--archive", "grid:cells=8,low=0", "--variation", "gaussian:sigma=0.05", "--seed", 2**70, "--no-robust"]
    odd += ["--survival", 0.125, "--no-snapshots", "--log", 'csv:a "log" \\ of é.csv', "--checkpoint-every", 3]
    for name, options in (("plain", []), ("odd", odd)):
        command(*RUN, *options, "--out", name, "--save-config", f"{name}.toml", cwd=tmp_path)
        command("run", "--config", f"{name}.toml", "--out", f"{name} again", cwd=tmp_path)
        assert files_of(tmp_path / name) == files_of(tmp_path / f"{name} again")
    saved = tomllib.loads((tmp_path / "odd.toml").read_text())
    assert saved["log"] == ['csv:a "log" \\ of é.csv']
    assert (saved["seed"], saved["checkpoint-every"], saved["figures"]) == (2**70, 3.0, False)
    assert saved.keys().isdisjoint({"out", "overwrite", "config", "save-config", "jobs", "capacity"})
    assert files_of(tmp_path / "plain")[1] != files_of(tmp_path / "odd")[1]


def test_the_command_line_wins(tmp_path):
    (tmp_path / "run.toml").write_text(
        'task = "ballistic"\ndescriptor = "genotype"\ngenerations = 9\nbatch-size = 20\nfigures = true\nseed = 5\n'
        'epsilon = 0\nout = "by-file"\nsnapshots = false\n'
    )
    command("run", "--config", "run.toml", "-n", 2, "--no-figures", cwd=tmp_path)
    config = json.loads((tmp_path / "by-file" / "config.json").read_text())
    assert [config[name] for name in ("generations", "batch_size", "seed", "epsilon")] == [2, 20, 5, 0]
    assert not (tmp_path / "by-file" / "figures").exists()
    assert not (tmp_path / "by-file" / "snapshots").exists()
    options = ["--resolution", "fixed:l=0.1", "--snapshots", "--out", "other", "-n", 2, "--save-config", "new.toml"]
    command("run", "air-hockey", "--config", "run.toml", *options, cwd=tmp_path)
    config = json.loads((tmp_path / "other" / "config.json").read_text())
    assert (config["task"], config["resolution"]["l"], config["seed"]) == ("air-hockey", 0.1, 5)
    assert (tmp_path / "other" / "figures").exists()
    assert (tmp_path / "other" / "snapshots").exists()
    saved = tomllib.loads((tmp_path / "new.toml").read_text())
    assert (saved["task"], saved["generations"], saved["figures"], saved["epsilon"]) == ("air-hockey", 2, True, 0.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("generatons = 3", "run.toml: there is no option 'generatons'; did you mean generations?"),
        ("batch_size = 3", "run.toml: there is no option 'batch_size'; did you mean batch-size?"),
        ("wings = 2", "run.toml: there is no option 'wings'; they are those of `auroraqd run --help`"),
        ('config = "other.toml"', "run.toml: there is no option 'config'"),
        ('save-config = "other.toml"', "run.toml: there is no option 'save-config'"),
        ("help = true", "run.toml: there is no option 'help'"),
        ('generations = "many"', "run.toml: generations must be a whole number, got 'many'"),
        ('generations = "3"', "run.toml: generations must be a whole number, got '3'"),
        ("generations = 3.0", "run.toml: generations must be a whole number, got 3.0"),
        ("seed = true", "run.toml: seed must be a whole number, got True"),
        ('epsilon = "small"', "run.toml: epsilon must be a number, got 'small'"),
        ("epsilon = false", "run.toml: epsilon must be a number, got False"),
        ("figures = 0", "run.toml: figures must be true or false, got 0"),
        ("descriptor = 2", "run.toml: descriptor must be text in quotes, got 2"),
        ("out = 2", "run.toml: out must be a path in quotes, got 2"),
        ('log = "csv:x"', "run.toml: log must be a list of texts in quotes, got 'csv:x'"),
        ("log = [1]", "run.toml: log must be a list of texts in quotes, got [1]"),
        ('[archive]\ntype = "grid"', "run.toml: archive must be text in quotes, got {'type': 'grid'}"),
        ("seed = 2026-01-01", "run.toml: seed must be a whole number, got datetime.date(2026, 1, 1)"),
        ("seed = 1\nseed = 2", "run.toml is no TOML: Cannot overwrite a value"),
        ("generations 3", "run.toml is no TOML: Expected '=' after a key"),
        (b"task = '\xff'", "run.toml is no TOML: 'utf-8' codec can't decode"),
        ("log = " + "[" * 5000, "run.toml is no TOML: "),
        ("generations = 0", "generations must be a whole number, 1 or more, got 0"),
        (
            'task = "juggling"',
            "task must be one of ballistic, air-hockey, air-hockey-camera, maze, hexapod, octopus-arm, or your own",
        ),
        ("checkpoint-every = -1", "Invalid value for '--checkpoint-every'"),
        (None, "there is no file run.toml"),
    ],
)
def test_mistakes_in_a_file_are_a_sentence(tmp_path, text, message):
    if text is not None:
        (tmp_path / "run.toml").write_bytes(text if isinstance(text, bytes) else text.encode())
    task = [] if text and text[:4] == "task" else ["ballistic"]
    done = command("run", *task, "--config", "run.toml", cwd=tmp_path, ok=False)
    assert message in done.stderr
    assert not (tmp_path / "runs").exists()


def test_what_a_file_leaves_out_must_be_given(tmp_path):
    (tmp_path / "run.toml").write_text("generations = 2\n")
    assert "Missing argument" in command("run", "--config", "run.toml", cwd=tmp_path, ok=False).stderr
    assert "there is no file ." in command("run", "--config", ".", cwd=tmp_path, ok=False).stderr


def test_files_of_others_are_not_overwritten(tmp_path):
    file = tmp_path / "run.toml"
    file.write_text("seed = 1 # mine\n")
    saving = [*RUN, "--save-config", "run.toml", "--out", "run"]
    assert "run.toml exists: choose another" in command(*saving, cwd=tmp_path, ok=False).stderr
    assert file.read_text() == "seed = 1 # mine\n"
    assert not (tmp_path / "run").exists()
    assert "run.toml exists: choose another" in command(*saving, "--overwrite", cwd=tmp_path, ok=False).stderr
    file.unlink()
    command(*saving, cwd=tmp_path)
    text = file.read_text()
    assert "seed = 0\n" in text
    assert "holds a run already" in command(*saving, cwd=tmp_path, ok=False).stderr
    command(*saving[:-1], "other", cwd=tmp_path)  # which would write the same
    assert file.read_text() == text
    missing = command(*RUN, "--save-config", "nowhere/run.toml", "--out", "third", cwd=tmp_path, ok=False)
    assert "nowhere/run.toml could not be written: No such file" in missing.stderr


def test_nothing_is_saved_of_a_run_that_cannot_be(tmp_path):
    command("run", "nomod:task", "--save-config", "run.toml", cwd=tmp_path, ok=False)
    assert not (tmp_path / "run.toml").exists()


def test_other_commands(tmp_path):
    (tmp_path / "paper.toml").write_text('task = "ballistic"\nquick = true\nvariants = "none of these"\n')
    done = command("reproduce", "--config", "paper.toml", cwd=tmp_path, ok=False)
    assert "variants of ballistic must be of" in done.stderr


def test_options_are_written_as_at_the_command_line():
    """In a file an option has the name of its parameter."""
    for name in ("run", "reproduce"):
        for parameter in typer.main.get_command(app).commands[name].params:
            if parameter.param_type_name == "option":
                assert f"--{parameter.name.replace('_', '-')}" in parameter.opts
