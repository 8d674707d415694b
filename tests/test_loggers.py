"""Loggers, with the libraries themselves."""

import copy
import csv
import errno
import json
import struct
import sys
import time
import warnings

import numpy as np
import pytest
from sklearn.decomposition import PCA
from test_cli import command

import auroraqd
from auroraqd.callbacks import CSV, MLflow, TensorBoard, WeightsAndBiases
from auroraqd.callbacks.loggers import settings_of
from auroraqd.cli import UserError
from auroraqd.cli._shared import loggers
from auroraqd.history import Record


def task(genotypes):
    return genotypes.sum(axis=1), np.repeat(genotypes, 3, axis=1)


def made(**options):
    return auroraqd.Aurora(2, PCA(2), seed=0, batch_size=20, schedule=auroraqd.Every(4), **options)


def lines_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_csv_has_the_history(tmp_path):
    path = tmp_path / "logs" / "run.csv"
    aurora = made().run(task, generations=6, callback=CSV(path, also=lambda run: {"twice": 2 * run.generation}))
    lines = lines_of(path)
    assert len(lines) == 6
    for line, record in zip(lines, aurora.history.records, strict=True):
        assert {name: float(line[name]) for name in Record._fields} == pytest.approx(record._asdict(), nan_ok=True)
        assert float(line["twice"]) == 2 * record.generation
    assert [line["updated"] for line in lines] == ["1", "0", "0", "0", "1", "0"]  # the first fit, and generation 4


def test_csv_is_on_disk_at_once_and_skips(tmp_path):
    path, seen = tmp_path / "run.csv", []
    made().run(
        task, generations=6, callback=[CSV(path, every=2), lambda _: seen.append(len(lines_of(path)) if path.exists() else 0)]
    )
    assert seen == [0, 1, 1, 2, 2, 3]
    assert [line["generation"] for line in lines_of(path)] == ["2", "4", "6"]
    assert [line["updated"] for line in lines_of(path)] == ["1", "0", "1"]


def test_csv_of_a_run_that_is_resumed_has_no_line_twice(tmp_path):
    path, aurora = tmp_path / "run.csv", made()
    aurora.run(task, generations=3, callback=CSV(path))
    crashed = copy.deepcopy(aurora)
    crashed.run(task, generations=3, callback=CSV(path))
    with path.open("a") as file:
        file.write("7,14")  # the power failed
    aurora.run(task, generations=5, callback=CSV(path))
    assert [line["generation"] for line in lines_of(path)] == list("12345678")
    made().run(task, generations=1, callback=CSV(path))
    assert [line["generation"] for line in lines_of(path)] == ["1"]
    assert [line["generation"] for line in lines_of(tmp_path / "run.csv.previous")] == list("12345678")


def test_a_file_that_is_no_log_is_left_alone(tmp_path):
    path = tmp_path / "thesis.csv"
    path.write_text("years,of,work\n1,2,3\n")
    with pytest.warns(UserWarning, match="CSV could not log generation 0, and the run goes on: .*something else than a log"):
        assert made().run(task, generations=3, callback=CSV(path)).generation == 3
    assert path.read_text() == "years,of,work\n1,2,3\n"


def test_other_columns_than_before_are_said_once(tmp_path):
    path, aurora = tmp_path / "run.csv", made()
    aurora.run(task, generations=1, callback=CSV(path))
    with pytest.warns(UserWarning, match="has the columns") as said:
        aurora.run(task, generations=3, callback=CSV(path, also=lambda _: {"more": 1.0}))
    assert len(said) == 1
    assert len(lines_of(path)) == 1


