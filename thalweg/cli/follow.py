"""`thalweg follow`: shows what a policy would do over a video."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from thalweg.cli.command import Command
from thalweg.cli.flight_options import policy_name
from thalweg.cli.options import Plugins, UsageError, check_file


@dataclass(frozen=True)
class Follow(Command):
    """Show over a video the water that is found in it, and the moves that a policy would choose."""

    video: Positional[Path]
    """Video to read; one frame is used for each step of the policy, four a second unless it was trained otherwise."""
    policy: str = "packaged"
    """A run's folder, a policy file, `packaged`, or `packaged-rgb`."""
    segmenter: Path | None = None
    """File of a finder of water, which `encoder train --target water` writes; by default that of the package."""
    out: Path = Path("overlay.mp4")
    """Film to write, .mp4; an existing one is replaced."""
    plugin: Plugins = ()

    def run(self) -> int:
        from thalweg.cli.evaluate import load_named_policy
        from thalweg.deploy.follow import Follower, follow
        from thalweg.encoder.water import PACKAGED_WATER, load_segmenter

        check_file("--out", self.out, ".mp4")
        if self.out.exists() and self.video.exists() and self.out.samefile(self.video):
            raise UsageError(f"--out {self.out} is the video itself: name another file")
        follower = Follower(
            load_named_policy(self.policy, trained=True), load_segmenter(self.segmenter or PACKAGED_WATER)
        )
        taken = follow(self.video, self.out, follower, policy_name(self.policy))
        print(f"{self.out}: {len(taken)} steps of {policy_name(self.policy)} over {self.video.name}")
        return 0
