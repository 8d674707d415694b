"""How fast and how well auto-encoders learn descriptors.

    python benchmarks/learned.py            # everything but the three below, about ten minutes
    python benchmarks/learned.py --noise    # runs of paper size with and without noise in training: a quarter of an hour
    python benchmarks/learned.py --paper    # one update by the paper's protocol beside the default one: half an hour
    python benchmarks/learned.py --ablations  # coverage by weight of the isometry and by length of training: an hour
    python benchmarks/learned.py --quick      # to see it work, also with these: seconds; no conclusions can be drawn

Errors are root mean square errors on the [-1, 1] scale, of throws that were never trained on.
"""

import argparse
import itertools
import time
from contextlib import contextmanager
from functools import partial

import numpy as np
from sklearn.decomposition import PCA
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

import auroraqd
from auroraqd.descriptors import training as training_loop
from auroraqd.descriptors.descriptor import Descriptor
from auroraqd.individuals import Columns
from auroraqd.metrics import diversity, klc, reconstruction_error

ROWS = 8_500
BRIEF = {"network": "convolutional", "batch_size": 256, "learning_rate": 5e-3, "min_steps": 0}  # of the paper's variants here
HARDLY = {"min_steps": 200, "max_epochs": 1, "repeats": 1}  # training, to see it work
AS_THE_PAPER = auroraqd.Polynomial(at_least_one=False)


def repertoire(seed, rows):
    """Trajectories of a repertoire grown by AURORA-PCA, (rows, 50, 2)."""
    task = auroraqd.tasks.Ballistic()
    aurora = auroraqd.Aurora(2, PCA(n_components=2), seed=seed, variation=AS_THE_PAPER)
    aurora.run(task, generations=5000, callback=lambda run: len(run.archive) >= rows + 200)
    return aurora.archive.observation[np.random.default_rng(0).permutation(len(aurora.archive))[:rows]]


def held_out_error(encoder, x, held_out):
    low, high = x.min(axis=(0, 1)), x.max(axis=(0, 1))
    reconstruction = encoder.inverse_transform(encoder.transform(held_out))
    return reconstruction_error(held_out * 2 / (high - low), reconstruction * 2 / (high - low)).mean()


def flat_pca():
    """Two-dimensional PCA of trajectories."""
    flatten = FunctionTransformer(lambda x: x.reshape(len(x), -1), lambda x: x.reshape(len(x), -1, 2))
    return make_pipeline(flatten, PCA(n_components=2))


def updates(estimators, rows):
    """One update of the descriptor for each estimator."""
    x, held_out = repertoire(0, rows), repertoire(1, min(rows, 4_000))
    print(f"### One update of the encoder: {rows} trajectories, held out {len(held_out)} of another run\n")
    print("| descriptor | seconds | epochs of each repeat | RMSE held out |\n|---|---|---|---|")
    for name, estimator in estimators.items():
        since = time.perf_counter()
        estimator.fit(x)
        seconds = time.perf_counter() - since
        epochs = ", ".join(map(str, getattr(estimator, "epochs_", [])))
        print(f"| {name} | {seconds:.1f} | {epochs} | {held_out_error(estimator, x, held_out):.4f} |", flush=True)


def encoding(times):
    """Encoding a batch of 200, in the loop's own way."""
    task = auroraqd.tasks.Ballistic()
    print(f"\n### Encoding a batch of 200, milliseconds (median of {times})\n")
    print("| network | descriptor | with the error of its reconstruction |\n|---|---|---|")
    batch = np.random.default_rng(0).random((200, 2))
    _, observation, truth = task(batch)
    individuals = Columns({"genotype": batch, "observation": observation, "ground_truth": truth})
    for network in ("convolutional", "mlp"):
        aurora = auroraqd.Aurora(2, auroraqd.AutoEncoder(network=network, repeats=1, min_steps=0), seed=0)
        descriptor = aurora.run(task, generations=2).descriptor
        alone = median_seconds(partial(descriptor.describe_observation, observation), times)
        both = median_seconds(partial(descriptor.describe, individuals), times)
        print(f"| {network} | {1e3 * alone:.2f} | {1e3 * both:.2f} |", flush=True)


