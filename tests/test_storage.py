import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from safetensors.numpy import save_file
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.runs import folders

COLUMNS = ("genotype", "fitness", "observation", "descriptor", "ground_truth", "reconstruction_error", "curiosity", "id")


@pytest.fixture(scope="module")
def aurora():
    task = auroraqd.tasks.Ballistic()
    return auroraqd.Aurora(task.n_genes, PCA(n_components=2), seed=0).run(task, generations=10)


@pytest.fixture
def folder(aurora, tmp_path):
    return auroraqd.save(aurora, tmp_path / "deep" / "run")


def test_a_repertoire_comes_back(aurora, folder):
    repertoire = auroraqd.load(folder)
    assert len(repertoire) == len(aurora.archive)
    for name in COLUMNS:
        values = getattr(repertoire, name)
        assert_array_equal(values, getattr(aurora.archive, name))
        assert values.dtype == getattr(aurora.archive, name).dtype
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 0
    assert_allclose(repertoire.describe(repertoire.observation), repertoire.descriptor, atol=1e-9)
    assert "individuals" in repr(repertoire)


def test_equal_runs_give_equal_files(aurora, folder, tmp_path):
    again = auroraqd.Aurora(2, PCA(n_components=2), seed=0).run(auroraqd.tasks.Ballistic(), generations=10)
    other = auroraqd.save(again, tmp_path / "again")
    name = "repertoire.safetensors"
    assert (other / name).read_bytes() == (folder / name).read_bytes()


def test_history_comes_back(aurora, folder):
    assert repr(folders.load_history(folder)) == repr(aurora.history.records)
    assert len(folders.load_history(folder)) == 10


def test_config_says_what_was_run(folder):
    config = folders.load_config(folder)
    assert config["variation"] == {"type": "Polynomial", "rate": 0.1, "eta": 10.0, "at_least_one": True}
    assert config["seed"] == 0
    assert config["environment"]["numpy"] == np.__version__


def test_writing_again_replaces_and_leaves_no_temporary_files(aurora, folder):
    (folder / "figures").mkdir()
    (folder / "figures" / "history.png").write_bytes(b"of another run")
    (folder / "figures" / "mine.png").write_bytes(b"of the user's")
    auroraqd.save(aurora, folder)
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["config.json", "figures", "history.csv", "repertoire.safetensors"]
    assert [path.name for path in (folder / "figures").iterdir()] == ["mine.png"]


@pytest.mark.parametrize("descriptor", ["hand-coded", "genotype"])
def test_descriptors_that_are_not_learned(tmp_path, descriptor):
    task = auroraqd.tasks.Ballistic()
    aurora = auroraqd.Aurora(2, descriptor, seed=0).run(task, generations=2)
    repertoire = auroraqd.load(auroraqd.save(aurora, tmp_path))
    assert_array_equal(repertoire.descriptor, aurora.archive.descriptor)
    assert folders.load_history(tmp_path)[0].size == aurora.history.records[0].size  # NaN in a record is read back
    with pytest.raises(RuntimeError, match="not learned"):
        repertoire.describe(repertoire.observation)


def test_an_empty_run_can_be_saved(tmp_path):
    auroraqd.save(auroraqd.Aurora(2, PCA(n_components=2)), tmp_path)
    assert len(auroraqd.load(tmp_path)) == 0
    assert folders.load_history(tmp_path) == []


class Foreign:
    """A transformer whose type nobody trusts."""

    def __init__(self):
        self.scale = 2.0

    def fit(self, x):
        return self

    def transform(self, x):
        return x[:, -2:] * self.scale


def test_a_foreign_type_is_loaded_only_when_trusted(tmp_path):
    task = auroraqd.tasks.Ballistic()
    auroraqd.save(auroraqd.Aurora(2, Foreign(), seed=0).run(task, generations=2), tmp_path)
    repertoire = auroraqd.load(tmp_path)  # the columns need no trust
    with pytest.raises(ValueError, match="not trusted"):
        repertoire.describe(repertoire.observation)
    trusted = auroraqd.load(tmp_path, trusted=["test_storage.Foreign"])
    assert_allclose(trusted.describe(trusted.observation), trusted.descriptor)


