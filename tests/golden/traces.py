"""Traces of behaviour: a few numbers for everything that has a version in `thalweg.core.versions`.

Each trace is a function without arguments that returns named arrays, the same in every process of a machine.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch

from tests.algos import rollouts
from tests.encoder.synthetic_frames import synthetic_frames
from tests.env.handmade import ring
from tests.env.task.priced.flights import PRICED, erratic
from tests.env.vehicle.basins import arch_at, basin
from tests.render import golden as golden_frames
from tests.render import lake
from tests.train.small_runs import rows_of, small, train
from thalweg.algos import ALGORITHMS
from thalweg.algos.imitation.config import ImitationConfig
from thalweg.algos.imitation.student import Lesson, Student
from thalweg.algos.interface import Feedback, Task
from thalweg.algos.offpolicy.replay_buffer import valid_transitions
from thalweg.algos.onpolicy.agent import cost_signals, reward_signal
from thalweg.algos.onpolicy.config import ConstrainedConfig
from thalweg.algos.policy.actions import actions_of
from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label, evaluate
from thalweg.bench.packaged import PACKAGED_POLICIES, PACKAGED_RGB
from thalweg.core import versions
from thalweg.core.cache import file_hash
from thalweg.core.compute.torch_threads import torch_threads
from thalweg.core.config import parse_config
from thalweg.encoder import DEFAULT_PATH, PACKAGED, load_encoder, train_encoder
from thalweg.encoder.vae import VAEConfig
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.moves import MOVE_OPTIONS
from thalweg.env.physics.wind import Wind
from thalweg.env.shield.moves import VERDICTS
from thalweg.env.shield.shield import Shield
from thalweg.env.shield.water_map import LEAST, MOST
from thalweg.env.spaces import action_space
from thalweg.env.task.altimeter import heights_above_water
from thalweg.render import Camera, Look, Renderer
from thalweg.render.records.quality import QUALITIES
from thalweg.world import World, load_or_build

Trace = dict[str, np.ndarray]


@dataclass(frozen=True)
class Golden:
    """A version and the trace that guards it."""

    version_name: str
    """As it is written in `thalweg/core/versions.py`."""
    version: int
    function: Callable[[], Trace]
    tolerance: float = 1e-3
    """Relative difference that another processor or library may cause."""
    smallest: float = 1e-3
    """Values below this one may differ by as much as this one may."""

    def trace(self) -> Trace:
        """Return the trace, computed with one thread of PyTorch, on whose number last bits depend."""
        with torch_threads(1):
            return self.function()


def world() -> Trace:
    """Sizes and means of the maps of each level's fixed river, of another seed, and of a line."""
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    line = np.stack([104 * np.cos(angle), 80 * np.sin(angle), np.zeros(60), np.full(60, 7.0)], axis=1)
    worlds = {level: load_or_build(level) for level in ("Easy", "Medium", "Hard")}
    worlds |= {"Medium 7": load_or_build("Medium", 7), "line": World.from_centerline(line, plants=False)}
    return {name: _summary(each) for name, each in worlds.items()}


def _summary(world: World) -> np.ndarray:
    maps = (world.ground_m, world.water_m, world.albedo, world.sun, world.sky, world.canopy_m)
    points = (world.river.position_m, world.river.width_m, world.islands, world.bridges, world.plants.position_m)
    means = [float(np.mean(each, dtype=np.float64)) if each.size else 0.0 for each in (*maps, *points)]
    spreads = [float(np.std(each, dtype=np.float64)) if each.size else 0.0 for each in (*maps, *points)]
    return np.array([world.ground_m.size, len(world.plants.kind), *means, *spreads])


def render() -> Trace:
    """Mean colour and share of water of the kept frames' views, in both qualities, and of their depths and classes."""
    worlds = [load_or_build(level) for level in golden_frames.LEVELS]
    poses = golden_frames.poses_of(golden_frames.load()[0])
    index, times = np.repeat(np.arange(len(worlds)), golden_frames.EACH), 1.5 * np.arange(len(poses))
    found = {}
    for quality in QUALITIES:
        frames = Renderer(worlds, quality=quality).render(poses, index, times)
        found[quality] = frames.mean(axis=(1, 2), dtype=np.float64)
    layers = Renderer(worlds).render_layers(poses, index, times)
    found["depth"] = np.where(layers.depth_m < 0, 0.0, layers.depth_m).mean(axis=(1, 2), dtype=np.float64)
    found["class"] = np.array([np.bincount(each.ravel(), minlength=5) for each in layers.class_id], np.float64)
    return found


