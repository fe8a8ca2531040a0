"""Tests of errors in the words of the command line."""

from pathlib import Path

import pytest

from thalweg.cli.encoder import EncoderTrain
from thalweg.cli.evaluate import Evaluate
from thalweg.cli.film import Film
from thalweg.cli.fly import Fly
from thalweg.cli.imitate import Imitate
from thalweg.cli.options import RiverFile
from thalweg.cli.train import Train
from thalweg.cli.wording import in_options
from thalweg.cli.world import DrawWorld

TRAIN = Train(Path("x"))


@pytest.mark.parametrize(
    ("command", "message", "told"),
    [
        (TRAIN, "num_envs must be at least 1, not 0", "--num-envs must be at least 1, not 0; such as --num-envs 16"),
        (TRAIN, "seed must not be negative, got -1", "--seed must not be negative, got -1; such as --seed 0"),
        (TRAIN, "give as many environments, or rivers=episode", "give as many environments, or --rivers episode"),
        (TRAIN, "it sees images: set policy=cnn", "it sees images: --set policy=cnn"),
        (TRAIN, "give begin_with, or leave it out", "give --begin-with, or leave it out"),
        (TRAIN, "--set passes=0: passes must be at least 1", "--set passes=0: passes must be at least 1"),
        (TRAIN, "the seed is odd, and steps_per_update must be 2", "the seed is odd, and steps_per_update must be 2"),
        (TRAIN, "/a/num_envs.yaml cannot be read", "/a/num_envs.yaml cannot be read"),
        (
            DrawWorld(river=RiverFile(Path("a.geojson"))),
            "length_m is 3 m; expected 15 to 10400 m",
            "--length-m is 3 m; expected 15 to 10400 m; such as --length-m 300",
        ),
        (
            DrawWorld(river=RiverFile(Path("a.geojson"))),
            "no width: give the line the property width_m, in metres, or pass width_m",
            "no width: give the line the property width_m, in metres, or pass --width-m",
        ),
        (Film(), "look must be random", "--look must be random; such as --look 'as trained'"),
        (Fly(), "size_px must be 32 or more, got 1", "--size must be 32 or more, got 1; such as --size 384"),
        (
            DrawWorld(river=RiverFile(Path("a.geojson"))),
            "its crs is odd: name the system by crs=EPSG:32632",
            "its crs is odd: name the system by --crs EPSG:32632",
        ),
        (
            Imitate(),
            "in_memory must be at least 96 for 192 rivers, not 1",
            "--rivers-in-memory must be at least 96 for 192 rivers, not 1",
        ),
        (
            Imitate(),
            "in_memory must be at least 6, not 1",
            "--rivers-in-memory must be at least 6, not 1; such as --rivers-in-memory 8",
        ),
        (Imitate(), "num_envs must be at most 9, not 32", "--num-envs must be at most 9, not 32"),
        (Evaluate("hover"), "in_memory must be at least 96", "in_memory must be at least 96"),
        (Evaluate("hover"), "policy is none", "policy is none"),
        (EncoderTrain(Path("x")), "latent must be 1 or more", "--latent must be 1 or more; such as --latent 16"),
    ],
)
def test_arguments_become_options_with_a_value_to_try(command, message: str, told: str):
    assert in_options(message, command) == told
