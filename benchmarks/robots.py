"""Robots of Gymnasium: how long a step takes, in MuJoCo's rollout and when environments are stepped.

Needs the extra `robots`.
"""

import time

import numpy as np

from auroraqd import tasks

BATCH, STEPS = 64, 100
STANDING = {"terminate_when_unhealthy": False}  # or it would be over early


def ways(env_id, options):
    """Tasks by how they are simulated."""
    common = {"steps": STEPS, "options": options}
    return {
        "rollout, as many threads as cores": tasks.Gym(env_id, **common),
        "rollout, one thread": tasks.Gym(env_id, threads=1, **common),
        "stepped, open-loop": tasks.Gym(env_id, fitness="return", **common),
        "stepped, MLP of 16 neurons": tasks.Gym(env_id, controller=tasks.MLP(), **common),
    }


def microseconds(task, repeats=5):
    """Of a step of control: the median of some batches."""
    rng, times = np.random.default_rng(0), []
    task(rng.random((BATCH, task.n_genes)))
    for _ in range(repeats):
        genotypes = rng.random((BATCH, task.n_genes))
        since = time.perf_counter()
        task(genotypes)
        times.append(1e6 * (time.perf_counter() - since) / (BATCH * STEPS))
    return float(np.median(times))


def main():
    print(f"### A step of robots, batches of {BATCH}, episodes of {STEPS} steps, microseconds (median of 5)\n")
    print("| environment | simulated by | a step of control | a step of physics |\n|---|---|---|---|")
    environments = {"Ant-v5": STANDING, "HalfCheetah-v5": {}, "Swimmer-v5": {}}
    robots = {env_id: ways(env_id, options) for env_id, options in environments.items()}
    robots["hexapod"] = {"rollout, one thread": tasks.Hexapod(seconds=0.015 * STEPS, threads=1)}
    for robot, simulated in robots.items():
        for name, task in simulated.items():
            took, physics = microseconds(task), task.interval / task.model.opt.timestep
            print(f"| {robot} | {name} | {took:.0f} | {took / physics:.1f} |", flush=True)


if __name__ == "__main__":
    main()
