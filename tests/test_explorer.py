"""The explorer: what is in a page, and what the page does in a browser, where there is one."""

import csv
import dataclasses
import io
import json
import shutil
import sys
from ctypes.util import find_library

import commands
import numpy as np
import pytest
from browsing import serving
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.report import explore
from auroraqd.report.explorer.decoders import decoder
from auroraqd.report.explorer.places import genes_of, stage_of
from auroraqd.report.explorer.runs import content, source_of
from auroraqd.report.explorer.sights import Sight
from auroraqd.report.explorer.tables import back, table, wholes
from auroraqd.tasks import _drawing, air_hockey

EVIL = "</script><script>window.hacked = true</script>"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run of the arm and the puck."""
    task = auroraqd.tasks.AirHockey()
    place = tmp_path_factory.mktemp("explorer") / "hockey"
    aurora = auroraqd.Aurora(8, PCA(2), seed=0, batch_size=100, schedule=auroraqd.Every(2))
    return auroraqd.save(aurora.run(task, generations=6, callback=auroraqd.Snapshots(place)), place)


def found(task, descriptor, n_genes=2, generations=2, **options):
    return auroraqd.Aurora(n_genes, descriptor, seed=0, batch_size=30, **options).run(task, generations=generations)


@pytest.mark.parametrize("columns", [3, 40])
def test_tables_keep_numbers(columns):
    rows = np.random.default_rng(0).normal(3, 5, (50, columns))
    rows[:, 1] = 7.0
    kept = table(rows)
    assert kept["values"].nbytes == rows.size * (4 if columns < 33 else 2)
    np.testing.assert_allclose(back(kept), rows, atol=np.ptp(rows) / 60_000)
    np.testing.assert_allclose(back(table(rows - 3, np.int8)), rows - 3, atol=np.abs(rows).max() / 200)


def test_tables_of_what_is_not_finite_or_not_there():
    rows = np.full((2, 40), np.nan)
    np.testing.assert_array_equal(back(table(rows)), rows)
    assert back(table(np.empty((0, 40)))).shape == (0, 40)
    assert wholes(np.array([2**40])).dtype == np.float64
    assert wholes(np.array([2**30])).dtype == np.int32


@pytest.mark.parametrize(
    ("shape", "dtype", "kind", "shown"),
    [
        ((50, 2), float, "path", (50, 2)),
        ((50, 3), float, "series", (50, 3)),
        ((5,), float, "series", (5, 1)),
        ((1, 2), float, "series", (1, 2)),
        ((64, 64, 3), np.uint8, "image", (32, 32, 3)),
        ((33, 20), np.uint8, "image", (17, 10, 1)),
        ((20, 30), float, "image", (20, 30, 1)),
        ((2, 3, 4, 5), float, "series", (120, 1)),
        ((10, 10, 7), float, "series", (700, 1)),
    ],
)
def test_sights_of_observations(shape, dtype, kind, shown):
    sight = Sight.of(shape, dtype)
    assert (sight.kind, sight.shape) == (kind, shown)
    observation = np.random.default_rng(0).uniform(0, 200, (3, *shape)).astype(dtype)
    assert sight.seen(observation).shape == (3, sight.features)
    if sight.factor == 1:
        np.testing.assert_array_equal(sight.seen(observation), observation.reshape(3, -1))


def test_a_pixel_is_the_mean_of_what_it_stands_for():
    image = np.arange(64 * 64 * 3, dtype=np.uint16).reshape(1, 64, 64, 3)
    seen = Sight.of((64, 64, 3), np.uint8).seen(image).reshape(32, 32, 3)
    assert seen[4, 5, 1] == image[0, 8:10, 10:12, 1].mean()


def test_an_affine_decoder_is_exact_and_others_are_sampled():
    places = np.random.default_rng(0).normal(size=(100, 3))
    slopes = np.arange(12.0).reshape(3, 4)
    kept = decoder(lambda z: z @ slopes + 1, places)
    assert kept["kind"] == "affine"
    np.testing.assert_allclose(kept["matrix"][1:], slopes, atol=1e-6)
    assert decoder(lambda z: np.sin(9 * z), places) is None  # a grid in three dimensions would be large
    assert decoder(lambda z: np.sin(9 * z), places[:, :2])["kind"] == "grid"
    assert decoder(lambda z: np.sin(9 * z), np.zeros((1, 1)))["kind"] == "grid"


def test_the_arm_is_that_of_the_task(folder):
    repertoire = auroraqd.load(folder)
    config = {"task": "air-hockey"}
    arm = stage_of(config, repertoire, Sight.of((50, 2), float), repertoire.observation)["arm"]
    genes = genes_of(config, 8).scale(repertoire.genotype[:9])
    angles = np.cumsum(
        genes[:, None, :4] * np.array(arm["first"])[:, None] + genes[:, None, 4:] * np.array(arm["final"])[:, None], 2
    )
    tips = arm["link"] * np.stack([np.cos(angles), np.sin(angles)], axis=3).sum(axis=2)
    np.testing.assert_allclose(tips, air_hockey.joints(repertoire.genotype[:9])[:, :, -1], atol=1e-12)


def test_many_skills_are_thinned_and_large_observations_too(folder):
    source = source_of(folder)
    some = content(source, 20)
    assert len(some["rows"]) == 20 < some["total"] == len(source.repertoire)
    np.testing.assert_array_equal(some["id"], source.repertoire.id[some["rows"]])
    pictures = found(lambda g: np.repeat(g[:, :1], 3072, axis=1).reshape(-1, 32, 32, 3), "genotype")
    assert len(content(source_of(pictures), 1000, share=0.01)["rows"]) == 70_000 // 3072


def test_a_run_a_repertoire_and_a_folder_give_the_same_skills(folder):
    aurora = auroraqd.resume(folder)
    contents = [content(source_of(run), 1000) for run in (folder, aurora, auroraqd.load(folder))]
    seen = [each["streams"]["observation"] for each in contents]
    for other, each in zip(contents[1:], seen[1:], strict=True):
        np.testing.assert_array_equal(other["id"], contents[0]["id"])
        np.testing.assert_array_equal(each["observed"]["values"], seen[0]["observed"]["values"])
        np.testing.assert_array_equal(each["decoder"]["matrix"], seen[0]["decoder"]["matrix"])


def test_snapshots_are_thinned_to_what_a_page_can_hold(folder):
    source = source_of(folder)
    assert [each.moment for each in source.snapshots] == ["after", "before", "after", "before", "after"]
    many = [each._replace(generation=number) for number, each in enumerate([source.snapshots[0]] + source.snapshots[1:3] * 100)]
    kept = content(dataclasses.replace(source, snapshots=many), 1000)["moments"]
    assert len(kept) == 47
    assert (kept[0]["generation"], kept[-1]["generation"]) == (0, 200)
    assert [each["moment"] for each in kept] == ["after"] + ["before", "after"] * 23


def test_places_of_another_time_are_those_of_the_snapshot(folder):
    source = source_of(folder)
    for kept, snapshot in zip(content(source, 1000)["moments"], source.snapshots, strict=True):
        np.testing.assert_array_equal(kept["id"], snapshot.id)
        for name, wanted in (("descriptor", snapshot.descriptor), ("truth", snapshot.ground_truth)):
            np.testing.assert_allclose(back(kept["places"][name]), wanted, atol=np.ptp(wanted) / 60_000)


def test_the_page_of_a_run_is_written_again_but_no_other_file(folder, tmp_path):
    run = shutil.copytree(folder, tmp_path / "run")
    for _ in range(2):
        assert commands.cli("explore", run).stdout.startswith(f"{run / 'skills.html'}, ")
    other = tmp_path / "other.html"
    other.write_text("mine")
    assert "exists: choose another file with --out" in commands.cli("explore", run, "--out", other).stderr
    assert other.read_text() == "mine"


def test_what_cannot_be_explored_is_said(folder, tmp_path):
    empty = auroraqd.save(auroraqd.Aurora(2, "genotype"), tmp_path / "empty")
    with pytest.raises(ValueError, match="empty is empty, nothing was stored in its run: there is no skill to explore"):
        explore(empty, tmp_path / "x.html")
    with pytest.raises(ValueError, match="run of seed 0 is empty"):
        explore(auroraqd.Aurora(2, "genotype", seed=0), tmp_path / "x.html")
    with pytest.raises(IsADirectoryError, match="must be of a file, and is a folder"):
        explore(folder, tmp_path)
    with pytest.raises(ValueError, match="several are compared by their ground truth, and run of seed 0 has none"):
        explore([folder, found(lambda g: g, "genotype")], tmp_path / "x.html")
    with pytest.raises(ValueError, match=r"and run of seed 0 has \(3,\)"):
        explore([folder, found(lambda g: (g[:, 0], g, np.repeat(g[:, :1], 3, axis=1)), "genotype")], tmp_path / "x.html")
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        explore(tmp_path / "none", tmp_path / "x.html")
    with pytest.raises(TypeError, match=r"run must be a run folder, an auroraqd\.Aurora or an auroraqd\.Repertoire, got int"):
        explore(3, tmp_path / "x.html")
    with pytest.raises(ValueError, match="run must be one, or from 1 to 12 of them, got 0"):
        explore([], tmp_path / "x.html")
    assert not (tmp_path / "x.html").exists()


def test_without_bokeh(folder, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "bokeh.embed", None)
    with pytest.raises(ValueError, match=r'Bokeh is not installed: pip install "auroraqd\[explore\]"'):
        explore(folder, tmp_path / "x.html")


def test_the_command(folder, tmp_path):
    done = commands.cli("explore", folder, folder, "--out", tmp_path / "two.html")
    assert done.returncode == 0, done.stderr
    assert "open it in a browser" in done.stdout
    assert (tmp_path / "two.html").stat().st_size < 15e6
    again = commands.cli("explore", folder, "--out", tmp_path / "two.html")
    assert again.returncode == 1
    assert "exists: choose another file with --out" in again.stderr


def test_a_folder_that_is_being_written(tmp_path):
    """Whenever it is read, there are whole skills; where the last checkpoint is damaged, those of the one before."""
    aurora = auroraqd.Aurora(2, "hand-coded", seed=0, batch_size=50)
    sizes = []

    def read(_):
        sizes.append(content(source_of(tmp_path), 1000)["total"])

    with auroraqd.Checkpoints(aurora, tmp_path, every=0) as checkpoints:
        aurora.run(auroraqd.tasks.Ballistic(), generations=3, callback=(checkpoints, read))
        (tmp_path / "repertoire.safetensors").write_bytes(b"half")
        with pytest.warns(UserWarning, match="the checkpoint before it is taken"):
            assert content(source_of(tmp_path), 1000)["total"] == sizes[1]
    assert sizes == [record.size for record in aurora.history.records]


ODD = {
    "one skill": lambda: found(lambda g: np.ones((len(g), 4, 2)), "genotype", resolution=auroraqd.Fixed(10.0)),
    "one dimension": lambda: found(lambda g: (g[:, 0], g), PCA(1)),
    "twenty dimensions": lambda: found(lambda g: (g[:, 0], g, g[:, 0]), PCA(20), n_genes=24),
    "no inverse": lambda: found(lambda g: (g[:, 0], g), "genotype"),
    "unknown truth": lambda: found(lambda g: (g[:, 0], g, np.where(g > 0.5, np.nan, g)), "genotype"),
    "huge": lambda: found(lambda g: (1e300 * g[:, 0], 1e300 * g), "genotype"),
    "four axes": lambda: found(lambda g: np.tile(g[:, :, None, None], (1, 1, 3, 4)), "genotype"),
    "image": lambda: found(lambda g: (255 * np.tile(g[:, :, None], (1, 20, 40))).astype(np.uint8), PCA(2)),
    "encoder": lambda: found(lambda g: np.tile(g[:, None], (1, 30, 1)), auroraqd.AutoEncoder(2)),
}


@pytest.fixture(scope="module")
def page(folder, browser):
    """That of the run of the arm and the puck."""
    browser.open(explore(folder, folder.parent / "hockey.html"))
    return browser


SHOW = "explorer.state.place = null; explorer.show(0, arguments[0])"
MOVE = "document.getElementById('step').value = {}; document.getElementById('step').dispatchEvent(new Event('input'))"


def shown(page):
    return page.js("return explorer.state.skill")


def test_pointing_shows_the_skill_under_the_pointer(page, folder):
    repertoire = auroraqd.load(folder)
    for row in (3, len(repertoire) - 2):
        page.mouse("mouseMoved", page.place(0, *repertoire.descriptor[row]))
        page.until(f"return explorer.state.skill === {row}")
        assert page.text("which") == f"skill {row}"
        gene, unit = page.js("return document.querySelector('#genes td.number').textContent").split()
        assert unit == "rad"
        np.testing.assert_allclose(float(gene), (2 * repertoire.genotype[row, 0] - 1) * np.pi, rtol=1e-3)
    assert page.troubles() == []


def test_the_arm_that_is_drawn_is_that_of_the_task(page, folder):
    repertoire = auroraqd.load(folder)
    page.js("document.getElementById('step').value = 20; document.getElementById('step').dispatchEvent(new Event('input'));")
    arm = page.js(
        "const r = Bokeh.documents[0].roots().find((f) => f.name === 'skill-lines').renderers.find((r) => r.name === 'arm');"
        "return [Array.from(r.data_source.data.x), Array.from(r.data_source.data.y)]"
    )
    wanted = air_hockey.joints(repertoire.genotype[[shown(page)]])[0, 20]
    np.testing.assert_allclose(np.transpose(arm), wanted, atol=1e-5)


def test_a_click_pins_and_another_takes_away(page, folder):
    repertoire = auroraqd.load(folder)
    place = page.place(0, *repertoire.descriptor[5])
    for pins in (1, 0, 1):
        page.click(place)
        page.until(f"return document.querySelectorAll('#pins button').length === {pins}")
        page.rest()  # or two clicks are a double click


def test_an_empty_place_shows_what_the_descriptor_expects_there(page, folder):
    repertoire = auroraqd.load(folder)
    place = repertoire.descriptor.min(axis=0) - 0.02 * np.ptp(repertoire.descriptor, axis=0)  # within the margin of the map
    page.click(page.place(0, *place))
    page.until("return explorer.state.place !== null")
    x, y = page.js("return explorer.state.place.at")
    expected = page.js("return Array.from(explorer.state.place.decoded)")
    np.testing.assert_allclose(expected, repertoire.reconstruct([[x, y]]).ravel(), atol=1e-4)
    np.testing.assert_allclose([x, y], place, atol=0.02 * np.ptp(repertoire.descriptor))


def test_a_lasso_selects_what_is_in_it_and_exports_it(page, folder):
    repertoire = auroraqd.load(folder)
    low, high = np.array([-0.6, -0.6]), np.array([0.3, 0.4])
    page.lasso(
        [page.place(1, *corner) for corner in ((low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]))]
    )
    rows = np.array(page.until("return explorer.state.set && explorer.state.set.indices"))
    inside = ((repertoire.ground_truth > low + 0.02) & (repertoire.ground_truth < high - 0.02)).all(axis=1)
    outside = ((repertoire.ground_truth < low - 0.02) | (repertoire.ground_truth > high + 0.02)).any(axis=1)
    assert set(np.flatnonzero(inside)) <= set(rows)
    assert not set(np.flatnonzero(outside)) & set(rows)
    assert page.text("many").startswith(f"{len(rows)} skills selected")

    exported = list(csv.DictReader(io.StringIO(page.saved("csv"))))
    np.testing.assert_array_equal([int(line["id"]) for line in exported], repertoire.id[rows])
    np.testing.assert_allclose([float(line["descriptor 2"]) for line in exported], repertoire.descriptor[rows, 1], rtol=1e-5)
    kept = json.loads(page.saved("json"))
    observed = [skill["observation"] for skill in kept["skills"]]
    np.testing.assert_allclose(observed, repertoire.observation[rows].reshape(len(rows), -1), atol=1e-4)
    loaded = {}
    exec(kept["python"], loaded)
    np.testing.assert_array_equal(loaded["rows"], rows)


def test_seeking(page, folder):
    repertoire = auroraqd.load(folder)

    def seek(text):
        page.js(
            "document.getElementById('wanted').value = arguments[0]; document.getElementById('search').requestSubmit();", text
        )
        return shown(page)

    ends = repertoire.observation[:, -1]
    assert seek("ends near (0.3, -0.2)") == np.argmin(np.linalg.norm(ends - [0.3, -0.2], axis=1))
    assert seek("skill 4") == 4
    assert seek(f"id {repertoire.id[7]}") == 7
    assert seek("nowhere") == 7
    assert "two numbers" in page.text("said")


def test_keys_go_from_skill_to_skill(page):
    element = page.driver.find_element("css selector", ".map")
    before = shown(page)
    page.js("arguments[0].focus()", element)
    element.send_keys("\ue014")  # to the right
    page.until(f"return explorer.state.skill !== {before}")
    places = page.js(
        "const { data } = Bokeh.documents[0].roots()[0].renderers[0].data_source;"
        "return arguments[0].map((i) => data.descriptor_x[i])",
        [before, shown(page)],
    )
    assert places[1] > places[0]


def test_colours_and_looks(page):
    page.js(
        "const s = document.getElementById('colour'); s.value = [...s.options].findIndex((o) => o.text === 'novelty');"
        "s.dispatchEvent(new Event('change'));"
    )
    assert page.js("return Bokeh.documents[0].roots()[0].below.some((b) => b.visible && b.color_mapper)")
    theme = page.js("return document.documentElement.dataset.theme")
    page.js("document.getElementById('theme').click()")
    assert page.js("return document.documentElement.dataset.theme") != theme
    assert page.troubles() == []


SLIDE = (
    "const m = document.getElementById('moment'); m.value = arguments[0] < 0 ? m.max : arguments[0];"
    "m.dispatchEvent(new Event('input'));"
)
THEN = (
    "const r = Bokeh.documents[0].roots()[arguments[0]].renderers.find((r) => r.name === arguments[1]);"
    "return [r.visible, Array.from(Object.values(r.data_source.data)[0]).length]"
)


def test_the_slider_goes_through_the_updates(page, folder):
    snapshots, repertoire = source_of(folder).snapshots, auroraqd.load(folder)
    assert page.js("return document.getElementById('moment').max") == str(len(snapshots))
    for number in (0, 3):
        snapshot = snapshots[number]
        page.js(SLIDE, number)
        said = f"generation {snapshot.generation}, {snapshot.moment} an update: {snapshot.size:,} skills"
        assert page.text("when").startswith(said)
        for plot in range(3):
            assert page.js(THEN, plot, "then") == [True, len(snapshot.id)]
            assert page.js(THEN, plot, "points")[0] is False
    stays = np.flatnonzero(np.isin(snapshots[3].id, repertoire.id))[4]
    page.mouse("mouseMoved", page.place(0, *map(float, snapshots[3].descriptor[stays])))
    page.until(f"return explorer.data().runs[0].id[explorer.state.skill] === {snapshots[3].id[stays]}")
    page.js("explorer.tap('map0', {x: 99, y: 99})")  # what was expected there is not known
    page.js(SLIDE, -1)
    assert page.text("when") == f"now: {len(repertoire):,} skills"
    assert page.js(THEN, 0, "then") == [False, 0]
    assert page.js(THEN, 0, "points")[0] is True
    assert page.troubles() == []


def test_the_slider_by_keys(page):
    slider = page.driver.find_element("id", "moment")
    most = page.js("return Number(arguments[0].max)", slider)
    slider.send_keys("\ue012")  # to the left
    page.until(f"return explorer.state.moment === explorer.data().runs[0].moments[{most - 1}]")
    slider.send_keys("\ue014")
    page.until("return explorer.state.moment === null")


def test_runs_beside_each_other(folder, browser, tmp_path):
    browser.open(explore([folder, folder], tmp_path / "two.html"))
    repertoire = auroraqd.load(folder)
    browser.mouse("mouseMoved", browser.place(1, *repertoire.ground_truth[9]))
    browser.until("return explorer.state.run === 1 && explorer.state.skill === 9")
    assert browser.js("return document.querySelectorAll('#compared tr').length") == 3
    size = browser.js("return document.querySelectorAll('#compared tr')[2].cells[1].textContent")
    assert size == f"{len(repertoire):,}"
    assert browser.troubles() == []


@pytest.mark.parametrize("kind", ODD)
def test_odd_runs_have_a_page(kind, browser, tmp_path):
    aurora = ODD[kind]()
    browser.open(explore(aurora, tmp_path / "odd.html"))
    assert browser.js("return explorer.data().runs[0].rows.length") == len(aurora.archive)
    assert browser.js("return document.getElementById('time').hidden")  # it has no snapshots
    browser.js("explorer.tap('map0', {x: 0.1, y: 0.1}); explorer.move('map0', {x: 0.3, y: 0.2});")
    assert browser.troubles() == []


def streams(genotypes):
    camera = (255 * np.tile(genotypes[:, :1, None], (1, 12, 16))).astype(np.uint8)
    return {"camera": camera, "path": np.tile(genotypes[:, None], (1, 20, 1)), "joints": np.tile(genotypes, 3)}


def test_any_stream_can_be_seen(browser, tmp_path):
    aurora = found(streams, PCA(2), resolution=auroraqd.Fixed(0.05))
    browser.open(explore(aurora, tmp_path / "streams.html"))
    choose = "const s = document.getElementById('stream'); s.value = arguments[0]; s.dispatchEvent(new Event('change'));"
    for k, (name, pictures) in enumerate({"path": 0, "camera": 2, "joints": 0}.items()):
        browser.js(choose, k)
        assert browser.js("return document.getElementById('stream').selectedOptions[0].text") == name
        assert browser.js("return document.querySelectorAll('aside .pictures canvas').length") == pictures
        assert (
            browser.js("return explorer.data().runs[0].sight.kind")
            == {"path": "path", "camera": "image", "joints": "series"}[name]
        )
        browser.js("Bokeh.documents[0].roots()[0].renderers[0].data_source.selected.indices = [0, 1]")
        kept = json.loads(browser.saved("json"))["skills"][1]
        wanted = aurora.archive.observation[name][int(kept["row"])].ravel()
        np.testing.assert_allclose(kept["observation"], wanted, atol=0.6 if name == "camera" else 1e-4)
    assert browser.troubles() == []


def test_a_stream_for_which_there_is_no_room_is_left_out():
    source = source_of(found(streams, "genotype"))
    assert list(content(source, 1000)["streams"]) == ["path", "camera", "joints"]
    few = content(source, 1000, share=len(source.repertoire) * 100 / 7e6)  # a path has 80 bytes, an image 192, joints 12
    assert (list(few["streams"]), few["left_out"]) == (["path", "joints"], ["camera"])


def test_a_page_can_fetch_nothing_and_run_nothing_else(folder, browser, tmp_path):
    path = explore(folder, tmp_path / "strict.html")
    text = path.read_text()
    assert all(f"{rule};" in text for rule in ("default-src 'none'", "connect-src 'none'", "base-uri 'none'"))
    injected = text.replace(
        "</header>", "<script>window.hacked = true</script><img src=x onerror='window.hacked = true'></header>"
    )
    path.write_text(injected)
    browser.open(path)
    assert browser.js("return window.hacked") is None
    asked = "fetch('http://127.0.0.1:9/').then(() => 'fetched', (error) => error.name).then(arguments[0])"
    assert browser.driver.execute_async_script(asked) == "TypeError"
    assert any("Content Security Policy" in said for said in browser.troubles())


LIBRARY = find_library("EGL") or find_library("OSMesa")
needs_a_library = pytest.mark.skipif(not LIBRARY, reason="there is neither EGL nor OSMesa")


@pytest.fixture(scope="module")
def swimmers(tmp_path_factory):
    """A run of a robot, and its task."""
    pytest.importorskip("gymnasium")
    task = auroraqd.tasks.Gym("Swimmer-v5", steps=30, samples=10)
    aurora = auroraqd.Aurora(task.n_genes, PCA(2), seed=0, batch_size=10)
    return task, auroraqd.save(aurora.run(task, generations=2), tmp_path_factory.mktemp("robots") / "swimmers")


@needs_a_library
def test_films_of_robots(swimmers, browser, tmp_path):
    task, folder = swimmers
    browser.open(explore(folder, tmp_path / "films.html", films=3, task=task))
    repertoire = auroraqd.load(folder)
    filmed = [int(row) for row in browser.js("return Object.keys(explorer.data().runs[0].films)")]
    assert filmed == sorted(repertoire.sample(3))
    assert browser.js("return document.querySelectorAll('.marks')[0].querySelectorAll('.filmed').length") == 3
    browser.js(SHOW, filmed[0])
    browser.until("return explorer.state.film.picture?.complete")
    assert browser.js("return document.querySelector('#film figcaption').textContent") == ""
    assert browser.js("return document.getElementById('step').max") == "29"  # frames: no more than steps
    first, last = (
        browser.until(f"{MOVE.format(k)}; return document.querySelector('#film canvas').toDataURL()") for k in (0, 29)
    )
    assert first != last
    assert browser.text("now") == f"{30 * task.interval:.1f} of {30 * task.interval:.1f} s"
    other = next(row for row in range(len(repertoire)) if row not in filmed)
    distance = np.linalg.norm(repertoire.descriptor[filmed] - repertoire.descriptor[other], axis=1)
    browser.js(SHOW, other)
    said = browser.js("return document.querySelector('#film figcaption').textContent")
    assert said == f"This is skill {filmed[np.argmin(distance)]}, the nearest of those that were filmed, which have rings. "
    assert browser.troubles() == []


@needs_a_library
def test_films_when_they_are_asked_for(swimmers, browser, monkeypatch):
    task, folder = swimmers
    with serving(folder, task) as server:
        browser.open(server.url)
        assert browser.js("return document.querySelector('#film button').textContent") == "Film this skill"
        browser.js("document.querySelector('#film button').click()")
        browser.until("return explorer.state.film?.picture?.complete")
        assert browser.js("return Object.keys(explorer.data().runs[0].films)") == [str(shown(browser))]
        monkeypatch.setattr(_drawing, "find_library", lambda name: None)
        browser.js(SHOW, (shown(browser) + 1) % 3)
        browser.js("document.querySelector('#film button').click()")
        browser.until(
            "return document.getElementById('said').textContent.startsWith('there is no library to draw robots with')"
        )
        assert browser.js("return document.querySelector('#film figcaption').textContent").startswith("This is skill ")
        browser.driver.get("about:blank")


def test_a_page_says_how_films_are_to_be_had(swimmers, folder, browser, tmp_path):
    browser.open(explore(swimmers[1], tmp_path / "none.html"))
    said = browser.js("return document.querySelector('#film figcaption').textContent")
    assert said == "The robot can be filmed: write the page with --films 24."
    browser.open(explore(folder, tmp_path / "hockey.html"))
    assert browser.js("return document.getElementById('film').hidden")


def test_what_cannot_be_filmed_is_said(swimmers, folder, tmp_path):
    for films in (-1, 65, 1.5, "x"):
        with pytest.raises(ValueError, match="films must be a whole number"):
            explore(folder, tmp_path / "x.html", films=films)
    with pytest.raises(ValueError, match="the task of the run is no robot that MuJoCo draws"):
        explore(folder, tmp_path / "x.html", films=1)
    with pytest.raises(TypeError, match=r"task must be a robot, an auroraqd\.tasks\.Gym, got 5"):
        explore(folder, tmp_path / "x.html", films=1, task=5)
    with pytest.raises(ValueError, match="task CartPole-v1 is not of MuJoCo"):
        explore(folder, tmp_path / "x.html", films=1, task=auroraqd.tasks.Gym("CartPole-v1", auroraqd.tasks.MLP()))
    with pytest.raises(ValueError, match="task Swimmer-v5 has 7 genes, and the skills have 2"):
        explore(found(lambda g: g, "genotype"), tmp_path / "x.html", films=1, task=swimmers[0])
    assert not (tmp_path / "x.html").exists()


def test_genes_that_are_called_like_other_columns_keep_theirs(browser, tmp_path):
    def task(genotypes):
        return genotypes[:, 0], genotypes

    task.genes = auroraqd.tasks.Genes(fitness=(0, 9), observation=(0, 5))
    aurora = found(task, "genotype")
    browser.open(explore(auroraqd.save(aurora, tmp_path / "run"), tmp_path / "same.html"))
    browser.js("Bokeh.documents[0].roots()[0].renderers[0].data_source.selected.indices = [3]")
    for kept in (next(csv.DictReader(io.StringIO(browser.saved("csv")))), json.loads(browser.saved("json"))["skills"][0]):
        fitness, genes = aurora.archive.fitness[3], aurora.archive.genotype[3]
        np.testing.assert_allclose(float(kept["fitness"]), fitness, rtol=1e-5)
        np.testing.assert_allclose(float(kept["fitness (gene)"]), 9 * genes[0], rtol=1e-5)
        np.testing.assert_allclose(float(kept["observation (gene)"]), 5 * genes[1], rtol=1e-5)
    np.testing.assert_allclose(kept["observation"], aurora.archive.observation[3], rtol=1e-5)
    names = browser.js("return [...document.getElementById('colour').options].map((o) => o.text)")
    assert {"fitness", "fitness (gene)"} <= set(names)
    assert browser.troubles() == []


def test_names_do_not_run(browser, tmp_path):
    def task(genotypes):
        return genotypes

    task.genes = auroraqd.tasks.Genes(**{EVIL: (0, 1, EVIL), "'\"&<b>": (0, 2)})
    task.__name__ = task.__qualname__ = EVIL
    folder = auroraqd.save(found(task, "genotype"), tmp_path / EVIL / "a<b>'&")  # with a slash in it, EVIL is two folders
    browser.open(explore(folder, tmp_path / "evil.html"))
    assert browser.js("return window.hacked") is None
    assert EVIL in browser.text("genes")
    assert browser.text("title") == "a<b>'&"
    browser.js("Bokeh.documents[0].roots()[0].renderers[0].data_source.selected.indices = [0]")
    assert EVIL in browser.text("code")
    assert browser.troubles() == []
