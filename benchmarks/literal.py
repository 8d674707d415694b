"""AURORA-AE pre-trained, trained as the paper says: does the length of the training explain its coverage?

    python benchmarks/literal.py            # an hour and a half of one core
    python benchmarks/literal.py --quick    # to see it work: half a minute

Adagrad at 0.1 on all 10,000 throws of the prior data set at once, no validation split, nothing that ends it early
(`AutoEncoder.paper`). The paper's training has up to five repeats of 25,000 epochs; a repeat restarts the optimiser. Here one
repeat of each length is trained from the same first weights, and a whole run follows it. The paper's KLC is 0.528.
"""

import argparse
import time

import numpy as np

import auroraqd
from auroraqd.metrics import klc, reconstruction_error

LENGTHS = (60, 250, 1_000, 4_000, 25_000)  # epochs
GENERATIONS = 5_000
AS_THE_PAPER = {"variation": auroraqd.Polynomial(at_least_one=False), "resolution": auroraqd.VAT(robust=False), "survival": 0.0}


def row(epochs: int, seed: int, generations: int) -> str:
    """A line of the table: the training, and the run that follows it."""
    task = auroraqd.tasks.Ballistic()
    prior = task.prior()
    encoder = auroraqd.AutoEncoder.paper(2, validation=0, repeats=1, max_epochs=epochs, patience=epochs, random_state=seed)
    since = time.process_time()
    encoder.fit(prior)
    seconds = time.process_time() - since
    low, high = prior.min(axis=(0, 1)), prior.max(axis=(0, 1))
    found = encoder.inverse_transform(encoder.transform(prior))
    error = reconstruction_error(prior * 2 / (high - low), found * 2 / (high - low)).mean()
    runs = {
        "hand-coded": auroraqd.Aurora(2, "hand-coded", seed=seed, **AS_THE_PAPER),
        "ae": auroraqd.Aurora(2, Fitted(encoder), seed=seed, prior=prior, **AS_THE_PAPER),
    }
    truths = [run.run(task, generations=generations).archive.ground_truth for run in runs.values()]
    return f"| {epochs:,} | {seconds:,.0f} | {error:.4f} | {len(truths[1]):,} | {klc(*truths):.3f} |"


class Fitted:
    """An encoder that has learned, and learns nothing more: `Aurora` fits on the prior data set once."""

    natural_shape = True

    def __init__(self, encoder: auroraqd.AutoEncoder):
        self.encoder = encoder

    def fit(self, x: np.ndarray) -> "Fitted":
        """Nothing."""
        return self

    def transform(self, x: np.ndarray) -> np.ndarray:
        """The latent positions."""
        return self.encoder.transform(x)

    def inverse_transform(self, z: np.ndarray) -> np.ndarray:
        """What they decode to."""
        return self.encoder.inverse_transform(z)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="5 epochs, 20 generations; no conclusions can be drawn")
    args = parser.parse_args()
    print("| epochs | CPU s of training | RMSE | stored | KLC |\n|---|---|---|---|---|")
    for epochs in (5,) if args.quick else LENGTHS:
        print(row(epochs, args.seed, 20 if args.quick else GENERATIONS), flush=True)


if __name__ == "__main__":
    main()
