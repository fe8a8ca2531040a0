"""Export of a policy to one ONNX file: encoder, memory, preprocessing and the choice of actions.

An export is compared with its policy on random images before it is written.
"""

import json
import logging
import warnings
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from thalweg.algos.policy.actions import Actions
from thalweg.algos.policy.policy import Policy
from thalweg.core import versions
from thalweg.core.atomic_io import atomic_path
from thalweg.core.cache import file_hash
from thalweg.core.compute.torch_threads import torch_threads
from thalweg.core.machine import package_version
from thalweg.deploy.errors import ExportError
from thalweg.deploy.network import ExportedNetwork
from thalweg.deploy.onnx_policy import FORMAT, KEY, OnnxPolicy
from thalweg.encoder import Encoder, PluginEncoder
from thalweg.env.config import DEFAULT_CONFIG
from thalweg.env.forces.options import ForceOptions
from thalweg.env.spaces import BRANCHES, moves_in_words
from thalweg.env.task.proprioception import PROPRIOCEPTION
from thalweg.env.tasks import task_named
from thalweg.render import Camera
from thalweg.train.encoder_of_run import context_of, encoder_of
from thalweg.train.observations import (
    IMAGES,
    PRIVILEGED,
    action_of,
    camera_of,
    check_policy_fits,
    feels,
    forces_of,
    observation_of,
    task_of,
    vehicle_of,
)
from thalweg.train.river import load_compatible_encoder

OUTPUTS = {
    "categorical": "logits of the options of all branches",
    "gaussian": "means, then logarithms of standard deviations",
    "squashed": "means, then logarithms of standard deviations, before tanh",
    "point": "numbers before tanh",
}
"""What a network returns, by the kind of its actions."""
STEPS = {
    "seconds": "step_s",
    "vertical_m": "vertical_step_m",
    "yaw_deg": "yaw_step_deg",
    "forward_m": "forward_step_m",
    "lateral_m": "lateral_step_m",
}
"""Field of `EnvConfig` of each size of a step in the metadata."""
OPSET = 18
"""Version of ONNX's operators."""
CHECKED_STEPS, CHECKED_FLIGHTS = 6, 3
"""Steps, and vehicles, of the comparison of an export with its policy."""
TOLERANCE = 1e-4
"""Greatest difference of log-probabilities or other parameters, as a share of the greatest of them, or of 1 if that is
less."""


