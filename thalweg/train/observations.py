"""Observations of policies of the river task, and checks that a policy fits what it would be shown."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from thalweg.algos.policy.actions import Actions
from thalweg.core import versions
from thalweg.core.cache import file_hash
from thalweg.encoder import Encoder, PluginEncoder, sides
from thalweg.env.config import DEFAULT_CONFIG, ActionSpace, Vehicle
from thalweg.env.forces.options import ForceOptions
from thalweg.env.spaces import CHANNELS
from thalweg.env.task.priced.eye import features_of
from thalweg.env.task.proprioception import PROPRIOCEPTION
from thalweg.render import RENDER_VERSION, Camera
from thalweg.train.encoder_of_run import context_of, encoder_in_words
from thalweg.train.errors import TrainingError

BRANCHES = (3, 3, 3, 3)
"""Number of options of each branch of an action: vertical, yaw, longitudinal, lateral."""
FRAMES, PRIVILEGED, IMAGES = "frames", "privileged", tuple(CHANNELS)
"""What a policy of the river task sees: frames through an encoder, the privileged observation, which draws nothing
(`thalweg.env.task.ideal_eye`), or, with convolutions of its own, images: `rgb+mask`, `rgb` or `mask`."""
IN_WORDS = {FRAMES: "frames through an encoder", PRIVILEGED: "the privileged observation"} | {
    channels: f"images ({channels})" for channels in IMAGES
}
FELT = "proprioception_version"
"""Key of a policy's context that says that it takes proprioception (`thalweg.env.task.proprioception`) beside what it
sees, and of which version."""
TAUGHT = "taught"
"""Key of the context of a policy whose training began with one that learnt from a teacher."""
SEEN_BY_CRITICS = {True: "the privileged state and progress too", False: "what the policy sees"}
"""What critics see in training, by whether they are asymmetric."""


def encoder_hash(encoder: Encoder) -> str:
    """Return the hash of the encoder's file, which identifies it; of a plug-in its name and version."""
    if isinstance(encoder, PluginEncoder):
        return encoder.identity
    return file_hash(Path(encoder.about["path"]))


def observation_of(policy: Any) -> str:
    """Return what a policy was trained on: `FRAMES`, `PRIVILEGED` or one of `IMAGES`.

    A policy that does not say it sees frames: files of earlier versions knew nothing else. Raises `TrainingError` for
    any other observation, and for a policy with convolutions that does not say which images it sees.
    """
    found = context_of(policy).get("observation", FRAMES)
    if found not in (FRAMES, PRIVILEGED, *IMAGES):
        raise TrainingError(
            f"the policy was trained on the observation {found!r}; on rivers policies see {FRAMES}, {PRIVILEGED},"
            f" {', '.join(IMAGES)}"
        )
    if _image_of(policy) is not None and found not in IMAGES:
        raise TrainingError(
            f"the policy takes images, but does not say which: its context has the observation {found!r} instead of one"
            f" of {', '.join(IMAGES)}"
        )
    return found


def feels(policy: Any) -> bool:
    """Return whether a policy takes proprioception beside what it sees."""
    return FELT in context_of(policy)


def is_taught(policy: Any) -> bool:
    """Return whether a policy learnt from a teacher that knows the map, or its training began with one that did."""
    context = context_of(policy)
    return "imitation_version" in context or bool(context.get(TAUGHT))


def task_of(policy: Any) -> str:
    """Return the task that a policy was trained on, that of the paper if it does not say it."""
    return context_of(policy).get("env", {}).get("task", "River")


def vehicle_of(policy: Any) -> Vehicle:
    """Return the vehicle that a policy was trained for, `uav` if it does not say it."""
    return context_of(policy).get("env", {}).get("vehicle", "uav")


def flies_hard(policy: Any) -> bool:
    """Return whether a policy was trained in the hard mode of its task, see `EnvConfig.hard`."""
    return bool(context_of(policy).get("env", {}).get("hard", False))


def forces_of(policy: Any) -> ForceOptions:
    """Return wind, current and dynamics under which a policy was trained; none if it does not say it."""
    return ForceOptions.of_env_data(context_of(policy).get("env", {}))


def camera_of(policy: Any, encoder: Encoder | None = None) -> Camera:
    """Return the camera that a policy was trained with, that of the levels if it does not say it.

    With an `encoder`, its frames have the size that the encoder takes.
    """
    told = context_of(policy).get("env", {}).get("camera")
    camera = Camera(**told) if isinstance(told, Mapping) else DEFAULT_CONFIG.camera
    if encoder is None:
        return camera
    height, width = sides(encoder.config.size_px)
    return replace(camera, height_px=height, width_px=width)


