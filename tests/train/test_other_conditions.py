"""Runs that resume under other conditions than they began with, on which the last bits depend."""

import warnings
from pathlib import Path

import pytest
import yaml

from tests.train.small_runs import Stop, StopsAt, train
from thalweg.algos.policy import fast_path
from thalweg.train import ResumeWarning


@pytest.fixture
def begun(tmp_path: Path) -> Path:
    """Folder of a run that was interrupted."""
    with pytest.raises(Stop):
        train(tmp_path, env=StopsAt(130))
    return tmp_path


def test_a_run_that_resumes_without_the_fast_path_is_warned_of(begun: Path):
    with fast_path.switched(False), pytest.warns(ResumeWarning, match=r"'fast path': True.* with .*'fast path': False"):
        train(begun)


def test_a_run_from_before_the_fast_path_was_recorded_resumes_without_a_warning(begun: Path):
    config = yaml.safe_load((begun / "config.yaml").read_text())
    del config["machine"]["fast_path"]
    (begun / "config.yaml").write_text(yaml.safe_dump(config))
    with warnings.catch_warnings():
        warnings.simplefilter("error", ResumeWarning)
        assert train(begun).resumed_from == 512


@pytest.mark.parametrize(
    ("place", "changes", "words"),
    [
        ("machine", {"learning_threads": 7}, r"'threads': 7.* resumes with .*'threads': 1"),
        ("versions", {"numpy": "0.1"}, r"'numpy': '0\.1'.* resumes with"),
    ],
)
def test_a_run_that_resumes_with_other_threads_or_packages_is_warned_of(
    place: str, changes: dict, words: str, begun: Path
):
    config = yaml.safe_load((begun / "config.yaml").read_text())
    config[place] |= changes
    (begun / "config.yaml").write_text(yaml.safe_dump(config))
    with pytest.warns(ResumeWarning, match=words):
        assert train(begun).resumed_from == 512