def median_seconds(function, times):
    seconds = []
    for _ in range(times):
        since = time.perf_counter()
        function()
        seconds.append(time.perf_counter() - since)
    return float(np.median(seconds))


def paper_size(generations, training):
    """Whole runs with auto-encoders, and where their seconds go; the second of a kind has nothing to compile."""
    print(f"\n### A run of paper size with an auto-encoder: {generations:,} generations of 200\n")
    print("| auto-encoder | seconds | training | describing | stored | KLC | RMSE |\n|---|---|---|---|---|---|---|")
    kinds = {"the default": {}, "that of the paper's variants": {**BRIEF, "isometry": 0.0}}
    for (name, options), again in itertools.product(kinds.items(), ("", ", again")):
        with seconds_of(training_loop, "train") as trained, seconds_of(Descriptor, "describe") as described:
            size, score, error, seconds = grown({**options, **training}, seed=0, generations=generations)
        spent = " | ".join(f"{sum(times):.1f}" for times in ([seconds], trained, described))
        print(f"| {name}{again} | {spent} | {size:,} | {score:.4f} | {error:.4f} |", flush=True)


@contextmanager
def seconds_of(owner, name):
    """Of each call of a function, as long as this lasts."""
    function, found = getattr(owner, name), []

    def timed(*args, **options):
        since = time.perf_counter()
        try:
            return function(*args, **options)
        finally:
            found.append(time.perf_counter() - since)

    setattr(owner, name, timed)
    try:
        yield found
    finally:
        setattr(owner, name, function)


def grown(options, seed, generations):
    """Size, KLC, RMSE and seconds of one run on throws."""
    task = auroraqd.tasks.Ballistic()
    reference = auroraqd.Aurora(2, "hand-coded", seed=seed, variation=AS_THE_PAPER).run(task, generations=generations)
    archive, error, seconds = found(task, options, seed, generations)
    return len(archive), klc(reference.archive.ground_truth, archive.ground_truth), error, seconds


def pushed(options, seed, generations):
    """Size, diversity, RMSE and seconds of one run on pucks."""
    archive, error, seconds = found(auroraqd.tasks.AirHockey(), options, seed, generations)
    return len(archive), diversity(archive.observation, bins=20), error, seconds


def found(task, options, seed, generations):
    """Repertoire, RMSE and seconds of one run."""
    aurora = auroraqd.Aurora(task.n_genes, auroraqd.AutoEncoder(2, **options), seed=seed, variation=AS_THE_PAPER)
    since = time.perf_counter()
    aurora.run(task, generations=generations)
    return aurora.archive, aurora.history.last.rmse, time.perf_counter() - since


def noises(generations, seeds, training):
    """What the noise of the default training does to runs of the two tasks of the paper."""
    print(f"### AutoEncoder(2) with its noise and without, {generations:,} generations, {seeds} seeds\n")
    print("| task | noise | stored | KLC; diversity, 20 x 20 | RMSE | seconds |\n|---|---|---|---|---|---|")
    for task, run, score in (("ballistic", grown, "{:.4f}"), ("air hockey", pushed, "{:.1f}")):
        for name, options in (("the default", {}), ("0", {"noise": 0.0})):
            rows = [run({**options, **training}, seed, generations) for seed in range(seeds)]
            print(f"| {task} | {name} | {' | '.join(columns(rows, '{:,}', score, '{:.4f}', '{:.0f}'))} |", flush=True)


def columns(rows, *forms):
    """Of each number of some rows, all of them in one cell of a table."""
    return [", ".join(form.format(row[i]) for row in rows) for i, form in enumerate(forms)]


