"""Flies environments of tensors by the kernel of a GPU and stores what happens: `python -m tests.cuda.simulate_rules
FILE CASE`, where a case is a task, "wind", "boats" or "boats in wind"."""

import sys

import numpy as np

from tests.cuda import cases, simulated
from thalweg.core.compute import gpu
from thalweg.env import torch_env as tensors
from thalweg.env.device import cuda_step as rules
from thalweg.env.device import observer

THREADS = 2


def main(path: str, case: str) -> None:
    simulated.begin()
    blocks = -(-cases.FLIGHTS // THREADS) + 1  # the last one has nothing to do
    boats = case.startswith("boats")
    advance, pushed = (
        (rules.advance_boats, rules.advance_pushed_boats) if boats else (rules.advance, rules.advance_pushed)
    )
    tensors.advance_all = lambda *given: gpu.launch(advance, blocks, THREADS, simulated.DEVICE, *given)
    tensors.advance_pushed_all = lambda *given: gpu.launch(pushed, blocks, THREADS, simulated.DEVICE, *given)
    tensors.write_winds = lambda *given: gpu.launch(rules.write_winds, blocks, THREADS, simulated.DEVICE, *given)
    observer.see_all = lambda *given: gpu.launch(rules.see, blocks, THREADS, simulated.DEVICE, *given)
    observer.see_boats = lambda *given: gpu.launch(rules.see_boats, blocks, THREADS, simulated.DEVICE, *given)
    observer.see_all_in_task = lambda *given: gpu.launch(rules.see_in_task, blocks, THREADS, simulated.DEVICE, *given)
    observer.feel_all = lambda *given: gpu.launch(rules.feel, blocks, THREADS, simulated.DEVICE, *given)
    if boats:
        found = cases.flown_by_boats(case == "boats in wind")
    else:
        found = cases.flown_in_wind() if case == "wind" else cases.flown(case)
    np.savez(path, **found)


if __name__ == "__main__":
    main(*sys.argv[1:])
