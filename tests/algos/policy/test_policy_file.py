"""Tests of policy files: damaged and foreign ones are refused by name."""

import gymnasium as gym
import numpy as np
import pytest
from safetensors.numpy import save_file

from tests.algos.policy.test_policy import policy_for
from thalweg.algos import AlgorithmError, Policy

SPACE = gym.spaces.Discrete(4, start=7)


def test_files_without_a_policy_are_refused(tmp_path):
    path = tmp_path / "policy.safetensors"
    with pytest.raises(AlgorithmError, match=r"there is no policy at .*: give a run's folder or a policy file"):
        Policy.load(path)
    policy_for(SPACE).save(path)
    content = path.read_bytes()
    path.write_bytes(content[:-10])
    with pytest.raises(AlgorithmError, match="not a complete policy file"):
        Policy.load(path)
    save_file({"x": np.zeros(1)}, path)
    with pytest.raises(AlgorithmError, match="of format none"):
        Policy.load(path)
    path.write_bytes(content.replace(b": [16]", b": [99]"))
    with pytest.raises(AlgorithmError, match="shapes"):
        Policy.load(path)


def test_the_format_of_a_file_is_checked_first(tmp_path):
    path = tmp_path / "policy.safetensors"
    policy_for(SPACE).save(path)
    path.write_bytes(path.read_bytes().replace(b'\\"format\\": 2', b'\\"format\\": 1'))
    with pytest.raises(AlgorithmError, match="holds a policy of format 1, this version reads 2"):
        Policy.load(path)
