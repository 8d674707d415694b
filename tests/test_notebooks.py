"""What notebooks show: a table and a picture of whatever there is, in which nothing can run."""

import base64
import io
import subprocess
import sys
from html.parser import HTMLParser

import numpy as np
import pytest
from matplotlib import image
from sklearn.decomposition import PCA

import auroraqd

EVIL = "</td><script>window.hacked = true</script><img src=x onerror=hacked()>"
ALLOWED = {"div": {"style"}, "table": set(), "tr": set(), "th": {"style", "colspan"}, "td": {"style"}, "img": {"alt", "src"}}


def task(genotypes):
    return genotypes[:, 0], np.tile(genotypes[:, None], (1, 4, 1)), genotypes


def run(**options):
    return auroraqd.Aurora(2, PCA(2), seed=0, batch_size=50, **options).run(task, generations=3)


class Page(HTMLParser):
    """What is in a piece of HTML: texts, and pictures."""

    def __init__(self, html):
        super().__init__()
        self.texts, self.pictures, self.open = [], [], []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        assert {name for name, _ in attrs} <= ALLOWED[tag]
        if tag == "img":
            kind, _, content = dict(attrs)["src"].partition(",")
            assert kind == "data:image/png;base64"
            self.pictures.append(image.imread(io.BytesIO(base64.b64decode(content))))
        else:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


def shown(thing):
    return Page(thing._repr_html_())


@pytest.fixture(scope="module")
def aurora():
    return run()


@pytest.fixture(scope="module")
def repertoire(aurora, tmp_path_factory):
    return auroraqd.load(auroraqd.save(aurora, tmp_path_factory.mktemp("notebooks") / "run"))


def things(aurora, repertoire):
    return {"Aurora": aurora, "UnstructuredArchive": aurora.archive, "Repertoire": repertoire, "History": aurora.history}


def test_each_has_a_table_and_a_picture(aurora, repertoire):
    for name, thing in things(aurora, repertoire).items():
        page = shown(thing)
        assert page.texts[0].startswith(name)
        (picture,) = page.pictures
        assert (picture[..., :3] < 0.9).any(axis=2).mean() > 0.01
        assert f"{len(repertoire):,}" in page.texts
    assert "3" in shown(aurora).texts
    assert shown(repertoire).texts[1:3] == ["task", "test_notebooks:task"]


def test_what_is_empty_has_a_table():
    aurora = auroraqd.Aurora(2, "genotype", seed=0)
    for thing in (aurora, aurora.archive, aurora.history, auroraqd.GridArchive((3, 3))):
        assert shown(thing).pictures == []


@pytest.mark.parametrize("d", [1, 3])
def test_any_number_of_dimensions_and_no_ground_truth(d):
    aurora = auroraqd.Aurora(4, PCA(d), seed=0, batch_size=50).run(lambda g: (g[:, 0], g), generations=2)
    assert len(shown(aurora).pictures) == 1


def test_numbers_that_cannot_be_drawn_leave_the_table():
    archive = auroraqd.UnstructuredArchive()
    places = np.array([[1.7e308, 0], [-1.7e308, 1], [0, -1.7e308]])
    with np.errstate(all="ignore"):
        archive.add(np.full((3, 2), 0.5), np.zeros(3), places, places)
        assert "3" in shown(archive).texts
    truth = np.array([[np.nan, 0.0]] * 3)
    columns = {"genotype": np.full((3, 2), 0.5), "fitness": np.zeros(3), "observation": places, "descriptor": np.eye(3)[:, :2]}
    columns |= {"ground_truth": truth, "curiosity": np.zeros(3), "id": np.arange(3)}
    assert "3" in shown(auroraqd.Repertoire(columns, object())).texts


def test_names_are_text(repertoire, tmp_path):
    evil = type(EVIL, (PCA,), {})
    aurora = auroraqd.Aurora(2, evil(2), seed=0, batch_size=50).run(task, generations=2)
    assert EVIL in "".join(shown(aurora).texts)
    saved = auroraqd.load(auroraqd.save(aurora, tmp_path, config={"task": EVIL, "descriptor": EVIL, "seed": EVIL}))
    assert shown(saved).texts.count(EVIL) == 3


def test_plots_are_figures_that_notebooks_show(repertoire, aurora):
    for figure in (repertoire.plot(), aurora.history.plot(), auroraqd.Aurora(2, "genotype").history.plot()):
        dpi = figure.dpi
        assert min(image.imread(io.BytesIO(figure._repr_png_())).shape[:2]) > 100
        assert figure.dpi == dpi
    assert len(repertoire.plot().axes) == 3
    with pytest.raises(ValueError, match="the repertoire is empty"):
        auroraqd.Repertoire({name: rows[:0] for name, rows in repertoire.columns.items()}, object()).plot()


def test_matplotlib_is_imported_when_it_is_wanted():
    code = (
        "import auroraqd, sys; a = auroraqd.Aurora(2, 'genotype', seed=0).run(lambda g: g, generations=1);"
        "before = 'matplotlib' in sys.modules; a._repr_html_(); print(before, 'matplotlib' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]