def banks() -> Trace:
    """Sizes and means of the maps of a river with all kinds of banks, and what its frames show, in both qualities."""
    world = load_or_build("Easy+meadow+reeds_60-130+quay_130-200")
    river, found = world.river, {"world": _summary(world)}
    poses = [
        [*river.position_m[at], river.level_m[at] + height, np.arctan2(*river.tangent[at, ::-1])]
        for at, height in ((20, 2.0), (70, 4.0), (110, 3.0), (125, 8.0))
    ]
    for quality in QUALITIES:
        frames = Renderer([world], quality=quality).render(poses)
        found[quality] = frames.mean(axis=(1, 2), dtype=np.float64)
    layers = Renderer([world]).render_layers(poses, layers=("class_id",))
    found["class"] = np.array([np.bincount(each.ravel(), minlength=5) for each in layers.class_id], np.float64)
    return found


def props() -> Trace:
    """Mean colour, class and depth of a lake with one prop of each kind, in both qualities and two looks."""
    found = {}
    poses, rows = np.repeat(lake.POSE, 2, axis=0), np.repeat(lake.ALL, 2, axis=0)
    rows[1, :, -1] += 2.0
    looks = [Look(), Look(haze=20.0, warmth=0.5, ripple=0.3)]
    for quality in QUALITIES:
        renderer = Renderer([lake.lake(bridges=lake.arch_at(24.0))], Camera(64, 64), quality)
        layers = renderer.render_layers(poses, time_s=1.0, look=looks, props=rows)
        found[quality] = layers.rgb.mean(axis=(1, 2), dtype=np.float64)
        found[f"{quality} class"] = np.array([np.bincount(each.ravel(), minlength=9) for each in layers.class_id])
        found[f"{quality} depth"] = np.where(layers.class_id > 4, layers.depth_m, 0.0).mean(axis=(1, 2), dtype=float)
    return found


def privileged() -> Trace:
    """What the ideal eye sees at 64 starts on Medium and on Hard: mean and deviation of each number."""
    found = {}
    for level in ("Medium", "Hard"):
        seen, _ = RiverVectorEnv([load_or_build(level)], 64, EnvConfig(observation="privileged")).reset(seed=3)
        found[level] = np.concatenate([seen.mean(axis=0), seen.std(axis=0)])
    return found


def proprioception() -> Trace:
    """What vehicles feel in random flights on a hand-made ring: mean and deviation of each number."""
    felt = EnvConfig(observation=("proprioception",), allow_backward=True)
    env = RiverVectorEnv([ring(level_m=0.5)], 16, felt)
    env.reset(seed=3)
    rng = np.random.default_rng(7)
    seen = np.array([env.step(rng.integers(0, 3, (16, 4)))[0]["proprioception"] for _ in range(60)], np.float64)
    return {"mean": seen.mean(axis=(0, 1)), "deviation": seen.std(axis=(0, 1))}


def rules() -> Trace:
    """What random actions and the scripted pilot earn, cost and end with on a hand-made ring and on Hard."""
    found = {}
    for name, worlds, drawn in (("ring", [ring()], 1.0), ("Hard", [load_or_build("Hard")], 0.2)):
        env = RiverVectorEnv(worlds, 8, EnvConfig(observation="none"))
        rng = np.random.default_rng(7)
        env.reset(seed=3)
        rewards, costs, reasons = np.zeros(8), np.zeros((8, 2)), []
        for _ in range(200):
            guided = env.pilot_actions()
            actions = np.where(rng.random((8, 1)) < drawn, rng.integers(0, 3, (8, 4)), guided)
            _, reward, _, _, info = env.step(actions)
            rewards += reward
            costs += info["costs"]
            reasons.append(info["done_reason"])
        found[name] = np.concatenate([rewards, costs.ravel(), np.bincount(np.ravel(reasons) + 1, minlength=12)])
        found[f"{name} poses"] = env.get_state()["pose"]
    return found


