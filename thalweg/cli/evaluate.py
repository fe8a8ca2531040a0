"""`thalweg evaluate`: evaluation of a policy from the fixed starts of levels, or on a real river."""

import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import FlagCreatePairsOff, Positional

from thalweg.cli.command import Command
from thalweg.cli.forces import STILL, Forces
from thalweg.cli.options import NO_FILE, Plugins, River, UsageError, check_file, checked_task
from thalweg.core.seeds import parse_seeds
from thalweg.core.suggestion import did_you_mean

if TYPE_CHECKING:
    from thalweg.bench.evaluate.baselines import Policy, RecurrentPolicy
    from thalweg.bench.evaluate.course import Course, EvaluationConfig
    from thalweg.encoder import Encoder
    from thalweg.env import EnvConfig
    from thalweg.render import Camera
    from thalweg.world import Reach


@dataclass(frozen=True)
class Evaluate(Command):
    """Evaluate a policy from the fixed list of starts of each river, with the kind of actions that it has."""

    policy: Positional[str]
    """A run's folder, a policy file, a function (fly.py:fly), packaged, packaged-rgb, or a baseline such as pilot."""
    levels: tuple[str, ...] = ()
    """Levels to fly on; by default Easy, Medium and Hard, for the boat Easy, Medium-Deep and Hard-Deep."""
    river: River = NO_FILE
    world_seed: int | None = None
    """Seed of the plants and hills; only with --river."""
    world_seeds: tuple[str, ...] = ()
    """Seeds of rivers of each level, such as 0 5 1000:1016 (1016 excluded); by default that of its fixed river."""
    vehicle: Literal["uav", "asv"] | None = None
    """`uav` flies; `asv` is a boat, for Easy, Medium-Deep and Hard-Deep. By default that of the policy's training."""
    episodes: int = 20
    """Number of starts per river, each flown once."""
    starts_seed: int = 0
    """Seed of the list of starts."""
    seed: int = 0
    """Seed for action sampling."""
    deterministic: bool = False
    """Take the most probable action instead of sampling."""
    task: str | None = None
    """River, Swimmers, Nests, RacingLine or Portage; by default that on which the policy was trained."""
    hard: Annotated[bool, FlagCreatePairsOff] = False
    """End an episode at the first cost of the task; not for River. Policies that were trained so fly so without it."""
    no_hard: Annotated[bool, FlagCreatePairsOff] = False
    """Let episodes go on after a cost of the task, also those of a policy that was trained with --hard."""
    forces: Forces = STILL
    quality: Literal["full", "fast"] = "full"
    """Quality of the frames that policies see; the names of results with `fast` say so."""
    camera: tuple[str, ...] = ()
    """Calibration and settings of another camera than that of the training, such as lens.yaml pitch_deg=10."""
    randomise: bool = False
    """Vary the appearance of each start, the same for all policies; the names of results say so."""
    sample: bool = False
    """Sample actions, also of policies that always take the most probable one, such as packaged ones."""
    unseen: bool = False
    """Fly on unseen rivers of the levels, on which nothing is trained: one start on each, one river per episode."""
    shield: bool = False
    """Replace moves that would leave the water remembered from past masks; results say so, and are apart."""
    encoder: Path | None = None
    """`default`, `geometry`, `geometry-tasks`, a file or a run's folder, for policies of codes; usually their own."""
    out: Path | None = None
    """Also write one row per episode to this .csv file, replacing it."""
    device: str = "cpu"
    """Where to render and encode: cpu, cuda, cuda:1, or auto, which uses a GPU if one works."""
    plugin: Plugins = ()

    def config_for(self, policy: "Policy | RecurrentPolicy") -> "EvaluationConfig":
        """Return the config of the flights of a policy: task, hard mode, vehicle and forces that are not given are
        those that it was trained with; River has no hard mode. Raises `UsageError` and `ConfigError`."""
        from thalweg.bench.evaluate.course import EvaluationConfig
        from thalweg.cli.flown_camera import flown_camera
        from thalweg.env import EnvConfig
        from thalweg.env.tasks import PAPER_TASK
        from thalweg.train.observations import action_of, flies_hard, forces_of, task_of, vehicle_of

        task = checked_task(self.task or task_of(policy))
        inherited = task != PAPER_TASK and not self.no_hard and flies_hard(policy)
        rules = EnvConfig(
            observation="none",
            task=task,
            hard=self.hard or inherited,
            vehicle=self.vehicle or vehicle_of(policy),
            action=action_of(policy),
            camera=flown_camera(policy, self.policy, self.camera),
        )
        rules = self.forces.options(forces_of(policy)).applied(rules)
        return EvaluationConfig(self.episodes, self.starts_seed, self.deterministic, rules)

    @property
    def seeds(self) -> tuple[int, ...]:
        """The chosen seeds of rivers; raises `UsageError` for anything that is not a seed."""
        return parse_seeds(self.world_seeds, "--world-seeds", UsageError)

    def run(self) -> int:
        from thalweg.core.compute.device import resolve_device

        if self.sample and self.deterministic:
            raise UsageError("give --sample or --deterministic, not both")
        if self.hard and self.no_hard:
            raise UsageError("give --hard or --no-hard, not both")
        if self.out is not None:
            check_file("--out", self.out, ".csv")
        reach = self.river.reach("--levels", self.levels, levels_have_banks=True)
        if reach is not None and self.unseen:
            raise UsageError("--unseen goes with --levels: a file has only one river")
        if reach is None and self.world_seed is not None:
            raise UsageError("--world-seed goes with --river; rivers of the levels are chosen with --world-seeds")
        if self.seeds and (self.unseen or reach is not None):
            other = (
                "--unseen, which chooses its own rivers"
                if self.unseen
                else "--river, whose plants and hills --world-seed chooses"
            )
            raise UsageError(f"--world-seeds does not go with {other}")
        resolve_device(self.device)  # before a river is built
        levels = [self.river.on_banks(level) for level in self.levels]
        evaluate_and_print(self, levels if reach is None else (reach,))
        return 0


