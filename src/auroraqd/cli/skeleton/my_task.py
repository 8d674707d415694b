"""my_task: what a robot does, and what it senses, when it is given controllers.

A cart with two wheels stands in for your robot. Put its parameters into GENES, and your simulator into `simulate`.
"""

import numpy as np

from auroraqd.tasks import Evaluation, Genes

GENES = Genes(  # what there is to try: name, lowest, highest, unit
    left_first=(-1, 1, "m/s"),
    right_first=(-1, 1, "m/s"),
    left_then=(-1, 1, "m/s"),
    right_then=(-1, 1, "m/s"),
)
STEPS = 40  # of a simulation
SECONDS = 0.1  # a step
WIDTH = 0.5  # m, between the wheels
WALL = 3.0  # m, from the middle


def simulate(wheels):
    """Where carts go: speeds of their wheels, (n, 4) in m/s, in; their ways, (n, STEPS, 2) in m, out."""
    # YOUR SIMULATOR GOES HERE. This one moves all n carts at once. If yours takes one controller at a time, write a function
    # of one genotype, and make a task of it by `auroraqd.tasks.each(function, n_genes)`.
    left, right = wheels[:, 0::2], wheels[:, 1::2]
    speed = np.repeat((left + right) / 2, STEPS // 2, axis=1)
    turn = np.repeat((right - left) / WIDTH, STEPS // 2, axis=1)
    heading = np.cumsum(turn, axis=1) * SECONDS
    steps = speed[..., None] * np.stack([np.cos(heading), np.sin(heading)], axis=2) * SECONDS
    return np.cumsum(steps, axis=1)


def my_task(genotypes):
    """What individuals do: genotypes, (n, n_genes) in [0, 1], in; an evaluation with n rows out."""
    wheels = GENES.scale(genotypes)
    way = simulate(wheels)
    crashed = (np.abs(way) > WALL).any(axis=(1, 2))
    fitness = np.where(crashed, np.nan, -np.abs(wheels).mean(axis=1))  # larger is better; NaN: it failed, and is not stored
    return Evaluation(
        fitness=fitness,
        observation=way,  # what the robot senses: that in which behaviours are to differ. Any shape, (n, ...)
        ground_truth=way[:, -1],  # what you would look at, for figures; the search does not see it
    )


my_task.genes = GENES
my_task.n_genes = len(GENES)
