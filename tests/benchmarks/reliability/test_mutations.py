"""Tests of the mutations of files: the same seed gives the same file, and headers lie as they should."""

import io
import json
import struct
from collections.abc import Callable
from itertools import pairwise
from random import Random
from types import ModuleType

import numpy as np
import pytest
import yaml

TREE = {"type": "a", "numbers": [1, 2.5, -3], "nested": {"flag": True, "none": None}}
TENSORS = {"__metadata__": {"about": '{"size": 3}'}, "weight": {"dtype": "F32", "shape": [2], "data_offsets": [0, 8]}}


def tensor_file() -> bytes:
    header = json.dumps(TENSORS).encode()
    return struct.pack("<Q", len(header)) + header + struct.pack("<2f", 1.0, 2.0)


def archive() -> bytes:
    written = io.BytesIO()
    np.savez(written, about=np.array(json.dumps(TREE)), values=np.arange(6.0))
    return written.getvalue()


CONTENTS = {
    "mutated_bytes": b"some text of a file, long enough to be cut",
    "mutated_json": json.dumps(TREE).encode(),
    "mutated_xml": b'<gpx version="1.1"><trkpt lat="45" lon="7.5"><ele>9.5</ele></trkpt><name>Elde</name></gpx>',
    "mutated_table": b"a,b,c\n1,2,3\n4,5,6\n",
    "mutated_yaml": b"run: {algorithm: PPO, seeds: [1, 2]}\nsteps: 5\n",
    "mutated_lines": b"import a\n\n\ndef f(x):\n    return x\n",
    "mutated_safetensors": tensor_file(),
    "mutated_npz": archive(),
}


@pytest.mark.parametrize("name", CONTENTS)
def test_the_same_seed_gives_the_same_file_and_most_differ(name: str, script: Callable[[str], ModuleType]):
    mutate = getattr(script("mutations"), name)
    files = [mutate(CONTENTS[name], Random(seed)) for seed in range(60)]
    assert files == [mutate(CONTENTS[name], Random(seed)) for seed in range(60)]
    assert len(set(files)) > 30
    assert sum(file != CONTENTS[name] for file in files) > 50


def test_a_mutated_tree_leaves_the_original_alone(script: Callable[[str], ModuleType]):
    mutated_tree, before = script("mutations").mutated_tree, json.dumps(TREE)
    for seed in range(200):
        mutated_tree(TREE, Random(seed), deep=False)
    assert json.dumps(TREE) == before


def test_a_deep_tree_is_written_although_json_cannot(script: Callable[[str], ModuleType]):
    mutations = script("mutations")
    text = mutations.dumped(mutations.nested(20_000))
    with pytest.raises(RecursionError):
        json.loads(text)


def test_a_tree_of_aliases_that_multiply_is_not_written_out(script: Callable[[str], ModuleType]):
    class Late(Random):
        """Chooses the mutation of a tree."""

        def random(self) -> float:
            return 0.9

    mutated_yaml = script("mutations").mutated_yaml
    assert mutated_yaml(b"a: [1, 2]\nb: 3\n", Late(0))
    letters = "abcdefgh"
    laughs = [f"{letter}: &{letter} [{', '.join([f'*{last}'] * 9)}]" for last, letter in pairwise(letters)]
    with pytest.raises(yaml.YAMLError, match="more than 1,000,000 values"):
        mutated_yaml("\n".join(["a: &a [x, x]", *laughs]).encode(), Late(0))
