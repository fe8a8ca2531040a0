"""How small may a code be, and what should an encoder look at? The paper's two questions, and what a pilot could read.

Each case is trained in a folder of its own, by epochs: killed at any moment, the same call goes on. Its measures are
written once it is trained; the tables are made of them, and of the codes of the encoders.
"""

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from thalweg.bench.figures import STYLE, png
from thalweg.bench.files import ResultsError, csv_text
from thalweg.bench.published import RELATIVE_ENTROPY
from thalweg.bench.tables import markdown
from thalweg.encoder import Encoder, Source, VAEConfig, draw_reconstructions, load_encoder, train_encoder
from thalweg.encoder.entropy import SMOOTHING, relative_entropy
from thalweg.encoder.measure import reconstruct
from thalweg.encoder.probe import explained
from thalweg.encoder.training import split
from thalweg.encoder.water import Finder, mean_iou, train_finder, water_in
from thalweg.env.bearings import BEARINGS, bearings
from thalweg.render import RENDER_VERSION, Renderer
from thalweg.train.collect import draw_frames, river_worlds, views
from thalweg.whole import write_whole
from thalweg.world import level_named

SIZES = (1024, 512, 256, 128, 64, 32, 16, 8)
"""Numbers in a code that are compared."""
INPUTS = ("rgb", "mask", "rgb+mask")
CODE = 16
"""Numbers in the codes of different inputs."""
OTHER_SMOOTHINGS = (1e-9, 1e-4, 1e-3)
"""What else could be added to each bin, to see how much the choice matters."""
SHOWN = 8
"""Images of the figure."""
RECORD, MEASURES = "study.json", "measures.json"


@dataclass(frozen=True)
class Case:
    """An encoder to be trained."""

    inputs: str
    latent: int
    architecture: str = "lean"

    @property
    def name(self) -> str:
        return f"{self.architecture}-{self.inputs.replace('+', '-')}-{self.latent}"

    @property
    def config(self) -> VAEConfig:
        return VAEConfig(inputs=self.inputs, latent=self.latent, architecture=self.architecture)

    @property
    def precision(self) -> str:
        """bfloat16 for the paper's layers, which have nine times as many weights, else float32."""
        return "bfloat16" if self.architecture == "paper" else "float32"


SWEEP = tuple(Case("rgb+mask", size) for size in SIZES)
PAPERS = (Case("rgb+mask", 16, "paper"), Case("rgb+mask", 64, "paper"))
COMPARED = tuple(Case(inputs, CODE) for inputs in INPUTS)
CASES = tuple(dict.fromkeys((*COMPARED, *SWEEP, *PAPERS)))


@dataclass(frozen=True)
class Plan:
    """What a study is made of; a folder holds one."""

    level: str = "Medium"
    images: int = 2000
    """That are trained on."""
    held_out: int = 500
    """Further ones that are only measured."""
    epochs: int = 100
    seed: int = 0
    """Of poses and training."""
    cases: tuple[Case, ...] = CASES

    def __post_init__(self) -> None:
        for name, least in (("images", 8), ("held_out", 2), ("epochs", 1), ("seed", 0)):
            if getattr(self, name) < least:
                raise ResultsError(f"{name} must be at least {least}, not {getattr(self, name)}")


@dataclass(frozen=True)
class Scenes:
    """Frames, and what is true where they were taken; K images."""

    frames: np.ndarray
    """[K, H, W, 4] uint8."""
    truths: np.ndarray
    """[K, T] float64, see `thalweg.env.bearings`."""


