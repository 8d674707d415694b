"""auroraqd beside its peers, in one process and in turns: pyribs' `ProximityArchive`, and the AURORA of QDax.

    pip install "auroraqd[peers]"
    python benchmarks/peers.py
    python benchmarks/peers.py --quick    # to see it work: seconds; no conclusions can be drawn

All do the ballistic task in batches of 200, with a two-dimensional PCA of the scaled trajectories that was fitted once before,
on uniformly random throws: nothing is refitted while the clock runs. All mutate one or both of the two genes by polynomial
mutation. Times are medians. The systems take turns in blocks of a few generations, so that the machine's noise meets both
and each works with its own data in the cache, as it would alone.

pyribs has no AURORA. Two loops around its archive:

- bare: the cheapest that does the work. Parents are `sample_elites`, children `auroraqd.Polynomial`, descriptors
  `Aurora.describe`; the archive keeps neither observations nor ground truths, although a refit would need the observations.
- taught: as its tutorials have it, with `GaussianEmitter`, `Scheduler` and scikit-learn's PCA; the archive keeps the
  observations.

Neither has local competition, which a constant fitness would leave without effect. The generation of auroraqd also takes the
curiosity score, the reconstruction errors and the history.

The two archives decide differently: pyribs adds what has a mean distance to its 15 nearest above a threshold, judges a batch
against what was stored before it, and replaces nothing; auroraqd adds what is farther than l from its nearest, one individual
at a time, and lets others compete for the place of their nearest. pyribs builds a new k-d tree after each batch of which
something was added. So there are two phases, and the table says how many individuals of a batch were stored in each:

- filling: the archive has just reached its size and takes more from each batch;
- full: it has reached about that size after many generations, and hardly grows.

QDax is timed at max_size 1,000 only, with one jitted `AURORA.update` without metrics, on the task written in JAX. Version 0.5.0
looks for the nearest of a batch in an array of shape (batch, max_size, max_size, d), so that a generation grows with the square
of max_size, in memory too where the compiler does not fuse it away; `AURORA.init` and `AURORA.train` add all that is stored as
one batch, which is the cube. Each of its distances is one to all that is stored and not to one individual, so it stores near
duplicates of what it has: the table compares speed, not archives of one quality. Shapes are fixed, and with them its time.
"""

import argparse
import time
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np
from sklearn.decomposition import PCA

import auroraqd

BATCH = 200
NEIGHBOURS = 15


class Budget(NamedTuple):
    """How much is timed.

    Attributes:
        seeds: of pyribs and auroraqd.
        blocks: turns of each seed, and of QDax.
        timed: generations of a turn that count.
        full_after: generations.
        qdax_size: individuals that QDax stores at most.
        qdax_timed: generations of QDax that count.
    """

    seeds: int = 6
    blocks: int = 2
    timed: int = 6
    full_after: int = 600
    qdax_size: int = 1_000
    qdax_timed: int = 20


QUICK = Budget(seeds=1, blocks=1, timed=1, full_after=3, qdax_size=200, qdax_timed=1)


class Case(NamedTuple):
    """An archive size in one phase of a run, and the thresholds that lead there."""

    phase: str
    stored: int
    l: float  # of auroraqd: distance to the nearest
    novelty: float  # of pyribs: mean distance to the nearest 15


CASES = (
    Case("filling", 1_000, l=0.14, novelty=0.32),
    Case("filling", 10_000, l=0.031, novelty=0.075),
    Case("full", 1_000, l=0.173, novelty=0.373),
    Case("full", 10_000, l=0.0465, novelty=0.107),
)


class Timing(NamedTuple):
    """One generation."""

    step: float  # seconds of adding to the archive
    whole: float  # seconds of everything
    stored: int  # individuals of the batch that were stored
    size: int  # individuals stored afterwards


class TimedArchive(auroraqd.UnstructuredArchive):
    """An archive that knows how long its last `insert` took, which is what a run calls: `add` without its checks."""

    seconds = 0.0

    def insert(self, *arguments, **options):
        """As in the base class."""
        since = time.perf_counter()
        info = super().insert(*arguments, **options)
        self.seconds = time.perf_counter() - since
        return info


