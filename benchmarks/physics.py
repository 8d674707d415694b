"""Physics of many robots at once, a step of control at a time, as a policy needs it: what libraries there are, and how exact.

    pip install gymnasium[mujoco] mjbatch      # in an environment of its own: mjbatch 0.1 needs MuJoCo 3.14.0
    python benchmarks/physics.py
    python benchmarks/physics.py --quick       # to see it work: seconds; no conclusions can be drawn

MuJoCo's mj_step, called from Python for one robot after the other, five steps a call; MuJoCo's rollout, called for all robots
five steps at a time, which begins each time without what its solver had found; and mjbatch, if it is installed, all of them in
C++. All do the same 50 steps of control. What a policy and an environment compute is left out.
"""

import argparse
import time
from importlib.util import find_spec

import gymnasium
import mujoco
import numpy as np
from mujoco.rollout import rollout

ROBOTS = "Ant-v5", "HalfCheetah-v5", "Humanoid-v5"
BATCH, STEPS, SKIP = 64, 50, 5


def one_by_one(model, controls):
    """Last positions, (BATCH, nq)."""
    datas = [mujoco.MjData(model) for _ in range(BATCH)]
    for control in controls:
        for data, own in zip(datas, control, strict=True):
            data.ctrl[:] = own
            mujoco.mj_step(model, data, nstep=SKIP)
    return np.array([data.qpos for data in datas])


def rolled(model, controls, threads):
    """Last positions, (BATCH, nq)."""
    kind, datas = mujoco.mjtState.mjSTATE_FULLPHYSICS, [mujoco.MjData(model) for _ in range(threads)]
    begun = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, datas[0], begun, kind)
    state = np.tile(begun, (BATCH, 1))
    for control in controls:
        state = rollout(model, datas, state, np.repeat(control[:, None], SKIP, axis=1))[0][:, -1]
    return state[:, 1 : 1 + model.nq]


def in_a_batch(model, controls, threads):
    """Last positions, (BATCH, nq)."""
    from mjbatch import Batch

    batch = Batch(model, BATCH, num_threads=threads)
    positions, wanted = batch.bind("qpos"), batch.bind("ctrl")
    for control in controls:
        wanted[:] = control
        batch.step(nstep=SKIP)
    return positions.copy()


def ways():
    """By name."""
    found = {"mj_step, one after the other": one_by_one}
    for threads, words in ((1, "one thread"), (2, "two threads")):
        found[f"rollout, {words}"] = lambda model, controls, threads=threads: rolled(model, controls, threads)
        if find_spec("mjbatch"):
            found[f"mjbatch, {words}"] = lambda model, controls, threads=threads: in_a_batch(model, controls, threads)
    return found


def main(quick=False):
    repeats, steps = (1, 5) if quick else (4, STEPS)
    print(f"MuJoCo {mujoco.__version__}, {BATCH} robots, microseconds a step of physics, the least of {repeats}\n")
    print("| robot | by | a step | of all cores | farthest from mj_step |\n|---|---|---|---|---|")
    for env_id in ROBOTS:
        model = gymnasium.make(env_id).unwrapped.model
        controls = np.random.default_rng(0).uniform(-0.4, 0.4, (steps, BATCH, model.nu))
        times, ends = {name: [] for name in ways()}, {}
        for _ in range(repeats):
            for name, way in ways().items():
                since, used = time.perf_counter(), time.process_time()
                ends[name] = way(model, controls)
                times[name].append((time.perf_counter() - since, time.process_time() - used))
        for name, took in times.items():
            clock, cores = 1e6 * np.min(took, axis=0) / (BATCH * steps * SKIP)
            apart = np.abs(ends[name] - ends["mj_step, one after the other"]).max()
            print(f"| {env_id} | {name} | {clock:.1f} | {cores:.1f} | {apart:.0e} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="5 steps, once")
    main(parser.parse_args().quick)
