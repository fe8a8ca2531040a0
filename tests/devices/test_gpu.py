"""Tests on a real GPU, skipped without one; the end of the test run reports the skip."""

import csv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
import torch

from benchmarks import gpu
from thalweg.algos.interface import Task
from thalweg.algos.registry import algorithm_named
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label, encoded_frames, evaluate
from thalweg.core.compute import gpu as compute_gpu
from thalweg.encoder import load_encoder
from thalweg.env.config import ConfigError, EnvConfig
from thalweg.env.initial_poses import sample_starts
from thalweg.env.physics.wind import Wind
from thalweg.env.torch_env import TensorRiverEnv
from thalweg.env.vector_env import RiverVectorEnv
from thalweg.render import Renderer
from thalweg.render.records.classes import BUOY, KAYAK, SWIMMER
from thalweg.render.records.randomisation import Randomisation
from thalweg.render.slot_renderer import SlotRenderer
from thalweg.train import LatentTensorEnv, load_policy, run
from thalweg.train.encoder.geometry import GeometryTraining, geometry_config
from thalweg.train.imitation.imitate import Imitation
from thalweg.train.imitation.trainer import ImitationTrainer
from thalweg.train.rollouts.tensor_collector import TensorCollector
from thalweg.train.trainer import Trainer
from thalweg.world import World, load_or_build

pytestmark = pytest.mark.gpu
SMALL = {
    "FOCOPS": {"steps_per_update": 512},
    "SACLag": {"random_steps": 128, "steps_per_update": 256},
    "SafeLOOP": {"random_steps": 128, "steps_per_update": 256, "steps_per_collection": 64, "model_steps": 4},
}
"""Steps of 16 environments."""


@pytest.fixture
def card() -> torch.device:
    return torch.device("cuda:0")


@contextmanager
def no_waiting() -> Iterator[None]:
    """Whatever would make the host wait for the device raises an error, copies to the host above all."""
    torch.cuda.set_sync_debug_mode("error")
    try:
        yield
    finally:
        torch.cuda.set_sync_debug_mode("default")


def flown(world: World, card: torch.device, num_envs: int = 16) -> Any:
    return LatentTensorEnv(TensorRiverEnv([world], num_envs, device=str(card)), load_encoder(device=str(card)))


def test_frames_masks_and_codes_equal_those_of_the_cpu(easy_world: World, medium_world: World, card: torch.device):
    table = gpu.Table("")
    gpu.check_frames(table, [easy_world, medium_world], 64, card)
    assert [row for row in table.rows if row["holds"] != "yes"] == []


@pytest.mark.parametrize(("task", "objects"), [("Swimmers", {SWIMMER, KAYAK}), ("Nests", {BUOY})])
@pytest.mark.parametrize("quality", ["full", "fast"])
def test_frames_of_tasks_banks_and_wind_equal_those_of_the_cpu(
    quality: Any, task: str, objects: set[int], card: torch.device
):
    worlds = [load_or_build(f"Easy+{banks}", 0) for banks in ("quay", "reeds", "meadow")]
    wind = Wind((4.0, 8.0))
    seen_parts: Any = ("rgb", "mask", "depth", "class")
    config = EnvConfig(task=task, observation=seen_parts, quality=quality, wind=wind, randomisation=Randomisation())
    sides = [RiverVectorEnv(worlds, 48, config, device=device) for device in ("cpu", str(card))]
    seen = [side.reset(seed=0)[0] for side in sides]
    shown = set[int]()
    for _ in range(8):  # launched, recorded and replayed
        here, there = seen
        apart = np.abs(here["rgb"].astype(int) - there["rgb"].astype(int)).max(-1)
        assert np.mean(apart <= gpu.WITHIN) >= gpu.SHARE
        assert np.mean(here["mask"] == there["mask"]) >= gpu.SHARE
        assert np.mean(here["class"] == there["class"]) >= gpu.SHARE
        assert np.mean(np.abs(here["depth"] - there["depth"]) <= 1e-3 * np.abs(here["depth"])) >= gpu.SHARE
        shown |= set(np.unique(here["class"]).tolist())
        seen = [side.step(np.ones((48, 4), np.int64))[0] for side in sides]
    assert objects <= shown


def test_all_but_ten_of_a_million_random_steps_equal_those_of_the_cpu(
    easy_world: World, medium_world: World, card: torch.device
):
    table = gpu.Table("")
    gpu.check_rules(table, [easy_world, medium_world], 4096, 245, card)
    assert [row for row in table.rows if row["holds"] != "yes"] == []


@pytest.mark.parametrize(
    "forces", [{}, {"action": "continuous", "dynamics": "inertial", "wind": Wind()}], ids=["calm", "wind"]
)
def test_steps_of_boats_equal_those_of_the_cpu(forces: dict[str, Any], easy_world: World, card: torch.device):
    table = gpu.Table("")
    gpu.check_rules(table, [easy_world], 1024, 100, card, vehicle="asv", **forces)
    assert [row for row in table.rows if row["holds"] != "yes"] == []


