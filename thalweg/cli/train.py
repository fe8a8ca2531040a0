"""`thalweg train`: training of a policy on a river, from codes of an encoder, images or the privileged observation."""

import json
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from thalweg.cli.command import Command, after_checkpoint
from thalweg.cli.forces import STILL, Forces
from thalweg.cli.options import DEFAULT_LEVEL, NO_FILE, Plugins, River, UsageError, checked_task, settings_from
from thalweg.cli.run_result import print_result
from thalweg.cli.settings_help import HELP, print_settings
from thalweg.cli.views import AS_IN_LEVELS, Views
from thalweg.core.config import to_plain
from thalweg.core.seeds import parse_seeds

if TYPE_CHECKING:
    from thalweg.algos.registry import Entry
    from thalweg.world import Reach


@dataclass(frozen=True)
class Train(Command):
    """Train a policy on a river from frames or from the privileged observation; the same command resumes."""

    out: Path | None = None
    """Folder of the run; needed except with --set help."""
    algorithm: str = "FOCOPS"
    """PPO, PPOLag, FOCOPS, P3O, OnCRPO, CPO, CUP, DDPGLag, TD3Lag, SACLag, CCEPETS or SafeLOOP; also as `train PPO`."""
    level: tuple[str, ...] = ()
    """Easy, Medium or Hard, or several of them. Medium by default, for the boat Medium-Deep."""
    world_seeds: tuple[str, ...] = ()
    """Seeds of rivers of each level, such as 0 5 1000:1016 (1016 excluded); by default that of its fixed river."""
    rivers: Literal["auto", "fixed", "episode"] = "auto"
    """`fixed` in each environment, or another in each `episode`; `auto`: if there are more than environments."""
    rivers_in_memory: int | None = None
    """Greatest number of rivers in memory, if they change; by default as many as fit into half of the free memory."""
    river: River = NO_FILE
    task: str = "River"
    """River, that of the paper, or Swimmers, Nests, RacingLine or Portage, in which each step may have a cost."""
    hard: bool = False
    """End an episode at the first cost of the task; not for River."""
    forces: Forces = STILL
    views: Views = AS_IN_LEVELS
    steps: int = 200_000
    """Steps of training, over all environments together."""
    seed: int = 0
    """Seed of all random numbers in the training."""
    num_envs: int = 16
    """Number of environments that step together."""
    vehicle: Literal["uav", "asv"] = "uav"
    """`uav` flies; `asv` is a boat, for Easy, Medium-Deep and Hard-Deep."""
    observation: Literal["frames", "privileged", "rgb+mask", "rgb", "mask"] = "frames"
    """`frames` through an encoder; `privileged`: what an ideal eye tells; the others: images, for --set policy=cnn."""
    proprioception: bool = False
    """Beside codes or the privileged observation, also height, velocities, yaw rate and the last action."""
    encoder: Path | None = None
    """`default`, `geometry` (where banks are), `geometry-tasks` (objects too), a file or folder of `encoder train`."""
    preset: str = "default"
    """`default`, or `paper` for the settings of the study, as far as they are known."""
    set: tuple[str, ...] = ()
    """Settings on top of the preset, such as learning_rate=1e-4; `--set help` lists them with their meanings."""
    threads: int | None = None
    """Threads for acting and learning; by default 1 on-policy, 2 for others, all for images, within OMP_NUM_THREADS."""
    begin_with: Path | None = None
    """Run folder or policy file of the policy that the run starts from, `packaged` or `packaged-rgb`."""
    device: str = "cpu"
    """Where to train: cpu, cuda, cuda:1, or auto, which uses a GPU if one works."""
    graphs: bool = False
    """Record the gradient steps of DDPGLag, TD3Lag and SACLag as CUDA graphs and replay them."""
    plugin: Plugins = ()

    resumes = True

    def after_interrupt(self) -> str:
        return after_checkpoint(self.out)

    def run(self) -> int:
        from thalweg.algos.registry import algorithm_named
        from thalweg.bench.packaged import policy_path
        from thalweg.env import EnvConfig
        from thalweg.train.river import RiverTraining, load_compatible_encoder

        algorithm = algorithm_named(self.algorithm)
        if self.set == HELP:
            print_settings(algorithm.name, algorithm.configure({}, self.preset, self.num_envs))
            return 0
        if self.out is None:
            raise UsageError(f"--out is missing: name the folder of the run, such as --out runs/{algorithm.name}")
        settings = settings_from(self.set)
        river = self.river.reach("--level", self.level, levels_have_banks=True) or self._levels
        seeds = parse_seeds(self.world_seeds, "--world-seeds", UsageError)
        rules = EnvConfig(task=checked_task(self.task), hard=self.hard, vehicle=self.vehicle)
        images = settings.get("policy") == "cnn"
        rules = self.forces.options().applied(rules)
        rules = self.views.applied(rules, drawn=images or self.observation != "privileged")
        training = RiverTraining(
            river, self.num_envs, seeds, rules, rivers=self.rivers, rivers_in_memory=self.rivers_in_memory
        )
        self._check_settings(algorithm, settings)
        self._warn_of_limit(algorithm, settings, river)
        if (images or self.observation != "frames") and self.encoder is not None:
            takes_none = "policy=cnn" if images else f"--observation {self.observation}"
            raise UsageError(f"{takes_none} takes no encoder: leave --encoder {self.encoder} out")
        coded = self.observation == "frames" and not images
        result = training.train(
            algorithm.name,
            load_compatible_encoder(self.encoder, self.device) if coded else None,
            observation=None if self.observation == "frames" else self.observation,
            proprioception=self.proprioception,
            steps=self.steps,
            seed=self.seed,
            folder=self.out,
            settings=settings or None,
            preset=self.preset,
            threads=self.threads,
            device=self.device,
            begin_with=None if self.begin_with is None else policy_path(str(self.begin_with)),
            graphs=self.graphs,
        )
        plugins = [word for file in self.plugin for word in ("--plugin", str(file))]
        print_result(result, [*self._where(seeds), *plugins])
        return 0

    def _warn_of_limit(self, algorithm: "Entry", settings: dict[str, Any], river: "Reach | tuple[str, ...]") -> None:
        """Warn of a cost limit below the oracle's safest point on a level; no oracle flew files and the hard mode."""
        from thalweg.bench.fronts.attainable import warn_of_limits
        from thalweg.env.tasks import PAPER_TASK
        from thalweg.world import level_named

        if self.task == PAPER_TASK or self.hard or not isinstance(river, tuple):
            return
        config = algorithm.configure(settings, self.preset, self.num_envs)
        warn_of_limits(self.task, ((algorithm.name, level_named(name).base_name, config) for name in river))

    @property
    def _levels(self) -> tuple[str, ...]:
        """Names of the levels, with their banks."""
        return tuple(self.river.on_banks(level) for level in self.level or (DEFAULT_LEVEL[self.vehicle],))

    def _where(self, seeds: Sequence[int]) -> list[str]:
        """Return the options of an evaluation: the river of the run, unseen rivers if it had several, the encoder."""
        encoder = ["--encoder", str(self.encoder)] if self.encoder else []
        encoder += ["--vehicle", self.vehicle] if self.vehicle != "uav" else []
        if words := self.river.words():
            return [*words, *(["--world-seed", str(seeds[0])] if seeds else []), *encoder]
        levels = ["--levels", *self._levels] if self.level or self.river.banks else []
        if len(seeds) == 1:
            return [*(levels or ["--levels", DEFAULT_LEVEL[self.vehicle]]), "--world-seeds", str(seeds[0]), *encoder]
        return [*levels, *(["--unseen"] if seeds else []), *encoder]

    def _check_settings(self, algorithm: "Entry", settings: dict[str, Any]) -> None:
        """Raise `UsageError`, repeating what --set was given, for a setting that the algorithm does not accept."""
        from thalweg.algos import AlgorithmError

        algorithm.configure({}, self.preset, self.num_envs)  # an error of the preset is not one of --set
        try:
            algorithm.configure(settings, self.preset, self.num_envs)
        except AlgorithmError as error:
            default = algorithm.configure({}, self.preset, self.num_envs)
            wrong = [name for name in settings if str(error).startswith(f"{name} must ")]
            values = [json.dumps(to_plain(getattr(default, name))) for name in wrong]
            to_try = f"; such as --set {wrong[0]}={values[0]}" if wrong else ""
            raise UsageError(f"--set {shlex.join(self.set)}: {error}{to_try}") from error
