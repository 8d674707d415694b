"""A simulator that knows one robot at a time: Laikago of PyBullet walks, and an auto-encoder finds out in how many ways.

A task is a function of one controller, made one of many by `auroraqd.tasks.each`. Each episode begins from the same saved
state, so that what comes out follows from the genotype alone. What is sensed are the place of the body and the angles of 12
joints at 20 moments of two seconds. In the end the error of reconstructions is told for controllers that no run has seen.

    pip install pybullet
    python examples/laikago.py                 # 40 generations of 50, some minutes
    python examples/laikago.py 40 plain        # or: 40 pca

Writes the run folder `runs/laikago`, with figures.
"""

import sys

import numpy as np
import pybullet
import pybullet_data
from sklearn.decomposition import PCA

import auroraqd
from auroraqd.metrics import reconstruction_error
from auroraqd.report import write_figures

STANDS = [0.0, 0.0, 0.5]  # m
STRAIGHT_UP = [0.0, 0.5, 0.5, 0.0]  # as its model lies
BENT = np.tile([0.0, 0.3, -0.6], 4)  # rad, of the joints of a leg
REACH = np.tile([0.2, 0.5, 0.5], 4)  # rad, to both sides
STEPS, EVERY, STRENGTH = 480, 24, 40.0  # of 1/240 s; between two moments that are sensed; N m


class Laikago:
    """The robot on a floor, in a simulation of its own."""

    def __init__(self):
        self.world = pybullet.connect(pybullet.DIRECT)
        pybullet.setAdditionalSearchPath(pybullet_data.getDataPath(), self.world)
        pybullet.setGravity(0, 0, -9.81, self.world)
        pybullet.loadURDF("plane.urdf", physicsClientId=self.world)
        where = {"basePosition": STANDS, "baseOrientation": STRAIGHT_UP}
        self.robot = pybullet.loadURDF("laikago/laikago_toes.urdf", **where, physicsClientId=self.world)
        kinds = [
            pybullet.getJointInfo(self.robot, j, self.world)[2] for j in range(pybullet.getNumJoints(self.robot, self.world))
        ]
        self.joints = [j for j, kind in enumerate(kinds) if kind == pybullet.JOINT_REVOLUTE]
        for joint, angle in zip(self.joints, BENT, strict=True):
            pybullet.resetJointState(self.robot, joint, angle, physicsClientId=self.world)
        self.start = pybullet.saveState(self.world)

    def episode(self, wanted):
        """Place of the body and angles, (moments, 15), when its joints shall have these angles, (STEPS, 12)."""
        pybullet.restoreState(self.start, physicsClientId=self.world)
        sensed, forces = [], [STRENGTH] * len(self.joints)
        for step, angles in enumerate(wanted, start=1):
            position = pybullet.POSITION_CONTROL
            pybullet.setJointMotorControlArray(
                self.robot, self.joints, position, angles.tolist(), forces=forces, physicsClientId=self.world
            )
            pybullet.stepSimulation(self.world)
            if step % EVERY == 0:
                place, _ = pybullet.getBasePositionAndOrientation(self.robot, self.world)
                states = pybullet.getJointStates(self.robot, self.joints, self.world)
                sensed.append([*place, *(state[0] for state in states)])
        return np.array(sensed)


DESCRIPTORS = {
    "autoencoder": auroraqd.AutoEncoder(2),
    "plain": auroraqd.AutoEncoder(2, noise=0),  # soon knows by heart a thousand individuals of 300 numbers
    "pca": PCA(n_components=2),
}
controller = auroraqd.tasks.Sinusoids()
laikago = Laikago()


def walk(genotype):
    """How fast it goes forwards, what it senses, and where it ends."""
    controls = controller(genotype[None], len(BENT), np.arange(STEPS) / 240)[0]
    sensed = laikago.episode(BENT + REACH * controls)
    return sensed[-1, 0] * 240 / STEPS, sensed, sensed[-1, :2]


def main(generations=40, descriptor="autoencoder"):
    generations = int(generations)
    task = auroraqd.tasks.each(walk, n_genes=controller.n_genes(len(BENT)))
    options = {"seed": 0, "batch_size": 50, "selection": auroraqd.Uniform(), "variation": auroraqd.IsoLine(0.02, 0.2)}
    aurora = auroraqd.Aurora(task.n_genes, DESCRIPTORS[descriptor], **options, schedule=auroraqd.Doubling(5))
    aurora.run(task, generations=generations)
    auroraqd.save(aurora, "runs/laikago")
    write_figures("runs/laikago")
    repertoire = auroraqd.load("runs/laikago")
    unseen = task(np.random.default_rng(1).random((10 * generations, task.n_genes)))[1]
    told = repertoire.reconstruct(repertoire.describe(unseen))
    spread = np.ptp(unseen, axis=(0, 1)) / 2
    error = reconstruction_error(unseen / spread, told / spread).mean()
    print(f"{len(repertoire)} individuals; of controllers never seen, RMSE {error:.3f} on their [-1, 1] scale")


if __name__ == "__main__":
    main(*sys.argv[1:])
