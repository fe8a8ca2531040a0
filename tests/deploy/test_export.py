"""Tests of exported policies: ONNX Runtime acts as the policy does, and what cannot be faithful is refused."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import torch
from scipy.special import log_softmax

from tests.deploy import policies
from thalweg.algos.policy.actions import Adapter, Kind
from thalweg.algos.policy.policy import Policy
from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.bench.packaged import PACKAGED_POLICY
from thalweg.deploy import export
from thalweg.deploy.errors import ExportError
from thalweg.deploy.export import export_policy
from thalweg.deploy.onnx_policy import KEY, OnnxPolicy, about_error
from thalweg.encoder import VAE, Encoder, VAEConfig, load_encoder, save_vae
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.render import RENDER_VERSION
from thalweg.train import load_policy
from thalweg.train.errors import TrainingError
from thalweg.world import World

STEPS = 40
PAGE = Path(__file__).resolve().parents[2] / "docs" / "export.md"


def keys_on_the_page() -> str:
    """First column of the page's table of metadata."""
    table = PAGE.read_text(encoding="utf-8").partition("| key | value |\n|---|---|\n")[2].partition("\n\n")[0]
    return "\n".join(line.split("|")[1] for line in table.splitlines())


def test_the_packaged_policy_flies_the_same_flight_by_onnx_runtime(tmp_path: Path, easy_world: World):
    policy = load_policy(PACKAGED_POLICY)
    path = tmp_path / "policy.onnx"
    about = export_policy(policy, path, source=PACKAGED_POLICY, name="packaged")
    assert about["inputs"] == ["image", "mask", "fresh", "memory", "last_action"]
    exported = OnnxPolicy.load(path)
    env = RiverVectorEnv([easy_world], 2, EnvConfig(observation="rgb+mask"))
    player, flights = policy.player(2, deterministic=True), exported.player(2)
    seen, _ = env.reset(seed=5)
    fresh, taken = np.ones(2, bool), []
    for _ in range(STEPS):
        wanted = player(seen, fresh)
        found = flights(image=np.ascontiguousarray(seen[..., :3]), mask=np.ascontiguousarray(seen[..., 3]), fresh=fresh)
        np.testing.assert_array_equal(found, wanted)
        taken.append(found)
        seen, _, terminated, truncated, _ = env.step(found)
        fresh = terminated | truncated
    assert len(np.unique(np.concatenate(taken), axis=0)) > 3


@pytest.mark.parametrize("name", ["default", "geometry"])
@pytest.mark.parametrize(("memory", "felt"), [(0, False), (8, True)])
def test_policies_of_codes_act_the_same(name: str, memory: int, felt: bool, tmp_path: Path, easy_world: World):
    policy, encoder = policies.of_codes(name, memory, felt=felt)
    about = export_policy(policy, tmp_path / "policy.onnx")
    exported = OnnxPolicy.load(tmp_path / "policy.onnx")
    env = RiverVectorEnv([easy_world], 1, EnvConfig(observation=("rgb", "mask", "proprioception")))
    player, flights = policy.player(1, deterministic=True), exported.player()
    seen, _ = env.reset(seed=2)
    fresh, taken = np.ones(1, bool), set()
    for _ in range(15):
        codes = encoder(np.concatenate([seen["rgb"], seen["mask"]], axis=-1))
        wanted = player(np.concatenate([codes, seen["proprioception"]], axis=1) if felt else codes, fresh)
        given = {"image": seen["rgb"], "mask": seen["mask"][..., 0], "proprioception": seen["proprioception"]}
        found = flights(**{name: given[name] for name in given if name in about["inputs"]})
        np.testing.assert_array_equal(found, wanted)
        taken.add(tuple(found[0]))
        seen, _, terminated, truncated, _ = env.step(env.pilot_actions())
        fresh = terminated | truncated
    assert len(taken) > 1 and about["sees"] == "rgb+mask"


