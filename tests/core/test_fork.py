"""Tests of processes that were forked after kernels had run on several threads."""

import subprocess
import sys

import pytest

CODE = """
import multiprocessing, sys
import numba, numpy as np
import thalweg
if {early}:
    import thalweg.env
from tests.env.handmade import BlankRenderer, ring

@numba.njit(parallel=True)
def total(values):
    result = 0.0
    for row in numba.prange(len(values)):
        result += values[row]
    return result

class Drawing(BlankRenderer):
    def render(self, *given):
        total(np.ones(4))
        return super().render(*given)

def child(pipe):
    from thalweg.env import EnvConfig, RiverVectorEnv
    env = RiverVectorEnv(ring(), 1, EnvConfig(observation="{observation}"), renderer=Drawing())
    try:
        env.reset(seed=0)
        pipe.send("drawn")
    except RuntimeError as error:
        pipe.send(str(error))

if {kernels}:
    total(np.ones(4))
    if numba.threading_layer() != "omp":
        print("no OpenMP")
        sys.exit()
context = multiprocessing.get_context("fork")
ours, theirs = context.Pipe()
process = context.Process(target=child, args=(theirs,))
process.start()
process.join()
print(ours.recv() if ours.poll() else "died", process.exitcode)
"""


def forked(*, kernels: bool, observation: str = "rgb", early: bool = True) -> str:
    """Return the outcome of a reset in a forked process; `kernels`: whether kernels had run in its parent."""
    if not sys.platform.startswith("linux"):
        pytest.skip("processes are forked on Linux only")
    code = CODE.format(kernels=kernels, observation=observation, early=early)
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    if "no OpenMP" in found.stdout:
        pytest.skip("Numba's threads are not those of OpenMP here: forking them is safe")
    return found.stdout.strip()


@pytest.mark.parametrize("early", [True, False])
@pytest.mark.slow
def test_rendering_after_a_fork_raises_with_the_alternatives(early: bool):
    """Without the check, GNU OpenMP would kill the process."""
    found = forked(kernels=True, early=early)
    assert "make_vec" in found
    assert 'AsyncVectorEnv(..., context="spawn")' in found


def test_a_fork_before_any_kernel_can_render():
    assert forked(kernels=False) == "drawn 0"


def test_a_fork_that_does_not_render_can_run():
    assert forked(kernels=True, observation="none") == "drawn 0"