def run_study(folder: Path, plan: Plan = Plan(), *, command: str = "", progress: bool = True) -> Path:
    """Train what is not trained yet, measure it, and write the tables; returns the page.

    `command` is written into the encoders' files.

    Raises `ResultsError` for a folder of another study, and the errors of `train_encoder`.
    """
    _claim(folder, plan)
    scenes = collect(plan, progress)
    kept, aside = split(len(scenes.frames), plan.held_out, plan.seed)
    finder: Finder | None = None
    for case in plan.cases:
        home = folder / case.name
        if (home / MEASURES).exists():
            continue
        source = Source(plan.level, plan.seed, RENDER_VERSION, command)
        result = train_encoder(
            scenes.frames,
            case.config,
            home,
            epochs=plan.epochs,
            seed=plan.seed,
            held_out=plan.held_out,
            precision=case.precision,
            source=source,
            progress=progress,
        )
        finder = finder or train_finder(scenes.frames[kept], plan.seed)
        found = {
            "train_mse": result.train_mse,
            "held_out_mse": result.held_out_mse,
            "mean_image_mse": result.mean_image_mse,
        } | measures(load_encoder(result.path), finder, scenes, kept, aside)
        write_whole(home / MEASURES, json.dumps(found, indent=1) + "\n")
    return write_tables(folder, plan, scenes, kept, aside)


def collect(plan: Plan, progress: bool = True) -> Scenes:
    """The study's frames, of the level's fixed river, with what is true there."""
    worlds = river_worlds(plan.level, 1)
    poses, index, clocks = views(worlds, plan.images + plan.held_out, plan.seed)
    frames = draw_frames(Renderer(worlds), poses, index, clocks, progress=progress)
    return Scenes(frames, bearings(worlds[0], poses))


def measures(encoder: Encoder, finder: Finder, scenes: Scenes, kept: np.ndarray, aside: np.ndarray) -> dict[str, Any]:
    """How well an encoder keeps the river in images held out, and what a line reads from their codes.

    `iou_ceiling` is what the finder of water makes of the frames themselves.
    """
    frames, truth = scenes.frames[aside], scenes.frames[aside, ..., 3] > 0
    pictures = reconstruct(encoder.vae, frames)
    found: dict[str, Any] = {"iou_mask": None, "iou_colours": None}
    if encoder.inputs != "rgb":
        found["iou_mask"] = mean_iou(pictures[..., -1] >= 0.5, truth)
    if encoder.inputs != "mask":
        found["iou_colours"] = mean_iou(water_in(finder, pictures[..., :3]), truth)
    found["iou_ceiling"] = mean_iou(water_in(finder, frames), truth)
    codes = [encoder(scenes.frames[part]) for part in (kept, aside)]
    read = explained(codes[0], scenes.truths[kept], codes[1], scenes.truths[aside])
    return found | {"read": dict(zip(BEARINGS, read.tolist(), strict=True))}


def write_tables(folder: Path, plan: Plan, scenes: Scenes, kept: np.ndarray, aside: np.ndarray) -> Path:
    """sizes.csv, entropy.csv, sizes.png, inputs.png and study.md, once every case has its measures."""
    known = {case: _read(folder / case.name / MEASURES) for case in plan.cases}
    rows = [size_row(case, found) for case, found in known.items()]
    write_whole(folder / "sizes.csv", csv_text(SIZE_COLUMNS, rows))
    compared = {
        case.inputs: load_encoder(folder / case.name / "encoder.safetensors") for case in COMPARED if case in known
    }
    entropies: list[list[str]] = []
    if len(compared) > 1:
        codes = {inputs: encoder(scenes.frames[kept]) for inputs, encoder in compared.items()}
        entropies = [list(row) for row in entropy_rows(codes)]
        write_whole(folder / "entropy.csv", csv_text(ENTROPY_COLUMNS, entropies))
        draw_reconstructions(scenes.frames[aside[:SHOWN]], compared, folder / "inputs.png")
    write_whole(folder / "sizes.png", png(size_figure(known)))
    write_whole(folder / "study.md", page(plan, rows, entropies))
    return folder / "study.md"


SIZE_COLUMNS = (
    "architecture",
    "inputs",
    "numbers",
    "train_mse",
    "held_out_mse",
    "mean_image_mse",
    "iou_mask",
    "iou_colours",
    "iou_ceiling",
    *(f"read_{name.replace(' ', '_')}" for name in BEARINGS),
)
ENTROPY_COLUMNS = ("first", "second", "paper", *(f"smoothing_{value:g}" for value in (SMOOTHING, *OTHER_SMOOTHINGS)))