def flown_alike(policy: Policy, encoder: Encoder, path: Path, count: int = 3, steps: int = 6) -> np.ndarray:
    """Assert that a policy of codes and its export act the same on coarse random images; return the actions.

    Actions are [steps, count, 4]. Flights of some vehicles begin anew in between.
    """
    export_policy(policy, path, encoder=encoder)
    rng = np.random.default_rng(3)
    player, flights = policy.player(count, deterministic=True), OnnxPolicy.load(path).player(count)
    taken = []
    for step in range(steps):
        image = rng.integers(256, size=(count, 2, 2, 3), dtype=np.uint8).repeat(64, 1).repeat(64, 2)
        mask = rng.integers(2, size=(count, 2, 2), dtype=np.uint8).repeat(64, 1).repeat(64, 2) * 255
        felt = rng.normal(size=(count, 9)).astype(np.float32)
        codes = encoder(np.concatenate([image, mask[..., None]], axis=-1))
        seen = np.concatenate([codes, felt], axis=1) if policy.obs_size > encoder.latent else codes
        fresh = np.arange(count) == step % 4 if step else np.ones(count, bool)
        wanted = player(seen, fresh)
        found = flights(image=image, mask=mask, proprioception=felt, fresh=fresh)
        assert found.dtype == wanted.dtype
        np.testing.assert_allclose(found, wanted, atol=1e-4)
        if policy.actions.kind == "categorical":
            probable = log_softmax(flights.outputs.reshape(count, 4, 3), axis=-1)
            wanted = player.log_probs()
            assert wanted is not None
            np.testing.assert_allclose(probable, wanted, atol=1e-3)
        taken.append(found)
    return np.stack(taken)


@pytest.mark.parametrize(("memory", "felt"), [(0, False), (8, True)])
def test_policies_of_stacked_frames_act_the_same_and_their_memory_holds_the_frames(
    memory: int, felt: bool, tmp_path: Path
):
    policy, encoder = policies.of_codes("default", memory, felt=felt, frames=4)
    taken = flown_alike(policy, encoder, tmp_path / "policy.onnx")
    about = OnnxPolicy.load(tmp_path / "policy.onnx").about
    assert about["memory"] == 3 * policy.obs_size + memory
    assert {"fresh", "memory"} <= set(about["inputs"]) and len(np.unique(taken.reshape(-1, 4), axis=0)) > 1


@pytest.mark.parametrize("kind", ["gaussian", "squashed", "point"])
def test_policies_of_continuous_actions_choose_the_same_numbers(kind: Kind, tmp_path: Path):
    inertia = {"forward_m_per_s": 3.0}
    env = {"dynamics": "inertial", "inertia": inertia}
    policy, encoder = policies.of_codes("default", actions=policies.numbers(kind), **env)
    taken = flown_alike(policy, encoder, tmp_path / "policy.onnx")
    assert taken.dtype == np.float32 and np.abs(taken).max() <= 1.0 and np.ptp(taken, axis=(0, 1)).min() > 0.01
    about = OnnxPolicy.load(tmp_path / "policy.onnx").about
    assert (about["action_kind"], about["actions"]["yaw"]) == ("numbers", ["turn left", "turn right"])
    assert about["dynamics"] == "inertial" and about["inertia"]["forward_m_per_s"] == 3.0
    assert about["inertia"]["time_constant_s"] == 0.4


@pytest.mark.parametrize(("adapter", "kind"), [("box_literal", "gaussian"), ("box_scaled", "point")])
def test_policies_whose_numbers_are_rounded_choose_the_same_options(adapter: Adapter, kind: Kind, tmp_path: Path):
    policy, encoder = policies.of_codes("default", frames=2, actions=policies.rounded(adapter, kind))
    taken = flown_alike(policy, encoder, tmp_path / "policy.onnx")
    about = OnnxPolicy.load(tmp_path / "policy.onnx").about
    assert about["action_kind"] == "options" and "rounded to an option" in about["chooses"]
    assert set(np.unique(taken)) <= {0, 1, 2} and len(np.unique(taken.reshape(-1, 4), axis=0)) > 1


@pytest.mark.parametrize(("sees", "memory"), [("rgb", 0), ("mask", 6), ("rgb+mask", 0)])
def test_policies_of_images_act_the_same_in_any_number_of_vehicles(sees: str, memory: int, tmp_path: Path):
    policy = policies.of_images(sees, memory)
    export_policy(policy, tmp_path / "policy.onnx")
    exported = OnnxPolicy.load(tmp_path / "policy.onnx")
    rng = np.random.default_rng(3)
    for count in (1, 5):
        player, flights = policy.player(count, deterministic=True), exported.player(count)
        for step in range(4):
            image = rng.integers(256, size=(count, 128, 128, 3), dtype=np.uint8)
            mask = rng.integers(2, size=(count, 128, 128), dtype=np.uint8) * 255
            given: dict[str, Any] = {"rgb": {"image": image}, "mask": {"mask": mask}}.get(
                sees, {"image": image, "mask": mask}
            )
            seen = np.concatenate([value.reshape(count, 128, 128, -1) for value in given.values()], axis=-1)
            fresh = np.arange(count) % 2 == step % 2 if step else np.ones(count, bool)
            np.testing.assert_array_equal(flights(**given, fresh=fresh), player(seen, fresh))


