"""Encoder study: a comparison of code sizes and inputs, as in the paper, with linear probes of the codes.

Each case is trained in a folder of its own; the same call resumes an interrupted study. The measures of a case are
written after its training; the tables are computed from them and from the codes of the encoders.
"""

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from thalweg.bench.csv_files import ResultsError, csv_text
from thalweg.bench.report.figures import png
from thalweg.bench.studies.encoder_tables import (
    ENTROPY_COLUMNS,
    ERRORS,
    PACKAGED_COLUMNS,
    PROBED,
    RIVER,
    SIZE_COLUMNS,
    Case,
    entropy_rows,
    packaged_row,
    page,
    size_figure,
    size_row,
)
from thalweg.bench.studies.water_segmenter import train_segmenter
from thalweg.core import versions
from thalweg.core.atomic_io import write_atomic
from thalweg.core.config import TupleOf, frozen_config, to_plain
from thalweg.core.run_folder import FolderKind
from thalweg.encoder import PACKAGED, Encoder, Source, draw_reconstructions, load_encoder, train_encoder
from thalweg.encoder.linear_probe import probe_r_squared
from thalweg.encoder.reconstruction import reconstruct
from thalweg.encoder.training import resolve_precision, split_indices
from thalweg.encoder.water import WaterSegmenter, load_segmenter, mean_iou, save_segmenter, water_in
from thalweg.env.privileged_state import privileged_state
from thalweg.env.task.ideal_eye import FEATURES, RANGE_M
from thalweg.render import RENDER_VERSION, Renderer
from thalweg.train.encoder.frames import level_worlds, render_frames, sample_views
from thalweg.world import level_named

SIZES = (1024, 512, 256, 128, 64, 32, 16, 8)
"""Code sizes that are compared."""
INPUTS = ("rgb", "mask", "rgb+mask")
CODE = 16
"""Code size at which inputs are compared."""
SHOWN = 8
"""Number of images in the figure."""
RECORD, MEASURES, SEGMENTER = "study.json", "measures.json", "finder.safetensors"
STUDY_FOLDER = FolderKind("study", RECORD, ResultsError)

SWEEP = tuple(Case("rgb+mask", size) for size in SIZES)
PAPERS = (Case("rgb+mask", 16, "paper"), Case("rgb+mask", 64, "paper"))
COMPARED = tuple(Case(inputs, CODE) for inputs in INPUTS)
CASES = tuple(dict.fromkeys((*COMPARED, *SWEEP, *PAPERS)))


def current_versions() -> dict[str, int]:
    """Return the versions that the measures of a case depend on."""
    return {
        "world": versions.WORLD,
        "render": versions.RENDER,
        "rules": versions.RULES,
        "privileged": versions.PRIVILEGED,
        "encoder": versions.ENCODER,
    }


def _known_precision(value: Any) -> Any:
    if isinstance(value, str):
        resolve_precision(value)
    return value