class Ours:
    """The loop of auroraqd, with the defaults but for the fixed descriptor and l."""

    def __init__(self, l, seed):
        self.task = auroraqd.tasks.Ballistic()
        self.aurora = auroraqd.Aurora(
            self.task.n_genes,
            PCA(n_components=2),
            seed=seed,
            batch_size=BATCH,
            archive=TimedArchive(l=l, k=NEIGHBOURS),
            resolution=None,
            schedule=auroraqd.Never(),
            prior=random_throws(),
        )

    def __len__(self):
        return len(self.aurora.archive)

    def generation(self):
        """One generation, timed."""
        since = time.perf_counter()
        genotypes = self.aurora.ask()
        status = self.aurora.tell(*self.task(genotypes))
        whole = time.perf_counter() - since
        return Timing(self.aurora.archive.seconds, whole, np.count_nonzero(status > 0), len(self))


class Pyribs:
    """The same loop around pyribs' archive.

    Args:
        novelty: threshold of the archive.
        seed: of all that is random.
        describe: observations to descriptors.
    """

    def __init__(self, novelty, seed, describe):
        from ribs.archives import ProximityArchive

        self.task = auroraqd.tasks.Ballistic()
        self.variation = auroraqd.Polynomial()
        self.describe = describe
        self.rng = np.random.default_rng(seed)
        self.archive = ProximityArchive(
            solution_dim=self.task.n_genes,
            measure_dim=2,
            k_neighbors=NEIGHBOURS,
            novelty_threshold=novelty,
            seed=seed,
        )

    def __len__(self):
        return len(self.archive)

    def generation(self):
        """One generation, timed."""
        since = time.perf_counter()
        if self.archive.empty:
            genotypes = self.rng.random((BATCH, self.task.n_genes))
        else:
            genotypes = self.variation(self.archive.sample_elites(BATCH)["solution"], self.rng)
        fitness, observation, _ = self.task(genotypes)
        valid = np.isfinite(fitness)
        genotypes, measures = genotypes[valid], self.describe(observation[valid])
        before_add = time.perf_counter()
        status = self.archive.add(genotypes, None, measures)["status"]
        end = time.perf_counter()
        return Timing(end - before_add, end - since, np.count_nonzero(status), len(self))


class PyribsTaught:
    """The loop of pyribs' tutorials: an emitter, a scheduler, and a scikit-learn pipeline for the measures.

    Args:
        novelty: threshold of the archive.
        seed: of all that is random.
        scaling: the range of x and y.
        pca: fitted on observations scaled by it.
    """

    def __init__(self, novelty, seed, scaling, pca):
        from ribs.archives import ProximityArchive
        from ribs.emitters import GaussianEmitter
        from ribs.schedulers import Scheduler

        self.task = auroraqd.tasks.Ballistic()
        self.scaling, self.pca = scaling, pca
        self.archive = ProximityArchive(
            solution_dim=self.task.n_genes,
            measure_dim=2,
            k_neighbors=NEIGHBOURS,
            novelty_threshold=novelty,
            extra_fields={"observation": ((auroraqd.tasks.ballistic.STEPS, 2), np.float64)},
            seed=seed,
        )
        bounds = [(0, 1)] * self.task.n_genes
        emitter = GaussianEmitter(
            self.archive, sigma=0.05, x0=np.full(self.task.n_genes, 0.5), bounds=bounds, batch_size=BATCH, seed=seed
        )
        self.scheduler = Scheduler(self.archive, [emitter])

    def __len__(self):
        return len(self.archive)

    def generation(self):
        """One generation, timed. Throws that are invalid are added too: the scheduler wants all it asked for."""
        before = len(self)
        since = time.perf_counter()
        _, observation, _ = self.task(self.scheduler.ask())
        low, high = self.scaling.low, self.scaling.high
        scaled = (observation - low) / (high - low) * 2 - 1
        measures = self.pca.transform(scaled.reshape(len(scaled), -1))
        before_tell = time.perf_counter()
        self.scheduler.tell(None, measures, observation=observation)
        end = time.perf_counter()
        return Timing(end - before_tell, end - since, len(self) - before, len(self))