def test_boats_see_what_those_of_the_cpu_see(easy_world: World, card: torch.device):
    config = EnvConfig(observation="privileged", vehicle="asv")
    sides = [TensorRiverEnv([easy_world], 256, config, device=side) for side in ("cpu", str(card))]
    here, there = (side.reset(seed=0)[0].cpu().numpy() for side in sides)
    np.testing.assert_allclose(there, here, rtol=0, atol=1e-4)


@pytest.mark.parametrize("quality", ["full", "fast"])
@pytest.mark.parametrize("channels", [4, 1])
def test_replayed_frames_equal_those_that_are_launched(
    quality: Any, channels: int, easy_world: World, medium_world: World, card: torch.device
):
    worlds, camera = [easy_world, medium_world], EnvConfig().camera
    renderer, launched = (Renderer(worlds, quality=quality, device=str(card)) for _ in range(2))
    buffers = torch.zeros(2, 16, camera.height_px, camera.width_px, channels, dtype=torch.uint8, device=card)
    # Each buffer is launched, recorded, and replayed twice. Then a larger batch moves the memory that was recorded.
    draws = [(0, 4), (1, 4)] * 4 + [(0, 16), (1, 4)]
    expected = [torch.zeros_like(buffers[0, :count]) for _, count in draws]
    for seed, (buffer, count) in enumerate(draws):
        views, out = gpu.views(worlds, count, renderer, card, seed), buffers[buffer, :count]
        with mock.patch.object(compute_gpu, "launch", wraps=compute_gpu.launch) as launch:
            renderer.render_tensors(views, out)
        assert (launch.call_count == 0) == (4 <= seed < 8)
        launched.render_tensors(views, expected[seed])
        assert torch.equal(out, expected[seed])


@pytest.mark.parametrize("observation", [("rgb", "mask", "depth", "class"), ("depth",), ("mask", "class")])
def test_layers_of_observations_are_those_of_the_renderer(
    observation: Any, easy_world: World, medium_world: World, card: torch.device
):
    worlds = [easy_world, medium_world]
    env = TensorRiverEnv(worlds, 16, EnvConfig(observation=observation), device=str(card))
    obs, info = env.reset(seed=1)
    renderer = Renderer(worlds, device=str(card))
    for step in range(5):  # launched, recorded and replayed
        clock = env.get_state()["time_s"]
        drawn = renderer.render_layers(info["pose"].cpu().numpy(), env.world_index, clock)
        wanted = {"rgb": drawn.rgb, "mask": drawn.mask[..., None] * np.uint8(255)}
        wanted |= {"depth": drawn.depth_m[..., None], "class": drawn.class_id[..., None]}
        for part in observation:
            np.testing.assert_array_equal(obs[part].cpu().numpy(), wanted[part], err_msg=f"{part} of step {step}")
        obs, *_, info = env.step(torch.ones(16, 4, dtype=torch.int64, device=card))


@pytest.mark.parametrize("name", SMALL)
def test_a_step_never_waits_for_the_device(name: str, easy_world: World, card: torch.device):
    env, entry = flown(easy_world, card), algorithm_named(name)
    collector = TensorCollector(env, 1, 1)
    task = Task(collector.obs_size, env.single_action_space, env.num_envs, 0, {}, card)
    trainer = Trainer(collector, entry.make(entry.configure(SMALL[name]), task), 10_000, seed=0, threads=1)
    trainer.start()
    for _ in range(2):  # learns once, for what is compiled or allocated the first time
        gpu.update(trainer)
    with no_waiting():
        trainer.step()


def test_recorded_gradient_steps_equal_individual_ones(easy_world: World, card: torch.device, tmp_path: Path):
    """SACLag on choices draws nothing within a step."""
    config = {"random_steps": 128, "steps_per_update": 256, "updates_per_step": 0.5}
    for graphs in (False, True):
        same = {"steps": 2048, "seed": 1, "config": config, "device": "cuda", "graphs": graphs}
        run("SACLag", flown(easy_world, card), folder=tmp_path / str(graphs), **same)
    plain, recorded = (
        np.array([float(row["q_loss"]) for row in csv.DictReader((tmp_path / str(graphs) / "metrics.csv").open())])
        for graphs in (False, True)
    )
    np.testing.assert_allclose(recorded, plain, rtol=1e-3)


