"""A run that ends itself by SIGKILL at a given moment: `python killed.py FOLDER DESCRIPTOR GENERATIONS MOMENT`.

It asks and tells, saves at every step, and goes on with the run in the folder if there is one. A moment is "never"; "after:S",
S seconds after it has begun; or "PLACE:N", the Nth time it is at one of PLACES.
"""

import os
import signal
import sys
import threading
from pathlib import Path

from sklearn.decomposition import PCA

import auroraqd
from auroraqd.descriptors import autoencoder

PLACES = ("asked", "told", "training", "syncing", "moving")


def end():
    os.kill(os.getpid(), signal.SIGKILL)


class Moment:
    def __init__(self, text):
        self.place, _, number = text.partition(":")
        self.left = float(number or 0)
        if self.place == "after":
            threading.Timer(self.left, end).start()

    def at(self, place):
        if place == self.place:
            self.left -= 1
            if self.left <= 0:
                end()


def watched(moment, place, function):
    """The function, and before it the moment."""

    def call(*arguments, **options):
        moment.at(place)
        return function(*arguments, **options)

    return call


def begun(folder, descriptor):
    if (folder / "repertoire.safetensors").is_file() or (folder / "repertoire.previous.safetensors").is_file():
        return auroraqd.resume(folder)
    learned = {"pca": PCA(2), "autoencoder": auroraqd.AutoEncoder(2, hidden=(16, 8), repeats=2, min_steps=100)}
    archive = auroraqd.GridArchive((40, 40)) if descriptor == "genotype" else None
    return auroraqd.Aurora(2, learned.get(descriptor, descriptor), seed=1, batch_size=50, archive=archive)


def main(folder, descriptor, generations, moment):
    folder, moment = Path(folder), Moment(moment)
    os.fsync = watched(moment, "syncing", os.fsync)
    Path.replace = watched(moment, "moving", Path.replace)
    task = auroraqd.tasks.Ballistic()
    aurora = begun(folder, descriptor)
    with (
        auroraqd.Checkpoints(aurora, folder, every=0) as checkpoints,
        autoencoder.listening(lambda progress: moment.at("training")),
    ):
        while aurora.generation < int(generations):
            genotypes = aurora.ask() if aurora.pending is None else aurora.pending
            moment.at("asked")
            checkpoints()
            evaluation = task(genotypes)
            moment.at("asked")
            aurora.tell(*evaluation)
            moment.at("told")
            checkpoints()
    if moment.place == "after":
        os._exit(0)  # before its time has come


if __name__ == "__main__":
    main(*sys.argv[1:])