class Qdax:
    """QDax's AURORA on the ballistic task, with an encoder that is one matrix.

    Args:
        l: threshold of the repertoire.
        seed: of all that is random.
        describe: observations to descriptors, an affine function.
        size: individuals that it stores at most.
    """

    def __init__(self, l, seed, describe, size):
        import jax
        from qdax.core.aurora import AURORA
        from qdax.core.containers.unstructured_repertoire import UnstructuredRepertoire
        from qdax.core.emitters.mutation_operators import polynomial_mutation
        from qdax.core.emitters.standard_emitters import MixingEmitter
        from qdax.custom_types import AuroraExtraInfo

        def mutate(genotypes, key):
            return polynomial_mutation(genotypes, key, proportion_to_mutate=0.5, eta=10.0, minval=0.0, maxval=1.0)

        def encode(observation, extra):
            weight, offset = extra.model_params
            return observation @ weight + offset

        aurora = AURORA(
            scoring_function=jax.jit(ballistic_in_jax),
            emitter=MixingEmitter(mutate, variation_fn=None, variation_percentage=0.0, batch_size=BATCH),
            metrics_function=lambda repertoire: {},
            encoder_function=encode,
            training_function=None,
        )
        self.split = jax.random.split
        self.wait = jax.block_until_ready
        self.update = jax.jit(aurora.update)
        self.key, first = jax.random.split(jax.random.key(seed))
        self.extra = AuroraExtraInfo(model_params=as_matrix(describe))
        genotypes = jax.random.uniform(first, (BATCH, 2))
        fitness, _, extra_scores = ballistic_in_jax(genotypes, first)
        # `AURORA.init` would describe and add all again, as one batch of max_size, after a training that there is not.
        self.repertoire = jax.jit(UnstructuredRepertoire.init, static_argnames=("max_size", "keys_extra_scores"))(
            genotypes=genotypes,
            fitnesses=fitness,
            descriptors=encode(extra_scores["observations"], self.extra),
            l_value=l,
            max_size=size,
            extra_scores=extra_scores,
            keys_extra_scores=("observations",),
        )

    def __len__(self):
        return int(self.repertoire.get_number_genotypes())

    def generation(self):
        """Seconds of one generation."""
        since = time.perf_counter()
        self.key, key = self.split(self.key)
        self.repertoire, _, _ = self.wait(self.update(self.repertoire, None, key, self.extra))
        return time.perf_counter() - since


def random_throws(n=2_000):
    """Observations of valid throws, uniformly random in the genotype: what the descriptor is fitted on."""
    task = auroraqd.tasks.Ballistic()
    fitness, observation, _ = task(np.random.default_rng(0).random((n, task.n_genes)))
    return observation[np.isfinite(fitness)]


def as_matrix(describe, steps=auroraqd.tasks.ballistic.STEPS):
    """Weight and offset of an affine function of trajectories, flattened."""
    points = np.vstack([np.zeros(2 * steps), np.eye(2 * steps)])
    values = describe(points.reshape(-1, steps, 2))
    return (values[1:] - values[0]).astype(np.float32), values[0].astype(np.float32)


def ballistic_in_jax(genotypes, key):
    """`auroraqd.tasks.Ballistic` as a scoring function of QDax: fitness, descriptors that nobody reads, observations."""
    import jax
    import jax.numpy as jnp

    gravity, bounce, max_force, max_angle = 9.81, 0.6, 200.0, jnp.pi / 2
    share = 0.1 + 0.8 * genotypes
    angle, force = share[:, 0] * max_angle, share[:, 1] * max_force
    along, up = force * jnp.cos(angle), force * jnp.sin(angle)

    def second(state, _):
        x, y, vy, ay = state
        vy = vy + ay
        x, y = x + along, y + vy
        down = y <= 0
        y = jnp.where(down, 0.0, y)
        ay = jnp.where(down, -bounce * vy, -gravity)
        vy = jnp.where(down, 0.0, vy)
        return (x, y, vy, ay), jnp.stack([x, y], axis=-1)

    still = jnp.zeros_like(along)
    _, points = jax.lax.scan(second, (still, still, still, up - gravity), length=auroraqd.tasks.ballistic.STEPS - 1)
    trajectory = jnp.concatenate([jnp.zeros((1, *points.shape[1:])), points])  # (steps, n, 2)
    fitness = jnp.where(up > 3 * gravity, 0.0, -jnp.inf)  # -inf is never stored
    observation = trajectory.swapaxes(0, 1).reshape(len(genotypes), -1)
    return fitness, jnp.zeros((len(genotypes), 2)), {"observations": observation}