def forces() -> Trace:
    """Poses, winds, velocities and costs of random flights on a hand-made ring, under all forces and in the wind."""
    weather = {"wind": Wind(), "current_m_per_s": (0.2, 0.6), "carried_by_current": True}
    cases = {"all": {"action": "continuous", "dynamics": "inertial", **weather}, "wind": {"wind": Wind()}}
    found = {}
    for name, options in cases.items():
        env = RiverVectorEnv(ring(), 8, EnvConfig(observation="none", **options))
        rng, costs = np.random.default_rng(7), np.zeros((8, 2))
        env.reset(seed=3)
        for _ in range(60):
            units = np.where([[False, True, True, True]], rng.integers(-1, 2, (8, 4)), 0)
            *_, info = env.step(units.astype(np.float32) if name == "all" else 1 - units)
            costs += info["costs"]
        last, ended = info.get("final_info", info), info.get("_final_info", np.zeros(8, bool))[:, None]
        for part in ("pose", "wind", "velocity"):  # of the episode that the last action belongs to
            if part in info:
                found[f"{name} {part}"] = np.where(ended, last[part], info[part])
        found[f"{name} costs"] = costs
    return found


def vehicles() -> Trace:
    """What random actions and the pilot of the boat earn, cost and end with on Easy and in a basin, what its ideal eye
    tells, what it hits when it turns and moves, and its velocity with inertia in the wind."""
    rocky = basin(lambda x, y: 0.5 + 0.05 * np.abs(y - 4.0), rocks=((20.0, 1.0, 0.7),), bridges=arch_at(35.0, 10.0))
    found = {}
    for name, world in (("Easy", load_or_build("Easy")), ("basin", rocky)):
        env = RiverVectorEnv([world], 8, EnvConfig(observation="privileged", vehicle="asv"))
        rng = np.random.default_rng(7)
        seen, _ = env.reset(seed=3)
        rewards, costs, reasons = np.zeros(8), np.zeros((8, 3)), []
        for _ in range(100):
            guided = env.pilot_actions()
            actions = np.where(rng.random((8, 1)) < 0.3, rng.integers(0, 3, (8, 4)), guided)
            seen, reward, _, _, info = env.step(actions)
            rewards += reward
            costs += info["costs"]
            reasons.append(info["done_reason"])
        found[name] = np.concatenate([rewards, costs.ravel(), np.bincount(np.ravel(reasons) + 1, minlength=12)])
        found[f"{name} poses"] = env.get_state()["pose"]
        found[f"{name} seen"] = seen
    turned = RiverVectorEnv([basin(rocks=((29.1, -0.66, 0.05),))], 1, EnvConfig(observation="none", vehicle="asv"))
    turned.reset(seed=0, options={"pose": [30.0, 0.0, 1.2, 0.0]})
    found["turn and move"] = turned.step(np.array([[1, 0, 0, 1]]))[4]["done_reason"]
    options: Any = {"action": "continuous", "dynamics": "inertial", "wind": Wind()}
    pushed = RiverVectorEnv([basin()], 2, EnvConfig(observation="none", vehicle="asv", **options))
    pushed.reset(seed=1)
    found["pushed"] = pushed.step(np.array([[1.0, 0.2, 0.5, 0.0]] * 2, np.float32))[4]["velocity"]
    return found


def tasks() -> Trace:
    """What erratic flights earn and cost in each task, and where they end, on a hand-made ring and on Hard."""
    found = {}
    for task in PRICED:
        for name, world in (("ring", ring()), ("Hard", load_or_build("Hard"))):
            env = RiverVectorEnv(world, 6, EnvConfig(observation="privileged", task=task))
            rng = np.random.default_rng(5)
            env.reset(seed=3)
            rewards, costs = np.zeros(6), np.zeros((6, 3))
            for _ in range(60):
                seen, reward, _, _, info = env.step(erratic(env, rng))
                rewards += reward
                costs += info["costs"]
            state, limits = env.get_state(), env.courses.max_steps
            found[f"{task} {name}"] = np.concatenate([rewards, costs.ravel(), state["pose"].ravel(), limits])
            found[f"{task} {name} seen"] = seen.astype(np.float64)
    return found


def deadlines() -> Trace:
    """Whether episodes that hover until the step limit terminate or are truncated, in the paper's task and others, and
    what of learning goes on beyond a limit, by whether critics are told the share of steps."""
    found = {}
    for task in ("River", *PRICED):
        env = RiverVectorEnv(ring(), 2, EnvConfig(observation="none", task=task, max_steps=5))
        env.reset(seed=3)
        found[task] = np.array([env.step(np.ones((2, 4), np.int64))[2:4] for _ in range(5)], np.float64)
    steps = rollouts.cut_off(torch.zeros(5, 1, 2), 4)
    for told in (0, 1):
        config = ALGORITHMS["FOCOPS"].configure({"asymmetric_critics": bool(told)})
        signals = [reward_signal(config, steps), *cost_signals(config, steps)]
        found[f"on-policy {told}"] = np.array([float(each.ends_at_limit) for each in signals])
        found[f"off-policy {told}"] = valid_transitions(steps, told).continues.numpy()
    return found