@pytest.mark.parametrize("name", SMALL)
def test_an_interrupted_run_ends_like_an_uninterrupted_one(
    name: str, easy_world: World, card: torch.device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    same = {"steps": 1024, "seed": 1, "config": SMALL[name], "device": "cuda", "checkpoint_seconds": 0.0}
    run(name, flown(easy_world, card), folder=tmp_path / "whole", **same)
    update, done = Trainer.update, []

    def cut_off(trainer: Trainer) -> dict[str, float]:
        done.append(update(trainer))
        if trainer.statistics.steps >= 600:
            raise KeyboardInterrupt
        return done[-1]

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(Trainer, "update", cut_off)
        run(name, flown(easy_world, card), folder=tmp_path / "cut", **same)
    run(name, flown(easy_world, card), folder=tmp_path / "cut", **same)
    whole, cut = ((tmp_path / folder / "policy.safetensors").read_bytes() for folder in ("whole", "cut"))
    assert whole == cut


def test_a_policy_acts_the_same_on_gpu_and_cpu(easy_world: World, card: torch.device, tmp_path: Path):
    run("PPO", flown(easy_world, card, 64), steps=20_000, seed=0, folder=tmp_path, device="cuda")
    config = EvaluationConfig(episodes=20)
    course, label, returns = Course.on(easy_world, config), Label("PPO", 0, "Easy"), []
    for place in ("cpu", str(card)):
        observe = encoded_frames(easy_world, load_encoder(device=place))
        flights = evaluate(load_policy(tmp_path), course, label, config, observe=observe)
        returns.append(np.array([flight.return_ for flight in flights]))
    here, there = returns
    apart = float(np.mean(here - there))
    interval = 1.96 * float(np.std(here - there, ddof=1)) / len(here) ** 0.5
    assert abs(apart) <= max(interval, 1e-9), f"{here.mean():.2f} on the CPU, {there.mean():.2f} on the GPU"


@pytest.mark.parametrize("quality", ["full", "fast"])
def test_frames_of_replaced_worlds_are_those_of_worlds_that_stay(
    quality: Any, easy_world: World, medium_world: World, card: torch.device
):
    worlds = [easy_world, medium_world]
    fixed, slots = Renderer(worlds, quality=quality, device=str(card)), SlotRenderer(None, quality, device=str(card))
    slots.reserve(2)
    held = [0, 0]
    for round_, (slot, world) in enumerate([(0, 0), (1, 1), (1, 0), (0, 1)]):
        slots.put(slot, slots.bake(worlds[world]))
        held[slot] = world
        for count in (3, 40) * 3:  # launched, recorded and replayed
            here = np.arange(count) % (1 + (round_ > 0))
            there = np.array(held)[here]
            poses = np.stack([sample_starts(worlds[index], 1, at)[0] for at, index in enumerate(there)])
            drawn, expected = slots.render(poses, here), fixed.render(poses, there)
            np.testing.assert_array_equal(drawn, expected)
            np.testing.assert_array_equal(slots.render_mask(poses, here), expected[..., 3])


IMITATION = {
    "sequence": 8,
    "filters": [4, 4, 4, 4],
    "features": 8,
    "memory_size": 8,
    "hidden": [8],
    "gate_rivers": 1,
    "teacher_steps": 500,
}


def test_an_interrupted_imitation_ends_like_an_uninterrupted_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def imitation(name: str) -> Imitation:
        return Imitation(
            tmp_path / name,
            1024,
            levels=("Easy",),
            world_seeds=(1, 2),
            num_envs=8,
            settings=IMITATION,
            checkpoint_seconds=0.0,
            device="cuda",
        )

    imitation("whole").run()
    update, done = ImitationTrainer.update, []

    def cut_off(trainer: ImitationTrainer) -> dict[str, float]:
        done.append(update(trainer))
        if len(done) == 9:
            raise KeyboardInterrupt
        return done[-1]

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(ImitationTrainer, "update", cut_off)
        imitation("cut").run()
    imitation("cut").run()
    whole, cut = (load_policy(tmp_path / folder) for folder in ("whole", "cut"))
    # Its last rounds are recorded in one run and not in the other, and a GPU adds up in any order.
    for one, other in zip(whole.actor.parameters(), cut.actor.parameters(), strict=True):
        assert torch.allclose(one, other, atol=1e-2)


def test_an_encoder_of_geometry_learns_on_a_gpu(tmp_path: Path):
    training = GeometryTraining(
        tmp_path,
        geometry_config(hidden=16, latent=8),
        levels=("Easy",),
        world_seeds=(1, 2),
        held_out_seeds=(3,),
        views=64,
        images=512,
        held_out=64,
        epochs=3,
        device="cuda",
    )
    result = training.run(progress=False)
    losses = [float(row["loss"]) for row in csv.DictReader((tmp_path / "metrics.csv").open())]
    assert losses[-1] < losses[0] and result.path.is_file()


def test_more_cameras_than_fit_into_gpu_memory_are_refused(easy_world: World, card: torch.device):
    before = torch.cuda.memory_allocated(card)
    with pytest.raises(ConfigError, match=r"num_envs = 100,000,000 takes .* fit"):
        TensorRiverEnv([easy_world], 100_000_000, EnvConfig(), device=str(card))
    assert torch.cuda.memory_allocated(card) - before < 2e9  # the world's tables alone
