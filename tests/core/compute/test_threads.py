"""Tests of the thread pool: every job runs once, errors are raised, and other threads and processes are left alone."""

import multiprocessing
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv

from thalweg.core.compute import threads
from thalweg.core.compute.kernel_compiler import config
from thalweg.core.compute.threads import get_num_threads, run_in_threads, set_num_threads, shrinking_edges
from thalweg.env import EnvConfig
from thalweg.env.env import RiverEnv
from thalweg.world import World


@pytest.mark.parametrize(("variable", "cores", "expected"), [(None, 3, 3), ("", 3, 3), (None, 100, 64), ("64", 3, 64)])
def test_a_container_limits_the_threads_unless_a_number_was_asked_for(
    variable: str | None, cores: int, expected: int, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    if variable is not None:
        monkeypatch.setenv("NUMBA_NUM_THREADS", variable)
    monkeypatch.setattr(threads, "config", SimpleNamespace(NUMBA_NUM_THREADS=64))
    monkeypatch.setattr(threads, "usable_cores", lambda: cores)
    assert threads.default_threads() == expected


def test_pytorch_too_starts_no_more_threads_than_a_container_allows():
    code = (
        "import torch; torch.set_num_threads(64)\n"
        "from thalweg.core import cores; cores.usable_cores = lambda: 3\n"
        "from thalweg.core.compute.torch_threads import default_torch_threads\n"
        "print(default_torch_threads())"
    )
    environment = {name: value for name, value in os.environ.items() if name != "OMP_NUM_THREADS"}
    found = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "3"


@pytest.fixture(params=[1, 2])
def _threads(request: pytest.FixtureRequest):
    if request.param > config.NUMBA_NUM_THREADS:
        pytest.skip("one core")
    before = get_num_threads()
    set_num_threads(request.param)
    yield
    set_num_threads(before)


def jobs_done(jobs: int, unequal: bool = False) -> list[int]:
    done: list[int] = []
    run_in_threads(jobs, lambda first, last: done.extend(range(first, last)), unequal=unequal)
    return sorted(done)


@pytest.mark.usefixtures("_threads")
@pytest.mark.parametrize("jobs", [0, 1, 2, 7, 64])
@pytest.mark.parametrize("unequal", [False, True])
def test_every_job_runs_once(jobs, unequal):
    assert jobs_done(jobs, unequal) == list(range(jobs))


def test_a_thread_that_is_done_takes_jobs_from_one_that_is_not():
    if get_num_threads() < 2:
        pytest.skip("one thread")
    others_ended = threading.Event()
    done: dict[bool, list[int]] = {True: [], False: []}

    def work(first: int, last: int) -> None:
        done[threading.current_thread() is threading.main_thread()] += range(first, last)
        if first == 0:
            assert others_ended.wait(60)
        if last == 16:
            others_ended.set()

    run_in_threads(16, work, unequal=True)
    own = shrinking_edges(16, get_num_threads())[1]
    assert own < 8
    assert done[True] == list(range(own))
    assert sorted(done[False]) == list(range(own, 16))


@pytest.mark.parametrize(("jobs", "threads"), [(1, 1), (2, 2), (3, 2), (16, 2), (17, 4), (64, 64)])
def test_shrinking_ranges_end_with_single_jobs_and_are_enough_for_all_threads(jobs, threads):
    edges = shrinking_edges(jobs, threads)
    lengths = np.diff(edges)
    assert edges[0] == 0 and edges[-1] == jobs and len(lengths) >= threads
    assert (np.diff(lengths) <= 0).all() and (lengths[-threads:] == 1).all()


def test_an_error_in_another_thread_is_raised_after_all_have_ended():
    ended = []

    def work(first: int, last: int) -> None:
        ended.append(first)
        if threading.current_thread() is not threading.main_thread():
            raise ValueError(f"job {first}")

    if get_num_threads() < 2:
        pytest.skip("one thread")
    with pytest.raises(ValueError, match="job "):
        run_in_threads(8, work)
    assert len(ended) == min(get_num_threads(), 8)


def _count(jobs: int, answers) -> None:
    answers.put(jobs_done(jobs))


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork here")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_forked_process_has_its_own_threads():
    assert jobs_done(8) == list(range(8))
    context = multiprocessing.get_context("fork")
    answers = context.Queue()
    child = context.Process(target=_count, args=(8, answers))
    child.start()
    assert answers.get(timeout=60) == list(range(8))
    child.join(timeout=60)
    assert child.exitcode == 0


@pytest.mark.parametrize("threads", [0, -1, config.NUMBA_NUM_THREADS + 1])
def test_an_impossible_number_of_threads_is_refused(threads: int):
    before = get_num_threads()
    with pytest.raises(ValueError, match=f"threads = {threads}: it must be in 1"):
        set_num_threads(threads)
    assert get_num_threads() == before


def printed_after_rendering(before: str, after: str) -> str:
    """What a process of its own prints that runs `before`, builds a world, draws frames of it, and runs `after`."""
    code = f"""
{before}
from thalweg.env import sample_starts
from thalweg.render import Camera, Renderer
from thalweg.world import build
world = build("Easy", 5)
Renderer([world], Camera(32, 32)).render(sample_starts(world, 4, 0))
{after}
"""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def test_building_and_rendering_start_no_threads_of_numba():
    """Where Numba and PyTorch share OpenMP, starting Numba's threads changes PyTorch's."""
    after = """
try:
    print(numba.threading_layer())
except ValueError as error:
    print(error)
"""
    assert printed_after_rendering("import numba", after) == "Threading layer is not initialized.\n"


def test_building_and_rendering_leave_the_threads_of_pytorch():
    before = "import torch\ntorch.set_num_threads(3)"
    assert printed_after_rendering(before, "print(torch.get_num_threads())") == "3\n"


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads are counted on Linux")
def test_collecting_starts_no_threads_but_those_of_the_pool():
    """Threads of OpenMP would wait in a loop, and take the cores that draw frames."""
    before = """
import os
os.environ.pop("OMP_NUM_THREADS", None)
import torch
from thalweg.core.compute.threads import get_num_threads
from thalweg.encoder import load_encoder
encoder = load_encoder()
torch.set_num_threads(3)
before = len(os.listdir("/proc/self/task"))
"""
    after = """
from thalweg.env import RiverVectorEnv
from thalweg.train.latent import LatentVectorEnv
env = LatentVectorEnv(RiverVectorEnv([world], 16), encoder)
env.reset(seed=0)
for _ in range(2):
    env.step(env.action_space.sample())
world.relit(1.0, 0.6)
print(len(os.listdir("/proc/self/task")) - before, get_num_threads(), torch.get_num_threads())
"""
    started, pool, threads = map(int, printed_after_rendering(before, after).split())
    # The pool starts threads as it needs them: fewer where others, or the calling thread, take a share of every task.
    assert started <= pool and threads == 3


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork here")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_forked_worker_draws_the_same_frames(easy_world: World):
    """`AsyncVectorEnv` forks by default on Linux before Python 3.14; here its parent has already drawn."""
    config = EnvConfig()
    single = RiverEnv(easy_world, config)
    expected, _ = single.reset(seed=3)
    workers = AsyncVectorEnv([lambda: RiverEnv(easy_world, config)] * 2, context="fork")
    try:
        observation, _ = workers.reset(seed=[3, 4])
    finally:
        workers.close()
    assert expected.std() > 1.0
    np.testing.assert_array_equal(observation[0], expected)


@pytest.mark.slow
@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork here")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_forked_workers_of_a_registered_id_step_as_the_environment_does_here():
    single = gymnasium.make("thalweg/Easy-v0")
    first, _ = single.reset(seed=3)
    action = np.array([1, 2, 2, 1])
    second, reward, *_ = single.step(action)
    workers: Any = gymnasium.make_vec(
        "thalweg/Easy-v0", num_envs=2, vectorization_mode="async", vector_kwargs={"context": "fork"}
    )
    try:
        reset, _ = workers.reset(seed=[3, 4])
        stepped, rewards, *_ = workers.step(np.stack([action, action]))
    finally:
        workers.close()
    assert (first != second).any()
    np.testing.assert_array_equal(reset[0], first)
    np.testing.assert_array_equal(stepped[0], second)
    assert rewards[0] == reward


def test_an_error_of_the_calling_thread_is_raised_after_the_others_have_ended():
    if get_num_threads() < 2:
        pytest.skip("one thread")
    started, ended = threading.Event(), []

    def work(first: int, last: int) -> None:
        if first == 0:
            assert started.wait(60)
            raise ValueError("job 0")
        started.set()
        time.sleep(0.2)
        ended.append(first)

    with pytest.raises(ValueError, match="job 0"):
        run_in_threads(2, work)
    assert ended == [1]