def test_a_full_disk_does_not_end_the_run(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(type(tmp_path), "open", full)
    with pytest.warns(UserWarning, match="No space left on device") as said:
        assert made().run(task, generations=4, callback=CSV(tmp_path / "run.csv")).generation == 4
    assert len([warning for warning in said if "CSV" in str(warning.message)]) == 1


def test_no_half_line_is_left(tmp_path, monkeypatch):
    """A disk that takes a part of a line, and later has room again."""
    path, aurora = tmp_path / "run.csv", made()
    logger = CSV(path)
    aurora.run(task, generations=1, callback=logger)
    opened = type(path).open

    class Full:
        def __init__(self, file):
            self.file = file

        def __enter__(self):
            return self

        def __exit__(self, *_):
            self.file.close()

        def __getattr__(self, name):
            return getattr(self.file, name)

        def write(self, line):
            return self.file.write(line[:9])

    with monkeypatch.context() as patched:
        patched.setattr(type(path), "open", lambda self, *args, **options: Full(opened(self, *args, **options)))
        with pytest.warns(UserWarning, match="the disk is full"):
            aurora.run(task, generations=1, callback=CSV(path))
    aurora.run(task, generations=1, callback=CSV(path))
    assert [line["generation"] for line in lines_of(path)] == ["1", "3"]


def test_tensorboard(tmp_path):
    aurora = made()
    aurora.run(task, generations=3, callback=TensorBoard(tmp_path / "board"))
    aurora.run(task, generations=2, callback=TensorBoard(tmp_path / "board"))
    events = [event for path in sorted((tmp_path / "board").iterdir()) for event in events_in(path)]
    found = [(event.step, value.tag, value.simple_value) for event in events for value in event.summary.value]
    assert [(step, value) for step, tag, value in found if tag == "size"] == [
        (record.generation, record.size) for record in aurora.history.records
    ]
    assert [step for step, tag, value in found if tag == "updated" and value] == [1, 5]
    settings = [value for event in events for value in event.summary.value if value.tag.startswith("settings")]
    assert "| batch_size | 20 |" in settings[0].tensor.string_val[0].decode()


def events_in(path):
    """Records of a file of TensorBoard: length, checksum, content, checksum."""
    from tensorboardX.proto.event_pb2 import Event

    content = path.read_bytes()
    while content:
        (length,) = struct.unpack("<Q", content[:8])
        yield Event.FromString(content[12 : 12 + length])
        content = content[16 + length :]


@pytest.fixture
def quiet(monkeypatch, tmp_path):
    monkeypatch.setenv("WANDB_SILENT", "true")
    monkeypatch.setenv("WANDB_DIR", str(tmp_path))
    monkeypatch.setenv("WANDB_API_KEY", "0" * 40)
    monkeypatch.setenv("MLFLOW_ALLOW_FILE_STORE", "true")


def test_weights_and_biases_offline(quiet, tmp_path):
    aurora, logger = made(), WeightsAndBiases("skills", dir=str(tmp_path))
    aurora.run(task, generations=3, callback=logger)
    first = logger.id
    aurora.run(task, generations=2, callback=logger)
    assert logger.id == first is not None
    end = time.monotonic() + 60
    while True:  # a process of its own writes, which may be late
        sizes, configs = [], []
        for path in sorted(tmp_path.glob("wandb/offline-run-*/run-*.wandb")):
            for record in records_in(path):
                items = {item.key or item.nested_key[0]: json.loads(item.value_json) for item in record.history.item}
                sizes += [items["size"]] if items else []
                configs += [{item.key: json.loads(item.value_json) for item in record.run.config.update}]
        if len(sizes) == 5 or time.monotonic() > end:
            break
        time.sleep(0.2)
    assert sizes == [record.size for record in aurora.history.records]
    assert any(config.get("n_genes") == 2 for config in configs)


def records_in(path):
    """Records of a file of W&B, as of LevelDB: in blocks, each with checksum, length and kind."""
    from wandb.proto.wandb_internal_pb2 import Record

    content, place, parts = path.read_bytes(), 7, b""
    while place + 7 <= len(content):
        if (left := 2**15 - place % 2**15) < 7:
            place += left
            continue
        length, kind = struct.unpack("<HB", content[place + 4 : place + 7])
        parts += content[place + 7 : place + 7 + length]
        place += 7 + length
        if kind in (1, 4):  # whole, or the last of its parts
            yield Record.FromString(parts)
            parts = b""


def test_weights_and_biases_without_network(quiet, tmp_path, monkeypatch):
    import wandb

    logger = WeightsAndBiases(
        "skills", mode="online", dir=str(tmp_path), settings=wandb.Settings(init_timeout=1, base_url="http://127.0.0.1:9")
    )
    with pytest.warns(UserWarning, match="no connection to Weights & Biases, and mode='offline' needs none: ") as said:
        assert made().run(task, generations=3, callback=logger).generation == 3
    assert len(said) == 1
    assert "\n" not in str(said[0].message)


def test_mlflow_in_a_folder(quiet, tmp_path):
    from mlflow import MlflowClient

    uri = (tmp_path / "mlruns").as_uri()
    aurora, logger = made(), MLflow("skills", uri)
    aurora.run(task, generations=3, callback=logger)
    aurora.run(task, generations=2, callback=MLflow("skills", uri, logger.run_id))
    client = MlflowClient(tracking_uri=uri)
    found = client.get_metric_history(logger.run_id, "size")
    assert [(metric.step, metric.value) for metric in found] == [(r.generation, r.size) for r in aurora.history.records]
    run = client.get_run(logger.run_id)
    assert run.info.status == "FINISHED"
    assert run.data.params["n_genes"] == "2"
    assert run.data.params["descriptor"].startswith("PCA(n_components=2")


def test_mlflow_that_cannot_be_reached(tmp_path):
    (tmp_path / "mlruns").touch()
    with pytest.warns(UserWarning, match="MLflow could not log generation 0, and the run goes on: ") as said:
        assert made().run(task, generations=3, callback=MLflow("skills", (tmp_path / "mlruns" / "x").as_uri())).generation == 3
    assert len(said) == 1


@pytest.mark.parametrize(
    ("make", "module", "extra"),
    [
        (lambda: TensorBoard("x"), "tensorboardX", "tensorboard"),
        (lambda: WeightsAndBiases("x"), "wandb", "wandb"),
        (lambda: MLflow(), "mlflow", "mlflow"),
    ],
)
def test_a_library_that_is_missing(monkeypatch, make, module, extra):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ModuleNotFoundError, match=rf'^{module} is not installed: pip install "auroraqd\[{extra}\]"$'):
        make()
    with pytest.raises(UserError, match=f"--log {extra}: {module} is not installed"):
        loggers([{"tensorboard": "tensorboard:x", "wandb": "wandb:project=x", "mlflow": "mlflow"}[extra]])