def filled(system, case, full_after):
    """Run a system until its archive is as the case has it."""
    for _ in range(full_after):
        if case.phase == "filling" and len(system) >= case.stored:
            break
        system.generation()
    return system


def median_of(timings, field):
    return np.median([getattr(timing, field) for timing in timings])


def row(cells):
    print("| " + " | ".join(cells) + " |", flush=True)


def times(ours, theirs):
    """Cells of a table: two times in seconds as milliseconds, and their ratio."""
    return f"{1e3 * ours:.2f}", f"{1e3 * theirs:.2f}", f"{theirs / ours:.1f}"


def compare_pyribs(budget):
    """The archive step and the whole generation, beside the two loops around pyribs' archive."""
    number = budget.seeds * budget.blocks * budget.timed
    print(f"\n### auroraqd and pyribs' ProximityArchive, batches of {BATCH}, medians of {number}\n")
    row(["phase", "step", "loop of pyribs", "stored", "stored of a batch", "auroraqd ms", "pyribs ms", "pyribs / auroraqd"])
    row(["---"] * 8)
    for case in CASES:
        timings = {"auroraqd": [], "bare": [], "taught": []}
        for seed in range(budget.seeds):
            for name, times_of_seed in zip(timings, one_seed(case, seed, budget), strict=True):
                timings[name] += times_of_seed
        ours = timings["auroraqd"]
        for field, step in (("step", "archive.add"), ("whole", "generation")):
            for loop in ("bare", "taught"):
                theirs = timings[loop]
                sizes = " / ".join(f"{median_of(of, 'size'):,.0f}" for of in (ours, theirs))
                stored = " / ".join(f"{median_of(of, 'stored'):.0f}" for of in (ours, theirs))
                row([case.phase, step, loop, sizes, stored, *times(median_of(ours, field), median_of(theirs, field))])


def one_seed(case, seed, budget):
    """Timings of the three loops, which take turns in blocks."""
    after = budget.full_after
    us = filled(Ours(case.l, seed), case, after)
    descriptor = us.aurora.descriptor
    systems = (
        us,
        filled(Pyribs(case.novelty, seed, us.aurora.describe), case, after),
        filled(PyribsTaught(case.novelty, seed, descriptor.scaling, descriptor.source), case, after),
    )
    timings = ([], [], [])
    for _ in range(budget.blocks):
        for system, out in zip(systems, timings, strict=True):
            system.generation()  # warms the cache
            out += [system.generation() for _ in range(budget.timed)]
    return timings


def compare_qdax(budget):
    """The whole generation, beside QDax."""
    case = next(case for case in CASES if case.phase == "full" and case.stored == 1_000)
    us = filled(Ours(case.l, seed=0), case, budget.full_after)
    them = Qdax(case.l, 0, us.aurora.describe, budget.qdax_size)
    for _ in range(2 * budget.qdax_size // BATCH):
        them.generation()
    ours, theirs = [], []
    for _ in range(budget.blocks):
        us.generation()  # warms the cache
        ours += [us.generation().whole for _ in range(budget.qdax_timed // budget.blocks)]
        theirs += [them.generation() for _ in range(budget.qdax_timed // budget.blocks)]
    print(f"\n### auroraqd and QDax's AURORA, batches of {BATCH}, medians of {budget.qdax_timed}\n")
    row(["stored, auroraqd / QDax", "step", "auroraqd ms", "QDax ms", "QDax / auroraqd"])
    row(["---"] * 5)
    row([f"{len(us):,} / {len(them):,}", "generation", *times(np.median(ours), np.median(theirs))])


def main(quick=False):
    for package, compare in (("ribs", compare_pyribs), ("qdax", compare_qdax)):
        if find_spec(package) is None:
            print(f'\n{package} is not installed, so it is left out: pip install "auroraqd[peers]"')
        else:
            compare(QUICK if quick else Budget())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one generation of each, after three")
    main(parser.parse_args().quick)
