"""Tests of the thread pool: every job runs once, errors are raised, and a forked process has its own threads."""

import multiprocessing
import threading

import numba
import pytest

from thalweg.core.jit import config
from thalweg.core.threads import run_in_threads


@pytest.fixture(params=[1, 2])
def _threads(request: pytest.FixtureRequest):
    if request.param > config.NUMBA_NUM_THREADS:
        pytest.skip("one core")
    before = numba.get_num_threads()
    numba.set_num_threads(request.param)
    yield
    numba.set_num_threads(before)


def jobs_done(jobs: int) -> list[int]:
    done: list[int] = []
    run_in_threads(jobs, lambda first, last: done.extend(range(first, last)))
    return sorted(done)


@pytest.mark.usefixtures("_threads")
@pytest.mark.parametrize("jobs", [0, 1, 2, 7, 64])
def test_every_job_runs_once(jobs):
    assert jobs_done(jobs) == list(range(jobs))


def test_an_error_in_another_thread_is_raised_after_all_have_ended():
    ended = []

    def work(first: int, last: int) -> None:
        ended.append(first)
        if threading.current_thread() is not threading.main_thread():
            raise ValueError(f"job {first}")

    if numba.get_num_threads() < 2:
        pytest.skip("one thread")
    with pytest.raises(ValueError, match="job "):
        run_in_threads(8, work)
    assert len(ended) == min(numba.get_num_threads(), 8)


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