def evaluation() -> Trace:
    """Starts on Easy, and evaluated episodes of baselines."""
    config = EvaluationConfig(episodes=2)
    course = Course.of_level("Easy", config)
    found = {"starts": np.asarray(course.starts)}
    for name in ("random", "hover", "forward", "pilot"):
        rows = evaluate(BASELINES[name], course, Label(name, 0, "Easy"), config)
        found[name] = np.array([[row.return_, row.cost, row.length] for row in rows])
    return found


def algorithm(name: str) -> Trace:
    """Parameters and metrics of a small learner after each of three updates on fixed observations and rewards."""
    return _learning(name, rollouts.feedback(0.5, length=5.0, lowest=0.5), lambda actions: (actions != 0)[..., :1])[0]


LIMITS: dict[str, tuple[dict[str, Any], tuple[float, ...]]] = {
    "a limit": ({"cost_limit": 0.44, "cost_limit_schedule": ()}, (0.5,)),
    "two limits": (
        {"cost_limits": (0.44, 0.3), "cost_limit_schedule": (), "standardise_cost": False},
        (0.5, 0.32),
    ),
}
"""Limits, and mean costs that exceed them by so little that there are steps which keep them."""
OF_LIMITS = ("multiplier", "multiplier_tight", "multiplier_loose", "gate", "binding", "rectifies", "projection_passes")
"""Metrics that are 0 unless a limit is exceeded."""


def above(name: str, limits: str) -> Trace:
    """As `algorithm`, where what pays costs, the mean costs exceed the limits, and metrics that are 0 otherwise."""
    settings, costs = LIMITS[limits]
    settings = settings | ({"centre_minibatches": False} if name == "P3O" and len(costs) > 1 else {})
    told = rollouts.feedback(*costs, length=5.0, lowest=0.2)
    found, metrics = _learning(name, told, lambda actions: (actions == 0)[..., : len(costs)], **settings)
    return found | {key: np.array([each[key] for each in metrics]) for key in OF_LIMITS if key in metrics[0]}


def _learning(
    name: str, told: Feedback, costly: Callable[[torch.Tensor], torch.Tensor], **changes: Any
) -> tuple[Trace, list[dict[str, float]]]:
    """The trace of a learner that is told the same in each update, and its metrics in each, where option 0 of the first
    branch pays 1, and each action [T, N, A] costs 1 that is `costly` [T, N, M]."""
    settings = small(name) | {"steps_per_update": 128} | changes
    envs, steps, size = 4, 32, 5
    space = gymnasium.spaces.MultiDiscrete([3, 3])
    learner: Any = ALGORITHMS[name].make(ALGORITHMS[name].config(**settings), Task(size, space, envs, 0, {}))
    steps = learner.rollout_steps
    found, begun, log = {}, torch.ones(1, envs, dtype=torch.bool), []
    for update in range(3):
        generator = torch.Generator().manual_seed(update)
        obs = torch.randn(steps + 1, envs, size, generator=generator)
        ends = torch.rand(steps, envs, generator=generator) < 0.2
        fresh, begun = torch.cat([begun, ends]), ends[-1:]  # other episodes go on in the next rollout
        actions = torch.stack([learner.act(obs[t], fresh[t]) for t in range(steps)])
        good = (actions[..., 0] == 0).float()
        costs = costly(actions).float()
        rollout = rollouts.rollout_of(obs, actions=actions, rewards=good, costs=costs, terminated=ends, fresh=fresh)
        metrics = learner.update(rollout, told)
        log.append(metrics)
        found[f"metrics {update}"] = np.array([value for key, value in sorted(metrics.items()) if "time" not in key])
        found[f"actions {update}"] = actions.double().mean((0, 1)).numpy()
    return found | {"state": _parameters(learner.state())}, log


def _parameters(state: dict) -> np.ndarray:
    """Mean and spread of every array of a state, in the order of their names."""
    rows = []
    for _, value in sorted(_arrays(state)):
        values = np.asarray(value, np.float64)
        rows.append([values.mean(), values.std()])
    return np.array(rows)


