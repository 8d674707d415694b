import numpy as np
import pytest
from matplotlib.figure import Figure

import auroraqd
from auroraqd.report import history_figure, repertoire_figure, write_figures
from auroraqd.report.run import fitness_figure
from auroraqd.report.style import save_figure, two_dimensional_colors


def repertoire(task, descriptor, tmp_path, **options):
    aurora = auroraqd.Aurora(2, descriptor, seed=0, batch_size=50, **options).run(task, generations=3)
    return auroraqd.load(auroraqd.save(aurora, tmp_path)), aurora.history.records


class First:
    """The first `d` features."""

    def __init__(self, d):
        self.d = d

    def fit(self, x):
        return self

    def transform(self, x):
        return x[:, : self.d]


@pytest.mark.parametrize(
    ("task", "descriptor", "titles"),
    [
        (auroraqd.tasks.Ballistic(), "hand-coded", ["Descriptor space", "Ground truth", "Trajectories"]),
        (lambda g: (g[:, 0], g), First(1), ["Descriptor space"]),
        (lambda g: (g[:, 0], np.repeat(g, 3, axis=1)), First(5), ["Descriptor space, 2 of 5 dimensions"]),
        (lambda g: (g[:, 0], g, g[:, :1]), First(2), ["Descriptor space"]),
        (lambda g: (g[:, 0], g[:, :1]), First(1), ["Descriptor space"]),
    ],
)
def test_every_repertoire_has_a_figure(task, descriptor, titles, tmp_path):
    found, records = repertoire(task, descriptor, tmp_path)
    figure = repertoire_figure(found)
    assert [axes.get_title() for axes in figure.axes] == titles
    assert history_figure(records).axes
    skills, fitness = ["skills"] * ("Trajectories" in titles), ["fitness"] * bool(np.ptp(found.fitness))
    assert [path.stem for path in write_figures(tmp_path)[::2]] == ["repertoire", "history", *fitness, *skills]


def test_colors_are_fitness(tmp_path):
    """Over both spaces, but for the few that are far from the others."""
    found, _ = repertoire(lambda g: (g[:, 0] ** 2, g, g[:, ::-1]), "genotype", tmp_path, resolution=None)
    descriptors, truth, bar = fitness_figure(found).axes
    assert bar.get_ylabel() == "fitness"
    for axes in (descriptors, truth):
        np.testing.assert_array_equal(axes.collections[0].get_facecolor(), descriptors.collections[0].get_facecolor())
    colors = descriptors.collections[0].get_facecolor()
    green = colors[np.argsort(found.fitness), 1]  # of viridis: the more the fitter
    assert (np.diff(green) >= 0).all()
    assert len(np.unique(green)) > 50


def test_colors_correspond_to_places():
    places = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 8.0], [2.0, 8.0], [1.0, 4.0]])
    colors = two_dimensional_colors(places)
    assert len(np.unique(colors, axis=0)) == 5
    np.testing.assert_allclose(colors[4], colors[:4].mean(axis=0))
    assert two_dimensional_colors(np.ones((3, 2))).shape == (3, 3)


def test_nothing_to_draw(tmp_path):
    auroraqd.save(auroraqd.Aurora(2, "genotype"), tmp_path)
    for figure in (repertoire_figure, fitness_figure):
        with pytest.raises(
            ValueError, match="the repertoire is empty, nothing was stored in its run: there is nothing to draw"
        ):
            figure(auroraqd.load(tmp_path))
    assert [path.stem for path in write_figures(tmp_path)[::2]] == ["history"]


def test_one_individual(tmp_path):
    found, _ = repertoire(
        lambda g: (np.zeros(len(g)), np.ones((len(g), 4, 2))), "genotype", tmp_path, resolution=auroraqd.Fixed(10.0)
    )
    assert len(found) == 1
    assert len(write_figures(tmp_path)) == 6


def test_a_figure_is_as_before_when_it_has_been_written(tmp_path):
    figure = Figure(dpi=90, layout="constrained")
    figure.subplots().plot([1, 2])
    engine, canvas = figure.get_layout_engine(), figure.canvas
    save_figure(figure, tmp_path, "f")
    assert (figure.dpi, figure.canvas, figure.get_layout_engine()) == (90, canvas, engine)
    before = (tmp_path / "f.png").read_bytes()
    save_figure(figure, tmp_path, "f")
    assert (tmp_path / "f.png").read_bytes() == before