def action_of(policy: Any) -> ActionSpace:
    """Return the kind of actions of a policy, see `EnvConfig.action`; a policy without spaces takes any."""
    actions = getattr(policy, "actions", None)
    return "continuous" if actions is not None and not actions.sizes else "multidiscrete"


def check_policy_fits(
    policy: Any,
    encoder: Encoder | None,
    *,
    offered: str | None = None,
    proprioception: bool | None = None,
    task: str = "River",
    vehicle: str = "uav",
    action: str = "multidiscrete",
    dynamics: str | None = None,
) -> None:
    """Raise `TrainingError` unless a policy fits an observation and the actions of the river task.

    The observation is the codes of the encoder. For None it is `offered`, by default images for a policy of images, and
    the privileged observation, which differs by `task` and `vehicle`, for any other. `proprioception` is whether that
    is offered too, by default to a policy that takes it. A policy without spaces, such as a baseline, always fits. The
    vehicle must be the one that the policy was trained for. `action` is the kind of actions that are executed, see
    `EnvConfig.action`, and `dynamics` what they command: steps or velocities; None for either.
    """
    context, seen = context_of(policy), observation_of(policy)
    if encoder is not None:
        offered = FRAMES
    elif offered is None:
        offered = seen if seen in IMAGES else PRIVILEGED
    if seen != offered and ("observation" in context or "encoder" in context):
        raise TrainingError(
            f"the policy was trained on {IN_WORDS[seen]}, but here it would see {IN_WORDS[offered]};"
            f" choose {IN_WORDS[seen]}, or another policy"
        )
    if proprioception is not None and feels(policy) != proprioception:
        trained, here = ("with", "without") if feels(policy) else ("without", "with")
        raise TrainingError(
            f"the policy was trained {trained} proprioception, but here it would fly {here}; choose a policy that was"
            f" trained {here}, or fly {trained}"
        )
    _check_versions(seen, context)
    trained_for = vehicle_of(policy)
    if context and trained_for != vehicle:
        raise TrainingError(f"the policy was trained for the vehicle {trained_for}, not {vehicle}")
    commands = forces_of(policy).dynamics
    if "env" in context and dynamics not in (None, commands) and getattr(policy, "actions", None) is not None:
        raise TrainingError(
            f"the policy was trained with {commands} dynamics, but here it would fly with {dynamics} ones: what it"
            " commands means something else there"
        )
    _check_inputs(policy, offered, encoder, (task, vehicle))
    _check_actions(getattr(policy, "actions", None), action)
    trained_with = context.get("encoder")
    if encoder is not None and trained_with is not None and trained_with != (current := encoder_hash(encoder)):
        raise TrainingError(
            f"the policy was trained on the codes of {encoder_in_words(context)}, but {encoder.about['path']} is"
            f" another encoder (its hash: {current}); use the one that it was trained with"
        )


def _check_actions(actions: Actions | None, kind: str) -> None:
    """Raise `TrainingError` unless the actions of a policy are those of a kind, see `EnvConfig.action`."""
    if actions is None:
        return
    found = f"{actions.sizes} from {actions.start}" if actions.sizes else f"a Box of shape {actions.shape}"
    if kind == "continuous":
        if actions.sizes or actions.shape != (4,):
            raise TrainingError(
                f"the flight takes continuous actions, as inertial dynamics do, a Box of shape (4,), not {found}:"
                " choose a policy that was trained with them, or kinematic dynamics and discrete actions"
            )
    elif (actions.sizes, actions.start, actions.shape) != (BRANCHES, (0, 0, 0, 0), (4,)):
        raise TrainingError(f"the river task takes four branches of 3 options, counted from 0, not {found}")


