"""`Imitation`: DAgger of a teacher that knows the map into a policy that sees frames, on many rivers."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from thalweg.algos.common.state import CPU
from thalweg.algos.imitation.config import ImitationConfig, Teacher
from thalweg.algos.imitation.student import ALGORITHM, Student
from thalweg.algos.policy.actions import Actions, actions_of
from thalweg.core import versions
from thalweg.core.compute.device import resolve_device
from thalweg.core.compute.torch_threads import default_torch_threads, torch_threads
from thalweg.core.config import parse_config, to_plain
from thalweg.core.seeds import compact_seeds, parse_seeds, refuse_unseen
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.moves import MOVE_OPTIONS
from thalweg.env.rivers.assignment import DrawnRivers
from thalweg.env.rivers.memory import bytes_of, check_all_fit, check_enough
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.spaces import action_space
from thalweg.env.task.bird_eye import COLUMNS, ROWS
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.render import RENDER_VERSION, compilation
from thalweg.render.records.randomisation import Randomisation
from thalweg.train.errors import TrainingError
from thalweg.train.folder.run_record import (
    RUN_FOLDER,
    device_identity,
    read_config,
    read_context,
    read_status,
    require_same,
)
from thalweg.train.imitation.frame_memory import check_frame_memory, copies_of_flights
from thalweg.train.imitation.gate import check_teacher, flown_by
from thalweg.train.imitation.student_trainer import begin_student
from thalweg.train.imitation.trainer import ImitationTrainer
from thalweg.train.river import announce_build, banks_version, print_once
from thalweg.train.run_in_folder import (
    RunResult,
    check_numbers,
    check_seconds,
    open_folder,
    result_of,
    train_to_end,
)
from thalweg.world import Level, Reach, World, level_named
from thalweg.world.generate.memory import free_bytes


@dataclass(frozen=True)
class Imitation:
    """An imitation on the rivers of some levels, or on a real river."""

    folder: Path
    """Folder of the run; an interrupted one is resumed."""
    steps: int
    """Steps of flight, all environments together."""
    seed: int = 0
    levels: tuple[str, ...] = ("Easy", "Medium", "Hard")
    world_seeds: Any = tuple(range(1000, 1064))
    """Seeds of rivers of each level, as `thalweg.core.seeds.parse_seeds` reads them; of the plants and hills of a real
    river, whose course does not depend on them."""
    river: Reach | None = None
    """Real river, in place of the levels."""
    num_envs: int = 32
    rivers_in_memory: int | None = None
    """Greatest number of rivers in memory; None derives it from the free memory."""
    settings: dict[str, Any] | None = None
    """Settings of `ImitationConfig` that differ from the defaults."""
    threads: int | None = None
    """Threads for learning; None: `OMP_NUM_THREADS`, or as many as the cores that this process may use."""
    checkpoint_seconds: float = 60.0
    """Least time between two checkpoints."""
    begin_with: Path | None = None
    """Folder of a run, or policy file, with whose network the student begins; it must be of the same kind."""
    device: str = "cpu"
    """Where frames are drawn and the student learns, see `thalweg.core.compute.device`; rules and teacher are on the
    CPU. A run is resumed on the kind of device that it began on."""

    def run(self, *, progress: bool = False) -> RunResult:
        """Train the student, or resume the run in the folder; of a finished run the result is returned.

        Raises, before anything is learnt, `AlgorithmError` for a wrong setting, or a policy of another kind to begin
        with; `WorldError` for a level or a river's file that is none; `ConfigError` for rivers that do not fit into the
        memory; `DeviceError` for a device that cannot be used; and `TrainingError` for frames that do not fit, other
        wrong arguments, the folder of another run, a file of a river that has changed, or a teacher that fails its
        gate. Raises `NotFiniteError` for a loss that is not finite.
        """
        return self._with_whole_numbers()._run(progress)

    def _with_whole_numbers(self) -> "Imitation":
        """Return the same with Python's integers, which files can hold; raises `TrainingError` for other numbers."""
        check_seconds(checkpoint_seconds=self.checkpoint_seconds)
        numbers = {"steps": (self.steps, 1), "num_envs": (self.num_envs, 1), "seed": (self.seed, 0)}
        for name in ("threads", "rivers_in_memory"):
            if (number := getattr(self, name)) is not None:
                numbers[name] = (number, 1)
        return replace(self, **dict(zip(numbers, check_numbers(**numbers), strict=True)))

    def _run(self, progress: bool) -> RunResult:
        config = parse_config(ImitationConfig, dict(self.settings or {}), "settings")
        grounds = [level_named(name) for name in self.levels] if self.river is None else [self.river]
        seeds = parse_seeds(self.world_seeds, "world_seeds", TrainingError)
        self._check(grounds, seeds)
        threads = default_torch_threads() if self.threads is None else self.threads
        device = torch.device(resolve_device(self.device))
        rules = self._rules(config)
        identity = self._identity(config, rules, grounds, seeds)
        river = identity["context"].get("river", {})
        RUN_FOLDER.require_same_file(self.folder, read_context(self.folder).get("river") or {}, river)
        identity |= device_identity(device.type)
        with torch_threads(1):
            student = self.new_student(config, actions_of(action_space(rules.action)), identity["context"], device)
        if self.begin_with is not None:
            identity["begin_with"] = begin_student(student, self.begin_with)
        new = (existing := read_config(self.folder)) is None
        if existing is not None:
            require_same(self.folder, existing["run"], identity)
        if read_status(self.folder).get("state") != "finished":
            check_frame_memory(config, self.num_envs, copies_of_flights(config))
        if new:
            with RUN_FOLDER.locked(self.folder):  # one that cannot be written is refused before the teacher flies
                pass
        compilation.begin()
        rivers = self._rivers(grounds, seeds)
        env = RiverVectorEnv(rivers, self.num_envs, rules, device=str(device))
        try:
            if new:  # settings that the gate refuses can be corrected in the same folder
                self._pass_gate(grounds, self._seeds_of_gate(seeds, config), rules, config.teacher)
            status = open_folder(self.folder, identity, threads, device=str(device))
            if status.get("state") == "finished":
                return result_of(self.folder, status, resumed_from=None, already_finished=True)
            if isinstance(env.rivers, DrawnRivers):
                print_once(env.rivers.pool.description)
            if not new and not status:
                self._pass_gate(grounds, self._seeds_of_gate(seeds, config), rules, config.teacher)
            trainer = ImitationTrainer(env, student, self.steps, self.seed, threads)
            return train_to_end(
                self.folder, trainer, identity, progress=progress, checkpoint_seconds=self.checkpoint_seconds
            )
        finally:
            env.close()

    def new_student(
        self, config: ImitationConfig, actions: Actions, context: dict[str, Any], device: torch.device = CPU
    ) -> Student:
        """Return the student before it has learnt anything; `context` is kept in its policy's file."""
        return Student(config, actions, MOVE_OPTIONS, (len(FEATURES), ROWS * COLUMNS), self.seed, context, device)

    def _rivers(self, grounds: Sequence[Level | Reach], seeds: Sequence[int]) -> RiverList:
        """Return the rivers of the levels, or the real river with the plants and hills of each seed, all of them in
        memory; raises `ConfigError`, once one of them is built, if their valleys do not fit."""
        if self.river is None:
            return RiverList.of_levels([(level, seeds) for level in grounds], self.rivers_in_memory)  # pyright: ignore[reportArgumentType]
        worlds: list[World] = []
        for seed in seeds:
            announce_build(self.river, seed)
            worlds.append(self.river.build(seed))
            if len(worlds) == 1 and len(seeds) > 1:
                check_all_fit(len(seeds), bytes_of(worlds[0]), free_bytes())
        return RiverList(worlds, self.rivers_in_memory)

    def _seeds_of_gate(self, seeds: Sequence[int], config: ImitationConfig) -> Sequence[int]:
        """Return the seeds of the rivers of the gate, or of as many starts on a real river."""
        return seeds[: config.gate_rivers] if self.river is None else range(config.gate_rivers)

    def _pass_gate(
        self, grounds: Sequence[Level | Reach], seeds: Sequence[int], rules: EnvConfig, teacher: Teacher
    ) -> None:
        """Let the teacher fly rivers of each level, or starts on a real river; raises `TrainingError` if it fails."""
        for ground in grounds:
            if seeds:
                one, where = ("river", "of") if isinstance(ground, Level) else ("start", "on")
                what = f"{len(seeds)} {one}{'s' if len(seeds) > 1 else ''} {where} {ground.name}"
                print_once(f"the teacher flies {what}, before anything is learnt from it")
            check_teacher(ground, seeds, rules, flown_by(teacher))

    def _check(self, grounds: Sequence[Level | Reach], seeds: Sequence[int]) -> None:
        """Raise `TrainingError` for levels that are missing or given twice, for no seeds, and for unseen rivers of
        levels; `WorldError` for a file from which no river can be made; `ConfigError` for too few rivers in memory."""
        if self.river is not None:
            self.river.check()
        names = [ground.name for ground in grounds]
        if not names or len(set(names)) < len(names):
            raise TrainingError(f"levels must be at least one, each once, not {', '.join(names) or 'none'}")
        if not seeds:
            raise TrainingError("world_seeds must be at least one seed, such as 1000:1064")
        if self.river is None:
            refuse_unseen(seeds, "world_seeds", TrainingError)
        if self.rivers_in_memory is not None:
            check_enough(len(grounds) * len(seeds), self.rivers_in_memory, self.num_envs)

    def _rules(self, config: ImitationConfig) -> EnvConfig:
        """Return what the environments draw."""
        looks = Randomisation() if config.varied_looks else None
        return EnvConfig(observation=config.observation, randomisation=looks, quality=config.quality)

    def _identity(
        self, config: ImitationConfig, rules: EnvConfig, grounds: Sequence[Level | Reach], seeds: Sequence[int]
    ) -> dict[str, Any]:
        """Return what distinguishes the run from others, as config.yaml has it."""
        levels = {"levels": [ground.name for ground in grounds]}
        context = {
            **(levels if self.river is None else {"river": self.river.as_data()}),
            **banks_version(grounds),
            "world_seeds": compact_seeds(seeds),
            "rivers": "episode",
            "observation": config.observation,
            "render_version": RENDER_VERSION,
            "imitation_version": versions.IMITATION,
            "env": rules.as_data(),
        }
        return {
            "algorithm": ALGORITHM,
            "preset": "default",
            "config": to_plain(config),
            "steps": self.steps,
            "seed": self.seed,
            "num_envs": self.num_envs,
            "context": context,
        }