def evaluate_and_print(command: Evaluate, rivers: "Sequence[str | Reach]") -> None:
    """Fly on levels, by name, by default all of the vehicle, or on a real river; print the tables, and write the rows
    if asked to."""
    from rich.console import Console

    from thalweg.bench.evaluate.baselines import DRAWN, sight_of
    from thalweg.bench.evaluate.episodes import Episode, write_episodes
    from thalweg.bench.evaluate.evaluation import Label, evaluate, observation_function
    from thalweg.bench.evaluate.functions import FunctionPolicy
    from thalweg.bench.evaluate.progress import complete, progress_bar, track_episodes
    from thalweg.bench.evaluate.shielded import FlightShield, check_masks, check_moves
    from thalweg.bench.results.results import Results
    from thalweg.cli.tables import make_console, print_tables
    from thalweg.core.notices import notice
    from thalweg.render import Randomisation
    from thalweg.train.fast_steps import other_steps_in_words
    from thalweg.train.observations import context_of

    console = make_console()
    policy = load_named_policy(command.policy, command.vehicle or "uav")
    rivers = _named_once(rivers or _usual_levels(command, policy))
    if command.sample:
        policy = sampling(policy, command.policy)
    config = command.config_for(policy)  # what does not go together is refused before anything is loaded
    trained = "env" in context_of(policy) and not isinstance(policy, FunctionPolicy)
    if trained and (told := other_steps_in_words(policy, config.env.task)):
        notice(told)
    encoder = _encoder_for(policy, command, config.env)
    if command.shield:
        check_masks(policy, encoder)
        check_moves(config.env.action)
    name = _name_of(policy, command, config.env.camera)
    rows: list[Episode] = []
    for river in rivers:
        courses, level = _courses(command, config, river, drawn=command.shield or sight_of(policy) in DRAWN)
        with progress_bar(Console(stderr=True), "episodes") as progress:
            for course in courses:
                if command.randomise:
                    course = course.varied(Randomisation(), config)
                scene = course if command.randomise else course.world
                drawn: Any = {"shielded": command.shield, "quality": command.quality, "camera": config.env.camera}
                observe = observation_function(policy, scene, encoder, command.device, **drawn)
                which = f", river {course.world.seed}" if command.unseen or len(command.seeds) > 1 else ""
                on_step = track_episodes(progress, f"{name} on {level}{which}", len(course.starts))
                label = Label(name, command.seed, level)
                shield = FlightShield() if command.shield else None
                rows.extend(evaluate(policy, course, label, config, observe=observe, on_step=on_step, shield=shield))
                complete(progress)
    if command.out is not None:
        write_episodes(command.out, rows)
    print_tables(console, Results(Path(), {}, [], rows, [], []), published=_is_papers_study(policy, config.env))
    if command.shield:
        vetoes, steps = sum(row.vetoes for row in rows), sum(row.length for row in rows)
        console.print(f"The shield replaced {vetoes:,} of {steps:,} moves.", highlight=False)
    if command.out is not None:
        console.print(f"One row per episode: {command.out}", highlight=False, markup=False)