def ablations(generations, seeds, training, most):
    """What the weight of the isometry and the length of training do to coverage and reconstruction."""
    print(f"### AURORA-AE incremental at {generations} generations, {seeds} seeds\n")
    print("| isometry | training | stored | KLC | RMSE |\n|---|---|---|---|---|")
    brief, thorough = BRIEF, {"network": "convolutional"}
    cases = [(weight, "brief", brief) for weight in (0.0, 1.0, 5.0, 20.0, 80.0)]
    cases += [(weight, "the default", thorough) for weight in (0.0, 20.0)]
    cases += [(weight, "brief, weights anew at each update", {**brief, "warm_start": False}) for weight in (0.0, 20.0)]
    for weight, name, options in cases[:most]:
        rows = [grown({**options, **training, "isometry": weight}, seed, generations) for seed in range(seeds)]
        print(f"| {weight:g} | {name} | {' | '.join(columns(rows, '{:,}', '{:.4f}', '{:.4f}'))} |", flush=True)
    pretrained(generations, seeds, training, most)


def pretrained(generations, seeds, training, most):
    """What the length of training on the prior data set does."""
    task = auroraqd.tasks.Ballistic()
    print(f"\n### AURORA-AE pre-trained at {generations} generations, {seeds} seeds\n")
    print("| validation split | epochs | stored | KLC | RMSE |\n|---|---|---|---|---|")
    for split, epochs in [*itertools.product((0.0, 0.25), (12, 60, 300))][:most]:
        sizes, scores, errors = [], [], []
        for seed in range(seeds):
            reference = auroraqd.Aurora(2, "hand-coded", seed=seed, variation=AS_THE_PAPER).run(task, generations=generations)
            encoder = auroraqd.AutoEncoder(2, **{**BRIEF, "max_epochs": epochs, **training}, isometry=0.0, validation=split)
            aurora = auroraqd.Aurora(2, encoder, seed=seed, variation=AS_THE_PAPER, prior=task.prior())
            aurora.run(task, generations=generations)
            sizes.append(f"{len(aurora.archive):,}")
            scores.append(f"{klc(reference.archive.ground_truth, aurora.archive.ground_truth):.4f}")
            errors.append(f"{aurora.history.last.rmse:.4f}")
        print(f"| {split:g} | {5 * epochs} | {', '.join(sizes)} | {', '.join(scores)} | {', '.join(errors)} |", flush=True)


def main(quick=False):
    training, rows, generations = (HARDLY, 300, 10) if quick else ({}, ROWS, 5000)
    default = {
        "PCA": flat_pca(),
        "auto-encoder, the default": auroraqd.AutoEncoder(2, random_state=0, **training),
        "auto-encoder, convolutional": auroraqd.AutoEncoder(2, network="convolutional", random_state=0, **training),
        "auto-encoder, that of the paper's variants": auroraqd.AutoEncoder(
            2, **{**BRIEF, **training}, isometry=0.0, random_state=0
        ),
    }
    updates(default, rows)
    encoding(5 if quick else 200)
    paper_size(generations, training)


def paper(quick):
    training, rows = (HARDLY, 300) if quick else ({}, ROWS)
    literal = {"max_epochs": 2_000, "verbose": True, **training}
    updates(
        {
            "auto-encoder, the default": auroraqd.AutoEncoder(2, random_state=0, **training),
            "auto-encoder, the paper's protocol": auroraqd.AutoEncoder.paper(random_state=0, **literal),
        },
        rows,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--noise", action="store_true")
    parser.add_argument("--paper", action="store_true")
    parser.add_argument("--ablations", action="store_true")
    parser.add_argument(
        "--quick", action="store_true", help="300 trajectories, runs of 10 generations, one of each kind; hardly any training"
    )
    chosen = parser.parse_args()
    if chosen.paper:
        paper(chosen.quick)
    if chosen.ablations:
        ablations(*((10, 1, HARDLY, 1) if chosen.quick else (1500, 2, {}, None)))
    if chosen.noise:
        noises(*((10, 1, HARDLY) if chosen.quick else (5000, 2, {})))
    if not (chosen.paper or chosen.ablations or chosen.noise):
        main(chosen.quick)