def size_row(case: Case, found: dict[str, Any]) -> list[str]:
    """A row of sizes.csv; what an input does not have is empty."""
    values = [found[name] for name in SIZE_COLUMNS[3:9]] + [found["read"][name] for name in BEARINGS]
    cells = ["" if value is None or math.isnan(value) else f"{value:.5f}" for value in values]
    return [case.architecture, case.inputs, str(case.latent), *cells]


def entropy_rows(codes: dict[str, np.ndarray]) -> Iterable[list[str]]:
    """A row of entropy.csv for each pair of inputs, the paper's figure beside ours."""
    for (first, second), published in RELATIVE_ENTROPY.items():
        if first in codes and second in codes:
            ours = [
                relative_entropy(codes[first], codes[second], smoothing) for smoothing in (SMOOTHING, *OTHER_SMOOTHINGS)
            ]
            yield [first, second, f"{published:.3f}", *(f"{value:.3f}" for value in ours)]


def page(plan: Plan, rows: Sequence[list[str]], entropies: Sequence[list[str]]) -> str:
    """The tables, with what their columns mean."""
    names = [name.replace("read_", "").replace("_", " ") for name in SIZE_COLUMNS]
    parts = [
        "# The encoder study\n",
        f"{plan.images:,} frames of {plan.level} to train on and {plan.held_out:,} held out, {plan.epochs} epochs, seed"
        f" {plan.seed}.\n",
        "## Size, river and what a line reads\n",
        markdown(names[:9], [row[:9] for row in rows]),
        "Mean squared errors of values in 0..1. IoU of the water, on images held out: of the reconstructed mask, and of"
        " the water that a small network finds in the reconstructed colours; `iou ceiling` is what it finds in the"
        " frames themselves.\n",
        markdown(names[:3] + names[9:], [row[:3] + row[9:] for row in rows]),
        "R² on images held out of a linear regression on the code: distances to the banks, heading error, height above"
        " the water, way to the middle of the next bridge within 60 m.\n",
    ]
    if entropies:
        parts += [
            "## Inputs: relative entropy of the codes\n",
            markdown(list(ENTROPY_COLUMNS), [list(row) for row in entropies]),
            "In nats, mean over 16 numbers; `paper` is the paper's figure, of another simulator, for which it is not"
            " known what was added to empty bins.\n",
        ]
    return "\n".join(parts)


def size_figure(known: dict[Case, dict[str, Any]]) -> Figure:
    """Error against the size of the code."""
    with rc_context(STYLE):
        figure = Figure(figsize=(6, 3.6))
        axis = figure.subplots()
        for architecture, marker in (("lean", "o-"), ("paper", "s")):
            cases = sorted(
                (case for case in known if (case.architecture, case.inputs) == (architecture, "rgb+mask")),
                key=lambda case: case.latent,
            )
            for what, colour in (("train_mse", "C0"), ("held_out_mse", "C1")):
                label = f"{architecture}, {'trained on' if what == 'train_mse' else 'held out'}"
                errors = [known[case][what] for case in cases]
                if cases:
                    axis.plot([case.latent for case in cases], errors, marker, color=colour, label=label)
        axis.set_xscale("log", base=2)
        axis.set_xlabel("numbers in a code")
        axis.set_ylabel("mean squared error")
        axis.set_ylim(bottom=0)
        axis.legend(frameon=False)
    return figure


def _claim(folder: Path, plan: Plan) -> None:
    """Make the folder this study's, or raise `ResultsError` naming what differs."""
    record = json.loads(json.dumps(asdict(plan) | {"render_version": RENDER_VERSION}))
    record["level"] = level_named(plan.level).name
    path = folder / RECORD
    if path.exists():
        there = _read(path)
        differing = [
            f"{key} is {there.get(key)!r} there and {record[key]!r} here"
            for key in record
            if there.get(key) != record[key]
        ]
        if differing:
            raise ResultsError(f"{folder} belongs to another study: {'; '.join(differing)}. Choose another folder.")
        return
    if folder.exists() and any(folder.iterdir()):
        raise ResultsError(f"{folder} is not empty and holds no study; choose another folder")
    write_whole(path, json.dumps(record, indent=1) + "\n")


def _read(path: Path) -> dict[str, Any]:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ResultsError(f"{path} can't be read: {error}") from error
