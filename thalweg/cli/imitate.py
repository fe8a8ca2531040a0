"""`thalweg imitate`: a policy that sees frames, taught by a pilot that knows the map, on many rivers."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from thalweg.cli.command import Command, after_checkpoint
from thalweg.cli.options import NO_FILE, River, UsageError, settings_from
from thalweg.cli.run_result import print_result
from thalweg.cli.settings_help import HELP, print_settings
from thalweg.core.seeds import parse_seeds

REACH_SEEDS = (0,)
"""Seeds of the plants and hills of a real river, unless others are given."""


@dataclass(frozen=True)
class Imitate(Command):
    """Teach a policy that sees frames by a pilot that knows the map (DAgger); the same command resumes."""

    out: Path | None = None
    """Folder of the run; needed except with --set help."""
    levels: tuple[str, ...] = ()
    """Levels of the rivers that are flown; by default Easy, Medium and Hard."""
    world_seeds: tuple[str, ...] = ()
    """Seeds of each level's rivers, by default 1000:1064; with --river, seeds of its plants and hills, by default 0."""
    river: River = NO_FILE
    observation: Literal["rgb+mask", "rgb", "mask"] = "rgb+mask"
    """What the policy sees: the image and the water mask, or one of them."""
    recordings: tuple[Path, ...] = ()
    """Folders that `thalweg record` wrote, to learn from in place of a pilot (behaviour cloning): nothing is flown."""
    steps: int = 1_000_000
    """Steps of flight of all environments; with --recordings, recorded steps, counted each time they are drawn."""
    seed: int = 0
    """Seed of all random numbers."""
    num_envs: int = 32
    """Number of environments that step together; with --recordings, sequences for each update."""
    rivers_in_memory: int | None = None
    """Greatest number of rivers in memory; by default as many as fit into half of the free memory."""
    set: tuple[str, ...] = ()
    """Settings, such as learning_rate=5e-4; `--set help` lists them with their meanings."""
    threads: int | None = None
    """Threads for learning; by default OMP_NUM_THREADS, or as many as the cores that the process may use."""
    begin_with: Path | None = None
    """Run folder or policy file of the policy that the student starts from, `packaged` or `packaged-rgb`."""
    device: str = "cpu"
    """Where to draw frames and learn: cpu, cuda, cuda:1, or auto, which uses a GPU if one works."""

    resumes = True

    def after_interrupt(self) -> str:
        return after_checkpoint(self.out)

    def run(self) -> int:
        from thalweg.algos.imitation.config import ImitationConfig
        from thalweg.train.imitation.imitate import Imitation

        if self.set == HELP:
            print_settings("imitate", ImitationConfig(), without=("observation",))
            return 0
        if self.out is None:
            raise UsageError("--out is missing: name the folder of the run, such as --out runs/student")
        settings = settings_from(self.set)
        if "observation" in settings:
            raise UsageError("--set observation: give --observation instead")
        if self.recordings:
            return self._clone(settings)
        reach = self.river.reach("--levels", self.levels, levels_have_banks=True)
        levels = Imitation.levels if reach else tuple(map(self.river.on_banks, self.levels or Imitation.levels))
        seeds = parse_seeds(self.world_seeds, "--world-seeds", UsageError)
        imitation = Imitation(
            self.out,
            steps=self.steps,
            seed=self.seed,
            levels=levels,
            world_seeds=seeds or (Imitation.world_seeds if reach is None else REACH_SEEDS),
            river=reach,
            num_envs=self.num_envs,
            rivers_in_memory=self.rivers_in_memory,
            settings={**settings, "observation": self.observation},
            threads=self.threads,
            begin_with=self._begun,
            device=self.device,
        )
        result = imitation.run(progress=True)
        print_result(result, ["--levels", *levels, "--unseen"] if reach is None else self.river.words())
        return 0

    @property
    def _begun(self) -> Path | None:
        """File or folder of the policy to start from."""
        from thalweg.bench.packaged import policy_path

        return None if self.begin_with is None else policy_path(str(self.begin_with))

    def _clone(self, settings: dict[str, Any]) -> int:
        """Learn from recordings; raises `UsageError` for options of flights."""
        from thalweg.train.errors import TrainingError
        from thalweg.train.imitation.cloning import Cloning
        from thalweg.train.imitation.imitate import Imitation
        from thalweg.train.run_in_folder import check_numbers

        for name in ("levels", "world_seeds", "river", "rivers_in_memory"):
            if getattr(self, name) != getattr(type(self), name):
                raise UsageError(f"--{name.replace('_', '-')} does not go with --recordings, where nothing is flown")
        check_numbers(num_envs=(self.num_envs, 1))  # by the name of the option, which is the number of sequences
        cloning = Cloning(
            self.out or Path(),
            self.recordings,
            steps=self.steps,
            seed=self.seed,
            sequences=self.num_envs,
            settings={**settings, "observation": self.observation},
            threads=self.threads,
            begin_with=self._begun,
            device=self.device,
        )
        try:
            result = cloning.run(progress=True)
        except TrainingError as error:
            raise TrainingError(re.sub(r"^sequences (?=must|=)", "num_envs ", str(error))) from error
        print_result(result, ["--levels", *Imitation.levels, "--unseen"])
        return 0
