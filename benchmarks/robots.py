"""Robots of Gymnasium: how long a step takes, in MuJoCo's rollout and when environments are stepped, in one thread and in two.

    python benchmarks/robots.py
    python benchmarks/robots.py --quick    # to see it work: seconds; no conclusions can be drawn

What a step of an environment costs is MuJoCo's physics, which threads do at once, and Python, which they do in turn. So it can
become no less than the Python part, however many threads there are. Needs the extra `robots`.
"""

import argparse
import time

import numpy as np

from auroraqd import tasks

BATCH, STEPS = 64, 100
STANDING = {"terminate_when_unhealthy": False}  # or it would be over early
ROBOTS = {"Ant-v5": STANDING, "HalfCheetah-v5": {}, "Swimmer-v5": {}, "Humanoid-v5": STANDING}


def ways(env_id, options):
    """Tasks by how they are simulated."""
    common = {"steps": STEPS, "options": options}
    return {
        "rollout, two threads": tasks.Gym(env_id, threads=2, **common),
        "rollout, one thread": tasks.Gym(env_id, threads=1, **common),
        "stepped, open-loop, one thread": tasks.Gym(env_id, fitness="return", threads=1, **common),
        "stepped, MLP of 16 neurons, one thread": tasks.Gym(env_id, controller=tasks.MLP(), threads=1, **common),
        "stepped, MLP of 16 neurons, two threads": tasks.Gym(env_id, controller=tasks.MLP(), threads=2, **common),
    }


def microseconds(task, repeats, batch):
    """Of a step of control: the median of some batches."""
    return medians({"": task}, repeats, batch)[""][0]


def medians(simulated, repeats, batch):
    """Of steps of control, in microseconds, of the clock and of all cores, by the way they are simulated.

    All ways take turns, for other programs come and go.
    """
    rng, times = np.random.default_rng(0), {name: [] for name in simulated}
    for task in simulated.values():
        task(rng.random((batch, task.n_genes)))
    for _ in range(repeats):
        for name, task in simulated.items():
            genotypes = rng.random((batch, task.n_genes))
            since, used = time.perf_counter(), time.process_time()
            task(genotypes)
            times[name].append((time.perf_counter() - since, time.process_time() - used))
    return {name: np.median(both, axis=0) * 1e6 / (batch * STEPS) for name, both in times.items()}


def share_of_physics(task, batch):
    """Of the time of a task that steps in one thread, that of MuJoCo's steps."""
    import mujoco

    plain, spent = mujoco.mj_step, []

    def clocked(*arguments, **named):
        since = time.perf_counter()
        plain(*arguments, **named)
        spent.append(time.perf_counter() - since)

    genotypes = np.random.default_rng(0).random((batch, task.n_genes))
    mujoco.mj_step = clocked
    try:
        since = time.perf_counter()
        task(genotypes)
        return sum(spent) / (time.perf_counter() - since)
    finally:
        mujoco.mj_step = plain


def main(quick=False):
    repeats, batch = (1, 2) if quick else (5, BATCH)
    print(f"### A step of robots, batches of {batch}, episodes of {STEPS} steps, microseconds (medians of {repeats})\n")
    print("| environment | simulated by | a step of control | of all cores | a step of physics |\n|---|---|---|---|---|")
    robots = {env_id: ways(env_id, options) for env_id, options in ROBOTS.items()}
    robots["hexapod"] = {"rollout, one thread": tasks.Hexapod(seconds=0.015 * STEPS, threads=1)}
    for robot, simulated in robots.items():
        for name, (took, used) in medians(simulated, repeats, batch).items():
            physics = simulated[name].interval / simulated[name].model.opt.timestep
            print(f"| {robot} | {name} | {took:.0f} | {used:.0f} | {took / physics:.1f} |", flush=True)
    print("\n| environment, MLP of 16 neurons, one thread | MuJoCo's steps, of the time |\n|---|---|")
    for env_id in ROBOTS:
        share = share_of_physics(robots[env_id]["stepped, MLP of 16 neurons, one thread"], batch)
        print(f"| {env_id} | {share:.0%} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="one batch of two each")
    main(parser.parse_args().quick)