@dataclass(frozen=True)
class Exportable:
    """A policy that can be exported, with its encoder, if it has one."""

    policy: Policy
    encoder: Encoder | None
    sees: str
    """Images that the policy or its encoder takes: `rgb+mask`, `rgb` or `mask`."""
    inputs: tuple[str, ...]
    """Names of the inputs, see `ExportedNetwork`."""

    @classmethod
    def of(cls, policy: Any, encoder: Encoder | None = None) -> "Exportable":
        """Return a policy with what its export needs; `encoder` is by default that of its training.

        Raises `ExportError` for a policy that cannot be exported faithfully and for an encoder that it does not take,
        with the reason, and the errors of `load_compatible_encoder` and `check_policy_fits`.
        """
        _check(policy)
        seen = observation_of(policy)
        if seen not in IMAGES:
            encoder = encoder or load_compatible_encoder(encoder_of(policy))
            if isinstance(encoder, PluginEncoder):
                raise ExportError(
                    f"the policy sees through the encoder {encoder.identity} of a plug-in, whose code cannot be put"
                    " into a file: only encoders that thalweg encoder train wrote can be exported"
                )
            seen = encoder.inputs
        elif encoder is not None:
            raise ExportError(
                f"the policy sees {seen} with convolutions of its own, and takes no encoder: leave --encoder"
                f" ({encoder.about.get('path', 'an encoder')}) out"
            )
        trained: dict[str, Any] = {"task": task_of(policy), "vehicle": vehicle_of(policy), "action": action_of(policy)}
        check_policy_fits(policy, encoder, **trained)
        inputs = [{"rgb": "image", "mask": "mask"}[part] for part in seen.split("+")]
        if feels(policy):
            inputs.append("proprioception")
        remembers = policy.shape.memory or policy.frames > 1
        if remembers or policy.shape.eyes is not None:
            inputs.append("fresh")
        if remembers:
            inputs.append("memory")
        if policy.shape.eyes is not None:
            inputs.append("last_action")
        return cls(policy, encoder, seen, tuple(inputs))

    @property
    def memory(self) -> int:
        """M, the numbers of the memory: observations before the last one, and the recurrent state."""
        return (self.policy.frames - 1) * self.policy.obs_size + self.policy.shape.memory

    @property
    def camera(self) -> Camera:
        """The camera that the policy was trained with."""
        if self.encoder is not None:
            return camera_of(self.policy, self.encoder)
        assert self.policy.shape.eyes is not None
        height, width, _ = self.policy.shape.eyes.image
        return replace(camera_of(self.policy), height_px=height, width_px=width)

    @property
    def steps(self) -> dict[str, float]:
        """The duration of a step of the policy's training, and its sizes, by the keys of `STEPS`."""
        env = self._env
        return {key: env.get(field, getattr(DEFAULT_CONFIG, field)) for key, field in STEPS.items()}

    @property
    def moves(self) -> dict[str, tuple[str, str, str]]:
        """What the options of each branch, or +1, 0 and -1, did in the policy's training, see `moves_in_words`."""
        env = self._env
        return moves_in_words(
            action_of(self.policy),
            fast_step=task_named(task_of(self.policy)).fast_step_m > 0,
            allow_backward=bool(env.get("allow_backward", DEFAULT_CONFIG.allow_backward)),
            vehicle=env.get("vehicle", DEFAULT_CONFIG.vehicle),
        )

    @property
    def _env(self) -> dict[str, Any]:
        """What the policy says of the `EnvConfig` of its training."""
        return context_of(self.policy).get("env", {})

    def examples(self, count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
        """Return random inputs by name, as in `ExportedNetwork`, of `count` vehicles, some of which begin a flight."""
        camera, policy = self.camera, self.policy
        size = count, camera.height_px, camera.width_px
        every: dict[str, Any] = {
            "image": rng.integers(256, size=(*size, 3), dtype=np.uint8),
            "mask": rng.integers(2, size=size, dtype=np.uint8) * 255,
            "proprioception": rng.normal(size=(count, len(PROPRIOCEPTION))).astype(np.float32),
            "fresh": np.arange(count) % 2 == 0,
            "memory": rng.normal(size=(count, self.memory)).astype(np.float32),
            "last_action": rng.integers(-1, 3, size=(count, policy.actions.count)),
        }
        return {name: every[name] for name in self.inputs}


def _check(policy: Any) -> None:
    """Raise `ExportError` for a policy that cannot be exported faithfully."""
    if not isinstance(policy, Policy):
        name = getattr(getattr(policy, "about", None), "algorithm", "") or type(policy).__name__
        what = "is a planner, which searches with a model" if hasattr(policy, "about") else "is no trained network"
        raise ExportError(f"{name} {what}: only networks can be exported")
    if observation_of(policy) == PRIVILEGED:
        raise ExportError(
            "the policy sees the privileged observation, which only the simulator knows: export one that sees frames"
        )
    actions = policy.actions
    if actions.count != len(BRANCHES):
        raise ExportError(
            f"the policy chooses actions of {actions.count} numbers or branches; exports are of {len(BRANCHES)}:"
            f" {', '.join(BRANCHES)}"
        )
    if actions.sizes:
        return
    if set(actions.low + actions.high) != {-1.0, 1.0}:
        raise ExportError(f"the policy chooses numbers from {actions.low} to {actions.high}; exports are of -1..1")
    if policy.shape.eyes is not None:
        raise ExportError(
            "the policy sees images with convolutions of its own and chooses numbers; such a policy takes its last"
            " options, which it does not have: train it on the codes of an encoder"
        )


def export_policy(
    policy: Any, path: Path, *, encoder: Encoder | None = None, source: Path | None = None, name: str = ""
) -> dict[str, Any]:
    """Write a policy as an ONNX file, and return the metadata of the file.

    Args:
        policy: The policy.
        path: File to write, atomically.
        encoder: The policy's encoder; by default that of its training. Policies of images have none.
        source: The policy's file, whose hash is written to the metadata.
        name: Name of the policy for readers.

    Raises the errors of `Exportable.of`, and `ExportError` if the exported network differs from the policy.
    """
    import onnx

    chosen = Exportable.of(policy, encoder)
    about = _about(chosen, source, name)
    with atomic_path(path) as draft:
        with torch_threads(1):
            program = _program(chosen)
        model = program.model_proto
        onnx.helper.set_model_props(model, {KEY: json.dumps(about)})
        model.producer_name, model.doc_string = "thalweg", "A policy that follows rivers, see its metadata."
        onnx.checker.check_model(model)
        onnx.save(model, str(draft))
        _compare(chosen, OnnxPolicy.load(draft))
    return about


def _program(chosen: Exportable) -> Any:
    """Return the exported network."""
    network = ExportedNetwork(chosen.policy, chosen.encoder, chosen.inputs).eval().requires_grad_(False)
    given = tuple(torch.from_numpy(array) for array in chosen.examples(2, np.random.default_rng(0)).values())
    batch = torch.export.Dim("vehicles", min=1)
    logger = logging.getLogger("torch.onnx")
    before = logger.level
    outputs = ["action", "outputs", *(["next_memory"] if "memory" in chosen.inputs else [])]
    with warnings.catch_warnings():  # the exporter warns of torchvision, and of its own parts
        warnings.simplefilter("ignore")
        logger.setLevel(logging.ERROR)
        try:
            program = torch.onnx.export(
                network,
                given,
                input_names=list(chosen.inputs),
                output_names=outputs,
                dynamic_shapes={"given": tuple({0: batch} for _ in given)},
                opset_version=OPSET,
                dynamo=True,
                verbose=False,
            )
        finally:
            logger.setLevel(before)
    assert program is not None
    return program


def _about(chosen: Exportable, source: Path | None, name: str) -> dict[str, Any]:
    """Return the metadata of the file as plain data."""
    policy, camera = chosen.policy, chosen.camera
    context, task = context_of(policy), task_of(policy)
    options = bool(policy.actions.sizes)
    return {
        "format": FORMAT,
        "name": name,
        "algorithm": policy.about.algorithm,
        "policy_hash": None if source is None else file_hash(source),
        "encoder": context.get("encoder"),
        "sees": chosen.sees,
        "inputs": list(chosen.inputs),
        "camera": {**camera.as_data(), "intrinsics": camera.intrinsics().tolist()},
        "mask": "255 where water is seen, else 0",
        "proprioception": list(PROPRIOCEPTION) if "proprioception" in chosen.inputs else [],
        "memory": chosen.memory,
        "action_kind": "options" if options else "numbers",
        "actions": {branch: list(moves if options else moves[::2]) for branch, moves in chosen.moves.items()},
        "outputs": OUTPUTS[policy.actions.kind],
        "steps": chosen.steps,
        "fast_step_m": task_named(task).fast_step_m,
        "temperature": policy.temperature,
        "chooses": _chooses(policy),
        **_dynamics(forces_of(policy)),
        "task": task,
        "render_version": context.get("render_version"),
        "versions": {"thalweg": package_version("thalweg"), "torch": torch.__version__, "rules": versions.RULES},
    }


def _chooses(policy: Policy) -> str:
    """Return how an action is chosen from the outputs, in words."""
    if policy.actions.kind == "categorical":
        return "the most probable option of each branch"
    nearest = {"native": "", "box_literal": ", rounded to an option", "box_scaled": ", -1..1 rounded to an option"}
    return f"the most probable number of each branch{nearest[policy.actions.adapter]}"


def _dynamics(forces: ForceOptions) -> dict[str, Any]:
    """Return the dynamics of a policy's training, with its speeds if an action commands velocities."""
    inertia = asdict(forces.inertia) if forces.dynamics == "inertial" else None
    return {"dynamics": forces.dynamics, "inertia": inertia}


def _compare(chosen: Exportable, exported: OnnxPolicy) -> None:
    """Raise `ExportError` if a file and its policy differ in a few steps of random images."""
    rng = np.random.default_rng(1)
    player = chosen.policy.player(CHECKED_FLIGHTS, deterministic=True)
    flights = exported.player(CHECKED_FLIGHTS)
    fresh = np.ones(CHECKED_FLIGHTS, bool)
    for _ in range(CHECKED_STEPS):
        given = chosen.examples(CHECKED_FLIGHTS, rng)
        seen = {name: given[name] for name in ("image", "mask", "proprioception") if name in given}
        wanted, found = player(_observed(chosen, seen), fresh), flights(**seen, fresh=fresh)
        if chosen.policy.actions.kind == "categorical":
            told, outputs = player.log_probs(), _log_probs(flights.outputs, chosen.policy)
        else:
            told, outputs = player.parameters(), flights.outputs / np.float32(chosen.policy.temperature)
        assert told is not None
        apart = np.abs(outputs - told).max()
        if apart > TOLERANCE * max(1.0, float(np.abs(told).max())):
            raise ExportError(f"the exported network differs from the policy by {apart:.2g}: nothing was written")
        if wanted.shape != found.shape or not _same_choice(chosen.policy.actions, told, wanted, found):
            raise ExportError("the exported network chooses other actions than the policy: nothing was written")
        fresh = rng.random(CHECKED_FLIGHTS) < 0.2
        if flights.last is not None:
            player.correct(found)


def _observed(chosen: Exportable, seen: dict[str, np.ndarray]) -> np.ndarray:
    """Return the policy's observations of images and proprioception: frames [N, H, W, C], or codes [N, Z + P]."""
    parts = [seen["image"]] if "image" in seen else []
    parts += [seen["mask"][..., None]] if "mask" in seen else []
    frames = np.concatenate(parts, axis=-1)
    if chosen.encoder is None:
        return frames
    codes = chosen.encoder(frames)
    return np.concatenate([codes, seen["proprioception"]], axis=1) if "proprioception" in seen else codes


def _log_probs(outputs: np.ndarray, policy: Policy) -> np.ndarray:
    """Return the log-probabilities [N, A, K] of K options of A branches, from outputs [N, A K] of the network."""
    logits = torch.from_numpy(outputs) / policy.temperature
    return policy.actions.distribution(logits).log_p.numpy()  # pyright: ignore[reportAttributeAccessIssue]


def _same_choice(actions: Actions, told: np.ndarray, one: np.ndarray, other: np.ndarray) -> bool:
    """Return whether two choices [N, A] are the same, or of options between which `TOLERANCE` decides.

    `told`: log-probabilities [N, A, K] of options, or parameters [N, P] of numbers, from which the choices were made.
    """
    if np.array_equal(one, other):
        return True
    if actions.kind == "categorical":
        return _is_tie(told, one, other)
    if not actions.sizes:
        return bool(np.abs(one - other).max() <= TOLERANCE)
    numbers = told[:, : actions.count] if actions.kind == "gaussian" else np.tanh(told[:, : actions.count])
    last = np.array(actions.sizes) - 1
    between = (numbers + 1.0) * (0.5 * last) if actions.adapter == "box_scaled" else numbers
    return bool(np.abs(between - np.minimum(one, other) - 0.5)[one != other].max() <= TOLERANCE * max(1.0, last.max()))


def _is_tie(log_probs: np.ndarray, one: np.ndarray, other: np.ndarray) -> bool:
    """Return whether two choices [N, A] of options are equally probable, within `TOLERANCE`."""
    first, second = (np.take_along_axis(log_probs, each[..., None], -1) for each in (one, other))
    return bool(np.abs(first - second).max() < TOLERANCE)
