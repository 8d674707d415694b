"""Skills of many joints over hundreds of steps: how well descriptors learned from gaits tell how far apart the gaits are.

    python benchmarks/gaits.py                       # all encoders, 5,000 gaits
    python benchmarks/gaits.py --only mlp recurrent --rows 1000 --components 3
    python benchmarks/gaits.py --run                 # whole runs: what is found
    python benchmarks/gaits.py --quick               # to see it work: seconds; no conclusions can be drawn

A gait has three parameters, its amplitude, its frequency and how much the second of two joints lags behind the first, or all
behind those before; what is sensed are the angles of 12 joints at 200 steps. Correlations are those between distances in the
latent space and distances between the true parameters, of 1,000 gaits never trained on. Errors are root mean square errors of
the same, on the [-1, 1] scale.
"""

import argparse
import time
from functools import partial

import numpy as np
from scipy.spatial.distance import pdist
from scipy.stats import pearsonr, spearmanr
from sklearn.decomposition import PCA
from sklearn.manifold import Isomap

import auroraqd
from auroraqd.metrics import reconstruction_error

STEPS, JOINTS, SECONDS = 200, 12, 4.0
TIME, JOINT = np.linspace(0, SECONDS, STEPS)[:, None], np.arange(JOINTS)
GENERATIONS, BATCH, CELLS, BINS = 50, 60, 500, 6
BRIEF = {"min_steps": 100, "max_epochs": 1, "repeats": 1}  # training of auto-encoders, to see it work


def _swings(amplitude, frequency, phase):
    """(n,), (n,) in Hz and (n, joints) to (n, steps, joints)."""
    return amplitude[:, None, None] * np.sin(2 * np.pi * frequency[:, None, None] * TIME + phase[:, None])


def wave(genes):
    """Each joint lags behind the one before."""
    lag = np.pi / 3 * (2 * genes[:, 2:] - 1)
    return _swings(0.2 + 0.8 * genes[:, 0], 0.5 + 1.5 * genes[:, 1], lag * JOINT)


def pairs(genes):
    """Each second joint lags behind the first."""
    lag = np.pi * genes[:, 2:]
    return _swings(0.2 + 0.8 * genes[:, 0], 0.5 + 1.5 * genes[:, 1], lag * (JOINT % 2) + 0.3 * JOINT)


GAITS = {"wave": wave, "pairs": pairs}


class Flat:
    """A transformer of scikit-learn, fitted on 2,000 sequences at most: Isomap takes all their distances."""

    def __init__(self, estimator):
        self.estimator = estimator

    def fit(self, x):
        """Sequences, (n, steps, channels)."""
        self.estimator.fit(x.reshape(len(x), -1)[:2000])
        return self

    def transform(self, x):
        """To (n, d)."""
        return self.estimator.transform(x.reshape(len(x), -1))

    def inverse_transform(self, z):
        """Back."""
        return self.estimator.inverse_transform(z).reshape(-1, STEPS, JOINTS)


def encoders(d, **training):
    """By name, of this many components; the training is that of auto-encoders."""
    learned = partial(auroraqd.AutoEncoder, d, random_state=0, **training)
    return {
        "PCA": Flat(PCA(d)),
        "Isomap": Flat(Isomap(n_neighbors=8, n_components=d)),
        "mlp": learned(network="mlp"),
        "mlp, geodesic": learned(network="mlp", metric="geodesic"),
        "recurrent, euclidean": learned(network="recurrent", metric="euclidean"),
        "recurrent, geodesic": learned(network="recurrent", metric="geodesic"),
        "recurrent": learned(network="recurrent"),
        "auto": learned(),
    }


def correlations(wanted, z):
    """Of ranks, and of distances."""
    return spearmanr(wanted, pdist(z))[0], pearsonr(wanted, pdist(z))[0]


def fits(names, gait, rows, d, training):
    """One update on this many gaits."""
    rng = np.random.default_rng(0)
    x, genes = GAITS[gait](rng.random((rows, 3))), rng.random((1000, 3))
    new, wanted = GAITS[gait](genes), pdist(genes)
    most = max(correlations(wanted, genes[:, [i for i in range(3) if i != left]])[0] for left in range(3)) if d < 3 else 1.0
    print(f"### One update on {rows:,} gaits, {gait}, {STEPS} x {JOINTS}; {d} components\n")
    print(f"Two of the three parameters themselves: rank correlation {most:.2f}\n" if d == 2 else "")
    print(
        "| encoder | rank correlation | correlation | RMSE | seconds | CPU | encoding 200, ms |\n|---|---|---|---|---|---|---|"
    )
    for name in names:
        encoder = encoders(d, **training)[name]
        since, used = time.perf_counter(), time.process_time()
        encoder.fit(x)
        seconds, used = time.perf_counter() - since, time.process_time() - used
        z = encoder.transform(new)
        rank, linear = correlations(wanted, z)
        try:
            error = reconstruction_error(new, encoder.inverse_transform(z)).mean()
        except AttributeError:  # Isomap has no way back
            error = np.nan
        since = time.perf_counter()
        for _ in range(10):
            encoder.transform(new[:200])
        each = 100 * (time.perf_counter() - since)
        print(f"| {name} | {rank:.2f} | {linear:.2f} | {error:.3f} | {seconds:.0f} | {used:.0f} | {each:.0f} |", flush=True)


def runs(names, gait, d, generations, training):
    """Whole runs: of how many of the cells of the true parameters there are skills."""

    def task(genes):
        return np.zeros(len(genes)), GAITS[gait](genes), genes

    print(f"### {generations} generations of {BATCH}, {gait}, {d} components\n")
    print(f"| encoder | stored | coverage of {BINS}^3 | rank correlation | RMSE | seconds |\n|---|---|---|---|---|---|")
    for name in names:
        encoder = encoders(d, **training)[name]
        encoder = encoder.estimator if isinstance(encoder, Flat) else encoder
        since = time.perf_counter()
        aurora = auroraqd.Aurora(3, encoder, seed=0, batch_size=BATCH, resolution=auroraqd.VAT(cells=CELLS))
        aurora.run(task, generations=generations)
        archive, seconds = aurora.archive, time.perf_counter() - since
        found = auroraqd.metrics.coverage(archive.ground_truth, bins=BINS, low=0, high=1)
        rank = correlations(pdist(archive.ground_truth), archive.descriptor)[0]
        error = aurora.history.last.rmse
        print(f"| {name} | {len(archive)} | {found:.2f} | {rank:.2f} | {error:.3f} | {seconds:.0f} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=encoders(2), help="default: all")
    parser.add_argument("--gait", choices=GAITS, default="wave")
    parser.add_argument("--rows", type=int, default=5_000)
    parser.add_argument("--components", type=int, default=2)
    parser.add_argument("--run", action="store_true")
    parser.add_argument("--quick", action="store_true", help="100 gaits, or two generations, of two encoders, hardly trained")
    chosen = parser.parse_args()
    training, rows, generations, names = {}, chosen.rows, GENERATIONS, chosen.only or [*encoders(2)]
    if chosen.quick:
        training, rows, generations, names = BRIEF, 100, 2, names[:2]
    if chosen.run:
        runs(names, chosen.gait, chosen.components, generations, training)
    else:
        fits(names, chosen.gait, rows, chosen.components, training)