@frozen_config(ResultsError)
class StudyConfig:
    """Config of a study; a folder holds one study."""

    level: str = "Medium"
    images: Annotated[int, Field(ge=8)] = 2000
    """Number of training images."""
    held_out: Annotated[int, Field(ge=2)] = 500
    """Number of further images, used for measurement only."""
    epochs: Annotated[int, Field(ge=1)] = 100
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the poses and of the training."""
    precision: Annotated[str, BeforeValidator(_known_precision)] = "auto"
    """Precision of all training: "float32" or "bfloat16"; "auto" is the faster one on the machine where the study
    begins."""
    cases: TupleOf[Case] = CASES


DEFAULT_STUDY = StudyConfig()


@dataclass(frozen=True)
class Scenes:
    """K frames, and the privileged state at their poses."""

    frames: np.ndarray
    """[K, H, W, 4] uint8."""
    truths: np.ndarray
    """[K, T], the numbers `PROBED` of the ideal eye; NaN for the bridge where none is seen."""


def run_study(folder: Path, config: StudyConfig = DEFAULT_STUDY, *, command: str = "", progress: bool = True) -> Path:
    """Train and measure the cases that are not finished, write the tables, and return the path of the page.

    `command` is recorded in the encoders' files.

    Raises `ResultsError` for a folder of another study and one that another command holds, and the errors of
    `train_encoder`.
    """
    with STUDY_FOLDER.locked(folder):
        return _run_cases(folder, _claim(folder, config), command, progress)


def _run_cases(folder: Path, config: StudyConfig, command: str, progress: bool) -> Path:
    """Do what `run_study` does in a folder that is claimed."""
    scenes = collect(config, progress)
    train, held_out = split_indices(len(scenes.frames), config.held_out, config.seed)
    segmenter: WaterSegmenter | None = None
    for case in config.cases:
        case_folder = folder / case.name
        if (case_folder / MEASURES).exists():
            continue
        source = Source(config.level, config.seed, RENDER_VERSION, command)
        result = train_encoder(
            scenes.frames,
            case.config,
            case_folder,
            epochs=config.epochs,
            seed=config.seed,
            held_out=config.held_out,
            precision=config.precision,
            source=source,
            progress=progress,
        )
        segmenter = segmenter or _segmenter(folder / SEGMENTER, config, scenes.frames[train], progress)
        found = {
            "train_mse": result.train_mse,
            "held_out_mse": result.held_out_mse,
            "mean_image_mse": result.mean_image_mse,
        } | measures(load_encoder(result.path), segmenter, scenes, train, held_out)
        write_atomic(case_folder / MEASURES, json.dumps(found, indent=1) + "\n")
    return write_tables(folder, config, scenes, train, held_out)


def _segmenter(path: Path, config: StudyConfig, images: np.ndarray, progress: bool) -> WaterSegmenter:
    """Return the study's water segmenter, trained on `images` if its file does not exist."""
    if not path.exists():
        save_segmenter(path, train_segmenter(images, config.seed, precision=config.precision, progress=progress))
    return load_segmenter(path)


def collect(config: StudyConfig, progress: bool = True) -> Scenes:
    """Return the frames of the study, on the fixed river of the level, with the privileged state."""
    worlds = level_worlds(config.level, 1)
    poses, index, clocks = sample_views(worlds, config.images + config.held_out, config.seed)
    frames = render_frames(Renderer(worlds), poses, index, clocks, progress=progress)
    return Scenes(frames, probed_truths(privileged_state(worlds[0], poses)))


def probed_truths(seen: np.ndarray) -> np.ndarray:
    """Return the numbers `PROBED` [K, T] of what the ideal eye sees [K, FEATURES]."""
    truths = seen[:, [FEATURES.index(name) for name in PROBED]]
    bridge = PROBED.index("bridge")
    truths[:, bridge] = np.where(truths[:, bridge] < RANGE_M, truths[:, bridge], np.nan)
    return truths


def measures(
    encoder: Encoder, segmenter: WaterSegmenter, scenes: Scenes, train: np.ndarray, held_out: np.ndarray
) -> dict[str, Any]:
    """Return how well an encoder preserves the river in held-out images, and the R² of linear probes of the codes.

    `iou_ceiling` is the IoU of the water segmenter on the frames themselves.
    """
    frames, truth = scenes.frames[held_out], scenes.frames[held_out, ..., 3] > 0
    pictures = reconstruct(encoder.vae, frames)
    found: dict[str, Any] = {"iou_mask": None, "iou_colours": None}
    if encoder.inputs != "rgb":
        found["iou_mask"] = mean_iou(pictures[..., -1] >= 0.5, truth)
    if encoder.inputs != "mask":
        found["iou_colours"] = mean_iou(water_in(segmenter, pictures[..., :3]), truth)
    found["iou_ceiling"] = mean_iou(water_in(segmenter, frames), truth)
    codes = [encoder(scenes.frames[part]) for part in (train, held_out)]
    read = probe_r_squared(codes[0], scenes.truths[train], codes[1], scenes.truths[held_out])
    return found | {"read": dict(zip(PROBED, read.tolist(), strict=True))}