@pytest.mark.parametrize(
    "make",
    [
        lambda: policies.of_images("rgb", memory=8),
        lambda: policies.of_codes("default", actions=policies.numbers("gaussian"))[0],
    ],
    ids=["eyes and memory", "spread of numbers"],
)
def test_an_exported_policy_can_be_trained_on(make: Callable[[], Policy], tmp_path: Path):
    policy = make()
    policy.actor.train()

    def can_learn() -> dict[str, bool]:
        learns = {name: value.requires_grad for name, value in policy.actor.named_parameters()}
        return learns | {f"{name} in training": module.training for name, module in policy.actor.named_modules()}

    before = can_learn()
    export_policy(policy, tmp_path / "policy.onnx")
    assert can_learn() == before and any(before.values())


def test_a_file_says_what_it_needs_and_what_it_means(tmp_path: Path):
    source = tmp_path / "policy.safetensors"
    policy = policies.of_images("rgb")
    policy.save(source)
    export_policy(policy, tmp_path / "policy.onnx", source=source, name="mine")
    about = OnnxPolicy.load(tmp_path / "policy.onnx").about
    assert set(re.findall(r"`(\w+)`", keys_on_the_page())) == set(about)
    assert (about["name"], about["algorithm"], about["sees"]) == ("mine", "DAgger", "rgb")
    assert about["policy_hash"] and about["versions"]["torch"] == torch.__version__
    assert about["actions"]["yaw"] == ["turn left", "none", "turn right"]
    camera = about["camera"]
    assert (camera["height_px"], camera["fov_deg"], camera["pitch_deg"]) == (128, 60.0, 20.0)
    assert about["steps"] == {"seconds": 0.25, "vertical_m": 1, "yaw_deg": 10, "forward_m": 1, "lateral_m": 0.5}
    model = onnx.load(tmp_path / "policy.onnx")
    assert [each.name for each in model.graph.input] == ["image", "fresh", "last_action"] == about["inputs"]


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (policies.privileged, "privileged observation, which only the simulator knows"),
        (lambda: policies.of_other_numbers(-1.0, 3), "chooses actions of 3 numbers or branches; exports are of 4"),
        (lambda: policies.of_other_numbers(0.0, 4), r"chooses numbers from \(0\.0.* to .*; exports are of -1\.\.1"),
        (policies.of_images_and_numbers, "takes its last options, which it does not have"),
        (lambda: BASELINES["pilot"], "Pilot is no trained network"),
    ],
)
def test_what_cannot_be_exported_faithfully_is_refused_by_name(make: Callable[[], Any], reason: str, tmp_path: Path):
    with pytest.raises(ExportError, match=reason):
        export_policy(make(), tmp_path / "policy.onnx")
    assert list(tmp_path.iterdir()) == []


def test_a_network_that_acts_otherwise_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    class Otherwise(export.ExportedNetwork):
        def forward(self, *given: torch.Tensor) -> tuple[torch.Tensor, ...]:
            action, outputs, *rest = super().forward(*given)
            return 2 - action, -outputs, *rest

    monkeypatch.setattr(export, "ExportedNetwork", Otherwise)
    with pytest.raises(ExportError, match="differs from the policy by"):
        export_policy(policies.of_images("mask"), tmp_path / "policy.onnx")
    assert list(tmp_path.iterdir()) == []


def test_what_is_missing_is_named(tmp_path: Path):
    export_policy(policies.of_images("rgb+mask"), tmp_path / "policy.onnx")
    with pytest.raises(ExportError, match="takes mask, which was not given"):
        OnnxPolicy.load(tmp_path / "policy.onnx").player()(image=np.zeros((1, 128, 128, 3), np.uint8))


