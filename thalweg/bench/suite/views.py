"""Views of the policies of a suite in training, and their kind of actions, as data."""

from dataclasses import asdict, field, fields
from typing import Any

from thalweg.bench.csv_files import ResultsError
from thalweg.core.config import frozen_config, to_plain
from thalweg.env import EnvConfig
from thalweg.env.config import ActionSpace
from thalweg.render import Camera
from thalweg.render.records.quality import Quality


@frozen_config(ResultsError)
class TrainingViews:
    """Camera, quality and looks of the frames in training, and actions; by default those of the levels.

    Flights are seen through the same camera, in the full quality and under the look of their condition.
    """

    camera: Camera = field(default_factory=Camera)
    """Size and optics; encoders take frames of their own size."""
    quality: Quality = "full"
    """Quality of the frames in training."""
    randomise: bool = False
    """Whether light, water, plants, camera angles, noise and clouds vary in training."""
    action: ActionSpace = "multidiscrete"
    """Kind of actions, also of the flights; inertial dynamics have continuous ones in any case."""

    def in_training(self, rules: EnvConfig) -> EnvConfig:
        """Return the rules of flights with what is seen in training."""
        return rules.with_options(camera=self.camera, quality=self.quality, randomisation=self.randomise)

    def as_data(self) -> dict[str, Any]:
        """Return plain data of what differs from the defaults; empty if nothing does."""
        usual = TrainingViews()
        changed = {each.name: getattr(self, each.name) for each in fields(self)}
        data = {name: to_plain(value) for name, value in changed.items() if value != getattr(usual, name)}
        return data | ({"camera": self.camera.as_data()} if "camera" in data else {})


def views_in_words(data: dict[str, Any]) -> str:
    """Return a sentence about the `as_data` of views; empty for those of the levels."""
    camera = asdict(Camera()) | data.get("camera", {})
    seen = (
        f"a camera of {camera['height_px']} x {camera['width_px']} pixels, a field of view of {camera['fov_deg']:g}"
        f" degrees and a pitch of {camera['pitch_deg']:g}"
    )
    seen += f" behind a {camera['lens']['model']} lens" if camera.get("lens") else ""
    words = [
        seen if "camera" in data else "",
        "varied looks" if data.get("randomise") else "",
        "fast frames" if data.get("quality") == "fast" else "",
        "continuous actions" if data.get("action") == "continuous" else "",
    ]
    words = [word for word in words if word]
    return f"Policies were trained with {', '.join(words)}." if words else ""