def test_loggers_change_nothing_and_settings_are_short(tmp_path):
    with_log, without = made(), made()
    with_log.run(task, generations=5, callback=[CSV(tmp_path / "run.csv"), TensorBoard(tmp_path)])
    without.run(task, generations=5)
    assert np.array_equal(with_log.archive.genotype, without.archive.genotype)
    settings = settings_of(with_log)
    assert settings["task"] == "test_loggers:task"
    assert settings["archive"] == "UnstructuredArchive"
    assert json.dumps(settings)
    assert all(len(str(value)) <= 500 and " at 0x" not in str(value) for value in settings.values())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("paper", "--log must be one of csv, tensorboard, wandb, mlflow, got 'paper'"),
        ("csv", "--log csv needs a path: write csv:PATH"),
        ("wandb:mode=online", "--log wandb needs a project: write wandb:project=NAME"),
        ("wandb:project=x,color=red", "--log wandb has no option 'color'; its options are: project, mode,"),
        ("wandb:project=x,mode=fast", "--log wandb: mode must be one of offline, online, disabled, got 'fast'"),
    ],
)
def test_options_of_the_command_line_that_mean_nothing(text, message):
    with pytest.raises(UserError, match=message):
        loggers([text])


def test_options_of_the_command_line(tmp_path):
    one, other = loggers([f"csv:{tmp_path}/a=b,c:d.csv", "mlflow:tracking_uri=http://localhost:5000,experiment=e"])
    assert one._path == tmp_path / "a=b,c:d.csv"
    assert (other._uri, other._experiment) == ("http://localhost:5000", "e")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert loggers(None) == []


def test_the_command_line_logs(tmp_path):
    out, log = tmp_path / "run", ["--log", f"csv:{tmp_path}/run.csv", "--log", f"tensorboard:{tmp_path}/board"]
    command("run", "ballistic", "--descriptor", "genotype", "-n", 2, "--no-figures", "--out", out, *log)
    command("resume", out, "-n", 3, "--no-figures", *log)
    assert [line["generation"] for line in lines_of(tmp_path / "run.csv")] == ["1", "2", "3"]
    assert len(list((tmp_path / "board").iterdir())) == 2
    assert "--log must be one of" in command("run", "ballistic", "--log", "paper", ok=False).stderr
