"""A robot that is not a function: ask for controllers, try them one by one, tell what happened. Failures are NaN."""

import sys

import numpy as np
from sklearn.decomposition import PCA

import auroraqd


def try_on_the_robot(controller, rng):
    """Where a wheeled robot is at 10 moments; every twentieth trial it loses contact."""
    if rng.random() < 0.05:
        raise ConnectionError("no answer")
    speed, turn = controller
    heading = np.cumsum(np.full(10, 0.6 * (turn - 0.5)))
    return np.cumsum(speed * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)


def main(generations=20):
    rng = np.random.default_rng(0)
    aurora = auroraqd.Aurora(2, PCA(n_components=2), seed=0, batch_size=10)
    for _ in range(generations):
        controllers = aurora.ask()
        observation = np.full((len(controllers), 10, 2), np.nan)
        for i, controller in enumerate(controllers):
            try:
                observation[i] = try_on_the_robot(controller, rng)
            except ConnectionError as error:
                print(f"trial {i}: {error}")
        aurora.tell(np.zeros(len(controllers)), observation)
    print(aurora.archive)
    print(aurora.history.last)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