def _usual_levels(command: Evaluate, policy: "Policy | RecurrentPolicy") -> list[str]:
    """Return the names of the levels of the vehicle that is steered, on the banks that are asked for."""
    from thalweg.env.vehicle.levels import LEVELS_OF
    from thalweg.train.observations import vehicle_of

    return [command.river.on_banks(level) for level in LEVELS_OF[command.vehicle or vehicle_of(policy)]]


def _named_once(rivers: "Sequence[str | Reach]") -> "list[str | Reach]":
    """Return rivers with the usual spelling of levels; raises `ResultsError` for one that is named twice."""
    from thalweg.bench.csv_files import ResultsError
    from thalweg.world import Reach, level_named

    named = [river if isinstance(river, Reach) else level_named(river).name for river in rivers]
    for river in named:
        if named.count(river) > 1:
            raise ResultsError(f"--levels names {river} twice; each level is flown once")
    return named


def _is_papers_study(policy: "Policy | RecurrentPolicy", rules: "EnvConfig") -> bool:
    """Return whether flights of a policy by these rules can be compared with the paper's."""
    from thalweg.bench.evaluate.baselines import sight_of
    from thalweg.env.tasks import PAPER_TASK

    papers_rules = rules.task == PAPER_TASK and rules.vehicle == "uav" and not rules.has_forces
    return papers_rules and sight_of(policy) != "privileged"


def _name_of(policy: "Policy | RecurrentPolicy", command: Evaluate, camera: "Camera") -> str:
    """Return the name of a policy in rows and tables, with what is unusual about its flights through a camera in
    brackets."""
    from thalweg.bench.evaluate.baselines import BASELINES
    from thalweg.bench.evaluate.functions import FunctionPolicy
    from thalweg.bench.packaged import PACKAGED_POLICIES
    from thalweg.cli.flown_camera import camera_in_words

    if isinstance(policy, FunctionPolicy):
        name = policy.name
    else:
        named = command.policy in (*BASELINES, *PACKAGED_POLICIES)
        name = command.policy if named else Path(command.policy).resolve().name
    unusual = {
        "sampled": command.sample,
        "shield": command.shield,
        "fast frames": command.quality == "fast",
        "varied looks": command.randomise,
    }
    told = [*(words for words, applies in unusual.items() if applies)]
    told += filter(None, [camera_in_words(policy, camera, command.camera)])
    return name + "".join(f" ({words})" for words in told)


