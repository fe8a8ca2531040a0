"""Estimate of what can be told at most of the banks beside the vehicle from what lies ahead of it: R² of a network on
true numbers.

    python benchmarks/seen_ahead.py      # writes encoders/seen_ahead.csv

A frame shows the river from some metres ahead on, and not beside the vehicle. A network is given the true numbers of
the points of the course from 7 m on, and the height, along flights as encoders of geometry learn from, and predicts
what decides a flight. An encoder sees the same points with errors, so that it tells less. Rivers of measurement are
others than those of training. It takes two minutes.
"""

import argparse
import csv
import io
from pathlib import Path

import numpy as np
import torch
from torch import nn

from thalweg.core.atomic_io import write_atomic
from thalweg.core.compute.torch_threads import torch_threads
from thalweg.core.seeds import parse_seeds
from thalweg.encoder.geometry_training import r_squared
from thalweg.env.rivers.river_list import RiverList
from thalweg.train.encoder.views import TARGETS, flight_views

TABLE = Path(__file__).resolve().parent / "encoders" / "seen_ahead.csv"
AHEAD = tuple(name for name in TARGETS if name.endswith(("at 7 m", "at 11 m", "at 16 m", "at 24 m")))
"""Numbers of points that a camera at usual heights sees."""
GIVEN, TOLD = (*AHEAD, "height"), ("left bank", "right bank", "heading error", "half width at 2 m")
LEVELS = ("Easy", "Medium", "Hard")
TRAINED_ON, HELD_OUT, VIEWS = "1000:1064", "3000:3006", 160
PASSES, BATCH, RATE = 60, 256, 2e-3


def numbers(seeds: str) -> np.ndarray:
    """Return what is true of views [K, T] on the rivers of all levels with these seeds."""
    rivers = RiverList.of_levels([(level, parse_seeds(seeds, "seeds", ValueError)) for level in LEVELS], 16)
    truths = flight_views(rivers, VIEWS, 0).truths
    return truths[np.isfinite(truths).all(1)].astype(np.float64)


def columns(truths: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """Return the named quantities of truths [K, T]."""
    return truths[:, [TARGETS.index(name) for name in names]]


def fitted(given: np.ndarray, told: np.ndarray) -> nn.Module:
    """Return a network that predicts standardised quantities `told` [K, Q] from those `given` [K, P]."""
    torch.manual_seed(0)
    sizes = ((given.shape[1], 128), (128, 128))
    hidden = [layer for size in sizes for layer in (nn.Linear(*size), nn.ReLU())]
    network = nn.Sequential(*hidden, nn.Linear(128, told.shape[1]))
    optimiser = torch.optim.AdamW(network.parameters(), RATE, weight_decay=1e-3)
    inputs, targets = (torch.tensor(each, dtype=torch.float32) for each in (given, told))
    for number in range(PASSES):
        for group in optimiser.param_groups:
            group["lr"] = RATE * (1.0 - number / PASSES)
        for batch in torch.randperm(len(inputs)).split(BATCH):
            optimiser.zero_grad()
            (network(inputs[batch]) - targets[batch]).square().mean().backward()
            optimiser.step()
    return network


def measured() -> dict[str, float]:
    """Return R² of each quantity of `TOLD` on rivers that were not trained on."""
    seen, other = numbers(TRAINED_ON), numbers(HELD_OUT)
    given, told = columns(seen, GIVEN), columns(seen, TOLD)
    centres, scales = (given.mean(0), told.mean(0)), (given.std(0), told.std(0))
    with torch_threads(1):
        network = fitted((given - centres[0]) / scales[0], (told - centres[1]) / scales[1])
        inputs = torch.tensor((columns(other, GIVEN) - centres[0]) / scales[0], dtype=torch.float32)
        predicted = network(inputs).detach().numpy() * scales[1] + centres[1]
    return dict(zip(TOLD, r_squared(predicted, columns(other, TOLD)), strict=True))


def main() -> None:
    """Measure, print and write the table."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    found, text = measured(), io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerows([("quantity", "r_squared"), *((name, f"{value:.4f}") for name, value in found.items())])
    write_atomic(TABLE, text.getvalue())
    print(text.getvalue(), end="")


if __name__ == "__main__":
    main()
