"""An encoder of PyTorch as a descriptor: convolutions over time learn what throws have in common.

A descriptor is anything with `fit` and `transform`; with `inverse_transform` the errors of its reconstructions are kept. To be
saved it says in `__getstate__` what it is made of, in numbers and NumPy arrays, and in `__setstate__` how it is made of these
again: there is no code in a run folder, and no pickle. Copies, pipelines of scikit-learn and `Streams` use the same two.

    pip install torch
    python examples/torch_encoder.py    # 100 generations of 200, a minute

Writes the run folder `runs/torch`.
"""

import sys

import torch
from torch import nn

import auroraqd

torch.set_num_threads(1)  # small products; and the same sums, in the same order, on any machine of a kind


class TorchEncoder:
    """An auto-encoder for time series, (n, steps, channels).

    Args:
        n_components: of the descriptor.
        epochs: of a fit; another fit goes on with the weights there are.
        seed: of weights and mini-batches.
    """

    natural_shape = True  # it reads (n, steps, channels); else rows were flat

    def __init__(self, n_components=2, epochs=20, seed=0):
        self.n_components, self.epochs, self.seed = n_components, epochs, seed
        self.shape = None  # (steps, channels), once it is fitted

    def _build(self, shape):
        steps, channels = self.shape = tuple(shape)
        torch.manual_seed(self.seed)
        with torch.device("cpu"):
            self.encoder = nn.Sequential(
                nn.Conv1d(channels, 8, kernel_size=5, stride=2, padding=2),
                nn.Tanh(),
                nn.Flatten(),
                nn.Linear(8 * -(-steps // 2), 32),
                nn.Tanh(),
                nn.Linear(32, self.n_components),
            ).double()  # in float64 a row is described alike in a batch of any size, but for its last bits
            self.decoder = nn.Sequential(
                nn.Linear(self.n_components, 32),
                nn.Tanh(),
                nn.Linear(32, steps * channels),
                nn.Unflatten(1, self.shape),
            ).double()

    def _weights(self):
        return [*self.encoder.parameters(), *self.decoder.parameters()]

    def fit(self, x):
        """Adam on mini-batches of 64."""
        if self.shape is None:
            self._build(x.shape[1:])
        rows, draw = torch.as_tensor(x), torch.Generator().manual_seed(self.seed)
        optimizer = torch.optim.Adam(self._weights(), lr=3e-3)
        for _ in range(self.epochs):
            for batch in torch.randperm(len(rows), generator=draw).split(64):
                optimizer.zero_grad()
                loss = (self.decoder(self.encoder(rows[batch].mT)) - rows[batch]).square().mean()
                loss.backward()
                optimizer.step()
        return self

    @torch.no_grad()
    def transform(self, x):
        """(n, steps, channels) to (n, n_components)."""
        return self.encoder(torch.as_tensor(x).mT).numpy()

    @torch.no_grad()
    def inverse_transform(self, z):
        """And back."""
        return self.decoder(torch.as_tensor(z)).numpy()

    def __getstate__(self):
        options = {"n_components": self.n_components, "epochs": self.epochs, "seed": self.seed}
        weights = [] if self.shape is None else [weight.detach().numpy() for weight in self._weights()]
        return {**options, "shape": self.shape, "weights": weights}

    def __setstate__(self, state):
        self.__init__(state["n_components"], state["epochs"], state["seed"])
        if state["shape"] is not None:
            self._build(state["shape"])
            for weight, values in zip(self._weights(), state["weights"], strict=True):
                weight.data = torch.as_tensor(values.copy())


def main(generations=100):
    task = auroraqd.tasks.Ballistic()
    auroraqd.testing.check_descriptor(TorchEncoder(epochs=1))
    aurora = auroraqd.Aurora(task.n_genes, TorchEncoder(), seed=0, schedule=auroraqd.Doubling(10))
    aurora.run(task, generations=generations // 2)
    auroraqd.save(aurora, "runs/torch")
    aurora = auroraqd.resume("runs/torch", trusted=[f"{__name__}.TorchEncoder"])  # which says that its code may be called
    aurora.run(task, generations=generations - generations // 2)
    print(f"{len(aurora.archive)} individuals, RMSE {aurora.history.last.rmse:.3f} on the [-1, 1] scale")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