@pytest.mark.parametrize("content", [b"", b"not a model"])
def test_another_file_is_refused(content: bytes, tmp_path: Path):
    path = tmp_path / "policy.onnx"
    path.write_bytes(content)
    with pytest.raises(ExportError, match="is no policy that thalweg export wrote"):
        OnnxPolicy.load(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"memory": 10**12}, "its memory is 1,000,000,000,000, but its network takes one of 8"),
        ({"format": 4}, "its format is 4, not 3"),
    ],
)
def test_a_file_with_another_description_is_refused(change: dict, words: str, tmp_path: Path):
    path = tmp_path / "policy.onnx"
    export_policy(policies.of_images("rgb", memory=8), path)
    model = onnx.load(str(path))
    (entry,) = (each for each in model.metadata_props if each.key == KEY)
    entry.value = json.dumps(json.loads(entry.value) | change)
    onnx.save(model, str(path))
    with pytest.raises(ExportError, match=words):
        OnnxPolicy.load(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"inputs": ["mask", "fresh"]}, "names the inputs .*, but its network takes"),
        ({"inputs": 3}, "names the inputs 3"),
        ({"memory": "long"}, "its memory is 'long', not a number"),
        ({"memory": True}, "its memory is True, not a number"),
        ({"format": 2}, "its format is 2, not 3: export the policy again"),
        ({"format": None}, "its format is None, not 3"),
        ({"actions": [1]}, r"its actions are \[1\], not a mapping"),
    ],
)
def test_a_description_that_does_not_fit_the_network_is_refused(change: dict, words: str):
    about = {"format": 3, "inputs": ["mask", "fresh", "last_action"], "memory": 0, "actions": {}}
    assert about_error(about, ["mask", "last_action", "fresh"]) == ""
    assert re.search(words, about_error(about | change, ["mask", "last_action", "fresh"]))
    assert "lacks inputs" in about_error([about], [])


def test_another_encoder_than_that_of_the_training_is_refused(tmp_path: Path):
    policy, encoder = policies.of_codes("default")
    path = tmp_path / "other.safetensors"
    save_vae(path, VAE(VAEConfig(latent=encoder.latent)), encoder.about)
    other = load_encoder(path)
    with pytest.raises(TrainingError, match=r"other\.safetensors is another encoder"):
        export_policy(policy, tmp_path / "policy.onnx", encoder=other)


def test_an_encoder_for_a_policy_of_images_is_refused(tmp_path: Path):
    with pytest.raises(ExportError, match=r"takes no encoder: leave --encoder \(.*\) out"):
        export_policy(policies.of_images("rgb"), tmp_path / "policy.onnx", encoder=load_encoder())


def test_a_policy_of_images_of_another_renderer_is_refused(tmp_path: Path):
    policy = policies.of_images("rgb", render_version=RENDER_VERSION - 1)
    with pytest.raises(TrainingError, match=f"images of renderer version {RENDER_VERSION - 1}"):
        export_policy(policy, tmp_path / "policy.onnx")


def test_the_metadata_have_the_steps_and_the_temperature_of_the_training(tmp_path: Path):
    policy = policies.of_images("rgb", env={"forward_step_m": 0.75, "step_s": 0.5, "yaw_step_deg": 5.0})
    policy.temperature = 0.5
    about = export_policy(policy, tmp_path / "policy.onnx")
    assert about["steps"] == {"seconds": 0.5, "vertical_m": 1, "yaw_deg": 5, "forward_m": 0.75, "lateral_m": 0.5}
    assert (about["temperature"], about["fast_step_m"]) == (0.5, 0.0)
    assert about["actions"]["longitudinal"] == ["forward", "none", "none"]


@pytest.mark.parametrize("numbers", [False, True], ids=["options", "numbers"])
def test_a_network_with_the_same_outputs_and_other_actions_is_not_written(
    numbers: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    class Otherwise(export.ExportedNetwork):
        def forward(self, *given: torch.Tensor) -> tuple[torch.Tensor, ...]:
            action, *rest = super().forward(*given)
            return -action if numbers else 2 - action, *rest

    policy = policies.of_codes("default", actions=policies.numbers("gaussian") if numbers else None)[0]
    monkeypatch.setattr(export, "ExportedNetwork", Otherwise)
    with pytest.raises(ExportError, match="chooses other actions than the policy"):
        export_policy(policy, tmp_path / "policy.onnx")
    assert list(tmp_path.iterdir()) == []


def test_options_that_are_equally_probable_count_as_the_same_choice():
    told = np.log(np.array([[[0.4, 0.4, 0.2]] * 4]))
    first = np.zeros((1, 4), np.int64)
    assert export._same_choice(policies.discrete(), told, first, first + np.array([1, 0, 0, 0]))
    assert not export._same_choice(policies.discrete(), told, first, first + np.array([2, 0, 0, 0]))