def _arrays(state: dict, prefix: str = ""):
    for key, value in state.items():
        if isinstance(value, dict):
            yield from _arrays(value, f"{prefix}{key}.")
        elif isinstance(value, np.ndarray | torch.Tensor) and len(np.shape(value)):
            yield f"{prefix}{key}", value.numpy() if isinstance(value, torch.Tensor) else value


def training() -> Trace:
    """Episodes of a run of PPO on a walk of chance, and its metrics but for times."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "run"
        train(folder, "PPO", steps=600, config=small("PPO") | {"discount": 0.99})
        episodes = rows_of(folder, "episodes.csv")
        metrics = rows_of(folder, "metrics.csv")
    columns = ("step", "return", "cost", "length")
    timing = ("time_", "seconds", "steps_per_second")
    return {
        "episodes": np.array([[float(row[name]) for name in columns] for row in episodes]),
        "metrics": np.array(
            [[float(value or "nan") for key, value in row.items() if not key.startswith(timing)] for row in metrics]
        ),
    }


def encoder() -> Trace:
    """Codes and errors of an encoder after two epochs on synthetic frames."""
    images = synthetic_frames(48, 64)
    with tempfile.TemporaryDirectory() as name:
        config = VAEConfig(size_px=64, latent=4)
        result = train_encoder(
            images, config, name, epochs=2, batch=16, held_out=8, precision="float32", progress=False
        )
        codes = load_encoder(result.path)(images[:8])
    return {"errors": np.array([result.train_mse, result.held_out_mse]), "codes": np.asarray(codes, np.float64)}


def packaged_encoder() -> Trace:
    """The hash of the packaged encoder's file, and its codes of synthetic frames."""
    codes = load_encoder()(synthetic_frames(4, 128))
    return {"file": _digits(DEFAULT_PATH), "codes": np.asarray(codes, np.float64)}


def packaged_geometry(name: str = "geometry") -> Trace:
    """The hash of the file of a packaged encoder of geometry, and its codes and predictions of synthetic frames."""
    encoder = load_encoder(name)
    codes = encoder(synthetic_frames(4, 128))
    found = {"codes": codes, "predictions": encoder.predict(codes)}
    return {"file": _digits(PACKAGED[name])} | {key: each.astype(np.float64) for key, each in found.items()}


def packaged_policy(name: str = "packaged") -> Trace:
    """The hash of the file of a packaged policy."""
    return {"file": _digits(PACKAGED_POLICIES[name])}


def steady() -> Trace:
    """The steady pilot's worths along its flight on Medium."""
    env = RiverVectorEnv([load_or_build("Medium")], 4, EnvConfig(observation="none"))
    env.reset(seed=3)
    worths = []
    for _ in range(40):
        worths.append(env.move_worths())
        env.step(env.pilot_actions("steady"))
    return {"worths": np.maximum(np.array(worths), -100.0)}


def imitation() -> Trace:
    """Losses of a student over three lessons, and what its teacher gives to moves."""
    settings = {"observation": "mask", "filters": [4, 4, 4, 4], "features": 8, "memory_size": 8, "hidden": [8]}
    config = parse_config(ImitationConfig, settings)
    student = Student(config, actions_of(action_space("multidiscrete")), MOVE_OPTIONS, (3, 8), seed=0, context={})
    rng = np.random.default_rng(0)
    losses = []
    for _ in range(3):
        lesson = Lesson(
            torch.from_numpy(rng.integers(0, 256, (4, 4, 128 * 128 + 4)).astype(np.uint8) % 4),
            torch.from_numpy(rng.random((4, 4)) < 0.2),
            torch.zeros(4, 8),
            torch.from_numpy(rng.normal(size=(4, 4, len(MOVE_OPTIONS))).astype(np.float32)),
            torch.from_numpy(rng.normal(size=(4, 4, 3)).astype(np.float32)),
            torch.from_numpy(rng.integers(0, 2, (4, 4, 8)).astype(np.uint8)),
        )
        student.update_scale(lesson.privileged.flatten(0, 1))
        losses.append(list(student.learn(lesson).values()))
    return {"losses": np.array(losses)} | steady()