def test_a_transformer_that_cannot_be_saved_does_not_cost_the_repertoire(tmp_path):
    class Unsavable(Foreign):
        def __reduce__(self):
            raise TypeError("no")

        def __deepcopy__(self, memo):
            return self

        @property
        def __dict__(self):
            raise TypeError("no")

    task = auroraqd.tasks.Ballistic()
    unsavable = Unsavable.__new__(Unsavable)
    object.__setattr__(unsavable, "scale", 1.0)
    aurora = auroraqd.Aurora(2, unsavable, seed=0).run(task, generations=1)
    with pytest.warns(UserWarning, match="cannot be saved"):
        auroraqd.save(aurora, tmp_path)
    repertoire = auroraqd.load(tmp_path)
    assert len(repertoire) == len(aurora.archive)
    with pytest.raises(ValueError, match="without its transformer"):
        repertoire.describe(repertoire.observation)


def test_other_shapes_are_refused(folder):
    with pytest.raises(ValueError, match=r"observation must have shape \(n, 50, 2\), as those"):
        auroraqd.load(folder).describe(np.zeros((3, 7)))


def test_missing_folders_and_files(tmp_path, folder):
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        auroraqd.load(tmp_path / "nowhere")
    with pytest.raises(FileNotFoundError, match=r"is no run folder: there is no repertoire\.safetensors"):
        auroraqd.load(tmp_path)
    (folder / "history.csv").unlink()
    with pytest.raises(FileNotFoundError, match="history"):
        folders.load_history(folder)


@pytest.mark.parametrize("keep", [0, 5, 1000, -1])
def test_a_truncated_repertoire(folder, keep):
    path = folder / "repertoire.safetensors"
    content = path.read_bytes()
    path.write_bytes(content[:keep])
    with pytest.raises(ValueError, match="is damaged"):
        auroraqd.load(folder)


def test_other_formats(folder):
    save_file({"a": np.zeros(3)}, folder / "repertoire.safetensors")
    with pytest.raises(ValueError, match="must be of the format 'auroraqd repertoire 2'"):
        auroraqd.load(folder)
    (folder / "config.json").write_text("{")
    with pytest.raises(ValueError, match="damaged"):
        folders.load_config(folder)
    (folder / "config.json").write_text(json.dumps([1]))
    with pytest.raises(ValueError, match="JSON object"):
        folders.load_config(folder)
    for content in ("generation\n1\n", "", ",".join(auroraqd.history.Record._fields) + "\nx\n"):
        (folder / "history.csv").write_text(content)
        with pytest.raises(ValueError, match="damaged"):
            folders.load_history(folder)


def test_what_is_no_run_and_no_folder(aurora, folder, tmp_path):
    for wrong in (auroraqd.load(folder), None, "run"):
        for call in (lambda w=wrong: auroraqd.save(w, tmp_path), lambda w=wrong: auroraqd.Checkpoints(w, tmp_path)):
            with pytest.raises(TypeError, match=r"aurora must be a run, an auroraqd\.Aurora, got "):
                call()
    for call in (auroraqd.load, auroraqd.resume, folders.load_config, folders.load_history):
        with pytest.raises(TypeError, match="folder must be a path, got None"):
            call(None)
    for call in (auroraqd.save, auroraqd.Checkpoints):
        with pytest.raises(TypeError, match="folder must be a path, got 3"):
            call(aurora, 3)


@pytest.mark.parametrize("trusted", ["mymodule.MyEncoder", None, 3, [Foreign]])
def test_trust_is_a_list_of_names(folder, trusted):
    for call in (auroraqd.load, auroraqd.resume):
        with pytest.raises(TypeError, match=r'trusted must be names of types, like \["mymodule.MyEncoder"\], got '):
            call(folder, trusted=trusted)


@pytest.mark.parametrize("name", ["selection", "variation", "schedule", "resolution"])
def test_a_run_goes_on_with_strategies_only(folder, name):
    for wrong in ("uniform", auroraqd.Uniform, *([] if name == "resolution" else [None])):
        with pytest.raises(TypeError, match=f"{name} must be callable, an instance and not a class, got "):
            auroraqd.resume(folder, **{name: wrong})
    assert auroraqd.resume(folder, resolution=None).resolution is None