def _encoder_for(policy: "Policy | RecurrentPolicy", command: Evaluate, rules: "EnvConfig") -> "Encoder | None":
    """Return the encoder whose codes a policy sees, None for one that sees none.

    Raises `UsageError` for an encoder that a policy which sees no frames through one is given, and the errors
    of `encoder_of`, `load_compatible_encoder` and `check_policy_fits`.
    """
    from thalweg.bench.evaluate.baselines import sight_of
    from thalweg.train.encoder_of_run import encoder_of
    from thalweg.train.observations import IN_WORDS, check_policy_fits, observation_of
    from thalweg.train.river import load_compatible_encoder

    sight = sight_of(policy)
    if command.encoder is not None and sight not in ("privileged", "images", "frames"):
        raise UsageError(f"{command.policy} sees no frames: leave --encoder {command.encoder} out")
    if sight in ("privileged", "images") and command.encoder is not None:
        instead = "frames" if sight == "privileged" else "codes of an encoder"
        raise UsageError(
            f"{command.policy} sees {IN_WORDS[observation_of(policy)]}, not {instead}: leave --encoder"
            f" {command.encoder} out"
        )
    file = encoder_of(policy) if sight == "frames" and command.encoder is None else command.encoder
    encoder = load_compatible_encoder(file, command.device) if sight == "frames" else None
    fits: dict[str, Any] = {
        "task": rules.task,
        "vehicle": rules.vehicle,
        "action": rules.action,
        "dynamics": rules.dynamics,
    }
    check_policy_fits(policy, encoder, **fits)
    return encoder


def load_named_policy(name: str, vehicle: str = "uav", *, trained: bool = False) -> "Policy | RecurrentPolicy":
    """Return a baseline, a packaged policy, a function, or the policy of a run's folder or a file.

    With `trained`, the error of an unknown name offers no baselines and functions. Raises `ResultsError` for a name of
    none of these, and the errors of the one that it is.
    """
    from thalweg.bench.csv_files import ResultsError
    from thalweg.bench.evaluate.baselines import BASELINES
    from thalweg.bench.evaluate.functions import FunctionPolicy, is_reference
    from thalweg.bench.packaged import PACKAGED_POLICIES, policy_path
    from thalweg.train import load_policy

    if name in BASELINES:
        return BASELINES[name]
    if is_reference(name):
        return FunctionPolicy.load(name, vehicle=vehicle)
    path = policy_path(name)
    if not path.exists():
        known = (*PACKAGED_POLICIES,) if trained else (*PACKAGED_POLICIES, *BASELINES)
        function = "" if trained else " a function such as fly.py:fly,"
        raise ResultsError(
            f"no policy at {path}{did_you_mean(name, known)}; give a run's folder, a policy file,{function}"
            f" or one of: {', '.join(known)}"
        )
    return load_policy(path)


def sampling(policy: "Policy | RecurrentPolicy", name: str) -> "Policy | RecurrentPolicy":
    """Return a policy that samples its actions; raises `UsageError` for one without probabilities of actions, such as a
    baseline, a planner, or a policy that gives one action."""
    actions = getattr(policy, "actions", None)
    if not hasattr(policy, "greedy") or (actions is not None and actions.kind == "point"):
        raise UsageError(f"--sample is for policies with probabilities of actions; {name} has none")
    policy = copy.copy(policy)
    policy.greedy = False  # pyright: ignore[reportAttributeAccessIssue]
    return policy


def _courses(
    command: Evaluate, config: "EvaluationConfig", river: "str | Reach", *, drawn: bool
) -> "tuple[Iterable[Course], str]":
    """Return the courses of a level, or of a real river, and the name that their rows have."""
    from thalweg.bench.evaluate.course import Course
    from thalweg.train.river import announce_build

    if isinstance(river, str):
        if command.unseen:
            return Course.unseen(river, config, drawn=drawn), river
        if command.seeds:
            return Course.of_seeds(river, command.seeds, config, drawn=drawn), river
        return [Course.of_level(river, config, drawn=drawn)], river
    world_seed = command.world_seed or 0
    river.check()
    announce_build(river, world_seed)
    return [Course.on(river.build(world_seed), config)], river.name
