"""`thalweg imitate`: a policy that sees frames, taught by a pilot that knows the map, on many rivers."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from thalweg.cli.options import UsageError, settings_from
from thalweg.cli.run_result import print_result
from thalweg.core.seeds import parse_seeds


@dataclass(frozen=True)
class Imitate:
    """Teach a policy that sees frames by a pilot that knows the map (DAgger); the same command resumes."""

    out: Path
    """Folder of the run."""
    levels: tuple[str, ...] = ("Easy", "Medium", "Hard")
    """Levels of the rivers that are flown."""
    world_seeds: tuple[str, ...] = ("1000:1064",)
    """Seeds of rivers of each level, such as 1000:1256 (1256 excluded)."""
    observation: Literal["rgb+mask", "rgb", "mask"] = "rgb+mask"
    """What the policy sees: the image and the water mask, or one of them."""
    steps: int = 1_000_000
    """Steps of flight, over all environments together."""
    seed: int = 0
    """Seed of all random numbers."""
    num_envs: int = 32
    """Number of environments that step together."""
    rivers_in_memory: int | None = None
    """Greatest number of rivers in memory; by default as many as fit into half of the free memory."""
    set: tuple[str, ...] = ()
    """Settings, such as learning_rate=5e-4; an unknown one is an error that lists the known."""
    threads: int | None = None
    """Threads for learning; by default as many as there are processors, within OMP_NUM_THREADS."""
    device: str = "cpu"
    """Where to draw frames and learn: cpu, cuda, cuda:1, or auto, which uses a GPU if one works."""

    def run(self) -> int:
        from thalweg.train.imitation.imitate import Imitation

        settings = settings_from(self.set)
        if "observation" in settings:
            raise UsageError("--set observation: give --observation instead")
        imitation = Imitation(
            self.out,
            steps=self.steps,
            seed=self.seed,
            levels=self.levels,
            world_seeds=parse_seeds(self.world_seeds, "--world-seeds", UsageError),
            num_envs=self.num_envs,
            rivers_in_memory=self.rivers_in_memory,
            settings={**settings, "observation": self.observation},
            threads=self.threads,
            device=self.device,
        )
        result = imitation.run(progress=True)
        print_result(result, ["--levels", *self.levels, "--unseen"])
        return 0
