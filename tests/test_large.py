"""Observations that are large: in files instead of memory, and in pieces beside checkpoints."""

import errno
import os
import shutil

import commands
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.runs import _pieces, folders

PIXELS = np.arange(8)


def seen(genotypes):
    """Images of a spot, (n, 8, 8) uint8."""
    x, y = (np.exp(-((PIXELS - 8 * gene[:, None]) ** 2) / 4) for gene in genotypes.T)
    return (255 * y[:, :, None] * x[:, None, :]).astype(np.uint8)


def in_streams(genotypes):
    return {"eye": seen(genotypes), "place": genotypes.astype(np.float32)}


def made(**options):
    return auroraqd.Aurora(2, PCA(n_components=2), seed=0, batch_size=50, **options)


@pytest.fixture
def small_pieces(monkeypatch):
    """Any observations are large, a piece has 30 of them."""
    monkeypatch.setattr(_pieces, "_LARGE", 1)
    monkeypatch.setattr(_pieces, "_MOST_BYTES", 30 * 64)


def assert_same(one, other):
    assert set(one.columns) == set(other.columns)
    for name, rows in one.columns.items():
        assert_array_equal(rows, other.columns[name])


@pytest.mark.parametrize("task", [seen, in_streams])
@pytest.mark.parametrize("archive", [auroraqd.UnstructuredArchive, lambda: auroraqd.DominatedArchive(capacity=90)])
def test_observations_in_a_folder_are_as_in_memory(task, archive, tmp_path):
    descriptor = PCA(2)
    memory, disk = (
        auroraqd.Aurora(2, descriptor, seed=0, batch_size=50, archive=archive(), **options).run(task, generations=60)
        for options in ({}, {"observations": tmp_path / "there"})
    )
    assert_same(memory.archive, disk.archive)
    assert list((tmp_path / "there").iterdir()) == []  # files without names
    base = disk.archive.observation
    while isinstance(base, np.ndarray):
        base = base.base
    assert type(base).__name__ in ("mmap", "memoryview")


def test_a_full_archive_can_be_moved_and_a_run_goes_on_from_disk(tmp_path):
    aurora, twin = (made().run(seen, generations=20) for _ in range(2))
    aurora.archive.keep_observations(tmp_path)
    assert_same(aurora.archive, twin.archive)
    folder = auroraqd.save(aurora, tmp_path / "run")
    again = auroraqd.resume(folder, observations=tmp_path)
    for run in (aurora, twin, again):
        run.run(seen, generations=40)
    assert_same(aurora.archive, twin.archive)
    assert_same(again.archive, twin.archive)


def test_of_a_full_disk_nothing_is_lost(tmp_path, monkeypatch):
    if not hasattr(os, "posix_fallocate"):
        pytest.skip("this system cannot say so before")
    aurora = made(observations=tmp_path).run(seen, generations=3)
    twin = made().run(seen, generations=3)
    reserve = os.posix_fallocate

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(OSError, match=r"has no room for [0-9,]+ bytes of observations: No space left"):
        aurora.run(seen, generations=100)
    monkeypatch.setattr(os, "posix_fallocate", reserve)
    twin.run(seen, until_generation=aurora.generation)
    assert_same(aurora.archive, twin.archive)
    for run in (aurora, twin):
        run.run(seen, generations=30)
    assert_same(aurora.archive, twin.archive)


