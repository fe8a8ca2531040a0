"""Options for what policies see, and for their actions, that several commands share."""

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import FlagCreatePairsOff, arg

from thalweg.cli.options import UsageError, settings_from

if TYPE_CHECKING:
    from thalweg.bench.suite.views import TrainingViews
    from thalweg.env import EnvConfig
    from thalweg.render import Camera


@dataclass(frozen=True)
class TrainedViews:
    """Options for the frames and the actions of a training. What is not given is as in the levels."""

    camera: tuple[str, ...] = ()
    """Settings of the camera, such as fov_deg=75 pitch_deg=10, and before them the YAML file of a calibration."""
    quality: Literal["full", "fast"] | None = None
    """Quality of frames, by default full; `fast` reflects only the sky, filters less, and interpolates the ground."""
    randomise: Annotated[bool, FlagCreatePairsOff] = False
    """Vary light, water, plants, camera angles, noise and clouds from episode to episode."""
    action: Literal["multidiscrete", "continuous"] | None = None
    """Kind of actions: `multidiscrete`, or `continuous`, which inertial dynamics need; by default what these need."""

    def applied(self, rules: "EnvConfig", *, drawn: bool) -> "EnvConfig":
        """Return rules with these options; `drawn`: whether frames are.

        Raises `UsageError` for options that do not go together, and `RenderError` for a camera that cannot be.
        """
        asked = {"camera": bool(self.camera), "quality": self.quality is not None, "randomise": self.randomise}
        if not drawn and (of_frames := [f"--{name}" for name, given in asked.items() if given]):
            raise UsageError(f"the privileged observation draws no frames: leave {' and '.join(of_frames)} out")
        if self.action == "multidiscrete" and rules.dynamics == "inertial":
            raise UsageError("--dynamics inertial commands velocities: leave --action multidiscrete out")
        changes: dict[str, Any] = {"randomisation": self.randomise}
        if self.quality is not None:
            changes["quality"] = self.quality
        if self.camera:
            changes["camera"] = camera_from(self.camera)
        if self.action is not None:
            changes["action"] = self.action
        return rules.with_options(**changes)

    def replacing(self, usual: "TrainingViews") -> "TrainingViews":
        """Return the views of a suite, with these options where they are given; raises the errors of `camera_from`."""
        given: dict[str, Any] = {"camera": camera_from(self.camera)} if self.camera else {}
        given |= {"quality": self.quality} if self.quality is not None else {}
        given |= {"randomise": True} if self.randomise else {}
        given |= {"action": self.action} if self.action is not None else {}
        return replace(usual, **given)


Views = Annotated[TrainedViews, arg(name="")]
"""Its options stand among those of the command."""
AS_IN_LEVELS = TrainedViews()


def camera_from(texts: tuple[str, ...], side_px: int = 128) -> "Camera":
    """Return the camera of the option --camera: settings, after the file of a calibration if there is one.

    `side_px`: height and width where neither the settings nor a file have them. Raises `UsageError` for an unknown
    setting, and `RenderError` for values that are not allowed, which names them, and for a calibration that cannot be
    used.
    """
    from thalweg.render import Camera
    from thalweg.render.records.calibration import camera_of_calibration

    file, settings = camera_settings(texts)
    if file is None:
        return Camera(**{"height_px": side_px, "width_px": side_px, **settings})
    return camera_of_calibration(file, **settings)


def camera_settings(texts: tuple[str, ...]) -> tuple[Path | None, dict[str, Any]]:
    """Return the file of a calibration, if there is one, and the settings of the option --camera; raises `UsageError`
    for an unknown setting."""
    from thalweg.core.suggestion import did_you_mean
    from thalweg.render import Camera

    files = [text for text in texts if "=" not in text]
    settings = settings_from([text for text in texts if "=" in text], "--camera")
    known = [field.name for field in fields(Camera) if field.name != "lens"]  # which the file of a calibration has
    for name in settings:
        if name not in known:
            near = did_you_mean(name, known)
            raise UsageError(f"--camera has no setting {name!r}{near}; known: {', '.join(known)}")
    if len(files) > 1:
        raise UsageError(f"--camera takes one file of a calibration, not {' and '.join(files)}")
    return Path(files[0]) if files else None, settings
