"""What notebooks show: a table and a picture of whatever there is, in which nothing can run; and two notebooks that run."""

import base64
import io
import subprocess
import sys
import warnings
from html.parser import HTMLParser
from pathlib import Path

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


NOTEBOOKS = sorted((Path(__file__).parent.parent / "examples").glob("*.ipynb"))


def test_there_are_two_notebooks():
    assert len(NOTEBOOKS) == 2


@pytest.fixture(scope="module", params=NOTEBOOKS, ids=lambda path: path.stem)
def executed(request, tmp_path_factory):
    """A notebook after it has run, from top to bottom, in a kernel of its own."""
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    folder, notebook = tmp_path_factory.mktemp("notebook"), nbformat.read(request.param, as_version=4)
    nbformat.validate(notebook)
    assert not any(cell.get("outputs") for cell in notebook.cells), "it is kept without what it shows"
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what runs it
        patch.setenv("IPYTHONDIR", str(folder / "ipython"))
        patch.chdir(folder)
        nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    return notebook


def outputs(notebook, kind):
    """What the last lines of cells showed, by the lines."""
    return {
        cell.source.splitlines()[-1]: output.data[kind]
        for cell in notebook.cells
        if cell.cell_type == "code"
        for output in cell.outputs
        if kind in output.get("data", {})
    }


def test_a_notebook_shows_what_there_is(executed):
    cells = [cell for cell in executed.cells if cell.cell_type == "code"]
    assert [output for cell in cells for output in cell.outputs if output.output_type in ("error", "stream")] == []
    pages = outputs(executed, "text/html")
    tables = {line: Page(html) for line, html in pages.items() if "explore" not in line}
    assert len(tables) >= 2
    for line, page in tables.items():
        assert len(page.pictures) == 1, line
        assert page.texts[0].startswith(("Aurora", "UnstructuredArchive", "History", "Repertoire"))
    figures = outputs(executed, "image/png")
    assert figures
    for line, png in figures.items():
        assert line.endswith(".plot()")
        assert min(image.imread(io.BytesIO(base64.b64decode(png))).shape[:2]) > 100


def test_a_notebook_shows_the_explorer(executed, browser, tmp_path):
    ((line, frame),) = ((line, html) for line, html in outputs(executed, "text/html").items() if "explore" in line)
    assert frame.startswith("<iframe ")
    assert "<script" not in frame  # all of it is escaped, and in a frame that cannot reach the notebook
    assert 'sandbox="allow-scripts allow-downloads"' in frame
    path = tmp_path / "notebook.html"
    path.write_text(f"<!DOCTYPE html><meta charset=utf-8>{frame}")
    browser.driver.get(path.as_uri())
    browser.driver.switch_to.frame(0)
    try:
        browser.until("return document.documentElement.dataset.ready")
        runs = browser.js("return explorer.data().runs.map((run) => run.rows.length)")
        assert len(runs) == 1 + line.count("runs,")
        assert min(runs) > 100
        with pytest.raises(Exception, match="cross-origin"):
            browser.js("return parent.document.title")
    finally:
        browser.driver.switch_to.default_content()


def test_a_page_that_is_gone_is_a_path(aurora, tmp_path):
    page = auroraqd.report.explore(aurora, tmp_path / "skills.html")
    assert page == tmp_path / "skills.html"
    assert "srcdoc" in page._repr_html_()
    page.unlink()
    assert page._repr_html_() is None
    assert page.with_suffix(".other")._repr_html_() is None
