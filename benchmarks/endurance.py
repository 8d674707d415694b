"""What it costs to lose nothing, and what many workers give.

python benchmarks/endurance.py            # checkpoints, and evaluations over two processes
python benchmarks/endurance.py --kill 20  # a run of paper size, killed 20 times, beside one left alone: ten minutes
python benchmarks/endurance.py --quick    # to see it work: seconds; no conclusions can be drawn
"""

import argparse
import json
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.runs import folders

MILLISECONDS = 5
GENERATIONS = 5000


def simulated(genotypes):
    """A simulator that computes for 5 ms an individual."""
    for _ in genotypes:
        end = time.perf_counter() + MILLISECONDS / 1e3
        while time.perf_counter() < end:
            pass
    return np.zeros(len(genotypes)), np.cumsum(genotypes, axis=1)[..., None]


def checkpoints(generations):
    """Writing one at the end of runs, and their share of a run."""
    print(f"### Checkpoints of runs of {generations:,} generations, PCA\n")
    print("| task | stored | MB | seconds for one (median of 9) | resuming | run, s | with checkpoints, s | share of them |")
    print("|---|---|---|---|---|---|---|---|")
    for task in (auroraqd.tasks.Ballistic(), auroraqd.tasks.AirHockey()):

        def fresh(task=task):
            return auroraqd.Aurora(task.n_genes, PCA(n_components=2), seed=0, variation=auroraqd.Polynomial(at_least_one=False))

        fresh().run(task, generations=60)
        since = time.perf_counter()
        fresh().run(task, generations=generations)
        alone = time.perf_counter() - since
        with tempfile.TemporaryDirectory() as folder:
            aurora, spent, write = fresh(), [], folders.write

            def timed(*arguments, spent=spent, write=write, **options):
                since = time.perf_counter()
                write(*arguments, **options)
                spent.append(time.perf_counter() - since)

            folders.write = timed
            since = time.perf_counter()
            with auroraqd.Checkpoints(aurora, folder) as saved:
                aurora.run(task, generations=generations, callback=saved)
            total = time.perf_counter() - since
            share = sum(spent) / total
            spent.clear()
            for _ in range(9):
                timed(aurora, Path(folder), None, keep=True)
            folders.write = write
            size = (Path(folder) / folders.REPERTOIRE).stat().st_size / 1e6
            since = time.perf_counter()
            auroraqd.resume(folder)
            resumed = time.perf_counter() - since
        print(
            f"| {type(task).__name__} | {len(aurora.archive):,} | {size:.1f} | {np.median(spent):.3f} | {resumed:.2f} | "
            f"{alone:.1f} | {total:.1f} | {100 * share:.1f}% |",
            flush=True,
        )


def workers(batches):
    """Batches of 200 of a task of 5 ms an evaluation."""
    print(f"\n### A task of {MILLISECONDS} ms an evaluation, {batches} batches of 200\n")
    print("| workers | seconds a batch (median) | efficiency |\n|---|---|---|")
    genotypes = np.random.default_rng(0).random((200, 10))
    ideal = 200 * MILLISECONDS / 1e3
    for number in (1, 2):
        with auroraqd.evaluate.over(auroraqd.evaluate.processes(number), simulated) as task:
            task(genotypes)
            seconds = []
            for _ in range(batches):
                since = time.perf_counter()
                task(genotypes)
                seconds.append(time.perf_counter() - since)
        median = float(np.median(seconds))
        print(f"| {number} | {median:.3f} | {100 * ideal / number / median:.0f}% |", flush=True)


def killed(times, generations):
    """A run killed at random moments, resumed each time, beside one left alone."""
    command = [sys.executable, "-m", "auroraqd"]
    rng = random.Random(0)
    with tempfile.TemporaryDirectory() as folder:
        alone, ended = Path(folder) / "alone", Path(folder) / "killed"
        options = ["--no-figures", "--checkpoint-every", "1"]
        run = ["run", "air-hockey", "--generations", str(generations), *options, "--out"]
        subprocess.run([*command, *run, alone], check=True, stdout=subprocess.DEVNULL)
        print(f"### A run of {generations:,} generations on the air-hockey task, killed {times} times\n")

        def going_on():
            begun = (ended / folders.REPERTOIRE).is_file()  # or it was killed before there was anything to go on from
            return [*command, *(["resume", ended, *options] if begun else [*run, ended, "--overwrite"])]

        generation = 0
        for _ in range(times):
            process = subprocess.Popen(going_on(), stdout=subprocess.DEVNULL)
            time.sleep(rng.uniform(2, 5.5))  # about two of them until it is at work
            process.send_signal(signal.SIGKILL)
            process.wait()
            if (ended / folders.REPERTOIRE).is_file():
                generation = auroraqd.resume(ended).generation
            print(f"killed, {generation} generations are kept", flush=True)
        if generation < generations:
            subprocess.run(going_on(), check=True, stdout=subprocess.DEVNULL)
        same = (alone / folders.REPERTOIRE).read_bytes() == (ended / folders.REPERTOIRE).read_bytes()
        history = [[record[:-1] for record in folders.load_history(path)] for path in (alone, ended)]
        configs = [json.loads((path / folders.CONFIG).read_text()) for path in (alone, ended)]
        for config in configs:
            del config["provenance"]  # the command and the date differ
        print(f"\nthe same repertoire, byte for byte: {same}")
        print(f"the same history but for the times: {repr(history[0]) == repr(history[1])}")
        print(f"the same config: {configs[0] == configs[1]}")


def main(quick=False):
    checkpoints(50 if quick else GENERATIONS)
    workers(batches=1 if quick else 10)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kill", type=int, metavar="TIMES")
    parser.add_argument("--quick", action="store_true", help="runs of 50 generations, killed once")
    given = parser.parse_args()
    if given.kill is None:
        main(given.quick)
    else:
        killed(1 if given.quick else given.kill, 50 if given.quick else GENERATIONS)