def test_a_place_for_observations_that_is_none(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(NotADirectoryError, match="file must be a folder, and is a file"):
        made(observations=tmp_path / "file")
    with pytest.raises(TypeError, match="observations must be a path, got 3"):
        made(observations=3)


def test_on_the_command_line(tmp_path):
    run = ["run", "ballistic", "--descriptor", "genotype", "-n", 3, "--batch-size", 20, "--no-figures", "--no-snapshots"]
    done = [
        commands.cli(*run, "--out", "memory", cwd=tmp_path),
        commands.cli(*run, "--out", "disk", "--observations", "scratch", cwd=tmp_path),
        commands.cli("resume", "disk", "-n", 4, "--observations", "scratch", "--no-figures", cwd=tmp_path),
        commands.cli("resume", "memory", "-n", 4, "--no-figures", cwd=tmp_path),
    ]
    assert [one.returncode for one in done] == [0] * 4, done[-1].stderr
    assert_same(auroraqd.load(tmp_path / "memory"), auroraqd.load(tmp_path / "disk"))
    (tmp_path / "file").touch()
    wrong = commands.cli(*run, "--out", "other", "--observations", "file", cwd=tmp_path)
    assert (wrong.returncode, "file must be a folder, and is a file" in wrong.stderr) == (1, True)
    assert "Traceback" not in wrong.stderr


def rows_in(folder):
    return {path.name: len(_pieces._read(path)[0]) for path in sorted((folder / _pieces.FOLDER).iterdir())}


@pytest.mark.parametrize("task", [seen, in_streams])
def test_a_checkpoint_writes_what_is_new(task, small_pieces, tmp_path):
    aurora, twin = made(), made()
    with auroraqd.Checkpoints(aurora, tmp_path, every=0) as checkpoints:
        aurora.run(task, generations=4, callback=checkpoints)
        before = rows_in(tmp_path)
        stored = set(aurora.archive.id.tolist())
        aurora.run(task, generations=1, callback=checkpoints)
        after = rows_in(tmp_path)
        fresh = set(aurora.archive.id.tolist()) - stored
        assert fresh
        assert sum(after.values()) - sum(before.values()) == len(fresh)
        assert before.items() < after.items()
        assert max(after.values()) <= 30
        assert_same(auroraqd.load(tmp_path), aurora.archive)
    assert (tmp_path / folders.REPERTOIRE).stat().st_size < 10**6
    again = auroraqd.resume(tmp_path)
    with auroraqd.Checkpoints(again, tmp_path, every=0) as checkpoints:
        again.run(task, generations=60, callback=checkpoints)
    assert_same(again.archive, twin.run(task, generations=65).archive)
    assert_same(auroraqd.load(tmp_path), again.archive)
    # An update of the descriptor has let many go: what is theirs was not kept for long.
    assert sum(rows_in(tmp_path).values()) <= 3 * len(again.archive)
    assert_same(auroraqd.load(auroraqd.save(again, tmp_path)), again.archive)
    assert sum(rows_in(tmp_path).values()) == len(again.archive)


def test_there_are_never_many_pieces(tmp_path, monkeypatch):
    monkeypatch.setattr(_pieces, "_LARGE", 1)
    monkeypatch.setattr(_pieces, "_MOST_PIECES", 3)  # and two that all would take
    aurora, numbers = made(), []
    with auroraqd.Checkpoints(aurora, tmp_path, every=0) as checkpoints:
        for _ in range(12):
            aurora.run(seen, generations=1, callback=checkpoints)
            numbers.append(len(set(rows_in(tmp_path))))
            assert_same(auroraqd.load(tmp_path), aurora.archive)
    assert numbers[:3] == [1, 2, 3]
    assert max(numbers) <= 2 * (3 + 2) + 1  # those of the checkpoint before may be there too


def test_small_ones_are_in_the_checkpoint(tmp_path, monkeypatch):
    aurora = made().run(seen, generations=3)
    monkeypatch.setattr(_pieces, "_LARGE", 1)
    auroraqd.save(aurora, tmp_path)
    assert (tmp_path / _pieces.FOLDER).is_dir()
    monkeypatch.undo()
    auroraqd.save(aurora, tmp_path)
    assert not (tmp_path / _pieces.FOLDER).exists()
    assert_same(auroraqd.load(tmp_path), aurora.archive)


def damaged(path):
    content = bytearray(path.read_bytes())
    content[-5] ^= 1
    path.write_bytes(content)


def of_others(path):
    ids, rows = _pieces._read(path)
    folders._tensors.write(path, {"id": ids + 10**6, "observation": rows}, _pieces._FORMAT, "")


def of_another_shape(path):
    ids, rows = _pieces._read(path)
    folders._tensors.write(path, {"id": ids, "observation": rows[:, :4]}, _pieces._FORMAT, "")


def shorter(path):
    ids, rows = _pieces._read(path)
    folders._tensors.write(path, {"id": ids[1:], "observation": rows}, _pieces._FORMAT, "")


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        (damaged, "its checksum is wrong"),
        (os.unlink, "is missing"),
        (of_others, "individuals are in none of its pieces"),
        (of_another_shape, "must have shape"),
        (shorter, "must hold as many observations as ids"),
    ],
)
def test_of_a_damaged_piece_the_checkpoint_before_is_taken(harm, said, small_pieces, tmp_path):
    aurora = made()
    with auroraqd.Checkpoints(aurora, tmp_path / "run", every=0) as checkpoints:
        aurora.run(seen, generations=3, callback=checkpoints)
        before = made().run(seen, generations=2)
        shutil.copytree(tmp_path / "run", tmp_path / "copy")
    newest = max((tmp_path / "copy" / _pieces.FOLDER).iterdir())
    harm(newest)
    with pytest.warns(UserWarning, match=f"{said}.*the checkpoint before it is taken"):
        assert_same(auroraqd.load(tmp_path / "copy"), before.archive)
    oldest = min((tmp_path / "copy" / _pieces.FOLDER).iterdir())
    harm(oldest)
    with pytest.raises(ValueError, match="is damaged"):
        auroraqd.load(tmp_path / "copy")


@pytest.mark.parametrize("names", [b"[", b'["../../secret.safetensors"]', b"[3]", b'{"a": 1}', b"[]"])
def test_names_of_pieces_that_are_lies(names, small_pieces, tmp_path):
    auroraqd.save(made().run(seen, generations=3), tmp_path)
    path = tmp_path / folders.REPERTOIRE
    arrays, kind = folders._tensors.read(path, folders._FORMAT)
    folders._tensors.write(path, {**arrays, _pieces._NAMES: np.frombuffer(names, np.uint8)}, folders._FORMAT, kind)
    with pytest.raises(ValueError, match=f"{path} is damaged"):
        auroraqd.load(tmp_path)