def _check_versions(seen: str, context: dict[str, Any]) -> None:
    """Raise `TrainingError` if what a policy sees was of another version in its training."""
    made_with = context.get("privileged_version", 1)
    if seen == PRIVILEGED and made_with != versions.PRIVILEGED:
        raise TrainingError(
            f"the policy was trained on version {made_with} of the privileged observation, but this is version"
            f" {versions.PRIVILEGED}; train it again"
        )
    felt_with = context.get(FELT, versions.PROPRIOCEPTION)
    if felt_with != versions.PROPRIOCEPTION:
        raise TrainingError(
            f"the policy was trained on version {felt_with} of proprioception, but this is version"
            f" {versions.PROPRIOCEPTION}; train it again"
        )
    current = {"tasks": versions.TASKS, "vehicles": versions.VEHICLES, "props": versions.PROPS}
    for name, kept in (*current.items(), ("forces", versions.FORCES)):
        trained_on = context.get(f"{name}_version", kept)
        if trained_on != kept:
            raise TrainingError(
                f"the policy was trained on version {trained_on} of the {name}, but this is version {kept}; train it"
                " again"
            )
    drawn_with = context.get("render_version")
    if seen in IMAGES and drawn_with != RENDER_VERSION:
        raise TrainingError(
            f"the policy was trained on images of renderer version {drawn_with}, but the renderer is version"
            f" {RENDER_VERSION}; train it again"
        )


def _check_inputs(policy: Any, offered: str, encoder: Encoder | None, of: tuple[str, str]) -> None:
    """Raise `TrainingError` unless a policy takes as many numbers, or images of the shape, that it is offered.

    `of` are the task and the vehicle, by which the privileged observation differs.
    """
    if offered in IMAGES:
        camera = camera_of(policy)
        needed = (camera.height_px, camera.width_px, CHANNELS[offered])
        offers = f"{IN_WORDS[offered]} have the shape"
    elif encoder is None:
        of_task = "" if of[0] == "River" else f" of the task {of[0]}"
        needed, offers = len(features_of(*of)), f"privileged observation{of_task} has"
    else:
        needed, offers = encoder.latent, "encoder returns"
    if not isinstance(needed, tuple) and feels(policy):
        needed, offers = needed + len(PROPRIOCEPTION), offers.replace(" ", " and proprioception together ", 1)
    takes = _image_of(policy) or getattr(policy, "obs_size", needed)
    if takes != needed:
        found = f"images of the shape {takes}" if _image_of(policy) else f"{takes} numbers"
        raise TrainingError(f"the policy takes {found}, but the {offers} {needed}")


def _image_of(policy: Any) -> tuple[int, int, int] | None:
    """Return H, W, C of the images that a policy with convolutions takes; None for any other."""
    eyes = getattr(getattr(policy, "shape", None), "eyes", None)
    return None if eyes is None else eyes.image


def check_parts(seen: str, felt: bool, asked: str | tuple[str, ...]) -> None:
    """Raise `TrainingError` unless a policy that sees `seen`, and takes proprioception if `felt`, sees all parts of
    the observation that a config asks for."""
    if felt and seen in IMAGES:
        raise TrainingError(
            "policy=cnn sees images alone: leave proprioception out, or use policy=mlp, which takes it beside the codes"
            " of an encoder or the privileged observation"
        )
    known = ("privileged", "proprioception") if seen == PRIVILEGED else ("rgb", "mask", "proprioception")
    others = [part for part in asked if part not in known] if isinstance(asked, tuple) else []
    if others:
        raise TrainingError(f"a policy of {IN_WORDS[seen]} does not see {', '.join(others)}: leave that out")


def parts_of_codes(encoder: Encoder) -> tuple[str, ...]:
    """Return the parts of an observation that an encoder sees, see `thalweg.env.observation.PARTS`."""
    return tuple(encoder.inputs.split("+"))


def observation_of_run(images: bool, encoder: Encoder | None, chosen: str | None, begun: Any = None) -> str:
    """Return what the policy of a run sees: `FRAMES`, `PRIVILEGED` or one of `IMAGES`.

    `images` is whether it has convolutions, `chosen` the observation that was asked for, if any, `begun` the policy
    that the run begins with. Raises `TrainingError` for what does not go together.
    """
    if not images:
        expected = PRIVILEGED if encoder is None else FRAMES
        if chosen in IMAGES:
            raise TrainingError(f"the observation {chosen} is for policies with convolutions: set policy=cnn")
        if chosen is not None and chosen != expected:
            raise TrainingError(f"the observation {chosen} was asked for, but there is {IN_WORDS[expected]}")
        return expected
    if encoder is not None:
        raise TrainingError("policy=cnn sees images itself: leave the encoder out, or use policy=mlp")
    if chosen is None:
        found = FRAMES if begun is None else observation_of(begun)
        chosen = found if found in IMAGES else IMAGES[0]
    if chosen not in IMAGES:
        raise TrainingError(f"policy=cnn sees images, {' or '.join(IMAGES)}, not {IN_WORDS.get(chosen, chosen)}")
    return chosen