def shield() -> Trace:
    """Odds, poses, and counts of the verdicts on the scripted pilot's moves and random ones, by masks of Medium."""
    env = RiverVectorEnv([load_or_build("Medium")], 4, EnvConfig(observation="mask"))
    masks, _ = env.reset(seed=3)
    guard, rng, verdicts = Shield(4), np.random.default_rng(7), []
    for _ in range(40):
        random = MOVE_OPTIONS[rng.integers(len(MOVE_OPTIONS), size=4)]
        proposed = np.where(rng.random((4, 1)) < 0.5, random, env.pilot_actions("scripted"))
        heights = heights_above_water(env.courses, env.state)
        made, found = guard.screen(np.arange(4), masks[..., 0], heights, proposed)
        verdicts.append(found)
        masks, *_ = env.step(made)
    counts = np.bincount(np.ravel(verdicts), minlength=len(VERDICTS))
    odds = np.array([np.bincount(each.ravel() - LEAST, minlength=MOST - LEAST + 1) for each in guard.maps.odds])
    return {"verdicts": counts, "odds": odds, "poses": guard.vehicles.pose}


def _digits(path: Path) -> np.ndarray:
    return np.array([int(digit, 16) for digit in file_hash(path)], np.float64)


CONSTRAINED = [name for name, entry in ALGORITHMS.items() if issubclass(entry.config, ConstrainedConfig)]
"""Algorithms on policy with cost limits."""
GOLDENS: dict[str, Golden] = {
    "world": Golden("WORLD", versions.WORLD, world, tolerance=1e-4),
    "render": Golden("RENDER", versions.RENDER, render, tolerance=0.02),
    "banks": Golden("BANKS", versions.BANKS, banks, tolerance=0.02),
    "props": Golden("PROPS", versions.PROPS, props, tolerance=0.02),
    "rules": Golden("RULES", versions.RULES, rules, tolerance=1e-9),
    "forces": Golden("FORCES", versions.FORCES, forces, tolerance=1e-9),
    "tasks": Golden("TASKS", versions.TASKS, tasks, tolerance=1e-6, smallest=1e-3),
    "deadlines": Golden("DEADLINES", versions.DEADLINES, deadlines, tolerance=0.0),
    "vehicles": Golden("VEHICLES", versions.VEHICLES, vehicles, tolerance=1e-6, smallest=1e-5),
    "privileged": Golden("PRIVILEGED", versions.PRIVILEGED, privileged, tolerance=1e-4, smallest=1e-3),
    "proprioception": Golden("PROPRIOCEPTION", versions.PROPRIOCEPTION, proprioception, tolerance=1e-4, smallest=1e-3),
    "evaluation": Golden("EVALUATION", versions.EVALUATION, evaluation, tolerance=1e-9),
    "training": Golden("TRAINING", versions.TRAINING, training),
    "encoder": Golden("ENCODER", versions.ENCODER, encoder, tolerance=0.05, smallest=0.05),
    "packaged encoder": Golden("PACKAGED_ENCODER", versions.PACKAGED_ENCODER, packaged_encoder, tolerance=0.02),
    "packaged geometry": Golden("PACKAGED_GEOMETRY", versions.PACKAGED_GEOMETRY, packaged_geometry, tolerance=0.02),
    "packaged geometry of tasks": Golden(
        "PACKAGED_GEOMETRY_TASKS",
        versions.PACKAGED_GEOMETRY_TASKS,
        partial(packaged_geometry, "geometry-tasks"),
        tolerance=0.02,
    ),
    "packaged policy": Golden("PACKAGED_POLICY", versions.PACKAGED_POLICY, packaged_policy, tolerance=0.0),
    "packaged policy of images": Golden(
        "PACKAGED_RGB_POLICY", versions.PACKAGED_RGB_POLICY, partial(packaged_policy, PACKAGED_RGB), tolerance=0.0
    ),
    "shield": Golden("SHIELD", versions.SHIELD, shield, tolerance=0.02, smallest=20.0),
    "steady": Golden("STEADY", versions.STEADY, steady),
    "imitation": Golden("IMITATION", versions.IMITATION, imitation),
    **{
        name: Golden(f'ALGORITHMS["{name}"]', versions.ALGORITHMS[name], partial(algorithm, name))
        for name in versions.ALGORITHMS
    },
    **{
        f"{name} above {limits}": Golden(
            f'ALGORITHMS["{name}"]', versions.ALGORITHMS[name], partial(above, name, limits)
        )
        for name in CONSTRAINED
        for limits in LIMITS
    },
}
"""Traces by name. The frames themselves are stored as pictures in `tests/render/golden_frames`."""
