"""Tests of recorded data sets against LeRobot itself, which reads them by its own `LeRobotDataset`."""

import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from thalweg.cli.main import main
from thalweg.datasets.episode import RecordedEpisode
from thalweg.datasets.recordings import read_recordings

pytest.importorskip("lerobot", reason="LeRobot is not installed: make test-interop")

import torch

CACHE = tempfile.TemporaryDirectory()
os.environ |= {"HF_HUB_OFFLINE": "1", "HF_HOME": CACHE.name}

if torch.version.cuda is None:
    # torchvision is built for a PyTorch with CUDA. Beside one without, its own library does not load, and its import
    # fails for want of an operator of it, of which LeRobot uses none.
    OPERATORS = torch.library.Library("torchvision", "DEF")
    OPERATORS.define("nms(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")

from lerobot.datasets.lerobot_dataset import LeRobotDataset  # noqa: E402  # pyright: ignore[reportMissingImports]

CAMERA = "observation.images.camera"
FLOWN = ("--level", "easy", "--episodes", "2", "--seed", "3", "--steps", "6", "--size", "64")


def recorded(folder: Path, *options: str) -> Path:
    assert main(["record", "steady", *FLOWN, *options, "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def lossless(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("lerobot") / "steady")


@pytest.fixture(scope="module")
def flights(lossless: Path) -> list[RecordedEpisode]:
    return list(read_recordings(lossless)[1])


def pixels(image: torch.Tensor) -> np.ndarray:
    """LeRobot's image, float [C, H, W] in 0..1, as [H, W, C] uint8."""
    return np.asarray((image * 255).round().to(torch.uint8).permute(1, 2, 0))


def test_frames_states_actions_and_lengths_are_those_that_were_recorded(lossless: Path, flights: list[RecordedEpisode]):
    data = LeRobotDataset("thalweg/steady", root=lossless)
    assert (data.fps, data.num_episodes, len(data)) == (4, 2, sum(flight.steps for flight in flights))
    index = 0
    for number, flight in enumerate(flights):
        assert data.meta.episodes[number]["length"] == flight.steps
        for step in range(flight.steps):
            row = data[index]
            index += 1
            place = f"flight {number}, step {step}"
            assert (int(row["episode_index"]), int(row["frame_index"])) == (number, step)
            assert float(row["timestamp"]) == step / 4
            assert flight.mask is not None and flight.class_id is not None and flight.options is not None
            np.testing.assert_array_equal(pixels(row[CAMERA]), flight.rgb[step], err_msg=place)
            np.testing.assert_array_equal(pixels(row["mask"])[..., 0], flight.mask[step], err_msg=place)
            np.testing.assert_array_equal(pixels(row["class"])[..., 0], flight.class_id[step], err_msg=place)
            numbers = {
                "depth": flight.depth_m,
                "observation.state": flight.proprioception,
                "action": flight.moves,
                "option": flight.options,
                "next.reward": flight.rewards,
                "next.cost": flight.costs,
                "pose": flight.poses,
            }
            for name, wanted in numbers.items():
                assert wanted is not None
                found = np.asarray(row[name])
                np.testing.assert_array_equal(found, wanted[step].astype(found.dtype), err_msg=f"{place}: {name}")
            assert bool(row["next.done"]) == (step == flight.steps - 1)
            assert row["pilot"] == "steady" and row["task"].startswith("Follow the river")


def test_a_sequence_of_actions_ends_at_the_end_of_its_flight(lossless: Path, flights: list[RecordedEpisode]):
    data = LeRobotDataset("thalweg/steady", root=lossless, delta_timestamps={"action": [0.0, 0.25, 0.5]})
    first = flights[0]
    np.testing.assert_array_equal(data[1]["action"], first.moves[1:4])
    last = data[first.steps - 1]
    assert last["action_is_pad"].tolist() == [False, True, True]
    np.testing.assert_array_equal(last["action"], first.moves[[-1, -1, -1]])


def test_its_statistics_normalise_a_batch(lossless: Path, flights: list[RecordedEpisode]):
    data = LeRobotDataset("thalweg/steady", root=lossless)
    rows: Any = torch.utils.data.DataLoader(data, batch_size=len(data))
    batch, stats = next(iter(rows)), data.meta.stats["observation.state"]
    states = np.concatenate([flight.proprioception[:-1] for flight in flights])
    np.testing.assert_array_equal(batch["observation.state"], states)
    np.testing.assert_allclose(stats["mean"], states.mean(axis=0), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(stats["std"], states.std(axis=0), rtol=1e-4, atol=1e-6)


def test_its_decoder_finds_the_frames_of_a_video(tmp_path: Path, flights: list[RecordedEpisode]):
    data = LeRobotDataset("thalweg/filmed", root=recorded(tmp_path / "filmed", "--video"), video_backend="pyav")
    found = np.stack([pixels(data[index][CAMERA]) for index in range(len(data))]).astype(np.float64)
    wanted = np.concatenate([flight.rgb[:-1] for flight in flights]).astype(np.float64)
    errors = np.abs(found[:, None] - wanted[None]).mean(axis=(2, 3, 4))
    assert errors.argmin(axis=1).tolist() == list(range(len(wanted))), "each frame is the one of its own time"
    assert np.diagonal(errors).max() < 6.0  # of 255, by H.264