def write_tables(folder: Path, config: StudyConfig, scenes: Scenes, train: np.ndarray, held_out: np.ndarray) -> Path:
    """Write sizes.csv, packaged.csv, entropy.csv, the figures and study.md; every case must have its measures."""
    known = {case: read_measures(folder / case.name / MEASURES) for case in config.cases}
    rows = [size_row(case, found) for case, found in known.items()]
    write_atomic(folder / "sizes.csv", csv_text(SIZE_COLUMNS, ([row[name] for name in SIZE_COLUMNS] for row in rows)))
    compared = {
        case.inputs: load_encoder(folder / case.name / "encoder.safetensors") for case in COMPARED if case in known
    }
    entropies: list[list[str]] = []
    if len(compared) > 1:
        codes = {inputs: encoder(scenes.frames[train]) for inputs, encoder in compared.items()}
        entropies = [list(row) for row in entropy_rows(codes)]
        write_atomic(folder / "entropy.csv", csv_text(ENTROPY_COLUMNS, entropies))
        draw_reconstructions(scenes.frames[held_out[:SHOWN]], compared, folder / "inputs.png")
    packaged = list(packaged_rows(scenes, train, held_out))
    write_atomic(
        folder / "packaged.csv",
        csv_text(PACKAGED_COLUMNS, ([row[name] for name in PACKAGED_COLUMNS] for row in packaged)),
    )
    write_atomic(folder / "sizes.png", png(size_figure(known)))
    about = (
        f"{config.images:,} frames of {config.level} to train on and {config.held_out:,} held out,"
        f" {config.epochs} epochs in {config.precision}, seed {config.seed}."
    )
    write_atomic(folder / "study.md", page(about, rows, entropies, packaged))
    return folder / "study.md"


def packaged_rows(scenes: Scenes, train: np.ndarray, held_out: np.ndarray) -> Iterator[dict[str, str]]:
    """Yield a row of packaged.csv for each encoder that comes with the package, as far as they see these frames."""
    for name, path in PACKAGED.items():
        encoder = load_encoder(path)
        codes = [encoder(scenes.frames[part]) for part in (train, held_out)]
        read = probe_r_squared(codes[0], scenes.truths[train], codes[1], scenes.truths[held_out])
        yield packaged_row(name, encoder.latent, read)


def _claim(folder: Path, config: StudyConfig) -> StudyConfig:
    """Claim the folder for the study; return the config with the precision that the folder started with.

    Raises `ResultsError` that names the differences for a folder of another study.
    """
    path = folder / RECORD
    recorded = _read(path) if path.exists() else {}
    if config.precision == "auto":
        config = replace(config, precision=recorded.get("precision") or resolve_precision("auto"))
    record = to_plain(config) | {"render_version": RENDER_VERSION, "versions": current_versions()}
    record["level"] = level_named(config.level).name
    if STUDY_FOLDER.is_new(folder):
        write_atomic(path, json.dumps(record, indent=1) + "\n")
    else:
        STUDY_FOLDER.require_same(folder, {key: value for key, value in recorded.items() if key in record}, record)
    return config


def read_measures(path: Path) -> dict[str, Any]:
    """Return the measures in a file, see `thalweg.bench.studies.encoder_tables.Measures`; raises `ResultsError` for any
    other content."""
    found = _read(path)
    read = found.get("read")
    numbers = {name: found.get(name, ...) for name in (*ERRORS, *RIVER)}
    numbers |= {f"read.{name}": read.get(name, ...) if isinstance(read, dict) else ... for name in PROBED}
    for name, value in numbers.items():
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if value is not None and (not is_number or abs(value) > sys.float_info.max):
            told = "missing" if value is ... else f"{value!r:.40}"
            raise ResultsError(f"{path} holds no measures of the study: {name} is {told}; a number or null is needed")
    return found


def _read(path: Path) -> dict[str, Any]:
    """Return the mapping in a JSON file; raises `ResultsError` for any other content."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ResultsError(f"{path} can't be read: {error}") from error
    if not isinstance(found, dict):
        raise ResultsError(f"{path} can't be read: a mapping is needed, not {found!r:.40}")
    return found
