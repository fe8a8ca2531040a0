"""Tests of policy files: damaged and foreign ones are refused by name."""

import json

import gymnasium as gym
import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

from tests.algos.policy.test_policy import policy_for
from thalweg.algos import AlgorithmError, Policy
from thalweg.algos.policy.policy_file import HEADER

SPACE = gym.spaces.Discrete(4, start=7)


def test_files_without_a_policy_are_refused(tmp_path):
    path = tmp_path / "policy.safetensors"
    with pytest.raises(AlgorithmError, match=r"there is no policy at .*: give a run's folder or a policy file"):
        Policy.load(path)
    policy_for(SPACE).save(path)
    content = path.read_bytes()
    path.write_bytes(content[:-10])
    with pytest.raises(
        AlgorithmError, match=r"is no policy file, such as policy\.safetensors in .*, or a damaged one: "
    ):
        Policy.load(path)
    save_file({"x": np.zeros(1)}, path)
    with pytest.raises(AlgorithmError, match="of format none"):
        Policy.load(path)
    path.write_bytes(content.replace(b": [16]", b": [99]"))
    with pytest.raises(AlgorithmError, match="shapes of 891 weights"):
        Policy.load(path)


def test_the_format_of_a_file_is_checked_first(tmp_path):
    path = tmp_path / "policy.safetensors"
    policy_for(SPACE).save(path)
    path.write_bytes(path.read_bytes().replace(b'\\"format\\": 2', b'\\"format\\": 1'))
    with pytest.raises(AlgorithmError, match="holds a policy of format 1, this version reads 2"):
        Policy.load(path)


def rewritten(path, tensors=None, **header):
    """The same file with other tensors or another header."""
    with safe_open(path, framework="numpy") as file:
        old = json.loads(file.metadata()[HEADER])
    write = load_file(path) | (tensors or {})
    save_file(write, path, {HEADER: json.dumps(old | header)})


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ({"obs_size": 10**12}, "shapes of .* weights, but there are"),
        ({"obs_size": 10**40}, "shapes of .* weights, but there are"),
        ({"obs_size": "5"}, "obs_size must be a whole number of at least 1, got '5'"),
        ({"frames": 0}, "frames must be a whole number of at least 1, got 0"),
        ({"shape": {"hidden": [10**9, 10**9]}}, "shapes of .* weights, but there are"),
        ({"shape": {"hidden": ["16"]}}, "whole numbers of at least 1 are needed"),
        ({"shape": {"hidden": [16], "memory": 10**9}}, "shapes of .* weights, but there are"),
        ({"shape": {"hidden": [16], "memory": -1}}, "memory must be a whole number, got -1"),
        ({"shape": 3}, "do not match its header"),
        ({"temperature": 0}, "temperature must be a number above 0, got 0"),
        ({"temperature": float("nan")}, "temperature must be a number above 0, got nan"),
        ({"normaliser": {"count": -1, "enabled": True}}, "count must be at least 0, got -1"),
        ({"actions": {}}, "do not match its header"),
        ({"kind": ["network"]}, r"kind \['network'\]: a name is needed"),
        ({"config": 3}, "do not match its header: config is 3"),
        ({"algorithm": None}, "do not match its header: algorithm is None"),
    ],
)
def test_a_header_that_does_not_fit_is_refused_by_name(header, words, tmp_path):
    path = tmp_path / "policy.safetensors"
    policy_for(SPACE).save(path)
    rewritten(path, **header)
    with pytest.raises(AlgorithmError, match=words) as raised:
        Policy.load(path)
    assert str(path) in str(raised.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"kind": "telepathy"}, "'telepathy' with the adapter 'native', which this version does not know"),
        ({"adapter": "none"}, "the adapter 'none', which this version does not know"),
        ({"dtype": "<U8"}, "type <U8, which is no number"),
        ({"sizes": [0]}, "1 branches of options"),
        ({"start": []}, "1 branches of options, 0 of them with a first one"),
        ({"start": [2**63]}, "a first option beyond ±2,147,483,648"),
        ({"sizes": [], "start": []}, r"the shape \(\) and 0 numbers"),
        ({"shape": [2]}, r"the shape \(2,\) and 1 numbers"),
        ({"low": [1.0], "high": [0.0]}, "bounds that do not fit together"),
    ],
)
def test_actions_that_do_not_fit_together_are_refused(change, words, tmp_path):
    path = tmp_path / "policy.safetensors"
    policy = policy_for(SPACE)
    policy.save(path)
    rewritten(path, actions=policy.actions.as_data() | change)
    with pytest.raises(AlgorithmError, match=f"the actions of a policy .*{words}"):
        Policy.load(path)


def test_numbers_that_are_not_finite_are_refused(tmp_path):
    path = tmp_path / "policy.safetensors"
    policy_for(SPACE).save(path)
    rewritten(path, {"normaliser.mean": np.full(5, np.nan)})
    with pytest.raises(AlgorithmError, match=rf"{path}: the tensor normaliser\.mean holds numbers that are not finite"):
        Policy.load(path)
    policy_for(SPACE).save(path)
    rewritten(path, {"normaliser.square": np.full(5, -1.0)})
    with pytest.raises(AlgorithmError, match="squares must be 5 numbers of at least 0"):
        Policy.load(path)
