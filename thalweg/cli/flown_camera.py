"""The camera that `thalweg evaluate` flies a policy through: that of its training, or another one by --camera."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thalweg.cli.options import UsageError
from thalweg.cli.views import camera_settings

if TYPE_CHECKING:
    from thalweg.bench.evaluate.baselines import Policy, RecurrentPolicy
    from thalweg.render import Camera


def flown_camera(policy: "Policy | RecurrentPolicy", named: str, texts: tuple[str, ...]) -> "Camera":
    """Return the camera of an evaluation: that of the policy's training with the settings of --camera, or the camera of
    a calibration, whose images are cut to the size of the policy's frames.

    `named`: what the policy was given as. What is not given stays as in the training. Raises `UsageError` for a policy
    that sees no frames, frames of another size than a policy takes, and another field of view behind the lens of the
    training; and the errors of `camera_from`.
    """
    from thalweg.bench.evaluate.baselines import DRAWN, sight_of
    from thalweg.bench.evaluate.functions import FunctionPolicy
    from thalweg.train.observations import camera_of

    trained = camera_of(policy)
    if not texts:
        return trained
    file, settings = camera_settings(texts)
    if (sight := sight_of(policy)) not in DRAWN:
        raise UsageError(f"{named} sees no frames: leave --camera {' '.join(texts)} out")
    camera = _changed(trained, named, file, settings)
    needed, found = (f"{each.height_px} x {each.width_px}" for each in (trained, camera))
    any_size = sight == "images" and isinstance(policy, FunctionPolicy)  # a function may take what it is given
    if found != needed and not any_size:
        raise UsageError(
            f"{named} sees frames of {needed} pixels (height x width), not {found}: leave height_px and width_px out of"
            " --camera"
        )
    return camera


def camera_in_words(policy: "Policy | RecurrentPolicy", camera: "Camera", texts: tuple[str, ...]) -> str:
    """Return what names of results say of `camera`, the one that is flown: of a file its name and the begin of its
    content's hash, and the settings of --camera by their names; nothing for the camera of the policy's training."""
    from thalweg.core.cache import file_hash
    from thalweg.train.observations import camera_of

    if camera == camera_of(policy):
        return ""
    file, settings = camera_settings(texts)
    calibration = [] if file is None else [file.name, file_hash(file)[:8]]
    return " ".join(["camera", *calibration, *(f"{name}={settings[name]}" for name in sorted(settings))])


def _changed(trained: "Camera", named: str, file: Path | None, settings: dict[str, Any]) -> "Camera":
    """Return the camera of the training with settings in place of its own, or that of the file of a calibration."""
    from thalweg.render.records.calibration import camera_of_calibration

    if file is not None:
        kept = {name: getattr(trained, name) for name in ("height_px", "width_px", "pitch_deg", "near_m")}
        return camera_of_calibration(file, **{**kept, **settings})
    if trained.lens is not None and "fov_deg" in settings:
        raise UsageError(
            f"{named} was trained behind a lens, which no other field of view fits: leave fov_deg={settings['fov_deg']}"
            " out of --camera, or give the file of a calibration"
        )
    return replace(trained, **settings)
